"""Games and trials kept for people and programs: as a table, a digest, pictures, a video, an offline web page."""

from coevo.replay.frame import draw_frame, frame_size
from coevo.replay.page import make_page
from coevo.replay.recording import Actor, Recording, Take, game_recording
from coevo.replay.table import trace_digest, write_trace
from coevo.replay.video import check_video, write_video

__all__ = [
    "Actor",
    "Recording",
    "Take",
    "check_video",
    "draw_frame",
    "frame_size",
    "game_recording",
    "make_page",
    "trace_digest",
    "write_trace",
    "write_video",
]
