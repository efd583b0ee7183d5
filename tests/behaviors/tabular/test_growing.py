"""Tables that grow: against a table built by hand from (4.3), and what a robot does before and after, in any state."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from behaviors.tabular.growing import grown_table, grown_values, origins
from behaviors.tabular.table import all_states, make_table, row_of, with_room
from coevo.skill import ObjectModel, Skill, make_bank
from coevo.skill.estimate import discrete_state, make_memory
from coevo.skill.model import INPUTS, OBJECT_KINDS

ACTIONS = 7
SIZES = st.lists(st.tuples(st.integers(1, 3), st.integers(1, 2)), min_size=1, max_size=3)


def places(order, lost):
    """Return what an object's states are called, in their order: cells as (first axis, second, ...), then lost ones."""
    cells = [tuple(reversed(cell)) for cell in itertools.product(range(3), repeat=order)]
    return [*cells, *(f"lost {side}" for side in range(lost))]


def called(sizes):
    """Return what the states of several objects are called, the last object varying fastest."""
    return list(itertools.product(*(places(*size) for size in sizes)))


def by_hand(values, sizes, which):
    """Return Q(x1 .. xi, xj) = Q(x1 .. xi) for all xj (4.3), of each state by its name."""
    old = dict(zip(called(sizes), values, strict=True))
    order, lost = sizes[which]
    larger = [*sizes[:which], (order + 1, lost), *sizes[which + 1 :]]
    found = []
    for name in called(larger):
        place = name[which]
        before = place if isinstance(place, str) else place[:order]
        found.append(old[(*name[:which], before, *name[which + 1 :])])
    return np.array(found)


def filled(states, seed, *, sparse):
    """Return a table of random values, sparse ones with rows for some states, in any order."""
    rng = np.random.default_rng(seed)
    table = make_table(states, ACTIONS, sparse=sparse, channels=2)
    used = rng.permutation(states)[: states // 2] if sparse else np.arange(states)
    table = with_room(table, len(used))
    for state in used:
        row = row_of(table, int(state))
        table.values[row], table.visits[row] = rng.integers(-3, 4, ACTIONS), rng.integers(0, 9, ACTIONS)
        table.fixed[row] = rng.random() < 0.3
        table.critic[row], table.actor[row] = rng.normal(size=2), rng.normal(size=(ACTIONS, 2))
    return table


@given(SIZES, st.integers(0, 2), st.integers(0, 999), st.booleans())
@settings(deadline=None, max_examples=40)
def test_a_grown_table_is_the_one_built_by_hand(sizes, which, seed, sparse):
    which %= len(sizes)
    table = filled(len(called(sizes)), seed, sparse=sparse)
    grown = grown_table(table, origins(sizes, which))
    before = all_states(table.values, table.rows)
    after = all_states(grown.values, grown.rows)
    assert np.array_equal(after, by_hand(before, sizes, which))
    assert np.array_equal(
        all_states(grown.visits, grown.rows), by_hand(all_states(table.visits, table.rows), sizes, which)
    )
    actors = [all_states(one.actor.reshape(len(one.actor), -1), one.rows) for one in (table, grown)]
    assert np.array_equal(actors[1], by_hand(actors[0], sizes, which))
    assert np.array_equal(
        all_states(grown.critic, grown.rows), by_hand(all_states(table.critic, table.rows), sizes, which)
    )
    fixed = all_states(grown.fixed[:, None], grown.rows)
    assert np.array_equal(fixed, by_hand(all_states(table.fixed[:, None], table.rows), sizes, which))
    assert sorted(grown.rows[grown.rows >= 0]) == list(range(grown.used[0])) == list(range(len(grown.values)))


@given(SIZES, st.integers(0, 999))
@settings(deadline=None, max_examples=30)
def test_the_best_table_so_far_grows_with_the_one_that_is_learned(sizes, seed):
    table = filled(len(called(sizes)), seed, sparse=True)
    kept = table.values[: len(table.values) // 2].copy()  # when fewer states had rows
    origin = origins(sizes, 0)
    grown = all_states(grown_values(kept, table.rows, origin), grown_table(table, origin).rows)
    assert np.array_equal(grown, by_hand(all_states(kept, table.rows), sizes, 0))


def test_zeros_instead_of_what_was_learned_spare_rows_that_do_not_learn():
    table = filled(28, 1, sparse=False)
    origin = origins([(3, 1)], 0)
    grown = grown_table(table, origin, copy=False)
    assert np.array_equal(grown.fixed, table.fixed[origin])
    assert grown.fixed.any()
    assert not grown.values[~grown.fixed].any()
    assert not grown.visits[~grown.fixed].any()
    assert np.array_equal(grown.values[grown.fixed], table.values[origin][grown.fixed])


def model(kind, order, lost, rng):
    past = 2 * (INPUTS + OBJECT_KINDS[kind])
    return ObjectModel(kind, 2, rng.normal(size=(order, past)), rng.normal(size=past), 0.6, lost)


@pytest.mark.parametrize("which", [0, 1])
def test_a_robot_does_the_same_after_growth_whatever_it_sees(which):
    rng = np.random.default_rng(which)
    models = [model("ball", 3, 2, rng), model("opponent_goal", 2, 1, rng)]
    smaller = list(models)
    smaller[which] = dataclasses.replace(models[which], memory_matrix=models[which].memory_matrix[:-1])
    sizes = [(one.order, one.lost_states) for one in smaller]
    table = filled(len(called(sizes)), 5, sparse=False)
    grown = grown_table(table, origins(sizes, which))
    skills = [
        Skill("one", "4ws", tuple(objects), all_states(of.values, of.rows), 1, 9)
        for objects, of in ((smaller, table), (models, grown))
    ]
    bank = make_bank(skills, drive="4ws", actions=ACTIONS)
    memory, changed = make_memory(bank, [-1]), 0
    for time in range(500):
        memory.past[:], memory.inputs[:] = rng.normal(size=memory.past.shape), rng.normal(size=memory.inputs.shape)
        memory.areas[:], memory.side[:] = rng.random(memory.areas.shape) < 0.8, rng.integers(0, 2, memory.side.shape)
        old, new = (discrete_state(memory, bank, skill, 0, time) for skill in range(2))
        assert bank.policy[bank.first[0] + old] == bank.policy[bank.first[1] + new]
        assert np.array_equal(skills[0].values[old], skills[1].values[new])
        changed += old != new
    assert changed > 100
