"""What tests share: profiles and strategies of hypothesis, settings of small experiments, runs of them."""

from __future__ import annotations

import copy
import gc
import io
import itertools
import math
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st

from coevo.cli import main
from coevo.config import RunSettings, check, override
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.recipes import read_recipe, recipe_names
from coevo.run import create_run, open_run
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL, ROBOTS
from coevo.tree import Tree
from coevo.vocabulary import CATEGORIES, SKILLS

settings.register_profile("unhurried", deadline=None)  # the first call of a kernel may have to compile it
settings.load_profile("unhurried")

# What r0 of three robots can ask about.
OBJECTS = ("ball", "own_goal", "opponent_goal", "r1", "r2")
# Small enough for a run in about a second, and yet robots meet the ball, and trees grow.
SMALL = (
    "gp.population=6",
    "gp.generations=3",
    "gp.tournament=2",
    "gp.creation_depth_max=4",
    "evaluation.games=2",
    "game.time_limit_steps=90",
)


def _trees():
    conditions = st.builds(
        "IF_{}_is_{}".format,
        st.sampled_from(OBJECTS),
        st.sampled_from(CATEGORIES),
    )
    leaves = st.sampled_from(SKILLS).map(lambda skill: (skill,))
    names = st.recursive(
        leaves,
        lambda branches: st.builds(lambda name, yes, no: (name, *yes, *no), conditions, branches, branches),
        max_leaves=40,
    )
    return names.map(Tree)


# Trees of r0 of three robots, as st.from_type(Tree); conftest cannot be imported by tests.
st.register_type_strategy(Tree, _trees())


@pytest.fixture(scope="session")
def nested():
    """Return a function from a tree to nested tuples: ``"shoot"`` or ``(condition, yes, no)``."""

    def build(names):
        name = next(names)
        return (name, build(names), build(names)) if name.startswith("IF_") else name

    return lambda tree: build(iter(tree.names))


@pytest.fixture(scope="session")
def situations():
    """Return a function that yields all that can be seen of some objects, as the set of true "a is b"."""
    sights = [{"lost"}, *({where, size} for where in CATEGORIES[:3] for size in CATEGORIES[3:6])]

    def combine(objects):
        objects = sorted(objects)
        for combination in itertools.product(sights, repeat=len(objects)):
            pairs = zip(objects, combination, strict=True)
            yield {f"IF_{thing}_is_{category}" for thing, sight in pairs for category in sight}

    return combine


@pytest.fixture(scope="session")
def recipe():
    """Return a function that gives a preset as plain data: all through a session the same."""
    presets = {name: read_recipe(name, "evolution") for name in recipe_names("evolution")}
    return lambda name: copy.deepcopy(presets[name])


@pytest.fixture(scope="session")
def small_settings(recipe):
    """Return a function that makes the settings of a small experiment: a preset and ``key=value`` assignments."""

    def make(*assignments, preset="smoke"):
        return check(RunSettings, override(recipe(preset), [*SMALL, *assignments]), preset)

    return make


@pytest.fixture(scope="session")
def go_on():
    """Return a function that brings a run to its end in this process."""

    def bring(run, *, workers=1, backend="threads", report=lambda _: None):
        with Evaluator(run.config, workers=workers, backend=backend, folders=run.folders) as evaluator:
            evolve(run, evaluator, report)
        return open_run(run.path)

    return bring


@pytest.fixture(scope="session")
def small_run(small_settings, go_on, tmp_path_factory):
    """Return a finished run of the small experiment: only to be read."""
    return go_on(create_run(tmp_path_factory.mktemp("small") / "run", small_settings()))


@pytest.fixture(scope="session")
def results_of():
    """Return a function that gives the bytes of a run's tables and of its parts of individuals."""

    def read(folder):
        parts = sorted((Path(folder) / "individuals.parquet").iterdir())
        tables = sorted(Path(folder).glob("*.csv"))
        return {path.name: path.read_bytes() for path in [*tables, *parts]}

    return read


@dataclass
class Opened:
    """A page in a browser: Playwright's handle, what the page complained of, and what it asked for besides itself."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


_CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
# Without what it does for its own ends, it asks for nothing that a page did not ask for.
_QUIET = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)


@pytest.fixture(scope="session")
def chromium():
    """Return a running Chromium, or skip: the machine's own, or the one of 'playwright install chromium'."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        found = next(filter(None, map(shutil.which, _CHROMIUM)), driver.chromium.executable_path)
        if not Path(found).exists():
            pytest.skip("no Chromium: install the package chromium, or run 'playwright install chromium'")
        browser = driver.chromium.launch(executable_path=found, args=list(_QUIET))
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium):
    """Return a function that opens a file in a browser: ``open_page(path, "#step=3", width=390, scheme="dark")``."""
    contexts = []

    def show(path, fragment="", *, width=1280, height=900, scheme="light"):
        contexts.append(chromium.new_context(viewport={"width": width, "height": height}, color_scheme=scheme))
        opened = Opened(contexts[-1].new_page())
        address = Path(path).resolve().as_uri()
        opened.page.on("console", lambda said: opened.complaints.append(f"{said.type}: {said.text}"))
        opened.page.on("pageerror", lambda error: opened.complaints.append(str(error)))
        own = address, "about:"
        opened.page.on("request", lambda asked: asked.url.startswith(own) or opened.requests.append(asked.url))
        opened.page.goto(address + fragment)
        return opened

    yield show
    for context in contexts:
        context.close()


@np.errstate(divide="ignore", invalid="ignore")
def _cast(world, state, robot, side):
    """Return (rows, columns): the object that the ray through each pixel's centre hits first, -1 for none.

    Pinhole optics, written from the settings alone: world coordinates, one ray a pixel, nearest hit wins.
    """
    camera, field = world.camera, world.field
    tilt, heading = math.radians(camera.tilt_deg), state[robot, 2]
    x = (np.arange(camera.width_px) + 0.5) / camera.width_px * 2.0 - 1.0
    y = (np.arange(camera.height_px) + 0.5) / camera.height_px * 2.0 - 1.0
    right, down = np.meshgrid(
        x * math.tan(math.radians(camera.horizontal_view_deg) / 2.0),
        y * math.tan(math.radians(camera.vertical_view_deg) / 2.0),
    )
    forward = math.cos(tilt) + down * math.sin(tilt)
    dz = math.sin(tilt) - down * math.cos(tilt)
    dx = forward * math.cos(heading) + right * math.sin(heading)
    dy = forward * math.sin(heading) - right * math.cos(heading)
    hit, best = np.full(dx.shape, -1), np.full(dx.shape, np.inf)

    def offer(thing, distance, where):
        nearer = where & (distance > 0.0) & (distance < best)
        hit[nearer], best[nearer] = thing, distance[nearer]

    goals = {0.0: OWN_GOAL, field.length_m: OPPONENT_GOAL}
    if side == 1:
        goals = {0.0: OPPONENT_GOAL, field.length_m: OWN_GOAL}
    for line, thing in goals.items():
        distance = (line - state[robot, 0]) / dx
        across = state[robot, 1] + distance * dy - field.width_m / 2.0
        height = camera.height_m + distance * dz
        mouth = (np.abs(across) <= field.goal_width_m / 2.0) & (height >= 0.0) & (height <= field.goal_height_m)
        offer(thing, distance, mouth)
    best[:] = np.inf  # whatever stands on the field, or in a goal, is before its mouth
    for body in range(len(state)):
        ox, oy = state[body, :2] - state[robot, :2]
        if body == len(state) - 1:
            radius = world.ball.radius_m
            oz = radius - camera.height_m
            square, along = dx * dx + dy * dy + dz * dz, dx * ox + dy * oy + dz * oz
            under = along**2 - square * (ox * ox + oy * oy + oz * oz - radius**2)
            offer(BALL, (along - np.sqrt(np.maximum(under, 0.0))) / square, under >= 0.0)
        elif body != robot:
            thing = ROBOTS + body - (body > robot)
            radius, top = world.robot.radius_m, world.robot.height_m
            square, along = dx * dx + dy * dy, dx * ox + dy * oy
            under = along**2 - square * (ox * ox + oy * oy - radius**2)
            distance = (along - np.sqrt(np.maximum(under, 0.0))) / square
            height = camera.height_m + distance * dz
            offer(thing, distance, (under >= 0.0) & (height >= 0.0) & (height <= top))
            distance = (top - camera.height_m) / dz
            offer(thing, distance, np.hypot(distance * dx - ox, distance * dy - oy) <= radius)
    return hit


@pytest.fixture(scope="session")
def ray_cast():
    """Return the reference of the camera: a function of world, state, robot and side."""
    return _cast


class Said(NamedTuple):
    """What a command said: its exit code, standard output and standard error."""

    code: int
    out: str
    err: str


@pytest.fixture
def coevo(monkeypatch):
    """Return a function that runs a command in this process, as the installed script does."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["coevo", *map(str, arguments)])
        out, err = io.StringIO(), io.StringIO()
        code = 0
        with redirect_stdout(out), redirect_stderr(err):
            try:
                main()
            except SystemExit as stop:
                code = stop.code
        return Said(code or 0, out.getvalue(), err.getvalue())

    return run


@pytest.fixture
def copied_run(small_run, tmp_path):
    """Return the folder of a copy of the finished small run, that may be spoilt."""
    return Path(shutil.copytree(small_run.path, tmp_path / "copy"))


@pytest.fixture
def collected():
    """Collect what a test left, before the next one has to answer for it."""
    yield
    gc.collect()
