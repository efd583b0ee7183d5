"""Checkpoints: what is damaged, of another run or of another version is told with the remedy."""

from __future__ import annotations

import gc
import re
import shutil
import warnings
import zipfile

import numpy as np
import pyarrow.parquet as pq
import pytest

import coevo.run
import coevo.run_reader
from coevo.errors import InputError
from coevo.files import digest_of
from coevo.records import Checkpoint, Origins
from coevo.run import create_run, open_run

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
    killed = killed_run(9)
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
    assert "has format 99, this version reads 3" in refused(copied_run)


def without_ancestry(run):
    """Make a run one that was written before individuals had parents."""
    rewritten(run, {"format": np.array([1]), "parts": np.zeros(0, np.uint8)})
    (run.path / "digests.txt").unlink()
    for path in (run.path / "individuals.parquet").iterdir():
        table = pq.read_table(path)
        pq.write_table(table.select(table.column_names[: table.column_names.index("tree") + 1]), path)


def test_a_run_without_ancestry_can_be_read_but_not_gone_on_with(copied_run, go_on, small_run):
    without_ancestry(copied_run)
    assert copied_run.tree("r1", 2, 3) == small_run.tree("r1", 2, 3)
    assert {record.origins for record in copied_run.records(1)} == {None}
    (copied_run.path / "individuals.parquet" / "part-00002.parquet").unlink()
    for _ in range(2):
        with pytest.raises(InputError, match=r"written by an older coevo.* can be read, but not gone on with") as told:
            go_on(copied_run)
        assert str(told.value).startswith(str(copied_run.path))
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


class Killed(BaseException):
    """Stands for a kill: nothing of the program catches it."""


def kill(_report):
    raise Killed


def test_a_later_version_with_more_settings_reads_results_and_goes_on(small_settings, go_on, monkeypatch, tmp_path):
    """A run whose config.toml lacks a setting that this version has, as a version that did not have it wrote it."""
    written = coevo.run.to_toml

    def earlier(settings):
        lines = written(settings).splitlines(keepends=True)
        kept = [line for line in lines if not line.startswith("walk_stop")]
        assert len(kept) == len(lines) - 1
        return "".join(kept)

    settings = small_settings()
    with monkeypatch.context() as patched:
        for module in (coevo.run, coevo.run_reader):
            patched.setattr(module, "to_toml", earlier)
        begun = create_run(tmp_path / "run", settings)
        with pytest.raises(Killed):
            go_on(begun, report=kill)
        begun.save_result("found", {"values": np.arange(3)})
    run = open_run(begun.path)
    assert run.config == settings
    assert run.result("found")["values"].tolist() == [0, 1, 2]
    assert run.checkpoint().generation == 1
    whole = go_on(create_run(tmp_path / "whole", settings))
    assert (go_on(run).path / "generations.csv").read_bytes() == (whole.path / "generations.csv").read_bytes()
