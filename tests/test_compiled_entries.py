"""Compiled functions: where their machine code is kept, whether it is there, and that they do what Python does."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numba
import numpy as np
import pytest

from coevo import compiled
from coevo.compiled import borrowed, entry, helper, inlined, is_compiled, start_costs
from coevo.soccer.rng import uniform


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Return an empty folder that kernels made in this test keep their code in."""
    folder = tmp_path / "cache"
    monkeypatch.setattr(compiled, "cache_folder", lambda: folder)
    return folder


def double(values):
    for i in range(values.shape[0]):
        values[i] *= 2.0


def test_the_users_own_cache_folder_of_numba_is_left_alone(monkeypatch, tmp_path, own_cache):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "theirs"))
    kernel = entry(double)
    assert str(tmp_path / "theirs") == numba.config.CACHE_DIR
    values = np.ones(3)
    kernel(values)
    assert values.tolist() == [2.0] * 3
    assert not (tmp_path / "theirs").exists()
    assert list(own_cache.rglob("*.nbi"))


def test_the_users_own_cache_folder_is_restored_after_a_failure_too(monkeypatch, own_cache):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "theirs")
    with pytest.raises(TypeError):
        entry(None)
    assert numba.config.CACHE_DIR == "theirs"
    assert not own_cache.exists()


def test_is_compiled_tells_whether_a_first_call_will_be_quick(own_cache):
    kernel = entry(double)
    assert not is_compiled(kernel)
    kernel(np.ones(3))
    assert is_compiled(kernel)
    again = entry(double)  # as in a new process: nothing in memory yet
    assert not again.signatures
    assert is_compiled(again)
    again(np.ones(3))
    assert again.stats.cache_hits
    shutil.rmtree(own_cache)
    assert not is_compiled(entry(double))


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [slice(0), slice(20), slice(-1), slice(None, None, -1)])
def test_a_damaged_cache_is_made_anew(suffix, content, own_cache):
    entry(double)(np.ones(3))
    (path,) = own_cache.rglob(f"*.{suffix}")
    path.write_bytes(path.read_bytes()[content])
    values, kernel = np.ones(3), entry(double)
    kernel(values)
    assert values.tolist() == [2.0] * 3
    again = entry(double)  # and is of use once more
    again(values)
    assert values.tolist() == [4.0] * 3
    assert again.stats.cache_hits


def test_a_cache_that_cannot_be_written_is_done_without(own_cache, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._open_for_write", full)
    values = np.ones(3)
    entry(double)(values)
    assert values.tolist() == [2.0] * 3
    assert not list(own_cache.rglob("*.nb?"))


def test_machine_code_is_kept_nowhere_else(own_cache):
    """Elsewhere numba would look at one file only, and run old machine code after an edit of another."""
    own_cache.write_text("a file where the folder should be")
    values, kernel = np.ones(3), entry(double)
    kernel(values)
    assert values.tolist() == [2.0] * 3
    assert not list(Path(__file__).parent.glob("__pycache__/test_compiled_entries.double-*.nb?"))


def test_a_name_that_only_begins_alike_is_not_taken_for_compiled(own_cache):
    entry(double)(np.ones(3))

    def doub(values):
        values[0] = 0.0

    doub.__qualname__ = "doub"
    assert own_cache.exists()
    assert not is_compiled(entry(doub))


@helper
def parts(a, b):
    return (a + b) - a, a / (b - b)


@entry
def of_parts(a, b):
    return parts(a, b)


def test_helpers_do_exact_arithmetic_and_divide_as_numpy_does():
    exact, infinite = of_parts(1e16, 1.0)
    assert exact == (1e16 + 1.0) - 1e16  # not rearranged to b
    assert infinite == np.inf


@inlined
def scaled(value, times):
    return value * times


def scaled_thrice(value, times):
    return scaled(value, 2) + scaled(value, 3) + scaled(value, times)


def test_a_part_is_compiled_once_for_its_types_whatever_literals_it_is_given(own_cache):
    assert entry(scaled_thrice)(10, 5) == 100
    assert own_cache.exists()
    assert len(scaled.signatures) == 1


def test_borrowed_arrays_are_the_same_memory(own_cache):
    @entry
    def fill(pair, value):
        one, two = borrowed(pair)
        one[0] = value
        two[1, 0] = value

    arrays = np.zeros(2), np.zeros((2, 2))
    fill(arrays, 3.0)
    assert own_cache.exists()
    assert arrays[0].tolist() == [3.0, 0.0]
    assert arrays[1].tolist() == [[0.0, 0.0], [3.0, 0.0]]
    assert all(sys.getrefcount(array) < 10 for array in arrays)


def last_of_two(rng):
    uniform(rng)
    return uniform(rng)


def test_a_part_that_python_calls_does_what_it_does_in_an_entry(own_cache):
    one, other = np.array([7], np.uint64), np.array([7], np.uint64)
    found = entry(last_of_two)(one)
    assert own_cache.exists()
    assert last_of_two(other) == found
    assert np.array_equal(one, other)


def test_what_only_the_first_start_does_is_the_cost_of_compiling():
    code = """
        import os, time
        known = os.path.join(os.environ["COEVO_CACHE_DIR"], "known")
        if not os.path.exists(known):
            open(known, "w").close()
            while time.process_time() < 1.0:
                pass
        time.sleep(0.2)
        """
    # What another child used that ended before, and is reaped meanwhile, is not counted.
    other = subprocess.Popen([sys.executable, "-c", "import time\nwhile time.process_time() < 2.0: pass"])
    pid = other.pid
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        del other  # it still runs: Python reaps it when the next one begins
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    cpu, clock = start_costs(textwrap.dedent(code))
    assert 0.5 < cpu < 1.5
    assert clock >= 0.2
