"""What happens in a game of the plain loop, counted from positions alone, and what becomes of a ball that is stuck."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coevo.config import RunSettings
from coevo.soccer.world import World

__all__ = ["PlainReferee"]


class PlainReferee:
    """Counts what happens in each substep, from positions alone."""

    def __init__(self, settings: RunSettings, teams: NDArray[np.int64]) -> None:
        self._settings, self._teams = settings, teams
        robots = len(teams)
        self.kicks, self.collisions, self.passes, self.own_goals = (np.zeros(robots, np.int64) for _ in range(4))
        self._touching: set[tuple[int, int]] = set()
        self._had_ball: set[int] = set()
        self._last, self._at = -1, 0
        self._spot, self._spot_at = (math.inf, math.inf), 0

    def step(self, world: World, commands: Any, time: int) -> int:
        """Move the world on, count, and return the team that scored, or -1."""
        settings = self._settings
        gaps: list[dict[tuple[int, int], float]] = []
        world.step(commands, after_substep=lambda: gaps.append(self._gaps(world)))
        gap = {pair: min(step[pair] for step in gaps) for pair in gaps[0]}
        robots = len(self._teams)
        contact = settings.world.physics.contact_gap_m
        window = round(settings.world.rules.pass_window_s / settings.world.physics.step_s)
        at_ball = {robot for robot in range(robots) if gap[robot, robots] <= contact}
        for robot in sorted(at_ball):
            self.kicks[robot] += 1
            last = self._last
            mate = last >= 0 and last != robot and self._teams[last] == self._teams[robot]
            comes = robot not in self._had_ball and last not in at_ball
            if mate and comes and time - self._at <= window:
                self.passes[last] += 1
            self._last, self._at = robot, time
        self._had_ball = at_ball
        for one, two in ((i, j) for i in range(robots) for j in range(i)):
            if gap[two, one] <= contact:
                if (one, two) not in self._touching:
                    self._touching.add((one, two))
                    self.collisions[[one, two]] += 1
            elif gap[two, one] > settings.world.rules.collision_release_m:
                self._touching.discard((one, two))
        x = world.ball.position.x
        scorer = 0 if x > settings.world.field.length_m else 1 if x < 0.0 else -1
        if self._last >= 0 and self._teams[self._last] == 1 - scorer:
            self.own_goals[self._last] += 1
        if settings.world.rules.stuck_after_s > 0.0 and scorer < 0:
            self._drop_if_stuck(world, time)
        return scorer

    def _drop_if_stuck(self, world: World, time: int) -> None:
        """Put a ball that does not move on at mid-width, clear of the robots."""
        rules, physics = self._settings.world.rules, self._settings.world.physics
        field, position = self._settings.world.field, world.ball.position
        if math.dist(position, self._spot) > rules.stuck_within_m:
            self._spot, self._spot_at = (position.x, position.y), time
        elif (time - self._spot_at) * physics.step_s >= rules.stuck_after_s - 1e-9:
            off = min(rules.stuck_off_goals_m, 0.5 * field.length_m)
            x, middle = min(max(position.x, off), field.length_m - off), 0.5 * field.width_m
            apart = self._settings.world.robot.radius_m + self._settings.world.ball.radius_m + 0.05
            aside = range(1, int((middle - self._settings.world.ball.radius_m) / 0.1) + 1)
            places = [middle, *(middle + side * 0.1 * k for k in aside for side in (1, -1))]
            free = (y for y in places if all(math.dist(body.position, (x, y)) >= apart for body in world.robots))
            self._spot, self._spot_at = (x, next(free, middle)), time
            world.ball.position, world.ball.angle = self._spot, 0.0
            world.ball.velocity, world.ball.angular_velocity = (0.0, 0.0), 0.0
            self._last, self._had_ball = -1, set()

    def _gaps(self, world: World) -> dict[tuple[int, int], float]:
        bodies = [(body.position, self._settings.world.robot.radius_m) for body in world.robots]
        bodies.append((world.ball.position, self._settings.world.ball.radius_m))
        return {
            (i, j): math.hypot(p.x - q.x, p.y - q.y) - a - b
            for j, (q, b) in enumerate(bodies)
            for i, (p, a) in enumerate(bodies[:j])
        }
