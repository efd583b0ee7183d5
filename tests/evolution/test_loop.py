"""The generation loop: what is recorded is what single games, the fitness functions and breeding give."""

from __future__ import annotations

import itertools
import random
import signal
import threading
from collections import Counter

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator, Match, check_backend, group_seeds
from coevo.evolution.population import codes_of, first_population, individual_of
from coevo.evolution.variation import breed
from coevo.fitness import fixed, varying
from coevo.game import Arena, SoccerGame, function_set
from coevo.run import create_run
from coevo.seeds import RunStream, generator
from coevo.tree import compile_program, from_codes
from coevo.vocabulary import SKILLS

FITNESS_OF = ["goals", "lost", "kicks", "collisions", "steps"]
COUNTS = [*FITNESS_OF, "passes", "own_goals"]
INDIVIDUAL_COLUMNS = [
    *("generation", "robot", "index", "group", "fitness", *COUNTS, "depth", "nodes", "tree"),
    *("operator", "parent_1", "parent_2", *(f"chose_{skill}" for skill in SKILLS)),
]
GENERATION_COLUMNS = [
    *("generation", "robot", "fitness_best", "fitness_mean", "fitness_worst", *COUNTS),
    *("depth_best", "depth_mean", "depth_worst", "nodes_best", "nodes_mean", "nodes_worst"),
]
# Close to the goal and to the ball, so that a few games have everything: goals for and against, kicks, collisions.
EVENTFUL = (
    "game.time_limit_steps=240",
    "game.ball_start={ x_m = [7.0, 7.4], y_m = [2.0, 2.5] }",
    "players.0.start={ x_m = [6.3, 6.6], y_m = [2.1, 2.4] }",
    "players.1.start={ x_m = [5.6, 5.9], y_m = [2.0, 2.6] }",
    "players.2.start={ x_m = [7.6, 7.9], y_m = [2.0, 2.6] }",
)


@pytest.fixture(scope="module")
def eventful_run(small_settings, go_on, tmp_path_factory):
    settings = small_settings(*EVENTFUL, "gp.population=8", "fitness.kind=varying", "gp.generations=4", "seed=3")
    return go_on(create_run(tmp_path_factory.mktemp("eventful") / "run", settings))


@pytest.fixture(scope="module")
def stationary_run(small_settings, go_on, tmp_path_factory):
    settings = small_settings(preset="chapter6/dissertation-stationary-opponent")
    return go_on(create_run(tmp_path_factory.mktemp("stationary") / "run", settings))


@pytest.fixture(scope="module")
def mutating_run(small_settings, go_on, tmp_path_factory):
    """Return a run in which many are mutated, by a function and its two leaves at most."""
    shares = ("gp.crossover=0.5", "gp.mutation=0.45", "gp.mutation_depth_max=1", "gp.population=10", "gp.generations=5")
    settings = small_settings(*shares, "evaluation.games=1", "game.time_limit_steps=20")
    return go_on(create_run(tmp_path_factory.mktemp("mutating") / "run", settings))


@pytest.fixture(params=["small_run", "eventful_run", "stationary_run"])
def run(request):
    return request.getfixturevalue(request.param)


def read(run):
    """Return all individuals, read without this package."""
    return pd.read_parquet(run.path / "individuals.parquet")


def random_groups(population, robots, *, seed, generation):
    """Return (groups, robots) who is in which group, as the dissertation has it: every robot's individuals shuffled."""
    random = generator(seed, RunStream.GROUPING, generation)
    return np.stack([random.permutation(population) for _ in range(robots)], axis=1)


def evolving(run):
    return [i for i, player in enumerate(run.config.players) if player.control == "evolve"]


# -------------------------------------------------------------------------------------------------------- tables


def test_individuals_have_the_columns_and_types_of_the_contract(run):
    schema = pq.read_schema(run.path / "individuals.parquet" / "part-00000.parquet")
    assert schema.names == INDIVIDUAL_COLUMNS
    types = {name: str(schema.field(name).type) for name in schema.names}
    assert types.pop("robot") == "string"
    assert types.pop("fitness") == "double"
    assert types.pop("tree") == "list<element: uint8>"
    assert types.pop("operator") == "dictionary<values=string, indices=int32, ordered=0>"
    assert types["parent_1"] == types["parent_2"] == types["chose_shoot"] == "int32"
    assert set(types.values()) <= {"int16", "int32", "int64"}


def test_there_is_a_row_for_every_individual_of_every_generation(run):
    table, gp = read(run), run.config.gp
    assert len(table) == gp.generations * len(evolving(run)) * gp.population
    assert pd.testing.assert_frame_equal(table, run.individuals) is None
    for (generation, robot), rows in table.groupby(["generation", "robot"]):
        assert rows["index"].tolist() == list(range(gp.population))
        column = [f"r{i}" for i in evolving(run)].index(robot)
        groups = random_groups(gp.population, len(evolving(run)), seed=run.config.seed, generation=generation)
        assert groups[rows["group"], column].tolist() == rows["index"].tolist()


def test_depth_and_nodes_are_those_of_the_trees(run):
    for row in read(run).itertuples():
        tree = from_codes(row.tree, function_set(int(row.robot[1:]), len(run.config.players)))
        assert (row.depth, row.nodes) == (tree.depth, tree.nodes)


def test_the_table_of_generations_can_be_computed_from_the_individuals(run):
    table = pd.read_csv(run.path / "generations.csv")
    assert list(table.columns) == list(run.generations.columns) == GENERATION_COLUMNS
    individuals, expected = read(run), []
    for generation, robot in itertools.product(range(run.config.gp.generations), evolving(run)):
        members = individuals[(individuals.generation == generation) & (individuals.robot == f"r{robot}")]
        ranked = members.sort_values(["fitness", "depth", "index"])
        best, worst = ranked.iloc[0], ranked.iloc[-1]
        row = {"generation": generation, "robot": f"r{robot}"}
        for name in ("fitness", "depth", "nodes"):
            mean = float(np.mean(members[name].to_numpy(np.float64)))
            row |= {f"{name}_best": best[name], f"{name}_mean": mean, f"{name}_worst": worst[name]}
        expected.append(row | {name: best[name] for name in COUNTS})
    pd.testing.assert_frame_equal(
        table, pd.DataFrame(expected)[GENERATION_COLUMNS], check_dtype=False, rtol=1e-12, atol=0.0
    )


def test_a_robot_that_stands_has_no_rows(stationary_run):
    assert set(read(stationary_run)["robot"]) == set(stationary_run.generations["robot"]) == {"r0", "r1"}


# ------------------------------------------------------------------------------------------------------- scoring


def test_counts_are_those_of_single_games_played_again_alone(run):
    """Every group of every generation, game by game, the last first, on a fresh arena."""
    settings, robots = run.config, len(run.config.players)
    arena = Arena(settings)
    for (generation, group), rows in read(run).groupby(["generation", "group"]):
        programs = [None] * robots
        for row in rows.itertuples():
            robot = int(row.robot[1:])
            programs[robot] = compile_program(np.asarray(row.tree, np.uint8), function_set(robot, robots))
        seeds = group_seeds(settings.seed, generation, group, settings.evaluation.games)
        games = [arena.play(programs, np.array([seed])) for seed in reversed(seeds)]
        for row in rows.itertuples():
            robot = int(row.robot[1:])
            team = settings.players[robot].team
            assert row.goals == sum(int(game.scorer[0]) == team for game in games)
            assert row.lost == sum(int(game.scorer[0]) == 1 - team for game in games)
            assert row.kicks == sum(int(game.kicks[0, robot]) for game in games)
            assert row.collisions == sum(int(game.collisions[0, robot]) for game in games)
            assert row.passes == sum(int(game.passes[0, robot]) for game in games)
            assert row.steps == sum(int(game.steps[0]) for game in games)


def test_what_was_chosen_is_what_single_games_say(run):
    """Again on a fresh arena: which skill each robot was using in each step."""
    settings, robots = run.config, len(run.config.players)
    arena = Arena(settings)
    for (generation, group), rows in read(run).groupby(["generation", "group"]):
        programs = [None] * robots
        for row in rows.itertuples():
            robot = int(row.robot[1:])
            programs[robot] = compile_program(np.asarray(row.tree, np.uint8), function_set(robot, robots))
        seeds = group_seeds(settings.seed, generation, group, settings.evaluation.games)
        used = arena.play(programs, seeds).skill_steps
        for row in rows.itertuples():
            chosen = [getattr(row, f"chose_{skill}") for skill in SKILLS]
            assert chosen == np.asarray(used[int(row.robot[1:])]).tolist()
            assert sum(chosen) == row.steps


def test_the_eventful_run_has_everything_that_is_counted(eventful_run):
    table = read(eventful_run)
    for name in (*FITNESS_OF, "passes"):
        assert table[name].min() < table[name].max(), name
    mates = table[table.robot == "r0"].set_index(["generation", "group"]).sort_index()
    others = table[table.robot == "r2"].set_index(["generation", "group"]).sort_index()
    assert mates["goals"].tolist() == others["lost"].tolist()
    assert mates["lost"].tolist() == others["goals"].tolist()


def test_fitness_is_fixed_with_as_many_games_as_were_played(small_run):
    table = read(small_run)
    expected = fixed(*(table[name].to_numpy() for name in FITNESS_OF), t_max=small_run.config.evaluation.games)
    assert table["fitness"].to_numpy() == pytest.approx(expected, rel=1e-13)


def test_fitness_varies_with_the_generation_from_0(eventful_run):
    table = read(eventful_run)
    for generation, rows in table.groupby("generation"):
        expected = varying(
            *(rows[name].to_numpy() for name in FITNESS_OF),
            generation=generation,
            generations=eventful_run.config.gp.generations,
            t_max=eventful_run.config.evaluation.games,
        )
        assert rows["fitness"].to_numpy() == pytest.approx(expected, rel=1e-13)


# ------------------------------------------------------------------------------------------------------ breeding


def test_generations_follow_from_each_other(run):
    """The first is created, and each is bred from what was measured of the one before."""
    settings, table = run.config, read(run)
    for robot in evolving(run):
        functions = function_set(robot, len(settings.players))
        trees = first_population(settings.gp, functions, seed=settings.seed, robot=robot)
        for generation in range(settings.gp.generations):
            rows = table[(table.robot == f"r{robot}") & (table.generation == generation)].reset_index()
            assert [codes_of(tree, functions).tolist() for tree in trees] == [t.tolist() for t in rows["tree"]]
            parents = []
            for row in rows.itertuples():
                parent = individual_of(np.asarray(row.tree, np.uint8), functions)
                parent.fitness.values = (row.fitness, row.depth)
                parents.append(parent)
            trees = breed(parents, settings.gp, functions, seed=settings.seed, generation=generation, robot=robot)


def test_the_best_of_a_generation_is_in_the_next(run):
    for robot, generation in itertools.product(evolving(run), range(run.config.gp.generations - 1)):
        best = run.tree(f"r{robot}", generation)
        following = [run.tree(f"r{robot}", generation + 1, rank) for rank in range(run.config.gp.population)]
        assert best in following


def subtrees(nested_tree):
    """Yield a nested tree and all below it."""
    yield nested_tree
    if isinstance(nested_tree, tuple):
        for branch in nested_tree[1:]:
            yield from subtrees(branch)


def replacements(parent, child):
    """Return all pairs of what one replaced subtree may have been and become; (None, None) if any will do."""
    if parent == child:
        return [(None, None)]
    pairs = [(parent, child)]
    if isinstance(parent, tuple) and isinstance(child, tuple) and parent[0] == child[0]:
        differing = [(a, b) for a, b in zip(parent[1:], child[1:], strict=True) if a != b]
        if len(differing) == 1:
            pairs += replacements(*differing[0])
    return pairs


def depth_of(nested_tree):
    return 1 + max(map(depth_of, nested_tree[1:])) if isinstance(nested_tree, tuple) else 0


@pytest.mark.parametrize("which", ["small_run", "eventful_run", "stationary_run", "mutating_run"])
def test_every_individual_is_what_its_operator_makes_of_its_parents(which, request, nested):
    """Trees are compared whole: nothing here knows how children are bred."""
    run = request.getfixturevalue(which)
    table, seen = read(run), Counter()
    for robot in evolving(run):
        of_robot = table[table.robot == f"r{robot}"]
        functions = function_set(robot, len(run.config.players))
        trees = {
            (r.generation, r.index): nested(from_codes(r.tree, functions)) for r in of_robot.itertuples(index=False)
        }
        for row in of_robot.itertuples(index=False):
            child, before = trees[row.generation, row.index], row.generation - 1
            seen[row.operator] += 1
            assert (row.operator == "creation") == (row.generation == 0)
            if row.operator == "creation":
                assert (row.parent_1, row.parent_2) == (-1, -1)
                continue
            parent = trees[before, row.parent_1]
            if row.operator == "crossover":
                donated = list(subtrees(trees[before, row.parent_2]))
                assert any(came is None or came in donated for _, came in replacements(parent, child))
                assert child[0] == parent[0]  # the root stays
            else:
                assert row.parent_2 == -1
                assert row.operator == "mutation" or child == parent
                grown = [0 if came is None else depth_of(came) for _, came in replacements(parent, child)]
                assert row.operator != "mutation" or min(grown) <= run.config.gp.mutation_depth_max
    assert set(seen) <= {"creation", "elite", "reproduction", "crossover", "mutation"}
    assert min(seen[name] for name in ("creation", "elite", "crossover")) > 0
    assert which != "mutating_run" or seen["mutation"] > 20


def test_the_elite_are_the_best_of_the_generation_before(run):
    for robot, generation in itertools.product(evolving(run), range(1, run.config.gp.generations)):
        rows = run.record(generation, f"r{robot}")
        kept = rows[rows.operator == "elite"].sort_values("index")["parent_1"].tolist()
        assert kept == run.record(generation - 1, f"r{robot}")["index"][: run.config.gp.elite].tolist()


# ------------------------------------------------------------------------------------------------------- reports


def test_each_generation_is_reported_when_it_is_on_disk(small_settings, go_on, tmp_path):
    run = create_run(tmp_path / "run", small_settings())
    seen = []

    def report(of):
        table = run.generations
        rows = table[table.generation == of.generation].set_index("robot")
        assert of.best == rows["fitness_best"].to_dict()
        assert of.mean == pytest.approx(rows["fitness_mean"].to_dict(), rel=1e-13)
        assert of.games == run.config.gp.population * run.config.evaluation.games
        assert run.finished == run.checkpoint().generation == of.generation + 1
        seen.append(of.generation)

    go_on(run, report=report)
    assert seen == [0, 1, 2]


def test_a_run_leaves_the_global_generators_as_they_were(small_settings, go_on, tmp_path):
    before = random.getstate(), np.random.get_state()  # noqa: NPY002 - it is this state that must not change
    go_on(create_run(tmp_path / "run", small_settings("gp.generations=2")))
    assert random.getstate() == before[0]
    assert all(np.array_equal(a, b) for a, b in zip(np.random.get_state(), before[1], strict=True))  # noqa: NPY002


# ---------------------------------------------------------------------------------------------------- evaluation


def test_seeds_of_games_are_all_different_and_a_longer_list_begins_like_a_shorter():
    keys = itertools.product(range(3), range(4), range(5))
    seeds = [int(seed) for key in keys for seed in group_seeds(*key, 6)]
    assert len(set(seeds)) == len(seeds) == 3 * 4 * 5 * 6
    assert group_seeds(1, 2, 3, 9)[:4].tolist() == group_seeds(1, 2, 3, 4).tolist()


def test_outcomes_come_in_the_order_of_the_groups(small_settings):
    settings = small_settings()
    functions = [function_set(robot, 3) for robot in range(3)]
    trees = [first_population(settings.gp, functions[r], seed=9, robot=r) for r in range(3)]
    teams = [
        [compile_program(codes_of(trees[r][g], functions[r]), functions[r]) for r in range(3)]
        for g in range(settings.gp.population)
    ]
    with Evaluator(settings, workers=2, backend="threads") as evaluator:
        matches = [
            Match(team, group_seeds(settings.seed, 5, g, settings.evaluation.games)) for g, team in enumerate(teams)
        ]
        together = list(evaluator.play(matches))
    game = SoccerGame(settings)
    for group, (outcome, team) in enumerate(zip(together, teams, strict=True)):
        alone = game.play(team, group_seeds(settings.seed, 5, group, settings.evaluation.games))
        assert np.array_equal(outcome.winner, alone.winner)
        for name in game.counts:
            assert np.array_equal(outcome.counts[name], alone.counts[name]), name


def test_workers_end_with_their_evaluator_even_if_it_is_interrupted(small_settings):
    """A thread that is still in a world, or frees it, while Python ends makes Chipmunk abort the process."""
    settings = small_settings("evaluation.games=3000")
    alone = compile_program(np.array([35], np.uint8), function_set(0, 3))
    before = set(threading.enumerate())
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    ctrl_c = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    try:
        with pytest.raises(KeyboardInterrupt), Evaluator(settings, workers=2, backend="threads") as evaluator:  # noqa: PT012
            ctrl_c.start()
            matches = [Match([alone] * 3, group_seeds(1, 0, group, 3000)) for group in range(2)]
            list(itertools.chain.from_iterable(evaluator.play(matches) for _ in range(100)))
    finally:
        signal.signal(signal.SIGINT, handler)
    ctrl_c.join()
    left = {thread for thread in set(threading.enumerate()) - before if "worker" in thread.name}
    for thread in left:
        thread.join()
    assert left == set()


def test_an_unknown_backend_is_refused():
    with pytest.raises(InputError, match="the backend must be one of threads, processes, got 'mpi'"):
        check_backend("mpi")
