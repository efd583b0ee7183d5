"""The same bytes whatever plays the games, and wherever a run is killed or the disk is full."""

from __future__ import annotations

import errno
import itertools

import pandas as pd
import pytest

from coevo.config import RunSettings, check, read_toml
from coevo.errors import InputError
from coevo.run import create_run, open_run

WRITES = (
    "digests.txt",
    "generations.csv",
    "measures.csv",
    "part",
    "checkpoint.npz",
)  # of one generation, in their order


@pytest.mark.parametrize(
    ("workers", "backend"),
    [(1, "threads"), (2, "threads"), (3, "threads"), pytest.param(2, "processes", marks=pytest.mark.slow)],
)
def test_workers_change_no_byte(workers, backend, small_run, small_settings, go_on, results_of, tmp_path):
    run = go_on(create_run(tmp_path / "run", small_settings()), workers=workers, backend=backend)
    assert results_of(run.path) == results_of(small_run.path)
    assert (run.path / "checkpoint.npz").read_bytes() == (small_run.path / "checkpoint.npz").read_bytes()


def test_another_seed_is_another_run(small_run, small_settings, go_on, results_of, tmp_path):
    run = go_on(create_run(tmp_path / "run", small_settings("seed=1")))
    one, other = results_of(run.path), results_of(small_run.path)
    assert one.keys() == other.keys()
    assert all(one[name] != other[name] for name in one)


def test_the_stored_configuration_repeats_the_run(small_run, go_on, results_of, tmp_path):
    path = small_run.path / "config.toml"
    again = go_on(create_run(tmp_path / "again", check(RunSettings, read_toml(path), str(path))))
    assert results_of(again.path) == results_of(small_run.path)
    assert (again.path / "config.toml").read_bytes() == path.read_bytes()


def test_more_generations_begin_like_fewer(small_run, small_settings, go_on, results_of, tmp_path):
    """The fitness is fixed: a run's length changes nothing that came before."""
    longer = results_of(go_on(create_run(tmp_path / "run", small_settings("gp.generations=4"))).path)
    shorter = results_of(small_run.path)
    for name in ("generations.csv", "measures.csv"):
        assert longer.pop(name).startswith(shorter.pop(name))
    assert len(longer) == len(shorter) + 1
    assert shorter.items() < longer.items()


@pytest.mark.parametrize("moment", ["half written", "written", "renamed"])
@pytest.mark.parametrize("number", range(15), ids=lambda n: f"generation {n // 5}, {WRITES[n % 5]}")
def test_a_run_killed_at_any_write_goes_on_to_the_same_bytes(number, moment, small_run, killed_run, go_on, results_of):
    killed = killed_run(number, moment)
    done, write = divmod(number + (moment == "renamed"), 5)
    assert killed.finished == done + (write == 4)  # a part makes a generation
    run = go_on(killed)
    assert results_of(run.path) == results_of(small_run.path)
    assert sorted(path.name for path in run.path.iterdir()) == sorted(path.name for path in small_run.path.iterdir())


def test_a_run_killed_over_and_over_goes_on_to_the_same_bytes(
    small_run, small_settings, go_on, results_of, tmp_path, kill_at, killed_error, monkeypatch
):
    """Each time it lives for five writes and dies in the sixth: never in the same place of a generation."""
    run = create_run(tmp_path / "run", small_settings())
    kills = 0
    while not run.is_finished:
        kill_at(run.path, 5, "half written" if kills % 2 else "renamed")
        try:
            go_on(open_run(run.path))
        except killed_error:
            kills += 1
        monkeypatch.undo()
        assert kills < 20
    assert kills >= 2
    assert results_of(run.path) == results_of(small_run.path)


@pytest.mark.parametrize("number", [4, 8, 9])
def test_parents_and_choices_survive_a_kill(number, small_run, killed_run, go_on):
    """Told apart from the bytes, so that it is seen that they are there."""
    run = go_on(killed_run(number))
    columns = ["operator", "parent_1", "parent_2", "chose_shoot", "chose_pass", "chose_avoid", "chose_search"]
    pd.testing.assert_frame_equal(run.individuals[columns], small_run.individuals[columns])
    assert set(run.individuals["operator"]) >= {"creation", "elite", "crossover"}
    assert run.individuals["operator"].dtype == "category"


@pytest.mark.parametrize("number", [4, 5, 6, 9, 10, 13, 14])
def test_without_its_checkpoint_a_run_goes_on_to_the_same_bytes(number, small_run, killed_run, go_on, results_of):
    killed = killed_run(number)
    (killed.path / "checkpoint.npz").unlink(missing_ok=True)
    run = go_on(killed)
    assert results_of(run.path) == results_of(small_run.path)
    if number < 13:  # else everything was there already
        assert (run.path / "checkpoint.npz").read_bytes() == (small_run.path / "checkpoint.npz").read_bytes()


def test_what_a_kill_left_half_written_is_in_nobodys_way(killed_run):
    """Tables of a killed run are read by pandas before anybody goes on with it."""
    killed = killed_run(8, "half written")  # the part of generation 1
    assert len(killed.individuals) == 18
    assert killed.generations["generation"].max() == 1  # whole or not at all: its rows come before its part
    assert [path.name for path in killed.path.rglob("*.partial")] or [
        path.name for path in killed.path.rglob(".*part*")
    ]


def test_pandas_reads_the_individuals_of_a_killed_run(killed_run):
    killed = killed_run(8, "half written")
    assert len(pd.read_parquet(killed.path / "individuals.parquet")) == 18


def test_a_finished_run_is_left_as_it_is(copied_run, small_run, go_on, results_of):
    reports = []
    run = go_on(copied_run, report=reports.append)
    assert reports == []
    assert run.is_finished
    assert results_of(run.path) == results_of(small_run.path)


@pytest.mark.parametrize("number", range(12))
def test_a_kill_between_the_first_files_leaves_a_folder_that_is_taken_again(
    number, small_settings, small_run, tmp_path, kill_at, killed_error, monkeypatch
):
    kill_at(tmp_path / "run", number, "half written" if number % 2 else "renamed")  # the configuration is the last
    with pytest.raises(killed_error):
        create_run(tmp_path / "run", small_settings())
    monkeypatch.undo()
    with pytest.raises(InputError, match="was stopped before the run was begun"):
        open_run(tmp_path / "run")
    (tmp_path / "run" / "mine.txt").touch()
    with pytest.raises(InputError, match="is not an empty folder"):
        create_run(tmp_path / "run", small_settings())
    (tmp_path / "run" / "mine.txt").unlink()
    create_run(tmp_path / "run", small_settings())
    for name in ("config.toml", "environment.json", "skills/kept.json"):
        assert (tmp_path / "run" / name).read_bytes() == (small_run.path / name).read_bytes()


@pytest.mark.parametrize("number", range(22))  # a file and its folder are synced for each write
def test_no_space_left_is_told_and_what_was_saved_is_intact(
    number, small_run, small_settings, go_on, results_of, tmp_path, monkeypatch
):
    run = create_run(tmp_path / "run", small_settings())
    counter = itertools.count()

    def full(_):
        if next(counter) >= number:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("coevo.files.os.fsync", full)
    with pytest.raises(InputError, match="No space left on device") as caught:
        go_on(run)
    monkeypatch.undo()
    message = str(caught.value)
    assert message.startswith(f"cannot write {run.path}")
    assert "go on with 'coevo resume'" in message
    assert not list(run.path.rglob("*partial*"))
    # The folder of the parts is synced, too, when it is made; a part has its name when its own sync is through.
    assert len(open_run(run.path).individuals) == (number + 2) // 10 * 18
    assert results_of(go_on(open_run(run.path)).path) == results_of(small_run.path)


def test_a_folder_that_cannot_be_made_is_told(small_settings, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="Not a directory") as caught:
        create_run(tmp_path / "file" / "run", small_settings())
    assert str(tmp_path / "file" / "run") in str(caught.value)
    assert "choose another --out" in str(caught.value)
