"""The player in a browser: it opens, plays, is steered by keys, shows what robots see, and asks for nothing."""

from __future__ import annotations

import dataclasses
import html
import json

import numpy as np
import pytest

from coevo.replay import make_page
from coevo.soccer.sight import label_images

STEP = "document.getElementById('scrub').valueAsNumber"
GAME = "Number(document.getElementById('game').value)"


@pytest.fixture(scope="module")
def page_file(games, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "replay.html"
    path.write_text(make_page(games.recording), encoding="utf-8")
    return path


def picture(page, robot):
    """Return (rows, columns, 3) the colours of a camera's canvas."""
    size, pixels = page.evaluate(
        """robot => { const canvas = document.querySelectorAll('canvas.camera')[robot];
        const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext('2d', { willReadFrequently: true });
        copy.drawImage(canvas, 0, 0);
        const image = copy.getImageData(0, 0, canvas.width, canvas.height);
        return [[canvas.height, canvas.width], Array.from(image.data)]; }""",
        robot,
    )
    return np.array(pixels, np.uint8).reshape(*size, 4)[..., :3]


def is_quiet(opened):
    opened.page.wait_for_timeout(100)
    assert opened.complaints == []
    assert opened.requests == []


def wait_for_cameras(page):
    page.wait_for_function("current().seen.every((seen, i) => seen || !robots[i].sees)")


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_a_page_opens_without_complaints_or_requests_and_fits_the_screen(open_page, page_file, width, scheme):
    opened = open_page(page_file, width=width, scheme=scheme)
    wait_for_cameras(opened.page)
    assert opened.page.evaluate("document.documentElement.scrollWidth") == width
    assert opened.page.locator("h1").text_content() == "three-learners"
    is_quiet(opened)


def test_keys_play_step_and_choose(open_page, page_file, games):
    page = (opened := open_page(page_file)).page
    steps = [len(trace.skills) for trace in games.traces]
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate(STEP) == 31
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(STEP) == 30
    page.keyboard.press(" ")
    page.wait_for_function(f"{STEP} > 33")
    page.keyboard.press(" ")
    stopped = page.evaluate(STEP)
    page.wait_for_timeout(150)
    assert page.evaluate(STEP) == stopped
    page.keyboard.press("ArrowDown")
    assert (page.evaluate(GAME), page.evaluate(STEP)) == (1, 0)
    page.keyboard.press("End")
    assert page.evaluate(STEP) == steps[1]
    assert page.locator("#outcome").text_content() == games.recording.takes[1].ending
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowUp")
    assert page.evaluate(GAME) == 0
    page.locator("#play").focus()
    page.keyboard.press("Enter")
    page.wait_for_function(f"{STEP} > 2")
    page.locator("#game").select_option("2")
    assert page.evaluate(GAME) == 2
    is_quiet(opened)


def test_a_camera_shows_its_objects_in_their_colours_at_every_moment(open_page, page_file, games):
    world, trace = games.settings.world, games.traces[1]
    page = (opened := open_page(page_file, "#game=2&step=0")).page
    wait_for_cameras(page)
    objects = page.evaluate("robots.map((robot) => robot.objects)")
    seen = 0
    for step in (0, 7, 60, len(trace.skills)):
        page.evaluate("step => go(step)", step)
        for robot, player in enumerate(games.settings.players):
            shown = picture(page, robot)
            (labels,) = label_images(world, trace.states[step : step + 1], robot, player.team)
            for label, colour in enumerate(objects[robot], start=1):
                expected = tuple(bytes.fromhex(colour[1:]))
                assert (shown[labels == label] == expected).all()
                assert not (shown[labels != label] == expected).all(axis=-1).any()
                seen += np.count_nonzero(labels == label)
            assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 1  # never blank
    assert seen > 500
    is_quiet(opened)


def test_the_way_through_a_tree_is_told_in_words(open_page, page_file, games):
    page = (opened := open_page(page_file, "#game=1&step=20")).page
    for robot, tree in enumerate(games.trees):
        leaf = int(games.traces[0].leaves[20, robot])
        told = page.locator(".robot").nth(robot).locator(".path li").all_inner_texts()
        assert told[-1] == f"→ {tree.names[leaf]}"
        node = 0
        for line in told[:-1]:
            question, answer = line.split("\n")
            assert "IF_" + question[:-1].replace(" is ", "_is_").replace(" ", "_") == tree.names[node]
            node = node + 1 if answer == "yes" else tree.second[node]
        assert node == leaf
    is_quiet(opened)


def test_a_panel_is_closed_and_opened_by_keyboard(open_page, page_file):
    page = (opened := open_page(page_file)).page
    wait_for_cameras(page)
    summary, camera = page.locator(".robot summary").first, page.locator(".camera").first
    summary.focus()
    page.keyboard.press("Enter")
    camera.wait_for(state="hidden")
    page.keyboard.press("ArrowRight")  # keys go on steering
    assert page.evaluate(STEP) == 1
    page.keyboard.press("Enter")
    camera.wait_for(state="visible")
    is_quiet(opened)


def test_names_are_text_whatever_they_hold(open_page, games, tmp_path):
    evil = "</script><img src=x onerror=alert(1)>&amp;"
    actors = tuple(dataclasses.replace(actor, name=evil) for actor in games.recording.actors)
    takes = tuple(dataclasses.replace(take, title=evil, ending=evil) for take in games.recording.takes)
    recording = dataclasses.replace(games.recording, name=evil, actors=actors, takes=takes, sides=(evil, evil))
    (tmp_path / "evil.html").write_text(make_page(recording), encoding="utf-8")
    opened = open_page(tmp_path / "evil.html", "#step=100000")
    assert opened.page.locator("h1").text_content() == evil
    assert opened.page.locator("img").count() == 0
    is_quiet(opened)


@pytest.mark.parametrize("sandbox", ["", 'sandbox="allow-scripts"'])
def test_a_page_works_within_another(open_page, page_file, tmp_path, sandbox):
    inner = html.escape(page_file.read_text(encoding="utf-8"))
    outer = (
        "<!doctype html><title>report</title><script>addEventListener('message', e => window.told = e.data)</script>"
        f'<iframe {sandbox} style="width: 100%; height: 500px" srcdoc="{inner}"></iframe>'
    )
    (tmp_path / "outer.html").write_text(outer, encoding="utf-8")
    page = (opened := open_page(tmp_path / "outer.html")).page
    page.wait_for_function("window.told && window.told.height > 500")
    assert page.evaluate("window.told.coevo") == "height"
    frame = page.frames[1]
    frame.locator("#field").click()
    frame.wait_for_function(f"{STEP} > 3")
    page.keyboard.press(" ")
    assert frame.locator("#play").text_content() == "Play"
    assert json.loads(frame.evaluate("JSON.stringify(current().seen.map(Boolean))")) == [True] * 3
    is_quiet(opened)
