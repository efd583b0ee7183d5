"""Skills know the world that they were learned for."""

from __future__ import annotations

import dataclasses
import re

import pytest

from coevo.config import WorldSettings, check, override
from coevo.errors import InputError
from coevo.game import load_bank
from coevo.skill import check_world, installed_skills, load_skill


def world(*assignments):
    return check(WorldSettings, override({}, assignments), "world")


# Every setting that decides what is seen and done, and a value that is not the presets'.
DECIDES = {
    "camera.width_px": 128,
    "camera.height_px": 48,
    "camera.horizontal_view_deg": 60.0,
    "camera.vertical_view_deg": 50.0,
    "camera.tilt_deg": -20.0,
    "camera.height_m": 0.5,
    "robot.radius_m": 0.25,
    "robot.height_m": 0.6,
    "robot.max_speed_mps": 2.5,
    "robot.max_turn_rate_dps": 90.0,
    "robot.max_acceleration_mps2": 2.0,
    "robot.max_turn_acceleration_dps2": 1000.0,
    "ball.radius_m": 0.2,
    "physics.step_s": 0.02,
}
STANDS = {
    "camera.noise_px": 1.0,
    "robot.actuator_noise": 0.1,
    "robot.mass_kg": 12.0,
    "ball.mass_kg": 0.5,
    "field.length_m": 9.0,
    "field.goal_width_m": 1.0,
    "robot.wheelbase_m": 0.5,  # of the other drive
    "robot.max_steering_deg": 20.0,
}


@pytest.mark.parametrize("name", installed_skills())
def test_installed_skills_are_at_home_in_the_presets(name):
    check_world(load_skill(name), WorldSettings(), name)


@pytest.mark.parametrize("setting", DECIDES)
def test_another_world_is_refused_with_both_values_and_the_remedy(setting):
    here = world(f"{setting}={DECIDES[setting]}")
    part, name = setting.split(".")
    was = getattr(getattr(WorldSettings(), part), name)
    with pytest.raises(InputError) as caught:
        check_world(load_skill("shoot"), here, "strike")
    message = str(caught.value)
    assert message.startswith("skills.strike: 'shoot' was learned for a world with ")
    assert f"{setting} {was}, here it is {DECIDES[setting]}" in message
    assert f"with world.{setting} = {DECIDES[setting]}" in message
    assert 'skills_elsewhere = "allow"' in message


@pytest.mark.parametrize("setting", STANDS)
def test_what_a_skill_has_to_stand_is_not_compared(setting):
    check_world(load_skill("shoot"), world(f"{setting}={STANDS[setting]}"), "shoot")


@pytest.mark.parametrize("about", [{}, {"recipe": {}}, {"recipe": {"world": {}}}, {"recipe": "lost"}])
def test_a_skill_that_does_not_tell_its_world_is_taken(about):
    skill = dataclasses.replace(load_skill("search"), about=about)
    check_world(skill, world("camera.width_px=128"), "search")


def test_games_refuse_skills_of_another_world_unless_they_are_allowed(small_settings):
    with pytest.raises(
        InputError, match=re.escape("skills.shoot: 'shoot' was learned for a world with camera.width_px 64")
    ):
        load_bank(small_settings("world.camera.width_px=128"))
    allowed = load_bank(small_settings("world.camera.width_px=128", "skills_elsewhere=allow"))
    assert len(allowed.models) == 4


def test_the_bank_holds_the_terminals_in_their_order(small_settings):
    settings = small_settings("skills.strike=shoot", "skills.pass=''", "skills.find=search")
    assert list(settings.terminals) == ["shoot", "avoid", "search", "strike", "find"]
    bank = load_bank(settings)
    sizes = [load_skill(name).values.shape[0] for name in ("shoot", "avoid", "search", "shoot", "search")]
    assert bank.first.tolist() == [sum(sizes[:n]) for n in range(5)]
