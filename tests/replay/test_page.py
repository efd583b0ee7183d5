"""What a page holds of a game: what each camera showed, and the way through each tree."""

from __future__ import annotations

import base64
import json
import re
import zlib

import numpy as np
import pytest

from coevo.replay import Actor, Recording, make_page
from coevo.replay.packing import pack_images
from coevo.soccer.camera import ROBOTS, camera_params, make_retina, object_count, see
from coevo.soccer.sight import label_images
from coevo.soccer.vision import BALL_HUE, GOAL_HUES, ROBOT_HUES, colour_regions, render


def data_of(recording):
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', make_page(recording), re.DOTALL)
    return json.loads(found[1])


def unpacked(text, columns, rows):
    """Undo ``pack_images``, by what its docstring says."""
    labels, number, digit = [], 0, 0
    for byte in zlib.decompress(base64.b64decode(text)):
        number += (byte & 127) * 128**digit
        digit += 1
        if byte < 128:
            length, label = divmod(number, 16)
            labels += [label] * length
            number = digit = 0
    return np.array(labels, np.uint8).reshape(-1, columns, rows).transpose(0, 2, 1)


def unrolled(runs):
    return np.repeat(runs[::2], runs[1::2])


# ------------------------------------------------------------------------------------------------------ cameras


def test_images_are_unpacked_as_they_were_packed():
    rng = np.random.default_rng(3)
    images = np.concatenate(
        [
            rng.integers(0, 16, (4, 60, 64)),
            np.zeros((2, 60, 64)),  # a run longer than two bytes of seven bits
            np.repeat(rng.integers(0, 3, (3, 1, 64)), 60, axis=1),
        ]
    ).astype(np.uint8)
    assert np.array_equal(unpacked(pack_images(images), 64, 60), images)
    assert np.array_equal(unpacked(pack_images(images[:, :7, :11]), 11, 7), images[:, :7, :11])


def test_the_images_of_a_page_are_those_that_features_were_measured_in(games):
    """For every state that was recorded: area, centre and extent of each object are those that the robot measured."""
    data, world, players = data_of(games.recording), games.settings.world, games.settings.players
    camera, retina = camera_params(world), make_retina(world)
    shown = 0
    for trace, game in zip(games.traces, data["games"], strict=True):
        for robot, packed in enumerate(game["images"]):
            images = unpacked(packed, world.camera.width_px, world.camera.height_px)
            assert len(images) == len(trace.states)
            for image, state in zip(images, trace.states, strict=True):
                features, areas = np.zeros((object_count(3), 11)), np.zeros(object_count(3))
                see(camera, state, robot, players[robot].team, retina, features, areas)
                for thing, area in enumerate(areas):
                    row, column = np.nonzero(image == 1 + thing)
                    assert len(row) == area
                    if area:
                        shown += 1
                        centre = column.mean() + 0.5, row.mean() + 0.5
                        assert features[thing, :2] == pytest.approx(centre, abs=1e-9)
                    if area and thing >= ROBOTS:
                        assert features[thing, 2:4].tolist() == [np.ptp(column) + 1, np.ptp(row) + 1]
    assert shown > 1000


def test_the_images_are_what_the_painter_paints(games):
    """OpenCV paints the same scene another way: but for pixels at the outlines both show the same objects."""
    world, differing, objects = games.settings.world, 0, 0
    for trace in games.traces:
        states = trace.states[::20]
        for robot, player in enumerate(games.settings.players):
            goals = GOAL_HUES if player.team == 0 else GOAL_HUES[::-1]
            hues = [BALL_HUE, *goals, *(hue for n, hue in enumerate(ROBOT_HUES[:3]) if n != robot)]
            for image, state in zip(label_images(world, states, robot, player.team), states, strict=True):
                regions = colour_regions(render(world, state, robot), hues)
                painted = sum((1 + n) * region for n, region in enumerate(regions))
                differing += np.count_nonzero(image != painted)
                objects += np.count_nonzero(image)
    assert objects > 10_000
    assert differing < 0.05 * objects


def test_a_robot_without_eyes_has_no_images(games):
    blind = [Actor("r0"), Actor("r1", 0, sees=False), Actor("r2", 1, sees=False)]
    one = games.recording
    data = data_of(Recording("x", one.world, tuple(blind), one.skills, one.takes))
    assert [bool(images) for images in data["games"][0]["images"]] == [True, False, False]


def test_three_games_are_far_below_their_limit(games):
    steps = sum(len(trace.skills) for trace in games.traces)
    assert len(make_page(games.recording)) * (3 * 600 / steps) < 1_500_000


# ---------------------------------------------------------------------------------------------------------- trees


def test_the_leaf_that_is_told_is_the_one_that_the_answers_lead_to(games):
    """Conditions are asked anew of each recorded state, by the plain words of Table 6.1."""
    limits, leaves = games.settings.categories, set()
    for trace in games.traces:
        for robot, player in enumerate(games.settings.players):
            tree = games.trees[robot]
            things = ["ball", "own_goal", "opponent_goal", *(f"r{n}" for n in range(3) if n != robot)]
            images = label_images(games.settings.world, trace.states[:-1], robot, player.team)
            for step, image in enumerate(images):
                node = 0
                while tree.names[node].startswith("IF_"):
                    thing, asked = tree.names[node][3:].rsplit("_is_", 1)
                    row, column = np.nonzero(image == 1 + things.index(thing))
                    true = {"lost"}
                    if len(row):
                        true = {"left"} if column.mean() + 0.5 < limits.left_below_px else set()
                        kind = thing if thing == "ball" else "goal" if "goal" in thing else "robot"
                        true |= {"large"} if len(row) >= getattr(limits, f"{kind}_large_from_px") else set()
                    node = node + 1 if asked in true else tree.second[node]
                assert trace.leaves[step, robot] == node
                assert tree.names[node] == list(games.settings.terminals)[trace.skills[step, robot]]
                leaves.add((robot, node))
    assert len(leaves) > 7  # of 12, one of which nothing can lead to


def test_a_page_holds_leaves_and_trees(games):
    data = data_of(games.recording)
    for tree, robot in zip(games.trees, data["robots"], strict=True):
        words = [robot["tree"]["words"][node] for node in robot["tree"]["nodes"]]
        assert words[0] == tree.names[0].removeprefix("IF_").replace("_is_", " is ").replace("_", " ") + "?"
        assert [word for word in words if not word.endswith("?")] == [n for n in tree.names if n[:3] != "IF_"]
        assert robot["tree"]["second"] == list(tree.second)
    for trace, game in zip(games.traces, data["games"], strict=True):
        for name in ("skills", "actions", "leaves", "perceived"):
            for robot, runs in enumerate(game[name]):
                assert np.array_equal(unrolled(runs), getattr(trace, name)[:, robot])
