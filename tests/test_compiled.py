"""Machine code is kept apart for every version of the sources: nobody ever runs stale code."""

from __future__ import annotations

import ast
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

import behaviors
import coevo
from coevo import compiled
from coevo.compiled import cache_folder

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


def folder_now():
    """Return the cache folder as a new process would find it."""
    return cache_folder.__wrapped__()


def append(path, text="\n# another line\n"):
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


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
