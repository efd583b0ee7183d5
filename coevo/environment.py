"""What a run depends on besides its settings: versions, the commit, digests of skills and of code of one's own."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding

from coevo.compiled import cache_folder
from coevo.config import EvolutionSettings, RunSettings
from coevo.files import read_whole
from coevo.game import own_references
from coevo.kept import with_kept_skills
from coevo.plugins import own_file
from coevo.skill import load_skill

__all__ = ["environment"]

_LIBRARIES = (
    "coevo",
    "deap",
    "joblib",
    "llvmlite",
    "numba",
    "numpy",
    "opencv-python-headless",
    "pandas",
    "pyarrow",
    "pymunk",
)


def environment(settings: EvolutionSettings, folders: Sequence[Path] = ()) -> dict[str, Any]:
    """Return versions, commit, and digests of skills and of modules of one's own beside the recipe."""
    settings = with_kept_skills(settings, folders)
    skills = settings.terminals if isinstance(settings, RunSettings) else {}
    own = [path for path in (own_file(reference, folders) for reference in own_references(settings)) if path]
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": llvmlite.binding.get_host_cpu_name(),
        "kernels": cache_folder().name,  # sources and libraries of compiled code, and the kind of processor
        "versions": {name: importlib.metadata.version(name) for name in _LIBRARIES},
        "commit": _commit(),
        "skills": {name: load_skill(source).digest for name, source in skills.items()},
        "own_modules": {path.name: hashlib.sha256(read_whole(path)).hexdigest() for path in own},
    }


def _commit() -> str | None:
    """Return the commit of the sources if they are a git checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)  # noqa: S603 - fixed words
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
