"""Who plays with whom, from which starts, and for whom it counts.

A grouping turns the settings and the number of a generation into the groups of that generation, and nothing else: not
what happened before, since a guest is named by its generation, as the best of its role there, or stands in the settings
(``coevo.evolution.opponents``). So the groups of any generation can be worked out again from a run folder's settings.

However they are grouped, each individual is once in each of ``evaluation.rounds`` rounds, and the games of these
groups, ``evaluation.games`` together, count for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from coevo.config import EvaluationSettings, EvolutionSettings
from coevo.evolution.evaluation import group_seeds
from coevo.game import Role
from coevo.seeds import RunStream, generator

__all__ = ["FROZEN", "Groups", "games_of_run", "groups_again", "groups_of", "line_ups"]

FROZEN = -2  # in place of the generation of a guest: it is of the teams that do not evolve (``evaluation.against``)

_T = TypeVar("_T")


class _Round(NamedTuple):
    """Who meets in a round: all members of one role are in different groups.

    units: of roles, whose members play together, and for whom these groups count; whoever else plays is a guest.
    guests: whom a team that is invited consists of: the best of the last generation or of one that is drawn for each
        group, or a team that does not evolve.
    """

    units: Sequence[Sequence[int]]
    guests: Literal["last", "drawn", "frozen"]


@dataclass(frozen=True)
class Groups:
    """The groups of a generation: each plays ``games`` games.

    Attributes:
        members: (groups, roles) int64, the individual of this generation that plays; -1 where it is a guest, or none.
        guests: (groups, roles) int64, the generation whose best plays instead, or ``FROZEN``; -1 for none.
        counts: (groups, roles) bool, for whom the games count: members only.
        starts: (groups,) int64, the number of the group whose seeds are used: its own, or that of the round's first.
        games: of each group.
    """

    members: NDArray[np.int64]
    guests: NDArray[np.int64]
    counts: NDArray[np.bool_]
    starts: NDArray[np.int64]
    games: int

    def __len__(self) -> int:
        return len(self.members)

    def of(self, role: int) -> NDArray[np.int64]:
        """Return (population, rounds) the numbers of the groups that count for each individual, ascending."""
        groups = np.flatnonzero(self.counts[:, role])
        members = self.members[groups, role]
        return groups[np.argsort(members, kind="stable")].reshape(int(members.max()) + 1, -1)

    def seeds(self, run_seed: int, generation: int, group: int) -> NDArray[np.uint64]:
        """Return (games,) the seeds of a group's games."""
        return group_seeds(run_seed, generation, int(self.starts[group]), self.games)

    def seeds_of_all(self, run_seed: int, generation: int) -> list[NDArray[np.uint64]]:
        """Return the seeds of each group's games; they are drawn once where groups have the same."""
        drawn = {
            start: group_seeds(run_seed, generation, start, self.games) for start in np.unique(self.starts).tolist()
        }
        return [drawn[start] for start in self.starts.tolist()]


def groups_of(settings: EvolutionSettings, roles: Sequence[Role], generation: int) -> Groups:
    """Return the groups of a generation.

    Args:
        settings: the experiment.
        roles: of its game.
        generation: its number.
    """
    deal = generator(settings.seed, RunStream.GROUPING, generation)
    invite = generator(settings.seed, RunStream.GUESTS, generation)
    size, evolving = settings.gp.population, _evolving(roles)
    parts, first = [], 0
    for of in _rounds(settings.evaluation, roles, generation):
        members = np.full((size, len(roles)), -1)
        for role in evolving:
            members[:, role] = deal.permutation(size)
        of_round = [_split(members, unit, of.guests, roles, generation, invite) for unit in of.units]
        parts += [(*part, _starts(settings.evaluation, first, k * size, size)) for k, part in enumerate(of_round)]
        first += len(of.units) * size
    return _joined(parts, settings.evaluation)


def groups_again(
    settings: EvolutionSettings, roles: Sequence[Role], generation: int, who: tuple[int, int], draw: np.random.Generator
) -> Groups:
    """Return groups of one individual as a generation has them, a round each, with other partners and guests.

    Args:
        settings, roles, generation: as of ``groups_of``.
        who: role and index of the individual.
        draw: draws the others.
    """
    role, index = who
    parts = []
    for number, of in enumerate(_rounds(settings.evaluation, roles, generation)):
        members = np.full((1, len(roles)), -1)
        for other in _evolving(roles):
            members[0, other] = draw.integers(settings.gp.population)
        members[0, role] = index
        unit = next(unit for unit in of.units if role in unit)
        parts.append((*_split(members, unit, of.guests, roles, generation, draw), np.array([number])))
    return _joined(parts, settings.evaluation)


def games_of_run(settings: EvolutionSettings, roles: Sequence[Role], generations: int) -> int:
    """Return how many games the first generations play."""
    units = [
        sum(len(of.units) for of in _rounds(settings.evaluation, roles, generation))
        for generation in range(min(generations, 2))
    ]
    groups = sum(units[:1]) + sum(units[1:]) * (generations - 1)
    return groups * settings.gp.population * (settings.evaluation.games // settings.evaluation.rounds)


def line_ups(
    groups: Groups,
    populations: Mapping[int, Sequence[_T]],
    best_of: Callable[[int, int], _T],
    frozen: Mapping[int, _T],
    numbers: Sequence[int] | None = None,
) -> Iterator[list[_T | None]]:
    """Yield who plays in each group, for each role its tree or program, None for a role that does not evolve.

    Args:
        groups: of a generation.
        populations: by role its individuals.
        best_of: returns the best of a role in an earlier generation: ``best_of(role, generation)``.
        frozen: by role who plays in a team that does not evolve; nothing if there is none.
        numbers: of the groups; by default all.
    """
    for group in range(len(groups)) if numbers is None else numbers:
        found: list[_T | None] = []
        for role, (member, guest) in enumerate(zip(groups.members[group], groups.guests[group], strict=True)):
            if member >= 0:
                found.append(populations[role][member])
            elif guest == FROZEN:
                found.append(frozen[role])
            else:
                found.append(best_of(role, int(guest)) if guest >= 0 else None)
        yield found


def _evolving(roles: Sequence[Role]) -> list[int]:
    return [number for number, role in enumerate(roles) if role.evolves]


def _rounds(evaluation: EvaluationSettings, roles: Sequence[Role], generation: int) -> list[_Round]:
    """Return who meets in each round; those against teams that do not evolve are the last.

    Before there is a past there are no guests of it: then all play together.
    """
    evolving = _evolving(roles)
    teams = {role: roles[role].team for role in evolving}
    by_team = [[role for role in evolving if teams[role] == team] for team in sorted(set(teams.values()))]
    against, hall = evaluation.against_rounds, evaluation.hall_rounds if generation else 0
    first = _Round([evolving], "drawn")
    if generation and evaluation.grouping == "best":
        first = _Round([[role] for role in evolving], "last")
    return [
        *[first] * (evaluation.rounds - hall - against),
        *[_Round(by_team, "drawn")] * hall,
        *[_Round(by_team, "frozen")] * against,
    ]


def _split(
    members: NDArray[np.int64],
    unit: Sequence[int],
    who: Literal["last", "drawn", "frozen"],
    roles: Sequence[Role],
    generation: int,
    invite: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Return members, guests and for whom it counts, where only the members of ``unit`` play for themselves.

    The guests of a team come from one generation, as ``who`` says: the last, or one that is drawn for each group.
    """
    own, guests = members.copy(), np.full_like(members, -1)
    invited = [role for role in _evolving(roles) if role not in unit]
    own[:, invited] = -1
    for team in sorted({roles[role].team for role in invited}):
        if who == "drawn":
            past = invite.integers(generation, size=len(members))
        else:
            past = np.full(len(members), FROZEN if who == "frozen" else generation - 1)
        for role in invited:
            if roles[role].team == team:
                guests[:, role] = past
    return own, guests, own >= 0


def _starts(evaluation: EvaluationSettings, first: int, begin: int, size: int) -> NDArray[np.int64]:
    """Return (size,) whose seeds the groups use that follow the first of their round after ``begin`` others."""
    own = first + begin + np.arange(size)
    return own if evaluation.starts == "own" else np.full(size, first)


_Part = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]


def _joined(parts: Sequence[_Part], evaluation: EvaluationSettings) -> Groups:
    members, guests, counts, starts = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Groups(members, guests, counts, starts, evaluation.games // evaluation.rounds)
