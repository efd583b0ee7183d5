"""A skill on disk: nothing is lost, the bytes can be made again, and what is wrong is refused in plain words."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import pickle
import shutil
import warnings
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from coevo.errors import InputError
from coevo.skill import ObjectModel, Skill, installed_skills, load_skill, read_card, skill_description, skill_path
from coevo.skill.model import OBJECT_KINDS, state_count

KINDS = tuple(OBJECT_KINDS)


def model(rng, kind="ball", order=2, length=2, lost=2):
    past = length * (2 + OBJECT_KINDS[kind])
    return ObjectModel(kind, length, rng.normal(size=(order, past)), rng.normal(size=past), 0.6, lost)


def skill(seed=1, objects=(("ball", 2, 2), ("robot", 1, 3)), actions=9, drive="pws"):
    """Return a skill of random numbers; ``objects``: kind, order, history length, maybe lost states of each."""
    rng = np.random.default_rng(seed)
    models = tuple(model(rng, *which) for which in objects)
    states = int(np.prod([one.states for one in models]))
    values = rng.normal(size=(states, actions)).astype(np.float32)
    return Skill("shoot", drive, models, values, 5, 30, {"seed": seed, "recipe": {"name": "shoot", "parts": [1, 2.5]}})


PLAIN = ("name", "drive", "min_steps", "max_steps", "about", "sparse")


def same(one, two):
    """Tell whether two skills are equal in everything."""
    plain = [getattr(one, name) == getattr(two, name) for name in PLAIN]
    models = [
        (a.kind, a.history_length, a.cell, a.lost_states) == (b.kind, b.history_length, b.cell, b.lost_states)
        and a.memory_matrix.tobytes() == b.memory_matrix.tobytes()
        and a.memory_matrix.shape == b.memory_matrix.shape
        and a.past_mean.tobytes() == b.past_mean.tobytes()
        for a, b in zip(one.objects, two.objects, strict=True)
    ]
    return all(plain) and all(models) and one.values.tobytes() == two.values.tobytes()


@pytest.fixture
def saved(tmp_path):
    """Return the path of a saved skill, and the skill."""
    path = tmp_path / "skill.npz"
    kept = skill()
    kept.save(path)
    return path, kept


def rewritten(path, changes):
    """Write a skill file anew: arrays replaced or left out (None), or keys of its header replaced."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = {**json.loads(bytes(arrays["header"])), **changes.get("header", {})}
    arrays.update(changes)
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def attempt(path):
    """Return a skill and no message, or no skill and the message."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # see test_a_refused_file_is_closed
        try:
            return load_skill(path), ""
        except InputError as error:  # let go of here, unlike what pytest.raises keeps
            return None, str(error)


def refusal(path):
    """Return what is said about a file that is no skill; it always says which file, and what to do."""
    found, message = attempt(path)
    assert found is None
    assert str(path) in message
    assert "learn it again" in message
    assert "\n" not in message
    return message


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
def test_a_skill_comes_back_as_it_was(tmp_path, objects, actions, seed, share, sparse):
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


def test_a_sparse_file_holds_the_visited_rows_and_means_the_same(tmp_path):
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


def test_the_same_skill_gives_the_same_bytes(tmp_path):
    skill().save(tmp_path / "one.npz")
    skill().save(tmp_path / "two.npz")
    load_skill(tmp_path / "one.npz").save(tmp_path / "three.npz")
    one, two, three = ((tmp_path / f"{name}.npz").read_bytes() for name in ("one", "two", "three"))
    assert one == two == three
    skill(seed=2).save(tmp_path / "two.npz")
    assert (tmp_path / "two.npz").read_bytes() != one


def test_saving_replaces_the_file_and_leaves_nothing_beside_it(saved):
    path, _ = saved
    other = skill(seed=9)
    other.save(path)
    assert same(load_skill(path), other)
    assert [file.name for file in path.parent.iterdir()] == ["skill.npz"]


def test_a_folder_stands_for_the_skill_in_it(saved):
    path, kept = saved
    assert same(load_skill(path.parent), kept)
    assert same(load_skill(str(path)), kept)


def test_a_policy_is_the_best_action_and_of_equals_the_first():
    values = np.zeros((5, 3), np.float32)
    values[1:4] = [[0.0, 0.0, 0.1], [-1.0, -0.5, -0.5], [2.0, 1.0, 2.0]]
    kept = Skill("x", "pws", (model(np.random.default_rng(0), "ball", 1, 1),), values, 1, 1)
    assert kept.policy.tolist() == [0, 2, 1, 0, 0]
    assert kept.actions == 3


@pytest.mark.parametrize("order", range(1, 9))
def test_an_object_has_three_cells_an_element_and_one_or_two_states_when_lost(order):
    assert state_count(order, 2) == 3**order + 2
    assert state_count(order, 1) == 3**order + 1  # as (3.9) is printed
    assert model(np.random.default_rng(0), "ball", order, 1).states == 3**order + 2
    assert model(np.random.default_rng(0), "ball", order, 1).order == order


def first_object(change):
    """Return the objects of the skill, the first one changed."""
    one, two = skill().objects
    return {"objects": (dataclasses.replace(one, **change), two)}


DECISIVE = {
    "drive": {"drive": "4ws"},
    "shortest action": {"min_steps": 4},
    "longest action": {"max_steps": 31},
    "values": {"values": skill().values + np.float32(1e-3)},
    "models": {"objects": skill(seed=2).objects},
    "cell": first_object({"cell": 0.7}),
    "mean": first_object({"past_mean": np.zeros(12)}),
    "kind": {"objects": skill(objects=(("ball", 2, 2), ("mate", 1, 3))).objects},
}


@pytest.mark.parametrize("what", DECISIVE)
def test_the_digest_changes_with_whatever_decides_what_a_skill_does(what):
    assert dataclasses.replace(skill(), **DECISIVE[what]).digest != skill().digest


def test_the_digest_is_that_of_the_behaviour_not_of_its_name():
    assert dataclasses.replace(skill(), name="mine", about={}).digest == skill().digest


# ------------------------------------------------------------------------------------------ a skill that makes no sense


NONSENSE = {
    "a row too few": {"values": np.zeros((54, 9), np.float32)},
    "no table": {"values": np.zeros(55, np.float32)},
    "an action of no step": {"min_steps": 0},
    "longest below shortest": {"min_steps": 31},
    "no objects": {"objects": ()},
    "an object too few": {"objects": skill().objects[:1]},
    "unknown object": first_object({"kind": "moon"}),
    "history too long": first_object({"history_length": 3}),
    "three lost states": first_object({"lost_states": 3}),
    "mean too short": first_object({"past_mean": np.zeros(11)}),
}


@pytest.mark.parametrize("what", NONSENSE)
def test_parts_that_do_not_fit_each_other_are_refused(what):
    assert skill().values.shape == (55, 9)
    with pytest.raises(ValueError, match=r"must|expected"):
        dataclasses.replace(skill(), **NONSENSE[what])


def test_a_history_of_no_steps_is_refused():
    empty = first_object({"history_length": 0, "memory_matrix": np.zeros((2, 0)), "past_mean": np.zeros(0)})
    with pytest.raises(ValueError, match="history_length"):
        dataclasses.replace(skill(), **empty)


@pytest.mark.parametrize("part", ["values", "memory matrix", "mean"])
def test_numbers_that_are_not_finite_are_refused(part):
    # A value that is not a number is the largest of all to argmax, and so one action would be taken for ever.
    one, _ = skill().objects
    values, matrix, mean = skill().values.copy(), one.memory_matrix.copy(), one.past_mean.copy()
    change = {
        "values": {"values": values},
        "memory matrix": first_object({"memory_matrix": matrix}),
        "mean": first_object({"past_mean": mean}),
    }[part]
    {"values": values, "memory matrix": matrix, "mean": mean}[part].flat[3] = np.nan
    with pytest.raises(ValueError, match="finite"):
        dataclasses.replace(skill(), **change)


# ------------------------------------------------------------------------------------------- files that are no skills


def test_every_damaged_byte_is_noticed_or_does_not_matter(saved):
    path, kept = saved
    whole = path.read_bytes()
    assert len(whole) > 3000
    rng, noticed = np.random.default_rng(1), 0
    # All bytes of the zip's own records at both ends, and every fifth between.
    places = sorted({*range(120), *range(120, len(whole), 5), *range(len(whole) - 500, len(whole))})
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(damaged))
        found, message = attempt(path)
        if found is None:
            assert str(path) in message, place
            assert "learn it again" in message, place
            noticed += 1
        else:
            assert same(found, kept), place  # a date, or another field of the archive that means nothing
    assert noticed > 0.7 * len(places)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.95, 0.999])
def test_a_truncated_file_is_refused(saved, share):
    path, _ = saved
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refusal(path)


def test_a_refused_file_is_closed(saved):
    path, _ = saved
    path.write_bytes(path.read_bytes()[:2000])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.suppress(InputError):
            load_skill(path)
    assert [str(warning.message) for warning in caught] == []


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=300))
@example(b"")
@example(b"PK\x03\x04")
@example(b"\x93NUMPY\x01\x00")
@example(pickle.dumps({"a": 1}))
def test_other_bytes_are_refused(tmp_path, content):
    path = tmp_path / "skill.npz"
    path.write_bytes(content)
    refusal(path)


def test_a_single_array_is_refused(tmp_path):
    with (tmp_path / "skill.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    refusal(tmp_path / "skill.npz")


def test_a_foreign_npz_is_refused(tmp_path):
    np.savez(tmp_path / "skill.npz", weights=np.zeros(3))
    refusal(tmp_path / "skill.npz")


def test_a_zip_of_other_files_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "skill.npz", "w") as archive:
        archive.writestr("header", "{}")
        archive.writestr("values.txt", "1 2 3")
    refusal(tmp_path / "skill.npz")


class Trap:
    """Something whose unpickling would be noticed."""

    sprung = False

    def __reduce__(self) -> tuple[object, ...]:
        return setattr, (Trap, "sprung", True)


def test_nothing_is_ever_unpickled(saved):
    path, _ = saved
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    trap = np.empty(1, object)
    trap[0] = Trap()
    for name in arrays:
        np.savez(path, **{**arrays, name: trap})
        refusal(path)
        assert not Trap.sprung
    with np.load(path, allow_pickle=True) as archive:  # the trap works
        assert archive[name] is not None
    assert Trap.sprung


@pytest.mark.parametrize("other", [0, 2, "1", None])
def test_another_format_is_refused_by_its_number(saved, other):
    path, _ = saved
    rewritten(path, {"header": {"format": other}})
    message = refusal(path)
    assert f"format {other}" in message
    assert "reads format 1" in message


@pytest.mark.parametrize(
    "header",
    [
        {"objects": 5},
        {"objects": [{"kind": "ball"}]},
        {"objects": [{"kind": "moon", "history_length": 2, "order": 2, "cell": 0.6}]},
        {"min_steps": "many"},
        {"min_steps": 99},
        {"about": 3},
    ],
    ids=str,
)
def test_a_header_that_makes_no_sense_is_refused(saved, header):
    path, _ = saved
    rewritten(path, {"header": header})
    refusal(path)


@pytest.mark.parametrize("content", [b"[]", b"5", b"\xff\xfe", b"{", b"{}"])
def test_a_header_that_is_no_table_is_refused(saved, content):
    path, _ = saved
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    np.savez(path, **{**arrays, "header": np.frombuffer(content, np.uint8)})
    refusal(path)


ARRAYS = {
    "no values": {"values": None},
    "a model too few": {"memory_matrix_1": None},
    "words": {"values": np.array(["a", "b"])},
    "another shape": {"values": np.zeros((3, 3))},
    "one number": {"values": np.zeros(())},
    "a vector for a matrix": {"memory_matrix_0": np.zeros(5)},
    "a matrix for a vector": {"past_mean_0": np.zeros((2, 6))},
}
SPARSE = {
    "a row too few": np.arange(54),
    "a state twice": np.array([*range(54), 53]),
    "not ascending": np.arange(55)[::-1],
    "no such state": np.arange(1, 56),
    "below the first": np.arange(-1, 54),
    "no list": np.zeros((55, 1)),
    "words": np.array(["a"] * 55),
}
CHANGES = {
    "longest action": {"header": {"max_steps": 29}},
    "drive": {"header": {"drive": "4ws"}},
    "values": {"values": skill(seed=3).values},
}


@pytest.mark.parametrize("what", ARRAYS)
def test_arrays_that_do_not_fit_are_refused(saved, what):
    path, _ = saved
    rewritten(path, ARRAYS[what])
    refusal(path)


@pytest.mark.parametrize("what", SPARSE)
def test_row_numbers_that_do_not_fit_are_refused(saved, what):
    path, _ = saved
    rewritten(path, {"rows": np.arange(55)})
    load_skill(path)  # all of them fit
    rewritten(path, {"rows": SPARSE[what]})
    refusal(path)


def test_a_table_too_large_for_any_machine_is_refused_before_it_is_made(saved):
    path, _ = saved
    rewritten(path, {"rows": np.arange(55), "memory_matrix_0": np.zeros((30, 12))})
    refusal(path)


@pytest.mark.parametrize("what", CHANGES)
def test_contents_that_were_changed_do_not_match_the_digest(saved, what):
    path, _ = saved
    rewritten(path, CHANGES[what])
    assert "digest" in refusal(path)


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


def test_the_four_skills_are_installed_in_the_order_of_the_terminals():
    assert installed_skills() == ["shoot", "pass", "avoid", "search"]
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
    with pytest.raises(InputError, match=r"card\.json is not valid JSON.*coevo skills evaluate"):
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
