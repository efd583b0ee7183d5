"""Learned policies with random actions, and the study of them."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
from click.testing import CliRunner

from behaviors.learning import evaluate
from behaviors.recipe import read_recipe
from behaviors.studies.greedy import greedy as command
from coevo.skill import load_skill


def test_with_random_actions_only_the_table_does_not_matter():
    recipe, skill = read_recipe("shoot"), load_skill("shoot")
    other = dataclasses.replace(skill, values=-skill.values)
    mine, others = (evaluate(recipe, one, games=60, seed=7, epsilon=1.0) for one in (skill, other))
    assert np.array_equal(mine.outcomes, others.outcomes)
    assert np.array_equal(mine.steps, others.steps)
    greedy = [evaluate(recipe, one, games=60, seed=7) for one in (skill, other)]
    assert greedy[0].success_rate > 0.8 > greedy[1].success_rate
    assert mine.success_rate < 0.2


def test_random_actions_come_in_the_share_that_is_asked_for():
    recipe, skill = read_recipe("shoot"), load_skill("shoot")
    success = [evaluate(recipe, skill, games=300, seed=7, epsilon=share).success_rate for share in (0.0, 0.3, 0.9)]
    assert success[0] > success[1] > success[2]


def test_the_study_measures_both_recipes_with_each_share(tmp_path):
    path = tmp_path / "found.json"
    options = ["--seeds", "2", "--trials", "30", "--games", "20", "--workers", "1", "--out", str(path)]
    result = CliRunner().invoke(command, options)
    assert result.exit_code == 0, result.output
    found = json.loads(path.read_text())
    assert [(one["recipe"], one["epsilon"]) for one in found] == [
        (name, share) for name in ("literal-shoot", "shoot") for share in (0.0, 0.1, 0.2)
    ]
    for one in found:
        assert len(one["success"]) == len(one["timed_out"]) == 2
        shares = np.array([one["success"], one["timed_out"]])
        assert (shares >= 0.0).all()
        assert (shares.sum(axis=0) <= 1.0).all()
