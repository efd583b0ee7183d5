import dataclasses
import json

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from analysis._dynamics import gain_of, interaction, largest_return, loss_of, noise_of, variogram_of
from analysis.calibration.diagnosis import confusion, diagnosis
from analysis.calibration.dynamics import SETS, cases
from analysis.progress import LABELS, MINIMUM_GENERATIONS, diagnose
from coevo.errors import InputError


def grid(n):
    return np.arange(n)[:, None], np.arange(n)[None, :]


def played(chances, games, seed=0):
    return np.random.default_rng(seed).binomial(games, chances) / games


def arms_race(n, slope=0.15):
    i, j = grid(n)
    return 1 / (1 + np.exp(-slope * (i - j)))


def clock(n, period, size=0.3):
    i, j = grid(n)
    return 0.5 + size * np.sin(2 * np.pi * (i - j) / period)


def memory(n, width):
    i, j = grid(n)
    return np.where((i >= j) & (i - j < width), 0.9, 0.2)


# ---------------------------------------------------------------------------------------------- how often it errs


@pytest.mark.slow
@pytest.mark.parametrize("kind", LABELS)
def test_matrices_it_was_not_tuned_on(kind):
    found = confusion("held-out", kind, 200, seed=3)
    assert found["alone"][0] >= 0.95, found


@pytest.mark.parametrize("kind", LABELS)
@pytest.mark.parametrize("which", SETS)
def test_a_few_of_each_kind(which, kind):
    found = confusion(which, kind, 12, seed=4)
    assert found["named"][0] >= 0.8, found


def test_cases_are_the_same_for_a_seed_and_others_for_another():
    one, again, other = ([wins for _, wins in cases("held-out", "progress", 4, seed=seed)] for seed in (1, 1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(one, again, strict=True))
    assert not any(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_command_counts_every_case():
    result = CliRunner().invoke(diagnosis, ["--cases", "3", "--json", "--quiet"])
    assert result.exit_code == 0, result.output
    kinds = json.loads(result.stdout)["kinds"]
    assert {(found["set"], found["kind"]) for found in kinds} == {(which, kind) for which in SETS for kind in LABELS}
    assert all(sum(found["labels"].values()) == found["cases"] == 3 for found in kinds)


# ---------------------------------------------------------------------------------------------- what each label is


def test_an_arms_race_is_progress_for_both_sides():
    wins = played(arms_race(40), 20)
    assert diagnose(wins).labels == {"progress"}
    assert diagnose(1 - wins.T).labels == {"progress"}


def test_a_steep_arms_race_is_engaged_along_its_diagonal():
    assert diagnose(arms_race(40, slope=10)).labels == {"progress"}


def test_order_of_opponents_does_not_make_progress():
    chances = np.clip(np.linspace(0.2, 0.7, 30)[:, None] + np.random.default_rng(1).normal(0, 0.1, 30), 0, 1)
    wins = played(chances, 20)
    assert diagnose(wins).labels == diagnose(wins[:, ::-1]).labels == {"progress"}


def test_time_turned_round_makes_progress_a_loss():
    wins = played(np.broadcast_to(np.linspace(0.2, 0.7, 30)[:, None], (30, 30)), 20)
    assert diagnose(wins[::-1]).labels == {"forgetting"}


def test_only_opponents_that_change_are_no_progress():
    wins = played(np.broadcast_to(np.linspace(0.3, 0.7, 30), (30, 30)), 20)
    assert diagnose(wins).labels == {"stagnation"}
    assert diagnose(wins.T).labels == {"progress"}


@pytest.mark.parametrize("period", [2.5, 3, 5, 8, 13, 20])
def test_cycles_and_their_period(period):
    found = diagnose(played(clock(40, period), 20))
    assert found.labels == {"cycling"}
    # The period or a multiple of it, to a generation.
    assert abs(found.period / period - round(found.period / period)) * period <= 1


def test_a_memory_of_the_last_generations_is_forgetting():
    wins = played(memory(40, 6), 20)
    assert diagnose(wins).labels == {"forgetting"}


def test_progress_with_later_forgetting_is_both():
    chances = arms_race(40, slope=0.2)
    chances[36:, :8] = 0.05
    assert diagnose(played(chances, 50)).labels == {"progress", "forgetting"}


@pytest.mark.parametrize("end", [0.0, 1.0])
@pytest.mark.parametrize("onset", [0, 12, 20])
def test_onset_of_disengagement(onset, end):
    chances = np.full((30, 30), 0.5)
    chances[onset:, onset:] = end
    found = diagnose(played(chances, 20))
    assert found.labels == {"disengagement"}
    assert found.onset == onset


def test_progress_before_disengagement_is_both():
    chances = arms_race(40)
    chances[28:, 28:] = 1.0
    found = diagnose(played(chances, 20))
    assert found.labels == {"progress", "disengagement"}
    assert 27 <= found.onset <= 29


@pytest.mark.parametrize("level", [0.08, 0.3, 0.5, 0.92])
def test_one_level_is_stagnation(level):
    assert diagnose(played(np.full((30, 30), level), 20)).labels == {"stagnation"}


def test_text_names_every_label_and_the_answer_is_frozen():
    for chances in (arms_race(30), clock(30, 6), memory(30, 5), np.ones((30, 30)), np.full((30, 30), 0.4)):
        found = diagnose(played(chances, 20))
        assert all(label in found.text.lower() for label in found.labels)
        assert found.text.endswith(".")
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.gain = 1.0


# -------------------------------------------------------------------------------------------------- what is measured


@pytest.mark.parametrize("chances", [np.full((60, 60), 0.4), clock(60, 7), arms_race(60)])
def test_noise_is_that_of_the_games_whatever_the_dynamics(chances):
    true = np.sqrt(np.mean(chances * (1 - chances)) / 25)
    assert noise_of(played(chances, 25), None) == pytest.approx(true, rel=0.15)


def test_noise_is_no_less_than_that_of_the_games_that_are_named():
    shares = played(np.full((8, 8), 0.5), 5)
    assert noise_of(shares, 5) >= np.sqrt(np.mean(shares * (1 - shares)) / 4)


def test_variogram_of_a_sine_is_one_less_a_cosine():
    changes = interaction(clock(48, 8))
    lags = np.arange(37)
    expected = 0.3**2 / 2 * (1 - np.cos(2 * np.pi * lags / 8))
    variogram = variogram_of(changes @ changes.T / 48)
    assert variogram == pytest.approx(expected, abs=1e-12)
    fall, period = largest_return(variogram, 48)
    assert fall == pytest.approx(0.3**2)
    assert period in {8, 16, 24}


def test_gain_is_that_of_a_straight_line():
    gain, _ = gain_of(np.linspace(0, 1, 41)[:-1], 0.01)
    # Means of the first and last quarter, or eighth, of 40 generations lie 30 and 35 steps of 1/40 apart.
    assert gain in (pytest.approx(30 / 40), pytest.approx(35 / 40))


def test_what_only_rises_has_no_loss():
    for chances in (arms_race(30), arms_race(30, slope=10), np.linspace(0, 1, 30)[:, None] + np.zeros(30)):
        assert loss_of(chances, 0.01, 0.01)[0] <= 1e-12


def test_loss_is_the_height_that_was_lost():
    time = np.arange(48)[:, None]
    chances = np.where(time < 30, 0.8, 0.3) + np.zeros(48)
    assert loss_of(chances, 0.01, 0.01)[0] == pytest.approx(0.5)


# ------------------------------------------------------------------------------------------------------------ input


@given(st.integers(MINIMUM_GENERATIONS, 14).flatmap(lambda n: arrays(np.float64, (n, n), elements=st.floats(0, 1))))
def test_any_shares_get_an_answer_and_the_same_one_again(wins):
    before = wins.copy()
    found = diagnose(wins)
    assert found.labels
    assert found.labels <= set(LABELS)
    assert ("stagnation" not in found.labels) or len(found.labels) == 1
    assert diagnose(wins.tolist()) == found
    assert np.array_equal(wins, before)


@pytest.mark.parametrize(
    ("wins", "word"),
    [
        (np.full((8, 9), 0.5), "shape"),
        (np.full(8, 0.5), "shape"),
        (np.full((MINIMUM_GENERATIONS - 1,) * 2, 0.5), "at least"),
        (np.full((8, 8), np.nan), "finite"),
        (np.full((8, 8), 20.0), "0..1"),
        (np.full((8, 8), -0.1), "0..1"),
        ([["a"] * 8] * 8, "numbers"),
        ([[0.5, 0.5], [0.5]], "numbers"),
    ],
)
def test_other_input_is_refused_in_words(wins, word):
    with pytest.raises(InputError, match=word):
        diagnose(wins)


def test_games_must_be_some():
    with pytest.raises(InputError, match="at least 1"):
        diagnose(np.full((8, 8), 0.5), games=0)
