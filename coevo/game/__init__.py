"""Games that trees play: the contract of a game, and soccer."""

from coevo.game.arena import Arena, Outcome, StartsDoNotFitError, Trace, load_bank, warm_up
from coevo.game.contract import Game, Played, Role, check_game, check_played, programs_of, teams_of, terminals_of
from coevo.game.functions import function_set, given_trees
from coevo.game.make import (
    Creation,
    DecisionTable,
    check_playable,
    creations,
    make_game,
    own_references,
    prepare,
)
from coevo.game.soccer import SoccerGame

__all__ = [
    "Arena",
    "Creation",
    "DecisionTable",
    "Game",
    "Outcome",
    "Played",
    "Role",
    "SoccerGame",
    "StartsDoNotFitError",
    "Trace",
    "check_game",
    "check_playable",
    "check_played",
    "creations",
    "function_set",
    "given_trees",
    "load_bank",
    "make_game",
    "own_references",
    "prepare",
    "programs_of",
    "teams_of",
    "terminals_of",
    "warm_up",
]
