"""How fast learning is on this machine, beside the pure physics of as many steps.

A trial of learning is physics, camera, state estimate, table and update. The ratio to physics holds on any machine; the
times are this one's.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import click
import numpy as np

from behaviors.experience import make_models
from behaviors.recipe import installed_recipes, read_recipe
from behaviors.schedule.course import Course
from behaviors.schedule.recipe import read_schedule
from behaviors.schedule.scene import first_table, pair_scene
from behaviors.tabular.decisions import most_decisions
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials.scene import Scene
from behaviors.trials.solo import blank_skill, solo_scene
from coevo.compiled import start_costs
from coevo.config import WorldSettings
from coevo.console import note, output_options, show, table
from coevo.seeds import SetStream, SkillStream, game_seeds
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params, replay
from coevo.soccer.world import World
from coevo.stage import LEARNER, STANDING

__all__ = ["physics_seconds", "speed"]

_SCHEDULE = "chapter3/schedule"
_HELD = 10  # steps a random primitive is held while pure physics is timed
_AT_ONCE = 900
_START = "from behaviors.studies.speed import _alone; _alone('search', 1)"


def physics_seconds(world: WorldSettings, robots: int, steps: int) -> float:
    """Return how long the physics of so many steps takes: nothing but robots that act at random."""
    rng = np.random.default_rng(0)
    commands = action_set(world.robot).commands
    start = np.zeros((robots + 1, 6))
    start[:, 0] = np.linspace(0.3, 0.6, robots + 1) * world.field.length_m
    start[:, 1] = 0.5 * world.field.width_m
    room, handles = World(world, robots), physics_params(world)
    states, seconds = np.empty((_AT_ONCE, robots + 1, 6)), 0.0
    for _ in range(0, steps, _AT_ONCE):
        chosen = rng.integers(len(commands), size=(_AT_ONCE // _HELD, robots)).repeat(_HELD, axis=0)
        began = time.perf_counter()
        replay(room.handles, handles, start, commands[chosen], states)
        seconds += time.perf_counter() - began
    return seconds * steps / (-(-steps // _AT_ONCE) * _AT_ONCE)


def _timed(scene: Scene, stream: tuple[int, ...], trials: int) -> tuple[float, int]:
    """Return the seconds of so many trials, and their steps."""
    seeds = game_seeds(*stream, count=trials)
    began = time.perf_counter()
    found = scene.run(seeds, total=trials)
    seconds = time.perf_counter() - began
    assert found is not None
    return seconds, int(found.steps.sum())


def _alone(name: str, trials: int) -> tuple[WorldSettings, int, float, int]:
    """Return the world of a skill, its robots, the seconds of learning in so many trials, and their steps."""
    recipe = read_recipe(name)
    skill = blank_skill(recipe, make_models(recipe, recipe.seed)[0])
    table, learner = make_table(*skill.values.shape), make_learner(recipe.learning)
    scene = solo_scene(recipe, skill, LEARNER, learner=learner, table=table)
    stream = recipe.seed, SkillStream.LEARNING
    _timed(scene, stream, 1)  # compiles what is not compiled yet
    return recipe.world, len(scene.minds), *_timed(scene, stream, trials)


def _pair(roles: tuple[int, int], trials: int) -> tuple[WorldSettings, int, float, int]:
    """Return the same of the two robots of chapter 3 in these roles."""
    changes = ["store.report_orders=false", "trials=1", "transfer.trials_e=0", "transfer.trials_f=0", "games=10"]
    schedule = read_schedule(_SCHEDULE, changes)
    course = Course(schedule, schedule.seed)
    while not course.is_finished:  # so that both have models
        course.advance()
    for agent in course.agents:
        agent.values, agent.old = None, None
    tables = [first_table(agent, schedule) for agent in course.agents]
    scene = pair_scene(schedule, schedule.world, course.agents, roles, tables=tables)
    for robot, agent in enumerate(course.agents):
        scene.grow(robot, trials * most_decisions(schedule.time_limit_steps, agent.settings.action.min_steps))
    return schedule.world, 2, *_timed(scene, (schedule.seed, SetStream.TIMING), trials)


@click.command()
@click.option(
    "--trials",
    type=click.IntRange(min=1),
    default=5000,
    show_default=True,
    help="Of each learning; exploration falls within them.",
)
@output_options
def speed(*, trials: int, as_json: bool, quiet: bool) -> None:
    """Time trials of learning, the physics of as many steps alone, and compiling.

    \b
    Example: coevo reproduce speed --trials 25000
    """
    note("Compiling what is not compiled yet for this machine ...", quiet=quiet)
    physics_seconds(WorldSettings(), 1, 1)
    runs: list[tuple[str, Callable[[], tuple[WorldSettings, int, float, int]]]] = [
        *((name, partial(_alone, name, trials)) for name in installed_recipes()),
        ("chapter 3, period A", partial(_pair, (LEARNER, STANDING), trials)),
        ("chapter 3, both learn", partial(_pair, (LEARNER, LEARNER), trials)),
    ]
    rows, data = [], []
    for label, run in runs:
        world, robots, seconds, steps = run()
        physics = physics_seconds(world, robots, steps)
        rate, micro = trials / seconds, 1e6 / steps
        cells = f"{rate:.0f}", f"{25_000 / rate:.0f}", f"{steps / trials:.0f}", f"{seconds * micro:.2f}"
        rows.append([label, *cells, f"{physics * micro:.2f}", f"{seconds / physics:.2f}"])
        data.append(
            {
                "learning": label,
                "trials_per_second": rate,
                "steps_per_trial": steps / trials,
                "microseconds_per_step": seconds * micro,
                "pure_physics_microseconds_per_step": physics * micro,
                "ratio_to_pure_physics": seconds / physics,
            }
        )
        note(f"{label} timed", quiet=quiet)
    compiling, _ = start_costs(_START)
    header = ["learning", "trials/s", "25,000 trials [s]", "steps a trial", "us a step", "physics alone", "ratio"]
    text = f"{table(header, rows)}\nCompiling all of it anew: {compiling:.1f} CPU seconds"
    show({"learning": data, "compiling_cpu_seconds": compiling}, text, as_json=as_json)
