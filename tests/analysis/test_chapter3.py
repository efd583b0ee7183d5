"""Tables and figures of chapter 3, from sets that are put together by hand."""

from __future__ import annotations

import csv
import json
import shutil
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from analysis.chapter3 import report
from analysis.chapter3_figures import contributions, errors_of_a_trial, periods_of
from analysis.chapter3_sets import read_methods

PASSING = (0.2, 0.4, 0.9)  # of each set, in period E
GAINS = (("E", 1.0), ("F", 1.5))  # times that


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def folder(tmp_path):
    for number, share in enumerate(PASSING):
        path = tmp_path / "schedule" / f"set-{number:02d}"
        path.mkdir(parents=True)
        lines = ["period,end,passes,steps", *("A,1,0,5",) * 50, *("B,3,2,7",) * 50]
        lines += [f"E,0,{int(n < 10 * share)},9" for n in range(10)]
        (path / "trials.csv").write_text("\n".join(lines) + "\n")
        (path / "errors.csv").write_text("where,robot,object,step,error_px\nsimulation,passer,ball,1,0.5\n")
        checks = [f"C,{n},{share * n / 10},{1 - n / 10},0.25,9,0" for n in range(10)]
        (path / "checks.csv").write_text(
            "\n".join(["period,trials,passing,shooting,collisions,steps,kept", *checks]) + "\n"
        )
        common = {"robot": "passer", "object": "ball"}
        model = {
            "period": "A",
            "windows": 9,
            "kept": False,
            "order": 3,
            "history_length": 2,
            "chosen_order": 4 + number,
        }
        summary = {
            "set": number,
            "periods": {name: {"passing": gain * share, "shooting": 0.5, "collisions": 0.0} for name, gain in GAINS},
            "after": {
                "passing": share,
                "shooting": 0.5,
                "collisions": 0.0,
                "nearer": {"passer": {"passing": 1.0, "shooting": 0.25, "collisions": 0.0}},
            },
            "models": [{**common, **model, "contribution": [0.9, 0.5 + 0.1 * number]}],
            "prediction_errors": [
                {**common, "where": "simulation", "orders": "used", "rms_px": 1.0 + number, "relative": 0.1}
            ],
            "exchange": [{**common, "where": "simulation", "error_ratio": 2.0}],
        }
        (path / "set.json").write_text(json.dumps(summary))
    (tmp_path / "schedule" / "settings.json").write_text("{}")
    return tmp_path


def test_tables_hold_means_and_student_s_intervals_over_sets(folder):
    result = CliRunner().invoke(report, [str(folder)])
    assert result.exit_code == 0, result.output
    row = rows(folder / "report" / "table-3-3.csv")[0]
    low, high = stats.t.interval(0.95, len(PASSING) - 1, np.mean(PASSING), stats.sem(PASSING))
    assert low < 0.0  # no share can be that, nor the upper end
    assert high > 1.0
    assert row["passing"] == f"{np.mean(PASSING):.3f} [0.000, 1.000]"
    assert (row["method"], row["period"], row["trials a set"]) == ("schedule", "E", "10")
    gain = rows(folder / "report" / "table-3-3.csv")[1]
    gains = 0.5 * np.array(PASSING)
    low, high = stats.t.interval(0.95, len(gains) - 1, gains.mean(), stats.sem(gains))
    assert (gain["period"], gain["passing"]) == ("F - E", f"{gains.mean():.3f} [{low:.3f}, {high:.3f}]")
    error = rows(folder / "report" / "figure-3-8.csv")[0]
    low, high = stats.t.interval(0.95, 2, 2.0, stats.sem([1.0, 2.0, 3.0]))
    assert error["error of y [px]"] == f"2.000 [{max(0.0, low):.3f}, {high:.3f}]"
    order = rows(folder / "report" / "table-3-2.csv")[0]
    assert (order["order"], order["chosen order"], order["kept"]) == ("3", "5", "0 of 3")
    assert "57/100" in result.output


def test_what_changes_within_a_period_is_told_of_greedy_policies(folder):
    CliRunner().invoke(report, [str(folder)])
    (row,) = rows(folder / "report" / "within.csv")
    changes = [0.8 * share for share in PASSING]  # checks 8 and 9 less checks 0 and 1, each check a tenth more
    low, high = stats.t.interval(0.95, 2, np.mean(changes), stats.sem(changes))
    assert row["passing"] == f"{np.mean(changes):.3f} [{max(low, -1.0):.3f}, {min(high, 1.0):.3f}]"
    assert row["shooting"] == "-0.800 [-0.800, -0.800]"
    assert row["collisions"] == "0.000 [0.000, 0.000]"


def test_curves_are_shares_of_blocks_in_simulation_only(folder):
    CliRunner().invoke(report, [str(folder)])
    found = rows(folder / "report" / "figure-3-10.csv")
    for what, first, second in (("passing", 0.0, 1.0), ("shooting", 1.0, 0.0), ("collisions", 0.0, 1.0)):
        shares = [float(row["share"]) for row in found if row["what"] == what]
        assert shares == [first] * 50 + [second] * 50
    for path in (folder / "report").glob("*.svg"):
        ET.parse(path)  # noqa: S314 - our own file
    assert (folder / "report" / "figure-3-9-schedule-passer.svg").exists()


def test_what_came_after_is_told_by_who_was_nearer_to_the_ball(folder):
    CliRunner().invoke(report, [str(folder)])
    found = {row["nearer to the ball"]: row for row in rows(folder / "report" / "afterwards.csv")}
    assert found["either"]["passing"].startswith(f"{np.mean(PASSING):.3f}")
    assert found["passer"]["passing"] == "1.000 [1.000, 1.000]"
    assert (found["passer"]["sets"], found["shooter"]["sets"]) == ("3", "0")
    assert found["shooter"]["passing"] == ""


def test_methods_are_compared_within_sets_of_one_number(folder):
    for number, share in enumerate(PASSING[:2]):
        path = folder / "previous" / f"set-{number:02d}"
        shutil.copytree(folder / "schedule" / f"set-{number:02d}", path)
        summary = json.loads((path / "set.json").read_text())
        summary["after"]["passing"] = share - 0.1 * (1 + number)
        (path / "set.json").write_text(json.dumps(summary))
    (folder / "previous" / "settings.json").write_text("{}")
    assert CliRunner().invoke(report, [str(folder)]).exit_code == 0
    (row,) = rows(folder / "report" / "differences.csv")
    low, high = stats.t.interval(0.95, 1, 0.15, stats.sem([0.1, 0.2]))
    assert (row["methods"], row["sets"]) == ("schedule - previous", "2")
    assert row["passing"] == f"0.150 [{low:.3f}, {high:.3f}]"
    assert row["shooting"] == "0.000 [0.000, 0.000]"


def test_the_last_tenth_of_a_period_says_where_learning_has_come_to(folder):
    for path in folder.glob("schedule/set-*/trials.csv"):
        text = path.read_text()
        path.write_text(text.replace("A,1,0,5\n" * 5 + "B", "A,3,1,5\n" * 5 + "B"))
    CliRunner().invoke(report, [str(folder)])
    found = {row["last tenth of"]: row for row in rows(folder / "report" / "periods.csv")}
    assert list(found) == ["A", "B"]
    assert found["A"]["passing"] == found["A"]["collisions"] == found["B"]["passing"] == "1.000 [1.000, 1.000]"
    assert found["A"]["shooting"] == found["B"]["shooting"] == "0.000 [0.000, 0.000]"


def test_only_whole_sets_are_read(folder):
    (folder / "schedule" / ".set-09.partial").mkdir()
    assert len(read_methods(folder)[0].summaries) == len(PASSING)


def test_errors_have_a_gap_where_the_object_was_out_of_view(folder):
    lines = [f"simulation,passer,ball,{step},{step / 10}" for step in (30, 31, 45, 46)]
    path = folder / "schedule" / "set-00" / "errors.csv"
    path.write_text("\n".join(["where,robot,object,step,error_px", *lines]) + "\n")
    table = errors_of_a_trial(read_methods(folder))
    assert table["error_px"].fillna(-1.0).tolist() == [3.0, 3.1, -1.0, 4.5, 4.6]
    assert table["time_s"].tolist() == pytest.approx([1.0, 31 / 30, 1.5, 1.5, 46 / 30])


def test_contributions_are_those_of_the_newest_models_and_means_over_sets(folder):
    table = contributions(read_methods(folder))
    assert table[["robot", "object", "element"]].to_numpy().tolist() == [["passer", "ball", 1], ["passer", "ball", 2]]
    assert table["mu"].tolist() == pytest.approx([0.9, np.mean([0.5, 0.6, 0.7])])


def test_marks_say_where_periods_in_simulation_begin(folder):
    assert periods_of(read_methods(folder)).to_numpy().tolist() == [[0, "period A"], [50, "period B"]]
