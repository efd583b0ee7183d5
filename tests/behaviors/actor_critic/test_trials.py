"""Learning by several rewards in trials: what is paid, what is learned of it, and what a recipe may not ask for."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from behaviors.actor_critic.choice import CHOICES, score
from behaviors.learning import Learning, evaluate
from behaviors.recipe import Recipe, plain_recipe, read_recipe
from behaviors.tabular.qlearning import make_learner
from behaviors.tabular.table import make_table
from behaviors.trials import task as tasks
from behaviors.trials.solo import blank_skill, blind_models, criteria_of, solo_scene
from behaviors.trials.task import BUMPED, COLLIDED, FAILURE, GOING, KICKED, STRAY_GOAL, SUCCEEDED, SUCCESS, TOUCHED
from coevo.compiled import entry
from coevo.config import check
from coevo.errors import InputError
from coevo.soccer.events import record_contacts
from coevo.stage import LEARNER

DEFENDED = "chapter5/shoot-defended"
FAR = 1.0


@entry
def judge(task, stage, tally, time):
    body = stage.body
    record_contacts(stage.limits, stage.roles.team, time, body.ball_gap, body.robot_gap, stage.events)
    return tasks.judge(task, stage, tally)


def scene_of(recipe, **settings):  # noqa: ANN003 - of learning
    learning = msgspec.structs.replace(recipe.learning, **settings)
    recipe = msgspec.structs.replace(recipe, learning=learning)
    skill = blank_skill(recipe, blind_models(recipe.objects))
    channels = len(recipe.reward.channels)
    table = make_table(*skill.values.shape, channels=channels)
    return solo_scene(recipe, skill, LEARNER, learner=make_learner(learning), table=table)


def told(*, ball=(4.0, 2.0), steps, recipe=DEFENDED):
    """Return how a trial stands after steps of (gap to the ball, of the other robot to it, between the robots)."""
    scene = scene_of(read_recipe(recipe))
    stage, tally = scene.venue.stage, scene.trial.tally
    stage.body.state[-1, :2], stage.body.state[0, :2], found = ball, (3.0, 2.0), []
    for time, (mine, other, apart) in enumerate(steps):
        stage.body.ball_gap[:], stage.body.robot_gap[:] = (mine, other), apart
        standing = judge(scene.trial.task, stage, tally, time)
        found.append((standing, {event for event in range(tasks.CHANNELS) if tally.rewards[0, event]}))
    return found


def test_contact_is_told_when_it_begins_and_while_it_lasts_and_ends_nothing():
    steps = [(FAR, FAR, 0.0), (0.0, FAR, 0.0), (0.0, FAR, FAR), (FAR, FAR, 0.0), (0.0, FAR, FAR)]
    expected = [{BUMPED, COLLIDED}, {BUMPED, KICKED, TOUCHED}, {TOUCHED}, {BUMPED, COLLIDED}, {KICKED, TOUCHED}]
    assert told(steps=steps) == [(GOING, events) for events in expected]


def test_a_goal_is_of_who_touched_the_ball_last():
    goal = (read_recipe(DEFENDED).world.field.length_m + 0.01, 2.0)
    assert told(ball=goal, steps=[(0.0, FAR, FAR)])[-1] == (SUCCESS, {SUCCEEDED, KICKED, TOUCHED})
    assert told(ball=goal, steps=[(FAR, 0.0, FAR)])[-1] == (STRAY_GOAL, set())
    assert told(ball=goal, steps=[(FAR, FAR, FAR)])[-1] == (STRAY_GOAL, set())
    assert told(ball=(-0.01, 2.0), steps=[(FAR, FAR, FAR)])[-1] == (FAILURE, set())


def paid(how):
    recipe = read_recipe(DEFENDED)
    return msgspec.structs.replace(recipe, reward=msgspec.structs.replace(recipe.reward, paid=how), starts="anywhere")


def test_what_decisions_earn_are_the_events_of_the_trial():
    for how in ("step", "contact", "action"):
        scene, touching = scene_of(paid(how), epsilon_start=1.0), 0
        for seed in range(40):
            found = scene.run(np.array([seed], np.uint64), total=1)
            count = int(scene.trial.minds.decisions.made[0])
            c, s, k = scene.trial.minds.outlook.earned[0, :count].T
            assert s.sum() == (found.ends[0] == SUCCESS)
            if how == "step":
                assert k.sum() == found.kicks[0]
            if how == "contact":
                assert -c.sum() == found.collisions[0]
                assert (k.sum() > 0) == (found.kicks[0] > 0)
            if how == "action":
                assert set(c.tolist()) <= {-1.0, 0.0}
                assert set(k.tolist()) <= {0.0, 1.0}
                assert k.sum() <= found.kicks[0]
            touching += found.kicks[0] > 0
        assert touching > 3


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("update", ["lambda-returns", "one-step"])
def test_the_values_that_are_chosen_by_are_the_scores_of_the_actor(choice, update):
    recipe = read_recipe(DEFENDED)
    scene = scene_of(recipe, choice=choice, update=update)
    scene.run(np.arange(30, dtype=np.uint64), total=30)
    table, scores = scene.minds[0].table, np.zeros(9)
    visited = np.flatnonzero(table.visits.any(axis=1))
    assert len(visited) > 5
    assert np.isfinite(table.actor).all()
    assert table.actor.any(axis=(0, 1)).any()
    for row in visited:
        score(CHOICES.index(choice), table.actor[row], criteria_of(recipe).tolerances, scores)
        assert np.array_equal(table.values[row], scores)


def small(**learning):  # noqa: ANN003 - settings of learning
    recipe = read_recipe(
        "chapter5/shoot-kicking",
        ["trials=750", "experience.windows=1000", "learning.check_every=250", "learning.check_games=20"],
    )
    return msgspec.structs.replace(recipe, learning=msgspec.structs.replace(recipe.learning, **learning))


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_a_learning_that_was_stopped_ends_with_the_same_bytes(storage, tmp_path):
    recipe, files = small(storage=storage), []
    for stops in (False, True):
        learning = Learning(recipe, seed=3, trials=750)
        while not learning.is_finished:
            learning.advance()
            if stops:
                learning.save(tmp_path / "at.npz")
                learning = Learning.load(tmp_path / "at.npz", recipe, seed=3, trials=750)
        files.append((learning.skill().to_bytes(), learning.files()))
    assert files[0] == files[1]
    skill, table = learning.skill(), files[0][1]["frequencies.csv"].decode().splitlines()
    assert table[0].startswith("trial,trials,steps,goals")
    assert len(table) == 4
    rows = skill.values[skill.values.any(axis=1)]
    assert ((rows == rows.max(axis=1, keepdims=True)).sum(axis=1) == 1).all()  # ties are drawn
    assert check(Recipe, plain_recipe(recipe), "it") == recipe


@pytest.mark.slow
def test_several_rewards_teach_to_shoot():
    recipe = read_recipe("chapter5/shoot-kicking", ["trials=6000"])
    learning = Learning(recipe, seed=1, trials=6000)
    while not learning.is_finished:
        learning.advance()
    assert evaluate(recipe, learning.skill(), games=200, seed=7).success_rate > 0.5  # by chance 0.005


S = {"name": "s", "earns": {"goal": 1.0}}
PLAIN = {"name": "mine", "task": "shoot", "objects": [{"kind": "ball"}], "learning": {"method": "actor-critic"}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"reward": {}}, "channels"),
        ({}, "needs [reward]"),
        ({"reward": {"channels": [S, S]}}, "each name once"),
        ({"reward": {"channels": [{"name": "s", "earns": {}}]}}, "no event gives 's' anything"),
        ({"reward": {"channels": [{"name": "s", "earns": {"gaol": 1}}]}}, "Did you mean 'goal'"),
        ({"reward": {"channels": [{**S, "discount": 1.0}]}}, "discount"),
        ({"reward": {"channels": [{"name": "c", "earns": {"collision": -1}}]}}, "'collision', which never happens"),
        ({"reward": {"channels": [S], "matrix": [[1.0]]}}, "unit circle"),
        ({"reward": {"channels": [S], "matrix": [[0.5, 0.1]]}}, "1 rows of 1 numbers"),
        ({"reward": {"channels": [S], "matrix": [[-0.5]]}}, "no real power"),
        ({"reward": {"channels": [S]}, "task": "search", "ends": "goal"}, "settings of the task 'shoot'"),
    ],
)
def test_what_cannot_be_learned_is_refused(changes, said):
    with pytest.raises(InputError) as caught:
        check(Recipe, {**PLAIN, **changes}, "mine.toml")
    assert said in str(caught.value)


def test_a_matrix_whose_eigenvalues_are_complex_is_inside_the_circle_by_its_modulus():
    channels = [S, {"name": "k", "earns": {"kick": 1.0}}]
    turn = [[0.6, -0.5], [0.5, 0.6]]  # modulus 0.78
    recipe = check(Recipe, {**PLAIN, "reward": {"channels": channels, "matrix": turn}}, "it")
    discounts = criteria_of(recipe).discounts
    assert discounts[10] == pytest.approx(np.array(turn))
    assert discounts[3] @ discounts[7] == pytest.approx(np.array(turn))
    grows = [[0.9, -0.5], [0.5, 0.9]]
    with pytest.raises(InputError, match="unit circle"):
        check(Recipe, {**PLAIN, "reward": {"channels": channels, "matrix": grows}}, "it")
