"""Recipes of several learners: those that are there, and what is refused before anything is learned."""

from __future__ import annotations

import msgspec
import pytest

from behaviors.team.recipe import TeamRecipe, mates_of, read_team
from coevo.config import check
from coevo.errors import InputError
from coevo.study.plan import read_plan

START = {"x_m": [1.0, 4.0], "y_m": [0.5, 4.0]}
BALL = {"kind": "ball"}
MATE = {"kind": "mate"}
S = {"name": "s", "earns": {"goal": 1.0}}
ROBOTS = [{"name": name, "start": START, "objects": [BALL]} for name in ("r0", "r1")]
PLAIN = {
    "name": "mine",
    "robots": ROBOTS,
    "turns": [{"name": "A", "learners": ["r0"]}],
    "ball": START,
    "reward": {"channels": [S]},
}


def turns(*given):
    return {"turns": [{"name": name, "learners": list(learners)} for name, *learners in given]}


def alone(**changes):  # noqa: ANN003 - of r1
    return {"robots": [ROBOTS[0], {**ROBOTS[1], **changes}]}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (turns(("A", "r0"), ("B", "r7")), ["'B' lets 'r7' learn", "robots r0, r1", "Did you mean 'r"]),
        (turns(("A", "r0"), ("B",)), ["turns.1", "nobody learns in 'B'; name a robot"]),
        (turns(), ["turns"]),
        (turns(("A", "r0"), ("A", "r1")), ["turns: expected each name once"]),
        (turns(("A", "r0", "r0")), ["names a learner twice"]),
        ({"turns": [{"name": "A", "learners": ["r0"], "trials": 0}]}, ["trials"]),
        ({"robots": [ROBOTS[0], ROBOTS[0]]}, ["robots: expected each name once"]),
        ({"robots": ROBOTS[:1]}, ["robots"]),
        (alone(team=1, objects=[MATE]), ["r1 has no mate"]),
        (alone(objects=[BALL, BALL]), ["r1 has an object twice"]),
        (alone(objects=[{**BALL, "needed": True}]), ["skills that learn alone"]),
        ({"reward": {"channels": [{"name": "m", "earns": {"giveaway": -1}}]}}, ["'giveaway', which never happens"]),
        ({**alone(team=1), "reward": {"channels": [{"name": "p", "earns": {"pass": 1}}]}}, ["'pass', which never"]),
        ({"reward": {"channels": [S], "matrix": [[0.9, 0.1]]}}, ["1 rows of 1 numbers"]),
        ({"reward": {"channels": [S], "matrix": [[1.0]]}}, ["unit circle"]),
        ({"reward": {"channels": [{"name": "s", "earns": {"goal": 1, "gaol": 1}}]}}, ["Did you mean 'goal'"]),
        ({"leaners": 1}, ["leaners"]),
    ],
)
def test_what_cannot_be_learned_is_refused(changes, said):
    with pytest.raises(InputError) as caught:
        check(TeamRecipe, {**PLAIN, **changes}, "mine.toml")
    assert str(caught.value).startswith("mine.toml")
    for part in said:
        assert part in str(caught.value)


def test_what_is_sound_is_read_and_written_alike():
    recipe = check(TeamRecipe, PLAIN, "it")
    assert check(TeamRecipe, msgspec.to_builtins(recipe), "it again") == recipe


def test_the_recipes_are_those_of_the_text():
    two, three = read_team("chapter5/shoot-and-pass"), read_team("chapter5/three-robots")
    assert [(turn.name, *turn.learners) for turn in two.turns] == [("A", "r0"), ("B", "r1"), ("C", "r0"), ("D", "r1")]
    assert {two.trials_of(turn) for turn in (*two.turns, *three.turns)} == {25_000}
    told = {one.name: (one.earns.amounts, one.discount) for one in three.reward.channels}
    assert told == {
        "c": ({"collision": -1.0}, 0.3),
        "l": ({"conceded": -1.0}, 0.9),
        "m": ({"giveaway": -1.0}, 0.9),
        "s": ({"goal": 1.0}, 0.9),
        "p": ({"pass": 1.0}, 0.9),
        "k": ({"kick": 1.0}, 0.6),
    }
    assert [(one.name, one.discount) for one in two.reward.channels] == [("c", 0.3), ("s", 0.9), ("p", 0.9), ("k", 0.6)]
    assert (mates_of(two), mates_of(three)) == ([1, 0], [1, 0, -1])


def test_the_arms_of_the_studies_are_the_orders_of_the_text_and_weights_of_the_kick():
    orders = {run.label.split("-")[-1]: run.settings(0) for run in read_plan("chapter5/orders-study").conditions}
    learners = {arm: [turn.learners for turn in recipe.turns] for arm, recipe in orders.items()}
    for arm, order in (("a", "r0 r1 r2"), ("b", "r2 r0 r1"), ("c", "r0 r2 r1 r2")):
        assert learners[arm] == [*((name,) for name in order.split()), ("r0", "r1", "r2")]
        assert len({orders[arm].trials_of(turn) for turn in orders[arm].turns}) == 1
    total = {arm: sum(recipe.trials_of(turn) for turn in recipe.turns) for arm, recipe in orders.items()}
    assert total["simultaneous"] == total["a"] == total["b"]
    arms = {run.label.split("-")[-1]: run.settings(0) for run in read_plan("chapter5/pass-study").conditions}
    weights = {arm: arms[arm].reward.channels[0].earns.kick for arm in ("w0", "w02", "w1")}
    assert weights == {"w0": 0.0, "w02": 0.2, "w1": 1.0}
    assert sum(arms["simultaneous"].trials_of(turn) for turn in arms["simultaneous"].turns) == 4 * arms["votes"].trials


def test_of_the_updates_study_each_arm_changes_one_thing():
    arms = read_plan("chapter5/updates-study").conditions
    assert len({msgspec.json.encode(one.settings(0)) for one in arms}) == len(arms) == 12
