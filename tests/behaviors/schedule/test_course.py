"""The periods of chapter 3: who stores, renews and learns when (Table 3.1), what is kept, measured and told."""

from __future__ import annotations

import numpy as np
import pytest

from behaviors.schedule.agents import NAMES, PERIODS, new_agents
from behaviors.schedule.course import Course
from behaviors.schedule.models import stored_by
from behaviors.schedule.recipe import read_schedule, transfer_world
from behaviors.schedule.scene import pair_scene
from behaviors.trials.task import COLLISION, SUCCESS
from coevo.errors import InputError
from coevo.recipes import recipe_names
from coevo.soccer.drive import action_set
from coevo.stage import LEARNER, SKILL

CENTRE_Y = 1


def known(agent):
    """Return what a robot knows and stores, as bytes: its models, its values, its store."""
    models = b"".join(model.memory_matrix.tobytes() for model in agent.models)
    values = b"" if agent.values is None else agent.values.tobytes()
    return {"models": models, "values": values, "store": b"".join(part.tobytes() for part in agent.store)}


class Watched(Course):
    """A set that remembers what its robots knew before they were measured, which fills their stores anew."""

    def afterwards(self, games):
        self.at_the_end = [known(agent) for agent in self.agents]
        return super().afterwards(games)


# What changes in each period: Table 3.1, and for the shooter in B "store and update".
CHANGES = {
    "A": ({"models", "values", "store"}, set()),
    "B": ({"store"}, {"models", "values", "store"}),
    "C": ({"models", "values"}, {"store"}),
    "D": ({"store"}, {"models", "values"}),
}


@pytest.mark.parametrize("reuse", ["mixture", "cold", "copy", "keep"])
def test_what_changes_in_a_period_is_what_table_3_1_says(small_schedule, reuse):
    one = Watched(small_schedule(f"reuse={reuse}", "fixed_epsilon=0.5"), 3)
    for name in "ABCD":
        before = [known(agent) for agent in one.agents]
        assert one.advance() == (name, 60, 60)
        after = one.at_the_end if name == "D" else [known(agent) for agent in one.agents]
        found = tuple({key for key in b if a[key] != b[key]} for a, b in zip(before, after, strict=True))
        kept = {"models"} if reuse == "keep" and name in "CD" else set()
        assert found == tuple(changed - kept for changed in CHANGES[name]), name
        learner = one.agents[0 if name in "AC" else 1]
        if kept:
            assert one.told["models"][-1]["period"] == "B"
        assert (learner.old is not None) == (reuse == "mixture" and name in "CD")
    assert one.is_finished
    assert set(one.told["gathered"]) == {"A", "B"}
    assert [(name, len(found.ends)) for name, found in one.results.items()] == [(name, 60) for name in "ABCD"]


@pytest.mark.slow
def test_in_e_and_f_both_learn_and_f_begins_with_new_models_and_the_old_values(small_schedule):
    changes = ("transfer.trials_e=11", "transfer.trials_f=5", "transfer.camera=analytic", "time_limit_steps=100")
    one = Course(small_schedule(*changes), 3)
    while one.advance()[0] != "D":
        pass
    told, blocks = [known(agent) for agent in one.agents], []
    while not one.is_finished:
        blocks.append(one.advance())
        now = [known(agent) for agent in one.agents]
        if blocks[-1][0] == "E":
            assert [a["models"] == b["models"] for a, b in zip(told, now, strict=True)] == [True, True]
            assert [a["store"] == b["store"] for a, b in zip(told, now, strict=True)] == [False, False]
        else:
            renewed = {row["robot"] for row in one.told["models"] if row["period"] == "F" and not row["kept"]}
            changed = {n for n, a, b in zip(NAMES, told, now, strict=True) if a["models"] != b["models"]}
            assert changed == renewed
    assert blocks == [("E", 10, 11), ("E", 11, 11), ("F", 5, 5)]
    assert all(agent.old is None for agent in one.agents)


def test_a_pass_is_what_the_rules_of_the_world_say_in_both_worlds():
    changes = ["world.rules.pass_window_s=1.0", "world.rules.collision_release_m=0.1"]
    schedule = read_schedule("chapter3/schedule", changes)
    for world in (schedule.world, transfer_world(schedule)):
        scene = pair_scene(schedule, world, new_agents(schedule), (SKILL, SKILL))
        limits = scene.venue.stage.limits
        assert (limits.contact_gap, limits.release_gap, limits.pass_window) == (0.004, 0.1, 30)


def test_with_simultaneous_learning_both_learn_in_as_many_trials(small_schedule):
    one = Course(small_schedule(name="chapter3/simultaneous"), 3)
    while not one.is_finished:
        one.advance()
    assert [period.name for period in PERIODS["simultaneous"]] == list(one.results) == ["S"]
    assert all(agent.values is not None and agent.values.any() for agent in one.agents)
    assert len(one.results["S"].ends) == 240


# ------------------------------------------------------------------------------------------------ which table is kept


def worth(schedule, period, row):
    """Return the mean reward of the robots that learn in a period, in words of 3.5.1: passes, goals, collisions."""
    learners = {"A": "p", "B": "s", "C": "p", "D": "s", "S": "ps"}[period]
    task = {"p": row["passing"] * schedule.pass_reward, "s": row["shooting"] * schedule.goal_reward}
    return sum(task[who] + row["collisions"] * schedule.collision_reward for who in learners)


@pytest.mark.parametrize(("name", "total"), [("chapter3/schedule", 1500), ("chapter3/simultaneous", 4000)])
def test_of_all_late_tables_those_that_did_best_in_the_checks_are_kept(small_schedule, name, total):
    trials = total if name == "chapter3/schedule" else total // 4
    often = [
        f"{who}.learning.{what}" for who in ("passer", "shooter") for what in ("check_every=250", "check_games=20")
    ]
    schedule = small_schedule(f"trials={trials}", "pass_reward=0.7", "time_limit_steps=100", *often, name=name)
    one, worse = Course(schedule, 4), 0
    for period in PERIODS[schedule.periods]:
        one.advance()
        practice, tables = one._practice, {}
        while True:
            tables[practice.at.done] = practice.values_now()
            if practice.is_finished:
                break
            one.advance()
        best, kept = -np.inf, 0
        rows = [row for row in one.told["checks"] if row["period"] == period.name]
        assert [row["trials"] for row in rows] == list(range(250, total + 1, 250))
        for row in rows:
            now, late = worth(schedule, period.name, row), row["trials"] >= 0.3 * total
            assert row["kept"] == int(late and now >= best)
            worse += late and now < best
            best, kept = (now, row["trials"]) if row["kept"] else (best, kept)
        learners = [n for n, duty in enumerate(period.duties) if duty.role == LEARNER]
        for n, values in zip(learners, tables[kept], strict=True):
            assert np.array_equal(one.agents[n].values, values)
    assert worse > 0
    assert one.is_finished


# --------------------------------------------------------------------------------------------- what comes after the end


def test_after_the_schedule_both_robots_do_what_their_tables_value_most(small_schedule):
    # However random they were while they were fixed, and while they learned.
    one = Course(small_schedule("fixed_epsilon=0.5"), 1)
    while not one.is_finished:
        one.advance()
    codes = action_set(one.schedule.world.robot).codes
    for agent, action in zip(one.agents, (3, 5), strict=True):
        agent.values = np.zeros_like(agent.values)
        agent.values[:, action] = 1.0
    found = one.afterwards(20)
    assert len(found.ends) == 20
    for agent, action in zip(one.agents, (3, 5), strict=True):
        rows = int(agent.store.written[0])
        assert rows == found.steps.sum()
        assert (agent.store.inputs[:rows] == codes[action]).all()


def test_what_is_told_after_the_schedule_is_that_of_greedy_trials(small_schedule):
    one = Course(small_schedule(), 1)
    while not one.is_finished:
        one.advance()
    told = one.told["after"]
    found = one.afterwards(20)  # the same trials once more
    assert told["games"] == 20
    assert told["passing"] == np.mean(found.passes > 0)
    assert told["shooting"] == np.mean(found.ends == SUCCESS)
    assert told["collisions"] == np.mean(found.ends == COLLISION)
    assert told["steps"] == np.mean(found.steps)


def test_prediction_errors_are_of_what_was_stored_in_greedy_trials(small_schedule):
    one = Course(small_schedule(), 1)
    while not one.is_finished:
        one.advance()
    told = {(row["robot"], row["object"]): row for row in one.told["errors"]}
    assert {name for name, _ in told} == set(NAMES)
    for agent in one.agents:
        for kind, model in agent.predictors.items():
            parts = [(seen - model.predict(u, seen))[:, CENTRE_Y] for u, seen in stored_by(agent, kind)]
            error = np.concatenate(parts)
            error = error[np.isfinite(error)]
            row = told[agent.name, kind]
            assert row["windows"] == len(error)
            assert row["rms_px"] == pytest.approx(np.sqrt(np.mean(error**2)))
    for row in one.told["exchange"]:
        agent = one.agents[NAMES.index(row["robot"])]
        other = one.agents[1 - agent.number].predictors[row["object"]]
        parts = [(seen - other.predict(u, seen))[:, CENTRE_Y] for u, seen in stored_by(agent, row["object"])]
        error = np.concatenate(parts)
        theirs = np.sqrt(np.nanmean(error**2))
        assert row["error_ratio"] == pytest.approx(theirs / told[row["robot"], row["object"]]["rms_px"])
    assert len(one.told["exchange"]) >= 2


# ------------------------------------------------------------------------------------------------------------- recipes


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ("pasess_rewarded=each", ["unknown setting 'pasess_rewarded'", "Did you mean 'passes_rewarded'?"]),
        ("passes_rewarded=none", ["passes_rewarded", "'first', 'each'", "got 'none'"]),
        ("transfer.supersample=2", ["supersample must be odd", "got 2"]),
        ("passer.also.0.kind=ball", ["'ball' is there twice"]),
        ("shooter.objects.0.needed=true", ["only a skill that is learned by its own recipe can need one"]),
        ("passer.action.min_steps=31", ["min_steps must be at most max_steps"]),
    ],
)
def test_a_wrong_setting_is_named_with_what_was_expected(change, parts):
    with pytest.raises(InputError) as caught:
        read_schedule("chapter3/schedule", [change])
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize("name", recipe_names("schedule"))
def test_each_recipe_can_be_read_and_is_named_as_its_file(name):
    assert f"chapter3/{read_schedule(name).name}" == name
