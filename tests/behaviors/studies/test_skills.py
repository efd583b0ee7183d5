"""Skills over several seeds: medians, and differences seed by seed."""

from __future__ import annotations

import json

import numpy as np
from click.testing import CliRunner
from scipy import stats

from behaviors.studies.skills import seed_rows, skills


def cards(*shares):
    """Return cards of pass with these shares of success."""
    return [{"measured": {"in-view": {"success_rate": s, "collision_rate": 0.1 * s}}} for s in shares]


def test_rows_hold_the_median_and_every_seed():
    assert seed_rows("pass", cards(0.9, 0.5, 0.6))[0] == [
        *("pass", "in-view", "success_rate", "0.600"),
        *("0.900", "0.500", "0.600"),
    ]


def test_differences_are_taken_seed_by_seed():
    one, other = (0.9, 0.5, 0.6), (0.8, 0.1, 0.5)
    rows = seed_rows("pass", cards(*one), cards(*other))
    differences = np.subtract(one, other)
    low, high = stats.t.interval(0.95, 2, differences.mean(), stats.sem(differences))
    assert rows[1][2:] == ["success_rate: the other", "0.500", "0.800", "0.100", "0.500"]
    assert rows[2][3:] == [f"+0.200 [{low:+.3f}, {high:+.3f}]", "+0.100", "+0.400", "+0.100"]


def test_the_other_setting_is_all_that_differs():
    given = ["search", "--seeds", "2", "--games", "20", "--workers", "1", "--set", "trials=250"]
    result = CliRunner().invoke(skills, [*given, "--against", "learning.return_lambda=0.1", "--json", "--quiet"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.output)
    one, other = ["trials=250"], ["trials=250", "learning.return_lambda=0.1"]
    assert [card["settings"] for card in told] == [one, one, other, other]
    assert [card["learned_with"]["seed"] for card in told] == [1, 2, 1, 2]
    assert told[0]["digest"] != told[2]["digest"]
    assert told[0]["random_actions"] == told[2]["random_actions"]
