"""Learning by turns: who learns when, what the others play meanwhile, stopping, and the folder of a run."""

from __future__ import annotations

import csv
import dataclasses
import json

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from behaviors.actor_critic.ties import ties_drawn
from behaviors.commands import skills
from behaviors.studies.team import TeamRuns
from behaviors.studies.watching import chapter5_watch
from behaviors.team.course import TeamCourse
from behaviors.team.recipe import mates_of, read_team
from behaviors.team.scene import Member, unlearned
from behaviors.trials.minds import rows_in_order
from behaviors.trials.task import CONCEDED, FAILURE, PASSED, SUCCEEDED, SUCCESS
from behaviors.watching import team_recording
from coevo.errors import InputError
from coevo.seeds import SetStream, generator
from coevo.skill import load_skill
from coevo.skill.bank import MATE, NEAREST
from coevo.skill.estimate import memory_slot
from coevo.soccer.camera import BALL, OPPONENT_GOAL, ROBOTS
from coevo.soundness import check_summary
from coevo.stage import LEARNER, SKILL, STANDING

SLOTS = {"ball": BALL, "opponent_goal": OPPONENT_GOAL, "mate": ROBOTS}
TINY = (
    "trials=300",
    "time_limit_steps=60",
    "games=20",
    "experience.windows=300",
    "learning.check_every=250",
    "learning.check_games=10",
)


def course_of(name="chapter5/shoot-and-pass", *changes, blind=True):
    """Return a course of short turns, of robots that look without knowing what they see: models take a while."""
    recipe = read_team(name, [*TINY, *changes])
    return TeamCourse(recipe, 1, members=unlearned(recipe) if blind else None)


def finish(course):
    while not course.is_finished:
        course.advance()
    return course


def roles(course):
    return course._practice._scene.venue.stage.roles.role.tolist()


def test_one_robot_learns_at_a_time_and_the_others_play_what_they_learned_last():
    course, seen, before = course_of(), [], {}
    for _ in range(4):
        course.advance()  # 250 of 300 trials
        turn, bank = course.turn, course._practice._scene.trial.stage.bank
        seen.append((turn.name, roles(course)))
        (learner,) = course.learners(turn)
        for n, member in enumerate(course.members):
            if member.values is not None:
                policy = bank.policy[bank.first[n] : bank.first[n] + len(member.values)]
                assert np.array_equal(policy, member.values.argmax(axis=1))
        course.advance()
        member = course.members[learner]
        assert member.values.any()
        assert not np.array_equal(member.values, before.get(learner))
        other = course.members[1 - learner]
        assert (other.values is None) == (1 - learner not in before)
        if other.values is not None:
            assert np.array_equal(other.values, before[1 - learner])
        before[learner] = member.values.copy()
    assert seen == [
        ("A", [LEARNER, STANDING]),
        ("B", [SKILL, LEARNER]),
        ("C", [LEARNER, SKILL]),
        ("D", [SKILL, LEARNER]),
    ]
    assert course.is_finished
    assert [len(found.ends) for found in course.results.values()] == [300] * 4


@pytest.mark.parametrize("kept", [0.0, 0.5])
def test_a_robot_that_learns_again_goes_on_with_its_table_and_rates_begin_anew(kept):
    course = course_of("chapter5/shoot-and-pass", f"keep_visits={kept}")
    for _ in range(4):
        course.advance()
    was = course.members[0].table
    course._prepare(None)
    now = course._practice.at.tables[0]
    rows = int(was.used[0])
    assert was.critic.any()
    for name in ("values", "critic", "actor"):
        assert np.array_equal(getattr(now, name)[:rows], getattr(was, name)[:rows])
    assert np.array_equal(now.visits[:rows], (was.visits[:rows] * kept).astype(int))


def test_order_c_lets_r2_learn_twice_and_then_all_learn():
    recipe = course_of("chapter5/three-robots").recipe
    order = [("r0",), ("r2",), ("r1",), ("r2",), ("r0", "r1", "r2")]
    turns = tuple(type(recipe.turns[0])(name=f"t{n}", learners=one) for n, one in enumerate(order))
    recipe = msgspec.structs.replace(recipe, turns=turns, trials=20)
    course, seen = TeamCourse(recipe, 1, members=unlearned(recipe)), []
    while not course.is_finished:
        course._prepare(None)
        seen.append(roles(course))
        course.advance()
    on, off, stands = LEARNER, SKILL, STANDING
    assert seen == [[on, stands, stands], [off, stands, on], [off, on, off], [off, off, on], [on, on, on]]
    assert {row["turn"] for row in course.checks} == {"t0", "t1", "t2", "t3"}  # nothing is better for all of the last
    for n, values in enumerate(member.values for member in course.members):
        table = course.members[n].table
        last = np.zeros_like(values)
        last[table.rows >= 0] = table.values[table.rows[table.rows >= 0]]
        assert np.array_equal(values, ties_drawn(last, generator(1, SetStream.TIES, n)))


def test_frequencies_are_sums_over_blocks_of_what_the_trials_came_to():
    course = finish(course_of("chapter5/three-robots", "trials=260"))
    rows = course.frequencies()
    assert len(rows) == 4 * 2 * 3
    assert [row["trial"] for row in rows[:: 2 * 3]] == [250, 510, 770, 1030]
    for turn, found in course.results.items():
        of = [row for row in rows if row["turn"] == turn]
        assert {row["robot"] for row in of if row["learns"]} == set(
            next(one.learners for one in course.recipe.turns if one.name == turn)
        )
        for robot, side in (("r0", SUCCESS), ("r1", SUCCESS), ("r2", FAILURE)):
            mine = [row for row in of if row["robot"] == robot]
            assert sum(row["trials"] for row in mine) == 260
            assert sum(row["scored"] for row in mine) == (found.ends == side).sum()
            n = course.recipe.names.index(robot)
            assert sum(row["conceded"] for row in mine) == found.counts[:, n, CONCEDED].sum()
            other = FAILURE if side == SUCCESS else SUCCESS
            assert sum(row["conceded"] for row in mine) == (found.ends == other).sum()


@pytest.mark.parametrize("method", ["actor-critic", "q"])
def test_turns_that_were_stopped_end_with_the_same_bytes(method, tmp_path):
    told = []
    for stops in (False, True):
        course = course_of("chapter5/shoot-and-pass", f"learning.method={method}")
        while not course.is_finished:
            course.advance()
            if stops:
                course.save(tmp_path / "at.npz")
                course = TeamCourse.load(tmp_path / "at.npz", course.recipe, 1)
        skills = {name: skill.to_bytes() for name, skill in course.skills().items()}
        told.append((skills, course.frequencies(), course.checks, course.afterwards().steps.tolist()))
    assert told[0] == told[1]
    course.save(tmp_path / "at.npz")
    with pytest.raises(InputError, match="another learning"):
        TeamCourse.load(tmp_path / "at.npz", msgspec.structs.replace(course.recipe, games=21), 1)


class Unwanted(Exception):  # noqa: N818 - as a study leaves a run
    """A study does not want the run any more."""


def test_a_run_of_a_study_goes_on_where_it_was_left_and_is_not_done_twice(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "behaviors.studies.team.TeamCourse",
        _Blind := type("_Blind", (TeamCourse,), {"_new_members": lambda self: unlearned(self.recipe)}),
    )
    recipe, kind = read_team("chapter5/three-robots", [*TINY, "seed=4"]), TeamRuns()
    whole, left = tmp_path / "whole", tmp_path / "left"
    row = kind.run(recipe, whole, [], lambda: None)
    blocks = []

    def leave():
        blocks.append(1)
        if len(blocks) in (2, 5):
            raise Unwanted

    def leave_at_once():
        raise Unwanted

    for _ in range(2):
        with pytest.raises(Unwanted):
            kind.run(recipe, left, [], leave)
        assert not kind.is_whole(left, recipe)
    assert kind.run(recipe, left, [], leave) == row
    files = sorted(path.name for path in whole.iterdir())
    assert {"r0.npz", "r1.npz", "r2.npz", "frequencies.csv", "team.json", "recipe.toml"} <= set(files)
    assert "learning.npz" not in files
    for name in files:
        assert (whole / name).read_bytes() == (left / name).read_bytes()
    for name in ("frequencies.csv", "checks.csv", "r0.npz", "team.json"):
        before = (left / name).read_bytes()
        (left / name).write_bytes(before[:-20] + before[-10:])
        assert "damaged" in {finding.state for finding in check_summary(left / "team.json")}
        with pytest.raises(Unwanted):  # it is learned again
            kind.run(recipe, left, [], leave_at_once)
        (left / "learning.npz").unlink()
        (left / name).write_bytes(before)
    monkeypatch.setattr(_Blind, "advance", lambda _self: pytest.fail("it is done"))
    assert kind.run(recipe, left, [], lambda: None) == row
    assert row["scored_team0"] + row["scored_team1"] <= 1.0
    watch = [str(left), "--games", "2", "--out", str(tmp_path / "team.html"), "--json", "--quiet"]
    said = CliRunner().invoke(chapter5_watch, watch, catch_exceptions=False)
    assert json.loads(said.stdout)["trials"] == [1, 2]
    assert "three-robots, seed 4: r0, r1, r2" in (tmp_path / "team.html").read_text()
    with pytest.raises(InputError, match="holds no robots that learned by turns"):
        CliRunner().invoke(chapter5_watch, [str(tmp_path), *watch[1:]], catch_exceptions=False)
    skill = load_skill(str(left / "r2.npz"))
    assert skill.about["robot"] == "r2"
    said = CliRunner().invoke(skills, ["evaluate", str(left / "r2.npz")])
    assert isinstance(said.exception, InputError)
    assert "among several robots" in str(said.exception)
    with (left / "frequencies.csv").open(encoding="utf-8", newline="") as file:
        last = [one for one in csv.DictReader(file) if one["turn"] == "games" and one["robot"] == "r2"]
    assert row["last_turn_goals_team1"] == sum(int(one["scored"]) for one in last)


AGAIN = ("turns.2.models=again", "turns.3.models=again", "store.steps=2000", "store.least_windows=200")


def test_models_are_made_again_from_what_was_seen_last(tmp_path):
    course = course_of("chapter5/shoot-and-pass", *AGAIN, blind=False)
    plain = course_of("chapter5/shoot-and-pass", blind=False)
    assert plain.members[0].store is None
    before, rows = [], []
    for turn in "ABCD":
        assert course.turn.name == turn
        models = [member.models for member in course.members]
        seen = [np.count_nonzero(rows_in_order(member.store) >= 0) for member in course.members]
        counts = [
            {kind: int((member.store.areas[: seen[n], slot] > 0).sum()) for kind, slot in SLOTS.items()}
            for n, member in enumerate(course.members)
        ]
        course.advance()
        if turn in "AB":
            plain.advance()
            assert all(
                (a.store is None) != (b.store is None) for a, b in zip(plain.members, course.members, strict=True)
            )
        (learner,) = course.learners(course.turn)
        for n, member in enumerate(course.members):
            for old, new in zip(models[n], member.models, strict=True):
                made = any(
                    (row["turn"], row["robot"], row["object"], row["kept"]) == (turn, member.settings.name, old.kind, 0)
                    for row in course.renewed
                )
                assert np.array_equal(old.memory_matrix, new.memory_matrix) != made
                assert made <= (n == learner and turn in "CD")
                assert old.memory_matrix.shape == new.memory_matrix.shape
        for row in course.renewed[len(rows) :]:
            assert row["windows"] == counts[learner][row["object"]]
            assert row["kept"] or row["windows"] >= 200
        rows = list(course.renewed)
        before.append(len(rows))
        course.save(tmp_path / "course.npz")
        course = TeamCourse.load(tmp_path / "course.npz", course.recipe, 1)
        course.save(tmp_path / "again.npz")
        assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "course.npz").read_bytes()
        course.advance()
        if turn in "AB":
            plain.advance()
            values = [member.values for member in (*course.members, *plain.members)]
            assert np.array_equal(values[0], values[2])  # that they store changes nothing
    assert before == [0, 0, 3, 6]
    assert any(not row["kept"] for row in rows)
    with pytest.raises(InputError, match="'A' makes models again, but of r0 nobody has learned before"):
        read_team("chapter5/shoot-and-pass", ["turns.0.models=again"])


def test_the_nearest_robot_is_stored_as_the_largest_of_the_others():
    course = course_of("chapter5/three-robots", "turns.3.models=again", "store.steps=2000")
    for _ in range(4):
        course.advance()
    mates = mates_of(course.recipe)
    assert mates == [1, 0, -1]
    assert [memory_slot(MATE, n, mates) for n in range(3)] == [ROBOTS, ROBOTS, -1]
    for n in (0, 1):
        areas = course.members[n].store.areas
        assert (areas[:, memory_slot(NEAREST, n, mates)] == areas[:, [ROBOTS, ROBOTS + 1]].max(axis=1)).all()
        assert areas.any()


def test_what_is_watched_are_the_games_that_measure_it():
    course = finish(course_of("chapter5/three-robots", "trials=250", "games=40", "time_limit_steps=150"))
    found, skills = course.afterwards(), course.skills()
    watched = TeamCourse(course.recipe, 1, members=unlearned(course.recipe)).watch_afterwards(skills, 12)
    assert [one.ends for one in watched] == found.ends[:12].tolist()
    assert [len(one.trace.skills) for one in watched] == found.steps[:12].tolist()
    assert np.array_equal([one.counts for one in watched], found.counts[:12])
    recording = team_recording(course.recipe, skills, watched, range(12), "mine")
    assert [actor.team for actor in recording.actors] == [0, 0, 1]
    goals = [sum(one.ends == end for one in watched) for end in (SUCCESS, FAILURE)]
    assert recording.score_before()[-1] == tuple(goals)
    for one, take in zip(watched, recording.takes, strict=True):
        assert take.ending.endswith(f", {(passes := int(one.counts[:, PASSED].sum()))} pass{'es' * (passes != 1)}")
        scorers = [name for name, counts in zip(course.recipe.names, one.counts, strict=True) if counts[SUCCEEDED]]
        if scorers:
            assert take.ending.startswith(f"goal of {scorers[0]}")
        assert ("time is up" in take.ending) == (one.ends not in (SUCCESS, FAILURE))


def test_a_turn_without_a_start_is_found_before_anything_is_learned():
    recipe = read_team("chapter5/shoot-and-pass", list(TINY))
    same = msgspec.structs.replace(recipe.ball, x_m=(1.0, 1.0), y_m=(1.0, 1.0))
    robots = tuple(msgspec.structs.replace(one, start=same) for one in recipe.robots)
    with pytest.raises(InputError, match="no start was found"):
        TeamCourse(msgspec.structs.replace(recipe, robots=robots, ball=same), 1)


def test_a_robot_with_too_many_states_is_told():
    recipe = read_team("chapter5/shoot-and-pass", list(TINY))
    (member, *_) = unlearned(recipe)
    model = member.models[0]
    wide = dataclasses.replace(model, memory_matrix=np.zeros((8, model.memory_matrix.shape[1])))
    with pytest.raises(InputError, match="r0 has 6563 x"):
        Member(member.settings, (wide,) * 3).skill(recipe)


@pytest.mark.slow
def test_a_robot_learns_to_shoot_while_its_mate_stands():
    recipe = read_team("chapter5/shoot-and-pass", ["trials=3000", "games=300"])
    course = finish(TeamCourse(msgspec.structs.replace(recipe, turns=recipe.turns[:1]), 1))
    assert (course.afterwards().ends == SUCCESS).mean() > 0.06  # by chance 0.005
    rows = [row for row in course.frequencies() if row["robot"] == "r0"]
    assert sum(row["goals"] for row in rows[-4:]) > 100
