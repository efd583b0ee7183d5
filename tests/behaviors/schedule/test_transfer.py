"""Periods E and F: the loop in Python against the compiled one, and what makes the other world another one."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy import stats

from behaviors.schedule import course, transfer
from behaviors.schedule.course import Course
from behaviors.schedule.models import stored_windows
from behaviors.schedule.recipe import TransferSettings, transfer_world
from behaviors.schedule.transfer import Eyes, run_elsewhere
from behaviors.trials.kernels import act
from behaviors.trials.scene import no_results
from behaviors.trials.task import GOING, PASSER, SHOOTER
from coevo.compiled import entry
from coevo.seeds import game_seeds
from coevo.skill import estimate
from coevo.soccer.camera import camera_params, make_retina, object_count, see
from coevo.soccer.physics import replay
from coevo.soccer.vision import extract, render
from coevo.stage import LEARNER, RANDOM, SKILL

SAME = TransferSettings(camera="analytic", latency_steps=0)
# What the recipe says of the other world, as numbers: [tilt, rolling drag, walls, noise of the actuators].
TILT_DEG, ROLLING_MPS2, WALLS, ACTUATORS = -24.0, 0.45, 0.6, 0.1


def test_the_other_world_is_the_compiled_one_if_it_is_the_same_world(pair):
    found = []
    for elsewhere in (False, True):
        one = pair(roles=(LEARNER, LEARNER), stores=(True, True))
        if elsewhere:
            seeds = game_seeds(1, 5, count=6)
            outcomes = run_elsewhere(one.scene, one.schedule.world, SAME, seeds, first=0, total=6)
        else:
            outcomes = one.run((5,), 6, total=6)
        parts = [*outcomes]
        for agent, mind in zip(one.agents, one.scene.minds, strict=True):
            store = agent.store._replace(features=agent.store.features[agent.store.areas > 0.0])
            parts += [mind.table.values, mind.table.visits, *store]
        found.append([part.tobytes() for part in parts])
    assert found[0] == found[1]


def test_latency_shows_what_was_there_some_steps_ago(pair):
    seen = []
    for latency in (0, 3):
        one = pair("time_limit_steps=60", roles=(RANDOM, RANDOM), stores=(True, True))
        settings = msgspec.structs.replace(SAME, latency_steps=latency)
        run_elsewhere(one.scene, one.schedule.world, settings, np.array([11], np.uint64))
        rows = int(one.agents[SHOOTER].store.written[0])
        seen.append(one.agents[SHOOTER].store.areas[:rows])
    assert len(seen[0]) == len(seen[1]) > 20
    assert np.array_equal(seen[1][3:, :3], seen[0][:-3, :3])
    assert not np.array_equal(seen[1], seen[0])


def test_painted_images_are_enough_to_act_on(pair):
    one = pair("time_limit_steps=60", roles=(LEARNER, LEARNER), stores=(True, True))
    found = run_elsewhere(one.scene, one.schedule.world, TransferSettings(), np.array([1, 2], np.uint64))
    assert (found.steps > 0).all()
    assert min(stored_windows(one.agents[PASSER]).values()) > 0


# --------------------------------------------------------------------------------------------------------- image noise


def looks(one, noise, count=30):
    """Return what the shooter sees of the ball (count, 4) where nothing moves."""
    settings = TransferSettings(noise_grey=noise, latency_steps=0)
    eyes, stage = Eyes(one.scene, one.schedule.world, settings, np.uint64(3)), one.scene.venue.stage
    stage.body.state[:] = 0.0
    stage.body.state[:, :2] = (1.0, 1.0), (4.0, 2.3), (5.2, 2.4)
    found = np.zeros((count, 4))
    for row in found:
        eyes.look(np.zeros(1, np.uint64))
        assert stage.memory.areas[SHOOTER, 0] > 0.0
        row[:] = stage.memory.features[SHOOTER, 0, :4]
    return found


def test_noise_of_the_image_makes_what_is_seen_of_a_still_ball_waver(pair):
    one = pair()
    still, mild, noisy, noisier = (looks(one, noise) for noise in (0.0, 8.0, 40.0, 60.0))
    assert not np.ptp(still, axis=0).any()
    assert np.array_equal(mild, still)  # the regions of colour swallow it
    assert 0.0 < noisy[:, 0].std() < noisier[:, 0].std()
    assert np.ptp(noisy[:, 3]) >= 1.0


@pytest.fixture
def elsewhere(small_schedule):
    """Return a function that makes a set which has just begun period E, or F, of 11 trials."""

    def begun(*changes, period="E"):
        changes = ("transfer.trials_e=11", "transfer.trials_f=11", "time_limit_steps=40", *changes)
        set_ = Course(small_schedule(*changes), 1)
        while set_.advance()[0] != period:
            pass
        return set_

    return begun


def test_images_of_e_and_f_are_painted_in_the_other_world_with_the_recipes_noise(elsewhere, monkeypatch):
    painted = []

    def spy(world, state, robot, *, supersample, noise, rng):
        image = render(world, state, robot, supersample=supersample, noise=noise, rng=rng)
        clean = render(world, state, robot, supersample=supersample, noise=0.0, rng=rng)
        painted.append((world, image.astype(float) - clean, clean))
        return image

    monkeypatch.setattr(transfer, "render", spy)
    for period in "EF":
        painted.clear()
        elsewhere("transfer.trials_e=1", "transfer.trials_f=1", "time_limit_steps=20", period=period)
        assert len(painted) >= 2 * 20
        for world, _, _ in painted:
            assert world.camera.tilt_deg == TILT_DEG
        # Where it is neither cut off at black nor at white.
        grey = np.concatenate([noise[(clean > 60) & (clean < 195)] for _, noise, clean in painted])
        assert len(grey) > 10_000
        assert abs(grey.std() - 8.0) < 0.1


# ----------------------------------------------------------------------------------------------- physics and the camera


def stage_of(set_):
    """Return the stage that the trials of the period under way are played on."""
    return set_._practice._scene.venue.stage


def rolled(stage, start, velocity, steps):
    """Return (steps, 6) states of a ball that rolls, both robots standing in a corner."""
    state, states = np.zeros((3, 6)), np.zeros((steps, 3, 6))
    state[:2, :2] = (0.5, 0.5), (0.5, 1.2)
    state[2, :2], state[2, 3:5] = start, velocity
    replay(stage.handles, stage.physics, state, np.zeros((steps, 2, 2)), states)
    return states[:, 2]


@pytest.mark.parametrize("period", ["E", "F"])
def test_in_e_and_f_the_ball_rolls_and_bounces_as_on_the_other_field(elsewhere, period):
    set_ = elsewhere("transfer.camera=analytic", period=period)
    stage, usual = stage_of(set_), set_._scene((SKILL, SKILL)).venue.stage
    for one, slowing, walls in ((stage, ROLLING_MPS2, WALLS), (usual, 0.3, 0.8)):
        rolling = rolled(one, (3.0, 2.0), (1.5, 0.0), 30)
        assert rolling[-1, 3] == pytest.approx(1.5 - slowing, abs=1e-9)  # after a second
        bounced = rolled(one, (5.0, 4.0), (0.0, 1.5), 30)[:, 4]
        k = int(np.flatnonzero(bounced < 0.0)[0])
        ratio = -bounced[k] / bounced[k - 1]
        assert ratio == pytest.approx(
            0.6 * walls, abs=0.03
        )  # the ball's elasticity times the walls', less a step's drag


@pytest.mark.parametrize("period", ["E", "F"])
def test_in_e_and_f_the_actuators_are_noisy(elsewhere, period):
    set_ = elsewhere("transfer.camera=analytic", period=period)
    scene, told, asked = set_._practice._scene, [], []
    stage = scene.venue.stage
    for seed in range(300):
        act(scene.trial, 0, np.array([seed], np.uint64))
        told += stage.body.commands.tolist()
        asked += stage.drive.commands[stage.doing.action].tolist()
    told, asked = np.array(told), np.array(asked)
    driven = asked != 0.0
    assert driven.sum() > 300
    assert stats.kstest((told[driven] / asked[driven] - 1.0) / ACTUATORS, "norm").pvalue > 0.001
    assert not told[~driven].any()


@pytest.mark.parametrize("camera", ["opencv", "analytic"])
def test_what_is_stored_in_e_was_seen_through_the_camera_of_the_other_world(elsewhere, monkeypatch, camera):
    states = []

    def watched(trial, time, rng):
        states.append(trial.stage.body.state.copy())
        act(trial, time, rng)

    monkeypatch.setattr(transfer, "act", watched)
    changes = (f"transfer.camera={camera}", "transfer.latency_steps=0", "transfer.noise_grey=0")
    set_ = elsewhere(*changes, "transfer.trials_e=1", "transfer.trials_f=0", "time_limit_steps=20")
    world = set_.schedule.world
    tilted = msgspec.structs.replace(world, camera=msgspec.structs.replace(world.camera, tilt_deg=TILT_DEG))
    agreed = 0
    for agent in set_.agents:
        rows = int(agent.store.written[0])
        for row, state in zip(range(rows), states[1:], strict=False):  # what is seen at a time, from the first step on
            if camera == "opencv":
                settings = set_.schedule.transfer
                image = render(tilted, state, agent.number, supersample=settings.supersample)
                areas = extract(image, tilted, 2, agent.number, 0, min_region_px=settings.min_region_px)[1]
            else:
                areas = np.zeros(object_count(2))
                features = np.zeros((len(areas), 11))
                see(camera_params(tilted), state, agent.number, 0, make_retina(tilted), features, areas)
            assert np.array_equal(agent.store.areas[row, : len(areas)], areas)
            agreed += areas.any()
    assert agreed > 20


def test_the_other_world_differs_in_what_the_recipe_says_and_in_nothing_else(small_schedule):
    schedule = small_schedule()
    here, there = (msgspec.to_builtins(world) for world in (schedule.world, transfer_world(schedule)))
    changed = {(part, key) for part in here for key in here[part] if here[part][key] != there[part][key]}
    expected = {
        ("camera", "tilt_deg"): TILT_DEG,
        ("ball", "rolling_deceleration_mps2"): ROLLING_MPS2,
        ("field", "wall_elasticity"): WALLS,
        ("robot", "actuator_noise"): ACTUATORS,
    }
    assert changed == set(expected)
    assert {(part, key): there[part][key] for part, key in changed} == expected


# ------------------------------------------------------------------------------------------------- learning elsewhere


@entry
def discrete_state(stage, robot, time):
    """Call from Python what only compiled code can call."""
    return estimate.discrete_state(stage.memory, stage.bank, stage.roles.skill[robot], robot, time)


class Beside:
    """Runs trials elsewhere one by one, and lets a plain learner learn of each, from the same values on."""

    def __init__(self, update, alpha) -> None:
        self.update, self.alpha = update, alpha
        self.values, self.visits = [], []

    def begin(self, agents):
        self.values = [agent.values.astype(np.float64).tolist() for agent in agents]
        self.visits = [[[0] * len(row) for row in values] for values in self.values]

    def run(self, scene, world, there, seeds, *, first, total):
        results = no_results(len(seeds))
        for n, seed in enumerate(seeds):
            found = run_elsewhere(scene, world, there, np.array([seed]), first=first + n, total=total)
            for column, one in zip(results, found, strict=True):
                column[n] = one[0]
            self.learn(scene, int(found.ends[0]), int(found.steps[0]))
        return results

    def learn(self, scene, end, steps):
        for robot, mind in enumerate(scene.minds):
            made = scene.trial.minds.decisions
            columns = (made.rows, made.actions, made.rewards, made.lengths)
            told = list(zip(*(column[robot, : made.made[robot]].tolist() for column in columns), strict=True))
            last = -1
            if end == GOING:
                last = int(mind.table.rows[discrete_state(scene.venue.stage, robot, steps)])
            rule = mind.learner._replace(alpha=self.alpha, alpha_visits=0.0)
            self.update(rule, self.values[robot], self.visits[robot], told, last)


@pytest.mark.parametrize("alpha", [0.01, 0.1])
def test_in_e_and_f_tables_are_learned_with_the_recipes_constant_rate(small_schedule, plain_update, monkeypatch, alpha):
    changes = ["transfer.trials_e=9", "transfer.trials_f=8", "transfer.camera=analytic", "time_limit_steps=60"]
    schedule = small_schedule(*changes, *([] if alpha == 0.01 else [f"transfer.alpha={alpha}"]))  # 0.01 is the recipe's
    beside, set_ = Beside(plain_update, alpha), Course(schedule, 1)
    monkeypatch.setattr(course, "run_elsewhere", beside.run)
    while set_.advance()[0] != "D":
        pass
    for agent in set_.agents:  # after so few trials most values are zero, and would stay so
        agent.values = np.random.default_rng(agent.number).uniform(0.0, 1.0, agent.values.shape).astype(np.float32)
    for period in "EF":
        before = [agent.values for agent in set_.agents]
        beside.begin(set_.agents)
        assert set_.advance()[0] == period
        for agent, values, began in zip(set_.agents, beside.values, before, strict=True):
            np.testing.assert_allclose(agent.values, values, rtol=1e-6, atol=1e-9)
            assert 5 < (agent.values != began).sum() < 500
    assert set_.is_finished
