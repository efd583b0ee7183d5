"""The commands that make the tables of the documentation again: one door, whatever package they come from."""

from __future__ import annotations

import importlib
import json
import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from analysis.chapter3 import report
from analysis.unseen import unseen
from coevo.cli import plugins
from coevo.cli.reproducing import reproduce
from coevo.console import show
from coevo.errors import InputError

DECLARED = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
POINTS = DECLARED["project"]["entry-points"]["coevo.reproduce"]


@pytest.fixture
def installed(monkeypatch):
    """Let the entry points be those of pyproject.toml, whatever was installed last."""
    points = EntryPoints(EntryPoint(name, value, "coevo.reproduce") for name, value in POINTS.items())
    there = plugins.importlib.metadata.entry_points

    def entry_points(**chosen):  # noqa: ANN003 - numba asks too
        return points.select(**chosen) if chosen.get("group") == "coevo.reproduce" else there(**chosen)

    monkeypatch.setattr(plugins.importlib.metadata, "entry_points", entry_points)


@pytest.mark.parametrize(("name", "where"), POINTS.items())
@pytest.mark.usefixtures("installed")
def test_each_command_has_help_with_an_example_of_itself(name, where):
    module, _, attribute = where.partition(":")
    assert isinstance(getattr(importlib.import_module(module), attribute), click.Command)
    said = CliRunner().invoke(reproduce, [name, "--help"])
    assert said.exit_code == 0
    assert f"Example: coevo reproduce {name}" in said.stdout
    assert "--json" in said.stdout


@pytest.mark.usefixtures("installed")
def test_they_are_listed_and_a_misspelt_one_is_answered_with_the_nearest():
    said = CliRunner().invoke(reproduce, ["--help"])
    for name in POINTS:
        assert f"  {name} " in said.stdout
    refused = CliRunner().invoke(reproduce, ["abaltion"], prog_name="coevo reproduce")
    assert isinstance(refused.exception, InputError)
    assert "there is no command 'reproduce abaltion'. Did you mean 'ablation'?" in str(refused.exception)


@pytest.mark.usefixtures("installed")
def test_a_command_works_through_the_group():
    arguments = ["categories", "smoke", "--teams", "1", "--json"]
    said = CliRunner().invoke(reproduce, arguments, catch_exceptions=False)
    found = json.loads(said.stdout)
    assert [one["seen"] for one in found] == ["ball", "goal", "robot"]
    assert all(0 < one["small_below_px"] < one["large_from_px"] for one in found)


def test_unseen_games_are_told_as_json(small_run):
    said = CliRunner().invoke(unseen, [str(small_run.path), "--games", "5", "--json"], catch_exceptions=False)
    found = json.loads(said.stdout)
    assert [one["who"] for one in found["teams"]][:2] == ["generation 0", "generation 2"]
    for one in found["teams"]:
        mean, low, high = one["goals"]
        assert low <= mean <= high
    assert all(len(interval) == 3 for interval in found["gains"].values())


def test_a_folder_without_sets_is_refused(tmp_path):
    said = CliRunner().invoke(report, [str(tmp_path)])
    assert isinstance(said.exception, InputError)
    assert "holds no finished set; run 'coevo reproduce chapter3' first" in str(said.exception)


def test_what_is_shown_is_the_same_in_a_file_and_as_json(tmp_path, capsys):
    show([{"a": 1}], "a text", as_json=False, out=tmp_path / "deep" / "found.json")
    assert capsys.readouterr().out == "a text\n"
    show([{"a": 1}], "a text", as_json=True)
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "deep" / "found.json").read_text())
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="choose another --out"):
        show([], "", as_json=True, out=tmp_path / "file" / "found.json")
