"""Several skills side by side, as flat arrays for compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.skill.model import INPUTS, OBJECT_KINDS, Skill

__all__ = ["CODES", "MATE", "NEAREST", "SkillBank", "make_bank"]

# Codes of what a skill looks at. The first three are the camera's own object numbers; the other two are resolved
# for each robot: a team mate to a fixed object, the nearest robot to the slot after the camera's objects.
MATE, NEAREST = -1, -2
CODES = {"ball": 0, "own_goal": 1, "opponent_goal": 2, "mate": MATE, "robot": NEAREST}


class SkillBank(NamedTuple):
    """Skills s, each with up to M models.

    models: (skills,) number of models.
    objects, lengths, orders, features, states, lost: (skills, M) code of the object, history length, order, number of
        features, number of states, and how many of these are for "not visible".
    memory: (skills, M, order, past) float64 memory matrices, padded with zeros.
    offset: (skills, M, order) float64, memory matrix times past mean.
    cells: (skills, M) float64.
    needed: (skills, M) bool, whether the skill only knows what to do while the object is in view.
    policy: (all states,) int8, the tables' best actions one after the other.
    first: (skills,) where each skill's part of policy begins.
    min_steps, max_steps: (skills,).
    history: longest history length.
    nearest: whether any skill looks at the nearest robot.
    """

    models: NDArray[np.int64]
    objects: NDArray[np.int64]
    lengths: NDArray[np.int64]
    orders: NDArray[np.int64]
    features: NDArray[np.int64]
    states: NDArray[np.int64]
    lost: NDArray[np.int64]
    memory: NDArray[np.float64]
    offset: NDArray[np.float64]
    cells: NDArray[np.float64]
    needed: NDArray[np.bool_]
    policy: NDArray[np.int8]
    first: NDArray[np.int64]
    min_steps: NDArray[np.int64]
    max_steps: NDArray[np.int64]
    history: int
    nearest: bool


def make_bank(skills: Sequence[Skill], *, drive: str, actions: int) -> SkillBank:
    """Put skills side by side, in the given order.

    Raises:
        InputError: a skill was learned for another drive or number of actions.
    """
    for skill in skills:
        if skill.drive != drive or skill.actions != actions:
            raise InputError(
                f"the skill {skill.name!r} was learned for the drive {skill.drive} with {skill.actions} actions,"
                f" this drive is {drive} with {actions}; learn it again with 'coevo learn {skill.name} --drive {drive}'"
            )
    count, most = len(skills), max(len(skill.objects) for skill in skills)
    order = max(model.order for skill in skills for model in skill.objects)
    past = max(model.memory_matrix.shape[1] for skill in skills for model in skill.objects)
    table = np.zeros((6, count, most), np.int64)
    memory, offset = np.zeros((count, most, order, past)), np.zeros((count, most, order))
    cells, needed = np.zeros((count, most)), np.zeros((count, most), np.bool_)
    for s, skill in enumerate(skills):
        for i, model in enumerate(skill.objects):
            features = OBJECT_KINDS[model.kind]
            table[:, s, i] = (
                CODES[model.kind],
                model.history_length,
                model.order,
                features,
                model.states,
                model.lost_states,
            )
            memory[s, i, : model.order, : model.history_length * (INPUTS + features)] = model.memory_matrix
            offset[s, i, : model.order] = model.memory_matrix @ model.past_mean
            cells[s, i], needed[s, i] = model.cell, model.kind in skill.domain
    sizes = [skill.values.shape[0] for skill in skills]
    return SkillBank(
        models=np.array([len(skill.objects) for skill in skills], np.int64),
        objects=table[0],
        lengths=table[1],
        orders=table[2],
        features=table[3],
        states=table[4],
        lost=table[5],
        memory=memory,
        offset=offset,
        cells=cells,
        needed=needed,
        policy=np.concatenate([skill.policy for skill in skills]),
        first=np.cumsum([0, *sizes[:-1]]).astype(np.int64),
        min_steps=np.array([skill.min_steps for skill in skills], np.int64),
        max_steps=np.array([skill.max_steps for skill in skills], np.int64),
        history=int(table[1].max()),
        nearest=bool((table[0] == NEAREST).any()),
    )
