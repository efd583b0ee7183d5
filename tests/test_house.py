"""The house stays one that can be read: files and argument lists have their limits."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

import analysis
import behaviors
import coevo

PACKAGES = (coevo, behaviors, analysis)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_no_file_has_more_than_400_lines(package):
    files = list(Path(package.__file__).parent.rglob("*.py"))
    assert files
    long = {path.name: len(path.read_text(encoding="utf-8").splitlines()) for path in files}
    assert {name: lines for name, lines in long.items() if lines > 400} == {}


def test_no_kernel_has_more_than_12_arguments():
    found = {}
    for package in PACKAGES:
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if not info.name.endswith("__main__"):
                for thing in vars(importlib.import_module(info.name)).values():
                    if isinstance(thing, CPUDispatcher):
                        found[f"{thing.py_func.__module__}.{thing.py_func.__name__}"] = (
                            thing.py_func.__code__.co_argcount
                        )
    assert len(found) > 80
    assert {name: count for name, count in found.items() if count > 12} == {}
