"""Two robots in one trial: rewards and ends, what is learned, what is reused, where trials start."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from behaviors.schedule.agents import where_nearer
from behaviors.trials.kernels import act, begin_trial, judge_trial
from behaviors.trials.task import COLLISION, FAILURE, GOING, PASSER, SHOOTER, STRAY_GOAL, SUCCESS
from coevo.compiled import entry
from coevo.skill import estimate
from coevo.soccer.events import record_contacts
from coevo.stage import LEARNER, SKILL, STANDING, run_episode
from coevo.stage.kernels import sense

LINE, MIDDLE = 8.22, 2.2875


@entry
def count_contacts(stage, time):
    """Count what the gaps mean, as a step of the stage does."""
    record_contacts(stage.limits, stage.roles.team, time, stage.body.ball_gap, stage.body.robot_gap, stage.events)


@entry
def discrete_state(stage, robot, time):
    return estimate.discrete_state(stage.memory, stage.bank, stage.roles.skill[robot], robot, time)


# ------------------------------------------------------------------------------------------------- rewards and endings


class Situation:
    """A pair in the middle of a trial that is put together by hand."""

    def __init__(self, one) -> None:
        self.trial = one.scene.trial
        self.stage, self.decisions = self.trial.stage, self.trial.minds.decisions
        assert begin_trial(self.trial, 0, 1, np.array([1], np.uint64))
        self.stage.body.state[:] = 0.0
        self.stage.body.state[:, :2] = (2.0, 1.0), (5.0, 3.0), (4.0, MIDDLE)
        self.decisions.made[:], self.decisions.rewards[:, 0] = 1, 0.0
        self.time = 0

    def step(self, *, touching=(False, False), collide=False, **places):  # noqa: ANN003 - places of bodies
        """Let a step end so; return how the trial stands and both robots' rewards of this step."""
        body, before = self.stage.body, self.decisions.rewards[:, 0].copy()
        for name, place in places.items():
            body.state[("passer", "shooter", "ball").index(name), :2] = place
        body.ball_gap[:] = np.where(touching, 0.0, 1.0)
        body.robot_gap[:] = 0.0 if collide else 1.0
        count_contacts(self.stage, self.time)
        self.time += 1
        ends = judge_trial(self.trial, self.time)
        return ends, *(round(float(one), 9) for one in self.decisions.rewards[:, 0] - before)


GOAL = (LINE + 0.01, MIDDLE)


def test_a_goal_counts_for_a_shooter_that_touched_the_ball_last(pair):
    assert Situation(pair()).step(ball=GOAL) == (STRAY_GOAL, 0.0, 0.0)
    one = Situation(pair())
    assert one.step(touching=(False, True)) == (GOING, 0.0, 0.0)
    assert one.step(ball=GOAL) == (SUCCESS, 0.0, 1.0)
    one = Situation(pair())
    one.step(touching=(False, True))
    one.step(touching=(True, False))
    assert one.step(ball=GOAL) == (STRAY_GOAL, 0.0, 0.0)


def test_a_goal_comes_before_everything_else_and_then_collisions(pair):
    one = Situation(pair())
    assert one.step(touching=(False, True), ball=GOAL, shooter=GOAL, collide=True) == (SUCCESS, 0.0, 1.0)
    assert Situation(pair()).step(collide=True, passer=(-0.1, MIDDLE)) == (COLLISION, -0.3, -0.3)


@pytest.mark.parametrize(
    "places", [{"ball": (-0.01, MIDDLE)}, {"passer": (-0.01, 2.0)}, {"shooter": (LINE + 0.1, 2.0)}]
)
def test_who_leaves_the_field_ends_the_trial_without_reward(pair, places):
    assert Situation(pair()).step(**places) == (FAILURE, 0.0, 0.0)


@pytest.mark.parametrize(("counted", "second"), [("first", 0.0), ("each", 1.0)])
def test_a_pass_is_rewarded_and_does_not_end_the_trial(pair, counted, second):
    one = Situation(pair(f"passes_rewarded={counted}"))
    rewards = []
    for _ in range(2):
        one.step(touching=(True, False))
        one.step()
        rewards.append(one.step(touching=(False, True)))
        one.step()
    assert rewards == [(GOING, 1.0, 0.0), (GOING, second, 0.0)]
    assert one.trial.tally.passes[0] == 2


def test_what_is_no_pass(pair):
    one = Situation(pair())
    one.step(touching=(False, True))
    one.step()
    assert one.step(touching=(True, False)) == (GOING, 0.0, 0.0)  # the shooter's pass to the passer
    assert one.step(touching=(True, True)) == (GOING, 0.0, 0.0)  # the passer still holds it
    for waited, reward in ((90, 1.0), (91, 0.0)):  # 3 s
        one = Situation(pair())
        one.step(touching=(True, False))
        for _ in range(waited - 1):
            one.step()
        assert one.step(touching=(False, True)) == (GOING, reward, 0.0)


def test_only_robots_that_learn_are_rewarded(pair):
    assert Situation(pair(roles=(SKILL, STANDING))).step(collide=True) == (COLLISION, 0.0, 0.0)
    assert Situation(pair(roles=(SKILL, LEARNER))).step(collide=True) == (COLLISION, 0.0, -0.3)


# ----------------------------------------------------------------------------------------------------------- learning


@pytest.mark.parametrize("update", ["lambda-returns", "one-step"])
def test_a_plain_learner_that_is_told_the_decisions_learns_the_same(pair, plain_update, update):
    changes = [f"{who}.learning.update={update}" for who in ("passer", "shooter")]
    one = pair(*changes, "pass_reward=2.0")
    minds, stage = one.scene.minds, one.scene.trial.stage
    values = [mind.table.values.tolist() for mind in minds]
    visits = [mind.table.visits.tolist() for mind in minds]
    rewards, ends = [], set()
    for n in range(40):
        found = one.run((9,), 1, first=n, total=40)
        end, steps = int(found.ends[0]), int(found.steps[0])
        ends.add(end)
        for robot, mind in enumerate(minds):
            told = one.told(robot)
            assert sum(length for *_, length in told) == steps
            last = int(mind.table.rows[discrete_state(stage, robot, steps)]) if end == GOING else -1
            rewards.append(sum(reward for _, _, reward, _ in told))
            expected = 2.0 * (robot == PASSER and found.passes[0] > 0) - 0.3 * (end == COLLISION)
            expected += robot == SHOOTER and end == SUCCESS
            assert rewards[-1] == pytest.approx(expected)
            plain_update(mind.learner, values[robot], visits[robot], told, last)
            np.testing.assert_allclose(mind.table.values, values[robot], rtol=1e-9, atol=1e-12)
            assert mind.table.visits.tolist() == visits[robot]
    assert any(rewards)
    assert len(ends) > 1
    assert GOING in ends


def test_the_old_policy_is_followed_with_probability_1_minus_beta(pair):
    def change(agents):
        agent = agents[PASSER]
        old, new = np.zeros_like(agent.values), np.zeros_like(agent.values)
        old[:, 2], new[:, 5] = 1.0, 1.0
        agent.old, agent.values = (agent.models, old), new

    changes = ("epsilon_start=0.0", "epsilon_end=0.0", "alpha=1e-9", "alpha_min=0")
    one = pair(*(f"passer.learning.{key}" for key in changes), roles=(LEARNER, STANDING), change=change)
    assert [mind.old for mind in one.scene.minds] == [1, -1]
    total = 101
    for trial in (0, 25, 50, 90, 100):
        actions = []
        for run in range(15):
            one.run((7, run), 1, first=trial, total=total)
            actions += [action for _, action, *_ in one.told(PASSER)]
        assert set(actions) <= {2, 5}
        renewed, beta = actions.count(5), trial / (total - 1)  # (trial - 1) / (N_all - 1), counted from 1
        assert stats.binomtest(renewed, len(actions), beta).pvalue > 1e-4
    assert renewed == len(actions)


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.slow
def test_a_robot_with_a_fixed_policy_follows_it_but_for_its_share_of_random_actions(pair, share):
    def change(agents):
        agents[PASSER].values = np.zeros_like(agents[PASSER].values)
        agents[PASSER].values[:, 3] = 1.0

    scene = pair(f"fixed_epsilon={share}", roles=(SKILL, STANDING), change=change).scene
    doing, actions = scene.trial.stage.doing, []

    def choose(scene, time, rng):
        act(scene.trial, time, rng)
        if doing.held[PASSER] == 1:  # an action that began in this step
            actions.append(int(doing.action[PASSER]))

    for seed in range(20):
        rng = np.array([seed], np.uint64)
        assert begin_trial(scene.trial, 0, 1, rng)
        run_episode.py_func(
            scene,
            scene.time_limit,
            rng,
            lambda scene, time, rng: sense(scene.trial.stage, time, rng),
            choose,
            lambda scene, time: judge_trial(scene.trial, time),
        )
    others = len(actions) - actions.count(3)
    assert len(actions) > 50
    assert stats.binomtest(others, len(actions), share * 6 / 7).pvalue > 1e-4


# -------------------------------------------------------------------------------------------------------------- starts


def test_in_a_share_of_the_trials_the_passer_starts_nearer_to_the_ball(pair):
    found = {}
    for share in (0.0, 0.25, 1.0):
        one = pair(f"starts.passer_nearer={share}", "time_limit_steps=1", roles=(SKILL, SKILL))
        found[share] = one.run((6,), 800)
        state = one.scene.trial.stage.body.state  # of the last start, a step later
        distances = np.hypot(*(state[:2, :2] - state[2, :2]).T)
        if abs(distances[0] - distances[1]) > 0.2:
            assert found[share].nearer[-1] == distances.argmin()
    anyway = (found[0.0].nearer == PASSER).mean()
    assert 0.0 < anyway < 0.3
    assert (found[1.0].nearer == PASSER).all()
    expected = 0.25 + 0.75 * anyway
    assert abs((found[0.25].nearer == PASSER).mean() - expected) < 0.07  # 4 standard deviations
    parts = [where_nearer(found[0.25], robot) for robot in (PASSER, SHOOTER)]
    assert sum(len(part.ends) for part in parts) == 800
    assert all((part.nearer == robot).all() for robot, part in enumerate(parts))


def test_easy_missions_of_the_shooter_do_not_wait_for_the_passer(pair):
    changes = ("starts.passer_nearer=1.0", "time_limit_steps=1", "shooter.learning.easy_share=1.0")

    def forget(agents):
        agents[SHOOTER].values = None

    one = pair(*changes, roles=(SKILL, LEARNER), change=forget)
    easy = one.run((6,), 200, total=10_000)
    full = one.run((6,), 200, first=10_000, total=10_000)
    assert (easy.nearer == SHOOTER).any()
    assert (full.nearer == PASSER).all()


def test_a_robot_that_goes_on_with_what_it_learned_has_no_easy_missions_again(pair):
    changes = ("starts.passer_nearer=1.0", "time_limit_steps=1", "shooter.learning.easy_share=1.0")
    found = pair(*changes, roles=(SKILL, LEARNER)).run((6,), 200, total=10_000)
    assert (found.nearer == PASSER).all()
