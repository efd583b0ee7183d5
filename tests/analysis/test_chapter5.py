"""Tables of chapter 5, from runs that are put together by hand: every number is known."""

from __future__ import annotations

import csv

import pytest
from click.testing import CliRunner

from analysis.chapter5 import comparisons, on_cards, report, two_by_two, while_learning
from analysis.chapter5_runs import read_arms
from coevo.errors import InputError

COLUMNS = ("trial", "trials", "steps", "goals", "stray", "kicks", "kicked", "collisions", "collided")
# Success of each arm in sets 0 and 1: a discount for each costs 0.1, votes cost 0.2, and there is nothing beyond these.
SUCCESS = {
    "votes": (0.5, 0.6),
    "votes-one-discount": (0.6, 0.7),
    "sum": (0.7, 0.8),
    "sum-one-discount": (0.8, 0.9),
    "w0": (0.9, 0.7),
}
GOALS = (10, 20, 30, 40, 50, 50, 50, 50, 50, 50)  # of 250 trials each: the first fifth has 30 of 500


def write(path, header, rows):
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *rows])


@pytest.fixture
def folder(tmp_path):
    rows = []
    for arm, rates in SUCCESS.items():
        for seed, rate in enumerate(rates):
            name = f"shoot-{arm}-seed{seed}"
            (tmp_path / name).mkdir()
            blocks = [(250 * (n + 1), 250, 9000, goals + seed, 0, 500, 125, 30, 25) for n, goals in enumerate(GOALS)]
            write(tmp_path / name / "frequencies.csv", COLUMNS, blocks)
            rows.append(("shoot", seed, arm, name, rate, 0.4, 0.1 + 0.1 * seed, 30 + seed))
    names = ("success_rate_in_view", "success_rate_anywhere", "collision_rate_in_view", "mean_kicks_in_view")
    write(tmp_path / "table.csv", ("recipe", "seed", "arm", "run", *names), rows)
    return tmp_path


def test_cards_and_frequencies_are_means_over_sets(folder):
    arms = read_arms(folder)
    header, rows = on_cards(arms)["on-cards"]
    first = dict(zip(header, rows[0], strict=True))
    assert (first["arm"], first["sets"]) == ("votes", "2")
    assert [first[name].split()[0] for name in header[2:]] == ["0.550", "0.400", "0.150", "30.500"]
    header, rows = while_learning(arms)["while-learning"]
    first = dict(zip(header, rows[0], strict=True))
    assert first["goals, first fifth"].startswith("0.062")  # (30 + 32) / 1000
    assert first["goals"].startswith("0.162")  # (400 + 410) / 5000
    assert first["best block"].startswith("0.202")
    assert [first[f"trials with {what}"].split()[0] for what in ("collisions", "kicks")] == ["0.100", "0.500"]


def test_arms_are_compared_within_sets(folder):
    header, rows = comparisons(read_arms(folder))["comparisons"]
    found = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert found["sum - votes"]["success"] == "0.200 [0.200, 0.200]"
    assert found["sum - votes"]["probability of more"].startswith("1.00")
    assert found["w0 - votes"]["success"].startswith("0.250 [-1.000, 1.000]")  # 0.4 and 0.1
    assert found["sum - w0"]["success"].startswith("-0.050")
    assert "votes - w0" not in found


def test_the_two_by_two_finds_what_each_half_adds(folder):
    _, rows = two_by_two(read_arms(folder))["two-by-two"]
    assert [row[2].split()[0] for row in rows[:2]] == ["-0.100", "-0.200"]
    assert abs(float(rows[2][2].split()[0])) < 5e-4


def test_the_command_writes_tables_and_curves_and_refuses_other_studies(folder):
    done = CliRunner().invoke(report, [str(folder)])
    assert done.exit_code == 0
    assert {path.name for path in (folder / "report").glob("*.svg")} == {"goals.svg", "kicks.svg", "collisions.svg"}
    assert "Written:" in done.output
    (folder / "shoot-w0-seed1" / "frequencies.csv").unlink()
    with pytest.raises(InputError, match="as in chapter 5"):
        read_arms(folder)
