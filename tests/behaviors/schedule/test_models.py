"""Models of the two robots: what they are made of, when they are renewed, and what they are said to predict."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from behaviors.experience import align
from behaviors.schedule.models import (
    error_trace,
    exchange,
    prediction_errors,
    renew_models,
    residuals,
    stored_by,
)
from behaviors.trials.minds import make_store
from behaviors.trials.task import PASSER, SHOOTER
from coevo.stage import RANDOM, STANDING

BALL, SHOWN, Y = 0, 4, 1


def test_a_model_of_what_is_hardly_seen_any_more_is_kept(pair):
    one = pair("store.least_windows=100", roles=(RANDOM, STANDING), stores=(True, False))
    agent = one.agents[PASSER]
    one.run((8,), 20)
    agent.store.areas[:, 3] = 0.0  # the shooter
    ball, mate = agent.models
    told = renew_models(agent, one.schedule, "C", "mixture")
    assert agent.models[1] is mate
    assert not np.array_equal(agent.models[0].memory_matrix, ball.memory_matrix)
    assert {row["object"]: row["kept"] for row in told}["mate"]
    assert agent.values is None
    assert agent.old is not None


def test_states_that_are_mapped_are_mapped_back_by_alignment(pair):
    one = pair(roles=(RANDOM, STANDING), stores=(True, False))
    one.run((8,), 20)
    agent = one.agents[PASSER]
    model = agent.models[0]
    random = np.random.default_rng(1)
    mapping, moved = random.normal(size=(3, 3)), random.normal(size=len(model.past_mean))
    mapped = dataclasses.replace(model, memory_matrix=mapping @ model.memory_matrix, past_mean=model.past_mean + moved)
    back = align(mapped, model, stored_by(agent, "ball"))
    np.testing.assert_allclose(back.memory_matrix, model.memory_matrix, rtol=1e-6, atol=1e-9)
    zero = model.memory_matrix @ (back.past_mean - model.past_mean)  # the state is the same of whatever past
    np.testing.assert_allclose(zero, 0.0, atol=1e-6)


def test_the_store_holds_the_latest_steps(pair):
    one = pair(roles=(RANDOM, RANDOM), stores=(True, False))
    found = one.run((4,), 60)
    store = one.agents[PASSER].store
    assert store.written[0] == found.steps.sum() > len(store.trial)
    assert one.agents[SHOOTER].store.written[0] == 0
    newest = (int(store.written[0]) - 1) % len(store.trial)
    assert store.trial[newest] == 59
    assert store.trial[(newest + 1) % len(store.trial)] == min(store.trial)


# --------------------------------------------------------------------------------------------------- what they predict


class Predictor:
    """Stands for a model whose error is known: ``error`` times the number of the step in its stretch."""

    def __init__(self, error) -> None:
        self.error = error

    def predict(self, actions, seen):
        assert len(actions) == len(seen)
        told = np.array(seen)
        told[:, Y] -= self.error * np.arange(len(seen))
        told[0] = np.nan  # of the first step there is no past
        return told


LENGTHS = (5, 9, 4)  # steps in view in trials 0, 1 and 2


@pytest.fixture
def watching(schooled):
    """Return two robots that saw a ball in three trials, and models of it whose errors are known."""
    agents = []
    for agent, errors in zip(schooled, ({"used": 0.5, "chosen": 2.0}, {"used": 4.0}), strict=True):
        store, steps = make_store(100, 5), sum(LENGTHS)
        store.written[0] = steps
        store.trial[:steps] = np.repeat(range(len(LENGTHS)), LENGTHS)
        store.areas[:steps, BALL] = 50.0
        store.features[:steps, BALL, :SHOWN] = np.random.default_rng(agent.number).uniform(1.0, 60.0, (steps, SHOWN))
        known = {orders: {"ball": Predictor(error)} for orders, error in errors.items()}
        parts = {"predictors": known["used"], "chosen": known.get("chosen", {})}
        agents.append(dataclasses.replace(agent, store=store, **parts))
    return tuple(agents)


# Of each stretch all steps but the first: 1, 2, ... times the error of the model.
ROWS = np.concatenate([np.arange(1, length) for length in LENGTHS])


def heights_of(agent):
    starts = np.cumsum([0, *LENGTHS[:-1]])
    return np.delete(agent.store.features[: sum(LENGTHS), BALL, Y], starts)


def test_residuals_are_what_was_seen_less_what_was_predicted(watching):
    for agent, error in zip(watching, (0.5, 4.0), strict=True):
        found = residuals(agent.predictors["ball"], stored_by(agent, "ball"))
        np.testing.assert_allclose(found[:, 0], error * ROWS)
        np.testing.assert_allclose(found[:, 1], heights_of(agent))


def test_prediction_errors_are_their_root_mean_square_and_its_share_of_the_spread(watching):
    for agent, errors in zip(watching, ({"used": 0.5, "chosen": 2.0}, {"used": 4.0}), strict=True):
        told = prediction_errors(agent, "here")
        assert [row["orders"] for row in told] == list(errors)
        for row, error in zip(told, errors.values(), strict=True):
            rms = error * np.sqrt(np.mean(ROWS**2.0))
            about = (row["where"], row["robot"], row["object"], row["windows"])
            assert about == ("here", agent.name, "ball", len(ROWS))
            assert row["rms_px"] == pytest.approx(rms)
            assert row["relative"] == pytest.approx(rms / np.std(heights_of(agent)))


def test_exchanged_models_are_as_many_times_worse_as_their_errors_are_larger(watching):
    told = exchange(watching, "there")
    assert [(row["where"], row["robot"], row["object"]) for row in told] == [
        ("there", "passer", "ball"),
        ("there", "shooter", "ball"),
    ]
    assert [row["error_ratio"] for row in told] == pytest.approx([4.0 / 0.5, 0.5 / 4.0])


def test_what_only_one_robot_has_a_model_of_is_not_exchanged(watching):
    passer, shooter = watching
    passer.predictors["mate"] = Predictor(1.0)
    assert {row["object"] for row in exchange((passer, shooter), "there")} == {"ball"}


def test_a_trace_is_of_the_trial_with_the_object_longest_in_view(watching):
    told = error_trace(watching[PASSER])
    assert [(row["object"], row["step"]) for row in told] == [("ball", step + 1) for step in range(1, 9)]
    assert [row["error_px"] for row in told] == pytest.approx([0.5 * step for step in range(1, 9)])
