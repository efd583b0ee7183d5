"""Teams that a person types, as tables: in a recipe, or in a list of their own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from coevo.config import EvolutionSettings
from coevo.errors import InputError, nearest_name
from coevo.game import Game, teams_of
from coevo.tree import Tree, parse

__all__ = ["HandTyped", "hand_typed_teams", "read_team", "read_teams"]

_EXAMPLE = 'name = "...", r0 = "pass", r1 = "IF_ball_is_lost(search, shoot)"'


@dataclass(frozen=True)
class HandTyped:
    """A team that somebody typed: what it is called, the number of its team, and by number of the role its trees."""

    name: str
    team: int
    trees: Mapping[int, Tree]


def hand_typed_teams(settings: EvolutionSettings, game: Game) -> list[HandTyped]:
    """Return the teams of a recipe (``hand_typed``).

    Raises:
        InputError: as of ``read_teams``.
    """
    return read_teams(game, settings.hand_typed, "hand_typed")


def read_teams(game: Game, tables: Sequence[Mapping[str, Any]], where: str) -> list[HandTyped]:
    """Read a list of tables, each with a name and the trees of one team's robots; ``where`` it stands, for messages.

    Raises:
        InputError: says what was expected, and in which team.
    """
    found = [read_team(game, table, f"{where}: team {number}") for number, table in enumerate(tables, 1)]
    names = [(one.team, one.name) for one in found]
    twice = next((name for team, name in names if names.count((team, name)) > 1), None)
    if twice is not None:
        raise InputError(f"{where}: expected each name once in a team, got {twice!r} twice")
    return found


def read_team(game: Game, table: Mapping[str, Any], what: str) -> HandTyped:
    """Read one table; ``what`` it is, for messages.

    Raises:
        InputError: says what was expected.
    """
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
            return HandTyped(name, team, trees)
    sides = " or ".join(", ".join(game.roles[role].name for role in members) for _, members in _members(game))
    got = ", ".join(game.roles[role].name for role in sorted(trees)) or "none"
    raise InputError(f"{what}: expected a tree for each robot of one team ({sides}), got trees for {got}")


def _members(game: Game) -> Iterator[tuple[int, list[int]]]:
    for team in teams_of(game):
        members = [k for k, role in enumerate(game.roles) if role.evolves and role.team == team]
        if members:
            yield team, members
