"""What is shown: who takes part, what they can do, and every step of games or trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from coevo.config import RunSettings, WorldSettings
from coevo.skill import ObjectModel, load_skill
from coevo.stage import Trace
from coevo.tree import Tree

__all__ = ["TEAMS", "Actor", "Recording", "Take", "game_recording"]

# A team is named after the goal it defends: team 0 the blue one at x = 0, team 1 the yellow one.
TEAMS = ("blue", "yellow")


@dataclass(frozen=True)
class Actor:
    """A robot that is shown.

    Attributes:
        name: as people know it.
        team: 0 attacks the goal at x = length, 1 the one at x = 0.
        sees: whether it looks through its camera.
        tree: that it chooses by, if it is known.
    """

    name: str
    team: int = 0
    sees: bool = True
    tree: Tree | None = None


@dataclass(frozen=True)
class Take:
    """One game or trial.

    Attributes:
        trace: every step of it.
        title: such as ``game 2 of 20``.
        ending: how it ended, in words.
        point: 0 or 1, which of the two things that a recording counts it adds to; -1 for neither.
        idle: for each robot, what it does while it chooses nothing.
    """

    trace: Trace
    title: str
    ending: str
    point: int
    idle: tuple[str, ...]


@dataclass(frozen=True)
class Recording:
    """Games or trials of the same robots in the same world, for tables, pictures, videos and pages.

    Attributes:
        name: of the whole.
        world: its settings.
        actors: the robots, in the order of the states.
        skills: by name what each looks at, in the order of the numbers in the traces; nothing, if that is not known.
        takes: the games or trials.
        kind: what each take is called.
        shows: what robots are labelled with: the skill that they choose, or the action of the drive.
        sides: names of the two things that are counted over the takes.
    """

    name: str
    world: WorldSettings
    actors: tuple[Actor, ...]
    skills: Mapping[str, tuple[ObjectModel, ...]]
    takes: tuple[Take, ...]
    kind: Literal["game", "trial"] = "game"
    shows: Literal["skills", "actions"] = "skills"
    sides: tuple[str, str] = TEAMS

    @property
    def traces(self) -> list[Trace]:
        """Every step of each take."""
        return [take.trace for take in self.takes]

    def chosen(self, trace: Trace) -> NDArray[np.int8]:
        """Return (steps, robots) the numbers of what robots are labelled with, -1 for nothing."""
        return trace.skills if self.shows == "skills" else trace.actions

    def score_before(self) -> list[tuple[int, int]]:
        """Return what was counted before each take, and after the last one."""
        score = [(0, 0)]
        for take in self.takes:
            first, second = score[-1]
            score.append((first + (take.point == 0), second + (take.point == 1)))
        return score


def game_recording(
    settings: RunSettings,
    traces: Sequence[Trace],
    *,
    trees: Sequence[Tree | None] = (),
    name: str | None = None,
    titles: Sequence[str] = (),
) -> Recording:
    """Return games of one experiment as what is shown.

    Args:
        settings: the experiment.
        traces: one for each game.
        trees: that the robots chose by, None for those without one; the page then shows the way through them.
        name: instead of the experiment's.
        titles: of the games, instead of ``game 1 of 3``.
    """
    players = settings.players
    given = list(trees) or [None] * len(players)
    actors = tuple(
        Actor(f"r{number}", player.team, player.control != "stationary", tree)
        for number, (player, tree) in enumerate(zip(players, given, strict=True))
    )
    takes = []
    for number, trace in enumerate(traces):
        team = _scorer(settings.world, trace)
        title = titles[number] if titles else f"game {number + 1} of {len(traces)}"
        ending = f"goal for {TEAMS[team]}" if team >= 0 else "time is up"
        takes.append(Take(trace, title, ending, team, ("stands still",) * len(players)))
    skills = {terminal: load_skill(source).objects for terminal, source in settings.terminals.items()}
    return Recording(name or settings.name, settings.world, actors, skills, tuple(takes))


def _scorer(world: WorldSettings, trace: Trace) -> int:
    """Return the team that scored, -1 if time ran out."""
    x = float(trace.states[-1, -1, 0])
    if x > world.field.length_m:
        return 0
    return 1 if x < 0.0 else -1
