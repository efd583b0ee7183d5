"""Critic and actor: closed forms of small Markov chains, optimal policies, and a textbook's steps."""

from __future__ import annotations

import numpy as np
import pytest

from behaviors.actor_critic.discounts import discount_powers
from behaviors.actor_critic.updates import Outlook, learn_backwards
from behaviors.settings import LearningSettings
from behaviors.tabular.decisions import Decisions
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table

TURN = np.array([[0.6, -0.5, 0.0], [0.5, 0.6, 0.0], [0.1, 0.0, 0.7]])  # eigenvalues 0.6 +- 0.5i, 0.7
GAMMAS = {
    "diagonal": np.diag([0.3, 0.9, 0.6]),
    "full": np.array([[0.5, 0.2, 0.0], [0.1, 0.6, 0.1], [0.0, 0.3, 0.4]]),
    "complex": TURN,
}
FIXED_RATES = {"alpha_visits": 0.0, "epsilon_start": 0.0, "epsilon_end": 0.0}


def learner_of(**settings):  # noqa: ANN003 - settings of learning
    return make_learner(LearningSettings(method="actor-critic", **settings))


def one(*numbers):
    return [np.array([number]) for number in numbers]


def outlook_of(earned, gamma, share=1.0, most=1):
    channels = len(gamma)
    powers = discount_powers(gamma, share, most)
    none = np.zeros(1, np.bool_)
    earned, credits_of = np.array(earned, float), np.zeros((channels, 1))
    return Outlook(credits_of, none, none, earned, powers, np.zeros(channels), np.zeros((2, channels)))


def made(rows, actions, lengths):
    return Decisions(rows, actions, np.zeros(len(rows)), lengths, np.array([len(rows)]))


def closed_form(gamma, chain, rewards, terms=400):
    """Return v = sum of Gamma^n P^n r, (states, channels), term by term."""
    found, ahead, power = np.zeros_like(rewards), np.eye(len(chain)), np.eye(len(gamma))
    for _ in range(terms):
        found += (ahead @ rewards) @ power.T
        ahead, power = ahead @ chain, gamma @ power
    return found


@pytest.mark.parametrize("kind", GAMMAS)
def test_the_closed_form_is_where_the_critic_stays(kind):
    """By the mean error over what may follow, weighted with its probability: zero in every state."""
    rng, gamma = np.random.default_rng(1), GAMMAS[kind]
    chain, rewards = rng.dirichlet(np.ones(5), 5), rng.normal(size=(5, 3))
    value = closed_form(gamma, chain, rewards)
    learner = learner_of(alpha=1e-3, **FIXED_RATES)
    for state in range(5):
        moved = np.zeros(3)
        for following in range(5):
            table = make_table(5, 1, channels=3)
            table.critic[:] = value
            learn_backwards(learner, table, outlook_of([rewards[state]], gamma), made(*one(state, 0, 1)), 0, following)
            moved += chain[state, following] * (table.critic[state] - value[state]) / 1e-3
        assert moved == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize("kind", GAMMAS)
@pytest.mark.parametrize("decay", [0.0, 0.7, 1.0])
def test_the_critic_converges_to_the_closed_form(kind, decay):
    """On a chain that is certain, so that it does to the last digit: five states in a circle, trials that are cut."""
    gamma, circle = GAMMAS[kind], np.roll(np.eye(5), 1, axis=1)
    rewards = np.random.default_rng(2).normal(size=(5, 3))
    learner, table = learner_of(alpha=0.5, return_lambda=decay, **FIXED_RATES), make_table(5, 1, channels=3)
    rows, ones = np.arange(7) % 5, np.ones(7, np.int64)
    for _ in range(300):
        outlook = outlook_of(rewards[rows], gamma)
        learn_backwards(learner, table, outlook, made(rows, ones * 0, ones), 0, 2)
    assert table.critic == pytest.approx(closed_form(gamma, circle, rewards), abs=1e-6)


@pytest.mark.parametrize("kind", GAMMAS)
def test_powers_of_parts_make_up_the_whole(kind):
    powers = discount_powers(GAMMAS[kind], 0.1, 25)
    assert powers[0] == pytest.approx(np.eye(3))
    assert powers[3] @ powers[7] == pytest.approx(GAMMAS[kind])
    assert powers[25] @ powers[25] == pytest.approx(np.linalg.matrix_power(GAMMAS[kind], 5))
    assert discount_powers(GAMMAS[kind], 1.0, 3)[3] == pytest.approx(np.linalg.matrix_power(GAMMAS[kind], 3))


def textbook(learner, gamma_of, decisions, last, channels, states, actions):
    """Return critic, actor and visits after one trial, from the definitions, with dictionaries and numpy."""
    v, p = np.zeros((states, channels)), np.zeros((states, actions, channels))
    visits = np.zeros((states, actions), int)

    def rate(start, count):
        return start if not learner.alpha_visits else max(learner.alpha_min, start / (1 + count / learner.alpha_visits))

    def take_in(state, action, target):
        advantage = target - v[state]
        v[state] += rate(learner.alpha, visits[state].sum()) * advantage
        step = advantage if learner.literal else advantage - p[state, action]
        p[state, action] += rate(learner.beta, visits[state, action]) * step
        visits[state, action] += 1

    places = [*(state for state, *_ in decisions[1:]), last]
    if learner.one_step:
        for (state, action, reward, length), following in zip(decisions, places, strict=True):
            ahead = v[following] if following >= 0 else np.zeros(channels)
            take_in(state, action, reward + gamma_of(length) @ ahead)
        return v, p, visits
    returned = None
    for (state, action, reward, length), following in reversed(list(zip(decisions, places, strict=True))):
        ahead = v[following].copy() if following >= 0 else np.zeros(channels)
        if returned is not None:
            ahead = (1 - learner.return_lambda) * ahead + learner.return_lambda * returned
        returned = reward + gamma_of(length) @ ahead
        take_in(state, action, returned)
    return v, p, visits


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("actor", ["advantage", "literal"])
@pytest.mark.parametrize("update", ["one-step", "lambda-returns"])
def test_every_step_is_that_of_a_textbook(channels, actor, update):
    rng = np.random.default_rng(channels)
    gamma = np.array([[0.9]]) if channels == 1 else TURN
    for trial in range(60):
        visits = 0.0 if trial % 2 else 3.0
        learner = learner_of(actor=actor, update=update, alpha=0.3, beta=0.2, alpha_visits=visits)
        count, last = int(rng.integers(1, 9)), int(rng.choice([-1, 3]))
        rows, actions, lengths = (rng.integers(0, most, count) for most in (4, 3, 6))
        earned = rng.normal(size=(count, channels))
        outlook = outlook_of(earned, gamma, share=0.1, most=5)
        table = make_table(4, 3, channels=channels)
        if update == "one-step":
            for k in range(count):
                following = int(rows[k + 1]) if k + 1 < count else last
                learn_backwards(learner, table, outlook, made(rows[: k + 1], actions, lengths), k, following)
        else:
            learn_backwards(learner, table, outlook, made(rows, actions, lengths), 0, last)
        decisions = list(zip(rows, actions, earned, lengths, strict=True))
        v, p, visited = textbook(learner, lambda length: outlook.discounts[length], decisions, last, channels, 4, 3)  # noqa: B023 - used at once
        assert table.critic == pytest.approx(v)
        assert table.actor == pytest.approx(p)
        assert np.array_equal(table.visits, visited)
        if channels == 1:  # whose preferences are the order of choice
            for state in set(rows.tolist()):
                assert table.actor[state, table.values[state].argmax(), 0] == table.actor[state].max()


@pytest.mark.parametrize("actor", ["advantage", "literal"])
@pytest.mark.parametrize("channel", [0, 1])
def test_each_channel_alone_reaches_its_optimal_policy(channel, actor):
    """In a corridor with a prize of its own for each channel at its ends, and a shorter way by a door in the middle."""
    rng, places = np.random.default_rng(3), 7
    gamma, prize = np.array([[(0.9, 0.6)[channel]]]), (places - 1, 0)[channel]
    learner = learner_of(actor=actor, alpha=0.2, beta=0.2, alpha_visits=50.0)

    def go(place, action):
        if action == 2:  # the door
            return places - 1 - place if place in (1, places - 2) else place
        return min(max(place + (1, -1)[action], 0), places - 1)

    table = make_table(places, 3, channels=1)
    for _ in range(1500):
        place, walk = int(rng.integers(1, places - 1)), []
        while place not in (0, places - 1) and len(walk) < 40:
            values = table.values[place]
            greedy = rng.choice(np.flatnonzero(values == values.max()))
            action = int(rng.integers(3)) if rng.random() < 0.3 else int(greedy)
            following = go(place, action)
            walk.append((place, action, [float(following == prize)]))
            place = following
        rows, actions, earned = (np.array(column) for column in zip(*walk, strict=True))
        last = -1 if place in (0, places - 1) else place
        ones = np.ones(len(rows), np.int64)
        learn_backwards(learner, table, outlook_of(earned, gamma), made(rows, actions, ones), 0, last)
    value = np.zeros(places)
    for _ in range(100):  # value iteration; the ends are ends
        next_of = [[go(s, a) for a in range(3)] for s in range(places)]
        worth = np.array([[s == prize or gamma[0, 0] * value[s] for s in row] for row in next_of], float)
        value[1:-1] = worth.max(axis=1)[1:-1]
    best = [set(np.flatnonzero(np.isclose(row, row.max())).tolist()) for row in worth[1:-1]]
    assert all(int(table.values[s].argmax()) in best[s - 1] for s in range(1, places - 1))
