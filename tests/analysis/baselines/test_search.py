"""Best answers, in a game whose every result can be worked out."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from analysis.baselines import (
    Answer,
    behaviour,
    best_answer,
    best_answers,
    best_single_skills,
    gain,
    measure,
    moves,
    single_skill_teams,
    small_trees,
    team_line_up,
)
from analysis.baselines.search import best_of
from coevo.tree import Tree, parse

X, Y = Tree(("x",)), Tree(("y",))


def drawn(seed, roles):
    return np.random.default_rng(seed).integers(-1, 2, (2, 2, *(2,) * roles))


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_alone_gets_the_best_of_all_its_trees(seed, known):
    world = known(drawn(seed, 3), (0, 0, 1))
    others = {0: parse("IF_dark(x, y)", world.game.function_set(0)), 1: Y}
    candidates = small_trees(world.game.function_set(2))
    with world.evaluator() as evaluator:
        answer = best_answer(
            world.game, evaluator, 1, [team_line_up(world.game, others)], games=4000, seed=seed, roles=[2]
        )
    worths = [world.worth({**others, 2: tree}, 1) for tree in candidates]
    assert world.worth({**others, **answer.trees}, 1) == max(worths)
    assert answer.worth == pytest.approx(max(worths), abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_no_robot_of_a_team_could_do_better_alone_and_the_team_is_ahead_of_single_skills(seed, known):
    world = known(drawn(seed, 3), (0, 0, 1))
    opponent = {2: parse("IF_wet(x, y)", world.game.function_set(2))}
    met = [team_line_up(world.game, opponent)]
    with world.evaluator() as evaluator:
        answer = best_answer(world.game, evaluator, 0, met, games=20_000, seed=seed)
        single = best_single_skills(world.game, evaluator, 0, met, games=2000, seed=seed)
    worth = world.worth({**answer.trees, **opponent}, 0)
    for role in (0, 1):
        for tree in small_trees(world.game.function_set(role)):
            assert world.worth({**answer.trees, role: tree, **opponent}, 0) <= worth
    singles = [world.worth({0: one, 1: two, **opponent}, 0) for one, two in itertools.product((X, Y), repeat=2)]
    assert world.worth({**single.trees, **opponent}, 0) == max(singles) <= worth
    assert set(answer.trees) == {0, 1}
    assert answer.games == pytest.approx(20_000, rel=0.2)


def test_deeper_trees_are_found_where_they_are_needed(known):
    winners = np.full((2, 2, 2, 2), 1)
    for dark, wet in itertools.product((0, 1), repeat=2):
        winners[dark, wet, dark ^ wet] = 0  # p0 has to choose by both; p1 only looks on
    world = known(winners, (0, 1))
    with world.evaluator() as evaluator:
        met = [team_line_up(world.game, {1: X})]
        shallow, deep = (
            best_answer(world.game, evaluator, 0, met, games=4000, seed=1, depth=depth) for depth in (1, 2)
        )
    assert world.worth({**shallow.trees, 1: X}, 0) == 0.5
    assert world.worth({**deep.trees, 1: X}, 0) == 1.0
    assert deep.trees[0].depth == 2


def test_only_teams_that_may_be_an_answer_are_tried(known):
    world = known(np.zeros((2, 2, 2, 2), int), (0, 0))

    def keep(team):
        return any("y" in tree.names for tree in team.values())

    with world.evaluator() as evaluator:
        answer = best_answer(world.game, evaluator, 0, games=500, seed=1, keep=keep)
        assert keep(answer.trees)
        with pytest.raises(ValueError, match="at least one team"):
            best_answer(world.game, evaluator, 0, games=500, seed=1, keep=lambda _: False)
        with pytest.raises(ValueError, match="at least one team"):
            best_single_skills(world.game, evaluator, 0, games=500, seed=1, keep=lambda _: False)


def test_games_that_are_lost_may_count(known):
    winners = np.zeros((2, 2, 2, 2), int)
    winners[..., 0, :] = [[[0], [0]], [[1], [1]]]  # x wins where it is not dark, and loses where it is
    winners[..., 1, :] = [[[0], [-1]], [[-1], [-1]]]  # y wins half as often, and never loses
    world = known(winners, (0, 1))
    with world.evaluator() as evaluator:
        met = [team_line_up(world.game, {1: X})]
        bold, careful = (
            best_of(world.game, evaluator, 0, met, [{0: X}, {0: Y}], games=500, seed=1, lost_weight=weight)
            for weight in (0.0, 1.0)
        )
    assert (bold.trees, careful.trees) == ({0: X}, {0: Y})


def test_measured_games_are_the_same_for_all_and_dealt_to_opponents_in_turn(known):
    winners = np.zeros((2, 2, 2, 2), int)
    winners[..., 0] = 0
    winners[..., 1] = 1  # p1 decides alone
    world = known(winners, (0, 1))
    with world.evaluator() as evaluator:
        met = [team_line_up(world.game, {1: tree}) for tree in (X, Y, X)]
        one, two = measure(
            world.game, evaluator, 0, [team_line_up(world.game, {0: tree}) for tree in (X, Y)], met, games=100, seed=1
        )
    assert len(one.won) == 102  # a multiple of three
    assert one.won.sum() == 68
    assert one.lost_share == pytest.approx(1 / 3)
    assert one.time_out == 0.0
    assert one.won.tolist() == two.won.tolist()
    assert gain(one, two)[0] == 0.0
    assert gain(one, two, 0.5) == (0.0, 0.0, 0.0)


def test_workers_change_nothing(known):
    world = known(drawn(7, 3), (0, 0, 1))
    met = [team_line_up(world.game, {2: X})]
    found = []
    for workers in (1, 2):
        with type(world.evaluator())(
            world.settings, workers=workers, backend="threads", folders=world.folders
        ) as evaluator:
            found.append(best_answer(world.game, evaluator, 0, met, games=2000, seed=1))
    assert found[0] == found[1]


def test_best_answers_go_round_where_each_has_one(known):
    winners = np.zeros((2, 2, 2, 2), int)
    for first, second in itertools.product((0, 1), repeat=2):
        winners[..., first, second] = int(first != second)  # team 0 wants to be like team 1, which wants to differ
    world = known(winners, (0, 1))
    only = {0: [X, Y], 1: [X, Y]}
    with world.evaluator() as evaluator:
        rounds = best_answers(
            world.game, evaluator, 8, games=200, seed=1, fresh=100, candidates=only, begin={0: {0: Y}, 1: {1: X}}
        )
    assert [one.team for one in rounds] == [0, 1] * 4
    assert moves(rounds) == 8
    assert [one.again for one in rounds] == [None, None, None, 0, 1, 2, 3, 0]
    assert {one.gain[0] for one in rounds} == {1.0}


def test_best_answers_stop_where_neither_can_do_better(known):
    winners = np.full((2, 2, 2, 2), -1)
    winners[:, :, 1, 0] = 0  # y is better than x for team 0, against x; y never lets it win
    world = known(winners, (0, 1))
    with world.evaluator() as evaluator:
        rounds = best_answers(world.game, evaluator, 8, games=400, seed=1, fresh=100, begin={0: {0: X}, 1: {1: X}})
    assert [(one.team, one.moved) for one in rounds] == [(0, True), (1, False), (0, False)]
    assert behaviour(rounds[0].standing[0], world.game.function_set(0)) == "y"


def test_an_answer_that_is_no_better_does_not_take_a_place(known, monkeypatch):
    winners = np.zeros((2, 2, 2, 2), int)
    winners[:, :, 1] = 1  # y loses for team 0
    world = known(winners, (0, 1))
    monkeypatch.setattr("analysis.baselines.rounds.best_answer", lambda *_, **__: Answer(0, {0: Y}, 1.0, 0))
    with world.evaluator() as evaluator:
        (one,) = best_answers(world.game, evaluator, 1, games=10, seed=1, fresh=50, begin={0: {0: X}, 1: {1: X}})
    assert (one.gain[0], one.moved) == (-1.0, False)
    assert one.previous == {0: X}
    assert one.standing == {0: X, 1: X}


def test_robots_of_one_team_answer_each_other(known):
    winners = np.full((2, 2, 2, 2), -1)
    for dark, wet in itertools.product((0, 1), repeat=2):
        winners[dark, wet, dark, wet] = 0
    world = known(winners, (0, 0))
    with world.evaluator() as evaluator:
        rounds = best_answers(world.game, evaluator, 6, games=1000, seed=1, fresh=400)
    assert [one.roles for one in rounds] == [(0,), (1,), (0,), (1,)][: len(rounds)]
    assert [one.moved for one in rounds] == [True, True, False, False]
    assert world.worth(rounds[-1].standing, 0) == 1.0


def test_single_skills_to_begin_with_are_best_against_all_of_the_others(known):
    world = known(drawn(3, 3), (0, 0, 1))
    with world.evaluator() as evaluator:
        found = single_skill_teams(world.game, evaluator, games=200, seed=1)
    pairs = [dict(zip((0, 1), pair, strict=True)) for pair in itertools.product((X, Y), repeat=2)]

    def mean(own, team):
        others = [{2: tree} for tree in (X, Y)] if team == 0 else pairs
        return np.mean([world.worth({**own, **other}, team) for other in others])

    assert mean(found[0], 0) == max(mean(one, 0) for one in pairs)
    assert mean(found[1], 1) == max(mean({2: tree}, 1) for tree in (X, Y))
