"""A set may be stopped after any block of any period: it goes on to the same bytes, or is refused in words."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

from behaviors import checkpoint
from behaviors.schedule.course import Course
from behaviors.studies import chapter3
from behaviors.studies.chapter3 import run_set
from coevo.errors import InputError
from coevo.files import read_arrays

# Two blocks in each period.
BLOCKS = (
    "trials=260",
    "time_limit_steps=60",
    "transfer.trials_e=11",
    "transfer.trials_f=11",
    "transfer.camera=analytic",
    *(f"{who}.learning.check_every=100" for who in ("passer", "shooter")),
)
PERIODS = [period for period in "ABCDEF" for _ in range(2)]
PAINTED = ("transfer.camera=opencv", "transfer.trials_e=2", "transfer.trials_f=1", "trials=60")
SPARSE = [f"{who}.learning.storage=sparse" for who in ("passer", "shooter")]


class Stopped(Exception):  # noqa: N818 - nothing is wrong
    """Stands for whatever ends a process."""


@pytest.fixture
def saving(monkeypatch):
    """Let run_set save after each block."""
    monkeypatch.setattr(chapter3, "_SAVE_EVERY_S", -1.0)


def run_until(schedule, stop, path, number=0):
    """Run a set, stopped when its block ``stop`` is told of, which is before it is saved."""
    blocks = itertools.count()

    def report(*_):
        if next(blocks) == stop:
            raise Stopped

    with pytest.raises(Stopped):
        run_set(schedule, number, report, checkpoint=path)


@pytest.fixture(scope="module")
def whole(small_schedule):
    """Return a function that gives the files of an undisturbed set, and what it told of its blocks."""
    found = {}

    def of(*changes):
        if changes not in found:
            told = []
            found[changes] = run_set(small_schedule(*changes), 0, lambda *at: told.append(at)), told
        return found[changes]

    return of


def test_a_set_tells_of_two_blocks_in_each_period(whole):
    files, told = whole(*BLOCKS)
    sizes = [(10, 11), (11, 11)]
    assert told == [(p, n, total) for p in "ABCD" for n, total in ((250, 260), (260, 260))] + [
        (period, *size) for period in "EF" for size in sizes
    ]
    assert set(files) == {"passer.npz", "shooter.npz", "set.json", "trials.csv", "checks.csv", "errors.csv"}
    assert all(files.values())


@pytest.mark.usefixtures("saving")
@pytest.mark.parametrize(
    "stop",
    [
        # The first and the last block that is trained in, and one of the other world; the rest takes as long each.
        pytest.param(n, id=f"{PERIODS[n]}{n % 2}", marks=() if n in (1, 7, 9) else pytest.mark.slow)
        for n in range(1, len(PERIODS))
    ],
)
def test_a_set_stopped_after_any_block_gives_the_same_bytes(small_schedule, whole, tmp_path, stop):
    schedule, path = small_schedule(*BLOCKS), tmp_path / "set.npz"
    run_until(schedule, stop, path)
    told = []
    assert run_set(schedule, 0, lambda *at: told.append(at), checkpoint=path) == whole(*BLOCKS)[0]
    assert told == whole(*BLOCKS)[1][stop:]  # the block that was told of last was not saved, and is run again


@pytest.mark.parametrize(
    "changes",
    [
        (*BLOCKS, *SPARSE),
        pytest.param((*BLOCKS, "store.report_orders=true", "store.steps=1000"), marks=pytest.mark.slow),
        pytest.param((*BLOCKS, "reuse=copy", "transfer.reuse=mixture"), marks=pytest.mark.slow),
    ],
)
def test_a_set_handed_on_after_each_block_gives_the_same_bytes(small_schedule, tmp_path, changes):
    schedule, path = small_schedule(*changes), tmp_path / "set.npz"
    course, undisturbed, blocks = Course(schedule, 5), Course(schedule, 5), 0
    while not course.is_finished:
        course.save(path)
        course = Course.load(path, schedule, 5)
        course.save(tmp_path / "again.npz")
        assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()
        assert course.advance() == undisturbed.advance()
        blocks += 1
    assert blocks == len(PERIODS)
    for one in (course, undisturbed):
        one.save(tmp_path / f"{id(one)}.npz")
    assert (tmp_path / f"{id(course)}.npz").read_bytes() == (tmp_path / f"{id(undisturbed)}.npz").read_bytes()
    assert course.skills == undisturbed.skills
    assert course.told == undisturbed.told


@pytest.mark.usefixtures("saving")
@pytest.mark.slow
def test_a_set_with_painted_images_killed_again_and_again_gives_the_same_bytes(small_schedule, whole, tmp_path):
    schedule, path, kills = small_schedule(*BLOCKS, *PAINTED), tmp_path / "set.npz", 0
    while True:
        try:
            run_until(schedule, 1, path)  # each time one block more is saved
        except pytest.fail.Exception:  # there are not two blocks any more
            break
        kills += 1
    assert kills == 5  # of six blocks
    assert run_set(schedule, 0, checkpoint=path) == whole(*BLOCKS, *PAINTED)[0]


# ---------------------------------------------------------------------------------------- checkpoints that do not serve


@pytest.fixture
def stopped(small_schedule, tmp_path, saving):  # noqa: ARG001 - a fixture that changes something
    """Return the schedule and the checkpoint of a set in the second block of A."""
    schedule = small_schedule(*BLOCKS)
    run_until(schedule, 2, tmp_path / "set.npz")
    return schedule, tmp_path / "set.npz"


@pytest.mark.parametrize(
    ("changes", "number", "says"),
    [
        (["trials=261"], 0, "trials is 260 there and 261 here"),
        (["passer.learning.gamma=0.9"], 0, "passer.learning.gamma is 0.995 there and 0.9 here"),
        (["transfer.alpha=0.5"], 0, "transfer.alpha is 0.01 there and 0.5 here"),
        ([], 1, "set_seed is "),
    ],
    ids=["trials", "gamma", "alpha", "seed"],
)
def test_another_set_is_refused_by_what_is_different(small_schedule, stopped, changes, number, says):
    _, path = stopped
    before = path.read_bytes()
    with pytest.raises(InputError) as caught:
        run_set(small_schedule(*BLOCKS, *changes), number, checkpoint=path)
    for part in (str(path), "is of another learning", says, "or remove it, and the set begins anew"):
        assert part in str(caught.value)
    assert path.read_bytes() == before


def test_another_version_is_refused(stopped, monkeypatch, tmp_path):
    schedule, path = stopped
    monkeypatch.setattr(checkpoint, "cache_folder", lambda: tmp_path / "0123456789")
    with pytest.raises(InputError, match=r"another version of coevo or its libraries.*; remove it, and the set begins"):
        run_set(schedule, 0, checkpoint=path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", "half"], ids=["empty", "no zip", "half"])
def test_a_damaged_checkpoint_is_refused_and_kept(stopped, content):
    schedule, path = stopped
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2] if content == "half" else content)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"damaged.*; remove it, and the set begins anew") as caught:
        run_set(schedule, 0, checkpoint=path)
    assert str(path) in str(caught.value)
    assert path.read_bytes() == before


def refusal(path, schedule, seed):
    """Return what is said about a checkpoint that does not serve, None if it does."""
    try:
        Course.load(path, schedule, seed)
    except InputError as error:
        return str(error)
    return None


def test_a_changed_byte_is_noticed_or_does_not_matter(stopped):
    schedule, path = stopped
    data, rng, noticed = path.read_bytes(), np.random.default_rng(2), 0
    seed = int(chapter3.game_seed(schedule.seed, 0))
    arrays = read_arrays(path)
    for place in rng.choice(len(data), 40, replace=False):
        damaged = bytearray(data)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(damaged))
        message = refusal(path, schedule, seed)
        if message is None:
            found = read_arrays(path)
            assert found.keys() == arrays.keys()
            assert all(np.array_equal(found[name], part) for name, part in arrays.items())
        else:
            assert "remove it, and the set begins anew" in message
            noticed += 1
    assert noticed > 25


def test_nothing_is_kept_before_it_is_time(small_schedule, tmp_path):
    run_until(small_schedule(*BLOCKS), 2, tmp_path / "set.npz")  # long before the first save is due
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("where", "what"),
    [
        ("told", {"checks": []}),
        ("over", ["B"]),
        ("agents", []),
        ("practice.states", [3, 3]),
        ("shooter.predictors.ball.C", np.zeros((4, 1))),
        ("shooter.predictors.ball.past_mean", np.full(12, "x")),
        ("passer.store.areas", np.zeros((2, 3))),
        ("practice.results.ends", np.zeros(4)),
        ("practice.table0.values", np.zeros((5, 2))),
        ("practice.table0.values", None),
    ],
)
@pytest.mark.usefixtures("saving")
def test_what_does_not_fit_is_refused_though_its_digest_is_right(small_schedule, tmp_path, where, what):
    schedule, path = small_schedule(*BLOCKS), tmp_path / "set.npz"
    run_until(schedule, 3, path)  # after the first block of B
    arrays = read_arrays(path)
    header = json.loads(bytes(arrays["header"]))
    parts = {name: part for name, part in arrays.items() if name not in ("digest", "header", "format", "code")}
    part, _, name = where.partition(".")
    if part in header["at"] and name != "results.ends" and not name.startswith("table0"):
        if name:
            header["at"][part][name] = what
        else:
            header["at"][part] = what
    else:
        assert where in parts, sorted(parts)
        if what is None:
            del parts[where]
        else:
            parts[where] = what
    checkpoint.write_checkpoint(path, header["learning"], header["at"], parts)
    with pytest.raises(InputError, match=r"is damaged.*; remove it, and the set begins anew"):
        run_set(schedule, 0, checkpoint=path)
