"""Tournaments: what is kept is what single games give, and the same whoever plays and however often it stops."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import analysis.tournament.play as play_module
from analysis.tournament import chosen_generations, largest_tournament, play_tournament, stored_tournaments
from coevo.contest import champions, line_up, single_skills
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.game import SoccerGame
from coevo.run import create_run, open_run
from coevo.seeds import RunStream, game_seeds


@pytest.fixture
def copied(small_run, tmp_path):
    """Return a function that gives a copy of the small run without what was found out about it."""
    numbers = itertools.count()

    def copy():
        folder = tmp_path / f"copy{next(numbers)}"
        folder.mkdir()
        (folder / "individuals.parquet").symlink_to(small_run.path / "individuals.parquet")
        for name in ("config.toml", "environment.json", "generations.csv", "checkpoint.npz"):
            (folder / name).symlink_to(small_run.path / name)
        return open_run(folder)

    return copy


def play(run, *, workers=1, backend="threads", **options):  # noqa: ANN003 - of play_tournament
    options = {"generations": (0, 1, 2), "games": 4} | options
    with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
        return play_tournament(run, evaluator, **options)


def strength(run, team, generation):
    """Return the strength of a champion of the ladder, from its text."""
    tree = run.tree(f"p{team}", generation)
    return int(next(name for name in tree.names if not name.startswith("IF_"))[1:])


def test_every_pair_is_what_its_games_played_alone_give(copied):
    run = copied()
    tournament = play(run)
    game = SoccerGame(run.config)
    for i, j in itertools.product(range(3), repeat=2):
        trees = {**champions(run, i)[0], **champions(run, j)[1]}
        seeds = game_seeds(run.config.seed, RunStream.TOURNAMENT, (i + j) % 3, count=4)
        alone = game.play(line_up(game, trees), seeds)
        assert tournament.share(0)[i, j] == (alone.winner == 0).mean()
        assert tournament.share(1)[j, i] == (alone.winner == 1).mean()
        assert tournament.lost(0)[i, j] == (alone.winner == 1).mean()
        totals = np.array([alone.counts[name].sum(axis=0) for name in game.counts]).T
        assert np.array_equal(tournament.totals[0, i, j], totals)


@pytest.mark.parametrize(
    ("stop", "workers", "backend"),
    [(1, 2, "threads"), (2, 1, "threads"), pytest.param(1, 2, "processes", marks=pytest.mark.slow)],
)
def test_a_stopped_tournament_goes_on_to_the_same_bytes(stop, workers, backend, copied):
    whole, run = copied(), copied()
    play(whole)
    (path,) = (whole.path / "results").iterdir()

    def interrupt(done, _total):
        if done == stop * 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play(run, report=interrupt)
    kept = run.path / "results" / path.name
    assert kept.read_bytes() != path.read_bytes()
    play(open_run(run.path), workers=workers, backend=backend)
    assert kept.read_bytes() == path.read_bytes()


def test_a_finished_tournament_is_read_and_not_played(copied):
    run = copied()
    first = play(run)
    again = play_tournament(run, None, generations=(0, 1, 2), games=4)  # nobody who could play
    assert np.array_equal(first.wins, again.wins)
    (stored,) = stored_tournaments(run)
    assert np.array_equal(stored.totals, first.totals)


def test_on_the_ladder_the_stronger_wins(ladder):
    run = ladder(2)
    tournament = play(run, generations=(0, 1, 2, 3))
    mine, theirs = ([strength(run, team, g) for g in range(4)] for team in (0, 1))
    expected = np.greater.outer(mine, theirs).astype(float)
    assert np.array_equal(tournament.share(0), expected)
    assert np.array_equal(tournament.lost(0), np.less.outer(mine, theirs).astype(float))
    assert np.array_equal(tournament.share(1), np.less.outer(mine, theirs).T.astype(float))


def test_whoever_takes_part_plays_from_the_same_starts(ladder):
    run = ladder(2, luck=3.0, generations=7)
    tournament = play(run, generations=(0, 3, 6))
    own = [1000 * np.array([strength(run, team, g) for g in (0, 3, 6)]) * 4 for team in (0, 1)]
    rows = tournament.totals[0, :, :, 0, 0] - own[0][:, None]
    columns = tournament.totals[0, :, :, 1, 0] - own[1][None, :]
    assert all(sorted(row) == sorted(rows[0].tolist()) for row in rows.tolist())
    assert all(sorted(column) == sorted(columns[:, 0].tolist()) for column in columns.T.tolist())


def test_games_that_a_team_without_evolution_wins_are_lost(small_settings, go_on, tmp_path):
    settings = small_settings(
        *("gp.population=4", "gp.generations=2", "game.time_limit_steps=400", "skills.shoot=avoid"),
        preset="stationary-opponent",
    )
    run = go_on(create_run(tmp_path / "run", settings))
    tournament = play(run, generations=(0, 1), games=60)
    trees = [champions(run, 0)[0], champions(run, 1)[0]]
    game = SoccerGame(run.config)
    for i, column in itertools.product(range(2), repeat=2):
        seeds = game_seeds(run.config.seed, RunStream.TOURNAMENT, column, count=60)
        winner = game.play(line_up(game, trees[i]), seeds).winner
        assert tournament.share(0)[i, column] == (winner == 0).mean()
        assert tournament.lost(0)[i, column] == (winner == 1).mean()


def test_what_is_stopped_within_a_pair_is_played_again(copied, monkeypatch):
    whole, stopped = copied(), copied()
    play(whole)
    (path,) = (whole.path / "results").iterdir()
    entered, before = [], play_module._enter

    def interrupt(*arguments):
        entered.append(arguments)
        if len(entered) == 5:
            raise KeyboardInterrupt
        before(*arguments)

    monkeypatch.setattr(play_module, "_enter", interrupt)
    with pytest.raises(KeyboardInterrupt):
        play(stopped)
    monkeypatch.undo()
    play(open_run(stopped.path))
    assert (stopped.path / "results" / path.name).read_bytes() == path.read_bytes()


def test_with_three_teams_each_meets_the_two_others_together(ladder):
    run = ladder(3)
    tournament = play(run, generations=(0, 2, 3))
    assert tournament.wins.shape == (3, 3, 3, 3)
    for side in range(3):
        for i, mine in enumerate((0, 2, 3)):
            for j, met in enumerate((0, 2, 3)):
                others = max(strength(run, other, met) for other in range(3) if other != side)
                assert tournament.share(side)[i, j] == (strength(run, side, mine) > others)


def test_a_team_alone_plays_from_the_same_starts_in_every_generation(ladder):
    run = ladder(1, luck=3.0)
    tournament = play(run, generations=(0, 1, 2, 3))
    points = tournament.totals[0, :, :, 0, 0]
    by_strength = points - 4000 * np.array([strength(run, 0, g) for g in range(4)])[:, None]
    assert all(
        sorted(row) == sorted(by_strength[0]) for row in by_strength.tolist()
    )  # the luck of all rows is the same
    assert np.all(by_strength == by_strength[0])  # in the same columns
    assert len(set(by_strength[0].tolist())) == 4
    assert np.all(tournament.share(0) == 1.0)  # nobody else could win


def test_whole_generations_play_by_members_drawn_at_random(ladder):
    run = ladder(2, population=40)
    tournament = play(run, generations=(0,), games=4000, individuals="all")
    codes = {record.role: record.codes for record in run.records(0)}
    leaves = {role: [int(tree[tree > 0][0]) for tree in trees] for role, trees in codes.items()}
    expected = np.mean([a > b for a, b in itertools.product(leaves[0], leaves[1])])
    assert tournament.share(0)[0, 0] == pytest.approx(expected, abs=0.04)  # five standard deviations


def test_a_damaged_or_foreign_result_is_told(copied, ladder):
    run = copied()
    play(run)
    (path,) = (run.path / "results").iterdir()
    data = path.read_bytes()
    path.write_bytes(data[:-30])
    with pytest.raises(InputError, match=r"is damaged .*; delete it; it is made anew"):
        play(run)
    other = ladder(2)
    (other.path / "results").mkdir()
    (other.path / "results" / path.name).write_bytes(data)
    with pytest.raises(InputError, match="belongs to another run"):
        other.result(path.stem)


def test_a_tournament_that_ends_before_the_run_is_not_what_came_of_it(copied):
    run = copied()
    play(run, generations=(0, 1), games=10)
    assert largest_tournament(run) is None
    play(run, generations=(0, 2), games=1)
    assert largest_tournament(run) is None
    play(run, generations=(0, 2), games=10)
    assert largest_tournament(run).generations == (0, 2)


def test_chosen_generations_end_with_the_last():
    assert chosen_generations(60, 7) == (0, 7, 14, 21, 28, 35, 42, 49, 56, 59)
    assert chosen_generations(1, 5) == (0,)
    with pytest.raises(InputError, match="no finished generation"):
        chosen_generations(0, 1)


def test_single_skills_are_all_teams_of_one_skill_for_each_robot(small_run):
    game = small_run.game
    teams = single_skills(game, 0)
    assert len(teams) == len({tuple(names.values()) for names, _ in teams}) == 16
    for names, programs in teams:
        assert {role: game.function_set(role).terminals[-1 - int(p.codes[0])] for role, p in programs.items()} == names
