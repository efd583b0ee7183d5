"""Played games kept for people and programs: as a table, a digest, pictures, a video, an offline web page."""

from coevo.replay.frame import draw_frame, frame_size
from coevo.replay.table import trace_digest, write_trace
from coevo.replay.video import write_video

__all__ = ["draw_frame", "frame_size", "trace_digest", "write_trace", "write_video"]
