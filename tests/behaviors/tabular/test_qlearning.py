"""Q learning: values against their definitions, for made-up decisions and for those of trials that were played."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from behaviors.recipe import read_recipe
from behaviors.settings import LearningSettings
from behaviors.tabular.qlearning import lambda_returns, make_learner, one_step
from behaviors.tabular.table import all_states, make_table
from behaviors.trials.solo import solo_scene
from behaviors.trials.task import COLLISION, GOING, SUCCESS
from coevo.skill import load_skill
from coevo.skill.estimate import discrete_state
from coevo.stage import LEARNER

# ------------------------------------------------------------------------------------------------------- lambda-returns


def move(rule, values, visits, state, action, target):
    """Move a value towards its target, as the settings say."""
    rate = rule.alpha
    if rule.alpha_visits:
        rate = max(rule.alpha_min, rule.alpha / (1.0 + visits[state][action] / rule.alpha_visits))
    values[state][action] += rate * (target - values[state][action])
    visits[state][action] += 1


def worth(rule, steps):
    """Return what a reward after ``steps`` steps, one action, is worth now."""
    return rule.gamma if rule.discount_per == "action" else rule.gamma**steps


def slow_lambda_returns(rule, values, visits, decisions, last):
    """Update from the end back, each return as its sum over n-step returns.

    decisions: (state, action, reward, steps) of each. last: the state that time ran out in, -1 if the trial ended.
    """
    count, decay = len(decisions), rule.return_lambda
    bootstrap = [0.0] * count  # worth of the state after each decision, when that decision is updated

    def n_step(k, n):
        total, discount = 0.0, 1.0
        for _, _, reward, steps in decisions[k : k + n]:
            total += discount * reward
            discount *= worth(rule, steps)
        return total + discount * bootstrap[k + n - 1]

    for k in reversed(range(count)):
        after = last if k == count - 1 else decisions[k + 1][0]
        bootstrap[k] = max(values[after]) if after >= 0 else 0.0
        left = count - k  # decisions from this one to the end
        target = decay ** (left - 1) * n_step(k, left)
        target += (1.0 - decay) * sum(decay ** (n - 1) * n_step(k, n) for n in range(1, left))
        state, action, _, _ = decisions[k]
        move(rule, values, visits, state, action, target)


def slow_one_step(rule, values, visits, decisions, last):
    """Update as (B.2) is printed, one decision after the other."""
    following = [*(state for state, *_ in decisions[1:]), last]
    for (state, action, reward, steps), after in zip(decisions, following, strict=True):
        best = max(values[after]) if after >= 0 else 0.0
        move(rule, values, visits, state, action, reward + worth(rule, steps) * best)


def fast(rule, values, visits, decisions, last):
    """Update by the compiled functions."""
    states, actions, rewards, lengths = zip(*decisions, strict=True)
    if rule.update == "one-step":
        for decision, after in zip(decisions, [*states[1:], last], strict=True):
            one_step(make_learner(rule), values, visits, *decision, after)
        return
    columns = (np.array(states), np.array(actions), np.array(rewards, np.float64), np.array(lengths))
    none_fixed = np.zeros(len(values), np.bool_)
    lambda_returns(make_learner(rule), values, visits, none_fixed, *columns, len(decisions), last)


SLOW = {"lambda-returns": slow_lambda_returns, "one-step": slow_one_step}
STATES, ACTIONS = 5, 3
trials = st.lists(
    st.tuples(
        st.integers(0, STATES - 1),
        st.integers(0, ACTIONS - 1),
        st.sampled_from((0.0, 0.0, 1.0, -0.3)),
        st.integers(1, 30),
    ),
    min_size=1,
    max_size=12,
)


@settings(deadline=None)
@given(
    story=st.lists(st.tuples(trials, st.integers(-1, STATES - 1)), min_size=1, max_size=4),
    gamma=st.floats(0.5, 0.999),
    decay=st.sampled_from((0.0, 0.3, 0.9, 1.0)),
    update=st.sampled_from(("lambda-returns", "one-step")),
    per=st.sampled_from(("step", "action")),
    alpha_visits=st.sampled_from((0.0, 2.0)),
    seed=st.integers(0, 1000),
)
def test_values_are_those_of_the_definition(story, gamma, decay, update, per, alpha_visits, seed):
    rule = LearningSettings(
        update=update, discount_per=per, gamma=gamma, return_lambda=decay, alpha_visits=alpha_visits, alpha_min=0.05
    )
    values = np.random.default_rng(seed).normal(size=(STATES, ACTIONS))
    visits = np.zeros((STATES, ACTIONS), np.int64)
    expected, counted = values.tolist(), visits.tolist()
    for decisions, last in story:
        fast(rule, values, visits, decisions, last)
        SLOW[update](rule, expected, counted, decisions, last)
    np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-12)
    assert visits.tolist() == counted


def one_trial(decisions, last, *, decay, gamma=0.9, start=0.0):
    """Return the values after one trial with a learning rate of 1, all values ``start`` before."""
    values = np.full((STATES, ACTIONS), start)
    rule = LearningSettings(gamma=gamma, return_lambda=decay, alpha=1.0)
    fast(rule, values, np.zeros((STATES, ACTIONS), np.int64), decisions, last)
    return values


def test_with_lambda_1_a_return_is_the_discounted_sum_of_all_rewards():
    decisions = [(0, 0, 0.0, 5), (1, 1, -0.3, 2), (2, 2, 1.0, 7)]
    values = one_trial(decisions, -1, decay=1.0)
    assert values[2, 2] == pytest.approx(1.0)
    assert values[1, 1] == pytest.approx(-0.3 + 0.9**2)
    assert values[0, 0] == pytest.approx(0.9**5 * (-0.3 + 0.9**2))


def test_with_lambda_0_a_return_is_one_step_of_q_learning():
    decisions = [(0, 0, 0.0, 5), (1, 1, 0.2, 2)]
    values = one_trial(decisions, 3, decay=0.0, start=0.5)
    assert values[1, 1] == pytest.approx(0.2 + 0.9**2 * 0.5)
    # The next state's best value, which may be that of an action that was not taken.
    assert values[0, 0] == pytest.approx(0.9**5 * max(0.5, 0.2 + 0.9**2 * 0.5))


@pytest.mark.parametrize("decay", [0.0, 0.5, 1.0])
def test_time_running_out_is_no_end_but_an_end_is(decay):
    decisions = [(0, 0, 0.0, 10)]
    assert one_trial(decisions, 4, decay=decay, start=2.0)[0, 0] == pytest.approx(0.9**10 * 2.0)
    assert one_trial(decisions, -1, decay=decay, start=2.0)[0, 0] == 0.0


def test_the_learning_rate_falls_with_visits_to_its_least():
    rule = LearningSettings(alpha=0.4, alpha_visits=10.0, alpha_min=0.05)
    values, visits, expected = np.zeros((1, 1)), np.zeros((1, 1), np.int64), 0.0
    for visit in range(100):
        fast(rule, values, visits, [(0, 0, 1.0, 1)], -1)
        expected += max(0.05, 0.4 / (1.0 + visit / 10.0)) * (1.0 - expected)
        assert values[0, 0] == pytest.approx(expected)
    assert visits[0, 0] == 100


def test_a_constant_learning_rate_forgets_by_the_same_share_each_time():
    rule = LearningSettings(alpha=0.25, alpha_visits=0.0)
    values, visits = np.zeros((1, 1)), np.zeros((1, 1), np.int64)
    for _ in range(50):
        fast(rule, values, visits, [(0, 0, 1.0, 1)], -1)
    assert values[0, 0] == pytest.approx(1.0 - 0.75**50)


@pytest.mark.parametrize("per", ["step", "action"])
def test_gamma_is_for_a_step_or_for_an_action_however_long(per):
    rule = LearningSettings(update="one-step", discount_per=per, gamma=0.9, alpha=1.0)
    values, visits = np.zeros((STATES, ACTIONS)), np.zeros((STATES, ACTIONS), np.int64)
    values[1, 2] = 1.0
    fast(rule, values, visits, [(0, 0, 0.0, 30)], 1)
    assert values[0, 0] == pytest.approx(0.9**30 if per == "step" else 0.9)


def test_a_step_of_q_learning_moves_a_reward_back_by_one_decision_a_trial():
    rule = LearningSettings(update="one-step", discount_per="action", gamma=0.5, alpha=1.0, alpha_visits=0.0)
    values, visits = np.zeros((STATES, ACTIONS)), np.zeros((STATES, ACTIONS), np.int64)
    walk = [(state, 0, 1.0 if state == 3 else 0.0, 7) for state in range(4)]
    for trial in range(4):
        fast(rule, values, visits, walk, -1)
        known = [0.5 ** (3 - state) if state >= 3 - trial else 0.0 for state in range(4)]
        assert values[:4, 0].tolist() == known


# ---------------------------------------------------------------------------------------------- trials that were played


def played(task, rule, trials, *, sparse, epsilon=0.3, start=0.0):
    """Yield, trial by trial, the decisions that were made, the row where time ran out, how it ended, and the table.

    start: values before the first trial, for a table that is not sparse.
    """
    recipe = read_recipe(task)
    settings = msgspec.structs.replace(rule, epsilon_start=epsilon, epsilon_end=epsilon, easy_share=1.0)
    recipe = msgspec.structs.replace(recipe, learning=settings, time_limit_steps=80)
    skill = load_skill(task)
    table = make_table(*skill.values.shape, sparse=sparse)
    table.values[:] = start
    scene = solo_scene(recipe, skill, LEARNER, learner=make_learner(settings), table=table)
    for n in range(trials):
        scene.grow(0, 17)
        found = scene.run(np.array([n], np.uint64), first=n, total=trials)
        decisions, table = scene.trial.minds.decisions, scene.minds[0].table
        made, outcome, steps = int(decisions.made[0]), int(found.ends[0]), int(found.steps[0])
        columns = (decisions.rows, decisions.actions, decisions.rewards, decisions.lengths)
        told = list(zip(*(column[0, :made].tolist() for column in columns), strict=True))
        assert sum(length for *_, length in told) == steps
        stage, last = scene.venue.stage, -1
        if outcome == GOING:
            last = int(table.rows[discrete_state(stage.memory, stage.bank, 0, 0, steps)])
            assert last >= 0
        yield told, last, outcome, table


@pytest.mark.parametrize("task", ["search", "avoid", "shoot"])
@pytest.mark.parametrize(
    "rule",
    [
        LearningSettings(),
        LearningSettings(update="one-step", discount_per="action", gamma=0.9, alpha_visits=0.0),
        LearningSettings(update="one-step", alpha=0.5),
        LearningSettings(discount_per="action", gamma=0.9, alpha_visits=0.0),
    ],
    ids=["today", "literal", "one-step", "literal returns"],
)
def test_a_plain_learner_that_is_told_the_decisions_learns_the_same(task, rule):
    values, visits, ends = [[0.0] * 9 for _ in range(1000)], [[0] * 9 for _ in range(1000)], set()
    for told, last, outcome, table in played(task, rule, 60, sparse=True):
        SLOW[rule.update](rule, values, visits, told, last)
        ends.add(outcome)
        reward = {SUCCESS: 1.0, COLLISION: -0.3}.get(outcome, 0.0)
        assert [reward for *_, reward, _ in told] == [0.0] * (len(told) - 1) + [reward]
        used = int(table.used[0])
        np.testing.assert_allclose(table.values[:used], values[:used], rtol=1e-9, atol=1e-12)
        assert table.visits[:used].tolist() == visits[:used]
        assert sorted(table.rows[table.rows >= 0].tolist()) == list(range(used))  # in the order of first visits
    assert len(ends) > 1


def test_a_greedy_learner_chooses_by_what_it_learned_a_decision_ago():
    # One step at a time, a trial changes its own choices; with returns at the end it does not.
    rule = LearningSettings(update="one-step", discount_per="action", gamma=0.9, alpha=0.9, alpha_visits=0.0)
    start = np.random.default_rng(1).uniform(0.5, 1.0, load_skill("search").values.shape)
    values, visits, changed = start.tolist(), np.zeros(start.shape, np.int64).tolist(), 0
    for told, last, _, _ in played("search", rule, 60, sparse=False, epsilon=0.0, start=start):
        before = [list(row) for row in values]
        for k, decision in enumerate(told):
            row, action = decision[:2]
            assert values[row][action] == pytest.approx(max(values[row]), abs=1e-12)
            changed += before[row][action] < max(before[row]) - 1e-9
            after = told[k + 1][0] if k + 1 < len(told) else last
            slow_one_step(rule, values, visits, [decision], after)
    assert changed > 0


def test_rows_of_visited_states_learn_what_a_whole_table_learns():
    runs = [list(played("shoot", LearningSettings(), 80, sparse=sparse)) for sparse in (False, True)]
    dense, sparse = (run[-1][-1] for run in runs)
    used = int(sparse.used[0])
    assert 10 < used < len(dense.rows)
    states = np.flatnonzero(sparse.rows >= 0)
    assert np.array_equal(sparse.values[sparse.rows[states]], dense.values[states])
    assert np.array_equal(sparse.visits[sparse.rows[states]], dense.visits[states])
    assert not np.delete(dense.values, states, axis=0).any()
    assert all_states(sparse.values, sparse.rows).tobytes() == all_states(dense.values, dense.rows).tobytes()
