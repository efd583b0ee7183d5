"""Machine code is kept apart for every version of the sources: nobody ever runs stale code."""

from __future__ import annotations

import ast
import errno
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

import behaviors
import coevo
from coevo import compiled
from coevo.compiled import borrowed, cache_folder, entry, helper, inlined, is_compiled, start_costs
from coevo.soccer.rng import uniform

ROOT = Path(coevo.__file__).parents[1]
PACKAGES = ("coevo", "behaviors")


@pytest.fixture
def sources(tmp_path, monkeypatch):
    """Return a copy of the sources that cache folders are made for, while the test lasts."""
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "*.npz", "*.pyc")
        )
    monkeypatch.setattr(compiled, "_PACKAGES", tmp_path)
    return tmp_path


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Return an empty folder that kernels made in this test keep their code in."""
    folder = tmp_path / "cache"
    monkeypatch.setattr(compiled, "cache_folder", lambda: folder)
    return folder


def folder_now():
    """Return the cache folder as a new process would find it."""
    return cache_folder.__wrapped__()


def append(path, text="\n# another line\n"):
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


# ------------------------------------------------------------------------------------------------------------- digests


def test_the_folder_is_that_of_these_sources(sources):
    assert sources != ROOT
    assert folder_now() == folder_now() == cache_folder()


@pytest.mark.parametrize(
    "kernel",
    [
        "coevo/soccer/rng.py",
        "coevo/soccer/physics.py",
        "coevo/soccer/camera.py",
        "coevo/skill/estimate.py",
        "coevo/skill/model.py",
        "coevo/tree/program.py",
        "coevo/game/kernels.py",
        "coevo/game/conditions.py",
        "coevo/stage/kernels.py",
        "coevo/stage/loop.py",
        "coevo/stage/roles.py",
        "coevo/compiled.py",
        "behaviors/tabular/qlearning.py",
        "behaviors/trials/kernels.py",
        "behaviors/trials/task.py",
    ],
)
def test_an_edit_of_a_kernels_source_changes_the_folder_and_taking_it_back_restores_it(sources, kernel):
    before, text = folder_now(), (sources / kernel).read_bytes()
    append(sources / kernel)
    assert folder_now() != before
    (sources / kernel).write_bytes(text)
    assert folder_now() == before


def test_new_and_removed_kernels_change_the_folder(sources):
    before = folder_now()
    (sources / "coevo" / "soccer" / "wind.py").write_text("SPEED = 1\n", encoding="utf-8")
    with_wind = folder_now()
    assert with_wind != before
    (sources / "coevo" / "soccer" / "wind.py").rename(sources / "coevo" / "soccer" / "gale.py")
    assert folder_now() not in (before, with_wind)
    (sources / "coevo" / "soccer" / "gale.py").unlink()
    assert folder_now() == before


@pytest.mark.parametrize("numbers", ["coevo/stage/data.py", "behaviors/trials/minds.py", "coevo/skill/bank.py"])
def test_what_compiled_code_takes_its_names_and_numbers_from_is_in_the_digest(sources, numbers):
    before = folder_now()
    append(sources / numbers)
    assert folder_now() != before


def test_the_list_names_what_is_there_and_is_all_that_counts(sources, monkeypatch):
    listed = [ROOT / name for name in compiled.KERNEL_SOURCES]
    assert all(path.exists() for path in listed)
    assert len(set(listed)) == len(listed)
    expected = {path for path in listed if path.is_file()}
    expected |= {path for folder in listed if folder.is_dir() for path in folder.rglob("*.py")}
    found = [path.relative_to(sources).as_posix() for path in compiled._kernel_files()]
    assert sorted(found) == sorted(path.relative_to(ROOT).as_posix() for path in expected)
    before = folder_now()
    extra = sources / "behaviors" / "extra.py"  # whatever it imports
    extra.write_text("from coevo.compiled import helper\n", encoding="utf-8")
    assert folder_now() == before
    monkeypatch.setattr(compiled, "KERNEL_SOURCES", (*compiled.KERNEL_SOURCES, "behaviors/extra.py"))
    with_extra = folder_now()
    assert with_extra != before
    append(extra)
    assert folder_now() != with_extra
    extra.unlink()
    assert folder_now() == before


@pytest.mark.parametrize(
    "other",
    [
        "coevo/cli/__init__.py",
        "coevo/run.py",
        "behaviors/practice.py",
        "behaviors/schedule/course.py",
        "coevo/config/world.py",
    ],
)
def test_an_edit_of_what_is_not_compiled_keeps_the_folder(sources, other):
    before = folder_now()
    append(sources / other)
    assert folder_now() == before


@pytest.mark.parametrize("library", ["numba", "llvmlite", "numpy", "pymunk"])
def test_another_version_of_a_library_changes_the_folder(monkeypatch, library):
    before, version = folder_now(), compiled.version
    monkeypatch.setattr(compiled, "version", lambda name: "0.0" if name == library else version(name))
    assert folder_now() != before


def test_another_kind_of_processor_changes_the_folder(monkeypatch):
    before = folder_now()
    monkeypatch.setattr(compiled.llvmlite.binding, "get_host_cpu_name", lambda: "abacus")
    assert folder_now() != before


def test_the_user_says_where_caches_go(monkeypatch, tmp_path):
    name = folder_now().name
    monkeypatch.setenv("COEVO_CACHE_DIR", str(tmp_path))
    assert folder_now() == tmp_path / name
    monkeypatch.delenv("COEVO_CACHE_DIR")
    assert folder_now().name == name
    assert folder_now().is_absolute()


def test_every_compiled_function_of_the_packages_stands_in_a_source_of_the_digest():
    sources, found = set(compiled._kernel_files()), 0
    for package in (coevo, behaviors):
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if info.name.rpartition(".")[2] == "__main__":
                continue
            for thing in vars(importlib.import_module(info.name)).values():
                if isinstance(thing, CPUDispatcher):
                    found += 1
                    assert Path(thing.py_func.__code__.co_filename) in sources, (info.name, thing)
    assert found > 50


def home(module, word):
    """Return the source in which a name of a module is assigned, following its imports; None if it is no such name."""
    for node in ast.parse(Path(module.__file__).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if word == (alias.asname or alias.name):
                    return home(importlib.import_module(node.module), alias.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
            if word in names:
                return Path(module.__file__)
    return None


def test_numbers_that_compiled_functions_take_from_other_modules_stand_in_a_source_of_the_digest():
    # They are frozen into the machine code.
    sources, checked = set(compiled._kernel_files()), set()
    for path in sources:
        module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
        kernels = [thing.py_func for thing in vars(module).values() if isinstance(thing, CPUDispatcher)]
        used = {word for kernel in kernels for word in kernel.__code__.co_names}
        for word in used & vars(module).keys():
            if isinstance(getattr(module, word), int | float):
                assert home(module, word) in sources, (module, word)
                checked.add(word)
    assert {"BALL", "ROBOTS", "_NEAR", "SUCCESS", "BODIES"} <= checked


@pytest.mark.slow
def test_an_edit_of_a_helper_is_never_answered_by_old_machine_code(sources):
    # numba's own cache looks at the file of the entry alone; here the helper's file is what changes.
    (sources / "coevo" / "soccer" / "probe.py").write_text(
        textwrap.dedent("""
        from coevo.compiled import entry
        from coevo.soccer.rng import uniform

        @entry
        def first(rng):
            return uniform(rng)
        """),
        encoding="utf-8",
    )
    code = (
        "import numpy as np; from coevo.compiled import is_compiled; from coevo.soccer.probe import first;"
        "known = is_compiled(first); print(known, first(np.array([1234567], np.uint64)))"
    )
    environment = {**os.environ, "COEVO_CACHE_DIR": str(sources / "cache"), "PYTHONPATH": str(sources)}

    def run():
        command = [sys.executable, "-c", code]
        done = subprocess.run(  # noqa: S603 - our own code
            command, cwd=sources, env=environment, check=True, capture_output=True, text=True
        )
        known, value = done.stdout.split()
        return known == "True", float(value)

    expected = (6457827717110365317 >> 11) / 2.0**53
    assert run() == (False, expected)
    assert run() == (True, expected)  # from the disk
    path = sources / "coevo" / "soccer" / "rng.py"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("(1.0 / 9007199254740992.0)", "(0.5 / 9007199254740992.0)"), encoding="utf-8")
    assert run() == (False, 0.5 * expected)


# ------------------------------------------------------------------------------------------------------------- entries


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
    assert not list(Path(__file__).parent.glob("__pycache__/test_compiled.double-*.nb?"))


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
    cpu, clock = start_costs(textwrap.dedent(code))
    assert 0.5 < cpu < 1.5
    assert clock >= 0.2
