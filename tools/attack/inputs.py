"""Settings, recipes, trees and archives that nobody means: each is refused in words, or read as what it says."""

from __future__ import annotations

import io
import random
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
from runner import Case

from behaviors.recipe import Recipe
from coevo.config import check, check_experiment, override, read_toml
from coevo.errors import InputError
from coevo.files import DamagedFileError, pack_arrays, read_arrays
from coevo.recipes import read_recipe, recipe_names, recipe_path
from coevo.skill import load_skill, skill_path
from coevo.study.plan import StudySettings
from coevo.tree import Tree, parse, simplify

__all__ = ["archives", "settings", "trees"]

_VALUES = (
    "1e-300", "5e-324", "1e308", "inf", "-inf", "nan", "0", "-1", "true", '""', '"x"', "[]", "{}", "[[]]", "1e400",
    "9" * 5000, "0x" + "f" * 5000, "[" * 1500, "[" * 40 + "]" * 40, "{a=" * 300, '"a\\u0000.npz"', '"\\ud800"',
    '"a\\n"', "[1, [2, [3]]]", "1979-05-27", '"../../etc/passwd"', '"/dev/zero"', "[" + "1," * 20000 + "]", "-0.0",
    '"' + "a" * 100000 + '"', "18446744073709551616", "{" + ", ".join(f"k{i} = {i}" for i in range(3000)) + "}",
)  # fmt: skip
_KEYS = (
    "players.².team", "players." + "9" * 5000 + ".team", "players.-1.team", "players.9.team", ".".join("a" * 1000),
    "", ".", "a..b", "players.0.0.0", "gp.start.r0", "skills.\x00", "game", "world", "players", "levels",
    "conditions.near", "evaluation.against", "hand_typed.0", "seed.x", "players.٣.team", "skills." + "a" * 1000,
)  # fmt: skip


def _leaves(data: object, path: str = "") -> Iterator[str]:
    """Yield the dotted key of every setting."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list | tuple) else ()
    for key, value in pairs:
        here = f"{path}.{key}" if path else str(key)
        yield here
        yield from _leaves(value, here)


def settings(count: int, rng: random.Random, folder: Path) -> Iterator[Case]:
    """Yield settings on the command line, and recipes and studies whose text was changed here and there."""
    whole = msgspec.to_builtins(check_experiment(read_recipe("smoke", "evolution"), "smoke"))
    keys = [*_KEYS, *_leaves(whole)]
    every = [f"{key}={value}" for key in keys for value in _VALUES]
    rng.shuffle(every)
    recipe = read_recipe("smoke", "evolution")
    for text in every[: count // 2]:
        yield Case("--set", text[:100], lambda text=text: _set(recipe, text))
    kinds = {"evolution": check_experiment, "skill": _check_skill, "study": _check_study}
    texts = [
        (kind, recipe_path(name, kind).read_bytes()) for kind in ("evolution", "study") for name in recipe_names(kind)
    ]
    texts += [("skill", path.read_bytes()) for path in skill_path("shoot").parents[1].glob("*/recipe.toml")]
    for number in range(count - count // 2):
        kind, data = texts[rng.randrange(len(texts))]
        seed = rng.getrandbits(64)
        path = folder / f"recipe-{number % 64}.toml"
        yield Case(
            f"recipes ({kind})",
            f"{kind}, seed {seed}",
            lambda data=data, seed=seed, kind=kind, path=path: _recipe(data, seed, kinds[kind], path),
        )


def _set(recipe: dict[str, object], text: str) -> str | None:
    check_experiment(override(recipe, [text]), "smoke")
    return None


def _check_skill(data: dict[str, object], source: str) -> None:
    check(Recipe, data, source)


def _check_study(data: dict[str, object], source: str) -> None:
    check(StudySettings, data, source)


_TOKENS = (b"[", b"]", b"{", b"}", b"=", b".", b'"', b"'''", b"\0", b"\xff", b"\n", b"#", b"1e400", b"[[", b"a.b.c.d=")


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return data with a few things changed, taken out, doubled or put in."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        at = rng.randrange(len(changed) + 1)
        match rng.randrange(7):
            case 0 if at < len(changed):
                changed[at] = rng.randrange(256)
            case 1:
                del changed[at : at + rng.choice((1, 4, 100, len(changed)))]
            case 2:
                changed[at:at] = changed[at : at + rng.randrange(1, 200)] * rng.choice((1, 2, 50))
            case 3:
                changed[at:at] = rng.choice(_TOKENS) * rng.choice((1, 2, 3000))
            case 4:
                changed[at:at] = rng.randbytes(rng.randrange(1, 30))
            case 5:
                lines = bytes(changed).split(b"\n")
                rng.shuffle(lines)
                changed = bytearray(b"\n".join(lines))
            case _:
                lines = bytes(changed).split(b"\n")
                line = rng.randrange(len(lines))
                key, mark, _ = lines[line].partition(b"=")
                lines[line] = key + mark + rng.choice(_VALUES).encode()
                changed = bytearray(b"\n".join(lines))
    return bytes(changed)


def _recipe(data: bytes, seed: int, read: Callable[[dict[str, object], str], object], path: Path) -> None:
    path = path.with_stem(f"{path.stem}-{seed}")
    path.write_bytes(mutated(data, random.Random(seed)))
    try:
        read(read_toml(path), str(path))
    finally:
        path.unlink()


# ------------------------------------------------------------------------------------------------ trees


def trees(count: int, rng: random.Random) -> Iterator[Case]:
    """Yield texts of trees that are none, and trees that are deep; what is read is simplified, and written back."""
    things, categories = ("ball", "own_goal", "opponent_goal", "r1", "r2"), ("left", "small", "large", "lost", "middle")
    questions = [f"IF_{thing}_is_{category}" for thing in things for category in categories]
    for number in range(count):
        seed = rng.getrandbits(64)
        depth = 1000 if number % 50 == 0 else rng.randrange(1, 40)
        yield Case(
            "trees", f"depth {depth}, seed {seed}", lambda s=seed, d=depth: _tree(random.Random(s), d, questions)
        )


def _tree(rng: random.Random, depth: int, questions: list[str]) -> str:
    skills = ("shoot", "pass", "avoid", "search")
    names: list[str] = []
    for _ in range(depth):  # a chain of questions, to the left or to the right
        names += [rng.choice(questions)] + ([rng.choice(skills)] if rng.random() < 0.5 else [])
    missing = 1
    for name in names:
        missing += 1 if name.startswith("IF_") else -1
    names += [rng.choice(skills) for _ in range(missing)]
    tree = Tree(tuple(names))
    text = str(tree)
    if parse(text) != tree:
        return "a tree is not what was written"
    smaller = simplify(tree)
    if smaller.nodes > tree.nodes or simplify(smaller) != smaller:
        return "a simplified tree is not the smallest"
    broken = mutated(text.encode(), rng).decode("utf-8", "replace")
    str(simplify(parse(broken)))
    return ""


# ------------------------------------------------------------------------------------------------ archives


def archives(count: int, rng: random.Random, folder: Path) -> Iterator[Case]:
    """Yield skill files that are damaged or made to harm: refused, or as good as whole."""
    paths = [skill_path(name) for name in ("shoot", "search", "defend")]
    for name, data in _bombs():
        yield Case("archives made to harm", name, lambda data=data, name=name: _harm(data, folder / f"harm-{name}.npz"))
    wholes = [(path.read_bytes(), load_skill(path).digest) for path in paths]
    for _ in range(count):
        data, digest = wholes[rng.randrange(len(wholes))]
        seed = rng.getrandbits(64)
        yield Case(
            "skill files",
            f"seed {seed}",
            lambda data=data, digest=digest, seed=seed: _skill(data, digest, seed, folder / f"skill-{seed}.npz"),
        )


def _skill(data: bytes, digest: str, seed: int, path: Path) -> str:
    rng = random.Random(seed)
    path.write_bytes(_deep(data, rng) if rng.random() < 0.5 else mutated(data, rng))
    try:
        found = load_skill(path).digest
    finally:
        path.unlink()
    return "" if found == digest else "another skill was read as if it were sound"


def _deep(data: bytes, rng: random.Random) -> bytes:
    """Return an archive that is one, with sums that are right, and one of its entries changed."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    name = rng.choice(list(entries))
    entries[name] = mutated(entries[name], rng)
    return zipped(entries)


def zipped(entries: dict[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return an archive of entries as they are."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", kind) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return whole.getvalue()


def _npy(header: bytes, data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    size = struct.pack("<H" if version == b"\x01\x00" else "<I", len(header) & (0xFFFF if version[0] == 1 else -1))
    return b"\x93NUMPY" + version + size + header + data


def _bombs() -> Iterator[tuple[str, bytes]]:
    """Yield archives by name, that declare too much, unpack to too much, or hold what is no array."""
    shapes = {"tera": "(1000000000000, )", "many": "(" + "1, " * 5000 + ")", "negative": "(-1, )", "text": "'x'"}
    shapes |= {"power": "(9**9**9, )", "long": "(" + "9" * 6000 + ", )", "nested": "(" * 3000}
    for name, shape in shapes.items():
        header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        yield f"shape-{name}", zipped({"header.npy": _npy(header, bytes(64))})
    for name, kind in {
        "object": "|O",
        "void": "|V9999999",
        "unicode": "<U999999999",
        "fields": "[('a', '<f8')]",
    }.items():
        header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': (3, ), }}\n".encode()
        yield f"kind-{name}", zipped({"header.npy": _npy(header, bytes(64))})
    yield "unfinished", zipped({"header.npy": _npy(b"{'descr': '<f8', (((", b"")})
    yield "tokens", zipped({"header.npy": _npy(b"{'descr': \\\n'''", b"")})
    yield "nothing", zipped({"header.npy": b""})
    large = np.zeros(400_000_000, np.uint8)
    yield "bomb", pack_arrays({"header": large, "values": large})
    header = b"{'descr': '|u1', 'fortran_order': False, 'shape': (16, ), }\n"
    lying = bytearray(zipped({"header.npy": _npy(header, bytes(300_000_000))}))
    at = bytes(lying).rindex(b"PK\x01\x02")
    lying[at + 24 : at + 28] = struct.pack("<I", len(_npy(header, bytes(16))))
    yield "bomb-that-lies", bytes(lying)
    yield "lzma", zipped({"header.npy": _npy(header, bytes(16))}, zipfile.ZIP_LZMA)
    yield "bzip2", zipped({"header.npy": _npy(header, bytes(16))}, zipfile.ZIP_BZIP2)
    yield "crowd", zipped({f"{number}.npy": b"" for number in range(20_000)})
    yield "json", pack_arrays({"header": np.frombuffer(b"[" * 200_000, np.uint8)})
    about = b'{"format": 1, "objects": [{"kind": "ball", "history_length": 1e999, "cell": 1e999}]}'
    yield "endless", pack_arrays({"header": np.frombuffer(about, np.uint8), "memory_matrix_0": np.zeros((1, 6)), "past_mean_0": np.zeros(6)})  # fmt: skip  # noqa: E501


def _harm(data: bytes, path: Path) -> str:
    path.write_bytes(data)
    try:
        with suppress(DamagedFileError):
            read_arrays(path)
        load_skill(path)
    except InputError:
        return ""
    finally:
        path.unlink()
    return "it was read as a skill"
