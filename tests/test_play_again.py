"""Games of evolution once more, from the run folder alone: the same games, and what is refused."""

from __future__ import annotations

import json
import re
import sys

import numpy as np
import pandas as pd
import pytest

from coevo.cli import main
from coevo.evolution.evaluation import Evaluator
from coevo.game import programs_of
from coevo.usage import group_trees, seeds_of_group

COUNTS = ("goals", "lost", "kicks", "collisions", "steps", "passes", "own_goals")


@pytest.fixture
def play(monkeypatch, capsys):
    """Return a function that runs 'coevo play' and returns its exit code, output and complaint."""

    def run(run, *arguments):
        monkeypatch.setattr(sys, "argv", ["coevo", "play", str(run.path), *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def recorded(run, generation, group):
    """Return by count what was recorded of each robot of a group."""
    table = run.individuals
    rows = table[(table["generation"] == generation) & (table["group"] == group)].set_index("robot")
    return {name: rows[name].to_dict() for name in COUNTS}


@pytest.mark.parametrize("generation", range(3))
def test_a_group_plays_the_games_that_were_recorded(small_run, play, generation):
    for group in range(small_run.config.gp.population):
        code, out, _ = play(small_run, "--generation", generation, "--group", group, "--json")
        told, expected = json.loads(out), recorded(small_run, generation, group)
        assert code == 0
        assert (told["generation"], told["group"], told["games"]) == (generation, group, 2)
        assert {name: told[name] for name in COUNTS if name != "steps"} == {
            name: counts for name, counts in expected.items() if name != "steps"
        }
        assert {told["steps"]} == set(expected["steps"].values())


def test_games_of_a_group_are_those_of_the_evaluator_one_by_one(small_run, play):
    game = small_run.game
    groups = [programs_of(game, group_trees(small_run, 1, group)) for group in range(6)]
    with Evaluator(small_run.config, workers=1, backend="threads") as evaluator:
        played = list(evaluator.play(1, groups))
    digests = set()
    for number in range(2):
        told = json.loads(play(small_run, "--generation", 1, "--group", 4, "--game", number, "--json")[1])
        assert (told["games"], told["game"]) == (1, number)
        for name in COUNTS[:4]:
            assert list(told[name].values()) == played[4].counts[name][number].tolist()
        assert told["steps"] == played[4].counts["steps"][number, 0]
        digests.add(told["digest"])
    assert len(digests) == 2
    assert len(np.unique(np.concatenate([seeds_of_group(small_run, g, k) for g in range(3) for k in range(6)]))) == 36


def test_a_page_of_a_group_names_its_games_and_holds_its_trees(small_run, play, tmp_path):
    files = ["--trace", tmp_path / "t.csv", "--video", tmp_path / "v.html"]
    code, out, _ = play(small_run, "--group", 2, "--game", 1, *files)
    assert code == 0
    assert out.startswith("game 1 of group 2 of generation 2, ")
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r'type="application/json">(.*?)</script>', page, re.DOTALL)[1])
    assert data["name"] == "smoke: group 2 of generation 2"
    assert [game["title"] for game in data["games"]] == ["game 1"]
    trees = group_trees(small_run, 2, 2)
    assert [len(robot["tree"]["nodes"]) for robot in data["robots"]] == [tree.nodes for tree in trees]
    rows = pd.read_csv(tmp_path / "t.csv")
    assert rows["step"].max() == data["games"][0]["steps"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--group", 6], "has the groups 0 to 5, got 6"),
        (["--group", 0, "--game", 2], "played the games 0 to 1, got 2"),
        (["--generation", 3, "--group", 0], "has no generation 3; finished generations: 0 to 2"),
        (["--game", 0], "say which with --group"),
        (["--group", 0, "--seed", 1], "leave out --seed"),
        (["--group", 0, "--games", 20], "leave out --games"),
        (["--group", -1], "'--group'"),
        (["--group", 0, "--video", "game.avi"], "a video file ending in .mp4, .gif, .html, got game.avi"),
    ],
)
def test_what_was_never_played_is_refused_in_words(small_run, play, arguments, said):
    code, out, err = play(small_run, *arguments)
    assert (code, out) == (2, "")
    assert said in err
    assert "Traceback" not in err
