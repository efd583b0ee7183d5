"""The page that compares several runs."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from analysis.curves import choose, table
from analysis.curves import summary as summarise
from analysis.groups import group_names, run_names
from analysis.report.one import figure
from analysis.report.parts import Code, Part, Points, Section, Short, Table, Text
from analysis.report.words import percent, who
from analysis.tournament import cross_play, diagnoses, largest_tournament, same_game
from coevo.contest import Judged, judge
from coevo.evolution.evaluation import Evaluator
from coevo.run import Run
from coevo.statistics import bootstrap_interval, probability_of_improvement
from coevo.usage import used_tree

__all__ = ["Comparison", "compare", "sections_of_several"]

_UNSEEN = 200  # games by which each run's last champions are judged
_CROSS = 40  # games of each pair of runs


@dataclass(frozen=True)
class Comparison:
    """What was found out about several runs.

    Attributes:
        runs, names: the runs and what they are called.
        groups: the group of each run by its name; runs that differ in the seed alone are one.
        judged: for each run how its last champions do in unseen games.
        cross: last champions of runs against those of other runs (``analysis.tournament.cross_play``); empty where the
            runs are about different games.
        used: a row a run and robot: the share of each terminal in the decisions of its last champion.
        labels: for each run what its kept tournament is called; empty where there is none.
    """

    runs: Sequence[Run]
    names: Sequence[str]
    groups: Mapping[str, str]
    judged: Sequence[Sequence[Judged]]
    cross: pd.DataFrame
    used: pd.DataFrame
    labels: Sequence[str]

    @property
    def scores(self) -> pd.DataFrame:
        """A row a side and run: ``side``, ``group``, ``run``, ``score``, its mean share over all runs it met."""
        found = self.cross.groupby(["side", "run"], sort=False)["share"].mean().rename("score").reset_index()
        found.insert(1, "group", found["run"].map(dict(self.groups)))
        return found


def compare(runs: Sequence[Run], *, workers: int, backend: str, tell: Callable[[str], None]) -> Comparison:
    """Play what a comparison needs.

    Args:
        runs: each with a finished generation.
        workers, backend: of the games.
        tell: receives a line before each part.
    """
    names = run_names(runs)
    judged, labels, rows = [], [], []
    for run, name in zip(runs, names, strict=True):
        tell(f"Judging the last champions of {name} ...")
        with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
            judged.append(list(judge(run, evaluator, games=_UNSEEN)))
        kept = largest_tournament(run)
        found = [] if kept is None else [of for of in diagnoses(kept) if of is not None]
        labels.append("; ".join(", ".join(sorted(of.labels)) for of in found))
        rows += [
            {"run": name, "robot": robot, **used_tree(run, robot).usage.skill_use} for robot in run.evolving.values()
        ]
    cross = pd.DataFrame(columns=["side", "run", "met", "share"])
    if same_game(runs):
        tell("Letting their last champions play against each other ...")
        first = runs[0]
        with Evaluator(first.config, workers=workers, backend=backend, folders=first.folders) as evaluator:
            cross = cross_play(runs, names, evaluator, games=_CROSS)
    return Comparison(runs, names, group_names(runs), judged, cross, pd.DataFrame(rows), labels)


def _improvements(found: Comparison) -> pd.DataFrame:
    """Return for each side and pair of groups how probably a run of the one is better than a run of the other."""
    rows = []
    for side, scores in found.scores.groupby("side", sort=False):
        of_group = {str(group): part["score"].to_numpy() for group, part in scores.groupby("group", sort=False)}
        for one, other in itertools.combinations(of_group, 2):
            probability, low, high = probability_of_improvement(of_group[one], of_group[other])
            rows.append((str(side), one, other, probability, low, high))
    return pd.DataFrame(rows, columns=["side", "group", "than", "probability", "low", "high"])


def _group_table(found: Comparison) -> list[tuple[str, str, str]]:
    """Return side and group, number of runs, and the mean of their scores with its interval over runs."""
    rows = []
    for (side, group), part in found.scores.groupby(["side", "group"], sort=False):
        mean, low, high = (float(value) for value in bootstrap_interval(part["score"].to_numpy()))
        told = percent((mean, max(0.0, low), min(1.0, high))) if len(part) > 1 else f"{100 * mean:.0f} %"
        rows.append((f"{side}: {group}", str(len(part)), told))
    return rows


def sections_of_several(found: Comparison) -> tuple[list[Section], list[str]]:
    """Return all sections of the page that compares runs, and what it says in short."""
    improvements, groups = _improvements(found), list(dict.fromkeys(found.groups.values()))
    short = _in_short(found, improvements, groups)
    sections = [Section("short", "In short", "In short", [Short(short), _runs(found)])]
    sections += [_curves(found), _meetings(found, improvements), _use(found), _again(found)]
    return [section for section in sections if section.parts], short


def _in_short(found: Comparison, improvements: pd.DataFrame, groups: Sequence[str]) -> list[str]:
    counts = [f"{sum(of == group for of in found.groups.values())} of {group}" for group in groups]
    texts = [f"{len(found.runs)} runs in {len(groups)} {'group' if len(groups) == 1 else 'groups'}: {who(counts)}."]
    if found.cross.empty:
        texts.append("They are about different games or worlds: their champions cannot meet, and are judged apart.")
        return texts
    for side, *pair, probability, low, high in improvements.itertuples(index=False):
        group, other = pair if probability >= 0.5 else reversed(pair)
        if probability < 0.5:
            probability, low, high = 1.0 - probability, 1.0 - high, 1.0 - low  # noqa: PLW2901 - said the other way round
        certain = "" if low > 0.5 or high < 0.5 else ", which these runs cannot tell from a toss of a coin"
        texts.append(
            f"{side}: a run of {group} makes better last champions than one of {other} with probability"
            f" {probability:.2f} [{low:.2f}, {high:.2f}]{certain}."
        )
    over = [(one, name) for judged, name in zip(found.judged, found.names, strict=True) for one in judged]
    for robots in dict.fromkeys(one.robots for one, _ in over):
        mine = [one for one, _ in over if one.robots == robots]
        better = sum(one.over_single_skills[1] > 0.0 for one in mine)
        worse = sum(one.over_single_skills[2] < 0.0 for one in mine)
        texts.append(
            f"{who(robots)}: against its own last opponents the evolved side wins more than the best team of single"
            f" skills in {better} of {len(mine)} runs, fewer in {worse}; the others cannot be told apart."
        )
    return texts


def _runs(found: Comparison) -> Table:
    sides = list(dict.fromkeys(one.robots for judged in found.judged for one in judged))
    header = ["run", "group", "seed", "generations", *(f"{who(side)} won" for side in sides), "tournament"]
    rows = []
    for run, name, judged, label in zip(found.runs, found.names, found.judged, found.labels, strict=True):
        won = {one.robots: percent(one.last) for one in judged}
        cells = [name, found.groups[name], str(run.config.seed), str(run.finished), *(won.get(s, "") for s in sides)]
        rows.append([*cells, label or "none kept"])
    caption = f"Share of {_UNSEEN} unseen games that last champions win against their own last opponents."
    return Table(header, rows, caption)


def _curves(found: Comparison) -> Section:
    from analysis.curve_chart import chart, words_for

    everything, words = table(found.runs), words_for(found.runs)
    shared = choose(everything)["measure"].unique()
    counts = [name for name in found.runs[0].game.counts if name in shared]
    parts: list[Part] = []
    for title, about, names in (
        ("Fitness", "Smaller is better; each generation is compared with its own contemporaries only.", ["fitness"]),
        ("What the game counts", "Of the best individual, and the mean of the population.", counts),
        ("What robots choose", "Share of decisions.", [name for name in shared if name.startswith("use_")]),
        ("Trees", "Depth and nodes, and how different the trees of a population are.", ["depth", "nodes", "diversity"]),
    ):
        if names:
            curves = summarise(choose(everything, names, ("best", "mean")), found.groups)
            parts.append(figure(title, about, chart(curves, words), curves))
    return Section("curves", "Curves", "Generation by generation", parts)


def _meetings(found: Comparison, improvements: pd.DataFrame) -> Section:
    if found.cross.empty:
        return Section("meetings", "Against each other", "", [])
    from analysis.tournament.charts import cross_chart

    rows = _group_table(found)
    alone = not any(one.robots != found.judged[0][0].robots for one in found.judged[0])
    about = (
        "Each run's last champions play from the same starts."
        if alone
        else f"Each run's last champions meet the other side's of every run, {_CROSS} games a pair."
    )
    wide = found.cross.pivot_table(index=["side", "run"], columns="met", values="share", sort=False).reset_index()
    parts: list[Part] = [
        Text("Fitness compares a robot with its contemporaries. Here all runs are judged by the same opponents."),
        Table(["side and group", "runs", "games won"], rows, "Mean over runs with its 95 % interval over runs."),
        figure("Run against run", about, cross_chart(found.cross), wide),
    ]
    if len(improvements):
        told = [
            [f"{side}: {group}", other, f"{probability:.2f} [{low:.2f}, {high:.2f}]"]
            for side, group, other, probability, low, high in improvements.itertuples(index=False)
        ]
        caption = "Probability that a run of the one group does better than a run of the other."
        parts.append(Table(["side and group", "better than", "probability"], told, caption))
    return Section("meetings", "Against each other", "Against each other", parts)


def _use(found: Comparison) -> Section:
    names = [name for name in found.used.columns if name not in ("run", "robot")]
    used = found.used.fillna(0.0)
    rows = [[f"{row['run']} {row['robot']}", *(f"{row[name]:.0%}" for name in names)] for _, row in used.iterrows()]
    caption = "Share of the decisions of each last champion, in the games that it was scored by."
    return Section("robots", "Robots", "What the robots do", [Table(["run and robot", *names], rows, caption)])


def _again(found: Comparison) -> Section:
    paths = [str(run.path) for run in found.runs]
    runs = list(zip(found.runs, found.names, strict=True))
    steps = [
        f"coevo evolve {shlex.quote(f'{run.path}/config.toml')} --out {shlex.quote('again-' + name.replace('/', '-'))}"
        for run, name in runs
    ]
    return Section(
        "settings",
        "Settings",
        "How to repeat it",
        [
            Points([f"{name}: {found.groups[name]}, seed {run.config.seed}" for run, name in runs]),
            Code("\n".join([*steps, f"coevo report {shlex.join(paths)}"])),
            Text("Trees, ancestry, games and the tournament of a run are on its own page:"),
            Code("\n".join(f"coevo report {shlex.quote(path)}" for path in paths)),
        ],
    )
