"""What tests of skills share: skills of random numbers, and one that is saved."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.skill import ObjectModel, Skill
from coevo.skill.model import OBJECT_KINDS

_PLAIN = ("name", "drive", "min_steps", "max_steps", "about", "sparse", "domain")


def _model(rng, kind="ball", order=2, length=2, lost=2):
    past = length * (2 + OBJECT_KINDS[kind])
    return ObjectModel(kind, length, rng.normal(size=(order, past)), rng.normal(size=past), 0.6, lost)


@pytest.fixture(scope="session")
def model():
    """Return a function that makes the model of an object of random numbers."""
    return _model


def _skill(seed=1, objects=(("ball", 2, 2), ("robot", 1, 3)), actions=9, drive="pws"):
    """Return a skill of random numbers; ``objects``: kind, order, history length, maybe lost states of each."""
    rng = np.random.default_rng(seed)
    models = tuple(_model(rng, *which) for which in objects)
    states = int(np.prod([one.states for one in models]))
    values = rng.normal(size=(states, actions)).astype(np.float32)
    return Skill("shoot", drive, models, values, 5, 30, {"seed": seed, "recipe": {"name": "shoot", "parts": [1, 2.5]}})


@pytest.fixture(scope="session")
def skill():
    """Return a function that makes a skill of random numbers, by default always the same."""
    return _skill


def _same(one, two):
    """Tell whether two skills are equal in everything."""
    plain = [getattr(one, name) == getattr(two, name) for name in _PLAIN]
    models = [
        (a.kind, a.history_length, a.cell, a.lost_states) == (b.kind, b.history_length, b.cell, b.lost_states)
        and a.memory_matrix.tobytes() == b.memory_matrix.tobytes()
        and a.memory_matrix.shape == b.memory_matrix.shape
        and a.past_mean.tobytes() == b.past_mean.tobytes()
        for a, b in zip(one.objects, two.objects, strict=True)
    ]
    return all(plain) and all(models) and one.values.tobytes() == two.values.tobytes()


@pytest.fixture(scope="session")
def same():
    """Return a function that tells whether two skills are equal in everything."""
    return _same


@pytest.fixture
def saved(tmp_path, skill):
    """Return the path of a saved skill, and the skill."""
    path = tmp_path / "skill.npz"
    kept = skill()
    kept.save(path)
    return path, kept
