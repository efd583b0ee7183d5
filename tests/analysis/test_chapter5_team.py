"""Tables of several learners, from runs that are put together by hand: every number is known."""

from __future__ import annotations

import csv

import pytest
from click.testing import CliRunner

from analysis.chapter5 import report
from analysis.chapter5_team import afterwards, by_turn, comparisons, curves, histories, read_teams, rise, scores
from coevo.errors import InputError

COLUMNS = (
    "turn", "trial", "trials", "robot", "team", "learns", "scored", "goals", "conceded", "passes", "giveaways",
    "kicks", "kicked", "collisions", "collided",
)  # fmt: skip
# Of each arm the shares of greedy games, after scored_team0 and goal_r0, which are those of the set.
GREEDY = {
    "votes": (0.1, 0.0, 0.0, 0.10, 0.10),
    "w0": (0.2, 0.0, 0.75, 0.10, 0.20),
    "a": (0.1, 0.0, 0.0, 0.0, 0.0),
    "b": (0.3, 0.0, 0.0, 0.0, 0.0),
    "a-q": (0.15, 0.0, 0.0, 0.0, 0.0),
}


def write(path, header, rows):
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def run_of(turns, teams):
    """Return rows of blocks: of each turn (name, learners, goals of each robot in each of two blocks of 250)."""
    rows, trial = [], 0
    for name, learners, *blocks in turns:
        for goals in blocks:
            trial += 250
            scored = [sum(g for g, team in zip(goals, teams, strict=True) if team == side) for side in (0, 1)]
            for robot, (mine, team) in enumerate(zip(goals, teams, strict=True)):
                told = (scored[team], mine, scored[1 - team], 2 * mine, 5, 900, 100, 30, 25)
                rows.append((name, trial, 250, f"r{robot}", team, int(robot in learners), *told))
    return rows


def study(folder, arms):
    table = []
    for arm, (teams, runs) in arms.items():
        for seed, turns in enumerate(runs):
            name = f"it-{arm}-seed{seed}"
            (folder / name).mkdir()
            write(folder / name / "frequencies.csv", COLUMNS, run_of(turns, teams))
            table.append(("it", seed, arm, name, 0.4 + 0.2 * seed, 0.25, *GREEDY[arm]))
    measured = ("scored_team0", "goal_r0", "scored_team1", "pass_r0", "pass_r1", "collision_r0", "collision_r1")
    write(folder / "table.csv", ("recipe", "seed", "arm", "run", *measured), table)
    return folder


@pytest.fixture
def two(tmp_path):
    runs = [
        [("A", {0}, (25, 0), (50, 0)), ("B", {1}, (25, 25), (50, 25 + 50 * seed))] for seed in (0, 1)
    ]  # per trial of A 0.15; of B 0.25 and 0.35
    return study(tmp_path, {"votes": ((0, 0), runs), "w0": ((0, 0), runs[:1])})


@pytest.fixture
def three(tmp_path):
    a = [[("r0", {0}, (9, 0, 0)), ("games", {0, 1, 2}, (50, 25, 25), (25, 25, 25))]]
    b = [[("r2", {2}, (0, 0, 9)), ("games", {0, 1, 2}, (0, 0, 100), (0, 25, 100))]]
    return study(tmp_path, {"a": ((0, 0, 1), a), "b": ((0, 0, 1), b)})


def rows_of(told, name):
    header, rows = told[name]
    return [dict(zip(header, row, strict=True)) for row in rows]


def test_turns_tell_what_each_robot_did_per_trial(two):
    rows = rows_of(by_turn(read_teams(two)), "turns")
    assert [(row["arm"], row["turn"], row["robot"]) for row in rows[:7]] == [
        ("votes", "A", "r0"), ("votes", "A", "r1"), ("votes", "A", "r0 r1"), ("votes", "B", "r0"), ("votes", "B", "r1"),
        ("votes", "B", "r0 r1"), ("w0", "A", "r0"),
    ]  # fmt: skip
    assert [row["goals"].split()[0] for row in rows[:6]] == ["0.150", "0.000", "0.150", "0.150", "0.150", "0.300"]
    assert [row["passes"].split()[0] for row in rows[:6]] == ["0.300", "0.000", "0.300", "0.300", "0.300", "0.600"]
    assert [row[""] for row in rows[:6]] == ["learns", "", "", "", "learns", ""]
    assert {row["trials with collisions"].split()[0] for row in rows} == {"0.100"}


def test_shooting_and_passing_rise_from_the_first_turn_to_the_last_within_sets(two):
    votes, w0 = rows_of(rise(read_teams(two)), "rise")
    assert votes["turns"] == "A to B"
    assert votes["goals"].startswith("0.150 [")  # 0.1 and 0.2
    assert votes["passes"].startswith("0.300 [")
    assert (w0["goals"], w0["trials with collisions"]) == ("0.100", "0.000")
    assert "scores" not in read_scores(two)


def read_scores(folder):
    return {name: one for name, one in scores(read_teams(folder)).items() if one[1]}


def test_games_are_won_by_who_scores_more_in_the_last_turn(three):
    a, b = rows_of(read_scores(three), "scores")
    assert (a["goals of r0 r1"], a["goals of r2"], a["difference"], a["sets won : lost"]) == (
        "0.250", "0.100", "0.150", "1 : 0"
    )  # fmt: skip
    assert (b["goals of r0 r1"], b["goals of r2"], b["difference"], b["sets won : lost"]) == (
        "0.050", "0.400", "-0.350", "0 : 1"
    )  # fmt: skip
    assert rise(read_teams(three))["rise"][1] == []


def test_histories_are_goals_so_far(three):
    frame = histories(read_teams(three))
    found = {who: part["goals"].tolist() for who, part in frame.groupby("who")}
    assert found == {"a: r0 r1": [75, 125], "a: r2": [25, 50], "b: r0 r1": [0, 25], "b: r2": [100, 200]}
    assert frame["game"].tolist() == [250, 500] * 4


def test_curves_are_of_each_robot_or_of_their_sum(two):
    each, both = (curves(read_teams(two), "goals", each_robot=one) for one in (True, False))
    last = both[(both["arm"] == "w0") & (both["trial"] == 1000)]["share"].item()
    assert last == pytest.approx((25 + 50 + 50 + 75) / 1000)
    assert list(dict.fromkeys(each["arm"])) == ["votes r0", "votes r1", "w0 r0", "w0 r1"]


def test_greedy_games_are_means_over_sets(two):
    votes, _ = rows_of(afterwards(read_teams(two)), "afterwards")
    assert votes["scored team0"].startswith("0.500")
    assert "pass r0" not in votes  # it is 0 everywhere


def test_arms_are_compared_within_the_sets_that_both_have(two):
    (row,) = rows_of(comparisons(read_teams(two)), "comparisons")
    assert (row["arms"], row["sets"], row["goals"]) == ("w0 - votes", "1", "0.000")  # there is no other side
    assert (row["passes"], row["collisions of each robot"]) == ("0.750", "0.050")


def test_arms_of_two_sides_are_compared_by_the_difference_of_goals(tmp_path):
    games = [[("games", {0, 1}, (0, 0, 0), (0, 0, 0))]]
    teams = read_teams(study(tmp_path, dict.fromkeys(("a", "b", "a-q"), ((0, 0, 1), games))))
    found = [(row["arms"], row["goals"]) for row in rows_of(comparisons(teams), "comparisons")]
    assert found == [("b - a", "-0.200"), ("a-q - a", "-0.050"), ("b - a-q", "-0.150")]


def test_the_command_writes_tables_and_figures(three, tmp_path):
    done = CliRunner().invoke(report, [str(three), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    figures = {"goals.svg", "passes.svg", "goals-of-arms.svg", "passes-of-arms.svg", "scores.svg"}
    assert {path.name for path in (tmp_path / "out").glob("*.svg")} == figures
    assert "sets won : lost" in done.output
    with (three / "it-a-seed0" / "frequencies.csv").open("w", encoding="utf-8") as file:
        file.write("trial,trials\n250,250\n")
    with pytest.raises(InputError, match="of one learner and of several"):
        read_teams(three)
