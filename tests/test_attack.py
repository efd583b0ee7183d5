"""A small share of the attack, and the holes that were found once: each is closed, and stays so."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from coevo.chain import Chain, sha256
from coevo.errors import InputError
from coevo.files import begin_file, lock, make_folder, read_arrays, read_text, read_whole, write_whole
from coevo.kept import with_kept_skills
from coevo.run import create_run, open_run
from coevo.seal import seal
from coevo.skill import load_skill, read_card, skill_path
from coevo.soundness import check_run, require_as_learned, require_sound, restore
from coevo.tree import parse, simplify

ROOT = Path(__file__).parents[1]
LONG = 5000


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["evolve", "smoke", "--set", "players.².team=1"], id="a digit that is none"),
        pytest.param(["evolve", "smoke", "--set", f"players.{'9' * LONG}.team=1"], id="index of 5,000 digits"),
        pytest.param(["evolve", "smoke", "--set", f"seed=0x{'f' * LONG}"], id="hexadecimal number"),
        pytest.param(["evolve", "smoke", "--set", f"x={'[' * 1500}"], id="lists in lists"),
        pytest.param(["evolve", "smoke", "--set", f"seed={'[' * 300}{']' * 300}"], id="closed lists in lists"),
        pytest.param(["evolve", "smoke", "--set", f"{'.'.join('a' * 1000)}=1"], id="1,000 parts"),
        pytest.param(["evolve", "smoke", "--set", 'skills.shoot="a\\u0000.npz"'], id="NUL in a path"),
        pytest.param(["evolve", "smoke", "--set", 'name="a\\n"'], id="a name that ends with a new line"),
        pytest.param(["evolve", "smoke", "--set", "world.physics.step_s=1e-300"], id="no time"),
        pytest.param(["evolve", "smoke", "--set", "world.ball.mass_kg=5e-324"], id="no mass"),
        pytest.param(["evolve", "smoke", "--workers", "20000"], id="workers"),
        pytest.param(["skills", "evaluate", "shoot", "--games", "1000000000000"], id="games"),
        pytest.param(["evolve", "smoke", "--out", "/".join("a" * 2040)], id="2,040 folders"),
        pytest.param(["evolve", "pipe.toml"], id="a pipe"),
        pytest.param(["evolve", "zero.toml"], id="a device"),
        pytest.param(["evolve", "parts.toml"], id="a header of 100,000 parts"),
        pytest.param(["evolve", "deep.toml"], id="lists in lists in a file"),
        pytest.param(["check", "nowhere"], id="check"),
    ],
)
def test_what_once_was_a_traceback_or_a_hang_is_told(arguments, coevo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.toml")
    Path("zero.toml").symlink_to("/dev/zero")
    Path("parts.toml").write_text(f"[{'.'.join(['a'] * 100_000)}]\n")
    Path("deep.toml").write_text("x=" + "[" * 1500)
    before = sorted(tmp_path.iterdir())
    began = time.monotonic()
    said = coevo(*arguments)
    assert (said.code, said.out) == (2, "")
    assert "Traceback" not in said.err
    assert said.err.count("\n") <= 3
    assert time.monotonic() - began < 10
    assert sorted(tmp_path.iterdir()) == before


def test_a_tree_as_deep_as_a_stack_is_simplified():
    text = "shoot"
    for level in range(1000):
        text = (
            f"IF_{('ball', 'r1', 'own_goal')[level % 3]}_is_{('left', 'lost', 'small')[level % 7 % 3]}({text}, avoid)"
        )
    assert simplify(parse(text)).nodes < 100


# ------------------------------------------------------------------------------------------------ wrong without a word


def test_skills_are_those_that_the_run_was_begun_with(
    small_settings, go_on, results_of, small_run, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("mine.npz").write_bytes(skill_path("shoot").read_bytes())
    run = create_run(Path("run"), small_settings("skills.shoot=mine.npz"))
    Path("mine.npz").write_bytes(skill_path("search").read_bytes())  # replaced, and from another folder
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    run = go_on(open_run(tmp_path / "run"))
    assert results_of(run.path).keys() == results_of(small_run.path).keys()
    assert (run.path / "generations.csv").read_bytes() == (small_run.path / "generations.csv").read_bytes()
    (run.path / "skills" / "shoot" / "skill.npz").write_bytes(skill_path("search").read_bytes())
    with pytest.raises(InputError, match="is not the skill that the run was begun with"):
        with_kept_skills(run.config, run.folders)
    with pytest.raises(InputError, match=r"begun with|does not match its digest"):
        go_on(run)


DAMAGES = {
    "a row that was altered": lambda run: change(run / "generations.csv", b"1,r0,", b"1,r0,9"),
    "settings that were edited": lambda run: change(run / "config.toml", b"tournament = 2", b"tournament = 3"),
    "a part that is lost": lambda run: (run / "individuals.parquet" / "part-00001.parquet").unlink(),
    "a part of another generation": lambda run: (run / "individuals.parquet" / "part-00001.parquet").write_bytes(
        (run / "individuals.parquet" / "part-00000.parquet").read_bytes()
    ),
    "a part too many": lambda run: (run / "individuals.parquet" / "part-00007.parquet").write_bytes(b"x"),
    "an environment that was edited": lambda run: change(run / "environment.json", b"numpy", b"numpi"),
    "digests that were made anew": lambda run: change(run / "digests.txt", b"config.toml,", b"config.toml,0"),
    "an empty table": lambda run: (run / "measures.csv").write_bytes(b""),
}


def change(path, old, new):
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))


@pytest.mark.parametrize("what", DAMAGES)
def test_damage_is_told_and_not_hidden_by_going_on(what, coevo, copied_run, go_on):
    (copied_run / "checkpoint.npz").unlink()  # nothing but the chain knows
    assert coevo("check", copied_run).code == 0
    DAMAGES[what](copied_run)
    before = {path: path.read_bytes() for path in copied_run.rglob("*") if path.is_file()}
    said = coevo("check", copied_run, "--json")
    assert (said.code, '"sound": false' in said.out) == (1, True)
    said = coevo("resume", copied_run)
    assert said.code == 2
    assert str(copied_run) in said.err
    with pytest.raises(InputError):
        go_on(open_run(copied_run))
    assert {path: path.read_bytes() for path in copied_run.rglob("*") if path.is_file()} == before


def test_what_was_altered_is_refused_by_who_reads_it(coevo, copied_run, tmp_path):
    """Each file by a command that shows what is in it, while commands that do not need it go on."""
    whole = {path: path.read_bytes() for path in copied_run.rglob("*") if path.is_file()}
    page = tmp_path / "report.html"
    for name, old, new, arguments in (
        ("config.toml", b"tournament = 2", b"tournament = 3", ["inspect", copied_run]),
        ("generations.csv", b"2,r0,", b"2,r0,9", ["settlements", copied_run, "--games", "2", "--json"]),
        ("environment.json", b"numpy", b"numpi", ["report", copied_run, "--out", page]),
        ("individuals.parquet/part-00001.parquet", b"PAR1", b"PAR2", ["curves", copied_run, "--json"]),
        ("skills/shoot/skill.npz", b"PK", b"KP", ["play", copied_run, "--games", "1"]),
        ("skills/shoot/card.json", b"drives", b"driven", ["inspect", copied_run]),
    ):
        change(copied_run / name, old, new)
        said = coevo(*arguments)
        assert (said.code, said.out) == (2, ""), name
        assert str(copied_run / name) in said.err
        (copied_run / name).write_bytes(whole[copied_run / name])
    part = copied_run / "individuals.parquet" / "part-00001.parquet"
    part.unlink()  # not read as a run of one generation
    said = coevo("curves", copied_run, "--json")
    assert (said.code, f"{part} is lost" in said.err) == (2, True)
    part.write_bytes(whole[part])
    change(copied_run / "measures.csv", b"r0", b"r9")
    assert coevo("curves", copied_run, "--json").code == 0
    assert not page.exists()


def test_a_card_that_was_altered_is_told(coevo, tmp_path):
    shutil.copy(skill_path("search"), tmp_path / "skill.npz")
    (tmp_path / "levels.csv").write_text("trial,event\n")
    path, card = tmp_path / "card.json", seal(read_card("search"), {"levels.csv": b"trial,event\n"})
    path.write_bytes(card)
    assert read_card(tmp_path / "skill.npz") == read_card("search") | {
        "files": {"levels.csv": sha256(b"trial,event\n")}
    }
    assert coevo("check", tmp_path).code == 0
    change(path, b'"success_rate": 0.9', b'"success_rate": 0.8')
    said = coevo("check", tmp_path)
    assert (said.code, f"{path} is damaged: it does not match its digest" in said.out) == (1, True)
    path.write_bytes(card)
    change(tmp_path / "levels.csv", b"event", b"evend")
    with pytest.raises(InputError, match=r"levels\.csv is damaged or was changed"):
        require_as_learned(tmp_path)
    assert coevo("check", tmp_path).code == 1


@pytest.mark.parametrize("text", ["[]", "3", '{"files": 3}', '{"files": {"levels.csv": 3}}', '{"a": 1', ""])
def test_a_card_that_is_none_is_told(coevo, tmp_path, text):
    shutil.copy(skill_path("search"), tmp_path / "skill.npz")
    (tmp_path / "card.json").write_text(text)
    said = coevo("check", tmp_path)
    assert (said.code, "card.json is damaged" in said.out) == (1, True)
    assert coevo("skills", "evaluate", tmp_path / "skill.npz", "--games", 10).code in (0, 2)


def test_who_goes_on_elsewhere_is_told_what_differs(coevo, copied_run):
    assert "Beware" not in coevo("resume", copied_run, "--unseen", "0").err
    path, chain = copied_run / "environment.json", Chain.read((copied_run / "digests.txt").read_text())
    about = json.loads(path.read_text())
    about["versions"]["numpy"], about["processor"] = "0.1", "abacus"
    path.write_text(json.dumps(about))
    whole = Chain().extended({**chain.digests, path.name: sha256(path.read_bytes())})  # as if begun there
    (copied_run / "digests.txt").write_text(whole.text())
    (copied_run / "checkpoint.npz").unlink()
    said = coevo("resume", copied_run, "--unseen", "0")
    assert said.code == 0
    assert "Beware: this run was begun under other conditions" in said.err
    assert "processor abacus there" in said.err
    assert f"numpy 0.1 there, {np.__version__} here" in said.err


def test_tables_that_are_lost_are_made_anew(copied_run, small_run, results_of):
    for name in ("generations.csv", "measures.csv"):
        (copied_run / name).unlink()
    run = open_run(copied_run)
    require_sound(run)
    assert {finding.name for finding in check_run(run) if finding.state == "missing"} == {
        "generations.csv",
        "measures.csv",
    }
    restore(run)
    assert results_of(copied_run) == results_of(small_run.path)


def test_a_chain_that_lacks_a_line_is_none():
    text = Chain().extended({name: sha256(name.encode()) for name in "abc"}).text()
    lines = text.splitlines(keepends=True)
    assert Chain.read(text).head == lines[-1].strip().split(",")[2]
    for wrong in (lines[:2] + lines[3:], [lines[0], lines[2], lines[1], lines[3]], lines[1:], [*lines, "d,e\n"]):
        with pytest.raises(ValueError, match=r"chain|columns|follow"):
            Chain.read("".join(wrong))


# ------------------------------------------------------------------------------------------------ files


def test_nothing_is_written_through_links(tmp_path):
    victim, folder = tmp_path / "victim", tmp_path / "folder"
    victim.write_text("mine")
    folder.mkdir()
    for name in (".x.partial", "x", ".lock"):
        (folder / name).symlink_to(victim)
    write_whole(folder / "x", b"new")
    with pytest.raises(OSError, match="symbolic link"):
        lock(folder / ".lock")
    (folder / ".y.partial").hardlink_to(victim)
    begin_file(folder / ".y.partial").close()
    (tmp_path / "other").mkdir()
    (folder / "results").symlink_to(tmp_path / "other")
    with pytest.raises(OSError, match="nothing is written through links"):
        make_folder(folder / "results" / "deep", within=folder)
    assert victim.read_text() == "mine"
    assert (folder / "x").read_bytes() == b"new"
    assert list((tmp_path / "other").iterdir()) == []


def test_a_lock_that_was_taken_away_is_not_held(tmp_path):
    release = lock(tmp_path / ".lock")
    with pytest.raises(BlockingIOError):
        lock(tmp_path / ".lock")
    release()
    assert list(tmp_path.iterdir()) == []
    lock(tmp_path / ".lock")()


def test_what_is_read_is_a_file_and_not_too_large(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"12345")
    assert read_whole(path, 5) == b"12345"
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_text(path, 4)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="no regular file"):
        read_whole(tmp_path / "pipe")
    np.savez(tmp_path / "y.npz", a=np.arange(6.0).reshape(2, 3), b=np.asfortranarray(np.ones((2, 3))), c=["ab", "c"])
    found = read_arrays(tmp_path / "y.npz")
    assert found["a"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert found["b"].tolist() == [[1.0] * 3] * 2
    assert found["c"].tolist() == ["ab", "c"]


def test_a_device_is_not_replaced_by_a_trace(coevo, small_run, tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    said = coevo("play", small_run.path, "--games", "1", "--trace", tmp_path / "pipe.csv")
    assert (said.code, "it is no regular file" in said.err) == (2, True)
    said = coevo("play", small_run.path, "--trace", tmp_path / "x.html", "--video", tmp_path / "x.html")
    assert (said.code, "give two names" in said.err) == (2, True)


def test_a_finished_skill_is_not_replaced_unasked(coevo, tmp_path):
    (tmp_path / "skill.npz").write_bytes(skill_path("shoot").read_bytes())
    said = coevo("learn", "search", "--trials", "10", "--out", tmp_path)
    assert said.code == 2
    assert "holds another skill; replace it with --restart, or choose another --out" in said.err
    assert load_skill(tmp_path / "skill.npz").digest == load_skill("shoot").digest


# ------------------------------------------------------------------------------------------------ the attack


def attack(*arguments):
    command = [sys.executable, str(ROOT / "tools" / "attack"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own


@pytest.mark.slow
def test_a_share_of_the_attack_fails_nowhere():
    done = attack("--scale", "0.02", "--only", "inputs", "--only", "damage", "--only", "crashes")
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 failed" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("family", "scale"), [("structured", 0.02), ("reading", 0.01), ("kills", 0.02)])
def test_what_takes_longer_to_attack_fails_nowhere_either(family, scale):
    done = attack("--scale", str(scale), "--only", family)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 failed" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mutation", "scale", "files"),  # a share that is sure to find it
    [
        ("skip-digest", 0.02, "*.csv"),
        ("skip-parts", 0.02, "*"),
        ("skip-chain", 0.02, "digests.txt"),
        ("drop-fsync", 0.02, "*"),
        ("drop-rename", 0.05, "*"),
        ("drop-lock", 0.02, "*"),
        ("follow-links", 0.02, "*"),
        ("unbounded", 0.02, "*"),
    ],
)
def test_the_attack_fails_where_a_part_of_the_code_is_taken_away(mutation, scale, files):
    done = attack("--scale", str(scale), "--mutation", mutation, "--files", files)
    assert done.returncode == 1, done.stdout + done.stderr
    assert " 0 failed" not in done.stdout.splitlines()[-1]
