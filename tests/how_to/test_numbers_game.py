"""The numbers games: their rules by hand, and evolution to the known solution."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from coevo.config import check_experiment, read_toml
from coevo.errors import InputError
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.game import check_game, check_played, make_game, programs_of
from coevo.run import create_run, open_run
from coevo.tree import compile_program, parse, simplify, tree_codes
from coevo.usage import group_trees, seeds_of_group

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
SOLUTION = "IF_dimension_is_1(IF_bit_1_is_one(say_one, say_zero), IF_bit_0_is_one(say_one, say_zero))"


@pytest.fixture(scope="module")
def numbers():
    """Return the example's module, imported by its path."""
    spec = importlib.util.spec_from_file_location("numbers_game", EXAMPLES / "numbers_game.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = EXAMPLES / "numbers.toml"
    settings = check_experiment(read_toml(path), "numbers")
    run = create_run(tmp_path_factory.mktemp("numbers") / "run", settings, [EXAMPLES])
    return go_on(run)


def go_on(run, *, workers=1, backend="threads"):
    with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
        evolve(run, evaluator, lambda _: None)
    return open_run(run.path)


def program(game, text):
    functions = game.function_set(0)
    return compile_program(tree_codes(parse(text, functions), functions), functions)


def rightly_answered(game, tree):
    """Return how many of all questions a tree answers rightly, by walking its names."""
    found = 0
    for dimension, *bits in game.questions.tolist():
        true = {f"IF_dimension_is_{dimension}", *(f"IF_bit_{b}_is_one" for b, bit in enumerate(bits) if bit)}
        node = 0
        while tree.second[node]:
            node = node + 1 if tree.names[node] in true else tree.second[node]
        found += tree.names[node] == ("say_one" if bits[dimension] else "say_zero")
    return found


def winner_of(game, one, two):
    played = game.play([program(game, one), program(game, two)], np.arange(5, dtype=np.uint64))
    check_played(game, played, [program(game, one), program(game, two)], 5)
    (winner,) = set(played.winner.tolist())  # everything is asked: all games are the same
    return winner


def test_the_rules_by_hand(numbers):
    """Of 8 questions in each of 3 dimensions; who answers "one" throughout has the numbers 4, 4, 4."""
    most = numbers.make({"dimensions": 3, "asked": 1.0})
    least = numbers.make({"rule": "intransitive", "dimensions": 3, "asked": 1.0})
    check_game(most, "numbers")
    constant = "say_one"  # 4, 4, 4
    first = "IF_dimension_is_1(say_one, IF_dimension_is_2(say_one, IF_bit_0_is_one(say_one, say_zero)))"  # 8, 4, 4
    # 8 in dimension 0; in dimension 1 wrong wherever bit 1 is clear and bit 0 is set: 6; always wrong in dimension 2.
    mixed = (
        "IF_dimension_is_2(IF_bit_2_is_one(say_zero, say_one), IF_dimension_is_1("
        "IF_bit_1_is_one(say_one, IF_bit_0_is_one(say_one, say_zero)), IF_bit_0_is_one(say_one, say_zero)))"
    )  # 8, 6, 0
    assert winner_of(most, first, constant) == winner_of(least, first, constant) == 0
    assert winner_of(most, constant, first) == 1
    assert winner_of(most, mixed, first) == 1  # differs by 2 in dimension 1 and by -4 in dimension 2
    assert winner_of(least, mixed, first) == 0
    assert winner_of(most, constant, constant) == winner_of(least, constant, constant) == -1


def test_what_is_counted_is_what_was_asked(numbers):
    game = numbers.make({"asked": 0.5})
    solution, constant = program(game, SOLUTION), program(game, "say_one")
    played = game.play([solution, constant], np.arange(200, dtype=np.uint64))
    asked = played.leaf_steps[0].sum()
    assert played.counts["right"][:, 0].sum() == asked == played.leaf_steps[1].sum()
    assert asked / (200 * 8) == pytest.approx(0.5, abs=0.05)
    assert played.counts["lost"][:, 0].sum() == 0  # nobody beats the solution
    assert played.counts["won"][:, 0].sum() == played.counts["lost"][:, 1].sum() > 150


def test_it_evolves_to_its_known_solution(finished):
    game = make_game(finished.config, finished.folders)
    for robot in ("red", "blue"):
        first, last = finished.tree(robot, 0), finished.tree(robot, finished.finished - 1)
        assert rightly_answered(game, last) == len(game.questions) == 8
        assert rightly_answered(game, first) < 8
        smaller = simplify(last, game.function_set(0))
        assert rightly_answered(game, smaller) == 8


def test_a_group_plays_again_what_was_recorded(finished):
    table = finished.individuals
    for generation, group in ((0, 0), (1, 3), (2, 17)):
        programs = programs_of(finished.game, group_trees(finished, generation, group))
        played = finished.game.play(programs, seeds_of_group(finished, generation, group))
        rows = table[(table["generation"] == generation) & (table["group"] == group)].set_index("robot")
        for name, counts in played.counts.items():
            assert rows[name].loc[["red", "blue"]].tolist() == counts.sum(axis=0).tolist()


def test_the_run_folder_has_the_games_own_columns(finished):
    counts = ["won", "lost", "right"]
    assert [name for name in finished.individuals.columns if name in counts] == counts
    assert [name for name in finished.generations.columns if name in counts] == counts
    assert set(finished.generations["robot"]) == {"red", "blue"}


@pytest.mark.parametrize("backend", ["threads", "processes"])
def test_workers_and_resuming_change_no_byte(backend, finished, results_of, tmp_path, monkeypatch):
    run = create_run(tmp_path / "run", finished.config, finished.folders)
    saved = []

    def stop(of):
        saved.append(of.generation)
        if len(saved) == 3:
            raise KeyboardInterrupt

    with (
        pytest.raises(KeyboardInterrupt),
        Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as e,
    ):
        evolve(run, e, stop)
    monkeypatch.chdir(tmp_path)  # no game here but the copy in the run folder
    again = go_on(open_run(tmp_path / "run"), workers=2, backend=backend)
    assert results_of(again.path) == results_of(finished.path)


def test_reading_a_run_runs_none_of_its_code(finished, tmp_path, monkeypatch):
    copy = Path(shutil.copytree(finished.path, tmp_path / "copy"))
    (copy / "numbers_game.py").write_text("raise RuntimeError('it ran')", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    run = open_run(copy)
    assert len(run.generations) == 40
    assert len(run.individuals) == 4000
    assert len(run.record(3, "red")) == 100
    with pytest.raises(InputError, match=r"numbers_game.py is damaged or was changed: it does not match its digest"):
        run.tree("red", 0)
    (copy / "digests.txt").unlink()  # as in a run of an older version
    with pytest.raises(InputError, match=r"importing 'numbers_game' failed: RuntimeError: it ran \(numbers_game.py"):
        open_run(copy).tree("red", 0)


@pytest.mark.parametrize("table", [{"rule": "best"}, {"dimensions": 0}, {"dimension": 2}])
def test_a_wrong_table_is_refused(numbers, table):
    with pytest.raises(InputError, match="expected rule, dimensions"):
        numbers.make(table)
