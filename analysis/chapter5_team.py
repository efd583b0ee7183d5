"""What several learners came to, turn by turn, and Figs. 5.8 and 5.10: tables and charts of tasks (iii) and (iv).

Shooting and passing are told per trial while robots learn, with exploration; the greedy games after the last turn
beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from analysis.chapter5_runs import more_often, read_runs, within_sets
from analysis.charts import line_chart
from analysis.written import Report, Rows, frame_table, mean_words

if TYPE_CHECKING:
    import altair as alt

__all__ = [
    "TeamRun",
    "Teams",
    "afterwards",
    "by_turn",
    "comparisons",
    "curves",
    "histories",
    "read_teams",
    "rise",
    "scores",
    "team_figures",
    "team_report",
]

_WINDOW = 4  # blocks that a curve is the mean of
_EVENTS = {
    "goals": "goals",
    "passes": "passes",
    "giveaways": "giveaways",
    "trials with collisions": "collided",
    "trials with kicks": "kicked",
}
_RISING = ("goals", "passes", "trials with collisions")
_GREEDY = ("goals", "passes", "collisions of each robot")


@dataclass(frozen=True)
class TeamRun:
    """A finished run of several learners.

    Attributes:
        seed: which.
        row: of the table of the study: the greedy games.
        blocks: rows of ``frequencies.csv``, one for each block of trials and robot.
    """

    seed: int
    row: Mapping[str, str]
    blocks: pd.DataFrame

    @property
    def turns(self) -> list[str]:
        """Names of its turns, in their order."""
        return list(dict.fromkeys(self.blocks["turn"]))

    @property
    def sides(self) -> dict[int, str]:
        """By the number of a side the names of its robots."""
        found: dict[int, list[str]] = {}
        for team, robot in sorted(set(zip(self.blocks["team"], self.blocks["robot"], strict=True))):
            found.setdefault(int(team), []).append(str(robot))
        return {team: " ".join(robots) for team, robots in found.items()}

    def of(self, *, turn: str, robot: str) -> pd.DataFrame:
        """Return the blocks of a robot in a turn."""
        return self.blocks[(self.blocks["turn"] == turn) & (self.blocks["robot"] == robot)]

    def share(self, what: str, *, turn: str, robots: Sequence[str]) -> float:
        """Return how often something of ``_EVENTS`` happened per trial of a turn.

        Summed over robots; of the trials with an event the mean over them, as one trial may be that of several.
        """
        parts = [self.of(turn=turn, robot=robot) for robot in robots]
        shares = [float(part[_EVENTS[what]].sum() / part["trials"].sum()) for part in parts]
        return sum(shares) / (len(shares) if what.startswith("trials with") else 1)

    def greedy(self, what: str) -> float:
        """Return one of _GREEDY, per greedy game after the last turn, of the first side."""
        if what == "goals":
            lost = float(self.row["scored_team1"]) if len(self.sides) > 1 else 0.0
            return float(self.row["scored_team0"]) - lost
        event = {"passes": "pass", "collisions of each robot": "collision"}[what]
        shares = [float(self.row[f"{event}_{robot}"]) for robot in self.sides[0].split()]
        return sum(shares) if what == "passes" else sum(shares) / len(shares)

    def goals(self, turn: str, team: int) -> int:
        """Return the goals of a side in a turn."""
        (first, *_) = self.blocks[self.blocks["team"] == team]["robot"]
        return int(self.of(turn=turn, robot=first)["scored"].sum())

    def trials(self, turn: str) -> int:
        """Return how many trials a turn has."""
        return int(self.of(turn=turn, robot=self.blocks["robot"].iloc[0])["trials"].sum())


Teams = dict[str, list[TeamRun]]
"""By the name of an arm, in the order of the study, its finished runs."""


def read_teams(folder: Path) -> Teams:
    """Read the finished runs of a study of several learners; none of a study of one.

    Raises:
        InputError: there is no finished run, or one of them is not of chapter 5.
    """
    teams: Teams = {}
    for arm, seed, row, blocks in read_runs(folder):
        if "robot" in blocks:
            teams.setdefault(arm, []).append(TeamRun(seed, row, blocks))
    return teams


def by_turn(teams: Teams) -> Report:
    """Return what each robot and each side did per trial of each turn, means over sets."""
    rows: Rows = []
    events = [
        what for what, of in _EVENTS.items() if any(run.blocks[of].any() for runs in teams.values() for run in runs)
    ]
    for arm, runs in teams.items():
        robots = [[robot] for robot in dict.fromkeys(runs[0].blocks["robot"])]
        robots += [names.split() for names in runs[0].sides.values() if " " in names]
        for turn in runs[0].turns:
            for who in robots:
                learns = all(bool(runs[0].of(turn=turn, robot=robot)["learns"].any()) for robot in who)
                told = [mean_words([run.share(what, turn=turn, robots=who) for run in runs]) for what in events]
                rows.append([arm, turn, " ".join(who), "learns" if learns else "", str(len(runs)), *told])
    return {"turns": (["arm", "turn", "robot", "", "sets", *events], rows)}


def rise(teams: Teams) -> Report:
    """Return by how much shooting and passing rise from the first turn to the last, within sets, without opponents."""
    rows: Rows = []
    for arm, runs in teams.items():
        first, last = runs[0].turns[0], runs[0].turns[-1]
        if first == last or len(runs[0].sides) > 1:  # what one side gains the other loses
            continue
        robots = runs[0].sides[0].split()
        told = []
        for what in _RISING:
            more = [
                run.share(what, turn=last, robots=robots) - run.share(what, turn=first, robots=robots) for run in runs
            ]
            told.append(mean_words(more, least=-np.inf))
        rows.append([arm, f"{first} to {last}", str(len(runs)), *told])
    return {"rise": (["arm", "turns", "sets", *_RISING], rows)}


def afterwards(teams: Teams) -> Report:
    """Return what greedy games after the last turn came to, as shares of the games, means over sets."""
    names = list(dict.fromkeys(name for runs in teams.values() for run in runs for name in run.row))
    columns = [
        name
        for name in names
        if name.startswith(("scored_team", "goal_", "pass_", "giveaway_", "collision_"))
        and any(float(run.row.get(name) or 0.0) for runs in teams.values() for run in runs)
    ]
    rows: Rows = [
        [arm, str(len(runs)), *(mean_words([float(run.row.get(name) or "nan") for run in runs]) for name in columns)]
        for arm, runs in teams.items()
    ]
    return {"afterwards": (["arm", "sets", *(name.replace("_", " ") for name in columns)], rows)}


def comparisons(teams: Teams) -> Report:
    """Return how arms differ within sets in the greedy games after the last turn.

    Each arm is compared with the first one and with those of today's scalar learner, ``q`` in their names; goals are
    those of the first side, less those of the other if there is one.
    """
    rows: Rows = []
    found = {
        what: {arm: {run.seed: run.greedy(what) for run in runs} for arm, runs in teams.items()} for what in _GREEDY
    }
    first, *others = teams
    bases = [first, *(arm for arm in others if "q" in arm.split("-"))]
    for number, base in enumerate(bases):
        for arm in teams:
            pairs = [within_sets(of[arm], of[base]) for of in found.values()]
            if arm in bases[: number + 1] or not pairs[0].size:
                continue
            told = [mean_words((one - other).tolist(), least=-np.inf) for one, other in pairs]
            rows.append([f"{arm} - {base}", str(pairs[0].shape[1]), told[0], more_often(pairs[0]), *told[1:]])
    goals, *rest = _GREEDY
    return {"comparisons": (["arms", "sets", goals, f"probability of more {goals}", *rest], rows)}


def scores(teams: Teams) -> Report:
    """Return who wins the games of the last turn, in which all learn, where there are two sides."""
    rows: Rows = []
    for arm, runs in teams.items():
        if len(runs[0].sides) < 2:
            continue
        turn = runs[0].turns[-1]
        goals = np.array([[run.goals(turn, team) / run.trials(turn) for team in (0, 1)] for run in runs])
        won, lost = (int((goals[:, one] > goals[:, 1 - one]).sum()) for one in (0, 1))
        difference = mean_words((goals[:, 0] - goals[:, 1]).tolist(), least=-1.0, most=1.0)
        told = [mean_words(goals[:, team].tolist(), most=1.0) for team in (0, 1)]
        rows.append([arm, str(len(runs)), *told, difference, f"{won} : {lost}"])
    sides = next(iter(teams.values()))[0].sides
    of = [f"goals of {sides.get(team, '')}" for team in (0, 1)]
    return {"scores": (["arm", "sets", *of, "difference", "sets won : lost"], rows)}


def curves(teams: Teams, what: str, *, each_robot: bool) -> pd.DataFrame:
    """Return how often something of the first side happened per trial, means over sets, over windows of four blocks.

    Args:
        teams: by arm.
        what: one of goals, passes, ...
        each_robot: a line for each robot of an arm, and not for their sum.

    Returns:
        Columns ``arm``, ``trial``, ``share``; the arm with the robot's name, if each has a line.
    """
    parts = []
    for arm, runs in teams.items():
        for run in runs:
            side = run.blocks[run.blocks["team"] == 0]
            groups = side.groupby("robot") if each_robot else [("", side)]
            for robot, blocks in groups:
                sums = blocks.groupby("trial")[[_EVENTS[what]]].sum()
                sums["trials"] = blocks.groupby("trial")["trials"].first()
                sums = sums.rolling(_WINDOW, min_periods=1).sum()
                share = (sums[_EVENTS[what]] / sums["trials"]).rename("share")
                parts.append(share.reset_index().assign(arm=f"{arm} {robot}".strip()))
    means = pd.concat(parts).groupby(["arm", "trial"], sort=False)["share"].mean()
    return means.reset_index()[["arm", "trial", "share"]]


def histories(teams: Teams) -> pd.DataFrame:
    """Return Fig. 5.10: goals so far of each side in the games of the last turn, means over sets.

    Returns:
        Columns ``who``, ``game``, ``goals``.
    """
    parts = []
    for arm, runs in teams.items():
        for run in runs:
            turn = run.turns[-1]
            for team, names in run.sides.items():
                blocks = run.of(turn=turn, robot=names.split()[0])
                games, goals = blocks["trials"].cumsum(), blocks["scored"].cumsum()
                parts.append(pd.DataFrame({"who": f"{arm}: {names}", "game": games, "goals": goals, "team": team}))
    means = pd.concat(parts).groupby(["who", "game"], sort=False)["goals"].mean()
    return means.reset_index()


def _beginnings(teams: Teams) -> pd.DataFrame:
    """Return where the turns of the first run begin: columns ``trial``, ``turn``."""
    (run, *_) = next(iter(teams.values()))
    ends = np.cumsum([run.trials(turn) for turn in run.turns])
    return pd.DataFrame({"trial": [0, *ends[:-1]], "turn": run.turns})


def team_figures(teams: Teams) -> dict[str, alt.LayerChart]:
    """Return the charts by the names of their files: Fig. 5.8 of the first arm and of all arms, and Fig. 5.10."""
    first = dict([next(iter(teams.items()))])
    found = {}
    for what in ("goals", "passes"):
        for file, arms, each in ((what, first, True), (f"{what}-of-arms", teams, False)):
            titles = (f"{what} per trial, mean over sets", "trial", "per trial, over 1,000 trials")
            frame = curves(arms, what, each_robot=each)
            marks = _beginnings(first) if each else None
            found[f"{file}.svg"] = line_chart(frame, x="trial", y="share", by="arm", titles=titles, marks=marks)
    two_sided = {arm: runs for arm, runs in teams.items() if len(runs[0].sides) > 1}
    if two_sided:
        titles = ("goals so far in the games of the last turn, mean over sets", "game", "goals")
        found["scores.svg"] = line_chart(histories(two_sided), x="game", y="goals", by="who", titles=titles)
    return found


def team_report(teams: Teams) -> tuple[Report, Report]:
    """Return the tables that are shown, and those that are only written."""
    shown = {
        name: one for part in (by_turn, rise, scores, afterwards, comparisons) for name, one in part(teams).items()
    }
    frame = curves(teams, "goals", each_robot=True)
    return {name: one for name, one in shown.items() if one[1]}, {"curves": frame_table(frame)}
