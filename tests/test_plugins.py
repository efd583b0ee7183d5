"""Fitness and games of one's own: what is wrong with them is told before anything is played, in words."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from coevo.config import EvaluationSettings, EvolutionSettings, FitnessSettings, ForeignSettings, GPSettings
from coevo.errors import InputError
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator, Match
from coevo.fitness import Scorer
from coevo.game import check_game, make_game
from coevo.plugins import load_callable, own_file, search_folders
from coevo.run import create_run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import compile_program, from_codes, parse, tree_codes

GAME = """
import numpy as np
from coevo.game import Played, Role
from coevo.tree import FunctionSet

class Game:
    roles = (Role("one", 0), Role("two", 1), Role("three", 2, evolves=False))
    counts = ("points",)
    def function_set(self, role):
        return FunctionSet(("IF_dark",), ("go", "stay"))
    def play(self, programs, seeds):
        counts = {"points": np.ones((len(seeds), 3), np.int64)}
        leaf_steps = [np.zeros(0 if p is None else len(p.codes), np.int64) for p in programs]
        return Played(counts, np.full(len(seeds), -1), leaf_steps)
def make(table):
    return Game()
"""


@pytest.fixture
def own(tmp_path):
    """Return a function that writes a module of one's own and returns where it is looked for."""

    def write(text, name="mine.py"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return (tmp_path,)

    return write


def settings(kind):
    return EvolutionSettings(
        fitness=FitnessSettings(kind=kind), evaluation=EvaluationSettings(games=5), gp=GPSettings(generations=9)
    )


# -------------------------------------------------------------------------------------------------------- fitness


def test_a_fitness_gets_what_was_counted_and_when(own):
    folders = own(
        "def f(measures, *, games, generation, generations):\n"
        "    assert set(measures) == {'a', 'b'}\n"
        "    return measures['a'] * 1000 + games * 100 + generation * 10 + generations\n"
    )
    scorer = Scorer(settings("mine:f"), ("a", "b"), folders)
    measures = {"a": np.array([1, 2, 3]), "b": np.array([0, 0, 0])}
    fitness = scorer(measures, 7)
    assert fitness.tolist() == [1579.0, 2579.0, 3579.0]
    assert fitness.dtype == np.float64


def test_a_fitness_cannot_change_what_is_recorded(own):
    folders = own("def f(measures, **now):\n    measures['a'] += 7\n    return measures['a']\n")
    measures = {"a": np.array([1, 2, 3])}
    assert Scorer(settings("mine:f"), ("a",), folders)(measures, 0).tolist() == [8.0, 9.0, 10.0]
    assert measures["a"].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        pytest.param("", "mine", "must be 'fixed', 'varying' or module:function of your own", id="no function"),
        pytest.param("", "mine:", "expected module:name", id="no name"),
        pytest.param("", "a b:f", "expected module:name", id="a space"),
        pytest.param("", "absent:f", r"there is no module 'absent' in .*; put absent.py there", id="no module"),
        pytest.param("def near(): pass", "mine:neer", "has no 'neer'. Did you mean 'near'?", id="misspelt"),
        pytest.param("f = 3", "mine:f", "mine:f is no function, but 3", id="a number"),
        pytest.param("import absent_too", "mine:f", "importing 'mine' failed: ModuleNotFoundError", id="its import"),
        pytest.param("def f(:", "mine:f", r"importing 'mine' failed: SyntaxError: .*\(mine.py, line 1\)", id="syntax"),
        pytest.param("x = 1\n1 / 0", "mine:f", r"ZeroDivisionError: division by zero \(mine.py, line 2\)", id="broken"),
        pytest.param("raise SystemExit(3)", "mine:f", "importing 'mine' failed: SystemExit: 3", id="it ends Python"),
        pytest.param("def f(m): return 0", "mine:f", "failed: TypeError: .*unexpected keyword", id="other arguments"),
        pytest.param(
            "def f(m, **now):\n    return m['gaols']", "mine:f", r"KeyError: 'gaols' \(mine.py, line 2\)", id="key"
        ),
        pytest.param("def f(m, **now): return 0.0", "mine:f", r"one number for each of 2 .*got shape \(\)", id="one"),
        pytest.param("def f(m, **now): return [[1, 2]]", "mine:f", r"got shape \(1, 2\)", id="two dimensions"),
        pytest.param("def f(m, **now): return 'ab'", "mine:f", "mine:f failed: ValueError", id="words"),
        pytest.param("def f(m, **now): return [1, float('nan')]", "mine:f", "must return finite numbers", id="nan"),
    ],
)
def test_a_fitness_that_cannot_be_used_is_told(text, kind, message, own):
    folders = own(text)
    with pytest.raises((InputError, ValueError), match=message) as caught:
        Scorer(settings(kind), ("goals", "kicks"), folders)
    assert "\n" not in str(caught.value)


def test_the_fitness_of_table_6_2_needs_what_it_weighs():
    with pytest.raises(
        InputError, match="'fixed' needs goals, lost, kicks, collisions, steps, but this game counts won"
    ):
        Scorer(settings("fixed"), ("won",))


def test_a_file_that_changed_is_read_again_and_two_folders_are_two_files(tmp_path):
    for folder, number in (("one", 1), ("two", 2)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text(f"def f(): return {number}", encoding="utf-8")
    one, two = ((tmp_path / folder,) for folder in ("one", "two"))
    assert [load_callable("mine:f", "x", folders)() for folders in (one, two, one)] == [1, 2, 1]
    (tmp_path / "one" / "mine.py").write_text("def f(): return 3", encoding="utf-8")
    assert load_callable("mine:f", "x", one)() == 3


def test_the_recipes_folder_comes_before_the_current_one_and_that_before_what_is_installed(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    folders = search_folders(tmp_path)
    assert own_file("json:dumps", folders) is None
    assert load_callable("json:dumps", "x", folders)([1]) == "[1]"
    for place, number in ((tmp_path / "here", 2), (tmp_path, 1)):
        (place / "json.py").write_text(f"def dumps(_): return {number}", encoding="utf-8")
        assert load_callable("json:dumps", "x", search_folders(tmp_path))([1]) == number
    assert json.dumps([1]) == "[1]"  # everyone else's is what it was


# ---------------------------------------------------------------------------------------------------------- games


def game_settings(table=None):
    return ForeignSettings(
        game={"kind": "mine:make", **(table or {})},
        gp=GPSettings(population=4, generations=2, tournament=2, creation_depth_max=2),
        fitness=FitnessSettings(kind="mine:f"),
        evaluation=EvaluationSettings(games=3),
    )


def test_a_factory_gets_its_table(own):
    folders = own(GAME.replace("def make(table):", "def make(table):\n    assert table == {'size': 3, 'names': ['a']}"))
    game = make_game(game_settings({"size": 3, "names": ["a"]}), folders)
    assert [role.name for role in game.roles] == ["one", "two", "three"]


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        pytest.param("return Game()", "return 3", "this one has no roles", id="a number"),
        pytest.param("return Game()", "1 / 0", r"making the game mine:make failed: ZeroDiv.*mine.py", id="it fails"),
        pytest.param('Role("two", 1)', 'Role("one", 1)', "each once; got the role 'one'", id="two of one name"),
        pytest.param('Role("two", 1)', 'Role("t,w", 1)', "got the role 't,w'", id="a comma"),
        pytest.param('Role("two", 1)', 'Role("two", -1)', "team of two to be 0 or more, got -1", id="no team"),
        pytest.param('("points",)', '("fitness",)', "has a column 'fitness' of its own", id="a column's name"),
        pytest.param('("points",)', '("chose_dark",)', "a column 'chose_dark' of its own", id="a terminal's column"),
        pytest.param('("points",)', '("parent_1",)', "has a column 'parent_1' of its own", id="a parent's column"),
        pytest.param('("points",)', '("a b",)', "got the count 'a b'", id="a space"),
        pytest.param('return FunctionSet(("IF_dark",), ("go", "stay"))', "return 3", "must return a .*Func", id="set"),
        pytest.param('("go", "stay")', '("IF_go",)', "making the game mine:make failed: ValueError", id="terminals"),
    ],
)
def test_a_game_that_breaks_the_contract_is_told(wrong, right, message, own):
    assert wrong in GAME
    with pytest.raises(InputError, match=message):
        make_game(game_settings(), own(GAME.replace(wrong, right)))


def test_what_is_chosen_has_a_column_for_each_terminal_of_any_role(own, tmp_path):
    """Roles may differ in their terminals; who lacks one has chosen it 0 times."""
    text = GAME.replace('("go", "stay"))', '(("wait", "stay"), ("stay", "go"), ())[role])').replace(
        "np.zeros(0 if p is None else len(p.codes), np.int64)",
        "np.zeros(0, np.int64) if p is None else np.where(p.codes == -1, 3, 10) * (p.codes < 0)",
    )
    folders = own(text + "def f(measures, **now): return measures['points'] * 1.0\n")
    run = create_run(tmp_path / "run", game_settings(), folders)
    with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
        evolve(run, evaluator, lambda _: None)
    table = run.individuals
    assert [name for name in table if name.startswith("chose_")] == ["chose_wait", "chose_stay", "chose_go"]
    terminals = {"one": ("wait", "stay"), "two": ("stay", "go")}
    for row in table.itertuples():
        names = from_codes(row.tree, run.game.function_set(run.number_of(row.robot))).names
        steps = dict(zip(terminals[row.robot], (3, 10), strict=True))
        expected = [names.count(name) * steps.get(name, 0) for name in ("wait", "stay", "go")]
        assert [row.chose_wait, row.chose_stay, row.chose_go] == expected
    assert {record.robot: tuple(record.chosen) for record in run.records(1)} == terminals


def test_somebody_has_to_evolve(own):
    game = make_game(game_settings(), own(GAME))
    game.roles = tuple(role._replace(evolves=False) for role in game.roles)
    with pytest.raises(InputError, match="at least one role must evolve"):
        check_game(game, "the game")


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        pytest.param("(len(seeds), 3)", "(len(seeds), 2)", r"'points' as integers of shape \(3, 3\)", id="roles"),
        pytest.param("np.int64)}", "float)}", r"'points' as integers", id="floats"),
        pytest.param(
            'counts = {"points"', 'counts = {"more"', "promises to count points; it counted more", id="others"
        ),
        pytest.param("np.full(len(seeds), -1)", "-1", "the winner of each of 3 games", id="one winner"),
        pytest.param("else len(p.codes)", "else 7", "leaf_steps for trees of", id="leaves"),
        pytest.param("leaf_steps = [", "1 / 0\n        x = [", r"the game mine:make failed: Zero.*mine.py", id="fails"),
    ],
)
def test_what_a_game_plays_is_checked(wrong, right, message, own):
    assert wrong in GAME
    play_two_groups(own(GAME.replace(wrong, right)), message, "threads")


def test_what_a_game_plays_in_another_process_is_checked(own):
    play_two_groups(own(GAME.replace("(len(seeds), 3)", "(len(seeds), 2)")), "'points' as integers", "processes")


def play_two_groups(folders, message, backend):
    game = make_game(game_settings(), folders)
    functions = game.function_set(0)
    tree = compile_program(tree_codes(parse("IF_dark(go, stay)", functions), functions), functions)
    with (
        pytest.raises(InputError, match=message),
        Evaluator(game_settings(), workers=2, backend=backend, folders=folders) as evaluator,
    ):
        list(evaluator.play([Match([tree, tree, None], game_seeds(1, RunStream.GAMES, count=3))] * 2))


def test_a_run_keeps_its_own_modules(own, tmp_path):
    folders = own(GAME + "def f(measures, **now): return measures['points']\n")
    run = create_run(tmp_path / "run", game_settings(), folders)
    assert (run.path / "mine.py").read_bytes() == (tmp_path / "mine.py").read_bytes()
    assert run.folders[0] == run.path.resolve()
    assert list(run.evolving.items()) == [(0, "one"), (1, "two")]


def test_settings_of_another_game_need_no_world(own):
    own(GAME)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"game": {"kind": "mine:make"}, "players": []}, ForeignSettings)
    with pytest.raises(ValueError, match="expected 'soccer' or module:factory of your own, got 'football'"):
        ForeignSettings(game={"kind": "football"})
