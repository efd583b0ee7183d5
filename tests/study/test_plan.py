"""A study file and the runs that follow from it: all combinations, each with a name of its own, all of it checked."""

from __future__ import annotations

import itertools
import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.config import read_toml, to_toml
from coevo.errors import InputError
from coevo.recipes import recipe_names
from coevo.study import plan
from coevo.study.folder import open_study
from coevo.study.plan import read_plan, study_name

SMOKE = 'recipes = ["smoke"]'


def test_every_combination_is_a_run_with_a_name_of_its_own(study_file):
    vary = '[vary]\n"fitness.kind" = ["fixed", "varying"]\n"gp.elite" = [1, 2]\n"skills.strike" = ["shoot", ""]'
    runs = read_plan(str(study_file('recipes = ["smoke", "two-learners"]\nseeds = [7, 3]', vary))).runs
    expected = itertools.product(["smoke", "two-learners"], ["fixed", "varying"], [1, 2], ["shoot", ""], [7, 3])
    settings = [run.settings for run in runs]
    assert [(one.name, one.fitness.kind, one.gp.elite, one.skills.get("strike"), one.seed) for one in settings] == list(
        expected
    )
    assert {one.gp.generations for one in settings} == {3}
    assert runs[0].name == "smoke-fixed-elite1-shoot-seed7"
    assert runs[3].name == "smoke-fixed-elite1-none-seed3"
    assert runs[0].key == {
        "recipe": "smoke",
        "seed": 7,
        "fitness.kind": "fixed",
        "gp.elite": 1,
        "skills.strike": "shoot",
        "run": "smoke-fixed-elite1-shoot-seed7",
    }


def test_arms_are_settings_by_name_in_place_of_the_studys_own(study_file, tmp_path):
    arms = '[arms.plain]\n[arms.small]\n"gp.population" = 8\ngp.elite = 2\n'
    path = str(study_file('recipes = ["smoke"]\nseeds = [1]', arms + '[vary]\n"fitness.kind" = ["fixed", "varying"]'))
    plan = read_plan(path)
    found = [(run.name, run.settings.gp.population, run.settings.gp.elite) for run in plan.runs]
    given = read_plan(str(study_file('recipes = ["smoke"]\nseeds = [1]', '[vary]\n"fitness.kind" = ["fixed"]'))).runs[0]
    own = given.settings.gp.population, given.settings.gp.elite
    assert found == [
        ("smoke-plain-fixed-seed1", *own),
        ("smoke-plain-varying-seed1", *own),
        ("smoke-small-fixed-seed1", 8, 2),
        ("smoke-small-varying-seed1", 8, 2),
    ]
    assert plan.runs[2].key == {
        "recipe": "smoke",
        "seed": 1,
        "arm": "small",
        "fitness.kind": "fixed",
        "run": "smoke-small-fixed-seed1",
    }
    (tmp_path / "again.toml").write_text(to_toml(plan.record))
    assert [run.name for run in read_plan(str(tmp_path / "again.toml")).runs] == [run.name for run in plan.runs]


@pytest.mark.parametrize(
    ("arms", "said"),
    [
        ('[arms.one]\n"fitness.kind" = "fixed"', r"fitness.kind stands in \[arms.one\] and in \[vary\]"),
        ("[arms.one]\nseed = 3", "arms.one.seed: a study says this by 'seeds'"),
        ("[arms.one]\ngp.elit = 3", "arm=one.*unknown setting 'gp.elit'"),
    ],
)
def test_wrong_arms_are_refused(arms, said, study_file):
    with pytest.raises(InputError, match=said):
        read_plan(str(study_file(settings=arms)))


def test_keys_without_quotes_mean_the_same(study_file):
    quoted = read_plan(str(study_file(settings='[set]\n"gp.population" = 6')))
    plain = read_plan(
        str(study_file(settings="[set.gp]\npopulation = 6", vary='[vary]\nfitness.kind = ["fixed", "varying"]'))
    )
    assert plain.record == quoted.record


def test_seeds_are_a_number_or_a_list_and_the_command_line_wins(study_file):
    assert read_plan(str(study_file('recipes = ["smoke"]'))).seeds == (0,)
    path = str(study_file('recipes = ["smoke"]\nseeds = [5, 2]'))
    assert read_plan(path).seeds == (5, 2)
    assert read_plan(path, 3).seeds == (0, 1, 2)


NUMBERS = st.one_of(st.integers(), st.booleans(), st.floats(allow_nan=False))
VALUES = st.one_of(st.text(max_size=200), NUMBERS, st.lists(st.integers(), max_size=3))


@given(st.lists(VALUES, min_size=1, max_size=8, unique_by=repr))
def test_names_are_names_of_folders_and_never_equal(values):
    taken = {}
    for value in values:
        taken[plan._label("smoke", {"a.b": value}, taken)] = ""
    assert len({label.lower() for label in taken}) == len(values)
    for label in taken:
        assert plan._slug(label) == label
        assert len(label) < 120


def test_recipes_are_files_beside_the_study_and_keep_their_folders_only_where_they_must(study_file, tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.toml").write_bytes(plan.recipe_path("smoke", "evolution").read_bytes())
    (tmp_path / "other.toml").write_bytes(plan.recipe_path("smoke", "evolution").read_bytes())
    read = read_plan(str(study_file('recipes = ["a/same.toml", "b/same.toml", "other.toml"]', vary="")))
    assert [run.name for run in read.runs] == ["a-same-seed0", "b-same-seed0", "other-seed0"]
    assert read.record.recipes == ("recipes/a-same.toml", "recipes/b-same.toml", "recipes/other.toml")


def test_a_resolved_study_is_a_study_file_of_the_same_runs(study_file, tmp_path):
    read = read_plan(str(study_file()))
    (tmp_path / "resolved.toml").write_text(to_toml(read.record))
    again = read_plan(str(tmp_path / "resolved.toml"))
    assert again.record == read.record
    assert [(run.name, run.settings) for run in again.runs] == [(run.name, run.settings) for run in read.runs]


def test_a_resolved_study_whose_recipe_has_changed_is_refused(study_file, tmp_path):
    text = to_toml(read_plan(str(study_file())).record)
    (tmp_path / "resolved.toml").write_text(text.replace('"gp.generations" = 3', '"gp.generations" = 4'))
    with pytest.raises(InputError, match=r"settings of smoke-fixed are not those that were recorded; take the table"):
        read_plan(str(tmp_path / "resolved.toml"))


def test_studies_are_called_as_their_file_or_its_folder():
    assert study_name("chapter6/tiny") == "tiny"
    assert study_name("chapter6/study") == "chapter6-study"


def test_the_studies_that_come_along_are_right():
    assert {"chapter6/study", "chapter6/tiny"} <= set(recipe_names("study"))
    runs = read_plan("chapter6/study").runs
    games = ("two-learners", "stationary-opponent", "three-learners")
    assert [run.name for run in runs if run.seed == 9] == [
        f"dissertation-{game}-{kind}-seed9" for game in games for kind in ("fixed", "varying")
    ]
    for run in runs:  # Table 6.3, and 20 games a grouping
        gp, evaluation = run.settings.gp, run.settings.evaluation
        assert (gp.population, gp.generations, gp.tournament, gp.elite, gp.crossover_depth_max) == (80, 60, 10, 1, 25)
        assert math.isclose(gp.crossover, 0.85)
        assert (evaluation.games, evaluation.grouping) == (20, "random")
        assert list(run.settings.terminals) == ["shoot", "pass", "avoid", "search"]


@pytest.mark.parametrize("name", [name for name in recipe_names("study") if name.startswith("chapter6/")])
def test_every_study_that_comes_along_can_be_done_and_each_of_its_conditions_differs(name):
    runs = read_plan(name).runs
    first = [run.settings for run in runs if run.seed == runs[0].seed]
    assert len(first) > 1
    assert all(one != other for one, other in itertools.combinations(first, 2))


@pytest.mark.parametrize("name", ["two-learners", "stationary-opponent", "three-learners"])
def test_the_dissertations_conditions_leave_no_setting_to_a_default(name):
    path = plan.recipe_path(f"chapter6/dissertation-{name}", "evolution")
    resolved = to_toml(plan.kind_named("evolution").settings(read_toml(path), ""))
    assert {**read_toml(path), "seed": 0} == tomllib.loads(resolved)


# A study of smoke in every respect but what is said here: its head, its tables, and what is said of it.
WRONG = {
    "no recipes": ("seeds = 1", "", "", "missing required field recipes"),
    "recipes, but none": ("recipes = []", "", "", "recipes: expected array of length >= 1"),
    "unknown recipe": ('recipes = ["smok"]', "", "", "no recipe 'smok'. Did you mean 'smoke'?"),
    "no such file": ('recipes = ["none.toml"]', "", "", "none.toml: No such file"),
    "a recipe twice": ('recipes = ["smoke", "smoke"]', "", "", 'recipes: expected each value once, got "smoke"'),
    "unknown key": (f"{SMOKE}\nseed = 3", "", "", "unknown setting 'seed'. Did you mean 'seeds'?"),
    "no seeds": (f"{SMOKE}\nseeds = 0", "", "", "seeds: expected int >= 1"),
    "seeds, but none": (f"{SMOKE}\nseeds = []", "", "", "seeds: expected array of length >= 1"),
    "a seed twice": (f"{SMOKE}\nseeds = [1, 1]", "", "", "seeds: expected each value once, got 1"),
    "a seed below 0": (f"{SMOKE}\nseeds = [-1]", "", "", "seeds.0: expected int >= 0, got -1"),
    "no study": (f'kind = "evolution"\n{SMOKE}', "", "", "is an experiment of evolution"),
    "no list": (SMOKE, '"fitness.kind" = "fixed"', "", "vary.fitness.kind: expected a list of values, such as [1, 2]"),
    "an empty list": (SMOKE, '"gp.elite" = []', "", "vary.gp.elite: expected a list of values"),
    "a value twice": (SMOKE, '"gp.elite" = [1, 1]', "", "vary.gp.elite: expected each value once, got 1"),
    "unknown varied key": (
        SMOKE,
        '"gp.populatoin" = [6, 8]',
        "",
        "smoke gp.populatoin=6: unknown setting 'gp.populatoin'. Did you mean 'population'?",
    ),
    "the second value": (SMOKE, '"gp.population" = [12, 1]', "", "smoke gp.population=1: gp.population: expected int"),
    "unknown key of all": (SMOKE, "", '"gp.genrations" = 3', "'gp.genrations'. Did you mean 'generations'?"),
    "past the end": (SMOKE, "", '"players.9.team" = 1', "players.9.team: expected an index from 0 to 2, got '9'"),
    "set and varied": (SMOKE, '"gp.elite" = [1, 2]', '"gp.elite" = 1', "gp.elite stands in [set] and in [vary]"),
    "seed varied": (SMOKE, "seed = [1, 2]", "", "vary.seed: a study says this by 'seeds'"),
    "seed set": (SMOKE, "", "seed = 1", "set.seed: a study says this by 'seeds'"),
    "no such fitness": (
        SMOKE,
        '"fitness.kind" = ["fixed", "absent:f"]',
        "",
        "smoke fitness.kind=absent:f: fitness.kind: there is no module 'absent'",
    ),
    "a schedule": ('recipes = ["chapter3/short"]', "", "", "no recipe 'chapter3/short'"),
    "itself": ('recipes = ["mine.toml"]', "", "", "recipes of the kind 'evolution' or 'skill' or 'team', got 'study'"),
    "a date": (
        SMOKE,
        '"gp.elite" = [1, 2020-01-01]',
        "",
        "vary.gp.elite: expected values that a setting can have, got 2020-",
    ),
    "a time in a table": (
        SMOKE,
        '"gp.start" = [{ r0 = [12:00:00] }]',
        "",
        "vary.gp.start: expected values that a setting",
    ),
    "too many": (f"{SMOKE}\nseeds = 2000", f'"gp.elite" = {list(range(60))}', "", "expected at most 100000 runs"),
}


@pytest.mark.parametrize(("head", "vary", "settings", "told"), WRONG.values(), ids=WRONG.keys())
def test_wrong_studies_are_refused_before_anything_is_made(
    head, vary, settings, told, coevo, study_file, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    kind = "" if head.startswith("kind") else 'kind = "study"\n'
    path = study_file(kind + head, f"[vary]\n{vary}", f"[set]\n{settings}")
    said = coevo("study", path, "--out", tmp_path / "out")
    assert said.code == 2, said.err
    assert said.out == ""
    assert "Traceback" not in said.err
    assert len(said.err.strip().splitlines()) == 1
    assert told in said.err
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("kind", "told"), [('["x"]', "['x']"), ("3", "3"), ("{ a = 1 }", "{'a': 1}")])
def test_a_recipe_whose_kind_is_no_text_is_refused(kind, told, study_file, tmp_path):
    (tmp_path / "odd.toml").write_text(f"kind = {kind}\nname = 'odd'\n")
    with pytest.raises(InputError) as caught:
        read_plan(str(study_file('recipes = ["odd.toml"]')))
    assert str(caught.value).endswith(f"odd.toml: kind: expected text, such as 'evolution', got {told}")


def recipes_with_modules_of_one_name(tmp_path, *texts):
    """Write recipes in folders of their own, each with a module own.py beside it; return their paths in a study."""
    recipe = plan.recipe_path("smoke", "evolution").read_text() + "\n[fitness]\nkind = 'own:reach'\n"
    for name, text in zip("ab", texts, strict=True):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.toml").write_text(recipe)
        (tmp_path / name / "own.py").write_text(text)
    return '["a/a.toml", "b/b.toml"]'


OWN = "def reach(measures, **_):\n    return -measures['goals']\n"


def test_two_modules_of_one_name_are_refused_as_one_would_run_for_the_other(study_file, tmp_path):
    recipes = recipes_with_modules_of_one_name(tmp_path, OWN, OWN.replace("-", ""))
    with pytest.raises(InputError) as caught:
        read_plan(str(study_file(f"recipes = {recipes}", vary="")))
    one, other = (tmp_path / name / "own.py" for name in "ab")
    assert f"mine.toml: {one} and {other} differ" in str(caught.value)
    assert str(caught.value).endswith("rename one of them")


def test_two_modules_of_one_name_that_are_equal_are_one(study_file, tmp_path):
    recipes = recipes_with_modules_of_one_name(tmp_path, OWN, OWN)
    read = read_plan(str(study_file(f"recipes = {recipes}", vary="")))
    assert [path.parent.name for path in read.own_files] == ["a", "b"]
    open_study(tmp_path / "out", read).close()
    assert (tmp_path / "out" / "recipes" / "own.py").read_text() == OWN
