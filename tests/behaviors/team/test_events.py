"""What the robots of a team are rewarded for: against a plain reference that is told who touched whom, step by step."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from behaviors.team.recipe import read_team
from behaviors.team.scene import run_games, team_scene, unlearned
from behaviors.trials import task as tasks
from behaviors.trials.kernels import act, begin_trial, judge_trial
from behaviors.trials.task import (
    BUMPED,
    CHANNELS,
    COLLIDED,
    CONCEDED,
    FAILURE,
    GIVEN_AWAY,
    GOING,
    KICKED,
    PASSED,
    SUCCEEDED,
    SUCCESS,
    TOUCHED,
)
from coevo.compiled import entry
from coevo.soccer.events import record_contacts
from coevo.stage import run_episode
from coevo.stage.kernels import sense

THREE = "chapter5/three-robots"
FAR = 1.0


@entry
def judge(task, stage, tally, time):
    body = stage.body
    record_contacts(stage.limits, stage.roles.team, time, body.ball_gap, body.robot_gap, stage.events)
    return tasks.judge(task, stage, tally)


def scene_of(recipe, learners=(0, 1, 2)):
    recipe = msgspec.structs.replace(recipe, learning=msgspec.structs.replace(recipe.learning, storage="dense"))
    members = unlearned(recipe)
    return team_scene(recipe, members, learners, tables=[members[n].first_table(recipe) for n in learners])


def of_the_ball(limits, teams, touches, counts):
    """Add touches, kicks, passes and giveaways; who had the ball is looked for backwards through the whole game."""
    steps, robots = touches.shape
    had = [(t, r) for t in range(steps) for r in range(robots) if touches[t, r]]
    for n, (t, r) in enumerate(had):
        counts[r, TOUCHED] += 1
        if t > 0 and touches[t - 1, r]:
            continue
        counts[r, KICKED] += 1
        if n > 0:
            since, giver = had[n - 1]
            if giver != r and not touches[t, giver] and t - since <= limits.pass_window:
                counts[giver, PASSED if teams[giver] == teams[r] else GIVEN_AWAY] += 1
    return had[-1][1] if had else -1


def of_collisions(limits, gaps, one, other, counts):
    """Add how often a robot ran into another: again only after they had parted."""
    parted = True
    for gap in gaps[:, one, other]:
        if gap <= limits.contact_gap:
            counts[one, COLLIDED] += parted
            parted = False
        elif gap > limits.release_gap:
            parted = True


def reference(limits, teams, touches, gaps, scored, *, whole_team=False):
    """Return (robots, CHANNELS) counts of a game from (steps, robots) touches and (steps, robots, robots) gaps.

    Written from the definitions, with the whole game at hand.
    """
    counts = np.zeros((len(teams), CHANNELS), int)
    last = of_the_ball(limits, teams, touches, counts)
    for r, team in enumerate(teams):
        others = [other for other in range(len(teams)) if other != r]
        counts[r, BUMPED] = (gaps[:, r, others] <= limits.contact_gap).any(axis=1).sum()
        for other in others:
            of_collisions(limits, gaps, r, other, counts)
        counts[r, SUCCEEDED] = team == scored and (whole_team or last == r)
        counts[r, CONCEDED] = scored >= 0 and team != scored
    return counts


@pytest.mark.parametrize("credit", ["last-touch", "team"])
def test_events_of_made_up_games_are_those_of_a_plain_reference(credit):
    recipe = msgspec.structs.replace(read_team(THREE), credit=credit)
    scene, rng, seen = scene_of(recipe), np.random.default_rng(5), np.zeros(CHANNELS, int)
    stage, tally = scene.venue.stage, scene.trial.tally
    teams, length = [0, 0, 1], recipe.world.field.length_m
    for game in range(60):
        steps = 120
        touches = rng.random((steps, 3)) < rng.choice([0.02, 0.3])
        gaps = np.full((steps, 3, 3), FAR)
        for one, other in ((0, 1), (0, 2), (1, 2)):
            gaps[:, one, other] = gaps[:, other, one] = rng.choice([0.0, 0.01, FAR], size=steps, p=[0.1, 0.2, 0.7])
        scored = game % 3 - 1
        begin_trial(scene.trial, 0, 1, np.array([game], np.uint64))
        stage.body.state[-1, :2], total = (4.0, 2.0), np.zeros((3, CHANNELS))
        for t in range(steps):
            stage.body.ball_gap[:], stage.body.robot_gap[:] = np.where(touches[t], 0.0, FAR), gaps[t]
            if t == steps - 1 and scored >= 0:
                stage.body.state[-1, 0] = length + 0.1 if scored == 0 else -0.1
            standing = judge(scene.trial.task, stage, tally, t)
            total += tally.rewards
        expected = reference(stage.limits, teams, touches, gaps, scored, whole_team=credit == "team")
        assert np.array_equal(tally.counted, expected)
        assert np.array_equal(total, expected)
        assert standing == (GOING, SUCCESS, FAILURE)[scored + 1]
        seen += expected.sum(axis=0)
    assert (seen > 5).all()


@pytest.mark.parametrize("paid", ["step", "contact", "action"])
def test_channels_are_paid_for_the_events_of_recorded_trials_and_for_nothing_else(paid):
    recipe = read_team(THREE, ["time_limit_steps=300", "learning.epsilon_start=1.0"])
    recipe = msgspec.structs.replace(recipe, reward=msgspec.structs.replace(recipe.reward, paid=paid))
    scene, happened = scene_of(recipe), np.zeros(CHANNELS, int)
    stage, outlook = scene.venue.stage, scene.trial.minds.outlook
    for number in range(25):
        rng, touches, gaps = np.array([number], np.uint64), [], []
        assert begin_trial(scene.trial, 0, 10**9, rng)  # the first of many: the ball lies before a goal

        def judged(scene, time, touches=touches, gaps=gaps):
            touches.append(stage.body.ball_gap <= stage.limits.contact_gap)
            gaps.append(np.maximum(stage.body.robot_gap, stage.body.robot_gap.T))
            return judge_trial(scene.trial, time)

        ends, _ = run_episode.py_func(
            scene,
            scene.time_limit,
            rng,
            lambda scene, time, rng: sense(scene.trial.stage, time, rng),
            lambda scene, time, rng: act(scene.trial, time, rng),
            judged,
        )
        scored = {GOING: -1, SUCCESS: 0, FAILURE: 1}[ends]
        counts = reference(stage.limits, [0, 0, 1], np.array(touches), np.array(gaps), scored)
        assert np.array_equal(scene.trial.tally.counted, counts)
        happened += counts.sum(axis=0)
        for robot in range(3):
            made = int(scene.trial.minds.decisions.made[robot])
            c, lost, m, s, p, k = outlook.earned[robot, :made].sum(axis=0)
            of = counts[robot]
            assert (lost, m, s, p) == (-of[CONCEDED], -of[GIVEN_AWAY], of[SUCCEEDED], of[PASSED])
            if paid == "step":
                assert (c, k) == (-of[BUMPED], of[TOUCHED])
            elif paid == "contact":
                assert (c, k) == (-of[COLLIDED], of[KICKED])
            else:  # once an action, however long contact lasts
                assert set(outlook.earned[robot, :made, 5].tolist()) <= {0.0, 1.0}
                assert (k > 0, c < 0) == (of[TOUCHED] > 0, of[BUMPED] > 0)
                assert k <= of[TOUCHED]
    assert happened[TOUCHED] > 20
    assert happened[SUCCEEDED] + happened[CONCEDED] > 0


def test_the_first_learner_starts_near_the_ball_that_lies_before_the_goal_it_attacks():
    recipe = read_team(THREE, ["time_limit_steps=1", "learning.easy_share=1.0", "ball.x_m=[3.3, 4.9]"])
    length, middle = recipe.world.field.length_m, 0.5 * recipe.world.field.width_m
    for learner, goal_x in ((0, length), (2, 0.0)):
        scene = scene_of(recipe, (learner,))
        for seed in range(10):
            run_games(scene, recipe, seed, (0,), 1, total=1000)
            state = scene.venue.stage.body.state
            assert np.hypot(state[-1, 0] - goal_x, state[-1, 1] - middle) < 1.1
            assert np.hypot(*(state[-1, :2] - state[learner, :2])) < 0.7
            run_games(scene, recipe, seed, (0,), 1, first=999, total=1000)
            assert 3.2 < scene.venue.stage.body.state[-1, 0] < 5.0
