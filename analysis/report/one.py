"""The page about one run."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

import pandas as pd

from analysis.ancestry import family_table, origin_table, sentences, summary
from analysis.charts import spec_of
from analysis.curves import choose, table
from analysis.curves import summary as summarise
from analysis.levels import level_chart, level_table, level_words
from analysis.report.gather import Findings
from analysis.report.parts import (
    Code,
    Figure,
    Heading,
    Part,
    Picture,
    Player,
    Points,
    Section,
    Short,
    Table,
    Text,
    cells,
)
from analysis.report.words import in_short, percent, who
from analysis.tournament import rate
from analysis.tournament.tables import against_table, master_table, matrix_table
from coevo.config import to_toml
from coevo.portrait import describe
from coevo.run import Run

if TYPE_CHECKING:
    import altair as alt

__all__ = ["figure", "sections_of", "title_of"]


def sections_of(findings: Findings) -> list[Section]:
    """Return all sections of a run's page."""
    sections = [_short(findings), _curves(findings.run), _progress(findings), _robots(findings), _ancestry(findings)]
    if findings.replay:
        sections.append(_games(findings.replay))
    return [*sections, _settings(findings.run)]


def figure(title: str, about: str, chart: alt.TopLevelMixin, frame: pd.DataFrame) -> Figure:
    """Return a chart with the table behind it."""
    header, rows = cells(frame)
    return Figure(title, about, spec_of(chart), header, rows)


def _short(findings: Findings) -> Section:
    rows = [
        [
            who(one.robots),
            percent(one.last),
            percent(one.first),
            percent(one.single_skills),
            ", ".join(one.skills.values()),
        ]
        for one in findings.judged
    ]
    header = ["side", "last champions", "first champions", "best single skills", "which"]
    caption = f"Share of {findings.judged[0].games} unseen games won, with 95 % intervals."
    texts = in_short(findings.run, findings.judged, findings.dynamics, findings.left)
    return Section("short", "In short", "In short", [Short(texts), Table(header, rows, caption)])


def _wide(curves: pd.DataFrame) -> pd.DataFrame:
    """Return a row a generation and robot, a column a measure and statistic."""
    wide = curves.pivot_table(
        index=["generation", "robot"], columns=["measure", "statistic"], values="value", sort=False
    )
    wide.columns = pd.Index([" ".join(name) for name in wide.columns.to_list()])
    return wide.reset_index()


def _curves(run: Run) -> Section:
    from analysis.curve_chart import chart, words_for

    everything, words = table([run]), words_for([run])
    measured = list(dict.fromkeys(everything["measure"]))
    counts = [name for name in run.game.counts if name in measured]
    uses = [name for name in measured if name.startswith("use_")]
    parts: list[Part] = []
    for title, about, names in (
        (
            "Fitness",
            "Smaller is better. The best is the luckiest, too: see how much is left when it plays again.",
            ["fitness"],
        ),
        ("What the game counts", "Of the best individual, and of the mean and the worst.", counts),
        ("What robots choose", "Share of the decisions that end at each terminal.", uses),
        ("Trees", "Depth and nodes, and how different the trees of a population are.", ["depth", "nodes", "diversity"]),
    ):
        if names:
            chosen = choose(everything, names)
            drawn = chart(summarise(chosen), words)
            parts.append(figure(title, about, drawn, _wide(chosen)))
    if run.config.levels is not None:
        levels = level_table(run)
        parts.append(figure("Levels", level_words(run, levels), level_chart(levels), levels))
    return Section("curves", "Curves", "Generation by generation", parts)


def _progress(findings: Findings) -> Section:
    from analysis.tournament.charts import against_chart, master_chart, matrix_chart, ratings_chart

    played, sides = findings.tournament, findings.sides
    alone = len(sides) == 1
    told = [f"{side}: {said}" for side, said in zip(sides.values(), findings.dynamics, strict=True)]
    matrix, master = matrix_table(played), master_table(played)
    met = "from other starts" if alone else "against the champions of other generations"
    parts: list[Part] = [
        Text(
            "Fitness says how a robot did among its own generation. Here the champions of different generations"
            f" play {met}, {played.games} games each, so that what is better is seen to be so."
        ),
        Points(told),
        figure(
            "Every generation against every other",
            "A row is a generation of the side that the panel names. If it gets brighter upwards, later champions win"
            " more against the same opponents: progress. Stripes that come and go are cycles.",
            matrix_chart(matrix, alone=alone),
            _square(matrix),
        ),
        figure(
            "Against all generations together",
            "The mean of each row above (master tournament), with the 95 % interval of its games.",
            master_chart(master),
            master,
        ),
    ]
    outside = against_table(findings.against, sides)
    if not alone and len(outside):
        parts.append(
            figure(
                "Against robots that never change",
                "Each robot of the other side uses one skill throughout.",
                against_chart(outside),
                outside.pivot_table(
                    index=["side", "generation"], columns="outsider", values="share", sort=False
                ).reset_index(),
            )
        )
    if not alone:
        ratings = rate(played)
        warning = (
            f" Who wins depends on who meets whom here (misfit {ratings.misfit:.1f}): ratings mislead."
            if ratings.mislead
            else ""
        )
        parts.append(
            figure(
                "Ratings",
                f"Bradley and Terry's model: 400 points more are odds of 10 to 1. The mean of a side is 0.{warning}",
                ratings_chart(ratings.table, sides),
                ratings.table.assign(side=ratings.table["team"].map(sides)).drop(columns="team"),
            )
        )
    if findings.left:
        rows = [[one.robot, one.text] for one in findings.left]
        parts += [
            Heading("Played again"),
            Text(
                "How much of a champion's advantage over its generation is left with other partners and other starts."
            ),
            Table(
                ["robot", "left, with its 95 % interval"],
                rows,
                f"Champions of {findings.left[0].generations} generations.",
            ),
        ]
    return Section("progress", "Progress", "Is it progress?", parts)


def _square(matrix: pd.DataFrame) -> pd.DataFrame:
    wide = matrix.pivot_table(index=["side", "generation"], columns="met", values="share", sort=False)
    return wide.reset_index()


def _robots(findings: Findings) -> Section:
    parts: list[Part] = []
    for tree in findings.trees:
        parts.append(Heading(tree.robot))
        told = describe(tree)
        parts.append(Text(told.about))
        for heading, cases in told.cases:
            parts += [Text(heading), Points([f"{share}: {when}" for share, when in cases])]
        parts += [
            Text(told.worth),
            Picture(
                f"The tree of {tree.robot}",
                f"Nodes: {tree.tree.nodes} as it was bred, {tree.simplified.nodes} simplified to the same behaviour;"
                " what was hardly used is folded. Wider lines carried more decisions.",
                tree._repr_svg_(),
            ),
            Code(str(tree.tree), f"The whole tree of {tree.robot} as text"),
        ]
    return Section("robots", "Robots", "What the robots do", parts)


def _ancestry(findings: Findings) -> Section:
    from analysis.ancestry.charts import family_chart, origin_chart

    parts: list[Part] = []
    for tree, found in zip(findings.trees, findings.ancestries, strict=True):
        if isinstance(found, str):
            parts.append(Text(found))
            continue
        parts.append(Heading(found.robot))
        parts += [Text(text) for text in sentences(summary(found), tree.rank, tree.again)]
        parts += [
            figure(
                f"Ancestors of the champion of {found.robot}",
                "Each point is an ancestor; larger ones carried more of the champion's nodes. The strong line is"
                " the line of first parents, who gave the root.",
                family_chart(found),
                family_table(found),
            ),
            figure(
                f"When the nodes of {found.robot} arose",
                "In which generation, and by which operator, each node of the champion came into being.",
                origin_chart(found),
                origin_table(found),
            ),
        ]
    return Section("ancestry", "Ancestry", "Where they come from", parts)


def _games(replay: str) -> Section:
    about = "The last champions in games that evolution has not seen. Space plays and pauses."
    return Section("games", "Games", "Games to watch", [Player("Games of the last champions", about, replay)])


def _settings(run: Run) -> Section:
    versions, folder = run.environment, shlex.quote(str(run.path))
    steps = [
        f"coevo evolve {shlex.quote(str(run.path / 'config.toml'))} --out again",
        f"coevo tournament {folder}",
        f"coevo play {folder} --games 20",
        f"coevo report {folder}",
    ]
    parts: list[Part] = [
        Text("The first command repeats the run, to the byte; the others make again what this page shows, and more."),
        Code("\n".join(steps)),
        Code(to_toml(run.config), "All settings (config.toml)"),
        Code(versions, "Versions, commit and digests of skills (environment.json)"),
    ]
    return Section("settings", "Settings", "Settings, and how to repeat it", parts)


def title_of(run: Run) -> tuple[str, str]:
    """Return the title of a run's page, and the line below it."""
    config = run.config
    kind = config.fitness.kind
    return f"{config.name}, seed {config.seed}", f"{run.path.name}: {run.finished} generations, fitness {kind}"
