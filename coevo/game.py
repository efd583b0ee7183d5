"""Games between trees, compiled: world, cameras, memories, trees and skills of a whole set of games in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.compiled import borrowed, entry, inlined, is_compiled
from coevo.config import GameSettings, PlayerSettings, RunSettings
from coevo.errors import InputError
from coevo.skill import SkillBank, check_world, load_skill, make_bank
from coevo.skill.estimate import Memory, discrete_state, forget, make_memory, perturb, remember
from coevo.soccer.camera import FEATURES, ROBOTS, CameraParams, Retina, camera_params, look, make_retina
from coevo.soccer.conditions import AREA, ConditionTable, condition_table
from coevo.soccer.drive import action_set
from coevo.soccer.events import (
    EventParams,
    Events,
    clear_events,
    event_params,
    goal_scored,
    make_events,
    record_contacts,
)
from coevo.soccer.physics import Handles, PhysicsParams, advance, physics_params, reset
from coevo.soccer.placement import place, regions
from coevo.soccer.rng import normal
from coevo.soccer.world import World
from coevo.tree import Program

__all__ = ["Arena", "Outcome", "StartsDoNotFitError", "Trace", "load_bank", "warm_up"]


class StartsDoNotFitError(InputError):
    """The bodies do not fit into the regions where they start."""


class _Rules(NamedTuple):
    """What else the kernel needs to know of the games."""

    time_limit: int
    conditions: ConditionTable
    teams: NDArray[np.int64]
    evolves: NDArray[np.bool_]
    codes: NDArray[np.float64]
    commands: NDArray[np.float64]


class _Programs(NamedTuple):
    """The programs of all robots, one after the other."""

    codes: NDArray[np.int16]
    second: NDArray[np.int32]
    start: NDArray[np.int64]


class _Desk(NamedTuple):
    """Room for what a game is doing: state of the world, commands, smallest gaps, and what each robot is at.

    skill, action: (robots,) -1 before the first. held: steps that the action has lasted. at_start: state in which it
    was chosen.
    """

    state: NDArray[np.float64]
    commands: NDArray[np.float64]
    ball_gap: NDArray[np.float64]
    robot_gap: NDArray[np.float64]
    skill: NDArray[np.int64]
    action: NDArray[np.int64]
    held: NDArray[np.int64]
    at_start: NDArray[np.int64]
    rng: NDArray[np.uint64]
    standing: NDArray[np.float64]


def _make_desk(robots: int) -> _Desk:
    return _Desk(
        state=np.zeros((robots + 1, 6)),
        commands=np.zeros((robots, 2)),
        ball_gap=np.zeros(robots),
        robot_gap=np.zeros((robots, robots)),
        skill=np.zeros(robots, np.int64),
        action=np.zeros(robots, np.int64),
        held=np.zeros(robots, np.int64),
        at_start=np.zeros(robots, np.int64),
        rng=np.zeros(1, np.uint64),
        standing=np.zeros(2),
    )


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


@dataclass(frozen=True)
class Trace:
    """Every step of one game.

    states: (steps + 1, bodies, 6), from the start on; robots, then the ball.
    skills: (steps, robots) int8, chosen in each step, -1 for a robot without a tree.
    actions: (steps, robots) int8, action of the drive in each step, -1 likewise.
    """

    states: NDArray[np.float64]
    skills: NDArray[np.int8]
    actions: NDArray[np.int8]


@inlined
def _holds(
    table: ConditionTable, robot: int, function: int, features: NDArray[np.float64], areas: NDArray[np.float64]
) -> bool:
    """Tell whether a condition holds for what a robot sees: (objects, 11) features and (objects,) areas."""
    thing = table.thing[robot, function]
    if areas[thing] <= 0.0:
        return bool(table.wants[robot, function] == 0)
    if table.wants[robot, function] == 0:
        return False
    first = table.first[robot, function]
    for k in range(first, first + table.terms[robot, function]):
        feature = table.feature[k]
        if feature == AREA:
            value = areas[thing]
        elif feature >= 0:
            value = features[thing, feature]
        else:
            value = 0.0
            for j in range(FEATURES):
                value += table.weights[k, j] * features[thing, j]
        if not table.low[k] <= value < table.high[k]:
            return False
    return True


@entry
def _play(
    handles: Handles,
    physics: PhysicsParams,
    camera: CameraParams,
    rules: _Rules,
    event_rules: EventParams,
    start_regions: NDArray[np.float64],
    bank: SkillBank,
    memory: Memory,
    retina: Retina,
    events: Events,
    desk: _Desk,
    programs: _Programs,
    seeds: NDArray[np.uint64],
    steps: NDArray[np.int64],
    scorer: NDArray[np.int64],
    kicks: NDArray[np.int64],
    collisions: NDArray[np.int64],
    passes: NDArray[np.int64],
    own_goals: NDArray[np.int64],
    skill_steps: NDArray[np.int64],
    leaf_steps: NDArray[np.int64],
    trace_states: NDArray[np.float64],
    trace_skills: NDArray[np.int8],
    trace_actions: NDArray[np.int8],
) -> bool:
    """Play one game a seed; return False if the bodies do not fit into their start regions.

    ``trace_states`` (time limit + 1, bodies, 6), ``trace_skills`` and ``trace_actions`` (time limit, robots) are
    filled when they are not empty.
    """
    handles, rules, start_regions, bank = borrowed(handles), borrowed(rules), borrowed(start_regions), borrowed(bank)
    memory, retina, events, programs = borrowed(memory), borrowed(retina), borrowed(events), borrowed(programs)
    skill_steps, leaf_steps, desk = borrowed(skill_steps), borrowed(leaf_steps), borrowed(desk)
    robots = rules.teams.shape[0]
    objects = ROBOTS + robots - 1
    state, commands, ball_gap, robot_gap = desk.state, desk.commands, desk.ball_gap, desk.robot_gap
    skill, action, held, at_start = desk.skill, desk.action, desk.held, desk.at_start
    rng, standing = desk.rng, desk.standing
    middle = 0.5 * camera.columns
    tracing = trace_states.shape[0] > 0
    for game in range(seeds.shape[0]):
        rng[0] = seeds[game]
        if not place(physics, start_regions, rules.teams, state, rng):
            return False
        reset(handles, state)
        forget(memory)
        clear_events(events)
        commands[:] = 0.0
        skill[:], action[:], held[:] = -1, -1, 0
        winner = -1
        t = 0
        if tracing:
            trace_states[0] = state
        while t < rules.time_limit:
            for r in range(robots):
                if not rules.evolves[r]:
                    if tracing:
                        trace_skills[t, r], trace_actions[t, r] = -1, -1
                    continue
                features, areas = memory.features[r], memory.areas[r]
                look(camera, state, r, rules.teams[r], retina, features, areas)
                if camera.noise > 0.0:
                    perturb(camera, objects, features, areas, rng)
                remember(memory, bank, r, t, standing if action[r] < 0 else rules.codes[action[r]], middle)
                node = programs.start[r]
                code = programs.codes[node]
                while code >= 0:
                    if _holds(rules.conditions, r, code, features, areas):
                        node += 1
                    else:
                        node = programs.start[r] + programs.second[node]
                    code = programs.codes[node]
                leaf_steps[node] += 1
                chosen = -1 - code
                skill_steps[r, chosen] += 1
                fresh = chosen != skill[r] or held[r] >= bank.max_steps[chosen]
                if fresh or held[r] >= bank.min_steps[chosen]:
                    now = discrete_state(memory, bank, chosen, r, t)
                    if fresh or now != at_start[r]:
                        skill[r], at_start[r], held[r] = chosen, now, 0
                        action[r] = bank.policy[bank.first[chosen] + now]
                held[r] += 1
                commands[r, 0], commands[r, 1] = rules.commands[action[r], 0], rules.commands[action[r], 1]
                if physics.actuator_noise > 0.0:
                    commands[r, 0] *= 1.0 + physics.actuator_noise * normal(rng)
                    commands[r, 1] *= 1.0 + physics.actuator_noise * normal(rng)
                if tracing:
                    trace_skills[t, r], trace_actions[t, r] = chosen, action[r]
            advance(handles, physics, state, commands, ball_gap, robot_gap)
            record_contacts(event_rules, rules.teams, t, ball_gap, robot_gap, events)
            t += 1
            if tracing:
                trace_states[t] = state
            winner = goal_scored(physics, state)
            if winner >= 0:
                break
        steps[game], scorer[game] = t, winner
        last = events.last_touch[0]
        if winner >= 0 and last >= 0 and rules.teams[last] != winner:
            own_goals[game, last] = 1
        for r in range(robots):
            kicks[game, r], collisions[game, r], passes[game, r] = (
                events.kicks[r],
                events.collisions[r],
                events.passes[r],
            )
    return True


class Arena:
    """A world with everything that games of one setting need; keep one for each thread.

    Args:
        settings: the experiment.
    """

    def __init__(self, settings: RunSettings) -> None:
        self.settings = settings
        world, players = settings.world, settings.players
        robots = len(players)
        actions = action_set(world.robot)
        self.bank = load_bank(settings)
        self.world = World(world, robots)
        self._physics = physics_params(world)
        self._camera = camera_params(world)
        conditions = condition_table(robots, settings.categories, settings.conditions)
        self._rules = _make_rules(settings.game, conditions, players, actions.codes, actions.commands)
        self._event_rules = event_params(world)
        self._regions = regions([player.start for player in players], settings.game.ball_start)
        self._memory = make_memory(self.bank, _mates(players))
        self._retina = make_retina(world)
        self._events = make_events(robots)
        self._desk = _make_desk(robots)

    def play(self, programs: Sequence[Program | None], seeds: NDArray[np.uint64]) -> Outcome:
        """Play one game a seed.

        Args:
            programs: a flat program for each robot that evolves, None for one that stands.
            seeds: (games,) uint64; the same seed is the same game, whatever was played before.

        Raises:
            StartsDoNotFitError: the bodies do not fit into the regions where they start.
        """
        nothing = np.zeros((0, 0), np.int8)
        return self._run(programs, seeds, np.zeros((0, 0, 0)), nothing, nothing)

    def trace(self, programs: Sequence[Program | None], seed: np.uint64) -> tuple[Outcome, Trace]:
        """Play one game and keep every step of it."""
        robots, limit = len(self.settings.players), self.settings.game.time_limit_steps
        states = np.zeros((limit + 1, robots + 1, 6))
        skills, actions = np.zeros((limit, robots), np.int8), np.zeros((limit, robots), np.int8)
        outcome = self._run(programs, np.array([seed], np.uint64), states, skills, actions)
        steps = int(outcome.steps[0])
        return outcome, Trace(states[: steps + 1], skills[:steps], actions[:steps])

    def _run(
        self,
        programs: Sequence[Program | None],
        seeds: NDArray[np.uint64],
        trace_states: NDArray[np.float64],
        trace_skills: NDArray[np.int8],
        trace_actions: NDArray[np.int8],
    ) -> Outcome:
        robots, games = len(self.settings.players), len(seeds)
        empty = Program(np.zeros(0, np.int16), np.zeros(0, np.int32))
        chosen = [program or empty for program in programs]
        start = np.cumsum([0, *(len(program.codes) for program in chosen)])
        joined = _Programs(
            np.concatenate([program.codes for program in chosen]),
            np.concatenate([program.second for program in chosen]),
            start.astype(np.int64),
        )
        outcome = Outcome(
            steps=np.zeros(games, np.int64),
            scorer=np.zeros(games, np.int64),
            kicks=np.zeros((games, robots), np.int64),
            collisions=np.zeros((games, robots), np.int64),
            passes=np.zeros((games, robots), np.int64),
            own_goals=np.zeros((games, robots), np.int64),
            skill_steps=np.zeros((robots, len(self.settings.terminals)), np.int64),
            leaf_steps=(),
        )
        leaf_steps = np.zeros(len(joined.codes), np.int64)
        fits = _play(
            self.world.handles,
            self._physics,
            self._camera,
            self._rules,
            self._event_rules,
            self._regions,
            self.bank,
            self._memory,
            self._retina,
            self._events,
            self._desk,
            joined,
            seeds,
            outcome.steps,
            outcome.scorer,
            outcome.kicks,
            outcome.collisions,
            outcome.passes,
            outcome.own_goals,
            outcome.skill_steps,
            leaf_steps,
            trace_states,
            trace_skills,
            trace_actions,
        )
        if not fits:
            raise StartsDoNotFitError(
                "the robots and the ball do not fit into their start regions without touching;"
                " widen game.ball_start or players.*.start"
            )
        leaves = tuple(leaf_steps[start[i] : start[i + 1]] for i in range(robots))
        return Outcome(**{**outcome.__dict__, "leaf_steps": leaves})


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
    if not is_compiled(_play):
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


def _make_rules(
    game: GameSettings,
    conditions: ConditionTable,
    players: Sequence[PlayerSettings],
    codes: NDArray[np.float64],
    commands: NDArray[np.float64],
) -> _Rules:
    return _Rules(
        time_limit=game.time_limit_steps,
        conditions=conditions,
        teams=np.array([player.team for player in players], np.int64),
        evolves=np.array([player.control == "evolve" for player in players]),
        codes=codes,
        commands=commands,
    )
