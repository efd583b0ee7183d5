"""Recipes by name: found wherever one is, of the kind that they say, each readable by the command that takes it."""

from __future__ import annotations

import math
import shutil

import msgspec
import pytest

from behaviors.recipe import Recipe, installed_recipes
from behaviors.recipe import read_recipe as read_skill_recipe
from behaviors.schedule.recipe import Schedule
from coevo import recipes
from coevo.config import RunSettings
from coevo.errors import InputError
from coevo.recipes import read_recipe, read_settings, recipe_names, recipe_path
from coevo.study.folder import open_study
from coevo.study.plan import read_plan

KINDS = {"evolution": RunSettings, "skill": Recipe, "schedule": Schedule}
NAMES = {
    "evolution": {"smoke", "two-learners", "stationary-opponent", "three-learners"},
    "skill": {"chapter3/literal-shoot", "chapter3/shoot-avoiding"},
    "schedule": {"chapter3/schedule", "chapter3/previous", "chapter3/matched", "chapter3/simultaneous"},
}
ALL = [(name, kind) for kind in KINDS for name in recipe_names(kind)]


@pytest.fixture
def elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("elsewhere")
def test_recipes_are_found_by_name_from_any_folder():
    for kind, names in NAMES.items():
        assert names <= set(recipe_names(kind))
    assert len({name for name, _ in ALL}) == len(ALL)


@pytest.mark.usefixtures("elsewhere")
@pytest.mark.parametrize(("name", "kind"), ALL)
def test_each_is_what_it_says_and_is_named_as_its_file(name, kind):
    settings = read_settings(KINDS[kind], name)
    assert settings.kind == kind
    assert settings.name == name.rpartition("/")[2]


@pytest.mark.parametrize(("name", "kind"), ALL)
def test_a_file_of_another_kind_is_refused_with_the_command_that_takes_it(name, kind):
    command = {"evolution": "coevo evolve", "skill": "coevo learn", "schedule": "coevo reproduce chapter3"}[kind]
    for other in set(KINDS) - {kind}:
        with pytest.raises(InputError, match=f"{name} is .*, not .*: '{command}' takes it") as caught:
            read_settings(KINDS[other], name)
        assert "\n" not in str(caught.value)


def test_a_path_means_the_file_and_a_name_never_does(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(recipe_path("smoke", "evolution"), tmp_path / "smoke.toml")
    with (tmp_path / "smoke.toml").open("a", encoding="utf-8") as file:
        file.write("\n[fitness]\nkind = 'varying'\n")
    assert read_settings(RunSettings, "smoke.toml").fitness.kind == "varying"
    assert read_settings(RunSettings, "smoke").fitness.kind == "fixed"
    assert read_settings(RunSettings, "smoke.toml", ["fitness.kind=fixed"]).fitness.kind == "fixed"


def test_the_environment_that_co_evolves_is_the_preset_but_for_its_levels():
    """So the preset is the control of chapter6/levelling."""
    preset = read_settings(RunSettings, "three-learners")
    other = read_settings(RunSettings, "chapter6/co-evolving-environment")
    assert other.levels is not None
    assert msgspec.structs.replace(other, name=preset.name, levels=None) == preset


def test_presets_begin_with_decision_tables_the_same_for_each_robot_and_those_of_a_contest_with_smaller_ones():
    """docs/decisions/0019-decision-tables.md."""
    alone = [read_settings(RunSettings, name) for name in ("two-learners", "stationary-opponent")]
    contests = [read_settings(RunSettings, name) for name in ("three-learners", "chapter6/equal-complexity")]
    assert alone[0].gp == alone[1].gp
    large, small = (math.prod(len(row) + 1 for row in one.gp.decision_tables["r0"]) for one in (alone[0], contests[0]))
    assert (large, small) == (96, 16)
    for one in (*alone, *contests):
        first = alone[0] if one in alone else contests[0]
        table = first.gp.decision_tables["r0"]
        evolving = [f"r{place}" for place, player in enumerate(one.players) if player.control == "evolve"]
        assert one.gp.decision_tables == dict.fromkeys(evolving, table)
        assert one.evaluation == alone[0].evaluation
        assert msgspec.structs.replace(one.gp, decision_tables={}) == msgspec.structs.replace(
            first.gp, decision_tables={}
        )
        assert (one.gp.population, one.gp.generations, one.evaluation.games) == (80, 60, 20)  # Table 6.3


def test_an_unknown_name_is_answered_with_the_nearest_of_its_kind():
    with pytest.raises(
        InputError, match=r"no recipe 'chapter3/shedule'\. Did you mean 'chapter3/schedule'\?"
    ) as caught:
        read_recipe("chapter3/shedule", "schedule")
    assert "smoke" not in str(caught.value)
    with pytest.raises(InputError, match=r"no recipe 'shot'\. Did you mean 'shoot'\?.*chapter3/literal-shoot"):
        read_skill_recipe("shot")
    assert read_skill_recipe("chapter3/literal-shoot").task == "shoot"
    assert "shoot" in installed_recipes()


def test_a_broken_file_among_the_recipes_spoils_no_answer_and_none_hides_a_preset(tmp_path, monkeypatch):
    package = tmp_path / "coevo"
    shutil.copytree(recipe_path("smoke", "evolution").parent, package / "presets")
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    (tmp_path / "runs" / "smoke.toml").write_text("kind = 'evolution'\nname = 'other'")
    (tmp_path / "runs" / "mine" / "own.toml").write_text("kind = 'evolution'\nname = 'other'")
    (tmp_path / "runs" / "mine" / "broken.toml").write_text("kind = ")
    (tmp_path / "runs" / "mine" / "config.toml").write_text("kind = 'evolution'")  # the record of a run
    (tmp_path / "runs" / "mine" / "recipe.toml").write_text("kind = 'skill'")  # and of a learned skill
    monkeypatch.setattr(recipes, "files", lambda _: package)
    assert set(recipe_names("evolution")) == {"mine/own", *NAMES["evolution"]}
    assert not any(name.startswith("mine/") for name in recipe_names("skill"))
    assert read_settings(RunSettings, "smoke").name == "smoke"
    with pytest.raises(InputError, match="Did you mean 'mine/own'"):
        read_recipe("mine/onw", "evolution")


def test_what_a_study_has_left_is_no_recipe_but_a_study_file_of_that_name_is(tmp_path, monkeypatch):
    package = tmp_path / "coevo"
    shutil.copytree(recipe_path("smoke", "evolution").parent, package / "presets")
    (tmp_path / "pyproject.toml").touch()
    for name in ("chapter6", "before"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "study.toml").write_text("kind = 'study'\nrecipes = ['smoke']\n")
    monkeypatch.setattr(recipes, "files", lambda _: package)
    assert recipe_names("study") == ["before/study", "chapter6/study"]
    (tmp_path / "runs" / "before" / "table.csv").touch()  # of a version whose record had no [conditions]
    for name, ends in (("under-way", False), ("finished", True)):
        folder = open_study(tmp_path / "runs" / name, read_plan("chapter6/study"))
        if ends:
            folder.write_tables({}, {})
        folder.close()
    assert recipe_names("study") == ["chapter6/study"]
    with pytest.raises(InputError, match=r"no recipe 'finished/study'\. Did you mean 'chapter6/study'"):
        recipe_path("finished/study", "study")


def test_an_installed_wheel_finds_them_beside_the_presets(tmp_path, monkeypatch):
    package = tmp_path / "coevo"
    shutil.copytree(recipe_path("smoke", "evolution").parent, package / "presets")
    folders = [("chapter3/schedule", "schedule"), ("chapter4/shooter", "skill"), ("chapter5/shoot-kicking", "skill")]
    folders.append(("chapter6/tiny", "study"))
    for folder in (recipe_path(*of).parent for of in folders):
        (package / "presets" / folder.name).mkdir(exist_ok=True)
        for path in folder.glob("*.toml"):
            shutil.copy(path, package / "presets" / folder.name)
    # A folder of runs beside it is a user's own.
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    (tmp_path / "runs" / "mine" / "config.toml").write_text("kind = 'evolution'")
    (tmp_path / "runs" / "mine" / "other.toml").write_text("kind = 'evolution'")
    before = {kind: recipe_names(kind) for kind in KINDS}
    monkeypatch.setattr(recipes, "files", lambda _: package)
    assert {kind: recipe_names(kind) for kind in KINDS} == before
