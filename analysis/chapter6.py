"""What became of the conditions of a study of chapter 6, beside Tables 6.4 to 6.6 and sections 6.4.1 to 6.4.3.

Every finished run of the folder is read, so that a study under way can be looked at. Runs are what intervals count; a
run's own numbers are the row that the study has of it, its ``generations.csv``, and its tournaments where some were
played. Tables are printed and written as CSV, curves of Figs. 6.5, 6.6 and 6.10 to 6.13 as SVG, into ``report``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from analysis.charts import altair
from analysis.curve_chart import chart, words_for
from analysis.curves import choose, summary, table
from analysis.groups import run_names
from analysis.levels import level_table
from analysis.progress import MINIMUM_GENERATIONS
from analysis.tournament import diagnoses, largest_tournament
from analysis.written import Report, Rows, mean_words, report_options, write_report
from coevo.errors import InputError
from coevo.run import Run, open_run
from coevo.settlement import PATTERNS, settled_name
from coevo.statistics import share_interval
from coevo.study.folder import finished_runs

if TYPE_CHECKING:
    import altair as alt

__all__ = [
    "TABLES",
    "Evolved",
    "differences",
    "endings",
    "late_and_early",
    "levels",
    "play",
    "read_conditions",
    "report",
    "sizes",
    "worth",
]

_STATISTICS = ("best", "mean", "worst")
_MEASURES = ("fitness", "goals", "lost", "kicks", "collisions", "steps")  # f, G, L, K, C and steps of the figures
_COUNTS = {
    "goals": "goals",
    "lost": "lost",
    "kicks": "contact",
    "passes": "passes",
    "collisions": "collisions",
    "steps": "steps",
}
_WHO = ("run", "recipe", "seed")
_BY_FITNESS = "fitness.kind"
_SOURCE = "dissertation-"

# Tables 6.4 to 6.6: setting, fitness, robot; depths of the best, the average and the worst individual, then nodes.
TABLES: dict[tuple[str, str, str], tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    ("two-learners", "fixed", "r0"): ((30, 24.3, 2), (729, 335.5, 3)),
    ("two-learners", "fixed", "r1"): ((15, 15.03, 17), (981, 909.4, 897)),
    ("two-learners", "varying", "r0"): ((12, 17.5, 5), (632, 594.5, 21)),
    ("two-learners", "varying", "r1"): ((13, 14.7, 16), (784, 821.4, 108)),
    ("stationary-opponent", "fixed", "r0"): ((13, 15.4, 4), (989, 1126.9, 7)),
    ("stationary-opponent", "fixed", "r1"): ((23, 17.7, 17), (261, 239.7, 125)),
    ("stationary-opponent", "varying", "r0"): ((14, 14.7, 8), (1021, 1328.3, 251)),
    ("stationary-opponent", "varying", "r1"): ((24, 18.3, 12), (1142, 1394.2, 860)),
    ("three-learners", "fixed", "r0"): ((24, 23.7, 25), (1433, 1373.2, 1505)),
    ("three-learners", "fixed", "r1"): ((15, 16.1, 18), (1093, 1081.8, 1265)),
    ("three-learners", "fixed", "r2"): ((21, 20.0, 21), (749, 772.5, 733)),
    ("three-learners", "varying", "r0"): ((25, 27.3, 18), (1810, 1635.7, 1206)),
    ("three-learners", "varying", "r1"): ((16, 17.3, 12), (1272, 1184.2, 1306)),
    ("three-learners", "varying", "r2"): ((24, 19.8, 27), (1762, 1083.5, 967)),
}


@dataclass(frozen=True)
class Evolved:
    """A finished run of a study.

    Attributes:
        setting: the recipe's name, without what says that it is the dissertation's.
        varied: values of the settings that the study varies, and the arm, by their keys.
        row: of the table of the study.
        run: its folder.
    """

    setting: str
    varied: Mapping[str, str]
    row: Mapping[str, str]
    run: Run

    @property
    def condition(self) -> str:
        """Setting and varied values in words."""
        return ", ".join([self.setting, *self._arms()])

    @property
    def arm(self) -> str:
        """Varied values alone, or the setting where there are none."""
        return ", ".join(self._arms()) or self.setting

    def _arms(self) -> list[str]:
        return [value if key in ("arm", _BY_FITNESS) else f"{key} {value}" for key, value in self.varied.items()]

    @property
    def fitness(self) -> str:
        """The kind of its fitness."""
        return str(self.run.config.fitness.kind)

    def source(self, robot: str) -> tuple[Sequence[float], Sequence[float]]:
        """Return depths and nodes of ``TABLES``; nothing of a recipe that is not the dissertation's."""
        recipe = self.row["recipe"]
        key = recipe.removeprefix(_SOURCE), self.fitness, robot
        return TABLES.get(key, ((), ())) if recipe.startswith(_SOURCE) else ((), ())

    def told(self, column: str) -> float:
        """Return a column of the study's table, NaN where the run has nothing there."""
        return float(self.row.get(column) or "nan")

    def teams(self) -> dict[int, list[str]]:
        """Return the names of the robots that evolve by the number of their team."""
        found: dict[int, list[str]] = {}
        for role, name in self.run.evolving.items():
            found.setdefault(self.run.game.roles[role].team, []).append(name)
        return found


Conditions = dict[str, list[Evolved]]
"""By the words for a condition, in the order of the study, its finished runs."""


def read_conditions(folder: Path) -> Conditions:
    """Read the finished runs of a study.

    Raises:
        InputError: there is none, or one of them is no run of evolution.
    """
    found: Conditions = {}
    finished = list(finished_runs(folder))
    recipes = {row["recipe"] for _, row in finished}
    for path, row in finished:
        names = list(row)
        varied = {name: row[name] for name in names[: names.index("run")] if name not in _WHO}
        setting = row["recipe"].removeprefix(_SOURCE)
        setting = row["recipe"] if setting in recipes else setting  # a preset of that name is another setting
        one = Evolved(setting, varied, row, open_run(path))
        if not one.run.is_finished:
            raise InputError(f"{path} is in the table of the study, but not finished; run 'coevo study' again")
        found.setdefault(one.condition, []).append(one)
    return found


def sizes(conditions: Conditions) -> Report:
    """Return depths and nodes of the trees of the last generation, beside Tables 6.4 to 6.6.

    Best and worst are by fitness, the average is over the population; means over runs.
    """
    told: Rows = []
    for name, runs in conditions.items():
        for robot in runs[0].run.evolving.values():
            last = [(rows := one.run.generations)[rows["robot"] == robot].iloc[-1] for one in runs]
            source = runs[0].source(robot)
            for what, theirs in zip(("depth", "nodes"), source, strict=True):
                ours = [mean_words([float(row[f"{what}_{which}"]) for row in last]) for which in _STATISTICS]
                told.append([name, str(len(runs)), robot, what, *ours, ", ".join(f"{number:g}" for number in theirs)])
    return {"sizes": (["condition", "runs", "robot", "of trees", "best", "average", "worst", "in the source"], told)}


def worth(conditions: Conditions) -> Report:
    """Return the shares of unseen games that last champions, first ones and single skills win, means over runs."""
    rows: Rows = []
    for name, runs in conditions.items():
        for team, robots in runs[0].teams().items():
            found = {
                who: np.array([one.told(f"team{team}_{who}") for one in runs])
                for who in ("last", "first", "single_skills")
            }
            ahead = [
                f"{int((found['last'] > found[other]).sum())} of {len(runs)}" for other in ("first", "single_skills")
            ]
            gain = mean_words((found["last"] - found["first"]).tolist(), least=-1.0, most=1.0)
            told = [mean_words(values.tolist(), most=1.0) for values in found.values()]
            rows.append([name, str(len(runs)), ", ".join(robots), *told, gain, *ahead])
    header = ["condition", "runs", "robots", "last", "first", "single skills", "last - first", "ahead of first"]
    return {"worth": ([*header, "of single skills"], rows)}


def differences(conditions: Conditions) -> Report:
    """Return by how much last champions win more unseen games than those of the setting's first condition.

    In the mean over runs of the same seeds, which meet the same games. Only where one team evolves: where two do, each
    is judged against the other of its own run, so that who wins more may just have met a worse one.
    """
    rows: Rows = []
    for runs, reference in _beside_the_first(conditions):
        known = {one.row["seed"]: one for one in reference}
        pairs = [(one, known[one.row["seed"]]) for one in runs if one.row["seed"] in known]
        teams = runs[0].teams()
        if len(teams) > 1 or not pairs:
            continue
        ((team, robots),) = teams.items()
        more = [one.told(f"team{team}_last") - other.told(f"team{team}_last") for one, other in pairs]
        ahead = f"{sum(gain > 0.0 for gain in more)} of {len(more)}"
        told = str(len(more)), ", ".join(robots), reference[0].condition
        rows.append([runs[0].condition, *told, mean_words(more, least=-1.0, most=1.0), ahead])
    return {"differences": (["condition", "runs", "robots", "beside", "more games won", "ahead"], rows)}


def _beside_the_first(conditions: Conditions) -> Iterator[tuple[list[Evolved], list[Evolved]]]:
    """Yield the runs of each condition but the first of its setting, and those of that first."""
    first: dict[str, list[Evolved]] = {}
    for runs in conditions.values():
        reference = first.setdefault(runs[0].setting, runs)
        if reference is not runs:
            yield runs, reference


def endings(conditions: Conditions) -> Report:
    """Return how games between the last champions end, the ratio of 6.4.3, and since when another side is ahead.

    Games that do not count what patterns are told by have no row. The ratio is in the mean over the runs that have
    games of either kind; take-overs are a share of runs with Wilson's interval, and the mean of their generations.
    """
    rows: Rows = []
    for name, runs in conditions.items():
        if any(np.isnan(one.told(settled_name(of))) for one in runs for of in PATTERNS):
            continue  # a game of one's own may not tell
        shares = [mean_words([one.told(settled_name(of)) for one in runs], most=1.0) for of in PATTERNS]
        ratios = [of for one in runs if not np.isnan(of := one.told("settled_ratio"))]
        most = [_most(one) for one in runs]
        usual = ", ".join(f"{of} {most.count(of)}" for of in PATTERNS if of in most)
        over, ratio = ["", ""], ""
        if len(runs[0].teams()) > 1:
            ratio = mean_words(ratios, most=1.0)
            took = [one.told("take_over") for one in runs if one.told("took_over") == 1.0]
            low, high = share_interval(len(took), len(runs))
            over = [f"{len(took)} of {len(runs)} [{low:.2f}, {high:.2f}]", mean_words(took)]
        rows.append([name, str(len(runs)), *shares, ratio, usual, *over])
    header = ["condition", "runs", *PATTERNS, "pass and shoot : interception", "most frequent"]
    return {"endings": ([*header, "others took over", "since generation"], rows)}


def play(conditions: Conditions) -> Report:
    """Return what the best individuals of the last generation did, per game: where Figs. 6.5, 6.6 and 6.10 to 6.13 end.

    These are the games that evolution judged them by, so the best look a little better than they are.
    """
    rows: Rows = []
    for name, runs in conditions.items():
        games = runs[0].run.config.evaluation.games
        for robot in runs[0].run.evolving.values():
            last = [(all_rows := one.run.generations)[all_rows["robot"] == robot].iloc[-1] for one in runs]
            told = [mean_words([float(row[count]) / games for row in last if count in row]) for count in _COUNTS]
            rows.append([name, str(len(runs)), robot, *told])
    return {"play": (["condition", "runs", "robot", *_COUNTS.values()], rows)}


def _most(one: Evolved) -> str:
    """Return how most decided games between the last champions of a run end; time-outs if none was decided."""
    shares = {pattern: one.told(settled_name(pattern)) for pattern in PATTERNS}
    most = max(PATTERNS[:-1], key=lambda pattern: shares[pattern])
    return most if shares[most] > 0.0 else PATTERNS[-1]


def late_and_early(conditions: Conditions) -> Report:
    """Return what the tournaments say that were played in runs: the last third of the generations against the first.

    A third's worth is the share of games that its champions win, over all opponents that took part. Runs without a
    tournament (``coevo tournament``) are left out. Where several sides evolve, a last row asks whether they all come
    forward in the same run: the smallest of a run's differences, and in how many runs every side is ahead.
    """
    rows: Rows = []
    for name, runs in conditions.items():
        played = [one for one in (largest_tournament(one.run) for one in runs) if one is not None]
        gains = []
        for side, (_, robots) in enumerate(runs[0].teams().items() if played else ()):
            early, late = np.array([_thirds(one.share(side)) for one in played]).T
            gains.append(late - early)
            labels = [
                label
                for one in played
                if len(one.generations) >= MINIMUM_GENERATIONS and (found := diagnoses(one)[side]) is not None
                for label in sorted(found.labels)
            ]
            told = [mean_words(values.tolist(), least=-1.0, most=1.0) for values in (early, late, late - early)]
            ahead = f"{int((late > early).sum())} of {len(played)}"
            counted = ", ".join(f"{label} {labels.count(label)}" for label in sorted(set(labels)))
            rows.append([name, str(len(played)), ", ".join(robots), *told, ahead, counted])
        if len(gains) > 1:
            least = np.min(gains, axis=0)
            told = ["", "", mean_words(least.tolist(), least=-1.0, most=1.0)]
            ahead = f"{int((least > 0.0).sum())} of {len(played)}"
            rows.append([name, str(len(played)), "all, the least", *told, ahead, ""])
    header = ["condition", "runs", "robots", "first third", "last third", "difference", "last ahead", "diagnoses"]
    return {"late-and-early": (header, rows)}


def _thirds(share: NDArray[np.float64]) -> tuple[float, float]:
    """Return the mean of the first and of the last third of the rows."""
    third = max(1, len(share) // 3)
    return float(share[:third].mean()), float(share[-third:].mean())


def levels(conditions: Conditions) -> Report:
    """Return how far environments that co-evolve (6.5) came, of the conditions that have levels.

    ``highest since``: the first generation on the highest level, in the mean over the runs that came to it.
    """
    rows: Rows = []
    for name, runs in conditions.items():
        settings = runs[0].run.config.levels
        if settings is None:
            continue
        highest = settings.levels - 1
        tables = [level_table(one.run) for one in runs]
        at = [table["level"].to_numpy() for table in tables]
        since = [float(np.argmax(of == highest)) for of in at if (of == highest).any()]
        told = [mean_words([float(of[-1]) for of in at], most=highest), str(highest)]
        told += [f"{len(since)} of {len(runs)}", mean_words(since)]
        told += [mean_words([float(np.mean(of == highest)) for of in at], most=1.0)]
        told += [mean_words([float((of["event"] == event).sum()) for of in tables]) for event in ("raised", "lowered")]
        rows.append([name, str(len(runs)), *told])
    came = ["last level", "highest", "came to it", "highest since", "generations on it", "raised", "lowered"]
    return {"levels": (["condition", "runs", *came], rows)}


def figures(conditions: Conditions) -> dict[str, alt.VConcatChart]:
    """Return curves over generations by the names of their files, a file a setting, where conditions are compared."""
    settings: dict[str, list[Evolved]] = {}
    for runs in conditions.values():
        settings.setdefault(runs[0].setting, []).extend(runs)
    found = {}
    for setting, evolved in settings.items():
        opened = [one.run for one in evolved]
        groups = dict(zip(run_names(opened), (one.arm for one in evolved), strict=True))
        measured = table(opened)
        known = set(measured["measure"])  # a game of one's own need not count goals
        curves = choose(measured, [name for name in _MEASURES if name in known], ("best", "mean"))
        told = (
            f"best (by fitness) and mean of a generation; means over runs ({len(opened)} in all), bands: 95 % intervals"
        )
        words = replace(words_for(opened), title=setting, subtitle=told)
        found[f"{setting}.svg"] = chart(summary(curves, groups), words)
    return found


@click.command()
@report_options
def report(*, folder: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Make the tables and figures of chapter 6 from the study in FOLDER, which may be under way.

    \b
    Example: coevo reproduce chapter6 runs/chapter6-study
    """
    del quiet  # it shows no progress
    altair()
    conditions = read_conditions(folder)
    tables = (worth, differences, endings, late_and_early, levels, play, sizes)
    parts = [part(conditions) for part in tables]
    shown = {name: one for part in parts for name, one in part.items()}
    write_report(out or folder / "report", shown, {}, figures(conditions), as_json=as_json)
