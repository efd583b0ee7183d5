"""A world that is thrown away is freed without harm, whenever the garbage collector runs."""

from __future__ import annotations

import subprocess
import sys

import pytest

# The collector may run at any line of pymunk's freeing of a space. Here it does, at each in turn.
DROP = """
import gc, sys

from coevo.config import WorldSettings
from coevo.soccer.world import World

def drop(collect_at):
    lines = 0

    def trace(frame, event, argument):
        nonlocal lines
        if frame.f_code.co_name != "spacefree" and not frame.f_code.co_name.startswith("ext_cpSpace"):
            return None
        if event == "line":
            lines += 1
            if lines == collect_at:
                gc.collect()
        return trace

    world = World(WorldSettings(), 3)
    sys.settrace(trace)
    del world
    sys.settrace(None)
    return lines

gc.disable()
steps = drop(0)
assert steps > 50, f"pymunk frees a space in another way now: {steps} lines"
for step in range(1, steps + 1):
    drop(step)
"""
AROUND = """
import gc, threading

from coevo.config import WorldSettings
from coevo.soccer.world import World

gc.set_threshold(50, 2, 2)

def drop_many():
    for _ in range(50):
        one, other = World(WorldSettings(), 2), World(WorldSettings(), 1)
        one.other, other.other = other, one

threads = [threading.Thread(target=drop_many) for _ in range(3)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
left_to_the_exit = [World(WorldSettings(), 3) for _ in range(3)]
"""


@pytest.mark.parametrize("program", [DROP, AROUND], ids=["at every line", "in cycles, threads and at exit"])
@pytest.mark.slow
def test_a_garbage_collection_while_a_world_is_freed_does_no_harm(program):
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)  # noqa: S603
    assert (done.returncode, done.stderr) == (0, "")
