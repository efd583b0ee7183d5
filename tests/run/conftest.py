"""What tests of run folders share: runs that were killed at any write, and copies that may be spoilt."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest

from coevo.run import create_run, open_run


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


@pytest.fixture(scope="session")
def killed_error():
    """Return what stands for a kill."""
    return Killed
