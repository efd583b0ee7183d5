"""coevo study as people meet it: what is done is skipped, what was cut short goes on, what fails is named."""

from __future__ import annotations

import json
import shutil

import pandas as pd
import pytest

from coevo.chain import Chain, rows_digest
from coevo.cli import studying
from coevo.recipes import recipe_path
from coevo.run import open_run
from coevo.study import cluster, evolving
from coevo.study.plan import read_plan

FAILS = "def late(measures, *, generation, **_):\n    return [measures['goals']][generation]\n"


@pytest.fixture(scope="module")
def finished(finished_study):
    """Return the folder of a finished study: only to be read."""
    return finished_study()


@pytest.fixture
def done(finished, tmp_path):
    """Return the folder of a copy of it."""
    return shutil.copytree(finished, tmp_path / "out")


def test_a_row_says_what_coevo_evolve_says_of_that_run(done, coevo, tmp_path, results_of):
    table = pd.read_csv(done / "table.csv")
    assert table["run"].tolist() == [f"smoke-{kind}-seed{seed}" for kind in ("fixed", "varying") for seed in (0, 1)]
    row = table.iloc[3]
    said = coevo("evolve", done / row["run"] / "config.toml", "--out", tmp_path / "alone", "--json", "--quiet")
    told = json.loads(said.out)
    assert results_of(tmp_path / "alone") == results_of(done / row["run"])
    for robot, best in told["robots"].items():
        assert [row[f"{robot}_{key}"] for key in ("best_fitness", "depth", "nodes")] == [
            best[key] for key in ("best_fitness", "depth", "nodes")
        ]
    for one in told["unseen"]:
        for who in ("last", "first", "single_skills"):
            assert row[f"team{one['team']}_{who}"] == one[who][0]
    run = open_run(done / row["run"])  # shares of decisions, mean over the champions of a team
    for team, robots in ((0, ["r0", "r1"]), (1, ["r2"])):
        best = [run.record(2, robot).iloc[0] for robot in robots]
        for skill in run.game.function_set(0).terminals:
            use = [one[f"chose_{skill}"] / one.filter(like="chose_").sum() for one in best]
            assert row[f"team{team}_use_{skill}"] == pytest.approx(sum(use) / len(use))
            assert [row[f"{robot}_use_{skill}"] for robot in robots] == pytest.approx(use)


def test_a_table_that_was_altered_is_told_by_a_check_and_made_anew(done, coevo, study_file):
    assert coevo("check", done).code == 0
    table, whole = done / "table.csv", (done / "table.csv").read_bytes()
    table.write_bytes(whole.replace(b"0.", b"1.", 1))
    said = coevo("check", done)
    assert (said.code, f"damaged  {table}" in said.out) == (1, True)
    assert coevo("study", study_file(), "--out", done).code == 0
    assert table.read_bytes() == whole


def forge(run):
    """Put the digests of altered rows into the chain, as nobody does by accident."""
    lines, chain = (run / "generations.csv").read_text().splitlines()[1:], Chain.read((run / "digests.txt").read_text())
    rows = {f"generations.csv {g}": rows_digest(lines[3 * g : 3 * g + 3]) for g in range(3)}
    (run / "digests.txt").write_text(Chain().extended({**chain.digests, **rows}).text())
    (run / "checkpoint.npz").unlink()


def test_a_row_says_what_coevo_settlements_says_of_that_run(done, coevo, study_file, here):
    ahead = done / "smoke-fixed-seed1"  # as if r2 had had more goals than the others from generation 1 on
    goals = pd.read_csv(ahead / "generations.csv")
    goals.loc[(goals["robot"] == "r2") & (goals["generation"] > 0), "goals"] = 99
    goals.loc[goals["generation"] == 0, "goals"] = 0
    goals.to_csv(ahead / "generations.csv", index=False)
    forge(ahead)
    (ahead / "study.json").unlink()
    assert coevo("study", study_file(), "--out", done).code == 0
    assert here == [ahead.name]
    table = pd.read_csv(done / "table.csv").set_index("run")
    assert (table.loc[ahead.name, "took_over"], table.loc[ahead.name, "take_over"]) == (1, 1)
    for name, row in table.iterrows():
        shutil.rmtree(done / name / "results")  # so that the games are played again
        (told,) = json.loads(coevo("settlements", done / name, "--games", 40, "--json").out)["runs"]
        measured = [key for key in told if key.startswith("settled_") or key == "take_over"]
        assert len(measured) == 8
        assert {key: row.get(key) if pd.notna(row.get(key)) else None for key in measured} == {
            key: told[key] for key in measured
        }
        assert row["took_over"] == (told["take_over"] is not None)


def test_the_summary_tells_of_how_many_runs_a_figure_is(study_file):
    plan = read_plan(str(study_file(vary="", head='recipes = ["smoke"]\nseeds = 4')))
    rows = {run.name: {"team1_last": share, "took_over": 0} for run, share in zip(plan.runs, (0, 0, 1, 1), strict=True)}
    rows["smoke-seed1"] |= {"took_over": 1, "take_over": 4.0}
    rows["smoke-seed3"] |= {"took_over": 1, "take_over": 10.0}
    shares, settled, take_over = studying._summary(plan, rows).split("\n\n")
    half = "0.500 [0.000, 1.000]"  # Student's t with 3 degrees of freedom: 0.5 +- 3.182 * 0.577 / 2, cut at 0 and 1
    assert shares.splitlines()[1].split(maxsplit=4) == ["smoke", "4", "of", "4", half]
    assert settled.splitlines()[1].split(maxsplit=4) == ["smoke", "4", "of", "4", half]
    assert settled.splitlines()[0].split() == ["condition", "runs", "took_over"]
    # with 1 degree of freedom: 7 +- 12.706 * 4.243 / sqrt(2), cut at the first generation
    assert take_over.splitlines()[1].split(maxsplit=4)[-1] == "7.000 [0.000, 45.119] (2 of 4)"


def test_what_is_done_is_skipped_and_more_seeds_may_be_added(done, coevo, study_file, here):
    before = (done / "table.csv").read_bytes()
    again = json.loads(coevo("study", study_file(), "--out", done, "--json").out)
    assert (again["runs"], again["skipped"], again["failed"], again["table"]) == (4, 4, 0, str(done / "table.csv"))
    assert here == []
    assert (done / "table.csv").read_bytes() == before
    more = json.loads(coevo("study", study_file(), "--out", done, "--seeds", 3, "--json").out)
    assert (more["runs"], more["skipped"]) == (6, 4)
    assert here == ["smoke-fixed-seed2", "smoke-varying-seed2"]
    assert (done / "table.csv").read_bytes().splitlines()[1:3] == before.splitlines()[1:3]


def test_what_was_cut_short_goes_on_to_the_same_bytes(done, coevo, study_file, here):
    before = (done / "table.csv").read_bytes()
    (done / "table.csv").unlink()
    cut = done / "smoke-varying-seed0"  # as if killed after a generation
    (cut / "study.json").unlink()
    for path in sorted((cut / "individuals.parquet").iterdir())[1:]:
        path.unlink()
    shutil.rmtree(cut / "results")
    (cut / "checkpoint.npz").unlink()
    first = (cut / "individuals.parquet" / "part-00000.parquet").stat()
    begun = done / "smoke-fixed-seed1"  # as if killed before its settings were written
    shutil.rmtree(begun)
    begun.mkdir()
    (begun / "own.py").touch()
    again = json.loads(coevo("study", study_file(), "--out", done, "--json").out)
    assert (again["skipped"], again["failed"]) == (2, 0)
    assert here == ["smoke-fixed-seed1", "smoke-varying-seed0"]
    assert (cut / "individuals.parquet" / "part-00000.parquet").stat().st_mtime_ns == first.st_mtime_ns
    assert (done / "table.csv").read_bytes() == before


def test_a_run_that_lost_generations_is_not_taken_for_done(done, coevo, study_file, here):
    before = (done / "table.csv").read_bytes()
    (done / "smoke-fixed-seed0" / "individuals.parquet" / "part-00002.parquet").unlink()
    told = json.loads(coevo("study", study_file(), "--out", done, "--json").out)
    assert (told["skipped"], told["failed"]) == (3, 1)
    assert "has lost generations that its checkpoint tells of; remove this folder" in told["failures"][0]["reason"]
    shutil.rmtree(done / "smoke-fixed-seed0")
    assert coevo("study", study_file(), "--out", done).code == 0
    assert here == ["smoke-fixed-seed0"] * 2
    assert (done / "table.csv").read_bytes() == before


def test_a_measure_that_is_new_is_measured_of_finished_runs(done, coevo, study_file, monkeypatch, here):
    monkeypatch.setitem(evolving._MEASURES, "extra", lambda of: {"extra": of.run.finished})
    assert json.loads(coevo("study", study_file(), "--out", done, "--json").out)["skipped"] == 0
    assert len(here) == 4
    assert pd.read_csv(done / "table.csv")["extra"].tolist() == [3] * 4


@pytest.mark.usefixtures("here")
def test_a_run_that_fails_is_named_while_the_others_finish(coevo, study_file, tmp_path):
    (tmp_path / "own.py").write_text(FAILS)
    shutil.copy(recipe_path("smoke", "evolution"), tmp_path / "small.toml")
    study = study_file('recipes = ["small.toml"]\nseeds = 2', '[vary]\n"fitness.kind" = ["own:late", "fixed"]')
    said = coevo("study", study, "--out", tmp_path / "out", "--json")
    assert said.code == 1
    told = json.loads(said.out)
    assert (told["runs"], told["failed"]) == (4, 2)
    assert [one["run"] for one in told["failures"]] == ["small-own-late-seed0", "small-own-late-seed1"]
    assert "2 runs failed; the same command tries them again:" in said.err
    for one in told["failures"]:
        assert "own:late failed: IndexError" in one["reason"]
        assert one["run"] in said.err
    assert pd.read_csv(tmp_path / "out" / "table.csv")["run"].tolist() == ["small-fixed-seed0", "small-fixed-seed1"]
    assert pd.read_csv(tmp_path / "out" / "failed.csv")["run"].tolist() == [one["run"] for one in told["failures"]]
    assert coevo("study", study, "--out", tmp_path / "out").code == 1  # they are tried again


@pytest.mark.usefixtures("here")
def test_a_run_of_other_settings_in_its_place_is_a_failure(done, coevo, study_file, small_run):
    shutil.rmtree(done / "smoke-fixed-seed0")
    shutil.copytree(small_run.path, done / "smoke-fixed-seed0")
    (done / "smoke-fixed-seed0" / "config.toml").write_text(
        (small_run.path / "config.toml").read_text().replace("seed = 0", "seed = 8")
    )
    said = coevo("study", study_file(), "--out", done, "--json")
    assert said.code == 1
    (failure,) = json.loads(said.out)["failures"]
    assert "smoke-fixed-seed0 holds a run of other settings" in failure["reason"]


def test_the_summary_has_a_line_a_condition(done, coevo, study_file):
    lines = coevo("study", study_file(), "--out", done, "--quiet").out.splitlines()
    assert [line.split()[:4] for line in lines[1:3]] == [
        ["smoke-fixed", "2", "of", "2"],
        ["smoke-varying", "2", "of", "2"],
    ]
    assert lines[-1] == f"4 of 4 runs are in {done / 'table.csv'}"


def test_without_the_library_it_is_told_what_to_install(coevo, study_file, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster.importlib.util, "find_spec", lambda _: None)
    said = coevo("study", study_file(), "--out", tmp_path / "out", "--scheduler", "local")
    assert said.code == 2
    assert "pip install 'coevo[cluster]'" in said.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("address", ["nonsense", "", "x://host:1", "tcp://127.0.0.1:1"])
def test_a_scheduler_that_is_not_there_is_told(address, coevo, study_file, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_REACH_S", 1)
    said = coevo("study", study_file(), "--out", tmp_path / "out", "--scheduler", address)
    assert said.code == 2
    assert f"cannot reach a Dask scheduler at '{address}'" in said.err
    assert "'dask scheduler'" in said.err
    assert not (tmp_path / "out").exists()


def test_a_table_that_a_kill_kept_from_being_written_is_written(done, coevo, study_file, here):
    before = (done / "table.csv").read_bytes()
    (done / "table.csv").write_bytes(b"".join(before.splitlines(keepends=True)[:2]))
    assert coevo("study", study_file(), "--out", done).code == 0
    assert here == []
    assert (done / "table.csv").read_bytes() == before


LEARNS = 'kind = "study"\nrecipes = ["quick.toml"]\nseeds = 1\n[set]\ntrials = 250\n"experience.windows" = 300\n'
QUICK = 'kind = "skill"\nname = "quick"\ntask = "search"\n[[objects]]\nkind = "ball"\norder = 2\nhistory_length = 2\n'


@pytest.fixture
def learning(tmp_path, monkeypatch):
    """Write, where one is, the studies first.toml and second.toml, which needs a skill that the first learns."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quick.toml").write_text(QUICK)
    needs = 'model_of = "runs/first/quick-seed{seed}/skill.npz"\n'
    (tmp_path / "more.toml").write_text(QUICK.replace("quick", "more").partition("order")[0] + needs)
    (tmp_path / "first.toml").write_text(LEARNS)
    (tmp_path / "second.toml").write_text(LEARNS.replace("quick", "more"))


@pytest.mark.usefixtures("here", "learning")
def test_several_studies_are_done_in_turn_and_a_later_one_may_need_an_earlier_one(coevo, tmp_path):
    both = tmp_path / "first.toml", tmp_path / "second.toml"
    assert coevo("study", *both, "--out", "mine").err.startswith("coevo: --out is the folder of one study, and 2")
    wrong = coevo("study", both[1], both[0])
    assert (wrong.code, (tmp_path / "runs").exists()) == (2, False)
    assert "quick-seed0/skill.npz" in wrong.err
    assert coevo("study", both[0], "nothing.toml").code == 2
    (tmp_path / "typo.toml").write_text(LEARNS.replace("trials", "trails"))
    assert "Did you mean 'trials'?" in coevo("study", both[0], tmp_path / "typo.toml").err
    assert not (tmp_path / "runs").exists()
    said = coevo("study", *both, "--json")
    assert said.code == 0
    assert "second.toml is read again when the studies before it are done" in said.err
    told = json.loads(said.out)["studies"]
    assert [(one["study"], one["runs"], one["failed"]) for one in told] == [("runs/first", 1, 0), ("runs/second", 1, 0)]
    again = coevo("study", *both, "--json")
    assert [one["skipped"] for one in json.loads(again.out)["studies"]] == [1, 1]
    assert "read again" not in again.err


def test_only_the_runs_that_match_are_done_and_the_rest_come_to_the_same_table(finished, coevo, study_file, tmp_path):
    out = tmp_path / "part"
    said = coevo("study", study_file(), "--out", out, "--only", "*-varying-seed1", "--only", "*-varying-seed0")
    assert (said.code, "2 runs to do, 0 are done" in said.err) == (0, True)
    assert pd.read_csv(out / "table.csv")["run"].tolist() == ["smoke-varying-seed0", "smoke-varying-seed1"]
    assert not list(out.glob("smoke-fixed-*"))
    said = coevo("study", study_file(), "--out", out)
    assert (said.code, "2 runs to do, 2 are done" in said.err) == (0, True)
    assert (out / "table.csv").read_bytes() == (finished / "table.csv").read_bytes()


def test_a_pattern_that_matches_nothing_is_told_and_nothing_is_made(coevo, study_file, tmp_path):
    said = coevo("study", study_file(), "--out", tmp_path / "none", "--only", "*-seed0", "--only", "smok-*")
    assert (said.code, said.out) == (2, "")
    assert "--only smok-*: no run is called so; the first are smoke-fixed-seed0, smoke-fixed-seed1" in said.err
    assert not (tmp_path / "none").exists()


@pytest.mark.usefixtures("here")
def test_what_failed_stands_while_other_runs_are_done(coevo, study_file, tmp_path):
    (tmp_path / "own.py").write_text(FAILS)
    shutil.copy(recipe_path("smoke", "evolution"), tmp_path / "small.toml")
    study = study_file('recipes = ["small.toml"]\nseeds = 2', '[vary]\n"fitness.kind" = ["own:late", "fixed"]')
    failed = tmp_path / "out" / "failed.csv"
    assert coevo("study", study, "--out", tmp_path / "out", "--only", "*-late-seed1").code == 1
    before = failed.read_bytes()
    assert pd.read_csv(failed)["run"].tolist() == ["small-own-late-seed1"]
    for only in ("*-fixed-seed0", "*-fixed-seed1", "*-fixed-*"):  # the last has nothing to do
        assert coevo("study", study, "--out", tmp_path / "out", "--only", only).code == 0
        assert failed.read_bytes() == before
    assert coevo("study", study, "--out", tmp_path / "out", "--only", "*-late-seed0").code == 1
    assert pd.read_csv(failed)["run"].tolist() == ["small-own-late-seed0", "small-own-late-seed1"]
    assert coevo("study", study, "--out", tmp_path / "out").code == 1
    assert pd.read_csv(failed)["run"].tolist() == ["small-own-late-seed0", "small-own-late-seed1"]


@pytest.mark.usefixtures("here")
def test_a_table_that_lacks_what_only_left_is_incomplete_and_the_whole_study_completes_it(
    done, coevo, study_file, monkeypatch
):
    monkeypatch.setitem(evolving._MEASURES, "extra", lambda of: {"extra": of.run.finished})
    said = coevo("study", study_file(), "--out", done, "--only", "*-fixed-*")
    assert said.code == 0
    assert "2 finished runs, such as smoke-varying-seed0, are to be measured anew and do not match --only" in said.err
    told = f"{done / 'table.csv'} is incomplete (it has no row of smoke-varying-seed0, which is finished)"
    read = coevo("reproduce", "chapter6", done)
    assert (read.code, f"{told}; 'coevo study' without --only completes it" in read.err) == (2, True)
    again = coevo("study", study_file(), "--out", done)
    assert (again.code, "measured anew" in again.err) == (0, False)
    assert coevo("check", done).code == 0
    assert pd.read_csv(done / "table.csv")["extra"].tolist() == [3] * 4


@pytest.fixture
def two_studies(study_file, tmp_path, monkeypatch):
    """Return two studies, whose folders are runs/mine and runs/other."""
    monkeypatch.chdir(tmp_path)
    head = 'recipes = ["two-learners"]\nseeds = 1'
    return study_file(vary=""), study_file(head, vary="", name="other.toml")


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("pattern", "--only none-*: no run is called so; the first are smoke-seed0, smoke-seed1, two-learners-seed0"),
        ("taken", "runs/other exists and is not the folder of a study; choose another --out"),
        ("stem", "a/mine.toml would both go into runs/mine; do them one at a time, with an --out for one of them"),
        ("twice", "mine.toml is given twice; give it once"),
    ],
)
def test_what_is_wrong_of_a_later_study_is_told_before_the_first_begins(
    wrong, told, coevo, here, two_studies, tmp_path
):
    given = list(two_studies)
    if wrong == "pattern":
        given += ["--only", "smoke-*", "--only", "none-*"]
    elif wrong == "taken":
        (tmp_path / "runs" / "other").mkdir(parents=True)
        (tmp_path / "runs" / "other" / "notes.txt").touch()
    elif wrong == "stem":
        (tmp_path / "a").mkdir()
        given[1] = shutil.copy(two_studies[1], tmp_path / "a" / "mine.toml")
    else:
        given[1] = given[0]
    said = coevo("study", *given)
    assert (said.code, said.out, here) == (2, "", [])
    assert said.err.strip().endswith(told)
    assert not (tmp_path / "runs" / "mine").exists()


def test_a_pattern_may_match_in_one_of_several_studies(coevo, here, two_studies, tmp_path):
    said = coevo("study", *two_studies, "--only", "two-learners-*", "--json")
    assert (said.code, here) == (0, ["two-learners-seed0"])
    assert "None of its runs matches --only; it stays as it is: runs/mine" in said.err
    assert [one["study"] for one in json.loads(said.out)["studies"]] == ["runs/other"]
    assert not (tmp_path / "runs" / "mine").exists()


@pytest.mark.usefixtures("here", "learning")
def test_a_pattern_may_be_for_a_study_that_cannot_be_read_yet(coevo, tmp_path):
    patterns = "--only", "quick-*", "--only", "more-*"
    told = coevo("study", "first.toml", "second.toml", *patterns, "--json")
    assert [one["failed"] for one in json.loads(told.out)["studies"]] == [0, 0]
    shutil.rmtree(tmp_path / "runs")
    wrong = coevo("study", "first.toml", "second.toml", *patterns, "--only", "mor-*")
    assert wrong.code == 2  # as soon as it can be known
    assert "--only mor-*: no run is called so; the first are quick-seed0, more-seed0" in wrong.err
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["first"]
