"""Trials that are watched are those that are measured, step for step, and taping changes nothing."""

from __future__ import annotations

import dataclasses
import json
import re

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from behaviors.cards import measure
from behaviors.commands import learn, skills
from behaviors.learning import evaluate, watch
from behaviors.recipe import Recipe, read_recipe
from behaviors.settings import LearningSettings, MoverSettings
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials.kernels import run_trials
from behaviors.trials.scene import no_results
from behaviors.trials.solo import provisional_skill, solo_scene
from behaviors.watching import skill_recording
from coevo.config import check
from coevo.errors import InputError
from coevo.replay import make_page, trace_digest
from coevo.skill import load_skill
from coevo.soccer.drive import action_set
from coevo.soccer.physics import physics_params, replay
from coevo.soccer.sight import label_images
from coevo.soccer.world import World
from coevo.stage import LEARNER
from coevo.stage.tape import blank_tape

NAMES = ("shoot", "pass", "avoid", "search")


@pytest.mark.parametrize("name", NAMES)
def test_watched_trials_are_those_that_are_measured(name):
    recipe, skill = read_recipe(name), load_skill(name)
    watched = watch(recipe, skill, games=12, seed=7)
    found = evaluate(recipe, skill, games=12, seed=7)
    assert [one.ends for one in watched] == found.outcomes.tolist()
    assert [len(one.trace.skills) for one in watched] == found.steps.tolist()
    more = evaluate(recipe, skill, games=30, seed=7)  # a trial depends on its number alone
    assert found.outcomes.tolist() == more.outcomes[:12].tolist()


def test_recorded_states_follow_from_recorded_actions():
    """The physics alone, told the recorded actions, goes through the recorded states bit by bit."""
    recipe, skill = read_recipe("shoot"), load_skill("shoot")
    (one,) = watch(recipe, skill, games=1, seed=3)
    robots = one.trace.skills.shape[1]
    assert robots == 1
    mover = World(recipe.world, robots)
    commands = action_set(recipe.world.robot).commands[one.trace.actions]
    states = np.empty((len(commands), *one.trace.states.shape[1:]))
    replay(mover.handles, physics_params(recipe.world), one.trace.states[0].copy(), commands, states)
    assert states.tobytes() == one.trace.states[1:].tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_the_perceived_state_says_of_each_object_whether_it_is_lost(name):
    """The last states of an object are for "not visible": they are perceived where the image does not show it."""
    recipe, skill = read_recipe(name), load_skill(name)
    things = {"ball": [0], "own_goal": [1], "opponent_goal": [2], "mate": [3], "robot": [3]}
    lost = visible = 0
    for one in watch(recipe, skill, games=6, seed=5):
        images = label_images(recipe.world, one.trace.states[:-1], 0, 0)
        states = one.trace.perceived[:, 0].astype(np.int64)
        for model in reversed(skill.objects):
            states, cell = np.divmod(states, model.states)
            seen = np.isin(images, [1 + thing for thing in things[model.kind]]).any(axis=(1, 2))
            assert ((cell < 3**model.order) == seen).all()
            visible, lost = visible + seen.sum(), lost + (~seen).sum()
        assert not states.any()
        assert (one.trace.skills[:, 0] == 0).all()
        assert (one.trace.leaves == -1).all()
        assert (one.trace.skills[:, 1:] == -1).all()
    assert lost > 20
    assert (visible > 20) == (name != "search")  # which ends when the ball is found


def test_actions_are_those_of_the_policy_where_they_begin():
    recipe, skill = read_recipe("search"), load_skill("search")
    for one in watch(recipe, skill, games=10, seed=2):
        actions, states = one.trace.actions[:, 0], one.trace.perceived[:, 0]
        begins = np.flatnonzero(np.diff(actions, prepend=-1))
        assert (actions[begins] == skill.policy[states[begins]]).all()


@pytest.mark.parametrize("name", ["shoot", "avoid"])
def test_a_tape_changes_nothing_that_is_learned(name):
    recipe = msgspec.structs.replace(read_recipe(name), time_limit_steps=120)
    skill, seeds = load_skill(name), np.arange(12, dtype=np.uint64)
    tables = []
    for taped in (False, True):
        scene = solo_scene(
            recipe, skill, LEARNER, learner=make_learner(LearningSettings()), table=make_table(len(skill.values), 9)
        )
        trial = scene.trial
        if taped:
            trial = trial._replace(tape=blank_tape(len(scene.minds), scene.time_limit))
        assert run_trials(trial, scene.time_limit, 0, 12, seeds, no_results(12)) == 12
        tables.append(scene.minds[0].table)
    assert tables[0].visits.any()
    for one, two in zip(*tables, strict=True):
        assert one.tobytes() == two.tobytes()


# ---------------------------------------------------------------------------------------------------- what is shown


def test_a_recording_tells_what_a_card_counts():
    recipe, skill = read_recipe("avoid"), load_skill("avoid")
    recipe = msgspec.structs.replace(recipe, mover=MoverSettings(kind="chaser"))  # a card has another
    recording = skill_recording(recipe, skill, games=20, seed=7, starts="in-view")
    card = measure(recipe, skill, games=20, seed=7, starts="in-view")
    assert sum(take.point == 0 for take in recording.takes) == round(20 * card["success_rate"])
    assert recording.score_before()[-1] == (
        sum(t.point == 0 for t in recording.takes),
        sum(t.point for t in recording.takes),
    )
    assert {take.idle[1] for take in recording.takes} == {"drives at random"}
    assert [actor.sees for actor in recording.actors] == [True, False]
    endings = {(take.point, take.ending) for take in recording.takes}
    assert endings <= {(0, "time is up, and no collision"), (1, "collision")}


@pytest.mark.parametrize("attacker", ["shoot", "home"])
def test_a_robot_that_plays_a_skill_is_shown_with_it(attacker, tmp_path):
    """The other robot of a defender plays a skill, which may have the name of the one that is watched."""
    goal = {"kind": "own_goal", "history_length": 1, "order": 1}
    played = tmp_path / f"{attacker}.npz"
    dataclasses.replace(load_skill("shoot"), name=attacker).save(played)
    plain = {"name": "home", "task": "defend", "objects": [goal], "mover": {"kind": "skill", "skill": str(played)}}
    recipe = check(Recipe, {**plain, "time_limit_steps": 120}, "mine")  # too short for some
    skill = provisional_skill(recipe)
    recording = skill_recording(recipe, skill, games=30, seed=2, starts="in-view")
    assert list(recording.skills) == ["home", f"{attacker} of r1"]
    assert [model.kind for model in recording.skills[f"{attacker} of r1"]] == ["ball", "opponent_goal"]
    assert [(actor.team, actor.sees) for actor in recording.actors] == [(0, True), (1, True)]
    endings = {(take.point, take.ending) for take in recording.takes}
    assert endings <= {(0, "time is up, and no goal"), (0, "goal on the other side"), (1, "goal against it")}
    assert len(endings) >= 2
    conceded = sum(take.trace.states[-1, -1, 0] < 0.0 for take in recording.takes)
    assert 0 < conceded == recording.score_before()[-1][1]
    shoot = load_skill("shoot").policy
    for take in recording.takes:
        actions, states = take.trace.actions[:, 1], take.trace.perceived[:, 1]
        begins = np.flatnonzero(np.diff(actions, prepend=-1))
        assert (actions[begins] == shoot[states[begins]]).all()
        assert (take.trace.skills == [0, 1]).all()
    make_page(recording)


def test_a_page_of_a_skill_tells_in_words_what_it_sees_and_does(open_page, tmp_path):
    recipe, skill = read_recipe("shoot"), load_skill("shoot")
    recording = skill_recording(recipe, skill, games=2, seed=7, starts="in-view")
    (tmp_path / "shoot.html").write_text(make_page(recording), encoding="utf-8")
    trace = recording.takes[1].trace
    opened = open_page(tmp_path / "shoot.html", "#game=2&step=0")
    words = [name for name, _ in _action_words()]
    for step in range(0, len(trace.skills), 25):
        opened.page.evaluate("step => go(step)", step)
        told = opened.page.locator(".mind p").text_content()
        state = int(trace.perceived[step, 0])
        parts = []
        for model in reversed(skill.objects):
            state, cell = divmod(state, model.states)
            signs = "".join("−0+"[cell // 3**k % 3] for k in range(model.order))  # noqa: RUF001 - a minus sign
            lost = ("lost (left)", "lost (right)")[cell - 3**model.order] if cell >= 3**model.order else ""
            parts.insert(0, f"{model.kind.replace('_', ' ')} {lost or signs}")
        assert told == f"shoot sees {'; '.join(parts)}"
        assert opened.page.locator(".now").inner_text().strip() == words[trace.actions[step, 0]]
    assert opened.complaints == opened.requests == []


def _action_words():
    turns, speeds = ("right", "", "left"), ("back", "turn", "ahead")
    names = [(f"{speed} {turn}".strip(), None) for speed in speeds for turn in turns]
    names[4] = ("stand", None)
    return names


def run(command, *arguments):
    return CliRunner().invoke(command, list(map(str, arguments)))


def page_of(path):
    found = re.search(r'type="application/json">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)
    return json.loads(found[1])


def test_the_command_writes_what_it_says(tmp_path):
    said = run(skills, "watch", "search", "--games", 3, "--seed", 9, "--out", tmp_path / "s.html", "--json", "--quiet")
    told = json.loads(said.stdout)
    recipe, skill = read_recipe("search"), load_skill("search")
    measured = evaluate(recipe, skill, games=3, seed=9)
    assert told == {
        "name": "search",
        "starts": "in-view",
        "games": 3,
        "succeeded": int(measured.success.sum()),
        "written": str(tmp_path / "s.html"),
    }
    data = page_of(tmp_path / "s.html")
    assert [game["steps"] for game in data["games"]] == measured.steps.tolist()
    assert (data["kind"], data["shows"]) == ("trial", "actions")
    assert [game["title"] for game in data["games"]] == [f"trial {n} of 3" for n in (1, 2, 3)]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["shot"], "Did you mean 'shoot'"),
        (["shoot", "--out", "shoot.avi"], "ending in .mp4, .gif, .html, got shoot.avi"),
        (["shoot", "--out", "nowhere/shoot.html"], "there is no folder nowhere; make it first"),
    ],
)
def test_the_command_refuses_in_words(arguments, said):
    result = run(skills, "watch", *arguments)
    assert isinstance(result.exception, InputError)
    assert said in str(result.exception)


def test_what_was_learned_is_filmed_and_is_that_of_its_card(tmp_path):
    folder, video = tmp_path / "skill", tmp_path / "search.html"
    said = run(learn, "search", "--trials", 300, "--games", 20, "--out", folder, "--video", video, "--quiet")
    assert said.exit_code == 0, said.output
    data = page_of(video)
    skill, card = load_skill(folder / "skill.npz"), json.loads((folder / "card.json").read_text(encoding="utf-8"))
    seed = card["measured"]["in-view"]["seed"]
    found = evaluate(read_recipe("search"), skill, games=5, seed=seed)
    assert [game["steps"] for game in data["games"]] == found.steps.tolist()
    assert str(video) in said.stdout
    late = run(learn, "search", "--out", tmp_path / "other", "--video", tmp_path / "x.avi")
    assert "ending in .mp4" in str(late.exception)
    assert not (tmp_path / "other").exists()  # told before anything is learned


def test_the_same_trials_have_the_same_digest():
    recipe, skill = read_recipe("pass"), load_skill("pass")
    one, two = ([w.trace for w in watch(recipe, skill, games=4, seed=1)] for _ in range(2))
    assert trace_digest(one) == trace_digest(two)
    assert trace_digest(one) != trace_digest([w.trace for w in watch(recipe, skill, games=4, seed=2)])
