"""New trees that are decision tables: what they ask, what their leaves are, and what cannot be a table."""

from __future__ import annotations

import itertools
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from analysis.ancestry.breeding import breed_again
from coevo.config import GPSettings
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.evolution.population import codes_of, first_population, random_teams
from coevo.evolution.variation import breed
from coevo.game import Creation, function_set
from coevo.run import create_run, open_run
from coevo.tree import from_codes
from coevo.vocabulary import SKILLS

functions = function_set(0, 3)
UNLIKELY = 1e-4
TABLE = (("IF_ball_is_lost", "IF_ball_is_small"), ("IF_own_goal_is_lost",))
IN_TOML = "[['IF_ball_is_lost', 'IF_ball_is_small'], ['IF_own_goal_is_lost']]"
tables = st.lists(
    st.lists(st.sampled_from(functions.functions), min_size=1, max_size=3, unique=True).map(tuple),
    min_size=1,
    max_size=3,
).map(tuple)


def first(table, population=6, seed=1):
    """Return the first population of r0 as trees."""
    made = first_population(
        GPSettings(population=population), functions, seed=seed, robot=0, creation=Creation(table=table)
    )
    return [from_codes(codes_of(one, functions), functions) for one in made]


def reached(tree, holds):
    """Return the number of the leaf that a tree comes to where the questions in ``holds`` hold, and its path."""

    def after(k):  # where the branch that begins at k ends
        return k + 1 if tree.names[k] not in functions.functions else after(after(k + 1))

    k, path = 0, []
    while tree.names[k] in functions.functions:
        path.append(tree.names[k])
        k = k + 1 if tree.names[k] in holds else after(k + 1)
    return k, tuple(path)


@given(table=tables, seed=st.integers(0, 2**63 - 1), data=st.data())
def test_the_first_question_of_each_list_that_holds_decides(table, seed, data):
    tree = first(table, 2, seed)[0]
    leaves = sum(name in SKILLS for name in tree.names)
    keys = {}
    for row in itertools.product(*(range(len(questions) + 1) for questions in table)):
        # A way to answer: of each list the question at this place holds and none before it, or none at all.
        asked = [questions[: place + 1] for questions, place in zip(table, row, strict=True)]
        holds = {questions[place] for questions, place in zip(table, row, strict=True) if place < len(questions)}
        denied = {name for questions, place in zip(table, row, strict=True) for name in questions[:place]}
        if holds & denied:  # a question of two lists cannot both hold and not
            continue
        leaf, path = reached(tree, holds)
        assert path == tuple(itertools.chain(*asked))
        keys[row] = leaf
        others = set(functions.functions) - set(itertools.chain(*table))
        more = data.draw(st.sets(st.sampled_from(sorted(others)))) if others else set()
        assert reached(tree, holds | more)[0] == leaf  # nothing else is asked
    assert len(set(keys.values())) == len(keys)  # each way to answer has a leaf of its own
    total = 1
    for questions in table:
        total *= len(questions) + 1
    assert leaves == total


def test_leaves_are_each_skill_as_often():
    seen = Counter(name for tree in first(TABLE, 500) for name in tree.names if name in SKILLS)
    assert set(seen) == set(SKILLS)
    assert stats.chisquare([seen[name] for name in SKILLS]).pvalue > UNLIKELY
    by_place = list(zip(*([n for n in tree.names if n in SKILLS] for tree in first(TABLE, 500)), strict=True))
    assert len(by_place) == 6
    pairs = Counter(zip(by_place[0], by_place[5], strict=True))  # of one tree they are drawn apart
    assert stats.chi2_contingency([[pairs[a, b] for b in SKILLS] for a in SKILLS]).pvalue > UNLIKELY


def test_random_search_draws_tables_anew():
    settings = GPSettings(population=30, variation="random", elite=2)
    parents = first_population(settings, functions, seed=1, robot=0, creation=Creation(table=TABLE))
    for fitness, parent in enumerate(parents):
        parent.fitness.values = (float(fitness), 3.0)
    children = breed(parents, settings, functions, seed=1, generation=0, robot=0, table=TABLE)
    trees = [from_codes(codes_of(one, functions), functions) for one in children]
    shape = [name if name in functions.functions else "" for name in first(TABLE)[0].names]
    assert all([name if name in functions.functions else "" for name in tree.names] == shape for tree in trees)
    assert [child.origin.operator for child in children] == ["elite"] * 2 + ["creation"] * 28
    assert len({tree.names for tree in trees[2:]}) > 25  # of 4^6


@pytest.mark.parametrize("more", [(), ("gp.variation=random",)], ids=["genetic", "random"])
def test_runs_begin_with_tables_go_on_without_a_checkpoint_and_are_bred_again(more, small_settings, go_on, tmp_path):
    settings = small_settings(f"gp.decision_tables={{ r0 = {IN_TOML} }}", "gp.start={ r0 = ['shoot'] }", *more)
    run = go_on(create_run(tmp_path / "run", settings))
    assert open_run(run.path).config == settings
    begun = run.record(0, "r0").sort_values("index")["tree"]
    names = run.game.function_set(0).names
    asked = [tuple(names[code] for code in tree if names[code] not in SKILLS) for tree in begun]
    assert asked[0] == ()  # the given tree
    assert asked[1:] == [
        ("IF_ball_is_lost", "IF_own_goal_is_lost", "IF_ball_is_small", "IF_own_goal_is_lost", "IF_own_goal_is_lost")
    ] * (len(begun) - 1)
    assert len(set(run.record(0, "r1")["nodes"])) > 1  # those without a table are drawn as before

    teams = random_teams(run.game, settings.gp, seed=settings.seed, teams=3)
    of_r0, of_r1 = ([str(tree) for tree in in_order(run, robot)[:3]] for robot in ("r0", "r1"))
    assert [(str(team[0]), str(team[1])) for team in teams] == list(zip(of_r0, of_r1, strict=True))
    assert of_r0[0] == "shoot"

    stopped = create_run(tmp_path / "stopped", settings)
    with pytest.raises(Killed), Evaluator(settings, workers=1, backend="threads") as evaluator:
        evolve(stopped, evaluator, kill)
    (stopped.path / "checkpoint.npz").unlink()
    go_on(open_run(stopped.path))
    for name in ("generations.csv", "digests.txt"):
        assert (stopped.path / name).read_bytes() == (run.path / name).read_bytes()
    assert len(breed_again(run, "r0", run.finished - 1)) == run.finished  # which compares them with the folder


class Killed(BaseException):
    """Stands for a kill: nothing of the program catches it."""


def kill(_report):
    raise Killed


def in_order(run, robot):
    """Return the first generation's trees by their index."""
    rows = run.record(0, robot).reset_index()
    return [run.tree(robot, 0, rank) for rank in rows["index"].argsort()]


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ("{ r9 = [] }", "gp.decision_tables: 'r9' is no role that evolves. Did you mean 'r1'? Known: r0, r1"),
        ("{ r2 = [] }", "gp.decision_tables: 'r2' is no role that evolves."),
        (
            "{ r0 = [['IF_ball_is_lost'], ['IF_ball_is_smal']] }",
            "gp.decision_tables.r0.1: 'IF_ball_is_smal' is no question of r0. Did you mean 'IF_ball_is_small'?",
        ),
        ("{ r0 = [['shoot']] }", "gp.decision_tables.r0.0: 'shoot' is no question of r0."),
        (
            f"{{ r0 = {[['IF_ball_is_lost']] * 11} }}",
            "gp.decision_tables.r0: expected a table of at most 1,024 leaves, got 2,048",
        ),
        ("{ r0 = ['IF_ball_is_lost'] }", "gp.decision_tables.r0.0: expected array, got str"),
        ("{ r0 = [[]] }", "gp.decision_tables.r0.0"),
        (
            f"{{ r0 = [{list(functions.functions[:26])}] }}",
            "gp.decision_tables.r0: expected at most gp.crossover_depth_max = 25 questions one after the other",
        ),
        (
            "{ r0 = [['IF_ball_is_lost', 'IF_ball_is_small', 'IF_ball_is_lost']] }",
            "gp.decision_tables.r0.0: asks 'IF_ball_is_lost' twice, which never holds the second time",
        ),
    ],
)
def test_what_is_no_table_is_refused_before_there_is_a_folder(tables, said, coevo, tmp_path):
    small = ["--set", "gp.population=6", "--set", "gp.tournament=2"]
    told = coevo(
        "evolve",
        "stationary-opponent",
        "--out",
        tmp_path / "run",
        *small,
        "--set",
        f"gp.decision_tables={tables}",
        "--quiet",
    )
    assert told.code == 2
    assert said in told.err
    assert not (tmp_path / "run").exists()
