"""A learning may be stopped at any moment: it goes on to the same bytes, and nothing of it is ever lost or mixed up."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time

import msgspec
import numpy as np
import pytest

from behaviors import checkpoint
from behaviors.checkpoint import read_checkpoint, write_checkpoint
from behaviors.learning import Learning, learn
from behaviors.practice import Standing
from behaviors.recipe import read_recipe
from coevo.cli import main
from coevo.config import to_toml
from coevo.console import put_off_interrupt
from coevo.errors import InputError
from coevo.files import digest_of, pack_arrays, read_arrays

TRIALS = 1000


def small(storage="dense", **parts):  # noqa: ANN003 - settings of a recipe
    """Return a recipe that is learned in about a second."""
    recipe = read_recipe("search")
    few = msgspec.structs.replace(recipe.experience, windows=1000)
    settings = msgspec.structs.replace(recipe.learning, check_every=500, check_games=20, storage=storage)
    return msgspec.structs.replace(recipe, trials=TRIALS, experience=few, learning=settings, **parts)


def begin(recipe, **parts):  # noqa: ANN003 - seed or trials
    return Learning(recipe, **{"seed": recipe.seed, "trials": recipe.trials, **parts})


def load(path, recipe, **parts):  # noqa: ANN003 - seed or trials
    return Learning.load(path, recipe, **{"seed": recipe.seed, "trials": recipe.trials, **parts})


def finish(learning, path):
    """Bring a learning to its end and return the bytes of its skill file."""
    while not learning.is_finished:
        learning.advance()
    learning.skill().save(path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the bytes of the skill that an undisturbed learning gives, and those of its recipe."""
    folder, recipe = tmp_path_factory.mktemp("whole"), small()
    learn(recipe).save(folder / "skill.npz")
    (folder / "small.toml").write_text(to_toml(recipe), encoding="utf-8")
    return (folder / "skill.npz").read_bytes(), folder / "small.toml"


@pytest.fixture
def stopped(tmp_path):
    """Return the path of the checkpoint of a learning after half of its trials."""
    learning = begin(small())
    for _ in range(2):
        learning.advance()
    learning.save(tmp_path / "learning.npz")
    return tmp_path / "learning.npz"


# ---------------------------------------------------------------------------------------------------------- going on


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_a_learning_stopped_after_any_block_gives_the_same_bytes(storage, tmp_path):
    recipe = small(storage)
    expected = finish(begin(recipe), tmp_path / "skill.npz")
    learning = begin(recipe)
    for done in range(0, TRIALS + 1, 250):
        assert learning.done == done
        learning.save(tmp_path / "learning.npz")
        again = load(tmp_path / "learning.npz", recipe)
        assert again.done == done
        again.save(tmp_path / "again.npz")
        assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "learning.npz").read_bytes()
        assert finish(again, tmp_path / "again") == expected
        if not learning.is_finished:
            learning.advance()


def test_a_learning_handed_on_after_each_block_gives_the_same_bytes(whole, tmp_path):
    path, recipe = tmp_path / "learning.npz", small()
    begin(recipe).save(path)
    for _ in range(TRIALS // 250):
        learning = load(path, recipe)
        learning.advance()
        learning.save(path)
    assert finish(load(path, recipe), tmp_path / "skill.npz") == whole[0]


def test_what_is_kept_is_what_stood_there(stopped):
    header, arrays = read_checkpoint(stopped, _identity())
    standing = Standing.unpack(header, arrays)
    assert (standing.done, standing.kept_after) == (500, 500)
    assert len(standing.best) == len(standing.tables) == 1
    assert len(standing.results.ends) == 500
    write_checkpoint(stopped.with_name("again.npz"), _identity(), header, arrays)
    assert stopped.with_name("again.npz").read_bytes() == stopped.read_bytes()


def attempt(path):
    """Return header and arrays of where a learning stands and no message, or None and the message."""
    try:
        return read_checkpoint(path, _identity()), ""
    except InputError as error:
        return None, str(error)


def _identity():
    return {**msgspec.to_builtins(small()), "seed": 1, "trials": TRIALS}


# ------------------------------------------------------------------------------------- checkpoints that are not ours


@pytest.mark.parametrize(
    ("recipe", "parts", "says"),
    [
        (small("sparse"), {}, "learning.storage is 'dense' there and 'sparse' here"),
        (small(time_limit_steps=299), {}, "time_limit_steps is 300 there and 299 here"),
        (small(), {"seed": 2}, "seed is 1 there and 2 here"),
        (small(), {"trials": 999}, "trials is 1000 there and 999 here"),
        (read_recipe("shoot"), {"seed": 1, "trials": TRIALS}, "name is 'search' there and 'shoot' here"),
    ],
    ids=["storage", "time", "seed", "trials", "task"],
)
def test_another_learning_is_refused_by_what_is_different(stopped, recipe, parts, says):
    before = stopped.read_bytes()
    with pytest.raises(InputError) as caught:
        load(stopped, recipe, **parts)
    for part in (str(stopped), says, "--restart"):
        assert part in str(caught.value)
    assert stopped.read_bytes() == before


def test_another_version_is_refused(stopped, monkeypatch, tmp_path):
    monkeypatch.setattr(checkpoint, "cache_folder", lambda: tmp_path / "0123456789")
    with pytest.raises(InputError, match=r"another version of coevo or its libraries.*--restart"):
        load(stopped, small())


def test_every_damaged_byte_is_noticed_or_does_not_matter(stopped):
    data, rng, noticed = stopped.read_bytes(), np.random.default_rng(1), 0
    places = rng.choice(len(data), 200, replace=False)
    for place in places:
        damaged = bytearray(data)
        damaged[place] ^= int(rng.integers(1, 256))
        stopped.write_bytes(bytes(damaged))
        standing, message = attempt(stopped)
        if standing is None:
            assert str(stopped) in message
            assert "--restart" in message
            noticed += 1
        else:
            write_checkpoint(stopped, _identity(), *standing)
            assert stopped.read_bytes() == data
    assert noticed > 150


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", None], ids=["empty", "no zip", "another npz"])
def test_another_file_is_refused(stopped, content):
    arrays = {"format": np.array([1]), "codes": np.arange(5)}
    stopped.write_bytes(pack_arrays({**arrays, "digest": digest_of(arrays)}) if content is None else content)
    with pytest.raises(InputError, match=r"no checkpoint of a learning or is damaged.*--restart"):
        load(stopped, small())


def test_another_format_is_refused_by_its_number(stopped):
    arrays = read_arrays(stopped)
    del arrays["digest"]
    arrays["format"] = np.array([7])
    stopped.write_bytes(pack_arrays({**arrays, "digest": digest_of(arrays)}))
    with pytest.raises(InputError, match="format 7, this version reads format 2"):
        load(stopped, small())


# -------------------------------------------------------------------------------------------------- the command line


@pytest.fixture
def coevo(monkeypatch, capsys):
    """Return a function that runs a command in this process and returns its exit code, stdout and stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["coevo", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code
        return code or 0, *capsys.readouterr()

    return run


def test_an_unfinished_learning_is_neither_replaced_nor_gone_on_with_unasked(coevo, whole, stopped):
    before = stopped.read_bytes()
    code, out, err = coevo("learn", whole[1], "--out", stopped.parent)
    assert (code, out) == (2, "")
    assert "holds an unfinished learning, 500 of 1000 trials; go on with --resume, or throw it away with --rest" in err
    code, _, err = coevo("learn", whole[1], "--out", stopped.parent, "--resume", "--seed", "5")
    assert code == 2
    assert "seed is 1 there and 5 here" in err
    code, _, err = coevo("learn", whole[1], "--out", stopped.parent, "--resume", "--restart")
    assert code == 2
    assert "give one of them" in err
    assert stopped.read_bytes() == before
    assert [path.name for path in stopped.parent.iterdir()] == ["learning.npz"]


@pytest.mark.parametrize("choice", ["--resume", "--restart"])
def test_both_choices_end_with_the_same_skill_and_no_checkpoint(choice, coevo, whole, stopped):
    code, out, err = coevo("learn", whole[1], "--out", stopped.parent, choice, "--games", "20", "--json")
    assert code == 0
    assert ("Going on after 500 of 1000 trials." in err) == (choice == "--resume")
    assert (stopped.parent / "skill.npz").read_bytes() == whole[0]
    assert sorted(path.name for path in stopped.parent.iterdir()) == ["card.json", "recipe.toml", "skill.npz"]
    again = coevo("learn", whole[1], "--out", stopped.parent, "--resume", "--json")
    assert again[:2] == (0, out)  # it was finished
    assert (stopped.parent / "skill.npz").read_bytes() == whole[0]
    code, _, err = coevo("learn", whole[1], "--out", stopped.parent, "--resume", "--seed", "9")
    assert code == 2
    assert "holds another skill and no unfinished learning" in err


def test_a_damaged_checkpoint_is_told_of_and_can_be_thrown_away(coevo, whole, stopped):
    stopped.write_bytes(stopped.read_bytes()[:-100])
    for choice in ([], ["--resume"]):
        code, out, err = coevo("learn", whole[1], "--out", stopped.parent, *choice)
        assert (code, out) == (2, "")
        assert "damaged" in err
        assert "--restart" in err
        assert "Traceback" not in err
    code, _, _ = coevo("learn", whole[1], "--out", stopped.parent, "--restart", "--games", "20", "--quiet")
    assert code == 0
    assert (stopped.parent / "skill.npz").read_bytes() == whole[0]


def interrupted(reached, number):
    with put_off_interrupt():
        os.kill(os.getpid(), number)
        reached.append("the end of the block")
    reached.append("what comes after it")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_kill_are_put_off_to_the_end_of_a_block(number):
    reached, before = [], signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        interrupted(reached, number)
    assert reached == ["the end of the block"]
    assert signal.getsignal(number) is before
    with put_off_interrupt():
        pass  # nothing came


def test_a_thread_has_no_ctrl_c_to_put_off():
    reached = []

    def block():
        with put_off_interrupt():
            reached.append(True)

    thread = threading.Thread(target=block)
    thread.start()
    thread.join()
    assert reached == [True]


# ------------------------------------------------------------------------------------------------ a process that dies

# A checkpoint after each block, so that few trials are enough to be stopped between.
PROGRAM = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
import behaviors.learned as learned
learned._SAVE_EVERY_S, learned._SAVE_SHARE = 0.0, 1.0
from coevo.cli import main
main()
"""
LONG = 12_000


@pytest.fixture(scope="module")
def lasting(tmp_path_factory):
    """Return the path of a recipe of some seconds, and the bytes of its skill."""
    recipe = msgspec.structs.replace(small(), trials=LONG)
    path = tmp_path_factory.mktemp("lasting") / "lasting.toml"
    path.write_text(to_toml(recipe), encoding="utf-8")
    learn(recipe).save(path.with_name("skill.npz"))
    return path, path.with_name("skill.npz").read_bytes()


@pytest.fixture
def start():
    """Return a function that starts a command in a process of its own; what still lives in the end is killed."""
    started = []

    def go(*arguments):
        command = [sys.executable, "-c", PROGRAM, "learn", *map(str, arguments), "--games", "20"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603
        started.append(process)
        return process

    yield go
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def written(path):
    return path.stat().st_mtime_ns if path.exists() else 0


def wait_for_checkpoint(path, process):
    """Wait until a checkpoint is written, or the process ends."""
    before = written(path)
    while written(path) == before and process.poll() is None:
        time.sleep(0.005)


@pytest.mark.slow
def test_ctrl_c_saves_and_says_how_to_go_on(lasting, start, tmp_path):
    recipe, expected = lasting
    process = start(recipe, "--out", tmp_path)
    wait_for_checkpoint(tmp_path / "learning.npz", process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err
    done = json.loads(bytes(read_arrays(tmp_path / "learning.npz")["header"]))["at"]["done"]
    assert 0 < done < LONG
    again = f"coevo learn {recipe} --out {tmp_path} --games 20 --resume"
    assert f"Stopped; {done} of {LONG} trials are saved. Go on with: {again}" in err
    process = start(recipe, "--out", tmp_path, "--resume", "--quiet")
    _, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    assert (tmp_path / "skill.npz").read_bytes() == expected
    assert not (tmp_path / "learning.npz").exists()


@pytest.mark.slow
def test_a_learning_killed_at_random_moments_goes_on_to_the_same_bytes(lasting, start, tmp_path):
    recipe, expected = lasting
    moment, codes = random.Random(3), []
    for late in (0.0, 0.05, 1.5):
        process = start(recipe, "--out", tmp_path, "--resume")
        if late < 1.0:
            wait_for_checkpoint(tmp_path / "learning.npz", process)
        time.sleep(moment.uniform(0.0, late))  # then it learns, writes, or still starts
        process.kill()
        process.communicate()
        codes.append(process.returncode)
    assert -signal.SIGKILL in codes
    process = start(recipe, "--out", tmp_path, "--resume", "--quiet")
    _, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, "")
    assert (tmp_path / "skill.npz").read_bytes() == expected
    assert not (tmp_path / "learning.npz").exists()
