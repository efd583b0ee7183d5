"""The same games as a plain Python loop: pymunk's methods, deap.gp.compile, and OpenCV or analytic cameras.

Nothing here is compiled and nothing is clever. It is how the compiled path is checked, game for game (with analytic
cameras both give the same games), and what its speed is measured against (with OpenCV cameras, as one would
write it without compiled code).
"""

from __future__ import annotations

import ast
import math
import operator
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from deap import gp
from numpy.typing import NDArray

from coevo.config import RunSettings
from coevo.game import Outcome, SoccerGame, Trace, given_trees
from coevo.skill import ObjectModel, Skill, load_skill
from coevo.soccer.camera import ROBOTS, camera_params, make_retina, object_count, see
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params
from coevo.soccer.placement import place, regions
from coevo.soccer.world import World
from coevo.tree import Tree

__all__ = ["PlainGame"]

_BALL, _GOALS = 0, (1, 2)
_THINGS = {"ball": 0, "own_goal": 1, "opponent_goal": 2}
_CORNERS = [f"{end}_{side}_{axis}" for end in ("upper", "lower") for side in ("left", "right") for axis in ("x", "y")]
_FEATURES = {
    "ball": ["x", "y", "radius", "area"],
    "goal": ["x", "y", *_CORNERS, "area"],
    "robot": ["x", "y", "width", "height", "area"],
}
_ARITHMETIC: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Lt: operator.lt,
    ast.GtE: operator.ge,
}
_Eye = Callable[[NDArray[np.float64], int], tuple[NDArray[np.float64], NDArray[np.float64]]]


class _Sight:
    """What a robot has seen of one object."""

    def __init__(self, history: int) -> None:
        self.past: deque[NDArray[np.float64]] = deque(maxlen=history)
        self.features: NDArray[np.float64] | None = None
        self.side = 0

    def update(self, features: NDArray[np.float64] | None, middle: float) -> None:
        if features is None:
            self.features = None
            self.past.clear()
            return
        if not self.past:
            self.past.extend([features] * (self.past.maxlen or 1))
        self.past.appendleft(features)
        self.features = features
        self.side = 0 if features[0] < middle else 1


@dataclass
class _Robot:
    number: int
    side: int
    sights: list[_Sight]
    nearest: _Sight
    nearest_is: int
    inputs: deque[tuple[float, float]]
    tree: Tree
    choose: Callable[[], str]
    skill: str = ""
    action: int = -1
    held: int = 0
    at_start: int = -1


class PlainGame:
    """Plays games of one setting, slowly.

    Args:
        settings: the experiment; sensor and actuator noise must be off.
        camera: "analytic" sees exactly what compiled games see; "opencv" renders every image and extracts colours.
    """

    def __init__(self, settings: RunSettings, camera: Literal["analytic", "opencv"] = "analytic") -> None:
        if settings.world.camera.noise_px or settings.world.robot.actuator_noise:
            raise ValueError("the plain loop has no noise; set camera.noise_px and robot.actuator_noise to 0")
        self.settings = settings
        self._skills = {name: load_skill(source) for name, source in settings.terminals.items()}
        self._terminals = list(self._skills)
        self._game, self._given = SoccerGame(settings), given_trees(settings)
        self._policies = {name: skill.policy for name, skill in self._skills.items()}
        self._history = max(model.history_length for skill in self._skills.values() for model in skill.objects)
        self._actions = action_set(settings.world.robot)
        self._eye: _Eye = self._analytic_eye if camera == "analytic" else self._make_opencv_eye()
        self._camera = camera_params(settings.world)
        self._retina = make_retina(settings.world)

    def _analytic_eye(self, state: NDArray[np.float64], robot: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        objects = object_count(len(self.settings.players))
        features, areas = np.zeros((objects, 11)), np.zeros(objects)
        see(self._camera, state, robot, self.settings.players[robot].team, self._retina, features, areas)
        return features, areas

    def _make_opencv_eye(self) -> _Eye:
        from coevo.soccer.vision import extract, render

        world, players = self.settings.world, self.settings.players

        def look(state: NDArray[np.float64], robot: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            image = render(world, state, robot, supersample=1)  # the fastest: one pixel a pixel
            return extract(image, world, len(players), robot, players[robot].team)

        return look

    def play(self, trees: Sequence[Tree | None], seed: np.uint64, *, thoughts: bool = False) -> tuple[Outcome, Trace]:
        """Play one game; the arguments and results are those of ``coevo.game.Arena.trace``.

        Leaves and perceived states, which take time of their own, are -1 without ``thoughts``.
        """
        settings, robots = self.settings, len(self.settings.players)
        teams = np.array([player.team for player in settings.players], np.int64)
        world = World(settings.world, robots)
        state = np.zeros((robots + 1, 6))
        starts = regions([player.start for player in settings.players], settings.game.ball_start)
        rng = np.array([seed], np.uint64)
        if not place(physics_params(settings.world), starts, teams, state, rng):
            raise ValueError("the bodies do not fit into their start regions")
        world.place(state)
        now: dict[int, dict[str, bool]] = {}
        players = [
            None if tree is None else self._robot(number, int(teams[number]), tree, now)
            for number, tree in enumerate(own or given for own, given in zip(trees, self._given, strict=True))
        ]
        referee = _Referee(settings, teams)
        states, skills, actions, leaves, perceived = [world.state], [], [], [], []
        skill_steps = np.zeros((robots, len(self._terminals)), np.int64)
        scorer, time = -1, 0
        while time < settings.game.time_limit_steps and scorer < 0:
            commands = np.zeros((robots, 2))
            for player in players:
                if player is None:
                    continue
                self._act(player, states[-1], now)
                skill_steps[player.number, self._terminals.index(player.skill)] += 1
                strength = settings.players[player.number].strength
                commands[player.number] = self._actions.commands[player.action] * strength
            skills.append([-1 if p is None else self._terminals.index(p.skill) for p in players])
            actions.append([-1 if p is None else p.action for p in players])
            thinking = [player if thoughts else None for player in players]
            leaves.append([-1 if p is None else _leaf(p.tree, now[p.number]) for p in thinking])
            perceived.append([-1 if p is None else self._state(p, self._skills[p.skill]) for p in thinking])
            scorer = referee.step(world, commands, time)
            states.append(world.state)
            time += 1
        outcome = Outcome(
            steps=np.array([time]),
            scorer=np.array([scorer]),
            kicks=referee.kicks[None],
            collisions=referee.collisions[None],
            passes=referee.passes[None],
            own_goals=referee.own_goals[None],
            skill_steps=skill_steps,
            leaf_steps=(),
        )
        return outcome, Trace(
            np.array(states),
            np.array(skills, np.int8),
            np.array(actions, np.int8),
            np.array(leaves, np.int32),
            np.array(perceived, np.int32),
        )

    def _robot(self, number: int, side: int, tree: Tree, now: dict[int, dict[str, bool]]) -> _Robot:
        """Compile a tree the way DEAP's examples do: each IF asks its condition, then runs one branch."""
        functions = self._game.function_set(number)
        primitives = gp.PrimitiveSet(f"r{number}", 0)

        def ask(condition: str, first: Callable[[], str], second: Callable[[], str]) -> str:
            return first() if now[number][condition] else second()

        for name in functions.functions:
            primitives.addPrimitive(partial(lambda c, a, b: partial(ask, c, a, b), name), 2, name=name)
        for name in self._terminals:
            primitives.addTerminal(partial(str, name), name=f"do_{name}")  # "pass" is a word of Python
        mapping = primitives.mapping
        nodes = [mapping.get(name) or mapping[f"do_{name}"] for name in tree.names]
        choose = gp.compile(gp.PrimitiveTree(nodes), primitives)
        objects = object_count(len(self.settings.players))
        sights = [_Sight(self._history) for _ in range(objects)]
        inputs = deque([(0.0, 0.0)] * self._history, maxlen=self._history)
        return _Robot(number, side, sights, _Sight(self._history), -1, inputs, tree, choose)

    def _act(self, player: _Robot, state: NDArray[np.float64], now: dict[int, dict[str, bool]]) -> None:
        features, areas = self._eye(state, player.number)
        self._remember(player, features, areas)
        now[player.number] = self._conditions(player, areas)
        chosen = player.choose()
        skill = self._skills[chosen]
        fresh = chosen != player.skill or player.held >= skill.max_steps
        if fresh or player.held >= skill.min_steps:
            number = self._state(player, skill)
            if fresh or number != player.at_start:
                player.skill, player.at_start, player.held = chosen, number, 0
                player.action = int(self._policies[chosen][number])
        player.held += 1

    def _remember(self, player: _Robot, features: NDArray[np.float64], areas: NDArray[np.float64]) -> None:
        middle = 0.5 * self.settings.world.camera.width_px
        code = self._actions.codes[player.action] if player.action >= 0 else (0.0, 0.0)
        player.inputs.appendleft((float(code[0]), float(code[1])))
        for sight, row, area in zip(player.sights, features, areas, strict=True):
            sight.update(row.copy() if area > 0 else None, middle)
        others = areas[ROBOTS:]
        if len(others) and others.max() > 0:
            largest = ROBOTS + int(np.argmax(others))
            if largest != player.nearest_is:
                player.nearest.update(None, middle)
                player.nearest_is = largest
            player.nearest.update(features[largest].copy(), middle)
        else:
            player.nearest.update(None, middle)

    def _conditions(self, player: _Robot, areas: NDArray[np.float64]) -> dict[str, bool]:
        limits = self.settings.categories
        found: dict[str, bool] = {}
        robots = len(self.settings.players)
        names = [*_THINGS, *(f"r{other}" for other in range(robots) if other != player.number)]
        for thing, (name, sight) in enumerate(zip(names, player.sights, strict=True)):
            true = {"lost"}
            if sight.features is not None:
                kind = "ball" if thing == _BALL else "goal" if thing in _GOALS else "robot"
                small, large = (
                    getattr(limits, f"{kind}_small_below_px"),
                    getattr(limits, f"{kind}_large_from_px"),
                )
                x, area = sight.features[0], areas[thing]
                true = {
                    "left" if x < limits.left_below_px else "right" if x >= limits.right_from_px else "middle",
                    "small" if area < small else "large" if area >= large else "medium",
                }
            for category in ("left", "middle", "right", "small", "medium", "large", "lost"):
                found[f"IF_{name}_is_{category}"] = category in true
            for category, condition in self.settings.conditions.items():
                if (name if name in _THINGS else "robot") in condition.objects:
                    found[f"IF_{name}_is_{category}"] = _holds(condition.expression, name, sight.features)
        return found

    def _state(self, player: _Robot, skill: Skill) -> int:
        """Return the discrete state: mixed radix over the objects of the skill."""
        number = 0
        for model in skill.objects:
            number = number * model.states + self._object_state(player, model)
        return number

    def _object_state(self, player: _Robot, model: ObjectModel) -> int:
        sight = self._sight_of(player, model.kind)
        if sight is None or sight.features is None:
            side = sight.side if sight is not None and model.lost_states > 1 else 0
            return model.states - model.lost_states + side
        length, width = model.history_length, model.past_mean.size // model.history_length - 2
        inputs = [value for pair in list(player.inputs)[:length] for value in pair]
        outputs = [value for row in list(sight.past)[:length] for value in row[:width]]
        x = model.memory_matrix @ (np.array(inputs + outputs) - model.past_mean)
        digits = (x >= -model.cell).astype(int) + (x >= model.cell).astype(int)
        return int(sum(int(digit) * 3**j for j, digit in enumerate(digits)))

    def _sight_of(self, player: _Robot, kind: str) -> _Sight | None:
        if kind in _THINGS:
            return player.sights[_THINGS[kind]]
        if kind == "robot":
            return player.nearest
        team = self.settings.players[player.number].team
        for other, settings in enumerate(self.settings.players):
            if other != player.number and settings.team == team:
                return player.sights[ROBOTS + other - (1 if other > player.number else 0)]
        return None


def _leaf(tree: Tree, true: dict[str, bool]) -> int:
    """Return the node where a tree ends, by what is true."""
    node = 0
    while tree.names[node] in true:
        skipped = 0 if true[tree.names[node]] else 1
        node += 1
        while skipped:  # one branch: a function begins two more and ends none
            skipped += 1 if tree.names[node] in true else -1
            node += 1
    return node


def _holds(expression: str, name: str, features: NDArray[np.float64] | None) -> bool:
    """Tell whether an added condition holds, by working its expression out as it stands."""
    if expression.strip() == "lost" or features is None:
        return expression.strip() == "lost" and features is None
    names = _FEATURES["ball" if name == "ball" else "goal" if name in _THINGS else "robot"]
    known = {"visible": True, **dict(zip(names, features.tolist(), strict=False))}
    return bool(_work_out(ast.parse(expression.strip(), mode="eval").body, known))


def _work_out(node: ast.expr, known: dict[str, Any]) -> Any:
    match node:
        case ast.Name(id=name):
            return known[name]
        case ast.Constant(value=value):
            return value
        case ast.UnaryOp(op=op, operand=operand):
            return -_work_out(operand, known) if isinstance(op, ast.USub) else _work_out(operand, known)
        case ast.BinOp(left=left, op=op, right=right):
            return _ARITHMETIC[type(op)](_work_out(left, known), _work_out(right, known))
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _ARITHMETIC[type(op)](_work_out(left, known), _work_out(right, known))
        case ast.BoolOp(values=values):
            return all(_work_out(value, known) for value in values)
    raise ValueError(f"cannot work out {ast.unparse(node)}")


class _Referee:
    """Counts what happens in each substep, from positions alone."""

    def __init__(self, settings: RunSettings, teams: NDArray[np.int64]) -> None:
        self._settings, self._teams = settings, teams
        robots = len(teams)
        self.kicks, self.collisions, self.passes, self.own_goals = (np.zeros(robots, np.int64) for _ in range(4))
        self._touching: set[tuple[int, int]] = set()
        self._had_ball: set[int] = set()
        self._last, self._at = -1, 0
        self._spot, self._spot_at = (math.inf, math.inf), 0

    def step(self, world: World, commands: Any, time: int) -> int:
        """Move the world on, count, and return the team that scored, or -1."""
        settings = self._settings
        gaps: list[dict[tuple[int, int], float]] = []
        world.step(commands, after_substep=lambda: gaps.append(self._gaps(world)))
        gap = {pair: min(step[pair] for step in gaps) for pair in gaps[0]}
        robots = len(self._teams)
        contact = settings.world.physics.contact_gap_m
        window = round(settings.world.rules.pass_window_s / settings.world.physics.step_s)
        at_ball = {robot for robot in range(robots) if gap[robot, robots] <= contact}
        for robot in sorted(at_ball):
            self.kicks[robot] += 1
            last = self._last
            mate = last >= 0 and last != robot and self._teams[last] == self._teams[robot]
            comes = robot not in self._had_ball and last not in at_ball
            if mate and comes and time - self._at <= window:
                self.passes[last] += 1
            self._last, self._at = robot, time
        self._had_ball = at_ball
        for one, two in ((i, j) for i in range(robots) for j in range(i)):
            if gap[two, one] <= contact:
                if (one, two) not in self._touching:
                    self._touching.add((one, two))
                    self.collisions[[one, two]] += 1
            elif gap[two, one] > settings.world.rules.collision_release_m:
                self._touching.discard((one, two))
        x = world.ball.position.x
        scorer = 0 if x > settings.world.field.length_m else 1 if x < 0.0 else -1
        if self._last >= 0 and self._teams[self._last] == 1 - scorer:
            self.own_goals[self._last] += 1
        if settings.world.rules.stuck_after_s > 0.0 and scorer < 0:
            self._drop_if_stuck(world, time)
        return scorer

    def _drop_if_stuck(self, world: World, time: int) -> None:
        """Put a ball that does not move on at mid-width, clear of the robots."""
        rules, physics = self._settings.world.rules, self._settings.world.physics
        field, position = self._settings.world.field, world.ball.position
        if math.dist(position, self._spot) > rules.stuck_within_m:
            self._spot, self._spot_at = (position.x, position.y), time
        elif (time - self._spot_at) * physics.step_s >= rules.stuck_after_s - 1e-9:
            off = min(rules.stuck_off_goals_m, 0.5 * field.length_m)
            x, middle = min(max(position.x, off), field.length_m - off), 0.5 * field.width_m
            apart = self._settings.world.robot.radius_m + self._settings.world.ball.radius_m + 0.05
            aside = range(1, int((middle - self._settings.world.ball.radius_m) / 0.1) + 1)
            places = [middle, *(middle + side * 0.1 * k for k in aside for side in (1, -1))]
            free = (y for y in places if all(math.dist(body.position, (x, y)) >= apart for body in world.robots))
            self._spot, self._spot_at = (x, next(free, middle)), time
            world.ball.position, world.ball.angle = self._spot, 0.0
            world.ball.velocity, world.ball.angular_velocity = (0.0, 0.0), 0.0
            self._last, self._had_ball = -1, set()

    def _gaps(self, world: World) -> dict[tuple[int, int], float]:
        bodies = [(body.position, self._settings.world.robot.radius_m) for body in world.robots]
        bodies.append((world.ball.position, self._settings.world.ball.radius_m))
        return {
            (i, j): math.hypot(p.x - q.x, p.y - q.y) - a - b
            for j, (q, b) in enumerate(bodies)
            for i, (p, a) in enumerate(bodies[:j])
        }
