"""Teams that a person types: a list that is shipped, and lists of one's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.baselines.search import Team, team_line_up
from analysis.calibration.hand_typed import TEAMS
from coevo.config import read_toml
from coevo.contest import evolving_teams
from coevo.errors import InputError, nearest_name
from coevo.game import Game
from coevo.tree import parse

__all__ = ["HandTyped", "read_hand_typed", "shipped_hand_typed"]

_SHIPPED = Path(__file__).with_name("hand_typed.toml")
_EXAMPLE = '[[teams]] with name = "...", r0 = "pass", r1 = "IF_ball_is_lost(search, shoot)"'


@dataclass(frozen=True)
class HandTyped:
    """A team that somebody typed: what it is called, the number of its team, and a tree for each of its roles."""

    name: str
    team: int
    trees: Team


def shipped_hand_typed(game: Game) -> list[HandTyped]:
    """Return the teams of the shipped list that a game has place for."""
    tables = [{"name": name, "r0": first, "r1": second} for name, (first, second) in TEAMS.items()]
    found = []
    for table in [*tables, *read_toml(_SHIPPED)["teams"]]:
        try:
            found.append(_read(game, table, str(table["name"])))
        except InputError:
            continue  # it is of another game
    return found


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
    found = [_read(game, table, f"{path}: team {number}") for number, table in enumerate(tables, 1)]
    names = [(one.team, one.name) for one in found]
    twice = next((name for team, name in names if names.count((team, name)) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: expected each name once in a team, got {twice!r} twice")
    return found


def _read(game: Game, table: Mapping[str, Any], what: str) -> HandTyped:
    name = table.get("name")
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"{what}: expected name = what it is called, got {name!r}")
    roles = {role.name: number for number, role in enumerate(game.roles) if role.evolves}
    trees = {}
    for robot, text in table.items():
        if robot == "name":
            continue
        if robot not in roles:
            raise InputError(f"{what}: {robot!r} does not evolve here.{nearest_name(robot, roles)} {_EXAMPLE}")
        if not isinstance(text, str):
            raise InputError(f"{what}: expected a tree for {robot}, as text; got {text!r}")
        try:
            trees[roles[robot]] = parse(text, game.function_set(roles[robot]))
        except InputError as error:
            raise InputError(f"{what}, {robot}: {error}") from None
    for team, members in _members(game):
        if set(trees) == set(members):
            team_line_up(game, trees)
            return HandTyped(name, team, trees)
    sides = " or ".join(", ".join(game.roles[role].name for role in members) for _, members in _members(game))
    got = ", ".join(game.roles[role].name for role in sorted(trees)) or "none"
    raise InputError(f"{what}: expected a tree for each robot of one team ({sides}), got trees for {got}")


def _members(game: Game) -> Iterator[tuple[int, list[int]]]:
    for team in evolving_teams(game):
        yield team, [k for k, role in enumerate(game.roles) if role.evolves and role.team == team]
