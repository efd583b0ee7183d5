"""Generations of a run against each other, against outsiders, and once more: is it progress, or luck?"""

from analysis.tournament.against import (
    Against,
    Outsider,
    play_against,
    read_outsider,
    single_skill_outsiders,
)
from analysis.tournament.cross import cross_play, same_game
from analysis.tournament.dynamics import diagnoses
from analysis.tournament.play import (
    INDIVIDUALS,
    Tournament,
    chosen_generations,
    play_tournament,
    stored_tournaments,
)
from analysis.tournament.ratings import Ratings, rate
from analysis.tournament.repeats import Left, left_over, play_again

__all__ = [
    "INDIVIDUALS",
    "Against",
    "Left",
    "Outsider",
    "Ratings",
    "Tournament",
    "chosen_generations",
    "cross_play",
    "diagnoses",
    "left_over",
    "play_again",
    "play_against",
    "play_tournament",
    "rate",
    "read_outsider",
    "same_game",
    "single_skill_outsiders",
    "stored_tournaments",
]
