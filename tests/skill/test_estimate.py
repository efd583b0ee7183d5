"""What a robot remembers, and the state it makes of it: against the formulas written out over whole stories."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from coevo.skill import ObjectModel, Skill, make_bank
from coevo.skill.estimate import discrete_state, forget, make_memory, remember, sees_what_it_needs
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, FEATURES, OPPONENT_GOAL, OWN_GOAL, ROBOTS

MIDDLE = 32.0
FIXED = {"ball": BALL, "own_goal": OWN_GOAL, "opponent_goal": OPPONENT_GOAL}


def model(rng, kind, order, length, lost=2):
    past = length * (2 + OBJECT_KINDS[kind])
    matrix = rng.normal(0.0, 0.02, (order, past))
    return ObjectModel(kind, length, matrix, rng.normal(30.0, 5.0, past), rng.uniform(0.3, 1.2), lost)


def skill(*models, actions=9):
    states = int(np.prod([3**m.order + m.lost_states for m in models]))
    return Skill("any", "pws", models, np.zeros((states, actions), np.float32), 1, 1)


def bank_of(*skills):
    return make_bank(skills, drive="pws", actions=9)


# ------------------------------------------------------------------------------------ the same, by definitions alone


@dataclasses.dataclass
class Story:
    """All that one robot saw and did: a row a step.

    actions: (steps, 2), what led to each image. features: (steps, objects, 11). areas: (steps, objects).
    """

    actions: np.ndarray
    features: np.ndarray
    areas: np.ndarray
    mate: int

    def object_at(self, kind, time):
        """Return the number of the object that ``kind`` means at a time, -1 for none."""
        if kind == "mate":
            return self.mate
        if kind != "robot":
            return FIXED[kind]
        others = self.areas[time, ROBOTS:]
        return ROBOTS + int(np.argmax(others)) if len(others) and others.max() > 0.0 else -1

    def sight(self, kind, time):
        """Return the features of an object at a time, None if it was not visible."""
        thing = self.object_at(kind, time)
        return None if thing < 0 or self.areas[time, thing] <= 0.0 else self.features[time, thing]

    def past(self, kind, time, length):
        """Return the last observations, newest first; before it came into view, the first that was made."""
        thing, seen = self.object_at(kind, time), []
        while time >= 0 and self.sight(kind, time) is not None and self.object_at(kind, time) == thing:
            seen.append(self.sight(kind, time))
            time -= 1
        return [seen[min(back, len(seen) - 1)] for back in range(length)]

    def side(self, kind, time):
        """Return where the object was seen last: 0 left, 1 right."""
        while time >= 0:
            if self.sight(kind, time) is not None:
                return int(self.sight(kind, time)[0] >= MIDDLE)
            time -= 1
        return 0

    def object_state(self, one, time):
        if self.sight(one.kind, time) is None:
            told_apart = one.lost_states == 2 and (self.mate >= 0 or one.kind != "mate")
            return 3**one.order + (self.side(one.kind, time) if told_apart else 0)
        features = OBJECT_KINDS[one.kind]
        actions = [self.actions[time - back] if time >= back else np.zeros(2) for back in range(one.history_length)]
        outputs = [row[:features] for row in self.past(one.kind, time, one.history_length)]
        p = np.concatenate([*actions, *outputs])
        x = one.memory_matrix @ (p - one.past_mean)  # (A.9)
        cells = [0 if value < -one.cell else 1 if value < one.cell else 2 for value in x]  # (3.9)
        return sum(3**j * cell for j, cell in enumerate(cells))

    def state(self, which, time):
        number = 0
        for one in which.objects:
            number = number * (3**one.order + one.lost_states) + self.object_state(one, time)
        return number


def story(rng, steps, robots, mate):
    """Return a random story in which objects come and go."""
    objects = ROBOTS + robots - 1
    features = rng.uniform(0.0, 64.0, (steps, objects, FEATURES))
    areas = np.zeros((steps, objects))
    for thing in range(objects):
        time, visible = 0, rng.random() < 0.5
        while time < steps:
            duration = int(rng.integers(1, 7))
            if visible:
                areas[time : time + duration, thing] = rng.uniform(1.0, 300.0, len(areas[time : time + duration]))
            time, visible = time + duration, not visible
    codes = np.array([(v, s) for v in (-1.0, 0.0, 1.0) for s in (-1.0, 0.0, 1.0)])
    actions = codes[rng.integers(0, 9, steps)]
    actions[0] = 0.0
    return Story(actions, features, areas, mate)


def tell(memory, bank, robot, told, time):
    """Let a robot see and remember one step of a story."""
    objects = told.areas.shape[1]
    memory.features[robot, :objects] = told.features[time]
    memory.areas[robot, :objects] = told.areas[time]
    remember(memory, bank, robot, time, told.actions[time], MIDDLE)


@pytest.mark.parametrize(("robots", "mates"), [(1, [-1]), (2, [1, 0]), (3, [1, 0, -1]), (4, [2, -1, 0, -1])])
def test_states_are_those_of_the_definitions_over_whole_stories(robots, mates):
    rng = np.random.default_rng(robots)
    visited = set()
    for _ in range(6):
        skills = [
            skill(model(rng, "ball", 2, 3), model(rng, "opponent_goal", 2, 1)),
            skill(model(rng, "mate", 3, 2), model(rng, "ball", 1, 1, lost=1), model(rng, "own_goal", 1, 4)),
            skill(model(rng, "robot", 3, 4, lost=1)),
            skill(model(rng, "ball", 3, 2), model(rng, "robot", 1, 1)),
        ]
        bank = bank_of(*skills)
        memory = make_memory(bank, mates)
        for game in range(2):  # one after the other in the same memory
            forget(memory)
            seen_as = [-1 if m < 0 else ROBOTS + m - int(m > r) for r, m in enumerate(mates)]
            told = [story(rng, 40, robots, mate) for mate in seen_as]
            for time in range(40):
                for robot in range(robots):
                    tell(memory, bank, robot, told[robot], time)
                    for s, which in enumerate(skills):
                        number = discrete_state(memory, bank, s, robot, time)
                        assert number == told[robot].state(which, time), (game, time, robot, s)
                        visited.add((s, number))
    assert len(visited) > 100  # the stories were not all the same


def test_the_skills_of_one_bank_do_not_need_the_same_history():
    # A long memory of one skill must not show in the state of another.
    rng = np.random.default_rng(5)
    short, long = skill(model(rng, "ball", 2, 1)), skill(model(rng, "ball", 2, 5))
    told = story(rng, 60, 1, -1)
    alone, both = bank_of(short), bank_of(short, long)
    memory_alone, memory_both = make_memory(alone, [-1]), make_memory(both, [-1])
    forget(memory_alone)
    forget(memory_both)
    for time in range(60):
        tell(memory_alone, alone, 0, told, time)
        tell(memory_both, both, 0, told, time)
        assert discrete_state(memory_alone, alone, 0, 0, time) == discrete_state(memory_both, both, 0, 0, time)


# -------------------------------------------------------------------------------------------------- single properties


def one_ball(matrix, length=1, cell=1.0):
    """Return a bank and a memory of one robot that looks at the ball by a given matrix, mean 0."""
    matrix = np.asarray(matrix, np.float64)
    bank = bank_of(skill(ObjectModel("ball", length, matrix, np.zeros(matrix.shape[1]), cell)))
    memory = make_memory(bank, [-1])
    forget(memory)
    return bank, memory


def show(memory, bank, time, ball=None, action=(0.0, 0.0)):
    """Show the ball's features (None: it is lost) and return the state."""
    memory.areas[0] = 0.0
    if ball is not None:
        memory.areas[0, BALL] = 5.0
        memory.features[0, BALL, : len(ball)] = ball
    remember(memory, bank, 0, time, np.array(action, np.float64), MIDDLE)
    return int(discrete_state(memory, bank, 0, 0, time))


@pytest.mark.parametrize(
    ("x", "cell"),
    [(-7.0, 0), (np.nextafter(-1.0, -2.0), 0), (-1.0, 1), (0.0, 1), (np.nextafter(1.0, 0.0), 1), (1.0, 2), (9.0, 2)],
)
def test_cells_are_closed_below_and_open_above(x, cell):
    # (3.9): (-inf, -1), [-1, 1), [1, inf)
    bank, memory = one_ball([[0, 0, 0, 1, 0, 0]])  # x is the ball's y
    assert show(memory, bank, 0, ball=(0.0, x, 0.0, 0.0)) == cell


def test_elements_of_the_state_are_digits_the_first_one_lowest():
    bank, memory = one_ball([[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0]])
    for number, digits in enumerate(np.ndindex(3, 3, 3)):
        third, second, first = (2.0 * digit - 2.0 for digit in digits)  # -2, 0, 2
        assert show(memory, bank, number, ball=(first, second, third, 0.0)) == number


def test_the_last_object_varies_fastest():
    rng = np.random.default_rng(3)
    ball, goal = model(rng, "ball", 1, 1), model(rng, "own_goal", 2, 1)
    bank = bank_of(skill(ball, goal))
    memory = make_memory(bank, [-1])
    forget(memory)
    memory.areas[0, OWN_GOAL] = 0.0
    assert show(memory, bank, 0) == 3 * 11 + 9  # both lost, never seen: the first of the lost states each


def test_a_lost_object_has_two_states_by_where_it_was_seen_last():
    bank, memory = one_ball(np.zeros((2, 6)))
    assert show(memory, bank, 0) == 9
    show(memory, bank, 1, ball=(40.0, 0.0, 0.0, 0.0))
    assert show(memory, bank, 2) == 10
    assert show(memory, bank, 3) == 10
    show(memory, bank, 4, ball=(np.nextafter(MIDDLE, 0.0), 0.0, 0.0, 0.0))
    assert show(memory, bank, 5) == 9
    show(memory, bank, 6, ball=(MIDDLE, 0.0, 0.0, 0.0))
    assert show(memory, bank, 7) == 10


def test_a_lost_object_may_have_one_state_wherever_it_was_seen_last():
    rng = np.random.default_rng(4)
    one = model(rng, "ball", 2, 1, lost=1)
    bank = bank_of(skill(one))
    memory = make_memory(bank, [-1])
    forget(memory)
    assert one.states == 10  # 3^n + 1, as (3.9) is printed
    assert show(memory, bank, 0) == 9
    for time, x in enumerate((40.0, 20.0)):
        assert show(memory, bank, 2 * time + 1, ball=(x, 0.0, 0.0, 0.0)) < 9
        assert show(memory, bank, 2 * time + 2) == 9


def test_windows_run_from_the_newest_back_actions_before_observations():
    # The state's digits show one number of the past each: u1 and u2 of steps 0 to 2 back, then y of 0 to 2 back.
    order = [0, 1, 2, 3, 4, 5, 6 + 1, 10 + 1, 14 + 1]
    seen = []
    for column in order:
        matrix = np.zeros((1, 18))
        matrix[0, column] = 1.0
        bank, memory = one_ball(matrix, length=3, cell=0.5)
        steps = [((1.0, -1.0), 5.0), ((0.0, 1.0), 0.0), ((-1.0, 0.0), -5.0), ((0.0, 1.0), 5.0)]
        for time, (action, y) in enumerate(steps):
            number = show(memory, bank, time, ball=(0.0, y, 0.0, 0.0), action=action)
        seen.append(number - 1)  # -1, 0, 1
    assert seen == [0, 1, -1, 0, 0, 1, 1, -1, 0]


def test_the_past_of_what_comes_into_view_is_its_first_sight():
    matrix = np.zeros((3, 18))
    matrix[0, 7], matrix[1, 11], matrix[2, 15] = 1.0, 1.0, 1.0  # the ball's y 0, 1 and 2 steps ago
    bank, memory = one_ball(matrix, length=3)
    low, high = (0.0, -5.0, 0.0, 0.0), (0.0, 5.0, 0.0, 0.0)
    assert show(memory, bank, 0, ball=high) == 26  # 2, 2, 2
    assert show(memory, bank, 1, ball=low) == 24  # 0, 2, 2
    assert show(memory, bank, 2, ball=low) == 18
    assert show(memory, bank, 3, ball=low) == 0
    assert show(memory, bank, 4) == 27
    assert show(memory, bank, 5, ball=high) == 26  # not a memory of the time before
    assert show(memory, bank, 6, ball=low) == 24


def test_actions_are_remembered_while_the_object_is_out_of_view():
    matrix = np.zeros((2, 18))
    matrix[0, 0], matrix[1, 2] = 1.0, 1.0  # speed code now and one step ago
    bank, memory = one_ball(matrix, length=3, cell=0.5)
    show(memory, bank, 0, action=(1.0, 0.0))
    assert show(memory, bank, 1, ball=(0.0,) * 4, action=(-1.0, 0.0)) == 0 + 3 * 2


def test_another_game_begins_without_a_past():
    bank, memory = one_ball(np.zeros((1, 12)), length=2)
    show(memory, bank, 0, ball=(50.0, 9.0, 0.0, 0.0), action=(1.0, 1.0))
    forget(memory)
    assert show(memory, bank, 0) == 3  # lost, and the right side is forgotten


def test_the_nearest_robot_is_the_largest_and_its_past_is_its_own():
    matrix = np.zeros((2, 14))
    matrix[0, 4], matrix[1, 9] = 1.0, 1.0  # x now and one step ago
    bank = bank_of(skill(ObjectModel("robot", 2, matrix, np.zeros(14), 1.0)))
    memory = make_memory(bank, [-1, -1, -1])
    forget(memory)

    def show_robots(time, first, second):
        memory.areas[0, ROBOTS : ROBOTS + 2] = first[0], second[0]
        memory.features[0, ROBOTS, 0], memory.features[0, ROBOTS + 1, 0] = first[1], second[1]
        remember(memory, bank, 0, time, np.zeros(2), MIDDLE)
        return int(discrete_state(memory, bank, 0, 0, time))

    assert show_robots(0, (10.0, -5.0), (0.0, 0.0)) == 0  # only the first: low now and before
    assert show_robots(1, (10.0, 5.0), (9.0, -5.0)) == 2 + 3 * 0
    assert show_robots(2, (8.0, 5.0), (9.0, -5.0)) == 0  # the second is larger now: as if it just came into view
    assert show_robots(3, (8.0, 5.0), (9.0, 5.0)) == 2 + 3 * 0
    assert show_robots(4, (9.5, -5.0), (9.0, 5.0)) == 0  # and back again
    assert show_robots(5, (0.0, 5.0), (0.0, 5.0)) == 9  # all lost, last seen at -5
    assert show_robots(6, (3.0, 5.0), (0.0, 5.0)) == 8  # the same robot comes into view


@pytest.mark.parametrize("mates", [[-1, -1], [1, 0]])
def test_a_robot_without_a_team_mate_never_sees_one(mates):
    bank = bank_of(skill(ObjectModel("mate", 1, np.zeros((1, 7)), np.zeros(7), 1.0)))
    memory = make_memory(bank, mates)
    forget(memory)
    memory.areas[0, ROBOTS] = 50.0
    remember(memory, bank, 0, 0, np.zeros(2), MIDDLE)
    assert discrete_state(memory, bank, 0, 0, 0) == (3 if mates[0] < 0 else 1)


# --------------------------------------------------------------------------------------------------- what a skill needs


def test_a_skill_sees_what_it_needs_where_all_of_its_domain_is_in_view():
    rng, robots, mates = np.random.default_rng(12), 3, [1, 0, -1]
    kinds = ("mate", "ball", "own_goal", "robot")
    domains = [(), ("ball",), ("mate",), ("robot",), ("own_goal", "ball"), ("robot", "mate", "ball")]
    whole = skill(*(model(rng, kind, 1, 1) for kind in kinds))
    bank = bank_of(*(dataclasses.replace(whole, domain=domain) for domain in domains))
    memory = make_memory(bank, mates)
    forget(memory)
    told = [story(rng, 60, robots, -1 if mate < 0 else ROBOTS + mate - int(mate > n)) for n, mate in enumerate(mates)]
    answers = []
    for time in range(60):
        for robot in range(robots):
            tell(memory, bank, robot, told[robot], time)
            for s, domain in enumerate(domains):
                expected = all(told[robot].sight(kind, time) is not None for kind in domain)
                assert sees_what_it_needs(memory, bank, s, robot) == expected, (time, robot, domain)
                answers.append((s, expected))
    assert set(answers) == {(s, yes) for s in range(len(domains)) for yes in (True, False)} - {(0, False)}
