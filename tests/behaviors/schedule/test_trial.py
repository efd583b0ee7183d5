"""Two robots in one trial: rewards and ends, what is learned, what is reused, and images that come from elsewhere."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest
from behaviors.alone.experience import align
from behaviors.alone.task import COLLISION, FAILURE, GOING, SUCCESS
from behaviors.pair import trial as pairs
from behaviors.pair.agents import PERIODS
from behaviors.pair.data import FIXED, LEARNING, PASSER, RANDOM, SHOOTER, STATIONARY, make_store
from behaviors.pair.models import renew_models, stored_stretches, stored_windows
from behaviors.pair.recipe import TransferSettings, read_schedule
from behaviors.pair.schedule import Schooling
from behaviors.pair.transfer import run_elsewhere
from behaviors.pair.trial import STRAY_GOAL
from scipy import stats

from coevo.compiled import entry
from coevo.seeds import game_seeds

SMALL = (
    "trials=60",
    "games=20",
    "time_limit_steps=150",
    "experience.windows=300",
    "store.steps=3000",
    "store.least_windows=100",
    "store.report_orders=false",
    *(f"{who}.learning.{what}" for who in ("passer", "shooter") for what in ("check_every=50", "check_games=10")),
)
LINE, MIDDLE = 8.22, 2.2875


def schooling(*changes, seed=1):
    return Schooling(read_schedule("chapter3/schedule", [*SMALL, *changes]), seed)


@pytest.fixture(scope="module")
def schooled():
    """Return two robots that have been through all periods; only to be read."""
    done = schooling()
    done.learn(PERIODS["scheduled"])
    return done


def ready(*changes, roles=(LEARNING, LEARNING), stores=(False, False), schooled):
    """Return a Schooling whose robots know what those of ``schooled`` do, and its pair in these roles."""
    agents = tuple(dataclasses.replace(agent, old=None) for agent in schooled.agents)
    one = Schooling(read_schedule("chapter3/schedule", [*SMALL, *changes]), 1, agents=agents)
    for agent in agents:
        agent.store = make_store(3000)
    tables = [one.table(agent, PERIODS["simultaneous"][0].duties[0]) for agent in agents]
    return one, one.pair(roles, tables, stores=stores)


# ------------------------------------------------------------------------------------------------- rewards and endings


@entry
def judged(pair, time):
    return pairs._judge(pair, time)


class Situation:
    """A pair in the middle of a trial that is put together by hand."""

    def __init__(self, schooled, *changes) -> None:
        _, self.pair = ready(*changes, schooled=schooled)
        self.pair.stage.state[:, :2] = (2.0, 1.0), (5.0, 3.0), (4.0, MIDDLE)
        for player in self.pair.players:
            player.decisions.made[0], player.decisions.rewards[0] = 1, 0.0
        self.time = 0

    def step(self, *, touching=(False, False), collide=False, **places):  # noqa: ANN003 - places of bodies
        """Let a step end so; return how the trial stands and both robots' rewards of this step."""
        stage, before = self.pair.stage, [player.decisions.rewards[0] for player in self.pair.players]
        for name, place in places.items():
            stage.state[("passer", "shooter", "ball").index(name), :2] = place
        stage.ball_gap[:] = np.where(touching, 0.0, 1.0)
        stage.robot_gap[:] = 0.0 if collide else 1.0
        self.time += 1
        ends = judged(self.pair, self.time)
        after = [player.decisions.rewards[0] for player in self.pair.players]
        return ends, *(round(float(b - a), 9) for a, b in zip(before, after, strict=True))


GOAL = (LINE + 0.01, MIDDLE)


def test_a_goal_counts_for_a_shooter_that_touched_the_ball_last(schooled):
    assert Situation(schooled).step(ball=GOAL) == (STRAY_GOAL, 0.0, 0.0)
    one = Situation(schooled)
    assert one.step(touching=(False, True)) == (GOING, 0.0, 0.0)
    assert one.step(ball=GOAL) == (SUCCESS, 0.0, 1.0)
    one = Situation(schooled)
    one.step(touching=(False, True))
    one.step(touching=(True, False))
    assert one.step(ball=GOAL) == (STRAY_GOAL, 0.0, 0.0)


def test_a_goal_comes_before_everything_else_and_then_collisions(schooled):
    one = Situation(schooled)
    assert one.step(touching=(False, True), ball=GOAL, shooter=GOAL, collide=True) == (SUCCESS, 0.0, 1.0)
    assert Situation(schooled).step(collide=True, passer=(-0.1, MIDDLE)) == (COLLISION, -0.3, -0.3)


@pytest.mark.parametrize(
    "places", [{"ball": (-0.01, MIDDLE)}, {"passer": (-0.01, 2.0)}, {"shooter": (LINE + 0.1, 2.0)}]
)
def test_who_leaves_the_field_ends_the_trial_without_reward(schooled, places):
    assert Situation(schooled).step(**places) == (FAILURE, 0.0, 0.0)


@pytest.mark.parametrize(("counted", "second"), [("first", 0.0), ("each", 1.0)])
def test_a_pass_is_rewarded_and_does_not_end_the_trial(schooled, counted, second):
    one = Situation(schooled, f"passes_rewarded={counted}")
    rewards = []
    for _ in range(2):
        one.step(touching=(True, False))
        one.step()
        rewards.append(one.step(touching=(False, True)))
        one.step()
    assert rewards == [(GOING, 1.0, 0.0), (GOING, second, 0.0)]
    assert one.pair.stage.passes[0] == 2


def test_what_is_no_pass(schooled):
    one = Situation(schooled)
    one.step(touching=(False, True))
    one.step()
    assert one.step(touching=(True, False)) == (GOING, 0.0, 0.0)  # the shooter's pass to the passer
    assert one.step(touching=(True, True)) == (GOING, 0.0, 0.0)  # the passer still holds it
    for waited, reward in ((90, 1.0), (91, 0.0)):  # 3 s
        one = Situation(schooled)
        one.step(touching=(True, False))
        for _ in range(waited - 1):
            one.step()
        assert one.step(touching=(False, True)) == (GOING, reward, 0.0)


def test_only_robots_that_learn_are_rewarded(schooled):
    _, pair = ready(roles=(FIXED, STATIONARY), schooled=schooled)
    for player in pair.players:
        player.decisions.made[0], player.decisions.rewards[0] = 1, 0.0
    pair.stage.robot_gap[:] = 0.0
    pair.stage.state[:, 0] = 3.0
    assert judged(pair, 1) == COLLISION
    assert [player.decisions.rewards[0] for player in pair.players] == [0.0, 0.0]


# ----------------------------------------------------------------------------------------------------------- learning


def plain_update(rule, values, visits, told, last):
    """Update lists of values by lambda-returns, or one decision after the other by (B.2)."""
    count = len(told)
    following = [*(row for row, *_ in told[1:]), last]
    ahead = 0.0
    for k in range(count) if rule.one_step else reversed(range(count)):
        row, action, target, length = told[k]
        after = following[k]
        if after >= 0:
            worth = max(values[after])
            if not rule.one_step and k < count - 1:
                worth = (1.0 - rule.return_lambda) * worth + rule.return_lambda * ahead
            target += rule.gamma**length * worth
        ahead = target
        rate = max(rule.alpha_min, rule.alpha / (1.0 + visits[row][action] / rule.alpha_visits))
        values[row][action] += rate * (target - values[row][action])
        visits[row][action] += 1


@pytest.mark.parametrize("update", ["lambda-returns", "one-step"])
def test_a_plain_learner_that_is_told_the_decisions_learns_the_same(schooled, update):
    changes = [f"{who}.learning.update={update}" for who in ("passer", "shooter")]
    one, pair = ready(*changes, "pass_reward=2.0", schooled=schooled)
    values = [player.table.values.tolist() for player in pair.players]
    visits = [player.table.visits.tolist() for player in pair.players]
    rewards, ends = [], set()
    for n in range(40):
        found = one.run(pair, (9,), 1, first=n, total=40)
        ends.add(int(found.ends[0]))
        for robot, player in enumerate(pair.players):
            made, kept = int(player.decisions.made[0]), player.decisions
            columns = (kept.rows, kept.actions, kept.rewards, kept.lengths)
            told = list(zip(*(column[:made].tolist() for column in columns), strict=True))
            assert sum(length for *_, length in told) == found.steps[0]
            assert (kept.last[0] >= 0) == (found.ends[0] == GOING)
            rewards.append(sum(reward for _, _, reward, _ in told))
            expected = 2.0 * (robot == PASSER and found.passes[0] > 0) - 0.3 * (found.ends[0] == COLLISION)
            expected += robot == SHOOTER and found.ends[0] == SUCCESS
            assert rewards[-1] == pytest.approx(expected)
            plain_update(player.learner, values[robot], visits[robot], told, int(kept.last[0]))
            np.testing.assert_allclose(player.table.values, values[robot], rtol=1e-9, atol=1e-12)
            assert player.table.visits.tolist() == visits[robot]
    assert any(rewards)
    assert len(ends) > 1


def test_the_old_policy_is_followed_with_probability_1_minus_beta(schooled):
    changes = [
        f"passer.learning.{key}" for key in ("epsilon_start=0.0", "epsilon_end=0.0", "alpha=1e-9", "alpha_min=0")
    ]
    one, _ = ready(*changes, schooled=schooled)
    agent = one.agents[PASSER]
    old, new = np.zeros_like(agent.values), np.zeros_like(agent.values)
    old[:, 2], new[:, 5] = 1.0, 1.0
    agent.old, agent.values = (agent.models, old), new
    tables = [one.table(a, PERIODS["simultaneous"][0].duties[0]) for a in one.agents]
    pair = one.pair((LEARNING, STATIONARY), tables)
    assert [player.old for player in pair.players] == [1, -1]
    total = 101
    for trial in (0, 25, 50, 90, 100):
        actions = []
        for run in range(15):
            one.run(pair, (7, run), 1, first=trial, total=total)
            actions += pair.players[0].decisions.actions[: pair.players[0].decisions.made[0]].tolist()
        assert set(actions) <= {2, 5}
        renewed, beta = actions.count(5), trial / (total - 1)  # (trial - 1) / (N_all - 1), counted from 1
        assert stats.binomtest(renewed, len(actions), beta).pvalue > 1e-4
    assert renewed == len(actions)


def test_a_robot_with_a_fixed_policy_follows_it_but_for_its_share_of_random_actions(schooled):
    for share in (0.0, 0.5):
        one, _ = ready(f"fixed_epsilon={share}", schooled=schooled)
        values = np.zeros_like(one.agents[PASSER].values)
        values[:, 3] = 1.0
        one.agents[PASSER].values = values
        pair = one.pair((FIXED, STATIONARY), [player.table for player in ready(schooled=schooled)[1].players])
        actions = []
        for n in range(20):
            one.run(pair, (3,), 1, first=n)
            decisions = pair.players[0].decisions
            actions += decisions.actions[: decisions.made[0]].tolist()
        others = len(actions) - actions.count(3)
        assert stats.binomtest(others, len(actions), share * 6 / 7).pvalue > 1e-4


# -------------------------------------------------------------------------------------------------------------- starts


def test_in_a_share_of_the_trials_the_passer_starts_nearer_to_the_ball(schooled):
    found = {}
    for share in (0.0, 0.25, 1.0):
        changes = (f"starts.passer_nearer={share}", "time_limit_steps=1")
        one, pair = ready(*changes, roles=(FIXED, FIXED), schooled=schooled)
        found[share] = one.run(pair, (6,), 800)
        distances = np.hypot(*(pair.stage.state[:2, :2] - pair.stage.state[2, :2]).T)  # of the last start, a step later
        if abs(distances[0] - distances[1]) > 0.2:
            assert found[share].nearer[-1] == distances.argmin()
    anyway = (found[0.0].nearer == PASSER).mean()
    assert 0.0 < anyway < 0.3
    assert (found[1.0].nearer == PASSER).all()
    expected = 0.25 + 0.75 * anyway
    assert abs((found[0.25].nearer == PASSER).mean() - expected) < 0.07  # 4 standard deviations
    parts = [found[0.25].where_nearer(robot) for robot in (PASSER, SHOOTER)]
    assert sum(len(part.ends) for part in parts) == 800
    assert all((part.nearer == robot).all() for robot, part in enumerate(parts))


def test_easy_missions_of_the_shooter_do_not_wait_for_the_passer(schooled):
    changes = ("starts.passer_nearer=1.0", "time_limit_steps=1", "shooter.learning.easy_share=1.0")
    one, pair = ready(*changes, roles=(FIXED, LEARNING), schooled=schooled)
    easy = one.run(pair, (6,), 200, total=10_000)
    full = one.run(pair, (6,), 200, first=10_000, total=10_000)
    assert (easy.nearer == SHOOTER).any()
    assert (full.nearer == PASSER).all()


# ----------------------------------------------------------------------------------------------------------- elsewhere

SAME = TransferSettings(camera="analytic", latency_steps=0)


def test_the_other_world_is_the_compiled_one_if_it_is_the_same_world(schooled):
    found = []
    for elsewhere in (False, True):
        one, pair = ready(roles=(LEARNING, LEARNING), stores=(True, True), schooled=schooled)
        if elsewhere:
            seeds = game_seeds(one.seed, 5, count=6)
            outcomes = run_elsewhere(pair, one.settings, SAME, seeds, time_limit=150, first=0, total=6)
        else:
            outcomes = one.run(pair, (5,), 6, total=6)
        parts = [*outcomes]
        for agent, player in zip(one.agents, pair.players, strict=True):
            store = agent.store._replace(features=agent.store.features[agent.store.areas > 0.0])
            parts += [player.table.values, player.table.visits, *store]
        found.append([part.tobytes() for part in parts])
    assert found[0] == found[1]


def test_latency_shows_what_was_there_some_steps_ago(schooled):
    seen = []
    for latency in (0, 3):
        one, pair = ready(roles=(RANDOM, RANDOM), stores=(True, True), schooled=schooled)
        settings = msgspec.structs.replace(SAME, latency_steps=latency)
        run_elsewhere(pair, one.settings, settings, np.array([11], np.uint64), time_limit=60)
        rows = int(one.agents[SHOOTER].store.written[0])
        seen.append(one.agents[SHOOTER].store.areas[:rows])
    assert len(seen[0]) == len(seen[1]) > 20
    assert np.array_equal(seen[1][3:, :3], seen[0][:-3, :3])
    assert not np.array_equal(seen[1], seen[0])


def test_painted_images_are_enough_to_act_on(schooled):
    one, pair = ready(roles=(LEARNING, LEARNING), stores=(True, True), schooled=schooled)
    found = run_elsewhere(pair, one.settings, TransferSettings(), np.array([1, 2], np.uint64), time_limit=60)
    assert (found.steps > 0).all()
    assert min(stored_windows(one.agents[PASSER]).values()) > 0


# -------------------------------------------------------------------------------------------------------------- models


def test_a_model_of_what_is_hardly_seen_any_more_is_kept(schooled):
    one, pair = ready("store.least_windows=100", roles=(RANDOM, STATIONARY), stores=(True, False), schooled=schooled)
    agent = one.agents[PASSER]
    one.run(pair, (8,), 20)
    agent.store.areas[:, 3] = 0.0  # the shooter
    ball, mate = agent.models
    told = renew_models(agent, one.schedule, "C", "mixture")
    assert agent.models[1] is mate
    assert not np.array_equal(agent.models[0].memory_matrix, ball.memory_matrix)
    assert {row["object"]: row["kept"] for row in told}["mate"]
    assert agent.values is None
    assert agent.old is not None


def test_states_that_are_mapped_are_mapped_back_by_alignment(schooled):
    one, pair = ready(roles=(RANDOM, STATIONARY), stores=(True, False), schooled=schooled)
    one.run(pair, (8,), 20)
    agent = one.agents[PASSER]
    model = agent.models[0]
    random = np.random.default_rng(1)
    mapping, moved = random.normal(size=(3, 3)), random.normal(size=len(model.past_mean))
    mapped = dataclasses.replace(model, memory_matrix=mapping @ model.memory_matrix, past_mean=model.past_mean + moved)
    back = align(mapped, model, stored_stretches(agent.store, "ball"))
    np.testing.assert_allclose(back.memory_matrix, model.memory_matrix, rtol=1e-6, atol=1e-9)
    zero = model.memory_matrix @ (back.past_mean - model.past_mean)  # the state is the same of whatever past
    np.testing.assert_allclose(zero, 0.0, atol=1e-6)


def test_the_store_holds_the_latest_steps(schooled):
    one, pair = ready(roles=(RANDOM, RANDOM), stores=(True, False), schooled=schooled)
    found = one.run(pair, (4,), 60)
    store = one.agents[PASSER].store
    assert store.written[0] == found.steps.sum() > len(store.trial)
    assert one.agents[SHOOTER].store.written[0] == 0
    newest = (int(store.written[0]) - 1) % len(store.trial)
    assert store.trial[newest] == 59
    assert store.trial[(newest + 1) % len(store.trial)] == min(store.trial)
