"""The folder of a study: for one study and one process, and its table always in the order of the plan."""

from __future__ import annotations

import csv
import json
import re
import shutil

import pytest

from coevo.config import to_toml
from coevo.errors import InputError
from coevo.recipes import recipe_path
from coevo.study.folder import ROW, check_folder, check_study, finished_runs, open_study, row_bytes
from coevo.study.folder import _read_row as read_row
from coevo.study.plan import read_plan
from coevo.study.registry import kind_named


@pytest.fixture
def plan(study_file):
    return read_plan(str(study_file()))


@pytest.fixture
def folder(plan, tmp_path):
    opened = open_study(tmp_path / "out", plan)
    yield opened
    opened.close()


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_is_in_the_order_of_the_plan_whatever_came_first(folder, plan):
    names = [run.name for run in plan.runs]
    rows = {name: {"share": 0.1 * number, f"only_{number}": number} for number, name in enumerate(names)}
    folder.write_tables(rows, {})
    whole = folder.table.read_bytes()
    folder.write_tables(dict(reversed(rows.items())), {})
    assert folder.table.read_bytes() == whole
    found = rows_of(folder.table)
    assert list(found[0]) == ["recipe", "seed", "fitness.kind", "run", "share", *(f"only_{n}" for n in range(4))]
    assert [(row["run"], row["fitness.kind"], row["seed"]) for row in found] == [
        ("smoke-fixed-seed0", "fixed", "0"),
        ("smoke-fixed-seed1", "fixed", "1"),
        ("smoke-varying-seed0", "varying", "0"),
        ("smoke-varying-seed1", "varying", "1"),
    ]
    assert [float(row["share"]) for row in found] == [0.1 * number for number in range(4)]  # to the last bit
    assert [row["only_2"] for row in found] == ["", "", "2", ""]


def test_what_failed_has_a_table_of_its_own_as_long_as_anything_does(folder, plan):
    lost = plan.runs[2].name
    folder.write_tables({}, {lost: 'it said "no", twice'})
    assert rows_of(folder.table) == []
    (row,) = rows_of(folder.path / "failed.csv")
    assert row == {
        "recipe": "smoke", "seed": "0", "fitness.kind": "varying", "run": lost, "reason": 'it said "no", twice'
    }  # fmt: skip
    folder.write_tables({}, {})
    assert not (folder.path / "failed.csv").exists()


@pytest.mark.parametrize("data", [b"", b"{", b'{"row": 3, "measured": []}', b'{"row": {"a": 1}}', b"[]"])
def test_a_damaged_row_is_none(folder, plan, data):
    run = plan.runs[0]
    (folder.path / run.name).mkdir()
    (folder.path / run.name / ROW).write_bytes(data)
    assert folder.row(run) is None


def test_a_digit_that_flipped_is_noticed_wherever_it_is(folder, plan):
    """In the row of a run, which then is measured anew, and in the table, which is not read then."""
    measured = kind_named("evolution").measured
    rows = {run.name: {"share": 0.125 * number, "goals": number} for number, run in enumerate(plan.runs)}
    for run in plan.runs:
        (folder.path / run.name).mkdir()
        (folder.path / run.name / ROW).write_bytes(row_bytes(measured, rows[run.name], run.key))
    folder.write_tables(rows, {})
    assert [(path.name, row["share"]) for path, row in finished_runs(folder.path)] == [
        (name, str(row["share"])) for name, row in rows.items()
    ]
    assert {finding.state for finding in check_study(folder.path)} == {"sound"}
    whole = folder.table.read_bytes()
    for old, new in (
        (b"0.25", b"0.35"),
        (b",3\n", b",2\n"),
        (b"smoke,1", b"smoke,0"),
        (b"smoke,1", b"smoje,1"),
        (b"smoke,1,varying", b"smoke,1,vazying"),
        (b"fixed-seed1", b"fixed-seed0"),
    ):
        folder.table.write_bytes(whole.replace(old, new, 1))
        with pytest.raises(InputError, match=r"table\.csv is damaged.*the same 'coevo study' makes it anew"):
            finished_runs(folder.path)
        assert [finding.name for finding in check_study(folder.path) if finding.state == "damaged"] == ["table.csv"]
    header, *lines = whole.splitlines(keepends=True)
    folder.leave()
    for others in (lines[::-1], [*lines, lines[0]]):
        folder.table.write_bytes(header + b"".join(others))
        with pytest.raises(InputError, match=r"table\.csv is damaged .*in their order"):
            finished_runs(folder.path)
    folder.table.write_bytes(header + b"".join(lines[:2] + lines[3:]))
    said = (
        r"table\.csv is incomplete \(it has no row of smoke-varying-seed0, which is finished\); 'coevo study' without"
    )
    with pytest.raises(InputError, match=said):
        finished_runs(folder.path)
    assert re.search(said, next(of.why for of in check_study(folder.path) if of.state == "damaged"))
    folder.flag.touch()
    folder.table.write_bytes(header + b"".join(lines[:2]))  # while it goes on
    assert len(finished_runs(folder.path)) == 2
    folder.table.write_bytes(whole)
    path = folder.path / plan.runs[3].name / ROW
    path.write_bytes(path.read_bytes().replace(b"0.375", b"0.378"))
    assert folder.row(plan.runs[3]) is None
    with pytest.raises(InputError, match="does not tell what the run came to"):
        finished_runs(folder.path)
    assert f"{plan.runs[3].name}/{ROW}" in {of.name for of in check_study(folder.path) if of.state == "damaged"}
    path.unlink()  # as in tables of which nothing else was kept
    assert len(finished_runs(folder.path)) == len(rows)


def test_a_file_in_place_of_the_folder_is_told(tmp_path):
    (tmp_path / "one.toml").write_text('kind = "study"')
    with pytest.raises(
        InputError, match=r"one\.toml is a file, but the folder of a study is expected; name the one wi"
    ):
        finished_runs(tmp_path / "one.toml")
    with pytest.raises(InputError, match=r"one\.toml/out lies within a file, but the folder of a study is expected"):
        finished_runs(tmp_path / "one.toml" / "out")


@pytest.mark.parametrize("data", [b"", b"\xff\n", b"run\n", b"a,b\n1,2\n", b'run\n"a', b"run,reason\nnone,why\n"])
def test_failures_that_cannot_be_read_are_none(folder, data):
    (folder.path / "failed.csv").write_bytes(data)
    assert folder.failures == {}


def test_a_row_of_before_has_no_digest_and_counts(tmp_path):
    told = json.loads(row_bytes(["robots"], {"share": 0.5}, {"seed": 1}))
    assert len(told.pop("sha256")) == 64
    assert told.pop("key") == {"seed": 1}
    path = tmp_path / ROW
    path.write_text(json.dumps(told), encoding="utf-8")
    assert read_row(path) == (["robots"], {"share": 0.5}, {})


@pytest.mark.parametrize("cell", [float("nan"), float("inf")])
def test_a_row_has_finite_numbers(cell):
    with pytest.raises(ValueError, match="finite"):
        row_bytes(["robots"], {"share": cell}, {})


def test_a_row_counts_only_with_the_whole_run_and_all_that_is_asked(folder, plan, monkeypatch):
    run, kind = plan.runs[0], kind_named("evolution")
    (folder.path / run.name).mkdir()
    (folder.path / run.name / ROW).write_bytes(row_bytes(kind.measured, {"a": 1}, run.key))
    assert folder.row(run) is None  # no generation is there
    monkeypatch.setattr(type(kind), "is_whole", lambda *_: True)
    assert folder.row(run) == {"a": 1}
    assert folder.row(plan.runs[1]) is None
    (folder.path / plan.runs[1].name).mkdir()
    shutil.copy(folder.path / run.name / ROW, folder.path / plan.runs[1].name / ROW)
    assert folder.row(plan.runs[1]) is None  # it is that of another run
    monkeypatch.setattr(type(kind), "measured", (*kind.measured, "more"))
    assert folder.row(run) is None


def test_another_study_is_refused(folder, study_file):
    changed = {
        "recipes": study_file('recipes = ["two-learners"]\nseeds = 2'),
        "vary": study_file(vary='[vary]\n"fitness.kind" = ["varying", "fixed"]', name="order.toml"),
        "set": study_file(settings='[set]\n"gp.population" = 8', name="set.toml"),
    }
    for what, path in changed.items():
        with pytest.raises(InputError, match=rf"holds another study: it differs in its {what}; choose another --out"):
            check_folder(folder.path, read_plan(str(path)))


def test_settings_that_toml_writes_in_another_order_are_the_same_study(study_file, tmp_path):
    keys = '"levels.keys" = [{ "players.2.strength" = [0.6, 1.0] }]\n"levels.against" = 0\n'
    study = str(study_file(settings=f'[set]\n"levels.keep" = "both sides winning"\n{keys}'))
    open_study(tmp_path / "out", read_plan(study)).close()
    check_folder(tmp_path / "out", read_plan(study))


def test_a_recipe_or_a_module_that_has_changed_is_another_study(study_file, tmp_path):
    recipe, module = tmp_path / "recipe.toml", tmp_path / "own.py"
    recipe.write_bytes(recipe_path("smoke", "evolution").read_bytes())
    module.write_text("def reach(measures, **_):\n    return -measures['goals']\n")
    study = str(study_file('recipes = ["recipe.toml"]', vary='[vary]\n"fitness.kind" = ["fixed", "own:reach"]'))
    open_study(tmp_path / "out", read_plan(study)).close()
    for path in (recipe, module):  # workers on other machines see the study's folder alone
        assert (tmp_path / "out" / "recipes" / path.name).read_bytes() == path.read_bytes()
    open_study(tmp_path / "out", read_plan(str(tmp_path / "out" / "study.toml"))).close()  # it is whole in itself
    for path, more in ((recipe, "[categories]\nleft_below_px = 20.0\n"), (module, "# changed\n")):
        before = path.read_text()
        path.write_text(f"{before}\n{more}")
        with pytest.raises(InputError, match="differs in its settings, which a recipe or a default now gives"):
            check_folder(tmp_path / "out", read_plan(study))
        path.write_text(before)
    check_folder(tmp_path / "out", read_plan(study))


def test_the_setting_that_has_changed_is_named_where_a_run_tells_it(study_file, tmp_path):
    recipe, out = tmp_path / "recipe.toml", tmp_path / "out"
    recipe.write_bytes(recipe_path("smoke", "evolution").read_bytes())
    study = str(study_file('recipes = ["recipe.toml"]\nseeds = 2', vary=""))
    plan = read_plan(study)
    open_study(out, plan).close()
    with recipe.open("a") as file:
        file.write("\n[categories]\nleft_below_px = 20.0\n")
    with pytest.raises(InputError, match="a default now gives; choose another --out"):  # no run was begun
        check_folder(out, read_plan(study))
    run = plan.runs[1]
    (out / run.name).mkdir()
    config = to_toml(run.settings)
    line = "left_below_px = 21.333333333333332\n"
    assert line in config
    for text, told in (
        (config, "left_below_px is 21.333333333333332 in recipe-seed1 and is 20.0 now"),
        (config.replace(line, ""), "left_below_px is not there in recipe-seed1 and is 20.0 now"),
        (config.replace(line, "left_below_px = 20.0\nmore = 1\n"), "more is 1 in recipe-seed1 and is not there now"),
    ):
        (out / run.name / "config.toml").write_text(text)
        with pytest.raises(
            InputError, match=f"a default now gives: categories.{re.escape(told)}; choose another --out"
        ):
            check_folder(out, read_plan(study))


def test_seeds_may_be_added_but_not_left_out(folder, study_file):
    check_folder(folder.path, read_plan(str(study_file()), 3))
    with pytest.raises(InputError, match="holds this study with more seeds, such as 1; give these too"):
        check_folder(folder.path, read_plan(str(study_file()), 1))


def test_arms_may_be_added_but_neither_changed_nor_left_out(study_file, tmp_path):
    few, more, other = (
        read_plan(
            str(study_file(vary=f'[arms.a]\n[arms.b]\n"gp.population" = {size}\n{rest}', name=f"{size}{rest[:7]}.toml"))
        )
        for size, rest in ((8, ""), (8, '[arms.c]\n"gp.population" = 10'), (6, ""))
    )
    open_study(tmp_path / "out", few).close()
    open_study(tmp_path / "out", more).close()
    assert "[arms.c]" in (tmp_path / "out" / "study.toml").read_text(encoding="utf-8")
    for plan in (few, other):
        with pytest.raises(InputError, match="differs in its arms"):
            check_folder(tmp_path / "out", plan)


def test_a_folder_of_something_else_is_refused(plan, tmp_path, small_run):
    for path in (tmp_path, small_run.path, tmp_path / "mine.toml"):
        with pytest.raises(InputError, match="exists and is not the folder of a study; choose another --out"):
            open_study(path, plan)
    with pytest.raises(InputError, match="Not a directory"):
        open_study(tmp_path / "mine.toml" / "out", plan)
    with pytest.raises(InputError, match="differs in its recipes"):  # where the recipes are
        check_folder(recipe_path("chapter6/study", "study").parent, plan)


def test_a_folder_that_another_process_directs_is_refused(folder, plan):
    with pytest.raises(InputError, match="is being written by another coevo process"):
        open_study(folder.path, plan)
    folder.close()
    open_study(folder.path, plan).close()


def test_a_lock_that_cannot_be_written_is_told_with_the_command_of_studies(plan, tmp_path):
    (tmp_path / "locked" / ".lock").mkdir(parents=True)
    with pytest.raises(InputError, match=r"cannot write .*locked.*; mend this and give the same command again$"):
        open_study(tmp_path / "locked", plan)


def test_flags_of_those_who_were_killed_go(folder, plan):
    left = folder.flag
    folder._release()  # as of a process that is gone
    again = open_study(folder.path, plan)
    assert not left.exists()
    assert again.flag.exists()
    again.close()
    assert not again.flag.exists()
