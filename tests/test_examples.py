"""The examples in docstrings hold, and what people call from Python has one."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from functools import cache

import pytest

import analysis
import behaviors
import coevo

# What the README, the how-tos and other programs call.
PUBLIC = (
    "analysis.ancestry.inheritance.ancestors",
    "analysis.baselines.trees.behaviour",
    "analysis.baselines.trees.small_trees",
    "analysis.chapter4.worlds",
    "analysis.chapter4_compared.of_medians",
    "analysis.curves.summary",
    "analysis.curves.table",
    "coevo.measures.distinct_trees",
    "coevo.measures.evenness",
    "coevo.measures.repeatability",
    "analysis.games.play",
    "analysis.groups.run_names",
    "analysis.progress.diagnose",
    "analysis.tournament.play.chosen_generations",
    "analysis.written.mean_words",
    "behaviors.actor_critic.discounts.discount_powers",
    "behaviors.actor_critic.ties.ties_drawn",
    "behaviors.coordination.isodata.isodata",
    "behaviors.learning.learn",
    "behaviors.lpm.model.identify",
    "behaviors.measuring.evaluate",
    "behaviors.recipe.of_seed",
    "behaviors.recipe.read_recipe",
    "behaviors.reward.discount_matrix",
    "behaviors.tabular.growing.origins",
    "behaviors.team.recipe.read_team",
    "coevo.complexity.Controller",
    "coevo.complexity.value_change",
    "coevo.complexity.values_at",
    "coevo.config.effect.without_effect",
    "coevo.config.reader.assign",
    "coevo.config.reader.check",
    "coevo.config.reader.override",
    "coevo.config.reader.to_toml",
    "coevo.evolution.loop.evolve",
    "coevo.fitness.Scorer",
    "coevo.fitness.fixed",
    "coevo.fitness.varying",
    "coevo.game.make.make_game",
    "coevo.game.soccer.SoccerGame",
    "coevo.recipes.read_experiment",
    "coevo.recipes.read_settings",
    "coevo.recipes.recipe_names",
    "coevo.run.open_run",
    "coevo.seal.seal",
    "coevo.seeds.game_seeds",
    "coevo.seeds.global_random",
    "coevo.settlement.taken_over",
    "coevo.skill.model.installed_skills",
    "coevo.skill.model.load_skill",
    "coevo.skill.model.read_card",
    "coevo.skill.model.skill_description",
    "coevo.soccer.drive.action_set",
    "coevo.statistics.bootstrap_interval",
    "coevo.statistics.estimate",
    "coevo.statistics.mean_interval",
    "coevo.statistics.median_interval",
    "coevo.statistics.paired_difference",
    "coevo.statistics.probability_of_improvement",
    "coevo.statistics.share_interval",
    "coevo.study.plan.read_plan",
    "coevo.tree.draw.as_text",
    "coevo.tree.fold.fold_tree",
    "coevo.tree.functions.FunctionSet",
    "coevo.tree.program.compile_program",
    "coevo.tree.rules.in_words",
    "coevo.tree.rules.leaf_rules",
    "coevo.tree.simplify.simplify",
    "coevo.tree.text.parse",
)
SLOW = {"behaviors.learning.learn", "behaviors.measuring.evaluate"}  # they compile trials
FINDER = doctest.DocTestFinder(exclude_empty=True)


@cache
def examples():
    """Return the examples of all modules by the name of what they belong to."""
    found = {}
    for package in (analysis, behaviors, coevo):
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if info.name.rpartition(".")[2] != "__main__":
                tests = FINDER.find(importlib.import_module(info.name))
                found |= {test.name: test for test in tests if test.examples}
    return found


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in PUBLIC])
def test_an_example_holds(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = []
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS | doctest.REPORT_NDIFF)
    runner.run(examples()[name], out=said.append)
    assert not said, "".join(said)


def test_every_example_is_run():
    assert set(examples()) == set(PUBLIC)
