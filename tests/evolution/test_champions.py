"""The last champions judged again: against every game of theirs, one by one."""

from __future__ import annotations

import itertools
import json
import shutil

import numpy as np
import pandas as pd
import pytest

from coevo.contest import champions
from coevo.errors import InputError
from coevo.evolution.champions import _ranked
from coevo.fitness import Scorer, fixed
from coevo.game import Arena, programs_of
from coevo.run import CHAMPION_COLUMNS, create_run, open_run
from coevo.seeds import RunStream, game_seeds
from coevo.usage import used_tree

GAMES = 4  # of evolution, and of a block
FITNESS_OF = ("goals", "lost", "kicks", "collisions", "steps")
# Kicks are soon enough, so that it matters which games are a block.
WEIGHTS = {"alpha_l": 0.5, "alpha_k": 0.05, "alpha_c": 0.005, "alpha_s": 0.0001, "beta": 12.0}
NEAR = (
    *("game.time_limit_steps=300", f"evaluation.games={GAMES}", "gp.generations=2", "gp.population=5"),
    "game.ball_start={ x_m = [7.0, 7.4], y_m = [2.0, 2.5] }",
    f"fitness.fixed={{ {', '.join(f'{name} = {value}' for name, value in WEIGHTS.items())} }}",
    "players.0.start={ x_m = [6.3, 6.6], y_m = [2.1, 2.4] }",
    "players.2.start={ x_m = [7.6, 7.9], y_m = [2.0, 2.6] }",
)


@pytest.fixture(scope="module")
def settings_for(small_settings):
    return lambda *more: small_settings(*NEAR, "evaluation.champion_games=16", *more)


@pytest.fixture(scope="module")
def run(settings_for, go_on, tmp_path_factory):
    return go_on(create_run(tmp_path_factory.mktemp("judged") / "run", settings_for()))


@pytest.fixture(scope="module")
def searched(settings_for, go_on, tmp_path_factory):
    settings = settings_for("gp.variation=random", "gp.generations=3", "evaluation.champion_games=4")
    return go_on(create_run(tmp_path_factory.mktemp("searched") / "run", settings))


@pytest.fixture
def copied(run, tmp_path):
    return open_run(shutil.copytree(run.path, tmp_path / "copy"))


def distinct(run, robot, generations):
    """Return the best different trees, best first: a list of (generation, index, tree)."""
    frames = [run.record(g, robot).assign(rank=range(run.config.gp.population)) for g in generations]
    rows = pd.concat(frames).sort_values(["fitness", "depth", "generation", "index"], kind="stable")
    found = {}
    for row in rows.to_dict("records"):
        found.setdefault(
            tuple(row["tree"]), (row["generation"], row["index"], run.tree(robot, row["generation"], row["rank"]))
        )
    return list(found.values())


def judged(run, generations):
    """Return by team the figures of all its candidates and who they are, by single games on a fresh arena."""
    arena, total = Arena(run.config), run.config.evaluation.champion_games
    best = [distinct(run, f"r{role}", generations) for role in range(3)]
    teams, found = {0: (0, 1), 1: (2,)}, {}
    for team, roles in teams.items():
        others = [role for role in range(3) if role not in roles]
        few = min(4, *(len(best[role]) for role in others))
        seeds = game_seeds(run.config.seed, RunStream.CHAMPIONS, team, count=total)
        found[team] = []
        for places in itertools.product(*(range(min(len(best[role]), 5 if len(roles) > 1 else 25)) for role in roles)):
            counts = {name: np.zeros((total // GAMES, 3), np.int64) for name in FITNESS_OF}
            won = lost = 0
            for game, seed in enumerate(seeds):
                trees = [None] * 3
                for role, place in zip(roles, places, strict=True):
                    trees[role] = best[role][place][2]
                for role in others:
                    trees[role] = best[role][game % 4 % few][2]
                played = run.game.played(arena.play(programs_of(run.game, trees), np.array([seed])))
                for name in FITNESS_OF:
                    counts[name][game // GAMES] += played.counts[name][0]
                won += int(played.winner[0] == team)
                lost += int(played.winner[0] == 1 - team)
            fitness = fixed(*(counts[name] for name in FITNESS_OF), t_max=GAMES, **WEIGHTS).mean(axis=0)[list(roles)]
            who = [best[role][place][:2] for role, place in zip(roles, places, strict=True)]
            found[team].append((fitness, sum(places), places, who, won, lost))
    return found


def test_with_one_block_the_best_candidate_of_all_is_chosen(searched):
    """In random search candidates come from all generations."""
    table = searched.champions()
    assert table.columns.tolist() == list(CHAMPION_COLUMNS)
    assert table["robot"].tolist() == ["r0", "r1", "r2"]
    for team, candidates in judged(searched, range(3)).items():
        fitness, _, _, who, won, lost = min(candidates, key=lambda one: (one[0].sum(), *one[1:3]))
        rows = table[table["team"] == team]
        assert list(zip(rows["generation"], rows["index"], strict=True)) == who
        assert rows["fitness_again"].to_numpy() == pytest.approx(fitness, rel=1e-12)
        assert set(zip(rows["games"], rows["won"], rows["lost"], strict=True)) == {(4, won, lost)}


def test_with_more_blocks_the_figures_are_means_over_all_and_the_chosen_beats_those_that_stayed(run):
    table = run.champions()
    assert min(table["won"].max(), table["lost"].max()) > 0
    for team, candidates in judged(run, [1]).items():
        rows = table[table["team"] == team]
        who = list(zip(rows["generation"], rows["index"], strict=True))
        (own,) = [one for one in candidates if one[3] == who]
        assert rows["fitness_again"].to_numpy() == pytest.approx(own[0], rel=1e-12)
        assert set(zip(rows["games"], rows["won"], rows["lost"], strict=True)) == {(16, *own[4:])}
        better = sum(one[0].sum() < own[0].sum() - 1e-9 for one in candidates)
        assert better <= len(candidates) - -(-len(candidates) // 4)  # only what fell out in the first round may be


def test_candidates_are_the_best_different_trees(run, searched, monkeypatch):
    monkeypatch.setattr("coevo.evolution.champions._CANDIDATES", 3)
    for of, generations in ((run, [1]), (searched, range(3))):
        for role in range(3):
            ranked = _ranked(of, role, Scorer(of.config, of.game.counts))
            told = [(tree.generation, tree.place) for tree in ranked]
            assert told == [one[:2] for one in distinct(of, f"r{role}", generations)[:3]]


def test_fitness_is_that_which_evolution_saw(run, searched):
    for of in (run, searched):
        for row in of.champions().to_dict("records"):
            rows = of.record(row["generation"], row["robot"])
            assert row["fitness"] == rows.set_index("index").loc[row["index"], "fitness"]


def test_the_champion_of_the_last_generation_is_the_chosen_one_and_of_others_the_best(searched):
    for row in searched.champions().to_dict("records"):
        generation, rank = searched.champion(row["robot"], 2)
        assert generation == row["generation"]
        assert searched.record(generation, row["robot"])["index"][rank] == row["index"]
        assert searched.champion(row["robot"], 1) == (1, 0)
        used = used_tree(searched, row["robot"])
        assert (used.generation, used.rank, used.again) == (generation, rank, (row["fitness_again"], 4))
        assert used.tree == searched.champion_tree(row["robot"], 2) == searched.tree(row["robot"], generation, rank)
        other = 1 if rank == 0 else 0
        assert used_tree(searched, row["robot"], generation, other).again is None
    for parts in champions(searched, 2).values():
        for role, program in parts.items():
            tree = searched.champion_tree(f"r{role}", 2)
            assert len(program.codes) == tree.nodes


# ------------------------------------------------------------------------------------------------ stopped, or damaged


def test_a_run_is_finished_when_its_champions_are_chosen(copied, run, go_on, results_of):
    (copied.path / "champions.csv").unlink()
    assert not copied.is_finished
    with pytest.raises(InputError, match=r"champions\.csv is lost; 'coevo resume"):  # nobody else is shown instead
        copied.champion("r0", 1)
    copied.save_result("judged-40-of1", {"of": np.arange(3)})  # of champions that were not chosen yet
    assert go_on(copied, workers=2).is_finished
    assert copied.results == []
    assert results_of(copied.path) == results_of(run.path)
    assert "champions.csv" in results_of(run.path)


def test_without_a_wish_nobody_is_judged_again(small_run):
    assert small_run.champions() is None
    assert not (small_run.path / "champions.csv").exists()
    assert small_run.champion("r0", 2) == (2, 0)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda _: "",
        lambda text: text.replace("team,", "tame,"),
        lambda text: text.replace("r1", "r7"),
        lambda text: text.replace(text.splitlines()[1].split(",")[4], "1.5", 1),
        lambda text: "\n".join(text.splitlines()[:-1]),
        lambda text: text[:-9],
    ],
    ids=["empty", "a column", "a robot", "a fitness", "a row", "half a row"],
)
def test_a_damaged_table_of_champions_is_named_with_the_remedy(spoil, copied):
    path = copied.path / "champions.csv"
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError, match=r"champions.csv is damaged .*; delete it; 'coevo resume") as told:
        champions(copied, 1)
    assert "\n" not in str(told.value)


def test_the_closing_table_says_both_figures(coevo, tmp_path):
    words = [word for change in NEAR for word in ("--set", change)]
    small = ["gp.tournament=2", "gp.creation_depth_max=4", "evaluation.champion_games=8"]
    words += [word for change in small for word in ("--set", change)]
    told = coevo("evolve", "smoke", *words, "--out", tmp_path / "run", "--unseen", 0)
    assert told.code == 0, told.err
    assert "Choosing the last champions once more, by 8 games" in told.err
    assert "The last champions:" in told.out
    table = open_run(tmp_path / "run").champions()
    for row in table.to_dict("records"):
        (line,) = [line for line in told.out.splitlines() if line.startswith(row["robot"])]
        assert line.split()[1:3] == [f"{row['fitness']:.3f}", f"{row['fitness_again']:.3f}"]
    data = json.loads(coevo("resume", tmp_path / "run", "--json", "--unseen", 0).out)
    assert [robot["fitness_again"] for robot in data["robots"].values()] == table["fitness_again"].tolist()
    assert [robot["best_fitness"] for robot in data["robots"].values()] == table["fitness"].tolist()
    shown = coevo("inspect", tmp_path / "run", "--robot", "r1")
    assert "Judged again it is" in shown.out
    assert "in the 8 games by which it was chosen" in " ".join(shown.out.split())


def test_a_team_without_opponents_that_evolve_is_judged_alone(small_settings, go_on, tmp_path):
    given = ("players.2.control=tree", "players.2.tree=shoot", "evaluation.champion_games=8", "gp.generations=1")
    run = go_on(create_run(tmp_path / "run", small_settings(*given)))
    table = run.champions()
    assert table["robot"].tolist() == ["r0", "r1"]
    arena, seeds = Arena(run.config), game_seeds(run.config.seed, RunStream.CHAMPIONS, 0, count=8)
    trees = [run.champion_tree("r0", 0), run.champion_tree("r1", 0), None]
    played = arena.play(programs_of(run.game, trees), seeds)
    assert set(table["won"]) == {played.goals_of(0)}
    assert set(table["lost"]) == {played.goals_of(1)}
