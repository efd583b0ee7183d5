"""Traces, digests, pictures, videos and the page, from games that are made up here."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pandas as pd
import pytest

from coevo.config import CameraSettings, GameSettings, PlayerSettings, RunSettings, StartSettings
from coevo.errors import InputError
from coevo.game import Trace
from coevo.replay import draw_frame, frame_size, game_recording, scene, trace_digest, write_trace, write_video
from coevo.vocabulary import SKILLS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

ROBOTS = 3
START = StartSettings(x_m=(2.0, 3.0), y_m=(1.0, 2.0))
SETTINGS = RunSettings(
    name="</script><b>three & more",
    game=GameSettings(ball_start=START),
    players=(
        PlayerSettings(start=START),
        PlayerSettings(team=1, start=START),
        PlayerSettings(control="stationary", start=START),
    ),
)
LENGTH, WIDTH = SETTINGS.world.field.length_m, SETTINGS.world.field.width_m


def make_trace(steps: int, seed: int, ball_ends_at: float = 4.0) -> Trace:
    rng = np.random.default_rng(seed)
    states = rng.normal(0.0, 0.01, (steps + 1, ROBOTS + 1, 6)).cumsum(0)
    states[:, :, 0] += [1.5, 3.0, 7.0, 4.0]
    states[:, :, 1] += [1.0, 3.5, 2.0, 2.2]
    states[-1, -1, 0] = ball_ends_at
    skills = rng.integers(0, len(SKILLS), (steps, ROBOTS)).astype(np.int8)
    skills[:, 2] = -1
    nodes = np.where(skills < 0, -1, 0).astype(np.int32)
    return Trace(states=states, skills=skills, actions=np.zeros_like(skills), leaves=nodes, perceived=nodes)


@pytest.fixture(scope="module")
def traces() -> list[Trace]:
    """Return a goal for blue, a game without a goal, a goal for yellow."""
    return [make_trace(40, 1, LENGTH + 0.1), make_trace(25, 2), make_trace(31, 3, -0.1)]


# ------------------------------------------------------------------------------------------------ the table


def test_a_trace_file_reads_back_exactly(tmp_path: Path, traces: list[Trace]) -> None:
    write_trace(tmp_path / "t.csv", game_recording(SETTINGS, traces))
    exact = dict.fromkeys(["x_m", "y_m", "heading_rad"], float)  # the default of older pandas is not
    table = pd.read_csv(tmp_path / "t.csv", converters=exact, keep_default_na=False)
    assert list(table) == ["game", "step", "body", "x_m", "y_m", "heading_rad", "skill"]
    assert len(table) == sum((len(trace.skills) + 1) * (ROBOTS + 1) for trace in traces)
    for game, trace in enumerate(traces):
        for number, body in enumerate(["r0", "r1", "r2", "ball"]):
            rows = table[(table.game == game) & (table.body == body)]
            assert rows.step.tolist() == list(range(len(trace.states)))
            assert np.array_equal(rows[["x_m", "y_m", "heading_rad"]].to_numpy(), trace.states[:, number, :3])
            named = [SKILLS[skill] for skill in trace.skills[:, number]] if body in {"r0", "r1"} else []
            assert rows.skill.tolist() == (named or [""] * len(trace.skills)) + [""]


def test_a_trace_file_is_the_same_every_time(tmp_path: Path, traces: list[Trace]) -> None:
    for name in ("a.csv", "b.csv"):
        write_trace(tmp_path / name, game_recording(SETTINGS, traces))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert (tmp_path / "a.csv").read_bytes().startswith(b"game,step,body,x_m,y_m,heading_rad,skill\n0,0,r0,")


def test_no_games_make_a_file_with_the_names_of_the_columns(tmp_path: Path) -> None:
    write_trace(tmp_path / "t.csv", game_recording(SETTINGS, []))
    assert pd.read_csv(tmp_path / "t.csv").empty


# ----------------------------------------------------------------------------------------------- the digest


def test_the_digest_depends_on_every_bit(traces: list[Trace]) -> None:
    def changed(name: str, index: tuple[int, ...], value: float) -> list[Trace]:
        array = getattr(traces[1], name).copy()
        array[index] = value
        return [traces[0], dataclasses.replace(traces[1], **{name: array}), traces[2]]

    x = traces[1].states[7, 2, 3]
    first, second = traces[0], traces[1]
    moved = [  # the last state of the first game at the start of the second
        dataclasses.replace(first, states=first.states[:-1]),
        dataclasses.replace(second, states=np.concatenate([first.states[-1:], second.states])),
        traces[2],
    ]
    digests = [
        trace_digest(games)
        for games in (
            traces,
            changed("states", (7, 2, 3), np.nextafter(x, 9.0)),
            changed("skills", (24, 0), (traces[1].skills[24, 0] + 1) % 4),
            traces[:2],
            traces[::-1],
            moved,
            [],
        )
    ]
    assert len(set(digests)) == len(digests)
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in digests)
    assert trace_digest([make_trace(40, 1, LENGTH + 0.1), *traces[1:]]) == digests[0]


# ----------------------------------------------------------------------------------------------- the picture


def pixel(image: NDArray[np.uint8], x: float, y: float) -> str:
    """Return the colour of a point of the field [m]."""
    height, width, _ = image.shape
    field = SETTINGS.world.field
    scale = width / (LENGTH + 2.0 * (field.goal_depth_m + field.wall_thickness_m))
    left, below = field.goal_depth_m + field.wall_thickness_m + x, field.wall_thickness_m + y
    blue, green, red = image[int(height - below * scale), int(left * scale)]
    return f"#{red:02x}{green:02x}{blue:02x}"


@pytest.mark.parametrize("width", [480, 721, 1280])
def test_a_frame_has_everything_in_its_place(width: int) -> None:
    poses = [[2.0, 1.0, 0.0], [6.0, 3.5, 3.0], [7.0, 1.0, 1.5], [4.0, 2.4, 0.0]]
    state = np.hstack([poses, np.zeros((4, 3))])
    image = draw_frame(game_recording(SETTINGS, []), state, [0, 2, -1], frame_size(SETTINGS.world, width))
    assert image.shape == (frame_size(SETTINGS.world, width)[1], width - width % 2, 3)
    assert image.dtype == np.uint8
    assert pixel(image, 4.0, 2.4) == scene.BALL
    assert pixel(image, 5.5, 0.5) == scene.FLOOR
    assert pixel(image, -0.3, 0.5 * WIDTH) == scene.TEAM_COLOURS[0]
    assert pixel(image, LENGTH + 0.3, 0.5 * WIDTH) == scene.TEAM_COLOURS[1]
    for x, y in [
        (4.0, -0.1),
        (4.0, WIDTH + 0.1),
        (-0.1, 0.5),
        (LENGTH + 0.1, 0.5),
        (0.05, 0.05),
        (-0.6, 0.5 * WIDTH),
    ]:
        assert pixel(image, x, y) == scene.WALL
    for number, (x, y, heading) in enumerate(poses[:-1]):
        away = 0.14 * np.array([np.cos(heading), np.sin(heading)])  # between the name and the rim
        assert pixel(image, x + away[0], y + away[1]) == scene.ROBOT_COLOURS[number]
    assert dict(scene.skill_labels(game_recording(SETTINGS, [])))["shoot"] in {
        pixel(image, 2.0 + dx, 0.67) for dx in np.linspace(-0.2, 0.2, 21)
    }
    assert pixel(image, 3.0, 1.0) != scene.FLOOR  # r0 sees this
    assert pixel(image, 7.0, 2.0) == scene.FLOOR  # r2 stands still and needs no eyes


def test_the_camera_sees_the_floor_that_its_angles_say() -> None:
    camera = SETTINGS.world.camera
    near, far, *_ = scene.seen_floor(camera)
    assert near[0] == pytest.approx(camera.height_m / np.tan(np.radians(56.0)))
    ray = np.array([near[0], near[1], -camera.height_m])  # to the lower left corner of the image
    down = np.radians(26.0)
    depth = ray @ [np.cos(down), 0.0, -np.sin(down)]
    assert ray[1] / depth == pytest.approx(np.tan(np.radians(33.5)))
    assert ray @ [np.sin(down), 0.0, np.cos(down)] / depth == pytest.approx(-np.tan(np.radians(30.0)))
    assert far[0] == pytest.approx(2.0)
    assert scene.seen_floor(CameraSettings(tilt_deg=29.0, vertical_view_deg=50.0)) == []
    assert scene.seen_floor(CameraSettings(tilt_deg=-54.0))[1][0] == pytest.approx(0.4 / np.tan(np.radians(24.0)))
    assert scene.seen_floor(CameraSettings(tilt_deg=-1.0, vertical_view_deg=6.0, height_m=2.0)) == []


# ------------------------------------------------------------------------------------------------ the videos


def test_an_mp4_has_every_state_and_holds_the_last_one(tmp_path: Path, traces: list[Trace]) -> None:
    write_video(tmp_path / "v.mp4", game_recording(SETTINGS, traces), width=320)
    reader = cv2.VideoCapture(str(tmp_path / "v.mp4"))
    frames = []
    while (answer := reader.read())[0]:
        frames.append(answer[1])
    assert reader.get(cv2.CAP_PROP_FPS) == 30.0
    assert len(frames) == sum(len(trace.states) + 24 for trace in traces)
    assert frames[0].shape == (*frame_size(SETTINGS.world, 320)[::-1], 3)
    expected = draw_frame(
        game_recording(SETTINGS, []), traces[0].states[0], traces[0].skills[0], frame_size(SETTINGS.world, 320)
    )
    assert np.abs(frames[0][20:].astype(int) - expected[20:]).mean() < 5.0
    assert [path.name for path in tmp_path.iterdir()] == ["v.mp4"]


def test_a_name_with_a_colon_is_no_address(
    tmp_path: Path, traces: list[Trace], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_video("12:30.mp4", game_recording(SETTINGS, traces[:1]), width=320)
    assert [path.name for path in tmp_path.iterdir()] == ["12:30.mp4"]
    shutil.copy("12:30.mp4", "copy.mp4")
    assert cv2.VideoCapture("copy.mp4").get(cv2.CAP_PROP_FRAME_COUNT) == len(traces[0].states) + 24


@pytest.mark.parametrize(("fps", "frames"), [(10.0, 15 + 8), (60.0, 81 + 48)])
def test_an_mp4_keeps_real_time(tmp_path: Path, traces: list[Trace], fps: float, frames: int) -> None:
    write_video(tmp_path / "v.mp4", game_recording(SETTINGS, traces[:1]), width=320, fps=fps)
    assert cv2.VideoCapture(str(tmp_path / "v.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == frames


def test_a_gif_has_every_third_state_and_the_last_one(tmp_path: Path, traces: list[Trace]) -> None:
    write_video(tmp_path / "v.GIF", game_recording(SETTINGS, traces), width=320)
    done, animation = cv2.imreadanimation(str(tmp_path / "v.GIF"))
    assert done
    assert len(animation.frames) == (14 + 1) + (9 + 1) + (11 + 1)
    assert animation.frames[0].shape[:2] == frame_size(SETTINGS.world, 320)[::-1]
    assert animation.durations[0] == 100
    assert animation.durations[14] == 900
    assert animation.loop_count == 0  # for ever


def test_many_games_make_a_gif_in_time_lapse(
    tmp_path: Path, traces: list[Trace], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coevo.replay.video._GIF_FRAMES", 12)
    write_video(tmp_path / "v.gif", game_recording(SETTINGS, traces), width=320)
    _, animation = cv2.imreadanimation(str(tmp_path / "v.gif"))
    assert len(animation.frames) == (5 + 1) + (4 + 1) + (4 + 1)
    assert animation.durations[0] == 100


def test_an_opencv_without_gif_says_what_to_do(
    tmp_path: Path, traces: list[Trace], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(cv2, "imencodeanimation")
    with pytest.raises(InputError, match=r"install opencv-python-headless 4\.12 or newer, or write \.html"):
        write_video(tmp_path / "v.gif", game_recording(SETTINGS, traces))


def test_an_mp4_that_lost_frames_is_not_kept(
    tmp_path: Path, traces: list[Trace], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coevo.replay.video._count_frames", lambda _: 3)
    with pytest.raises(InputError, match="3 of 65 frames arrived"):
        write_video(tmp_path / "v.mp4", game_recording(SETTINGS, traces[:1]), width=320)
    assert not list(tmp_path.iterdir())


# -------------------------------------------------------------------------------------------------- the page


def page_data(page: str) -> Any:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def test_a_page_needs_nothing_from_outside(tmp_path: Path, traces: list[Trace]) -> None:
    write_video(tmp_path / "v.html", game_recording(SETTINGS, traces))
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    assert not re.search(r"https?:|//[a-z]+\.|\bsrc=|\bhref=|@import|url\(", page)
    assert "{{" not in page
    assert "<b>" not in page  # the name of the run is text, whatever it holds
    assert page.count("</script>") == 2
    assert "&lt;/script&gt;&lt;b&gt;three &amp; more" in page


def test_a_page_holds_all_games(tmp_path: Path, traces: list[Trace]) -> None:
    write_video(tmp_path / "v.html", game_recording(SETTINGS, traces))
    data = page_data((tmp_path / "v.html").read_text(encoding="utf-8"))
    assert data["name"] == SETTINGS.name
    assert [robot["name"] for robot in data["robots"]] == ["r0", "r1", "r2"]
    assert [robot["sees"] for robot in data["robots"]] == [True, True, False]
    assert [skill["name"] for skill in data["skills"]] == list(SKILLS)
    assert [game["point"] for game in data["games"]] == [0, -1, 1]
    for trace, game in zip(traces, data["games"], strict=True):
        assert game["steps"] == len(trace.skills)
        for number, columns in enumerate(game["bodies"]):
            for column, differences in enumerate(columns):
                exact = 1000.0 * trace.states[:, number, column]
                assert np.abs(np.cumsum(differences) - exact).max() <= 0.5 + 1e-9
        for number, runs in enumerate(game["skills"]):
            assert np.array_equal(np.repeat(runs[::2], runs[1::2]), trace.skills[:, number])


# ------------------------------------------------------------------------------------------------- the errors


@pytest.mark.parametrize("name", ["v.avi", "v", "v.html.gz"])
def test_an_unknown_suffix_names_the_known_ones(tmp_path: Path, traces: list[Trace], name: str) -> None:
    with pytest.raises(InputError, match=rf"ending in \.mp4, \.gif, \.html, got {name}"):
        write_video(tmp_path / name, game_recording(SETTINGS, traces))


@pytest.mark.parametrize("suffix", ["csv", "mp4", "gif", "html"])
def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path, traces: list[Trace], suffix: str) -> None:
    def write(path: Path) -> None:
        if suffix == "csv":
            write_trace(path, game_recording(SETTINGS, traces))
        else:
            write_video(path, game_recording(SETTINGS, traces), width=320)

    with pytest.raises(InputError, match=r"there is no folder .*nowhere; make it first"):
        write(tmp_path / "nowhere" / f"v.{suffix}")
    folder = tmp_path / f"folder.{suffix}"
    folder.mkdir()
    with pytest.raises(InputError, match="it is a folder"):
        write(folder)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=rf"cannot write .*v\.{suffix}: Not a directory"):
        write(tmp_path / "file" / f"v.{suffix}")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", f"folder.{suffix}"]


def test_a_stop_half_way_keeps_the_file_of_before(tmp_path: Path, traces: list[Trace]) -> None:
    (tmp_path / "t.csv").write_text("before")
    broken = dataclasses.replace(traces[1], skills=np.full_like(traces[1].skills, 99))
    with pytest.raises(IndexError):
        write_trace(tmp_path / "t.csv", game_recording(SETTINGS, [traces[0], broken]))
    assert (tmp_path / "t.csv").read_text() == "before"
    assert len(list(tmp_path.iterdir())) == 1


def test_impossible_wishes_are_refused(tmp_path: Path, traces: list[Trace]) -> None:
    for wishes, message in (
        ({"width": 10}, "a width from 160 to 3840 px, got 10"),
        ({"fps": 0.0}, "1 to 240 frames a second, got 0"),
    ):
        with pytest.raises(InputError, match=message):
            write_video(tmp_path / "v.mp4", game_recording(SETTINGS, traces), **wishes)
    with pytest.raises(InputError, match="at least one game"):
        write_video(tmp_path / "v.html", game_recording(SETTINGS, []))
