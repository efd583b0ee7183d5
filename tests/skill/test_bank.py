"""Skills side by side: every number of every skill is found where compiled code looks for it."""

from __future__ import annotations

import numpy as np
import pytest

from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, load_skill, make_bank
from coevo.skill.bank import MATE, NEAREST
from coevo.skill.model import OBJECT_KINDS
from coevo.soccer.camera import BALL, OPPONENT_GOAL, OWN_GOAL

CODES = {"ball": BALL, "own_goal": OWN_GOAL, "opponent_goal": OPPONENT_GOAL, "mate": MATE, "robot": NEAREST}
# Of each skill: kind, order, history length of its objects.
SKILLS = {
    "shoot": (("ball", 2, 3), ("opponent_goal", 1, 1)),
    "pass": (("ball", 1, 2), ("mate", 2, 1), ("own_goal", 1, 2)),
    "avoid": (("robot", 3, 4),),
}


def skill(name, objects, *, seed=0, actions=9, drive="pws", steps=(5, 30)):
    rng = np.random.default_rng(seed)
    models = []
    for kind, order, length in objects:
        past = length * (2 + OBJECT_KINDS[kind])
        models.append(
            ObjectModel(kind, length, rng.normal(size=(order, past)), rng.normal(size=past), rng.uniform(0.3, 1))
        )
    states = int(np.prod([3**order + 2 for _, order, _ in objects]))
    return Skill(name, drive, tuple(models), rng.normal(size=(states, actions)).astype(np.float32), *steps)


@pytest.fixture
def skills():
    return [
        skill(name, objects, seed=seed, steps=(seed + 1, 10 * seed + 2))
        for seed, (name, objects) in enumerate(SKILLS.items())
    ]


def test_every_number_of_every_skill_is_in_its_place(skills):
    bank = make_bank(skills, drive="pws", actions=9)
    assert bank.models.tolist() == [2, 3, 1]
    assert bank.min_steps.tolist() == [1, 2, 3]
    assert bank.max_steps.tolist() == [2, 12, 22]
    for s, one in enumerate(skills):
        for i, model in enumerate(one.objects):
            features = OBJECT_KINDS[model.kind]
            past = model.history_length * (2 + features)
            assert bank.objects[s, i] == CODES[model.kind]
            assert bank.lengths[s, i] == model.history_length
            assert bank.orders[s, i] == model.order
            assert bank.features[s, i] == features
            assert bank.states[s, i] == 3**model.order + 2
            assert bank.cells[s, i] == model.cell
            assert np.array_equal(bank.memory[s, i, : model.order, :past], model.memory_matrix)
            assert not bank.memory[s, i, model.order :].any()
            assert not bank.memory[s, i, :, past:].any()
            np.testing.assert_allclose(
                bank.offset[s, i, : model.order],
                [sum(row * model.past_mean) for row in model.memory_matrix],
                rtol=1e-12,
                atol=1e-12,
            )


def test_tables_lie_one_after_the_other(skills):
    bank = make_bank(skills, drive="pws", actions=9)
    sizes = [11 * 5, 5 * 11 * 5, 29]
    assert bank.first.tolist() == [0, sizes[0], sizes[0] + sizes[1]]
    assert len(bank.policy) == sum(sizes)
    for first, one in zip(bank.first, skills, strict=True):
        best = np.argmax(one.values, axis=1)
        assert np.array_equal(bank.policy[first : first + len(best)], best)


def test_the_history_is_the_longest_and_the_nearest_robot_is_watched_if_a_skill_asks(skills):
    bank = make_bank(skills, drive="pws", actions=9)
    assert bank.history == 4
    assert bank.nearest is True
    bank = make_bank(skills[:2], drive="pws", actions=9)
    assert bank.history == 3
    assert bank.nearest is False


def test_the_installed_skills_stand_side_by_side():
    loaded = [load_skill(name) for name in ("shoot", "pass", "avoid", "search")]
    bank = make_bank(loaded, drive="pws", actions=9)
    assert bank.policy.min() >= 0
    assert bank.policy.max() <= 8
    for first, one in zip(bank.first, loaded, strict=True):
        assert np.array_equal(bank.policy[first : first + len(one.values)], one.policy)


@pytest.mark.parametrize(
    ("drive", "actions"), [("4ws", 7), ("4ws", 9), ("pws", 7)], ids=["both", "another drive", "other actions"]
)
def test_a_skill_of_another_drive_is_refused_with_the_remedy(drive, actions):
    strange = skill("avoid", SKILLS["avoid"], drive=drive, actions=actions)
    with pytest.raises(InputError) as caught:
        make_bank([skill("shoot", SKILLS["shoot"]), strange], drive="pws", actions=9)
    message = str(caught.value)
    assert "'avoid' was learned for" in message
    assert f"{drive} with {actions} actions" in message
    assert "this drive is pws with 9" in message
    assert "coevo learn avoid --drive pws" in message
