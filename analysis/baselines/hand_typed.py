"""Teams that a person types: a list that is shipped, those of a recipe, and lists of one's own."""

from __future__ import annotations

from pathlib import Path

from analysis.calibration.hand_typed import TEAMS
from coevo.config import read_toml
from coevo.errors import InputError
from coevo.game import Game
from coevo.hand_typed import HandTyped, hand_typed_teams, read_team, read_teams
from coevo.run import Run

__all__ = ["HandTyped", "hand_typed_of", "read_hand_typed", "shipped_hand_typed"]

_SHIPPED = Path(__file__).with_name("hand_typed.toml")
_EXAMPLE = '[[teams]] with name = "...", r0 = "pass", r1 = "IF_ball_is_lost(search, shoot)"'


def shipped_hand_typed(game: Game) -> list[HandTyped]:
    """Return the teams of the shipped list that a game has place for."""
    tables = [{"name": name, "r0": first, "r1": second} for name, (first, second) in TEAMS.items()]
    found = []
    for table in [*tables, *read_toml(_SHIPPED)["teams"]]:
        try:
            found.append(read_team(game, table, str(table["name"])))
        except InputError:
            continue  # it is of another game
    return found


def hand_typed_of(run: Run) -> list[HandTyped]:
    """Return the teams of a run's recipe, and those of the shipped list that have other names.

    Raises:
        InputError: one of the recipe is wrong.
    """
    own = hand_typed_teams(run.config, run.game)
    names = {(one.team, one.name) for one in own}
    return [*own, *(one for one in shipped_hand_typed(run.game) if (one.team, one.name) not in names)]


def read_hand_typed(game: Game, path: Path) -> list[HandTyped]:
    """Read a list of teams: a TOML file with ``[[teams]]``, each with a name and the trees of one team's robots.

    Raises:
        InputError: says what was expected, and in which team.
    """
    data = read_toml(path)
    tables = data.get("teams")
    wrong = sorted(set(data) - {"teams"})
    if wrong or not isinstance(tables, list) or not tables or not all(isinstance(one, dict) for one in tables):
        got = f"; got {wrong[0]!r} beside it" if wrong else ""
        raise InputError(f"{path}: expected {_EXAMPLE}, once or more{got}")
    return read_teams(game, tables, str(path))
