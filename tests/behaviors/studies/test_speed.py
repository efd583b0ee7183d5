"""The study of how fast learning is."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from behaviors.recipe import installed_recipes
from behaviors.studies import speed
from coevo.config import WorldSettings


def test_physics_is_timed_for_as_many_steps_as_asked_for(monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr(speed.time, "perf_counter", lambda: float(next(clock)))
    assert speed.physics_seconds(WorldSettings(), 1, 1800) == 2.0  # two stretches of 900 steps, one tick each
    assert speed.physics_seconds(WorldSettings(), 2, 450) == 0.5  # half of one stretch


@pytest.mark.slow
def test_every_learning_is_timed_beside_its_physics(monkeypatch):
    monkeypatch.setattr(speed, "start_costs", lambda code: (float(len(code)), 0.0))  # it compiles for half a minute
    result = CliRunner().invoke(speed.speed, ["--trials", "20"])
    assert result.exit_code == 0, result.output
    assert f"Compiling all of it anew: {len(speed._START):.1f} CPU seconds" in result.stdout
    lines = [line for line in result.stdout.splitlines() if line.strip()]
    labels = [*installed_recipes(), "chapter 3, period A", "chapter 3, both learn"]
    table = [next(line for line in lines if line.startswith(f"{label}  ")).split() for label in labels]
    for *_, steps, step_us, physics_us, ratio in table:
        assert float(steps) > 1.0
        assert float(step_us) > 0.0
        assert abs(float(ratio) - float(step_us) / float(physics_us)) < 0.1 * float(ratio)
