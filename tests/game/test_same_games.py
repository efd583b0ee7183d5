"""Whole games: compiled against the plain loop, with noise too, and independent of what else is played."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from coevo.errors import InputError
from coevo.game import Arena, SoccerGame, check_playable
from coevo.plain import PlainGame
from coevo.skill import ObjectModel, Skill, load_skill
from coevo.skill.model import OBJECT_KINDS
from coevo.tree import parse
from coevo.vocabulary import SKILLS

PRESETS = ("two-learners", "stationary-opponent", "three-learners", "smoke")
HAND_TYPED = "IF_ball_is_lost(search, shoot)"


def random_skill(path, name, kinds, rng, drive):
    """Write a skill of random numbers, which drives wildly but sees all it asks for."""
    models = []
    for kind in kinds:
        length, order = int(rng.integers(1, 5)), int(rng.integers(1, 4))
        past = length * (2 + OBJECT_KINDS[kind])
        matrix = rng.normal(0.0, 0.03, (order, past))
        models.append(ObjectModel(kind, length, matrix, rng.uniform(10.0, 40.0, past), rng.uniform(0.3, 1.0)))
    states = int(np.prod([model.states for model in models]))
    values = rng.normal(size=(states, 9 if drive == "pws" else 7)).astype(np.float32)
    values[:, -3:] += 0.7  # forwards more often than not
    shortest = int(rng.integers(1, 6))
    Skill(name, drive, tuple(models), values, shortest, shortest + int(rng.integers(0, 25))).save(path)
    return f"skills.{name}='{path}'"


@pytest.fixture(scope="module")
def wild(tmp_path_factory, settings_of):
    """Return the settings of crowded games of three against one with random skills, for each drive."""
    folder, found = tmp_path_factory.mktemp("skills"), {}
    looks = {
        "shoot": ("ball", "opponent_goal"),
        "pass": ("mate", "ball", "own_goal"),
        "avoid": ("robot",),
        "search": ("own_goal", "robot"),
    }
    for drive in ("pws", "4ws"):
        rng = np.random.default_rng(8)
        skills = [
            random_skill(folder / f"{drive}-{name}.npz", name, kinds, rng, drive) for name, kinds in looks.items()
        ]
        near = "start={x_m=[3.3, 4.7], y_m=[1.2, 2.6], facing='ball', spread_deg=60.0}"
        players = ", ".join(f"{{team={team}, {near}}}" for team in (0, 0, 1, 0))
        found[drive] = settings_of(
            "chapter6/dissertation-three-learners",
            f"players=[{players}]",
            f"world.robot.drive='{drive}'",
            "world.field.corner_panels=false",
            "game.time_limit_steps=200",
            "game.ball_start={x_m=[3.5, 4.5], y_m=[1.4, 2.4]}",
            *skills,
        )
    return found


@pytest.mark.parametrize("preset", PRESETS)
def test_compiled_games_are_those_of_the_plain_loop(
    preset, settings_of, random_trees, the_same_tree, seeds_of, play_both
):
    settings = settings_of(preset, "game.time_limit_steps=300")
    texts = (
        HAND_TYPED,
        "pass",
        "IF_ball_is_left(pass, IF_own_goal_is_lost(IF_ball_is_large(shoot, avoid), IF_own_goal_is_left(pass, search)))",
    )
    trees = [the_same_tree(settings, text) for text in texts] + random_trees(settings, 12, seed=2)
    different, outcomes, _ = play_both(settings, trees, seeds_of(4, count=15))
    assert sum(outcome.kicks.sum() for outcome in outcomes) > 20  # they played
    assert different == []


@pytest.mark.parametrize("drive", ["pws", "4ws"])
def test_crowded_games_of_random_skills_are_those_of_the_plain_loop(wild, drive, random_trees, seeds_of, play_both):
    settings = wild[drive]
    different, outcomes, _ = play_both(settings, random_trees(settings, 25, seed=3), seeds_of(5, count=25))
    for name, least in (("kicks", 40), ("collisions", 20), ("passes", 1)):
        assert sum(getattr(outcome, name).sum() for outcome in outcomes) >= least, name
    assert np.all(sum(outcome.skill_steps for outcome in outcomes) > 0)
    assert different == []


ADDED = (
    "conditions.near={objects=['ball', 'robot'], expression='area >= 40 and x >= 10 and x < 54'}",
    "conditions.leaning={objects=['own_goal', 'opponent_goal'], expression='upper_left_y - upper_right_y * 1.1 < -1'}",
    "conditions.high={objects=['robot', 'ball'], expression='y < 0.5 * x + 8'}",
    "conditions.there={objects=['ball', 'robot', 'own_goal'], expression='visible'}",
    "conditions.gone={objects=['opponent_goal'], expression='lost'}",
    "skills.avoid=''",
    "skills.strike=shoot",
    "skills.flee=avoid",
    "skills.find=search",
)


def test_games_of_added_conditions_and_skills_are_those_of_the_plain_loop(
    settings_of, random_trees, seeds_of, play_both
):
    settings = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=300", *ADDED)
    trees = random_trees(settings, 20, seed=31)
    asked = {name for team in trees for tree in team for name in tree.names}
    added = {name for robot in range(3) for name in SoccerGame(settings).function_set(robot).functions[35:]}
    assert len(added) == 16  # near and high 4 each, there 5, leaning 2, gone 1
    assert added <= asked
    different, outcomes, _ = play_both(settings, trees, seeds_of(6, count=20))
    assert np.all(sum(outcome.skill_steps for outcome in outcomes).sum(axis=0) > 0)  # each of the six terminals acts
    assert different == []


GIVEN = ("players.2.control=tree", "players.2.tree='IF_r0_is_lost(search, IF_ball_is_large(shoot, pass))'")


def test_a_given_tree_plays_the_games_of_the_plain_loop_and_those_of_the_same_tree_that_evolves(
    settings_of, random_trees, seeds_of, play_both, programs
):
    settings = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=200", *GIVEN)
    trees, seeds = random_trees(settings, 8, seed=33), seeds_of(34, count=8)
    assert {team[2] for team in trees} == {None}
    different, outcomes, _ = play_both(settings, trees, seeds)
    assert different == []
    evolving = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=200")
    given = parse(settings.players[2].tree)
    for team, seed, outcome in zip(trees, seeds, outcomes, strict=True):
        played = Arena(evolving).play(programs(evolving, [*team[:2], given]), np.array([seed]))
        assert np.array_equal(played.skill_steps, outcome.skill_steps)
        assert played.skill_steps[2].sum() == played.steps[0]
    game = SoccerGame(settings)
    assert [role.evolves for role in game.roles] == [True, True, False]
    assert game.trees_of(trees[0]) == [*trees[0][:2], given]
    assert len(game.play(programs(settings, trees[0]), seeds).leaf_steps[2]) == 0


@pytest.mark.parametrize(
    ("assignments", "said"),
    [
        (GIVEN[:1], 'control = "tree" needs a tree, such as tree = "IF_ball_is_lost(search, shoot)"'),
        (GIVEN[1:], "tree: a robot plays by a given tree where its control = \"tree\", got 'evolve'"),
    ],
)
def test_a_tree_without_a_robot_and_a_robot_without_a_tree_are_refused(assignments, said, settings_of):
    with pytest.raises(InputError, match=re.escape(said)):
        settings_of("chapter6/dissertation-three-learners", *assignments)


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        ("IF_r2_is_lost(shoot, pass)", "players.2.tree: unknown name 'IF_r2_is_lost' at character 1"),
        ("dribble", "players.2.tree: unknown name 'dribble' at character 1"),
        ("IF_ball_is_lost(shoot", "players.2.tree: the text ends where ',' was expected"),
    ],
)
def test_a_given_tree_that_asks_what_is_not_there_is_refused(tree, said, settings_of):
    settings = settings_of("chapter6/dissertation-three-learners", GIVEN[0], f"players.2.tree='{tree}'")
    with pytest.raises(InputError, match=re.escape(said)):
        check_playable(settings)


def with_one_lost_state(skill, path, objects):
    """Write ``skill`` with one state only (3.9) for each of the ``objects`` (numbers) that is not visible."""
    values = skill.values.reshape(*(model.states for model in skill.objects), skill.actions)
    models = list(skill.objects)
    for i in objects:
        assert models[i].lost_states == 2
        models[i] = dataclasses.replace(models[i], lost_states=1)
        values = np.delete(values, -1, axis=i)
    values = values.reshape(-1, skill.actions)
    dataclasses.replace(skill, objects=tuple(models), values=values).save(path)


@pytest.mark.parametrize("preset", ["two-learners", "three-learners"])
def test_skills_with_one_lost_state_play_the_games_of_the_plain_loop(
    preset, tmp_path, settings_of, random_trees, the_same_tree, seeds_of, play_both
):
    # The first, the last or the only object has one; r2 of three learners has no mate at all.
    changed = {"shoot": (0,), "pass": (1,), "avoid": (0,), "search": (0,)}
    for name, objects in changed.items():
        with_one_lost_state(load_skill(name), tmp_path / f"{name}.npz", objects)
    settings = settings_of(
        preset, "game.time_limit_steps=200", *(f"skills.{name}='{tmp_path / name}.npz'" for name in changed)
    )
    trees = [the_same_tree(settings, skill) for skill in SKILLS] + random_trees(settings, 8, seed=28)
    different, outcomes, _ = play_both(settings, trees, seeds_of(29, count=12))
    assert np.all(sum(outcome.skill_steps for outcome in outcomes) > 0)
    assert different == []


def everything(arena, team, seed):
    """Return all bytes of a game."""
    outcome, trace = arena.trace(team, seed)
    parts = [outcome.steps, outcome.scorer, outcome.kicks, outcome.collisions, outcome.passes, outcome.skill_steps]
    parts += [*outcome.leaf_steps, trace.states, trace.skills, trace.actions]
    return b"".join(part.tobytes() for part in parts)


@pytest.mark.parametrize("noise", ["", "world.camera.noise_px=0.5"])
def test_a_game_is_the_same_whatever_was_played_before(wild, noise, settings_of, programs, random_trees, seeds_of):
    for settings in (settings_of("chapter6/dissertation-three-learners", *filter(None, [noise])), wild["pws"]):
        teams = [programs(settings, trees) for trees in random_trees(settings, 6, seed=6)]
        games = [(team, seed) for team in teams for seed in seeds_of(7, count=3)]
        alone = [everything(Arena(settings), *game) for game in games]
        assert len(set(alone)) == len(games)
        arena, rng = Arena(settings), np.random.default_rng(1)
        for _ in range(3):
            for n in rng.permutation(len(games)):
                assert everything(arena, *games[n]) == alone[n]


def test_a_game_is_the_same_whatever_else_is_in_the_call(settings_of, programs, random_trees, seeds_of):
    settings = settings_of("chapter6/dissertation-three-learners")
    arena, seeds = Arena(settings), seeds_of(8, count=12)
    (team,) = (programs(settings, trees) for trees in random_trees(settings, 1, seed=9))
    together = arena.play(team, seeds)
    assert len(np.unique(together.kicks, axis=0)) > 3
    order = np.random.default_rng(2).permutation(12)
    turned = arena.play(team, seeds[order])
    for name in ("steps", "scorer", "kicks", "collisions", "passes", "own_goals"):
        assert np.array_equal(getattr(turned, name), getattr(together, name)[order]), name
        alone = np.concatenate([getattr(arena.play(team, seeds[n : n + 1]), name) for n in range(12)])
        assert np.array_equal(alone, getattr(together, name)), name
    assert np.array_equal(turned.skill_steps, together.skill_steps)
    for one, two in zip(turned.leaf_steps, together.leaf_steps, strict=True):
        assert np.array_equal(one, two)


def test_a_trace_is_the_game_that_is_played(settings_of, programs, random_trees, seeds_of):
    settings = settings_of("chapter6/dissertation-three-learners")
    arena, seeds = Arena(settings), seeds_of(9, count=6)
    (team,) = (programs(settings, trees) for trees in random_trees(settings, 1, seed=10))
    played = arena.play(team, seeds)
    for n, seed in enumerate(seeds):
        outcome, trace = arena.trace(team, seed)
        steps = int(played.steps[n])
        assert outcome.steps.tolist() == [steps]
        assert outcome.scorer[0] == played.scorer[n]
        assert np.array_equal(outcome.kicks[0], played.kicks[n])
        assert trace.states.shape == (steps + 1, 4, 6)
        assert trace.skills.shape == trace.actions.shape == (steps, 3)


def test_no_games_are_no_trouble(settings_of, programs, the_same_tree):
    settings = settings_of("chapter6/dissertation-two-learners")
    outcome = Arena(settings).play(programs(settings, the_same_tree(settings, "shoot")), np.zeros(0, np.uint64))
    assert outcome.steps.shape == (0,)
    assert outcome.goals_of(0) == 0


@pytest.mark.parametrize("preset", PRESETS)
def test_noise_is_off_by_default(preset, settings_of):
    world = settings_of(preset).world
    assert world.camera.noise_px == 0.0
    assert world.robot.actuator_noise == 0.0


@pytest.mark.parametrize("noise", ["world.camera.noise_px=1.0", "world.robot.actuator_noise=0.1"])
def test_noise_changes_a_game_and_can_be_repeated(noise, settings_of, programs, the_same_tree, seeds_of):
    quiet, noisy = (
        settings_of("chapter6/dissertation-two-learners"),
        settings_of("chapter6/dissertation-two-learners", noise),
    )
    team = programs(quiet, the_same_tree(quiet, HAND_TYPED))
    for seed in seeds_of(18, count=5):
        clean, one, two = (everything(Arena(settings), team, seed) for settings in (quiet, noisy, noisy))
        assert one == two
        assert one != clean
    starts = [Arena(settings).trace(team, seed)[1].states[0] for settings in (quiet, noisy)]
    assert np.array_equal(*starts)  # noise comes after the start is drawn


def test_actuator_noise_has_its_deviation(settings_of, programs, the_same_tree, seeds_of):
    # A robot that stands is not disturbed; one that drives is, by a share of its speed.
    settings = settings_of(
        "chapter6/dissertation-two-learners",
        "world.robot.actuator_noise=0.05",
        "world.robot.max_acceleration_mps2=1e5",
        "skills_elsewhere=allow",
    )
    arena, commands = Arena(settings), []
    team = programs(settings, the_same_tree(settings, HAND_TYPED))
    for seed in seeds_of(19, count=30):
        outcome, trace = arena.trace(team, seed)
        if outcome.collisions.any():
            continue
        for state, before, action in zip(trace.states[1:], trace.states, trace.actions[:, 0], strict=False):
            away = np.hypot(*(before[0, :2] - before[-1, :2]))
            inside = 0.4 < before[0, 0] < 7.8 and 0.4 < before[0, 1] < 4.1
            if away > 0.5 and inside and action >= 6:  # forwards, in the open: 1 m/s is what it was told
                commands.append(np.hypot(*state[0, 3:5]))
    assert len(commands) > 200
    assert np.mean(commands) == pytest.approx(1.0, abs=5.0 * 0.05 / math.sqrt(len(commands)))
    assert np.std(commands) == pytest.approx(0.05, rel=5.0 / math.sqrt(2 * len(commands)))


def test_the_plain_loop_refuses_noise(settings_of):
    with pytest.raises(ValueError, match="no noise"):
        PlainGame(settings_of("smoke", "world.camera.noise_px=0.1"))
