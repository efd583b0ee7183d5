"""Runs of every grouping: what is recorded is what single games give, and the same bytes after a kill."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
import pytest
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm

from coevo.config import check_experiment, override, read_toml
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.evolution.grouping import groups_of
from coevo.fitness import fixed
from coevo.game import Arena, programs_of
from coevo.measures import repeatability
from coevo.run import create_run, open_run
from coevo.usage import group_trees, seeds_of_group, tree_usage
from coevo.vocabulary import SKILLS

FITNESS_OF = ["goals", "lost", "kicks", "collisions", "steps"]
COUNTS = [*FITNESS_OF, "passes", "own_goals"]
# Close to the goal and to the ball, so that a few games have everything.
EVENTFUL = (
    "game.time_limit_steps=120",
    "game.ball_start={ x_m = [7.0, 7.4], y_m = [2.0, 2.5] }",
    "players.0.start={ x_m = [6.3, 6.6], y_m = [2.1, 2.4] }",
    "players.1.start={ x_m = [5.6, 5.9], y_m = [2.0, 2.6] }",
    "players.2.start={ x_m = [7.6, 7.9], y_m = [2.0, 2.6] }",
)
GROUPINGS = {
    "partners": ("evaluation.grouping=partners", "evaluation.partners=2", "evaluation.starts=common"),
    "best": ("evaluation.grouping=best",),
    "hall": ("evaluation.grouping=hall-of-fame", "evaluation.partners=2", "evaluation.games=4"),
}


class Killed(BaseException):
    """Stands for a kill: nothing of the program catches it."""


@pytest.fixture(scope="module")
def settings_for(small_settings):
    return lambda name: small_settings(*EVENTFUL, "gp.population=5", "seed=3", *GROUPINGS[name])


@pytest.fixture(scope="module")
def runs(settings_for, go_on, tmp_path_factory):
    folder = tmp_path_factory.mktemp("grouped")
    return {name: go_on(create_run(folder / name, settings_for(name))) for name in GROUPINGS}


@pytest.fixture(params=list(GROUPINGS))
def run(request, runs):
    return runs[request.param]


def each_group(run):
    for generation in range(run.config.gp.generations):
        for group in range(len(groups_of(run.config, run.game.roles, generation))):
            yield generation, group


def test_counts_are_the_sums_of_single_games_played_again_alone(run):
    """Every group of every generation, game by game, the last first, on a fresh arena."""
    arena, total = Arena(run.config), {}
    for generation, group in each_group(run):
        groups = groups_of(run.config, run.game.roles, generation)
        programs = programs_of(run.game, group_trees(run, generation, group))
        seeds = seeds_of_group(run, generation, group)
        assert len(seeds) == run.config.evaluation.games // run.config.evaluation.partners
        for seed in reversed(seeds):
            counts = run.game.played(arena.play(programs, np.array([seed]))).counts
            for role in np.flatnonzero(groups.counts[group]):
                key = generation, f"r{role}", int(groups.members[group, role])
                one = total.setdefault(key, dict.fromkeys(COUNTS, 0))
                for name in COUNTS:
                    one[name] += int(counts[name][0, role])
    table = run.individuals.set_index(["generation", "robot", "index"])
    assert {key: table.loc[key, COUNTS].to_dict() for key in table.index} == total
    assert table["kicks"].max() > 0


def test_fitness_is_that_of_the_sums_and_the_mean_of_the_rounds(run):
    table, games = run.individuals, run.config.evaluation.games
    expected = fixed(*(table[name].to_numpy() for name in FITNESS_OF), t_max=games)
    assert table["fitness"].to_numpy() == pytest.approx(expected, rel=1e-13)
    if run.config.evaluation.partners == 1:
        assert "rounds" not in table
        return
    rounds = np.array(table["rounds"].tolist())
    assert rounds.shape == (len(table), 2)
    # Nobody touches the ball often enough that more would not count: then the fitness is a sum over games.
    assert rounds.mean(axis=1) == pytest.approx(expected, rel=1e-12)
    assert (rounds[:, 0] != rounds[:, 1]).any()


def test_guests_are_the_best_of_their_generation(runs):
    for name in ("best", "hall"):
        run, seen = runs[name], 0
        groups = groups_of(run.config, run.game.roles, 2)
        best = {(role, earlier): run.tree(f"r{role}", earlier) for role in range(3) for earlier in range(2)}
        for group in range(0, len(groups), 3):
            trees = group_trees(run, 2, group)
            for role, guest in enumerate(groups.guests[group]):
                if guest >= 0:
                    assert trees[role] == best[role, int(guest)]
                    seen += 1
        assert seen > 3


def test_the_use_of_a_tree_is_summed_over_all_its_groups(run):
    for row in run.individuals.query("generation == 2 and index < 2").to_dict("records"):
        usage = tree_usage(run, 2, row["robot"], row["index"])
        assert usage.steps == row["steps"]
        for skill in SKILLS:
            assert usage.skill_use[skill] * usage.steps == pytest.approx(row[f"chose_{skill}"])


def test_the_column_group_is_the_first_that_counts(run):
    for (generation, robot), rows in run.individuals.groupby(["generation", "robot"]):
        groups, role = groups_of(run.config, run.game.roles, generation), int(robot[1:])
        for row in rows.to_dict("records"):
            counted = groups.counts[:, role] & (groups.members[:, role] == row["index"])
            assert row["group"] == np.flatnonzero(counted)[0]


# --------------------------------------------------------------------------------------------------------- the same


@pytest.mark.parametrize("name", list(GROUPINGS))
def test_a_run_that_was_killed_goes_on_to_the_same_bytes(name, runs, settings_for, go_on, results_of, tmp_path):
    """Killed after a generation, without its checkpoint and its table of measures, and gone on with by processes."""
    run = create_run(tmp_path / "run", settings_for(name))

    def report(of):
        if of.generation == 1:
            raise Killed

    with pytest.raises(Killed):
        go_on(run, report=report)
    (run.path / "checkpoint.npz").unlink()
    (run.path / "measures.csv").unlink()
    go_on(open_run(run.path), workers=2, backend="processes")
    assert results_of(run.path) == results_of(runs[name].path)


# ----------------------------------------------------------------------------------------------------------- measures


def test_measures_are_those_of_the_individuals(run):
    table = pd.read_csv(run.path / "measures.csv").set_index(["generation", "robot"])
    individuals = run.individuals
    assert len(table) == run.config.gp.generations * 3
    for (generation, robot), rows in individuals.groupby(["generation", "robot"]):
        measured = table.loc[(generation, robot)]
        assert measured["passes"] == pytest.approx(rows["passes"].mean() / run.config.evaluation.games)
        assert measured["diversity_trees"] == len({tuple(tree) for tree in rows["tree"]}) / len(rows)
        assert 0.0 <= measured["diversity_tops"] <= 1.0
        if "rounds" in rows:
            expected = repeatability(np.array(rows["rounds"].tolist()))
            assert measured["repeatability"] == pytest.approx(expected, nan_ok=True)
        else:
            assert np.isnan(measured["repeatability"])


def test_repeatability_is_that_of_an_analysis_of_variance():
    rng = np.random.default_rng(5)
    values = rng.normal(size=(9, 1)) + rng.normal(size=(1, 4)) + rng.normal(size=(9, 4))
    long = pd.DataFrame(
        [(i, r, values[i, r]) for i, r in itertools.product(range(9), range(4))], columns=["i", "r", "v"]
    )
    anova = anova_lm(ols("v ~ C(i) + C(r)", long).fit())
    expected = 1.0 - anova.loc["Residual", "mean_sq"] / anova.loc["C(i)", "mean_sq"]
    assert repeatability(values) == pytest.approx(expected)


def test_repeatability_is_the_correlation_of_two_evaluations_of_the_same_size():
    """By its meaning: individuals play twice, in other rounds, and the two figures are compared."""
    rng = np.random.default_rng(6)
    worth = rng.normal(size=(200, 1))
    one, two = (worth + rng.normal(0.0, 2.0, (200, 5)) + rng.normal(size=(1, 5)) for _ in range(2))
    found = np.corrcoef(one.mean(axis=1), two.mean(axis=1))[0, 1]
    assert repeatability(one) == pytest.approx(found, abs=0.12)
    assert found == pytest.approx(5 / 9, abs=0.12)


@pytest.mark.parametrize("rounds", [np.ones((3, 2)), np.ones((3, 1)), np.ones((1, 4))])
def test_where_nothing_can_be_compared_there_is_no_repeatability(rounds):
    assert np.isnan(repeatability(rounds))


# ------------------------------------------------------------------------------------------ three teams of one's own

PAIRS = """
import numpy as np
from coevo.game import Played, Role
from coevo.tree import FunctionSet

class Pairs:
    roles = tuple(Role(f"p{n}", n // 2) for n in range(6))
    counts = ("points",)

    def function_set(self, role):
        return FunctionSet(("IF_odd",), tuple(f"s{k}" for k in range(8)))

    def play(self, programs, seeds):
        strength = np.array([-1 - int(p.codes[p.codes < 0][0]) for p in programs])
        noise = np.array([np.random.default_rng(seed).random(6) for seed in seeds])
        points = np.round(1000 * (strength + noise + strength.sum())).astype(np.int64)
        leaves = [np.where(np.cumsum(p.codes < 0) * (p.codes < 0) == 1, len(seeds), 0) for p in programs]
        return Played({"points": points}, np.full(len(seeds), -1), leaves)

def make(table):
    return Pairs()

def points(measures, **now):
    return -measures["points"].astype(float)
"""


@pytest.mark.parametrize("grouping", ["random", "partners", "best", "hall-of-fame"])
def test_three_teams_of_two(grouping, tmp_path):
    (tmp_path / "pairs.py").write_text(PAIRS, encoding="utf-8")
    partners = 1 if grouping == "random" else 2
    data = {
        "game": {"kind": "pairs:make"},
        "fitness": {"kind": "pairs:points"},
        "gp": {"population": 4, "generations": 3, "tournament": 2},
        "evaluation": {"games": 2, "grouping": grouping, "partners": partners, "champion_games": 8},
    }
    run = create_run(tmp_path / "run", check_experiment(data, "pairs"), (tmp_path,))
    with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
        evolve(run, evaluator, lambda _: None)
    total, groups = np.zeros((6, 4), np.int64), groups_of(run.config, run.game.roles, 2)
    for group in range(len(groups)):
        programs = programs_of(run.game, group_trees(run, 2, group))
        played = run.game.play(programs, seeds_of_group(run, 2, group)).counts["points"].sum(axis=0)
        for role in np.flatnonzero(groups.counts[group]):
            total[role, groups.members[group, role]] += played[role]
    assert run.individuals.query("generation == 2")["points"].tolist() == total.ravel().tolist()
    assert run.champions()["team"].tolist() == [0, 0, 1, 1, 2, 2]


# ------------------------------------------------------------------------------------- random search, and given trees


@pytest.fixture(scope="module")
def searched(small_settings, go_on, tmp_path_factory):
    settings = small_settings("gp.variation=random", "gp.population=10", "gp.elite=2", "gp.generations=4")
    return go_on(create_run(tmp_path_factory.mktemp("searched") / "run", settings))


def test_random_search_makes_all_but_the_elite_anew(searched):
    table = searched.individuals
    assert set(table.query("generation == 0")["operator"]) == {"creation"}
    later = table.query("generation > 0")
    for (generation, robot), rows in later.groupby(["generation", "robot"]):
        assert rows["operator"].tolist() == ["elite"] * 2 + ["creation"] * 8
        assert rows["parent_1"].tolist()[2:] == [-1] * 8
        best = [searched.tree(robot, generation - 1, rank) for rank in range(2)]
        kept = rows["tree"].tolist()[:2]
        names = searched.game.function_set(int(robot[1:])).names
        assert [[names[code] for code in tree] for tree in kept] == [list(tree.names) for tree in best]
    big = [tuple(tree) for tree in later.query("operator == 'creation' and nodes > 7")["tree"]]
    assert len(set(big)) == len(big)  # never the same again
    sizes = table.query("operator == 'creation'").groupby("generation")["depth"].max()
    assert sizes.max() <= searched.config.gp.creation_depth_max


def test_given_trees_take_the_first_places_and_the_others_stay(small_settings, small_run, go_on, tmp_path):
    given = ("IF_ball_is_lost(search, shoot)", "pass")
    settings = small_settings("gp.generations=1", f"gp.start={{ r1 = {list(given)} }}")
    run = go_on(create_run(tmp_path / "run", settings))
    now, before = (one.individuals.query("generation == 0").reset_index() for one in (run, small_run))
    trees = {int(row["index"]): run.tree("r1", 0, k) for k, (_, row) in enumerate(run.record(0, "r1").iterrows())}
    assert (str(trees[0]), str(trees[1])) == given
    assert set(now["operator"]) == {"creation"}
    same = (now["robot"] != "r1") | (now["index"] >= 2)
    assert [list(tree) for tree in now["tree"][same]] == [list(tree) for tree in before["tree"][same]]
    assert open_run(run.path).config == settings  # it can be written and read


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ("{ r9 = ['shoot'] }", "gp.start: 'r9' is no role that evolves. Did you mean 'r1'? Known: r0, r1"),
        ("{ r2 = ['shoot'] }", "gp.start: 'r2' is no role that evolves."),
        ("{ r0 = ['shoot', 'IF_ball_is_lots(shoot, pass)'] }", "gp.start.r0.1: unknown name 'IF_ball_is_lots' at char"),
        ("{ r0 = ['IF_r0_is_lost(shoot, pass)'] }", "gp.start.r0.0: unknown name 'IF_r0_is_lost'"),
        ("{ r0 = ['shoot('] }", "gp.start.r0.0: expected the end after"),
        ("{ r0 = ['shoot', 'pass', 'avoid', 'search', 'pass', 'shoot', 'pass'] }", "at most population 6 trees, got 7"),
        ("{ r0 = 'shoot' }", "gp.start.r0: expected array, got str"),
    ],
)
def test_trees_that_cannot_start_a_population_are_refused_before_there_is_a_folder(start, said, coevo, tmp_path):
    small = ["--set", "gp.population=6", "--set", "gp.tournament=2"]
    told = coevo(
        "evolve", "stationary-opponent", "--out", tmp_path / "run", *small, "--set", f"gp.start={start}", "--quiet"
    )
    assert told.code == 2
    assert said in told.err
    assert not (tmp_path / "run").exists()


def test_a_repeated_run_of_given_trees_is_read_from_its_own_configuration(small_settings, tmp_path):
    settings = small_settings("gp.start={ r0 = ['shoot'], r2 = [] }", *GROUPINGS["hall"])
    run = create_run(tmp_path / "run", settings)
    assert check_experiment(override(read_toml(run.path / "config.toml"), []), "config.toml") == settings
