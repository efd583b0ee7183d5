"""Soccer between trees: settings in, what happened out; the games themselves are compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import is_compiled
from coevo.config import PlayerSettings, RunSettings
from coevo.errors import InputError
from coevo.game.functions import given_programs
from coevo.game.kernels import Match, Programs, Score, play
from coevo.skill import SkillBank, check_world, load_skill, make_bank
from coevo.soccer.conditions import condition_table
from coevo.soccer.drive import action_set
from coevo.soccer.events import event_params
from coevo.soccer.placement import regions
from coevo.stage import STANDING, TREE, Trace, make_venue
from coevo.stage.tape import Tape, blank_tape, no_tape, trace_of
from coevo.tree import Program

__all__ = ["Arena", "Outcome", "StartsDoNotFitError", "Trace", "load_bank", "warm_up"]


class StartsDoNotFitError(InputError):
    """The bodies do not fit into the regions where they start."""


@dataclass(frozen=True)
class Outcome:
    """What happened in a set of games.

    steps: (games,) int64, length of each game.
    scorer: (games,) int64, the team that scored, -1 if time ran out.
    kicks: (games, robots) int64, steps in which the robot touched the ball.
    collisions: (games, robots) int64, times it ran into another robot or was run into.
    passes: (games, robots) int64, times a team mate touched the ball soon after it.
    own_goals: (games, robots) int64, goals against its own team of which it was the last to touch the ball.
    skill_steps: (robots, skills) int64, steps in which each skill was chosen, in the order of the terminals.
    leaf_steps: per robot (nodes,) int64, steps that ended at each leaf of its tree.
    """

    steps: NDArray[np.int64]
    scorer: NDArray[np.int64]
    kicks: NDArray[np.int64]
    collisions: NDArray[np.int64]
    passes: NDArray[np.int64]
    own_goals: NDArray[np.int64]
    skill_steps: NDArray[np.int64]
    leaf_steps: tuple[NDArray[np.int64], ...]

    def goals_of(self, team: int) -> int:
        """Number of games that ``team`` won."""
        return int((self.scorer == team).sum())


class Arena:
    """A world with everything that games of one setting need; keep one for each thread.

    Args:
        settings: the experiment.
    """

    def __init__(self, settings: RunSettings) -> None:
        self.settings = settings
        players = settings.players
        self.bank = load_bank(settings)
        acts = [player.control != "stationary" for player in players]
        self._venue = make_venue(
            settings.world,
            self.bank,
            event_params(settings.world),
            roles=[TREE if one else STANDING for one in acts],
            teams=[player.team for player in players],
            mates=_mates(players),
        )
        self._venue.stage.roles.sees[:] = acts
        self._venue.stage.roles.share[:] = [player.strength for player in players]
        self._regions = regions([player.start for player in players], settings.game.ball_start)
        self._conditions = condition_table(len(players), settings.categories, settings.conditions)
        self._given = given_programs(settings)

    def play(self, programs: Sequence[Program | None], seeds: NDArray[np.uint64]) -> Outcome:
        """Play one game a seed.

        Args:
            programs: a flat program for each robot that evolves, None for one that stands or has a given tree.
            seeds: (games,) uint64; the same seed is the same game, whatever was played before.

        Raises:
            ValueError: a robot that evolves has no program, or another has one.
            StartsDoNotFitError: the bodies do not fit into the regions where they start.
        """
        return self._run(programs, seeds, no_tape())

    def trace(self, programs: Sequence[Program | None], seed: np.uint64) -> tuple[Outcome, Trace]:
        """Play one game and keep every step of it."""
        tape = blank_tape(len(self.settings.players), self.settings.game.time_limit_steps)
        outcome = self._run(programs, np.array([seed], np.uint64), tape)
        return outcome, trace_of(tape, int(outcome.steps[0]))

    def _run(self, programs: Sequence[Program | None], seeds: NDArray[np.uint64], tape: Tape) -> Outcome:
        robots, games = len(self.settings.players), len(seeds)
        for robot, (player, program) in enumerate(zip(self.settings.players, programs, strict=True)):
            if (player.control == "evolve") != (program is not None):
                why = "stands" if player.control == "stationary" else "has a given tree"
                needs = "a program" if program is None else f"none, as it {why}"
                raise ValueError(f"the robot r{robot} needs {needs}")
        joined = _joined([own or given for own, given in zip(programs, self._given, strict=True)])
        counts = [np.zeros((games, robots), np.int64) for _ in range(4)]
        score = Score(np.zeros(games, np.int64), np.zeros(games, np.int64), *counts)
        match = Match(self._venue.stage, self._conditions, joined, tape, np.full(1, -1))
        if not play(match, self.settings.game.time_limit_steps, self._regions, seeds, score):
            raise StartsDoNotFitError(
                "the robots and the ball do not fit into their start regions without touching;"
                " widen game.ball_start or players.*.start"
            )
        parts = [slice(a, b) for a, b in zip(joined.start[:-1], joined.start[1:], strict=True)]
        skill_steps = np.zeros((robots, len(self.settings.terminals)), np.int64)
        for robot, part in enumerate(parts):
            leaves = joined.codes[part] < 0
            np.add.at(skill_steps[robot], -1 - joined.codes[part][leaves], joined.steps[part][leaves])
        return Outcome(
            steps=score.steps,
            scorer=score.winner,
            kicks=score.kicks,
            collisions=score.collisions,
            passes=score.passes,
            own_goals=score.own_goals,
            skill_steps=skill_steps,
            leaf_steps=tuple(joined.steps[part] for part in parts),
        )


def _joined(programs: Sequence[Program | None]) -> Programs:
    """Put programs one after the other."""
    empty = Program(np.zeros(0, np.int16), np.zeros(0, np.int32))
    chosen = [program or empty for program in programs]
    start = np.cumsum([0, *(len(program.codes) for program in chosen)]).astype(np.int64)
    codes = np.concatenate([program.codes for program in chosen])
    return Programs(
        codes,
        np.concatenate([program.second for program in chosen]),
        start,
        np.zeros(len(codes), np.int64),
    )


def load_bank(settings: RunSettings) -> SkillBank:
    """Return the skills of the settings, side by side in the order of the terminals.

    Raises:
        InputError: a skill is missing, damaged, or learned for another drive or another world.
    """
    robot = settings.world.robot
    loaded = [load_skill(source) for source in settings.terminals.values()]
    bank = make_bank(loaded, drive=robot.drive, actions=len(action_set(robot).codes))
    if settings.skills_elsewhere == "refuse":
        for name, skill in zip(settings.terminals, loaded, strict=True):
            check_world(skill, settings.world, name)
    return bank


def warm_up(settings: RunSettings, tell: Callable[[str], None]) -> None:
    """Load the machine code of games, or compile it, before workers need it.

    Args:
        settings: any experiment.
        tell: receives a line if it has to be compiled, which takes a while and happens once.
    """
    if not is_compiled(play):
        tell("Compiling the games for this machine, once: about 15 s ...")
    arena = Arena(settings)
    stand = [
        None if p.control != "evolve" else Program(np.array([-1], np.int16), np.zeros(1, np.int32))
        for p in settings.players
    ]
    arena.play(stand, np.zeros(0, np.uint64))


def _mates(players: Sequence[PlayerSettings]) -> list[int]:
    """Return the number of each robot's first team mate, -1 where it has none."""
    return [
        next((j for j, other in enumerate(players) if j != i and other.team == player.team), -1)
        for i, player in enumerate(players)
    ]
