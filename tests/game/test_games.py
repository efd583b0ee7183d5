"""What games count, what a tree really decides in them, and what goes wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coevo.errors import InputError
from coevo.game import Arena, warm_up
from coevo.plain import PlainGame
from coevo.seeds import game_seed
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL
from coevo.soccer.conditions import things_of
from coevo.tree import parse
from coevo.vocabulary import CATEGORIES, SKILLS

PRESETS = (
    "chapter6/dissertation-two-learners",
    "chapter6/dissertation-stationary-opponent",
    "chapter6/dissertation-three-learners",
    "smoke",
)
HAND_TYPED = "IF_ball_is_lost(search, shoot)"


@pytest.mark.parametrize("preset", PRESETS)
def test_leaves_and_skills_are_counted_once_a_step(preset, settings_of, programs, random_trees, seeds_of):
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


def test_a_game_ends_with_a_goal_or_with_time(settings_of, programs, the_same_tree, seeds_of):
    settings = settings_of("chapter6/dissertation-two-learners")
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


def test_a_robot_without_a_tree_stands_until_it_is_pushed(settings_of, programs, the_same_tree, seeds_of):
    settings = settings_of("chapter6/dissertation-stationary-opponent")
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
def test_each_condition_is_what_the_robot_sees(robot, settings_of, programs, the_same_tree):
    settings = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=250")
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


def test_the_objects_of_robots_are_the_others_in_their_order(settings_of, programs, seeds_of):
    # r0 starts with its back to r2. Without any camera: what is behind is lost, what is ahead alone is not.
    settings = settings_of(
        "chapter6/dissertation-three-learners",
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


def test_only_the_chosen_branch_decides(settings_of, programs, the_same_tree, seeds_of):
    settings = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=200")
    arena = Arena(settings)
    always = "IF_ball_is_lost({0}, IF_ball_is_left({0}, IF_ball_is_middle({0}, IF_ball_is_right({0}, {1}))))"
    one = programs(settings, the_same_tree(settings, always.format("shoot", "search")))
    two = programs(settings, the_same_tree(settings, "shoot"))
    for seed in seeds_of(17, count=5):
        assert arena.trace(one, seed)[1].states.tobytes() == arena.trace(two, seed)[1].states.tobytes()


def test_games_seen_through_opencv_mostly_show_the_same(settings_of, the_same_tree, seeds_of):
    settings = settings_of("chapter6/dissertation-three-learners", "game.time_limit_steps=60")
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


def test_bodies_that_do_not_fit_are_the_users_to_mend(settings_of, programs, the_same_tree, seeds_of):
    spot = "{x_m=[2.0, 2.1], y_m=[2.0, 2.1]}"
    settings = settings_of("chapter6/dissertation-two-learners", f"game.ball_start={spot}", f"players.0.start={spot}")
    team = programs(settings, the_same_tree(settings, "shoot"))
    with pytest.raises(InputError, match=r"do not fit into their start regions.*widen game\.ball_start"):
        Arena(settings).play(team, seeds_of(21, count=1))


def test_skills_of_another_drive_are_refused_before_any_game(settings_of):
    with pytest.raises(InputError, match=r"'shoot' was learned for the drive pws.*coevo learn shoot --drive 4ws"):
        Arena(settings_of("smoke", "world.robot.drive='4ws'"))


def test_warming_up_tells_only_about_compiling(settings_of, programs, the_same_tree, seeds_of):
    settings, told = settings_of("smoke"), []
    Arena(settings).play(programs(settings, the_same_tree(settings, "shoot")), seeds_of(22, count=1))
    warm_up(settings, told.append)
    assert told == []
