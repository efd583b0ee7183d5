"""Settings that are said to change nothing change nothing, and change something where they are not."""

from __future__ import annotations

import pytest

from coevo.config import without_effect
from coevo.evolution.opponents import with_opponents
from coevo.recipes import read_experiment
from coevo.run import create_run
from coevo.study.plan import read_plan

TINY = ["gp.population=8", "gp.generations=3", "gp.tournament=2", "evaluation.games=4", "game.time_limit_steps=150"]
SMALL = ["gp.crossover=0.7", "gp.reproduction=0.1", "gp.mutation=0.2"]
GROWN = ["gp.inserted_conditions=2.0", "gp.changed_leaves=1.0"]


@pytest.fixture
def populations(go_on):
    """Return a function that does a run and returns its trees with their fitness."""
    return lambda settings, folder: _populations(go_on(create_run(folder, settings)))


def _populations(run):
    return [
        (record.fitness.tolist(), [tree.tobytes() for tree in record.codes])
        for generation in range(run.finished)
        for record in run.records(generation)
    ]


@pytest.mark.parametrize(
    ("change", "without", "counting"),
    [
        pytest.param("evaluation.partners=4", [], ["evaluation.grouping=partners"], id="partners"),
        pytest.param(
            "evaluation.hall_share=0.25",
            ["evaluation.grouping=partners", "evaluation.partners=4"],
            ["evaluation.grouping=hall-of-fame", "evaluation.partners=4"],
            id="hall",
        ),
        pytest.param("fitness.fixed.alpha_k=0.5", ["fitness.kind=varying"], [], id="fixed"),
        pytest.param("fitness.varying.alpha_k=0.5", [], ["fitness.kind=varying"], id="varying"),
        pytest.param("gp.tournament=5", ["gp.variation=random"], [], id="tournament"),
        pytest.param("gp.mutation_depth_max=1", ["gp.mutation=0.0", "gp.crossover=0.95"], SMALL, id="mutation"),
        pytest.param("gp.leaf_probability=1.0", ["gp.crossover_points=same-context"], [], id="leaves"),
        pytest.param("gp.walked_changes=1.0", [], GROWN, id="walks"),
        pytest.param("gp.walk_stop=0.9", GROWN, [*GROWN, "gp.walked_changes=0.5"], id="stop"),
    ],
)
def test_what_is_said_to_change_nothing_changes_nothing_and_else_something(
    change, without, counting, populations, tmp_path
):
    for number, (others, is_vain) in enumerate(((without, True), (counting, False))):
        plain = read_experiment("smoke", [*TINY, *others])
        changed = read_experiment("smoke", [*TINY, *others, change])
        assert bool(without_effect(changed, [change.partition("=")[0]])) == is_vain
        found = [populations(one, tmp_path / f"{number}-{k}") for k, one in enumerate((plain, changed))]
        assert (found[0] == found[1]) == is_vain


def test_the_share_of_games_against_frozen_teams_counts_where_there_are_some(
    small_settings, small_run, populations, tmp_path
):
    share, partners = "evaluation.against_share=0.5", ("evaluation.grouping=partners", "evaluation.partners=2")
    frozen = f"evaluation.against={small_run.path}"
    for number, (others, is_vain) in enumerate(((partners, True), ((*partners, frozen), False))):
        plain, changed = small_settings(*others), small_settings(*others, share)
        assert bool(without_effect(changed, [share.partition("=")[0]])) == is_vain
        found = [populations(with_opponents(one), tmp_path / f"{number}-{k}") for k, one in enumerate((plain, changed))]
        assert (found[0] == found[1]) == is_vain


def test_who_gives_such_a_setting_is_told_and_the_run_goes_on(tmp_path, monkeypatch, coevo):
    monkeypatch.chdir(tmp_path)
    few = [argument for change in TINY for argument in ("--set", change)]
    said = coevo("evolve", "smoke", *few, "--unseen", "0", "--quiet", "--set", "evaluation.partners=4")
    assert said.code == 0
    assert "Beware: evaluation.partners changes nothing here: see evaluation.grouping" in said.err
    assert (tmp_path / "runs" / "smoke-seed0").is_dir()
    assert "Beware" not in coevo("evolve", "smoke", *few, "--unseen", "0").err


def test_what_a_recipe_carries_along_is_not_complained_of():
    settings = read_experiment("two-learners", ["evaluation.grouping=random"])
    assert without_effect(settings, ["evaluation.grouping"]) == []
    assert without_effect(settings, ["evaluation.partners"])


def test_a_study_that_varies_in_vain_is_told(tmp_path):
    study = tmp_path / "vain.toml"
    study.write_text('recipes = ["smoke", "two-learners"]\n[vary]\n"evaluation.partners" = [1, 2]\n', encoding="utf-8")
    told = read_plan(str(study)).without_effect
    assert len(told) == 1
    assert told[0].startswith("smoke-partners1: evaluation.partners changes nothing here")
