"""The how-tos, followed to the letter in an empty folder: their files are written, and their commands run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pandas as pd
import pytest

from analysis.tournament import stored_tournaments
from coevo.cli import main
from coevo.run import open_run
from coevo.tree import simplify

DOCS = Path(__file__).resolve().parents[2] / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"# (\S+\.(?:py|toml))\n")


@pytest.fixture
def coevo(monkeypatch, capsys):
    """Return a function that runs a command as a shell would, and returns its output."""

    def run(line):
        monkeypatch.setattr("sys.argv", shlex.split(line))
        main()  # what goes wrong ends Python, and so fails the test
        return capsys.readouterr().out

    return run


@pytest.fixture
def follow(tmp_path, monkeypatch, coevo):
    """Return a function that does what a how-to says, and returns the folder that it was done in."""

    def do(name):
        monkeypatch.chdir(tmp_path)
        commands = 0
        for language, text in BLOCK.findall((DOCS / "how-to" / name).read_text(encoding="utf-8")):
            named = NAMED.match(text)
            if named:
                Path(named.group(1)).write_text(text, encoding="utf-8")
            if language == "sh":
                for line in text.splitlines():
                    command, _, file = line.partition(" > ")
                    said = coevo(command)
                    if file:
                        Path(file).write_text(said, encoding="utf-8")
                    commands += 1
        assert commands
        return tmp_path

    return do


def trees(run):
    return [run.tree(robot, 0, rank) for robot in run.evolving.values() for rank in range(run.config.gp.population)]


def test_condition(follow):
    run = open_run(follow("condition.md") / "runs" / "near")
    assert any("IF_ball_is_near" in tree.names for tree in trees(run))


@pytest.mark.slow
def test_curriculum(follow):
    folder = follow("curriculum.md") / "runs" / "noisy"
    moved, observed = (pd.read_csv(folder / f"{name}.csv") for name in ("levels", "observations"))
    assert moved["event"].iloc[[0, -1]].tolist() == ["start", "end"]
    assert set(moved["world.camera.noise_px"]) <= {0.0, 0.5, 1.0, 1.5}
    assert observed["trial"].tolist() == [100 * (n + 1) for n in range(len(observed))]


def test_fitness(follow, coevo):
    folder = follow("fitness.md")
    table = pd.read_parquet(folder / "runs" / "passing" / "individuals.parquet")
    games, left = 4, 1.0 - table["generation"] / 3
    expected = games - table["goals"] - 0.5 * left * table["passes"] + table["own_goals"]
    assert table["fitness"].tolist() == expected.tolist()

    # Changed meanwhile: the run has its own copy, and repeats with it.
    (folder / "teamwork.py").write_text("nonsense", encoding="utf-8")
    coevo("coevo evolve runs/passing/config.toml --out again")
    one, two = (folder / name / "generations.csv" for name in ("again", "runs/passing"))
    assert one.read_bytes() == two.read_bytes()


def test_game(follow):
    run = open_run(follow("game.md") / "runs" / "echo")
    best = run.generations[run.generations["generation"] == 4]
    assert best["robot"].tolist() == ["one", "two"]
    assert best["agreed"].tolist() == [40, 40]  # all rounds of all games


@pytest.mark.slow
def test_grouping(follow):
    runs = {path.name: open_run(path) for path in (follow("grouping.md") / "runs").iterdir()}
    assert all(run.is_finished for run in runs.values())
    assert {run.config.evaluation.grouping for run in runs.values()} == {"random", "partners", "best", "hall-of-fame"}
    assert runs["frozen"].evolving == {0: "r0", 1: "r1"}
    assert set(runs["chosen"].champions()["games"]) == set(runs["control"].champions()["games"]) == {40}
    assert set(runs["control"].individuals["operator"]) == {"creation", "elite"}
    first = runs["taught"].individuals.query("generation == 0 and index < 2 and robot == 'r0'")["nodes"]
    assert first.tolist() == [3, 1]


def test_inspect(follow):
    folder = follow("inspect.md")
    whole, simplified = ((folder / name).read_text(encoding="utf-8") for name in ("all.svg", "tree.svg"))
    tree = open_run(folder / "runs" / "seen").tree("r1", 2)
    assert whole.count('class="label"') == tree.nodes
    assert 0 < simplified.count('class="label"') <= simplify(tree).nodes
    ((_, text),) = [
        block for block in BLOCK.findall((DOCS / "how-to/inspect.md").read_text("utf-8")) if "py" in block[0]
    ]
    names = {}
    exec(text, names)  # noqa: S102 - of our own page
    assert names["used"].tree == tree


def test_ancestry(follow):
    folder = follow("ancestry.md")
    assert "individual" in (folder / "family.svg").read_text(encoding="utf-8")
    ancestors = pd.read_csv(folder / "ancestors.csv")
    ((_, text),) = [
        block for block in BLOCK.findall((DOCS / "how-to/ancestry.md").read_text("utf-8")) if "py" in block[0]
    ]
    names = {}
    exec(text, names)  # noqa: S102 - of our own page
    best = open_run(folder / "runs" / "family").record(2, "r0").iloc[0]
    assert names["operators"].sum() == 3 * 3 * 12
    assert names["born"].sum() == best["nodes"] == ancestors["carried"].iloc[-1]


@pytest.mark.slow
def test_baselines(follow):
    folder = follow("baselines.md")
    found = pd.read_csv(folder / "baselines.csv")
    assert set(found["robots"]) == {"r2"}
    assert found["run"].nunique() == 2
    (text,) = [
        text for kind, text in BLOCK.findall((DOCS / "how-to/baselines.md").read_text("utf-8")) if kind == "python"
    ]
    names = {}
    exec(text, names)  # noqa: S102 - of our own page
    assert names["rows"]["kind"].tolist()[:3] == ["champions", "single skills", "small trees"]


@pytest.mark.slow
def test_curves(follow, capsys):
    folder = follow("curves.md")
    pictures = ("first.svg", "goals.svg", "groups.svg")
    assert all("<svg" in (folder / name).read_text(encoding="utf-8") for name in pictures)
    (text,) = [text for kind, text in BLOCK.findall((DOCS / "how-to/curves.md").read_text("utf-8")) if kind == "python"]
    names = {}
    exec(text, names)  # noqa: S102 - of our own page
    assert "first" in capsys.readouterr().out
    assert set(names["bands"]["group"]) == {"smoke fitness.kind=fixed", "smoke fitness.kind=varying"}
    assert 0.0 <= names["low"] <= names["share"] <= names["high"] <= 1.0


@pytest.mark.slow
def test_skill(follow):
    run = open_run(follow("skill.md") / "runs" / "finding")
    used = {name for tree in trees(run) for name in tree.names if not name.startswith("IF_")}
    assert used == {"shoot", "pass", "avoid", "find"}
    assert list(run.game.function_set(0).terminals) == ["shoot", "pass", "avoid", "find"]


@pytest.mark.slow
def test_study(follow, capsys):
    folder = follow("study.md")
    table, again = (pd.read_csv(folder / "runs" / name / "table.csv") for name in ("mine", "again"))
    assert table["run"].tolist() == [f"smoke-{kind}-seed{seed}" for kind in ("fixed", "varying") for seed in range(3)]
    assert again.equals(table[table["seed"] < 2].reset_index(drop=True))
    assert "comparison.html" in {path.name for path in folder.iterdir()}
    (text,) = [text for kind, text in BLOCK.findall((DOCS / "how-to/study.md").read_text("utf-8")) if kind == "python"]
    exec(text, {})  # noqa: S102 - of our own page
    assert capsys.readouterr().out.split()[0] == "fixed"


def test_variation(follow):
    runs = {path.name: open_run(path) for path in (follow("variation.md") / "runs").iterdir()}
    assert set(runs) == {"context", "steps", "short", "tables"}
    begun = runs["tables"].individuals.query("generation == 0 and robot == 'r0'")
    assert set(begun["nodes"]) == {11}  # 3 x 2 leaves
    assert trees(runs["context"]) == trees(runs["steps"]) == trees(runs["short"])  # only what is bred differs
    bred = {name: run.individuals.query("generation > 0 and operator != 'elite'") for name, run in runs.items()}
    assert not bred["context"].equals(bred["steps"])

    short = runs["short"]
    functions = {name: short.game.function_set(robot) for robot, name in short.evolving.items()}
    for robot, generation in bred["short"].groupby(["robot", "generation"]).groups:
        for rank, operator in enumerate(short.record(generation, robot)["operator"]):
            tree = short.tree(robot, generation, rank)
            assert operator == "elite" or simplify(tree, functions[robot]) == tree


def test_watch(follow):
    folder = follow("watch.md")
    assert {path.name for path in folder.glob("*.html")} == {"again.html", "game.html", "search.html", "shoot.html"}
    assert "group 5 of generation 2" in (folder / "game.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_tournament(follow):
    folder = follow("tournament.md")
    assert (folder / "matrix.svg").read_text(encoding="utf-8").startswith("<svg")
    tournaments = stored_tournaments(open_run(folder / "runs" / "smoke"))
    assert [one.generations for one in tournaments] == [(0, 1, 2, 3, 4, 5), (0, 2, 4, 5)]


@pytest.mark.slow
def test_report(follow):
    folder = follow("report.md")
    for name, title in (("one.html", "smoke, seed 0"), ("comparison.html", "3 runs: smoke fitness.kind=fixed")):
        assert f"<h1>{title}" in (folder / name).read_text(encoding="utf-8")


@pytest.mark.slow
def test_levels(follow, capsys):
    folder = follow("levels.md")
    table = pd.read_csv(folder / "runs" / "noisy" / "levels.csv")
    run = open_run(folder / "runs" / "noisy")
    levels = {0: (0.2, 0.0, 200), 1: (0.37, 0.0, 200), 2: (0.37, 0.5, 220), 3: (0.37, 1.0, 240)}
    assert table["level"].max() > 0
    for row in table.itertuples(index=False):
        played_by = run.config_of(int(row.generation))
        values = played_by.world.ball.mass_kg, played_by.world.camera.noise_px, played_by.game.time_limit_steps
        assert values == levels[int(row.level)]
    (text,) = [text for kind, text in BLOCK.findall((DOCS / "how-to/levels.md").read_text("utf-8")) if kind == "python"]
    assert len(text.splitlines()) <= 40
    names = {}
    exec(text, names)  # noqa: S102 - of our own page
    assert names["events"][0].kind == "start"
    assert names["events"][-1].kind == "end"
    assert names["controller"].level > 0
    assert "raised" in capsys.readouterr().out
