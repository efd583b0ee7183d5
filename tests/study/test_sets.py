"""Folders of studies: sets are written whole, read back as they were, and never mixed with those of other settings."""

from __future__ import annotations

import pytest

from coevo.errors import InputError
from coevo.study import open_method, read_sets, sets, table_bytes, write_set

ROWS = [{"period": "A", "share": 0.25}, {"period": "B, late", "share": 1.0}]


@pytest.fixture
def method(tmp_path):
    """Return a method of which set 1 is finished."""
    found = open_method(tmp_path / "previous", "{}\n")
    write_set(found, 1, b'{"set": 1}', {"trials.csv": table_bytes(ROWS), "passer.npz": b"skill"})
    return found


def test_a_set_is_read_as_it_was_written(method):
    ((name, (one,)),) = read_sets(method.folder.parent).items()
    assert (name, one.summary) == ("previous", {"set": 1})
    assert one.rows("trials.csv") == [{key: str(value) for key, value in row.items()} for row in ROWS]
    assert (one.folder / "passer.npz").read_bytes() == b"skill"
    assert method.missing(3) == [0, 2]


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("set-01/trials.csv", b"0.25", b"0.35"),
        ("set-01/passer.npz", b"skill", b"skull"),
        ("set-01/set.json", b'"set": 1', b'"set": 2'),
        ("settings.json", b"{}", b'{"trials": 1}'),
    ],
)
def test_a_set_that_was_altered_is_not_read(method, coevo, name, old, new):
    assert coevo("check", method.folder.parent).code == coevo("check", method.folder / "set-01").code == 0
    path = method.folder / name
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(InputError, match=r"damaged|does not match its digest"):
        read_sets(method.folder.parent)
    assert coevo("check", method.folder).code == 1


def test_settings_in_the_place_of_a_summary_are_told(method):
    (method.folder / "set-01" / "set.json").write_bytes(b'{"trials": 1}')
    with pytest.raises(InputError, match="it is no summary of a set"):
        read_sets(method.folder.parent)


def test_no_rows_are_an_empty_table(method):
    write_set(method, 0, b"{}", {"checks.csv": table_bytes([])})
    assert read_sets(method.folder.parent)["previous"][0].rows("checks.csv") == []


def test_a_set_that_another_process_has_finished_stays_and_its_checkpoint_goes(method):
    method.checkpoint(1).write_bytes(b"under way")
    write_set(method, 1, b'{"set": "again"}', {})
    assert read_sets(method.folder.parent)["previous"][0].summary == {"set": 1}
    assert sorted(path.name for path in method.folder.iterdir()) == ["set-01", "settings.json"]


def test_what_is_not_finished_is_passed_over(method):
    method.checkpoint(0).write_bytes(b"under way")
    (method.folder / ".set-02.77.partial").mkdir()
    (method.folder.parent / "notes").mkdir()
    assert [one.folder.name for one in read_sets(method.folder.parent)["previous"]] == ["set-01"]
    with pytest.raises(InputError, match="holds no finished set; run 'coevo reproduce chapter3' first"):
        read_sets(method.folder.parent / "notes")


def test_a_set_that_cannot_be_written_leaves_nothing(method, monkeypatch):
    write = sets.write_whole

    def full(path, data):
        if path.name == "set.json":
            raise OSError(28, "No space left on device")
        write(path, data)

    monkeypatch.setattr(sets, "write_whole", full)
    with pytest.raises(OSError, match="No space left"):
        write_set(method, 0, b"{}", {"trials.csv": b""})
    assert not method.set_folder(0).exists()
    assert method.missing(1) == [0]


def test_sets_of_other_settings_do_not_mix(method):
    assert open_method(method.folder, "{}\n") == method
    with pytest.raises(InputError, match="holds sets of other settings"):
        open_method(method.folder, '{"trials": 1}\n')
