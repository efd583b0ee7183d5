"""Run folders: the same bytes whatever plays the games and wherever a run is killed, and damage that is told."""

from __future__ import annotations

import errno
import gc
import hashlib
import itertools
import json
import re
import shutil
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from coevo.config import RunSettings, check, read_toml
from coevo.errors import InputError
from coevo.files import digest_of
from coevo.game import function_set
from coevo.records import Checkpoint, Origins
from coevo.run import Run, create_run, open_run
from coevo.tree import Tree, from_codes

WRITES = ("generations.csv", "measures.csv", "part", "checkpoint.npz")  # of one generation, in their order


class Killed(BaseException):
    """Stands for a kill: nothing of the program catches it, nothing cleans up."""


@pytest.fixture
def kill_at(monkeypatch):
    """Return a function that makes a write of a folder the last: the n-th from now, before or after its rename."""

    def arm(folder, number, moment):
        counter = itertools.count()
        rename = Path.replace

        def replace(self, target):
            if folder not in self.parents:
                return rename(self, target)
            here = next(counter) == number
            if here and moment != "renamed":
                data = self.read_bytes()
                self.write_bytes(data[: len(data) // 2] if moment == "half written" else data)
                raise Killed
            done = rename(self, target)
            if here:
                raise Killed
            return done

        monkeypatch.setattr(Path, "replace", replace)

    return arm


@pytest.fixture
def killed_run(small_settings, go_on, tmp_path, kill_at, monkeypatch):
    """Return a function that makes the small run and kills it at a write."""

    def make(number, moment="renamed"):
        run = create_run(tmp_path / "killed", small_settings())
        kill_at(run.path, number, moment)
        with pytest.raises(Killed):
            go_on(run)
        monkeypatch.undo()
        return open_run(run.path)

    return make


@pytest.fixture
def copied_run(small_run, tmp_path):
    """Return a copy of the finished small run, that may be spoilt."""
    shutil.copytree(small_run.path, tmp_path / "copy")
    return open_run(tmp_path / "copy")


# -------------------------------------------------------------------------------------------------- the same bytes


@pytest.mark.parametrize(("workers", "backend"), [(1, "threads"), (2, "threads"), (3, "threads"), (2, "processes")])
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


# --------------------------------------------------------------------------------------------------------- kills


@pytest.mark.parametrize("moment", ["half written", "written", "renamed"])
@pytest.mark.parametrize("number", range(12), ids=lambda n: f"generation {n // 4}, {WRITES[n % 4]}")
def test_a_run_killed_at_any_write_goes_on_to_the_same_bytes(number, moment, small_run, killed_run, go_on, results_of):
    killed = killed_run(number, moment)
    done, write = divmod(number + (moment == "renamed"), 4)
    assert killed.finished == done + (write == 3)  # a part makes a generation
    run = go_on(killed)
    assert results_of(run.path) == results_of(small_run.path)
    assert sorted(path.name for path in run.path.iterdir()) == sorted(path.name for path in small_run.path.iterdir())


def test_a_run_killed_over_and_over_goes_on_to_the_same_bytes(
    small_run, small_settings, go_on, results_of, tmp_path, kill_at, monkeypatch
):
    """Each time it lives for four writes and dies in the fifth: never in the same place of a generation."""
    run = create_run(tmp_path / "run", small_settings())
    kills = 0
    while not run.is_finished:
        kill_at(run.path, 4, "half written" if kills % 2 else "renamed")
        try:
            go_on(open_run(run.path))
        except Killed:
            kills += 1
        monkeypatch.undo()
        assert kills < 20
    assert kills >= 2
    assert results_of(run.path) == results_of(small_run.path)


@pytest.mark.parametrize("number", [3, 6, 7])
def test_parents_and_choices_survive_a_kill(number, small_run, killed_run, go_on):
    """Told apart from the bytes, so that it is seen that they are there."""
    run = go_on(killed_run(number))
    columns = ["operator", "parent_1", "parent_2", "chose_shoot", "chose_pass", "chose_avoid", "chose_search"]
    pd.testing.assert_frame_equal(run.individuals[columns], small_run.individuals[columns])
    assert set(run.individuals["operator"]) >= {"creation", "elite", "crossover"}
    assert run.individuals["operator"].dtype == "category"


@pytest.mark.parametrize("number", [3, 4, 5, 7, 8, 10, 11])
def test_without_its_checkpoint_a_run_goes_on_to_the_same_bytes(number, small_run, killed_run, go_on, results_of):
    killed = killed_run(number)
    (killed.path / "checkpoint.npz").unlink(missing_ok=True)
    run = go_on(killed)
    assert results_of(run.path) == results_of(small_run.path)
    if number < 10:  # else everything was there already
        assert (run.path / "checkpoint.npz").read_bytes() == (small_run.path / "checkpoint.npz").read_bytes()


def test_what_a_kill_left_half_written_is_in_nobodys_way(killed_run):
    """Tables of a killed run are read by pandas before anybody goes on with it."""
    killed = killed_run(6, "half written")  # the part of generation 1
    assert len(killed.individuals) == 18
    assert killed.generations["generation"].max() == 1  # whole or not at all: its rows come before its part
    assert [path.name for path in killed.path.rglob("*.partial")] or [
        path.name for path in killed.path.rglob(".*part*")
    ]


def test_pandas_reads_the_individuals_of_a_killed_run(killed_run):
    killed = killed_run(6, "half written")
    assert len(pd.read_parquet(killed.path / "individuals.parquet")) == 18


def test_a_finished_run_is_left_as_it_is(copied_run, small_run, go_on, results_of):
    reports = []
    run = go_on(copied_run, report=reports.append)
    assert reports == []
    assert run.is_finished
    assert results_of(run.path) == results_of(small_run.path)


def test_a_kill_between_the_first_files_leaves_a_run_that_goes_on(
    small_settings, small_run, go_on, results_of, tmp_path, kill_at
):
    kill_at(tmp_path / "run", 0, "renamed")  # the configuration is there, the environment is not
    with pytest.raises(Killed):
        create_run(tmp_path / "run", small_settings())
    run = go_on(open_run(tmp_path / "run"))
    assert results_of(run.path) == results_of(small_run.path)
    assert (run.path / "environment.json").exists()


# ---------------------------------------------------------------------------------------------------- full disks


@pytest.mark.parametrize("number", range(8))
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
    assert len(open_run(run.path).individuals) == (number + 1) // 4 * 18
    assert results_of(go_on(open_run(run.path)).path) == results_of(small_run.path)


def test_a_folder_that_cannot_be_made_is_told(small_settings, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="Not a directory") as caught:
        create_run(tmp_path / "file" / "run", small_settings())
    assert str(tmp_path / "file" / "run") in str(caught.value)
    assert "choose another --out" in str(caught.value)


# ---------------------------------------------------------------------------------------------------- checkpoints

REMEDY = "delete it and resume again: it is made anew from individuals.parquet"


def refused(run):
    """Return how the checkpoint is refused; it must name the file and what to do."""
    with pytest.raises(InputError) as caught:
        run.checkpoint()
    message = str(caught.value)
    assert message.startswith(f"{run.path / 'checkpoint.npz'} ")
    assert message.endswith(REMEDY)
    assert "\n" not in message
    return message


def npy(path):
    with path.open("wb") as file:
        np.save(file, np.arange(5))


DAMAGES = {
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_text("not an archive\n" * 9),
    "cut in half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "one byte short": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "only a header": lambda path: path.write_bytes(path.read_bytes()[:4]),
    "an archive of nothing": lambda path: zipfile.ZipFile(path, "w").close(),
    "a single array": npy,
}


@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(
            name,
        )
        if name == "a single array"
        else name
        for name in DAMAGES
    ],
)
def test_a_damaged_checkpoint_is_named_with_the_remedy(damage, copied_run):
    DAMAGES[damage](copied_run.path / "checkpoint.npz")
    assert "is damaged" in refused(copied_run)


def test_a_damaged_checkpoint_is_not_left_open(copied_run):
    path = copied_run.path / "checkpoint.npz"
    path.write_bytes(path.read_bytes()[:100])
    gc.collect()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        refused(copied_run)
        gc.collect()
    assert [str(warning.message) for warning in told] == []


@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
def test_the_remedy_for_a_damaged_checkpoint_works(killed_run, go_on, small_run, results_of):
    killed = killed_run(7)
    path = killed.path / "checkpoint.npz"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match=re.escape(REMEDY)):
        go_on(killed)
    path.unlink()
    assert results_of(go_on(killed).path) == results_of(small_run.path)


def same(one, other):
    return one.generation == other.generation and all(
        [tree.tolist() for tree in one.populations[robot]] == [tree.tolist() for tree in other.populations[robot]]
        and one.origins[robot].operator.tolist() == other.origins[robot].operator.tolist()
        and one.origins[robot].parents.tolist() == other.origins[robot].parents.tolist()
        for robot in other.populations
    )


def spoilt(path, flip, step, read):
    """Flip bits of a byte here and there; yield what ``read`` gives then, or how it fails."""
    data = path.read_bytes()
    for position in range(0, len(data), step):
        path.write_bytes(data[:position] + bytes([data[position] ^ flip]) + data[position + 1 :])
        try:
            yield position, read()
        except Exception as error:  # noqa: BLE001 - which it is, is what is tested
            yield position, f"{type(error).__name__}: {error}"
    path.write_bytes(data)


@pytest.mark.usefixtures("collected")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # numpy leaves what it refuses open
@pytest.mark.parametrize(("flip", "step"), [(0x01, 1), (0x80, 3), (0xFF, 5)])
@pytest.mark.slow
def test_a_flipped_byte_of_a_checkpoint_is_noticed_wherever_it_is(flip, step, copied_run):
    """Bytes that mean nothing, such as times in the archive, may change; contents may not."""
    path = copied_run.path / "checkpoint.npz"
    right = copied_run.checkpoint()
    told, wrong = 0, []
    for position, found in spoilt(path, flip, step, copied_run.checkpoint):
        if isinstance(found, Checkpoint):
            if not same(found, right):
                wrong.append(f"{position}: other contents")
        elif found.startswith(f"InputError: {path}"):
            told += 1
        else:
            wrong.append(f"{position}: {found}")
    assert wrong == []
    assert told > path.stat().st_size // step // 2


def test_a_flipped_byte_of_a_part_is_noticed_wherever_it_is(copied_run):
    path = copied_run.path / "individuals.parquet" / "part-00001.parquet"
    right = copied_run.record(1, "r0").to_csv()
    wrong = [
        f"{position}: {found if found.partition(':')[0].isidentifier() else 'other contents'}"
        for position, found in spoilt(path, 0x20, 7, lambda: copied_run.record(1, "r0").to_csv())
        if found != right and not found.startswith(f"InputError: {path}")
    ]
    assert wrong == []


def test_the_checkpoint_of_another_run_is_refused(copied_run, small_settings, go_on, tmp_path):
    other = go_on(create_run(tmp_path / "other", small_settings("seed=5")))
    shutil.copy(other.path / "checkpoint.npz", copied_run.path)
    assert "belongs to another run: its settings are not those of config.toml" in refused(copied_run)


def rewritten(run, changed):
    """Write the checkpoint with other arrays, and a digest that is right for them."""
    path = run.path / "checkpoint.npz"
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files if name != "digest"}
    arrays |= changed
    arrays = {name: array for name, array in arrays.items() if array is not None}
    np.savez(path, **arrays, digest=digest_of(arrays))


def test_a_checkpoint_of_another_format_is_refused(copied_run):
    rewritten(copied_run, {"format": np.array([99])})
    assert "has format 99, this version reads 2" in refused(copied_run)


def without_ancestry(run):
    """Make a run one that was written before individuals had parents."""
    rewritten(run, {"format": np.array([1]), "parts": np.zeros(0, np.uint8)})
    for path in (run.path / "individuals.parquet").iterdir():
        table = pq.read_table(path)
        pq.write_table(table.select(table.column_names[: table.column_names.index("tree") + 1]), path)


def test_a_run_without_ancestry_can_be_read_but_not_gone_on_with(copied_run, go_on, small_run):
    without_ancestry(copied_run)
    assert copied_run.tree("r1", 2, 3) == small_run.tree("r1", 2, 3)
    assert {record.origins for record in copied_run.records(1)} == {None}
    (copied_run.path / "individuals.parquet" / "part-00002.parquet").unlink()
    for named in ("checkpoint.npz", "individuals.parquet/part-00001.parquet"):
        with pytest.raises(InputError, match=r"written by an older coevo.* can be read, but not gone on with") as told:
            go_on(copied_run)
        assert str(told.value).startswith(str(copied_run.path / named))
        (copied_run.path / "checkpoint.npz").unlink(missing_ok=True)


@pytest.mark.parametrize("name", ["codes_1", "operator_0", "parents_2"])
def test_a_checkpoint_that_lacks_something_is_refused(name, copied_run):
    rewritten(copied_run, {name: None})
    assert "is damaged" in refused(copied_run)


def test_a_checkpoint_can_be_written_and_read(small_settings, tmp_path):
    run = create_run(tmp_path / "run", small_settings())
    assert run.checkpoint() is None
    trees = {robot: [np.arange(n, dtype=np.uint8) for n in (1, 3, 5)] for robot in range(3)}
    parents = np.array([(-1, -1), (3, -1), (0, 2)], np.int32)
    saved = Checkpoint(7, trees, {robot: Origins(np.array([0, 1, robot], np.uint8), parents) for robot in trees})
    run.save_checkpoint(saved)
    assert same(run.checkpoint(), saved)
    with zipfile.ZipFile(run.path / "checkpoint.npz") as archive:
        assert not [name for name in archive.namelist() if b"\x80\x04" in archive.read(name)[:4]]  # nothing pickled


# ------------------------------------------------------------------------------------------------- other damage


def test_a_damaged_part_is_named(copied_run):
    path = copied_run.path / "individuals.parquet" / "part-00001.parquet"
    path.write_bytes(path.read_bytes()[:-20])
    assert copied_run.tree("r0", 0)
    with pytest.raises(InputError, match=re.escape(str(path)) + ".* is damaged"):
        copied_run.tree("r0", 1)
    with pytest.raises(InputError, match=re.escape(str(path)) + ".* is damaged"):
        _ = copied_run.individuals


def test_a_damaged_configuration_is_named(copied_run):
    path = copied_run.path / "config.toml"
    path.write_text(path.read_text().replace("[gp]", "[gp"))
    with pytest.raises(InputError, match=re.escape(f"{path} is not valid TOML")):
        open_run(copied_run.path)


def test_a_run_does_not_go_on_with_other_settings_than_it_began_with(killed_run, go_on):
    killed = killed_run(7)
    path = killed.path / "config.toml"
    path.write_text(path.read_text().replace("tournament = 2", "tournament = 3"))
    with pytest.raises(InputError, match=r"its settings are not those of config\.toml"):
        go_on(open_run(killed.path))


@pytest.mark.parametrize("content", [b"generation,robot\nx,r0\n", b"\xff\xfe\x00"], ids=["text", "binary"])
def test_a_damaged_table_is_named_when_a_run_goes_on(content, killed_run, go_on):
    killed = killed_run(7)
    (killed.path / "generations.csv").write_bytes(content)
    try:
        go_on(killed)
    except InputError as error:
        assert str(killed.path / "generations.csv") in str(error)  # noqa: PT017 - mending it would be right, too


def test_a_lost_table_is_told_or_made_again(killed_run, go_on, small_run, results_of):
    killed = killed_run(7)
    (killed.path / "generations.csv").unlink()
    try:
        go_on(killed)
    except InputError:
        return
    assert results_of(killed.path) == results_of(small_run.path)


# ------------------------------------------------------------------------------------------------ making and locks


def test_a_folder_with_a_run_is_refused(copied_run, small_settings):
    with pytest.raises(InputError, match=f"{copied_run.path} holds a run already; go on with 'coevo resume"):
        create_run(copied_run.path, small_settings())


def test_a_folder_with_anything_else_is_refused_and_left_alone(small_settings, tmp_path):
    (tmp_path / "diary.txt").write_text("mine")
    with pytest.raises(InputError, match="is not an empty folder; choose another --out"):
        create_run(tmp_path, small_settings())
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


def test_an_empty_folder_is_taken(small_settings, tmp_path):
    (tmp_path / "empty").mkdir()
    run = create_run(tmp_path / "empty", small_settings())
    assert open_run(run.path).config == run.config


def test_a_missing_skill_leaves_nothing_behind(small_settings, tmp_path):
    with pytest.raises(InputError, match="there is no skill file"):
        create_run(tmp_path / "run", small_settings(f"skills.shoot='{tmp_path}/none.npz'"))
    assert not (tmp_path / "run").exists()


def test_a_run_is_written_by_one_at_a_time(copied_run):
    release = copied_run.lock()
    with pytest.raises(InputError, match="is being written by another coevo process; wait for it or stop it"):
        Run(copied_run.path, copied_run.config).lock()
    release()
    Run(copied_run.path, copied_run.config).lock()()


def test_the_environment_names_versions_and_skills(small_run):
    about = json.loads((small_run.path / "environment.json").read_text())
    assert set(about) >= {"python", "platform", "versions", "commit", "skills"}
    assert about["versions"]["numpy"] == np.__version__
    assert set(about["skills"]) == {"shoot", "pass", "avoid", "search"}
    for digest in about["skills"].values():
        assert len(bytes.fromhex(digest)) == hashlib.sha256().digest_size


# ------------------------------------------------------------------------------------------------------- reading


def test_open_run_gives_what_was_written(small_run, small_settings):
    run = open_run(str(small_run.path))
    assert run.config == small_settings()
    assert run.finished == 3
    pd.testing.assert_frame_equal(run.generations, pd.read_csv(run.path / "generations.csv"))
    pd.testing.assert_frame_equal(run.individuals, pd.read_parquet(run.path / "individuals.parquet"))


def test_trees_are_ranked_by_fitness_then_depth_then_place(small_run):
    table = small_run.individuals
    for generation, robot in itertools.product(range(3), ("r0", "r1", "r2")):
        rows = table[(table.generation == generation) & (table.robot == robot)]
        ranked = sorted(rows.itertuples(), key=lambda row: (row.fitness, row.depth, row.index))
        functions = function_set(int(robot[1:]), 3)
        for rank, row in enumerate(ranked):
            tree = small_run.tree(robot, generation, rank)
            assert isinstance(tree, Tree)
            assert tree == from_codes(row.tree, functions)
        assert small_run.tree(robot, generation) == small_run.tree(robot, generation, rank=0)


@pytest.mark.parametrize(
    ("robot", "generation", "rank", "message"),
    [
        ("r3", 0, 0, "'r3' does not evolve in this run; choose one of r0, r1, r2"),
        ("ball", 0, 0, "'ball' does not evolve in this run; choose one of r0, r1, r2"),
        ("r0", 3, 0, "has no generation 3; finished generations: 0 to 2"),
        ("r0", -1, 0, "has no generation -1; finished generations: 0 to 2"),
        ("r0", 0, 6, "rank must be from 0 to 5, got 6"),
        ("r0", 0, -1, "rank must be from 0 to 5, got -1"),
    ],
)
def test_a_tree_that_is_not_there_is_told_with_what_is(robot, generation, rank, message, small_run):
    with pytest.raises(InputError, match=re.escape(message)):
        small_run.tree(robot, generation, rank)


def test_a_robot_that_stands_has_no_trees(small_settings, go_on, tmp_path):
    run = go_on(create_run(tmp_path / "run", small_settings("gp.generations=1", preset="stationary-opponent")))
    with pytest.raises(InputError, match="'r2' does not evolve in this run; choose one of r0, r1"):
        run.tree("r2", 0)


def test_a_run_without_a_generation_is_empty(small_settings, tmp_path):
    run = create_run(tmp_path / "run", small_settings())
    assert (run.finished, run.is_finished, len(run.individuals), len(run.generations)) == (0, False, 0, 0)
    assert list(run.generations)[:2] == ["generation", "robot"]
    with pytest.raises(InputError, match="has no generation 0; finished generations: none yet"):
        run.tree("r0", 0)


@pytest.mark.parametrize("name", ["nowhere", "."])
def test_what_is_no_run_is_told_how_to_start_one(name, tmp_path):
    with pytest.raises(InputError, match="start a run with 'coevo evolve'") as caught:
        open_run(tmp_path / name)
    assert str(tmp_path) in str(caught.value)
