"""Whole games: compiled against the plain loop, independence of what else is played, and what a tree really decides."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from coevo.config import GPSettings, RunSettings
from coevo.errors import InputError
from coevo.evolution.population import codes_of, first_population
from coevo.game import Arena, SoccerGame, warm_up
from coevo.plain import PlainGame
from coevo.recipes import read_settings
from coevo.seeds import game_seed, game_seeds
from coevo.skill import ObjectModel, Skill, load_skill
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL, ROBOTS
from coevo.soccer.conditions import things_of
from coevo.tree import Tree, from_codes, parse
from coevo.tree.program import compile_program, tree_codes
from coevo.vocabulary import CATEGORIES, SKILLS

PRESETS = ("two-learners", "stationary-opponent", "three-learners", "smoke")
HAND_TYPED, PASSES = "IF_ball_is_lost(search, shoot)", "IF_ball_is_lost(search, pass)"


def settings_of(preset, *assignments):
    """Return the settings of a preset, with some replaced."""
    return read_settings(RunSettings, preset, assignments)


def controlled(settings):
    """Return which robots evolve."""
    return [player.control == "evolve" for player in settings.players]


def programs(settings, trees):
    game, found = SoccerGame(settings), []
    for robot, tree in enumerate(trees):
        functions = game.function_set(robot)
        found.append(None if tree is None else compile_program(tree_codes(tree, functions), functions))
    return found


def random_trees(settings, count, seed, depths=(1, 6)):
    """Return ``count`` teams of random trees, None for robots that stand."""
    gp = GPSettings(population=count, elite=0, creation_depth_min=depths[0], creation_depth_max=depths[1])
    game, columns = SoccerGame(settings), []
    for robot, evolves in enumerate(controlled(settings)):
        functions = game.function_set(robot)
        trees = first_population(gp, functions, seed=seed, robot=robot)
        columns.append([from_codes(codes_of(tree, functions), functions) if evolves else None for tree in trees])
    return list(zip(*columns, strict=True))


def the_same_tree(settings, text):
    return [parse(text) if evolves else None for evolves in controlled(settings)]


def seeds_of(*key, count):
    return game_seeds(*key, count=count)


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
def wild(tmp_path_factory):
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
            "three-learners",
            f"players=[{players}]",
            f"world.robot.drive='{drive}'",
            "world.field.corner_panels=false",
            "game.time_limit_steps=200",
            "game.ball_start={x_m=[3.5, 4.5], y_m=[1.4, 2.4]}",
            *skills,
        )
    return found


# ------------------------------------------------------------------------------------------- compiled against plain


def play_both(settings, trees, seeds):
    """Return how many games differ in anything, and all that happened in them."""
    arena, plain = Arena(settings), PlainGame(settings)
    different, outcomes = [], []
    for n, (team, seed) in enumerate(zip(trees, seeds, strict=True)):
        one, seen = arena.trace(programs(settings, team), seed)
        two, expected = plain.play(team, seed, thoughts=True)
        equal = [
            np.array_equal(getattr(one, name), getattr(two, name))
            for name in ("steps", "scorer", "kicks", "collisions", "passes", "own_goals", "skill_steps")
        ]
        equal += [
            seen.states.tobytes() == expected.states.tobytes(),
            np.array_equal(seen.skills, expected.skills),
            np.array_equal(seen.actions, expected.actions),
            np.array_equal(seen.leaves, expected.leaves),
            np.array_equal(seen.perceived, expected.perceived),
        ]
        if not all(equal):
            different.append(n)
        outcomes.append(two)
    return different, outcomes


@pytest.mark.parametrize("preset", PRESETS)
def test_compiled_games_are_those_of_the_plain_loop(preset):
    settings = settings_of(preset, "game.time_limit_steps=300")
    texts = (
        HAND_TYPED,
        "pass",
        "IF_ball_is_left(pass, IF_own_goal_is_lost(IF_ball_is_large(shoot, avoid), IF_own_goal_is_left(pass, search)))",
    )
    trees = [the_same_tree(settings, text) for text in texts] + random_trees(settings, 12, seed=2)
    different, outcomes = play_both(settings, trees, seeds_of(4, count=15))
    assert sum(outcome.kicks.sum() for outcome in outcomes) > 20  # they played
    assert different == []


@pytest.mark.parametrize("drive", ["pws", "4ws"])
def test_crowded_games_of_random_skills_are_those_of_the_plain_loop(wild, drive):
    settings = wild[drive]
    different, outcomes = play_both(settings, random_trees(settings, 25, seed=3), seeds_of(5, count=25))
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


def test_games_of_added_conditions_and_skills_are_those_of_the_plain_loop():
    settings = settings_of("three-learners", "game.time_limit_steps=300", *ADDED)
    trees = random_trees(settings, 20, seed=31)
    asked = {name for team in trees for tree in team for name in tree.names}
    added = {name for robot in range(3) for name in SoccerGame(settings).function_set(robot).functions[35:]}
    assert len(added) == 16  # near and high 4 each, there 5, leaning 2, gone 1
    assert added <= asked
    different, outcomes = play_both(settings, trees, seeds_of(6, count=20))
    assert np.all(sum(outcome.skill_steps for outcome in outcomes).sum(axis=0) > 0)  # each of the six terminals acts
    assert different == []


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
def test_skills_with_one_lost_state_play_the_games_of_the_plain_loop(preset, tmp_path):
    # The first, the last or the only object has one; r2 of three learners has no mate at all.
    changed = {"shoot": (0,), "pass": (1,), "avoid": (0,), "search": (0,)}
    for name, objects in changed.items():
        with_one_lost_state(load_skill(name), tmp_path / f"{name}.npz", objects)
    settings = settings_of(
        preset, "game.time_limit_steps=200", *(f"skills.{name}='{tmp_path / name}.npz'" for name in changed)
    )
    trees = [the_same_tree(settings, skill) for skill in SKILLS] + random_trees(settings, 8, seed=28)
    different, outcomes = play_both(settings, trees, seeds_of(29, count=12))
    assert np.all(sum(outcome.skill_steps for outcome in outcomes) > 0)
    assert different == []


# ------------------------------------------------------------------------------------------------- games on their own


def everything(arena, team, seed):
    """Return all bytes of a game."""
    outcome, trace = arena.trace(team, seed)
    parts = [outcome.steps, outcome.scorer, outcome.kicks, outcome.collisions, outcome.passes, outcome.skill_steps]
    parts += [*outcome.leaf_steps, trace.states, trace.skills, trace.actions]
    return b"".join(part.tobytes() for part in parts)


@pytest.mark.parametrize("noise", ["", "world.camera.noise_px=0.5"])
def test_a_game_is_the_same_whatever_was_played_before(wild, noise):
    for settings in (settings_of("three-learners", *filter(None, [noise])), wild["pws"]):
        teams = [programs(settings, trees) for trees in random_trees(settings, 6, seed=6)]
        games = [(team, seed) for team in teams for seed in seeds_of(7, count=3)]
        alone = [everything(Arena(settings), *game) for game in games]
        assert len(set(alone)) == len(games)
        arena, rng = Arena(settings), np.random.default_rng(1)
        for _ in range(3):
            for n in rng.permutation(len(games)):
                assert everything(arena, *games[n]) == alone[n]


def test_a_game_is_the_same_whatever_else_is_in_the_call():
    settings = settings_of("three-learners")
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


def test_a_trace_is_the_game_that_is_played():
    settings = settings_of("three-learners")
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


def test_no_games_are_no_trouble():
    settings = settings_of("two-learners")
    outcome = Arena(settings).play(programs(settings, the_same_tree(settings, "shoot")), np.zeros(0, np.uint64))
    assert outcome.steps.shape == (0,)
    assert outcome.goals_of(0) == 0


# ------------------------------------------------------------------------------------------------------ what is counted


@pytest.mark.parametrize("preset", PRESETS)
def test_leaves_and_skills_are_counted_once_a_step(preset):
    settings = settings_of(preset, "game.time_limit_steps=200")
    arena = Arena(settings)
    for trees in random_trees(settings, 5, seed=11):
        outcome = arena.play(programs(settings, trees), seeds_of(12, count=4))
        for tree, leaves, skills in zip(trees, outcome.leaf_steps, outcome.skill_steps, strict=True):
            if tree is None:
                assert leaves.shape == (0,)
                assert not skills.any()
                continue
            assert leaves.shape == (tree.nodes,)
            assert leaves.sum() == skills.sum() == outcome.steps.sum()
            for skill, name in enumerate(SKILLS):
                assert sum(leaves[node] for node, what in enumerate(tree.names) if what == name) == skills[skill]


def test_a_game_ends_with_a_goal_or_with_time():
    settings = settings_of("two-learners")
    arena, limit, length = Arena(settings), settings.game.time_limit_steps, settings.world.field.length_m
    team = programs(settings, the_same_tree(settings, HAND_TYPED))
    scored = set()
    for seed in seeds_of(13, count=60):
        outcome, trace = arena.trace(team, seed)
        x, steps, scorer = trace.states[:, -1, 0], int(outcome.steps[0]), int(outcome.scorer[0])
        assert np.all((x[:-1] >= 0.0) & (x[:-1] <= length))  # in play until the end
        assert scorer == (0 if x[-1] > length else 1 if x[-1] < 0.0 else -1)
        assert steps == limit if scorer < 0 else steps <= limit
        assert outcome.goals_of(0) == int(scorer == 0)
        assert outcome.goals_of(1) == int(scorer == 1)
        scored.add(scorer)
    assert {-1, 0} <= scored


def test_a_robot_without_a_tree_stands_until_it_is_pushed():
    settings = settings_of("stationary-opponent")
    arena, trees = Arena(settings), the_same_tree(settings, HAND_TYPED)
    still = 0
    for seed in seeds_of(14, count=10):
        outcome, trace = arena.trace(programs(settings, trees), seed)
        assert np.all(trace.skills[:, 2] == -1)
        assert np.all(trace.actions[:, 2] == -1)
        assert np.all(trace.skills[:, :2] >= 0)
        if outcome.kicks[0, 2] == 0 and outcome.collisions[0, 2] == 0:
            assert np.ptp(trace.states[:, 2], axis=0).max() == 0.0
            still += 1
    assert still > 0


# ------------------------------------------------------------------------------------------- categories and decisions


def holds(settings, thing, category, features, area):
    """Tell whether "a is b" by Table 6.1: thirds of the image, limits of area."""
    limits = settings.categories
    if area <= 0.0 or category == "lost":
        return area <= 0.0 and category == "lost"
    if category in ("left", "middle", "right"):
        third = 64.0 / 3.0
        return category == ("left" if features[0] < third else "middle" if features[0] < 2.0 * third else "right")
    kind = "ball" if thing == BALL else "goal" if thing in (OWN_GOAL, OPPONENT_GOAL) else "robot"
    small, large = getattr(limits, f"{kind}_small_below_px"), getattr(limits, f"{kind}_large_from_px")
    return category == ("small" if area < small else "medium" if area < large else "large")


@pytest.mark.parametrize("robot", [0, 1, 2])
def test_each_condition_is_what_the_robot_sees(robot):
    settings = settings_of("three-learners", "game.time_limit_steps=250")
    arena, eye = Arena(settings), PlainGame(settings)
    seen = {}
    for thing, name in enumerate(things_of(robot, 3)):
        for category in CATEGORIES:
            trees = the_same_tree(settings, HAND_TYPED)
            trees[robot] = parse(f"IF_{name}_is_{category}(shoot, search)")
            _, trace = arena.trace(programs(settings, trees), game_seed(15, thing))
            for state, skills in zip(trace.states, trace.skills, strict=False):
                features, areas = eye._eye(state, robot)
                expected = holds(settings, thing, category, features[thing], areas[thing])
                assert SKILLS[skills[robot]] == ("shoot" if expected else "search"), (name, category)
                seen.setdefault((name, category), set()).add(expected)
    assert sum(found == {True, False} for found in seen.values()) > 20  # most conditions came out both ways


def test_the_objects_of_robots_are_the_others_in_their_order():
    # r0 starts with its back to r2. Without any camera: what is behind is lost, what is ahead alone is not.
    settings = settings_of(
        "three-learners",
        "game.time_limit_steps=90",
        "game.ball_start={x_m=[1.3, 1.9], y_m=[1.3, 1.9]}",
        "players.0.start={x_m=[1.6, 2.2], y_m=[0.6, 1.2], facing='ball', spread_deg=15.0}",
        "players.1.start.x_m=[1.0, 1.6]",
    )
    arena, counts = Arena(settings), {"r1": 0, "r2": 0}
    for seed in seeds_of(16, count=30):
        for name in counts:
            trees = [parse(f"IF_{name}_is_lost(search, avoid)"), parse("search"), parse("search")]
            _, trace = arena.trace(programs(settings, trees), seed)
            for state, skills in zip(trace.states, trace.skills, strict=False):
                ahead = np.arctan2(state[1:3, 1] - state[0, 1], state[1:3, 0] - state[0, 0]) - state[0, 2]
                if math.cos(ahead[1]) < 0.0 and math.cos(ahead[0]) > math.cos(math.radians(20.0)):
                    assert SKILLS[skills[0]] == ("avoid" if name == "r1" else "search")
                    counts[name] += 1
    assert min(counts.values()) > 20


def test_only_the_chosen_branch_decides():
    settings = settings_of("three-learners", "game.time_limit_steps=200")
    arena = Arena(settings)
    always = "IF_ball_is_lost({0}, IF_ball_is_left({0}, IF_ball_is_middle({0}, IF_ball_is_right({0}, {1}))))"
    one = programs(settings, the_same_tree(settings, always.format("shoot", "search")))
    two = programs(settings, the_same_tree(settings, "shoot"))
    for seed in seeds_of(17, count=5):
        assert arena.trace(one, seed)[1].states.tobytes() == arena.trace(two, seed)[1].states.tobytes()


# ---------------------------------------------------------------------------------------------------------------- noise


@pytest.mark.parametrize("preset", PRESETS)
def test_noise_is_off_by_default(preset):
    world = settings_of(preset).world
    assert world.camera.noise_px == 0.0
    assert world.robot.actuator_noise == 0.0


@pytest.mark.parametrize("noise", ["world.camera.noise_px=1.0", "world.robot.actuator_noise=0.1"])
def test_noise_changes_a_game_and_can_be_repeated(noise):
    quiet, noisy = settings_of("two-learners"), settings_of("two-learners", noise)
    team = programs(quiet, the_same_tree(quiet, HAND_TYPED))
    for seed in seeds_of(18, count=5):
        clean, one, two = (everything(Arena(settings), team, seed) for settings in (quiet, noisy, noisy))
        assert one == two
        assert one != clean
    starts = [Arena(settings).trace(team, seed)[1].states[0] for settings in (quiet, noisy)]
    assert np.array_equal(*starts)  # noise comes after the start is drawn


def test_actuator_noise_has_its_deviation():
    # A robot that stands is not disturbed; one that drives is, by a share of its speed.
    settings = settings_of(
        "two-learners",
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


def test_the_plain_loop_refuses_noise():
    with pytest.raises(ValueError, match="no noise"):
        PlainGame(settings_of("smoke", "world.camera.noise_px=0.1"))


# ----------------------------------------------------------------------------------------------------- the other camera


def test_games_seen_through_opencv_mostly_show_the_same():
    settings = settings_of("three-learners", "game.time_limit_steps=60")
    painted, exact = PlainGame(settings, camera="opencv"), PlainGame(settings)
    same, offsets = [], []
    for seed in seeds_of(20, count=2):
        outcome, trace = painted.play(the_same_tree(settings, HAND_TYPED), seed)
        assert len(trace.states) == int(outcome.steps[0]) + 1
        for state in trace.states[::3]:
            for robot in range(3):
                (seen, areas), (features, expected) = painted._eye(state, robot), exact._eye(state, robot)
                for thing in range(len(areas)):
                    same += [
                        holds(settings, thing, category, seen[thing], areas[thing])
                        == holds(settings, thing, category, features[thing], expected[thing])
                        for category in CATEGORIES
                    ]
                    if areas[thing] > 20.0 and expected[thing] > 20.0:
                        offsets.append(np.abs(seen[thing, :2] - features[thing, :2]).max())
    assert len(offsets) > 100
    assert np.mean(same) > 0.97
    assert np.median(offsets) < 0.5


# ------------------------------------------------------------------------------------------------------ what goes wrong


def test_bodies_that_do_not_fit_are_the_users_to_mend():
    spot = "{x_m=[2.0, 2.1], y_m=[2.0, 2.1]}"
    settings = settings_of("two-learners", f"game.ball_start={spot}", f"players.0.start={spot}")
    team = programs(settings, the_same_tree(settings, "shoot"))
    with pytest.raises(InputError, match=r"do not fit into their start regions.*widen game\.ball_start"):
        Arena(settings).play(team, seeds_of(21, count=1))


def test_skills_of_another_drive_are_refused_before_any_game():
    with pytest.raises(InputError, match=r"'shoot' was learned for the drive pws.*coevo learn shoot --drive 4ws"):
        Arena(settings_of("smoke", "world.robot.drive='4ws'"))


def test_warming_up_tells_only_about_compiling():
    settings, told = settings_of("smoke"), []
    Arena(settings).play(programs(settings, the_same_tree(settings, "shoot")), seeds_of(22, count=1))
    warm_up(settings, told.append)
    assert told == []


# ---------------------------------------------------------------------------------------------------------- some sense


@pytest.fixture(scope="module")
def random_goals():
    """Return the share of games that each of many random teams wins."""
    settings, games = settings_of("two-learners"), 5
    arena, teams = Arena(settings), random_trees(settings, 600, seed=25)
    won = [
        arena.play(programs(settings, trees), seeds_of(24, team, count=games)).goals_of(0)
        for team, trees in enumerate(teams)
    ]
    return np.array(won) / games


@pytest.mark.parametrize(
    "trees",
    [
        pytest.param((PASSES, "shoot"), id="r0 passes to r1"),
        pytest.param(("shoot", "shoot"), id="both shoot"),
        pytest.param((HAND_TYPED, HAND_TYPED), id="both search or shoot"),
    ],
)
def test_a_team_with_some_sense_scores_clearly_more_than_random_ones(random_goals, trees):
    settings, games = settings_of("two-learners"), 1000
    team = programs(settings, [parse(tree) for tree in trees])
    share = Arena(settings).play(team, seeds_of(23, count=games)).goals_of(0) / games
    # One-sided, 99.9 %: games of one random team are not independent of each other, but teams are.
    random = random_goals.mean(), random_goals.std(ddof=1) / math.sqrt(len(random_goals))
    error = math.hypot(math.sqrt(share * (1.0 - share) / games), random[1])
    assert share - random[0] > 3.1 * error, (share, *random)


@pytest.mark.parametrize("preset", ["two-learners", "stationary-opponent"])
def test_a_team_that_passes_does_better_than_one_robot_alone(preset):
    settings, games = settings_of(preset), 1000
    arena = Arena(settings)
    ahead = []
    for texts in ((PASSES, "shoot"), ("shoot", "search"), ("search", "shoot")):
        trees = [parse(text) for text in texts] + [None] * (len(settings.players) - 2)
        scorer = arena.play(programs(settings, trees), seeds_of(27, count=games)).scorer
        ahead.append((scorer == 0).astype(float) - (scorer == 1))
    for alone in ahead[1:]:
        gain = ahead[0] - alone  # the same games
        assert gain.mean() > 3.1 * gain.std(ddof=1) / math.sqrt(games)


def test_a_tree_is_its_text_in_any_writing():
    settings = settings_of("two-learners")
    spaced = parse(" IF_ball_is_lost ( search ,shoot ) ")
    assert spaced == Tree(("IF_ball_is_lost", "search", "shoot")) == parse(HAND_TYPED)
    arena = Arena(settings)
    one, two = (
        arena.play(programs(settings, [tree, tree]), seeds_of(26, count=3)) for tree in (spaced, parse(HAND_TYPED))
    )
    assert np.array_equal(one.steps, two.steps)


# -------------------------------------------------------------------------------------- categories as random play sees


def seen_by_random_teams(preset, teams, seed):
    """Return the areas [px] of what is visible to robots of random trees: of the ball, the goals and the robots."""
    settings = settings_of(preset)
    arena, eye, evolves = Arena(settings), PlainGame(settings), controlled(settings)
    found = {"ball": [], "goal": [], "robot": []}
    for trees, game in zip(
        random_trees(settings, teams, seed, depths=(2, 10)), seeds_of(seed, count=teams), strict=True
    ):
        for state in arena.trace(programs(settings, trees), game)[1].states[::15]:
            for robot in np.flatnonzero(evolves):
                _, areas = eye._eye(state, robot)
                found["ball"].append(areas[BALL])
                found["goal"] += areas[[OWN_GOAL, OPPONENT_GOAL]].tolist()
                found["robot"] += areas[ROBOTS:].tolist()
    return {kind: [area for area in areas if area > 0.0] for kind, areas in found.items()}


def test_about_a_third_of_what_random_teams_see_is_small_and_a_third_large():
    # Terciles of what is visible. Teams differ so much that the shares of 450 of them vary by 0.03 from seed to seed.
    limits = settings_of("three-learners").categories
    presets = [seen_by_random_teams(preset, 150, seed=30) for preset in PRESETS[:3]]
    for kind in ("ball", "goal", "robot"):
        areas = np.concatenate([found[kind] for found in presets])
        small, large = getattr(limits, f"{kind}_small_below_px"), getattr(limits, f"{kind}_large_from_px")
        assert np.mean(areas < small) == pytest.approx(1.0 / 3.0, abs=0.1)
        assert np.mean(areas >= large) == pytest.approx(1.0 / 3.0, abs=0.1)
