"""Files that are no skills, or damaged ones, are refused in plain words, and nothing of them is run."""

from __future__ import annotations

import contextlib
import json
import pickle
import warnings
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from coevo.errors import InputError
from coevo.skill import load_skill


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


def test_every_damaged_byte_is_noticed_or_does_not_matter(saved, same):
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
        {"domain": 5},
        {"domain": None},
        {"domain": "ball"},
        {"domain": ["moon"]},
        {"domain": ["own_goal"]},  # it does not look at it
        {"domain": [["ball"]]},
        {"domain": ["ball"] * 1000},
        {"domain": ["ball\n"]},
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
    "domain": {"header": {"domain": ["ball"]}},
    "values": {"values": np.ones((55, 9), np.float32)},
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
