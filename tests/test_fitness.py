"""Fitness (6.1) and (6.3) against fractions worked by hand and the constants of Table 6.2."""

from __future__ import annotations

import inspect
from fractions import Fraction

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.config import EvaluationSettings, EvolutionSettings, FitnessSettings, GPSettings
from coevo.fitness import Scorer, fixed, varying

COUNTS = ("goals", "lost", "kicks", "collisions", "steps")
WEIGHTS = ("alpha_g", "alpha_l", "alpha_k", "alpha_c", "alpha_s", "beta")
# Table 6.2.
FIXED = dict(zip(WEIGHTS, map(Fraction, ("1", "1/2", "1/1000", "5/1000", "1/10000", "4000")), strict=True))
VARYING = dict(zip(WEIGHTS, map(Fraction, ("1", "1", "1/100", "1/100", "1/100", "4000")), strict=True))

counts = st.fixed_dictionaries(
    {
        "goals": st.integers(0, 25),
        "lost": st.integers(0, 25),
        "kicks": st.integers(0, 6000),
        "collisions": st.integers(0, 500),
        "steps": st.integers(0, 40_000),
    }
)


def exactly(weights, happened, t_max=20):
    """Return (6.1), with h of (6.2), in exact fractions."""
    return (
        weights["alpha_g"] * max(0, t_max - happened["goals"])
        + weights["alpha_l"] * happened["lost"]
        + weights["alpha_k"] * max(0, weights["beta"] - happened["kicks"])
        + weights["alpha_c"] * happened["collisions"]
        + weights["alpha_s"] * happened["steps"]
    )


def exactly_varying(happened, generation, generations, t_max=20):
    """Return (6.3) in exact fractions."""
    past = Fraction(generation, generations)
    changed = {
        "alpha_k": (1 - past) * VARYING["alpha_k"],
        "alpha_c": past * VARYING["alpha_c"],
        "alpha_s": past * VARYING["alpha_s"],
    }
    return exactly({**VARYING, **changed}, happened, t_max)


# ----------------------------------------------------------------------------------------------- worked examples


def test_fixed_by_hand():
    # 8 goals missing, 3 lost, 2500 kicks missing, 40 collisions, 15000 steps: 8 + 1.5 + 2.5 + 0.2 + 1.5
    assert fixed(12, 3, 1500, 40, 15_000) == pytest.approx(13.7, rel=1e-14)


def test_varying_by_hand():
    # a quarter has passed: 8 + 3 + 3/4 of 25 + 1/4 of 0.4 + 1/4 of 150
    assert varying(12, 3, 1500, 40, 15_000, generation=15, generations=60) == pytest.approx(67.35, rel=1e-14)


def test_what_is_more_than_enough_counts_for_nothing():
    assert fixed(20, 0, 4000, 0, 0) == 0.0
    assert fixed(21, 0, 5000, 0, 0) == 0.0


def test_nothing_done_at_all_in_twenty_games_of_a_thousand_steps():
    # What the terms can weigh at most: 20 goals, 4 of kicks, 2 of steps; and while it varies 40 of kicks, 200 of steps
    assert fixed(0, 0, 0, 0, 20_000) == pytest.approx(26.0, rel=1e-14)
    assert varying(0, 0, 0, 0, 20_000, generation=0, generations=60) == pytest.approx(60.0, rel=1e-14)
    assert varying(0, 0, 0, 0, 20_000, generation=60, generations=60) == pytest.approx(220.0, rel=1e-14)


@given(happened=counts)
def test_fixed_is_6_1(happened):
    assert float(fixed(**happened)) == pytest.approx(float(exactly(FIXED, happened)), rel=1e-12, abs=1e-12)


@given(happened=counts, generations=st.integers(1, 200), data=st.data())
def test_varying_is_6_3(happened, generations, data):
    generation = data.draw(st.integers(0, generations))
    expected = exactly_varying(happened, generation, generations)
    got = varying(**happened, generation=generation, generations=generations)
    assert float(got) == pytest.approx(float(expected), rel=1e-12, abs=1e-9)


@given(happened=counts, data=st.data())
def test_any_weights(happened, data):
    share = st.fractions(0, 10, max_denominator=1000)
    weights = {name: data.draw(share, name) for name in WEIGHTS} | {"beta": data.draw(st.fractions(0, 9000))}
    t_max = data.draw(st.integers(1, 100))
    numbers = {name: float(value) for name, value in weights.items()}
    got = fixed(**happened, **numbers, t_max=float(t_max))
    assert float(got) == pytest.approx(float(exactly(weights, happened, t_max)), rel=1e-12, abs=1e-9)


# -------------------------------------------------------------------------------------------------- the two ends


@given(happened=counts, collisions=st.integers(0, 500), steps=st.integers(0, 40_000))
def test_at_the_start_collisions_and_time_do_not_count(happened, collisions, steps):
    other = {**happened, "collisions": collisions, "steps": steps}
    now = {"generation": 0, "generations": 60}
    assert varying(**happened, **now) == varying(**other, **now)


@given(happened=counts, kicks=st.integers(0, 6000))
def test_at_the_end_kicks_do_not_count(happened, kicks):
    now = {"generation": 60, "generations": 60}
    assert varying(**happened, **now) == varying(**{**happened, "kicks": kicks}, **now)


@given(happened=counts)
def test_the_start_and_the_end_are_fixed_functions(happened):
    start = fixed(**happened, alpha_l=1.0, alpha_k=0.01, alpha_c=0.0, alpha_s=0.0)
    end = fixed(**happened, alpha_l=1.0, alpha_k=0.0, alpha_c=0.01, alpha_s=0.01)
    assert varying(**happened, generation=0, generations=7) == start
    assert varying(**happened, generation=7, generations=7) == end


# ---------------------------------------------------------------------------------------------------- properties


@given(happened=counts, name=st.sampled_from(COUNTS), more=st.integers(1, 1000), generation=st.integers(0, 60))
def test_more_of_the_good_is_never_worse_and_more_of_the_bad_never_better(happened, name, more, generation):
    changed = {**happened, name: happened[name] + more}
    for function in (fixed, lambda **what: varying(**what, generation=generation, generations=60)):
        before, after = float(function(**happened)), float(function(**changed))
        if name in ("goals", "kicks"):
            assert after <= before + 1e-9
        else:
            assert after >= before - 1e-9


@given(several=st.lists(counts, min_size=1, max_size=6))
def test_arrays_give_what_numbers_give(several):
    arrays = [np.array([happened[name] for happened in several], np.int64) for name in COUNTS]
    now = {"generation": 3, "generations": 10}
    together, varied = fixed(*arrays), varying(*arrays, **now)
    assert together.shape == varied.shape == (len(several),)
    assert together.dtype == varied.dtype == np.float64
    assert together.tolist() == [float(fixed(**happened)) for happened in several]
    assert varied.tolist() == [float(varying(**happened, **now)) for happened in several]


# ------------------------------------------------------------------------------------- signatures and settings


@pytest.mark.parametrize("function", [fixed, varying])
def test_counts_come_first_and_weights_by_name(function):
    parameters = inspect.signature(function).parameters
    assert tuple(parameters)[:5] == COUNTS
    by_name = {name for name, parameter in parameters.items() if parameter.kind is parameter.KEYWORD_ONLY}
    assert by_name >= {*WEIGHTS, "t_max"}
    assert by_name - {*WEIGHTS, "t_max"} == ({"generation", "generations"} if function is varying else set())


@pytest.mark.parametrize(("kind", "table"), [("fixed", FIXED), ("varying", VARYING)])
def test_settings_and_defaults_are_the_constants_of_table_6_2(kind, table):
    chosen = msgspec.structs.asdict(getattr(FitnessSettings(), kind))
    assert chosen == {name: float(value) for name, value in table.items()}
    parameters = inspect.signature({"fixed": fixed, "varying": varying}[kind]).parameters
    assert {name: parameters[name].default for name in WEIGHTS} == chosen
    assert parameters["t_max"].default == 20.0


@given(happened=counts, games=st.integers(1, 50), generation=st.integers(0, 60))
def test_score_is_what_the_settings_ask_for(happened, games, generation):
    arrays = {name: np.array([value]) for name, value in happened.items()}
    settings = EvolutionSettings(gp=GPSettings(generations=60), evaluation=EvaluationSettings(games=games))
    (one,), (other,) = (
        Scorer(msgspec.structs.replace(settings, fitness=FitnessSettings(kind=kind)), COUNTS)(arrays, generation)
        for kind in ("fixed", "varying")
    )
    assert one == pytest.approx(float(exactly(FIXED, happened, games)), rel=1e-12, abs=1e-12)
    assert other == pytest.approx(float(exactly_varying(happened, generation, 60, games)), rel=1e-12, abs=1e-9)
