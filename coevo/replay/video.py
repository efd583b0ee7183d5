"""Games as a video, an animation or a web page, by the suffix of the file."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from coevo.errors import InputError
from coevo.replay.files import whole_file
from coevo.replay.frame import Painter, frame_size
from coevo.replay.page import make_page

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from coevo.replay.recording import Recording

__all__ = ["check_video", "write_video"]

# MPEG-4 plays in every desktop player and encodes 20 times faster than VP9; for browsers there is the page.
_CODEC = "mp4v"
_HOLD_S = 0.8  # the last frame of a game stands so long
_GIF_STRIDE = 3
_GIF_FRAMES = 600  # more than a minute; OpenCV wants all of them in memory
_GIF_LONGEST_MS = 100
_WIDTHS = range(160, 3841)
_RATES = range(1, 241)


class _Moment(NamedTuple):
    """A frame to draw: game, step of it, and whether it is the game's last."""

    game: int
    step: int
    last: bool


def check_video(path: Path) -> None:
    """Refuse a file that cannot become a video, before anything is done for it.

    Raises:
        InputError: its suffix is unknown, or there is no folder for it.
    """
    if path.suffix.lower() not in _WRITERS:
        raise InputError(f"expected a video file ending in {', '.join(_WRITERS)}, got {path.name}")
    if not path.parent.exists():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first")


def write_video(
    path: str | Path,
    recording: Recording,
    *,
    fps: float = 30.0,
    width: int | None = None,
) -> None:
    """Write games as ``.mp4`` (video), ``.gif`` (animation) or ``.html`` (one offline page that plays them).

    A GIF shows every third step; games that would need more than about 600 frames are shown in time lapse.

    Args:
        path: the file to write, whole or not at all; its suffix decides.
        recording: at least one game or trial.
        fps: frames a second of an MP4, in real time.
        width: of the picture [px]: 720 unless told, 480 for a GIF; a page takes the width it finds.

    Raises:
        InputError: the suffix is unknown, the file cannot be written, or this OpenCV cannot write the format.
    """
    path = Path(path)
    check_video(path)
    if not recording.takes:
        raise InputError("expected at least one game to show, got none")
    if width is not None and width not in _WIDTHS:
        raise InputError(f"expected a width from {_WIDTHS[0]} to {_WIDTHS[-1]} px, got {width}")
    if not _RATES[0] <= fps <= _RATES[-1]:
        raise InputError(f"expected {_RATES[0]} to {_RATES[-1]} frames a second, got {fps:g}")
    _WRITERS[path.suffix.lower()](path, recording, fps, width)


def _write_page(path: Path, recording: Recording, _fps: float, _width: int | None) -> None:
    page = make_page(recording)
    with whole_file(path) as partial:
        partial.write_text(page, encoding="utf-8")


def _write_mp4(path: Path, recording: Recording, fps: float, width: int | None) -> None:
    size = frame_size(recording.world, width or 720)
    moments = list(_moments(recording, 1.0 / (fps * recording.world.physics.step_s)))
    hold = round(_HOLD_S * fps)
    with whole_file(path) as partial:
        writer = _open_writer(partial, fps, size)
        try:
            for moment, frame in zip(moments, _frames(recording, moments, size), strict=True):
                for _ in range(1 + hold * moment.last):
                    writer.write(frame)
        finally:
            writer.release()
        written, expected = _count_frames(partial), len(moments) + hold * len(recording.takes)
        if written != expected:  # OpenCV's writer reports nothing, not even a full disk
            raise InputError(
                f"cannot write {path}: {written} of {expected} frames arrived; is there space on the disk?"
            )


def _open_writer(path: Path, fps: float, size: tuple[int, int]) -> cv2.VideoWriter:
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*_CODEC), fps, size)
    if writer.isOpened():
        return writer
    raise InputError(
        f"OpenCV {cv2.__version__} writes no MP4 here; install the wheel opencv-python-headless, or write .html or .gif"
    )


def _count_frames(path: Path) -> int:
    reader = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        return int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
    finally:
        reader.release()


def _write_gif(path: Path, recording: Recording, _fps: float, width: int | None) -> None:
    if not hasattr(cv2, "imencodeanimation"):
        raise InputError(
            f"OpenCV {cv2.__version__} writes no GIF;"
            " install opencv-python-headless 4.12 or newer, or write .html or .mp4"
        )
    size = frame_size(recording.world, width or 480)
    steps = sum(len(trace.skills) for trace in recording.traces)
    stride = max(_GIF_STRIDE, math.ceil(steps / _GIF_FRAMES))
    moments = list(_moments(recording, stride))
    pause = round(min(1000.0 * stride * recording.world.physics.step_s, _GIF_LONGEST_MS))
    # Dithered flat colours look like noise and take seven times the space.
    quality = [cv2.IMWRITE_GIF_QUALITY, cv2.IMWRITE_GIF_FAST_NO_DITHER]
    animation = cv2.Animation()
    animation.frames = list(_frames(recording, moments, size))
    animation.durations = [pause + round(1000.0 * _HOLD_S) * moment.last for moment in moments]
    with whole_file(path) as partial:
        done, data = cv2.imencodeanimation(".gif", animation, quality)
        if not done:
            raise InputError(f"OpenCV {cv2.__version__} could not make the GIF; write .html or .mp4 instead")
        partial.write_bytes(data.tobytes())


def _moments(recording: Recording, stride: float) -> Iterator[_Moment]:
    """Yield the moments to draw, ``stride`` steps apart, with the first and the last state of each game."""
    for game, trace in enumerate(recording.traces):
        last = len(trace.skills)
        for count in itertools.count():
            step = math.floor(count * stride + 1e-9)
            if step >= last:
                break
            yield _Moment(game, step, last=False)
        yield _Moment(game, last, last=True)


def _frames(recording: Recording, moments: Sequence[_Moment], size: tuple[int, int]) -> Iterator[NDArray[np.uint8]]:
    painter = Painter(recording, size)
    scores = recording.score_before()
    for game, step, last in moments:
        take = recording.takes[game]
        chosen, steps = recording.chosen(take.trace), len(take.trace.skills)
        now = chosen[min(step, steps - 1)] if steps else np.full(len(recording.actors), -1)
        one, two = scores[game + last]
        left = f"{take.title}   {recording.sides[0]} {one} : {two} {recording.sides[1]}"
        if last:
            left += f"   {take.ending}"
        right = f"step {step}/{steps}   {step * recording.world.physics.step_s:.1f} s"
        yield painter.draw(take.trace.states[step], now, (left, right))


_WRITERS = {".mp4": _write_mp4, ".gif": _write_gif, ".html": _write_page}
