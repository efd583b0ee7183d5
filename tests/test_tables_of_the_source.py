"""Every number that a source gives, as the source prints it: what the presets really play with must be that.

Numbers stand in the source's own units and quantities (a circumference, tables, thirds, per cent), and nothing here is
derived from the settings.
"""

from __future__ import annotations

import math

import msgspec
import pytest

from coevo.config import RunSettings, check

# The experiments of section 6.4 with the dissertation's own conditions.
EXPERIMENTS = tuple(
    f"chapter6/dissertation-{name}" for name in ("two-learners", "stationary-opponent", "three-learners")
)
PRESETS = ("two-learners", "stationary-opponent", "three-learners", "smoke", *EXPERIMENTS)

# RoboCup, "The Regulations for Full Set Small Size Robot League", 30 September 1997: three times the length and the
# width of the small league's field, which is a table for table tennis. The dissertation (3.5.1, 6.3.1) plays on the
# field of the middle-size league, of the same size.
TABLE_TENNIS_MM = (2740, 1525)  # the laws of table tennis, 2.1.1
RULES_MM = {"length": 8220, "width": 4575, "goal width": 1500, "goal height": 500, "corner panel": 200}
# What FIFA asks of a football of size 4: circumference and mass.
SIZE_4_CM, SIZE_4_G = (63.5, 66.0), (350, 390)

# Section 3.5.2: "the size of an image is reduced to 64 x 60 pixels"; 3.5.3: view 67 x 60 degrees, tilt -26 degrees.
IMAGE_PX, VIEW_DEG, TILT_DEG = (64, 60), (67, 60), -26
VIDEO_HZ = 30  # NTSC, section 3.5.3

# Table 6.1 has small, medium and large but no limits: terciles of the areas in random play, as they were when the
# limits were set. How near they still are is measured in tests/analysis/calibration/test_categories.py.
TERCILES_PX = {"ball": (19, 60), "goal": (36, 79), "robot": (24, 66)}

# Table 6.2; h(K, beta) counts steps of contact.
TABLE_6_2 = {
    "fixed": {"alpha_g": 1.0, "alpha_l": 0.5, "alpha_k": 1e-3, "alpha_c": 5e-3, "alpha_s": 1e-4, "beta": 4000},
    "varying": {"alpha_g": 1.0, "alpha_l": 1.0, "alpha_k": 1e-2, "alpha_c": 1e-2, "alpha_s": 1e-2, "beta": 4000},
}
# Table 6.3 and 6.3.4. The crossover probability is lost in print: what reproduction and mutation leave.
TABLE_6_3 = {
    "population": 80,
    "creation_depth_max": 10,
    "crossover_depth_max": 25,
    "tournament": 10,
    "elite": 1,  # "the best performing tree in the current generation will survive"
}
TABLE_6_3_PERCENT = {"crossover": 100 - 5 - 10, "reproduction": 5, "mutation": 10}
GAMES, GAMES_A_GENERATION = 20, 1600  # 6.3.4
# Tables 6.4 to 6.6 print the depths of the best trees; the deepest is that of r0 in 6.4.
DEEPEST_BEST_TREE = 30


@pytest.fixture(params=PRESETS)
def preset(request, recipe):
    """Return each preset with every setting resolved."""
    return check(RunSettings, recipe(request.param), request.param)


@pytest.fixture(params=EXPERIMENTS)
def experiment(request, recipe):
    """Return each preset of section 6.4 with every setting resolved."""
    return check(RunSettings, recipe(request.param), request.param)


def test_the_field_is_that_of_the_rules_of_1997(preset):
    field = preset.world.field
    found = {
        "length": field.length_m,
        "width": field.width_m,
        "goal width": field.goal_width_m,
        "goal height": field.goal_height_m,
        "corner panel": field.corner_panel_m,
    }
    assert {name: 1000.0 * size for name, size in found.items()} == pytest.approx(RULES_MM)
    assert (RULES_MM["length"], RULES_MM["width"]) == tuple(3 * side for side in TABLE_TENNIS_MM)
    assert field.corner_panels


def test_the_ball_is_a_football_of_size_4(preset):
    ball = preset.world.ball
    assert SIZE_4_CM[0] <= 100.0 * 2.0 * math.pi * ball.radius_m <= SIZE_4_CM[1]
    assert SIZE_4_G[0] <= 1000.0 * ball.mass_kg <= SIZE_4_G[1]
    assert 1000.0 * ball.mass_kg == pytest.approx(sum(SIZE_4_G) / 2)


def test_the_camera_and_the_step_are_those_of_section_3_5(preset):
    camera = preset.world.camera
    assert (camera.width_px, camera.height_px) == IMAGE_PX
    assert (camera.horizontal_view_deg, camera.vertical_view_deg) == VIEW_DEG
    assert camera.tilt_deg == TILT_DEG
    assert preset.world.physics.step_s * VIDEO_HZ == pytest.approx(1.0)


def test_left_middle_and_right_are_thirds_of_the_image(preset):
    limits = preset.categories
    assert (limits.left_below_px, limits.right_from_px) == pytest.approx((IMAGE_PX[0] / 3, 2 * IMAGE_PX[0] / 3))


@pytest.mark.parametrize("kind", TERCILES_PX)
def test_sizes_are_the_measured_terciles_rounded_to_5_px(preset, kind):
    limits = preset.categories
    found = getattr(limits, f"{kind}_small_below_px"), getattr(limits, f"{kind}_large_from_px")
    assert found == tuple(5 * round(tercile / 5) for tercile in TERCILES_PX[kind])


def test_chapter_6_drives_with_power_wheeled_steering(preset):
    assert preset.world.robot.drive == "pws"  # section 5.4.1; chapters 3 and 4 have 4-wheel steering


@pytest.mark.parametrize("kind", ["fixed", "varying"])
def test_fitness_has_the_constants_of_table_6_2(preset, kind):
    assert msgspec.structs.asdict(getattr(preset.fitness, kind)) == TABLE_6_2[kind]


def test_genetic_programming_has_the_parameters_of_table_6_3(experiment):
    gp = experiment.gp
    assert {name: getattr(gp, name) for name in TABLE_6_3} == TABLE_6_3
    shares = {name: 100.0 * getattr(gp, name) for name in TABLE_6_3_PERCENT}
    assert shares == pytest.approx(TABLE_6_3_PERCENT)
    assert experiment.evaluation.games == GAMES
    assert gp.population * experiment.evaluation.games == GAMES_A_GENERATION
    assert experiment.evaluation.grouping == "random"
    # "?0" of Table 6.3: events of the text at generations up to 25, and two digits that end with 0.
    assert gp.generations == 60
    assert experiment.fitness.kind == "fixed"


def test_one_mutation_at_the_limit_of_crossover_gives_the_deepest_tree_of_table_6_4(experiment):
    # Where Table 6.3 is silent: it lets crossover go to 25, and 30 is printed. So mutation went beyond, by 5 at least.
    assert experiment.gp.crossover_depth_max + experiment.gp.mutation_depth_max == DEEPEST_BEST_TREE


def test_one_crossover_point_of_ten_is_a_leaf(experiment):
    # Koza, Genetic Programming (1992): 90 % of the points are functions; DEAP's manual says the same.
    assert 1.0 - experiment.gp.leaf_probability == pytest.approx(0.9)
