"""The world in motion: compiled against plain pymunk bit for bit, and walls that hold."""

from __future__ import annotations

import functools
import math

import msgspec
import numpy as np
import pymunk
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coevo.config import BallSettings, FieldSettings, PhysicsSettings, RobotSettings, WorldSettings
from coevo.soccer.drive import action_set
from coevo.soccer.field import walls
from coevo.soccer.physics import physics_params, replay
from coevo.soccer.world import World

WORLD = WorldSettings()
changed = functools.partial(msgspec.structs.replace, WORLD)
DRIVES = ("pws", "4ws")
TEAMS = (2, 3)  # robots in a game
GAMES, STEPS = 60, 90  # for each drive and number of robots
TOUCH = 0.003  # bodies nearer than this are in contact, in the states between steps


def wall_gaps(world, places, radius):
    """Return (places, walls): gap between discs and each wall of the field."""
    ends = np.array([(*wall.start, *wall.end) for wall in walls(world.field)])
    start, along = ends[:, :2], ends[:, 2:] - ends[:, :2]
    offset = places[:, None] - start
    share = np.clip((offset * along).sum(-1) / (along * along).sum(-1), 0.0, 1.0)
    nearest = start + share[..., None] * along
    return np.hypot(*np.moveaxis(places[:, None] - nearest, -1, 0)) - 0.5 * world.field.wall_thickness_m - radius


def crowded_start(world, robots, rng):
    """Return a state with all bodies close together, at a wall, in a corner, at a goal or anywhere; some in motion."""
    field = world.field
    spots = [(x, y) for x in (0.0, field.length_m) for y in (0.0, field.width_m)] * 2  # corners are narrow
    spots += [(0.0, 0.5 * field.width_m), (field.length_m, 0.5 * field.width_m), (4.0, 0.0), (4.0, 2.3)]
    spot = np.array(spots[rng.integers(len(spots))])
    radii = [world.robot.radius_m] * robots + [world.ball.radius_m]
    state = np.zeros((robots + 1, 6))
    for body, radius in enumerate(radii):
        while True:
            place = spot + rng.normal(0.0, 0.45, 2)
            apart = np.hypot(*(state[:body, :2] - place).T) - radii[:body] - radius
            inside = 0.0 < place[0] < field.length_m and 0.0 < place[1] < field.width_m
            if inside and np.all(apart > 0.001) and wall_gaps(world, place[None], radius).min() > 0.001:
                break
        state[body] = *place, rng.uniform(-9.0, 9.0), *rng.normal(0.0, 0.5, 2), rng.normal()
    if rng.random() < 0.5:
        state[:, 3:] = 0.0
    return state


def wild_commands(world, robots, steps, rng):
    """Return random actions of the drive, each held for a while, most of them forwards."""
    commands = action_set(world.robot).commands
    forwards = np.flatnonzero(commands[:, 0] > 0.0)
    orders = np.zeros((steps, robots, 2))
    for robot in range(robots):
        step = 0
        while step < steps:
            duration = int(rng.integers(3, 25))
            action = rng.choice(forwards) if rng.random() < 0.6 else rng.integers(len(commands))
            orders[step : step + duration, robot] = commands[action]
            step += duration
    return orders


def built(world, start):
    """Return a World whose Space was made by hand, each body where it starts."""
    mover = World(world, len(start) - 1)
    space, half = pymunk.Space(), 0.5 * world.field.wall_thickness_m
    space.iterations, space.collision_slop = world.physics.iterations, world.physics.collision_slop_m
    for wall in walls(world.field):
        shape = pymunk.Segment(space.static_body, wall.start, wall.end, half)
        shape.elasticity, shape.friction = world.field.wall_elasticity, world.field.wall_friction
        space.add(shape)
    bodies = []
    for (x, y, heading, vx, vy, turn), kind in zip(start, [world.robot] * (len(start) - 1) + [world.ball], strict=True):
        body = pymunk.Body(kind.mass_kg, 0.5 * kind.mass_kg * kind.radius_m**2)
        body.position, body.angle, body.velocity, body.angular_velocity = (x, y), heading, (vx, vy), turn
        shape = pymunk.Circle(body, kind.radius_m)
        shape.elasticity, shape.friction = kind.elasticity, kind.friction
        space.add(body, shape)
        bodies.append(body)
    mover.space, mover.bodies, mover.robots, mover.ball = space, bodies, bodies[:-1], bodies[-1]
    return mover


def placed(world, start):
    """Return a new World with its bodies put where they start."""
    mover = World(world, len(start) - 1)
    mover.place(start)
    return mover


def plainly(mover, commands):
    """Return the states after each step, by pymunk's own methods."""
    states = []
    for order in commands:
        mover.step(order)
        states.append(mover.state)
    return np.array(states)


@pytest.fixture(scope="module")
def games():
    """Return, for each drive and number of robots, the world and games (start, commands, plain states)."""
    rng = np.random.default_rng(3)
    found = {}
    for drive in DRIVES:
        world = changed(robot=RobotSettings(drive=drive))
        for robots in TEAMS:
            played = []
            for _ in range(GAMES):
                start, commands = crowded_start(world, robots, rng), wild_commands(world, robots, STEPS, rng)
                played.append((start, commands, plainly(built(world, start), commands)))
            found[drive, robots] = world, played
    return found


def test_the_games_have_contacts_of_all_kinds(games):
    # Without these, equality below would prove little.
    seen = dict.fromkeys(("ball-robot", "robot-robot", "ball-wall", "robot-wall", "ball-panel", "robot-panel"), 0)
    for (_, robots), (world, played) in games.items():
        for _, _, states in played:
            places = states[:, :, :2]
            radii = np.array([world.robot.radius_m] * robots + [world.ball.radius_m])
            for body in range(robots + 1):
                what = "ball" if body == robots else "robot"
                near = wall_gaps(world, places[:, body], radii[body]) < TOUCH
                panels = len(walls(world.field)) - 4
                seen[f"{what}-wall"] += int(near[:, :panels].any())
                seen[f"{what}-panel"] += int(near[:, panels:].any())
                for other in range(body):
                    apart = np.hypot(*(places[:, body] - places[:, other]).T) - radii[body] - radii[other]
                    seen["ball-robot" if body == robots else "robot-robot"] += int((apart < TOUCH).any())
    assert min(seen.values()) >= 20, seen


def test_nothing_leaves_the_field_in_them(games):
    for world, played in games.values():
        for _, _, states in played:
            assert not escaped(world, states[:, :, :2]).any()


@pytest.mark.parametrize("robots", TEAMS)
@pytest.mark.parametrize("drive", DRIVES)
def test_compiled_games_are_plain_games_bit_for_bit_in_any_order_on_one_space(games, drive, robots):
    world, played = games[drive, robots]
    mover, params = World(world, robots), physics_params(world)
    rng = np.random.default_rng(4)
    orders = [
        np.arange(GAMES),
        np.arange(GAMES)[::-1],
        rng.permutation(GAMES),
        np.repeat(rng.permutation(GAMES)[:9], 2),
    ]
    for game in np.concatenate(orders):
        start, commands, expected = played[game]
        states = np.full(expected.shape, np.nan)
        replay(mover.handles, params, start, commands, states)
        assert states.tobytes() == expected.tobytes(), game


@pytest.mark.parametrize("robots", TEAMS)
@pytest.mark.parametrize("drive", DRIVES)
def test_a_new_world_plays_the_same_games_bit_for_bit(games, drive, robots):
    world, played = games[drive, robots]
    different = [
        game
        for game, (start, commands, expected) in enumerate(played)
        if plainly(placed(world, start), commands).tobytes() != expected.tobytes()
    ]
    assert different == []


def test_a_game_cut_short_leaves_nothing_behind(games):
    world, played = games["pws", 3]
    mover, params = World(world, 3), physics_params(world)
    for game in range(1, GAMES):
        start, commands, _ = played[game - 1]
        cut = game % STEPS  # in the middle of contacts
        replay(mover.handles, params, start, commands[:cut], np.empty((cut, 4, 6)))
        start, commands, expected = played[game]
        states = np.empty(expected.shape)
        replay(mover.handles, params, start, commands, states)
        assert states.tobytes() == expected.tobytes()


@pytest.mark.parametrize("substeps", [1, 5])
def test_compiled_and_plain_agree_with_other_settings(substeps):
    world = changed(
        field=FieldSettings(corner_panels=False, length_m=5.0, goal_width_m=1.1, wall_thickness_m=0.3),
        ball=BallSettings(radius_m=0.11, mass_kg=0.43, elasticity=0.9),
        robot=RobotSettings(radius_m=0.15, mass_kg=3.0, max_speed_mps=2.0),
        physics=PhysicsSettings(substeps=substeps, step_s=0.05, iterations=4),
    )
    rng = np.random.default_rng(5)
    mover = World(world, 4)
    for _ in range(8):
        start, commands = crowded_start(world, 4, rng), wild_commands(world, 4, 60, rng)
        states = np.empty((60, 5, 6))
        replay(mover.handles, physics_params(world), start, commands, states)
        assert states.tobytes() == plainly(built(world, start), commands).tobytes()


# --------------------------------------------------------------------------------------------------------------- walls


@pytest.mark.parametrize("heading", [0.0, 0.3, 1.2, math.pi / 2, 2.0, math.pi, -2.4, -math.pi / 2, -0.8])
def test_a_robot_does_not_push_through_a_wall(heading, rolled, at_rest, held):
    states = rolled(WORLD, at_rest((4.0, 0.8, heading), (1.0, 4.3, 0.0)), held((1.0, 0.0), 900))
    gaps = wall_gaps(WORLD, states[:, 0, :2], WORLD.robot.radius_m).min(axis=1)
    substep, slop = WORLD.physics.step_s / 2, WORLD.physics.collision_slop_m
    assert gaps.min() < 0.0  # it got there
    assert gaps.min() >= -1.0 * substep - slop  # at most one substep deep before the wall was noticed
    # Then each substep its drive moves it in by a dt^2, and Chipmunk takes back a tenth of the overlap.
    assert gaps[-300:].min() >= -WORLD.robot.max_acceleration_mps2 * substep**2 / 0.1 - slop
    assert not escaped(WORLD, states[:, 0, :2]).any()


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_a_robot_that_pushes_another_does_not_push_it_through_a_wall(turn, rolled, at_rest, held):
    start = at_rest((6.0, 0.9, 0.0), (7.0, 0.9, 0.0), (7.6, 0.9, 0.0))
    states = rolled(WORLD, start, np.stack([held((1.0, 0.0), 600)[:, 0], held((0.0, turn), 600)[:, 0]], axis=1))
    for body, radius in ((0, 0.2), (1, 0.2), (2, WORLD.ball.radius_m)):
        assert wall_gaps(WORLD, states[:, body, :2], radius).min() > -0.02


def escaped(world, places):
    """Return (...) bool: which centres are neither on the field nor in a goal box."""
    field = world.field
    x, y = places[..., 0], places[..., 1]
    low, high = 0.5 * (field.width_m - field.goal_width_m), 0.5 * (field.width_m + field.goal_width_m)
    on_field = (x >= 0.0) & (x <= field.length_m) & (y >= 0.0) & (y <= field.width_m)
    if field.corner_panels:
        right, top = np.minimum(x, field.length_m - x), np.minimum(y, field.width_m - y)
        on_field &= right + top >= field.corner_panel_m
    depth = field.goal_depth_m
    in_goal = (x >= -depth) & (x <= field.length_m + depth) & (y >= low) & (y <= high)
    return ~(on_field | in_goal)


def rush(world, state, rng, robots):
    """Return commands at full speed: at the ball, at another robot, along the push against walls, or blindly."""
    commands, fastest = np.zeros((robots, 2)), world.robot.max_speed_mps
    for robot in range(robots):
        aim = state[rng.integers(robots + 1), :2] if rng.random() < 0.3 else state[robots, :2]
        ahead = math.atan2(aim[1] - state[robot, 1], aim[0] - state[robot, 0]) - state[robot, 2]
        ahead = math.remainder(ahead, 2.0 * math.pi)
        commands[robot] = fastest, np.clip(6.0 * ahead, -1.0, 1.0) * math.radians(world.robot.max_turn_rate_dps)
        if rng.random() < 0.15:
            commands[robot] = action_set(world.robot).commands[rng.integers(9)]
    return commands


@pytest.mark.parametrize(
    ("world", "games"),
    [
        (WORLD, 300),
        (changed(field=FieldSettings(corner_panels=False)), 300),
        (changed(robot=RobotSettings(max_speed_mps=3.0, max_turn_rate_dps=720.0)), 100),
    ],
    ids=["with panels", "without panels", "three times as fast"],
)
def test_nothing_ever_leaves_the_field_but_into_a_goal(world, games):
    assert world.physics.substeps == 2
    rng = np.random.default_rng(6)
    tunnelled, in_goal, at_walls, robots = 0, 0, 0, 3
    mover, params, chunk = World(world, robots), physics_params(world), 10
    radii = np.array([world.robot.radius_m] * robots + [world.ball.radius_m])
    for _ in range(games):
        state = crowded_start(world, robots, rng)
        state[robots, 3:5] *= 4.0
        for _ in range(25):
            commands = np.tile(rush(world, state, rng, robots), (chunk, 1, 1))
            states = np.empty((chunk, robots + 1, 6))
            replay(mover.handles, params, state, commands, states)
            state = states[-1].copy()
            tunnelled += int(escaped(world, states[:, :, :2]).sum())
            in_goal += int(np.any((states[:, :, 0] < 0.0) | (states[:, :, 0] > world.field.length_m)))
            for body in range(robots + 1):
                at_walls += int(wall_gaps(world, states[:, body, :2], radii[body]).min() < TOUCH)
    assert at_walls > 10 * games  # what was tried
    assert in_goal > games // 10
    assert tunnelled == 0


def field_or_none(**settings: object) -> FieldSettings | None:
    """Return the field, None if its goals do not fit."""
    try:
        return FieldSettings(**settings)
    except ValueError:
        return None


fields = st.builds(
    field_or_none,
    length_m=st.floats(3.0, 20.0),
    width_m=st.floats(3.0, 10.0),
    goal_width_m=st.floats(0.5, 2.2),
    goal_depth_m=st.floats(0.3, 2.0),
    corner_panel_m=st.floats(0.05, 0.39),
    wall_thickness_m=st.floats(0.2, 2.0),
    corner_panels=st.booleans(),
).filter(lambda field: field is not None)


@given(fields, st.floats(0.0, 1.0))
@example(FieldSettings(length_m=3.0, width_m=3.0, goal_width_m=1.95, corner_panel_m=0.375, wall_thickness_m=1.0), 0.5)
def test_walls_bound_the_field_and_leave_mouths_as_wide_as_a_goal(field, share):
    world = World(changed(field=field), 0)
    space = world.space
    space.remove(world.ball, *world.ball.shapes)
    wide, middle = field.length_m, 0.5 * field.width_m
    half = 0.5 * field.wall_thickness_m
    everything = pymunk.ShapeFilter()

    def hit(start, end):
        found = space.segment_query_first(start, end, 0.0, everything)
        return None if found is None else found.point

    far = 100.0
    for line, outwards in ((0.0, -1.0), (wide, 1.0)):
        # Across the mouth, from the tip of the posts to the back of the box; the box is thin for thick walls.
        x = line + outwards * (half + 0.99 * share * (field.goal_depth_m - half)) if half < field.goal_depth_m else None
        if x is not None:
            up, down = hit((x, middle), (x, far)), hit((x, middle), (x, -far))
            assert up.y - down.y == pytest.approx(field.goal_width_m, abs=1e-9)
            assert up.y + down.y == pytest.approx(field.width_m, abs=1e-9)
        # Straight through the mouth, the box ends at its depth.
        back = hit((0.5 * wide, middle), (line + outwards * far, middle))
        assert abs(back.x - line) == pytest.approx(field.goal_depth_m, abs=1e-9)
        assert (back.x - line) * outwards > 0.0
        # Beside the mouth the wall's face is the goal line.
        beside = 0.5 * (field.width_m + field.goal_width_m) + half
        beside += share * max(0.0, field.width_m - field.corner_panel_m - beside)
        if beside <= field.width_m - field.corner_panel_m:
            assert hit((0.5 * wide, beside), (line + outwards * far, beside)).x == pytest.approx(line, abs=1e-9)
    for end, face in ((-far, 0.0), (far, field.width_m)):
        x = field.corner_panel_m + share * (wide - 2.0 * field.corner_panel_m)
        assert hit((x, middle), (x, end)).y == pytest.approx(face, abs=1e-9)
    # Into a corner: half the panel's cut from both walls, or all the way.
    stop = 0.5 * field.corner_panel_m if field.corner_panels else 0.0
    for corner_x, inwards_x in ((0.0, 1.0), (wide, -1.0)):
        for corner_y, inwards_y in ((0.0, 1.0), (field.width_m, -1.0)):
            start = corner_x + inwards_x * 0.4, corner_y + inwards_y * 0.4
            found = hit(start, (corner_x - inwards_x * 0.1, corner_y - inwards_y * 0.1))
            assert found.x == pytest.approx(corner_x + inwards_x * stop, abs=1e-9)
            assert found.y == pytest.approx(corner_y + inwards_y * stop, abs=1e-9)
