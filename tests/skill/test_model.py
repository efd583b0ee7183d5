"""A skill on disk: nothing is lost, the bytes can be made again, and parts that do not fit are refused."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coevo.config import RobotSettings
from coevo.errors import InputError
from coevo.skill import Skill, installed_skills, load_skill, read_card, skill_description, skill_path
from coevo.skill.model import OBJECT_KINDS, state_count
from coevo.soccer.drive import action_set

KINDS = tuple(OBJECT_KINDS)


# ---------------------------------------------------------------------------------------------------------- round trip


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    objects=st.lists(
        st.tuples(st.sampled_from(KINDS), st.integers(1, 3), st.integers(1, 4), st.sampled_from((1, 2))),
        min_size=1,
        max_size=3,
    ).map(tuple),
    actions=st.sampled_from((7, 9)),
    seed=st.integers(0, 2**32 - 1),
    share=st.sampled_from((0.0, 0.1, 1.0)),
    sparse=st.booleans(),
)
def test_a_skill_comes_back_as_it_was(tmp_path, objects, actions, seed, share, sparse, skill, same):
    kept = skill(seed, objects, actions)
    kept = dataclasses.replace(kept, values=visited(kept.values, share), sparse=sparse)
    kept.save(tmp_path / "any.npz")
    found = load_skill(tmp_path / "any.npz")
    assert same(found, kept)
    assert found.digest == kept.digest
    assert found.values.dtype == np.float32


def visited(values, share):
    """Return a table of which only a share of the rows was ever visited."""
    rows = np.random.default_rng(0).random(len(values)) < share
    return np.where(rows[:, None], values, np.float32(0.0))


def test_a_sparse_file_holds_the_visited_rows_and_means_the_same(tmp_path, skill):
    whole = skill(objects=(("ball", 4, 1), ("robot", 3, 1)))
    whole = dataclasses.replace(whole, values=visited(whole.values, 0.02))
    sparse = dataclasses.replace(whole, sparse=True)
    whole.save(tmp_path / "dense.npz")
    sparse.save(tmp_path / "sparse.npz")
    with np.load(tmp_path / "sparse.npz") as archive:
        assert 10 < len(archive["rows"]) < 100
        assert np.array_equal(archive["rows"], np.flatnonzero(whole.values.any(axis=1)))
        assert np.array_equal(archive["values"], whole.values[archive["rows"]])
    assert (tmp_path / "sparse.npz").stat().st_size < (tmp_path / "dense.npz").stat().st_size
    dense, found = load_skill(tmp_path / "dense.npz"), load_skill(tmp_path / "sparse.npz")
    assert found.digest == dense.digest == whole.digest
    assert np.array_equal(found.policy, whole.policy)
    assert found.values.tobytes() == whole.values.tobytes()
    found.save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "sparse.npz").read_bytes()


def test_a_file_from_before_there_was_a_choice_has_two_lost_states(saved):
    path, kept = saved
    with np.load(path) as archive:
        header = json.loads(bytes(archive["header"]))
    assert all("lost_states" not in item for item in header["objects"])
    assert [one.lost_states for one in load_skill(path).objects] == [2, 2]
    one = dataclasses.replace(kept.objects[0], lost_states=1)
    table = np.zeros((10 * 5, 9), np.float32)
    dataclasses.replace(kept, objects=(one, kept.objects[1]), values=table).save(path)
    assert [model.lost_states for model in load_skill(path).objects] == [1, 2]


def test_the_same_skill_gives_the_same_bytes(tmp_path, skill):
    skill().save(tmp_path / "one.npz")
    skill().save(tmp_path / "two.npz")
    load_skill(tmp_path / "one.npz").save(tmp_path / "three.npz")
    one, two, three = ((tmp_path / f"{name}.npz").read_bytes() for name in ("one", "two", "three"))
    assert one == two == three
    skill(seed=2).save(tmp_path / "two.npz")
    assert (tmp_path / "two.npz").read_bytes() != one


def test_saving_replaces_the_file_and_leaves_nothing_beside_it(saved, skill, same):
    path, _ = saved
    other = skill(seed=9)
    other.save(path)
    assert same(load_skill(path), other)
    assert [file.name for file in path.parent.iterdir()] == ["skill.npz"]


def test_a_folder_stands_for_the_skill_in_it(saved, same):
    path, kept = saved
    assert same(load_skill(path.parent), kept)
    assert same(load_skill(str(path)), kept)


def test_a_policy_is_the_best_action_and_of_equals_the_first(model):
    values = np.zeros((5, 3), np.float32)
    values[1:4] = [[0.0, 0.0, 0.1], [-1.0, -0.5, -0.5], [2.0, 1.0, 2.0]]
    kept = Skill("x", "pws", (model(np.random.default_rng(0), "ball", 1, 1),), values, 1, 1)
    assert kept.policy.tolist() == [0, 2, 1, 0, 0]
    assert kept.actions == 3


@pytest.mark.parametrize("order", range(1, 9))
def test_an_object_has_three_cells_an_element_and_one_or_two_states_when_lost(order, model):
    assert state_count(order, 2) == 3**order + 2
    assert state_count(order, 1) == 3**order + 1  # as (3.9) is printed
    assert model(np.random.default_rng(0), "ball", order, 1).states == 3**order + 2
    assert model(np.random.default_rng(0), "ball", order, 1).order == order


def first_object(skill, change):
    """Return the objects of the skill, the first one changed."""
    one, two = skill().objects
    return {"objects": (dataclasses.replace(one, **change), two)}


DECISIVE = {
    "drive": lambda _: {"drive": "4ws"},
    "shortest action": lambda _: {"min_steps": 4},
    "longest action": lambda _: {"max_steps": 31},
    "values": lambda skill: {"values": skill().values + np.float32(1e-3)},
    "models": lambda skill: {"objects": skill(seed=2).objects},
    "cell": lambda skill: first_object(skill, {"cell": 0.7}),
    "mean": lambda skill: first_object(skill, {"past_mean": np.zeros(12)}),
    "kind": lambda skill: {"objects": skill(objects=(("ball", 2, 2), ("mate", 1, 3))).objects},
    "domain": lambda _: {"domain": ("ball",)},
}


@pytest.mark.parametrize("what", DECISIVE)
def test_the_digest_changes_with_whatever_decides_what_a_skill_does(what, skill):
    assert dataclasses.replace(skill(), **DECISIVE[what](skill)).digest != skill().digest


def test_the_digest_is_that_of_the_behaviour_not_of_its_name(skill):
    assert dataclasses.replace(skill(), name="mine", about={}).digest == skill().digest


# -------------------------------------------------------------------------------------------------------------- domain


@pytest.mark.parametrize("drive", ["pws", "4ws"])
@pytest.mark.parametrize("domain", [("ball",), ("mate",), ("robot",), ("ball", "robot"), ("robot", "mate", "ball")])
def test_outside_its_domain_a_skill_stands_and_within_it_does_what_it_did(domain, drive, skill):
    actions = action_set(RobotSettings(drive=drive))
    objects = (("ball", 2, 1, 1), ("mate", 1, 2, 2), ("robot", 1, 1, 1))
    free = skill(objects=objects, actions=len(actions.codes), drive=drive)
    kept = dataclasses.replace(free, domain=domain)
    (stand,) = (n for n, command in enumerate(actions.commands.tolist()) if command == [0.0, 0.0])
    outside = 0
    for state, action in enumerate(kept.policy):
        rest, lost = state, set()
        for kind, order, _, lost_states in reversed(objects):
            rest, cell = divmod(rest, 3**order + lost_states)
            lost |= {kind} if cell >= 3**order else set()
        assert action == (stand if lost & set(domain) else free.policy[state])
        outside += bool(lost & set(domain))
    assert 0 < outside < len(kept.policy)
    assert (kept.policy != free.policy).any()


def test_a_domain_is_kept_and_is_in_the_digest(tmp_path, skill, same):
    kept = [dataclasses.replace(skill(), domain=domain) for domain in ((), ("ball",), ("robot",), ("ball", "robot"))]
    assert len({one.digest for one in kept}) == 4
    for one in kept:
        one.save(tmp_path / "one.npz")
        assert same(load_skill(tmp_path / "one.npz"), one)
    # The order in which the objects are named decides nothing.
    assert dataclasses.replace(skill(), domain=("robot", "ball")).digest == kept[3].digest


def test_the_file_of_a_skill_without_a_domain_is_that_of_before_there_were_any(saved):
    path, _ = saved
    with np.load(path) as archive:
        assert "domain" not in json.loads(bytes(archive["header"]))


# ------------------------------------------------------------------------------------------ a skill that makes no sense


NONSENSE = {
    "a row too few": lambda _: {"values": np.zeros((54, 9), np.float32)},
    "no table": lambda _: {"values": np.zeros(55, np.float32)},
    "an action of no step": lambda _: {"min_steps": 0},
    "longest below shortest": lambda _: {"min_steps": 31},
    "no objects": lambda _: {"objects": ()},
    "an object too few": lambda skill: {"objects": skill().objects[:1]},
    "unknown object": lambda skill: first_object(skill, {"kind": "moon"}),
    "history too long": lambda skill: first_object(skill, {"history_length": 3}),
    "a domain that it does not look at": lambda _: {"domain": ("ball", "own_goal")},
    "an object twice in the domain": lambda _: {"domain": ("ball", "ball")},
    "three lost states": lambda skill: first_object(skill, {"lost_states": 3}),
    "mean too short": lambda skill: first_object(skill, {"past_mean": np.zeros(11)}),
}


@pytest.mark.parametrize("what", NONSENSE)
def test_parts_that_do_not_fit_each_other_are_refused(what, skill):
    assert skill().values.shape == (55, 9)
    with pytest.raises(ValueError, match=r"must|expected"):
        dataclasses.replace(skill(), **NONSENSE[what](skill))


def test_a_history_of_no_steps_is_refused(skill):
    empty = first_object(skill, {"history_length": 0, "memory_matrix": np.zeros((2, 0)), "past_mean": np.zeros(0)})
    with pytest.raises(ValueError, match="history_length"):
        dataclasses.replace(skill(), **empty)


@pytest.mark.parametrize("part", ["values", "memory matrix", "mean"])
def test_numbers_that_are_not_finite_are_refused(part, skill):
    # A value that is not a number is the largest of all to argmax, and so one action would be taken for ever.
    one, _ = skill().objects
    values, matrix, mean = skill().values.copy(), one.memory_matrix.copy(), one.past_mean.copy()
    change = {
        "values": {"values": values},
        "memory matrix": first_object(skill, {"memory_matrix": matrix}),
        "mean": first_object(skill, {"past_mean": mean}),
    }[part]
    {"values": values, "memory matrix": matrix, "mean": mean}[part].flat[3] = np.nan
    with pytest.raises(ValueError, match="finite"):
        dataclasses.replace(skill(), **change)


# ---------------------------------------------------------------------------------------------------- names and paths


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"there is no skill file .*nothing\.npz"):
        load_skill(tmp_path / "nothing.npz")
    with pytest.raises(InputError, match=r"there is no skill file .*skill\.npz"):
        load_skill(tmp_path)


def test_an_unknown_name_is_answered_with_the_nearest_and_all():
    with pytest.raises(InputError, match=r"no installed skill 'shot'\. Did you mean 'shoot'") as caught:
        load_skill("shot")
    for name in ("shoot", "pass", "avoid", "search"):
        assert name in str(caught.value)


def test_skills_are_installed_those_of_the_source_first_in_the_order_of_the_terminals():
    of_the_source, others = installed_skills()[:4], installed_skills()[4:]
    assert of_the_source == ["shoot", "pass", "avoid", "search"]
    assert others == ["defend", "home", "pass-in-view", "shoot-in-view"]
    for name in installed_skills():
        assert load_skill(name).name == name
        assert skill_path(name).name == "skill.npz"


def test_a_card_lies_beside_its_skill(saved):
    path, _ = saved
    assert read_card(path) == {}
    path.with_name("card.json").write_text('{"digest": "abc", "games": 5}', encoding="utf-8")
    assert read_card(path) == {"digest": "abc", "games": 5}
    assert read_card(path.parent) == {"digest": "abc", "games": 5}


def test_a_broken_card_is_named_with_the_remedy(saved):
    path, _ = saved
    path.with_name("card.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"card\.json is damaged: .*; learn the skill again with 'coevo learn'"):
        read_card(path)


def test_what_a_skill_does_is_told_by_its_card_else_by_its_recipe(saved):
    path, skill = saved
    assert skill_description(path) == ""
    told = dataclasses.replace(skill, about={"recipe": {"description": "turns\n  left"}})
    told.save(path)
    assert skill_description(path) == "turns left"
    path.with_name("card.json").write_text('{"description": "turns right"}', encoding="utf-8")
    assert skill_description(path) == "turns right"


@pytest.mark.parametrize("card", ["{", "[]", '{"description": 5}', '{"description": ["a"]}'])
def test_a_card_that_tells_nothing_is_no_failure(card, saved):
    path, _ = saved
    path.with_name("card.json").write_text(card, encoding="utf-8")
    assert skill_description(path) == ""
    assert skill_description("nothing-like-it") == ""


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    folder = tmp_path / "skill.npz"
    folder.mkdir()
    (folder / "skill.npz").mkdir()
    with pytest.raises(InputError, match="cannot read the skill file"):
        load_skill(folder)
    shutil.rmtree(folder)


def test_the_header_is_json_a_person_can_read(saved):
    path, kept = saved
    with zipfile.ZipFile(path) as archive:
        data = np.lib.format.read_array(io.BytesIO(archive.read("header.npy")), allow_pickle=False)
    header = json.loads(bytes(data))
    assert header["digest"] == kept.digest
    assert header["objects"][0] == {"kind": "ball", "history_length": 2, "order": 2, "cell": 0.6}
