"""The one reader of settings: plain data, as TOML gives it, to typed and frozen settings, and back."""

from __future__ import annotations

import math
import re
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import tomli_w
from msgspec import Meta, Struct

from coevo.errors import InputError, nearest_name
from coevo.files import MOST_TEXT_BYTES, read_text

__all__ = [
    "FileSettings",
    "NonNegative",
    "Positive",
    "Range",
    "Settings",
    "Share",
    "assign",
    "check",
    "file_kind",
    "override",
    "read_toml",
    "to_toml",
]

_S = TypeVar("_S", bound=Struct)
Positive = Annotated[float, Meta(ge=1e-6, le=1e6)]  # what is nearer to 0 leaves the numbers
NonNegative = Annotated[float, Meta(ge=0.0, le=1e9)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Range = tuple[float, float]


_MOST_PARTS = 64  # of a dotted key
_MOST_DEPTH = 32  # of tables and lists within each other
_MOST_SHOWN = 200  # characters of a value, in a message
_KEY_PART = re.compile(r"[\w\"' \t\[-]+")
_INDEX = re.compile(r"[0-9]{1,6}")


class Settings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all settings: frozen, by keyword only, no unknown keys."""


class FileSettings(Settings, frozen=True, kw_only=True):
    """Base of what a whole file holds; each has a field ``kind``, whose one value says what the file is."""


# What each kind of file is, and the command that takes it.
_KINDS = {
    "evolution": ("an experiment of evolution", "coevo evolve"),
    "skill": ("the recipe of a skill", "coevo learn"),
    "schedule": ("a schedule of two robots", "coevo reproduce chapter3"),
    "team": ("a recipe of several learners", "coevo study"),
    "study": ("a study of many runs", "coevo study"),
}
# Settings that have another name, or stand elsewhere, than they once did.
_MOVED = {
    "game.pass_window_s": "world.rules.pass_window_s",
    "game.collision_release_m": "world.rules.collision_release_m",
    "pass_window_s": "world.rules.pass_window_s",
    "kind = 'scheduled'": "periods = 'scheduled'",
    "kind = 'simultaneous'": "periods = 'simultaneous'",
}


def check(kind: type[_S], data: Mapping[str, Any], source: str) -> _S:
    """Make settings of ``kind`` from plain data, as TOML gives it.

    Raises:
        InputError: a key is unknown (the nearest is offered), a value has the wrong type or is out of range, or it is
            a file of another kind (the command that takes it is offered).

    Example:
        >>> from coevo.config import WorldSettings, check
        >>> check(WorldSettings, {"robot": {"max_speed_mps": 0.5}}, "mine").robot.max_speed_mps
        0.5
        >>> check(WorldSettings, {"robot": {"max_sped_mps": 0.5}}, "mine")
        Traceback (most recent call last):
        coevo.errors.InputError: mine: unknown setting 'robot.max_sped_mps'. Did you mean 'max_speed_mps'?
    """
    _check_plain(data, source)
    if issubclass(kind, FileSettings):
        _check_file_kind(file_kind(kind), data, source)
    _check_keys(kind, data, source, "")
    try:
        return msgspec.convert(dict(data), kind)
    except msgspec.ValidationError as error:
        text, _, where = str(error).partition(" - at `$.")
        text = (
            text.replace("Expected `object | null`", "expected a table")
            .replace("Expected `object`", "expected a table")
            .replace("Expected", "expected")
        )
        path = where.rstrip("`").replace("[...]", ".*").replace("[", ".").replace("]", "")
        if ".*" in path:
            path = _name_key(kind, data, path, str(error))
        came = _look_up(data, path)
        if text.startswith("Invalid enum value"):
            text = f"expected one of {', '.join(map(repr, _choices(kind, path)))}"
        got = f", got {_shown(came)}" if path and not isinstance(came, Mapping) and "got" not in text else ""
        raise InputError(f"{source}: {path + ': ' if path else ''}{text.replace('`', '')}{got}") from None


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


def _check_plain(data: Any, source: str) -> None:
    """Refuse what no setting is: tables within tables without end, numbers of thousands of digits, NUL in a text."""
    waiting: list[tuple[str, Any, int]] = [("", data, 0)]
    while waiting:
        path, value, depth = waiting.pop()
        here = f"{source}: {path[:_MOST_SHOWN]}" if path else source
        if depth > _MOST_DEPTH:
            raise InputError(f"{here}: tables and lists lie within each other {_MOST_DEPTH} times at most")
        if isinstance(value, Mapping):
            pairs: list[tuple[Any, Any]] = list(value.items())
        else:
            pairs = list(enumerate(value)) if isinstance(value, list | tuple) else []
        if isinstance(value, int) and abs(value) >= 1 << 64:
            raise InputError(f"{here}: expected a number of 19 digits at most")
        if any(isinstance(one, str) and not _is_text(one) for one in (value, *(key for key, _ in pairs))):
            raise InputError(f"{here}: expected a text without the character NUL, and of whole characters")
        waiting += [(f"{path}.{key}" if path else str(key), item, depth + 1) for key, item in pairs]


def _is_text(text: str) -> bool:
    try:
        return b"\0" not in text.encode()
    except UnicodeEncodeError:
        return False


def file_kind(kind: type[FileSettings]) -> str:
    """Return what a file of these settings says it is."""
    return next(str(field.default) for field in msgspec.structs.fields(kind) if field.name == "kind")


def _check_file_kind(wanted: str, data: Mapping[str, Any], source: str) -> None:
    """Refuse a file that says it is of another kind; one that says nothing is taken for what it should be."""
    came = data.get("kind", wanted)
    if came == wanted:
        return
    if isinstance(came, str) and came in _KINDS:
        what, command = _KINDS[came]
        raise InputError(f"{source} is {what}, not {_KINDS[wanted][0]}: '{command}' takes it")
    moved = _MOVED.get(f"kind = {came!r}")
    hint = f"; write {moved} for what was kind = {came!r}" if moved else ""
    raise InputError(f"{source}: kind: expected {wanted!r}, got {came!r}{hint}")


def _name_key(kind: type[_S], data: Mapping[str, Any], path: str, message: str) -> str:
    """Return the path with the key that msgspec does not tell: the first that alone gives the same message."""
    table, _, rest = path.partition(".*")
    for key, value in _look_up(data, table).items():
        try:
            msgspec.convert(assign(data, {table: {key: value}}, table), kind)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return f"{table}.{key}{rest}"
    return path


def _check_keys(kind: Any, data: Any, source: str, path: str) -> None:
    if isinstance(data, float) and not math.isfinite(data):
        raise InputError(f"{source}: {path}: expected a finite number, got {data}")
    if isinstance(data, list | tuple):
        item = next((a for a in _arguments(kind) if _is_settings(a)), None)
        for index, value in enumerate(data):
            _check_keys(item, value, source, f"{path}.{index}")
    values = _values_of(kind)
    if values is not None and isinstance(data, Mapping):  # its keys are anyone's
        for key, value in data.items():
            _check_keys(values, value, source, f"{path}.{key}")
        return
    kind = next((a for a in [kind, *_arguments(kind)] if _is_settings(a)), None)
    if kind is None or not isinstance(data, Mapping):
        return
    fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
    for key, value in data.items():
        here = f"{path}.{key}" if path else str(key)
        if key not in fields:
            if here in _MOVED:
                raise InputError(f"{source}: there is no setting {here!r}; it is {_MOVED[here]!r} now")
            known = nearest_name(str(key), fields) or f" Known here: {', '.join(fields)}."
            raise InputError(f"{source}: unknown setting {here!r}.{known}")
        _check_keys(fields[key], value, source, here)


def _values_of(kind: Any) -> Any:
    """Return the type of the values of a table with any keys, None for other types."""
    bare = typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else kind
    return typing.get_args(bare)[1] if typing.get_origin(bare) is dict else None


def _choices(kind: Any, path: str) -> list[Any]:
    """Return what a setting with a closed list of values may be."""
    for part in path.split("."):
        values = _values_of(kind)
        if values is not None:
            kind = values
            continue
        inner = next((a for a in [kind, *_arguments(kind)] if _is_settings(a)), None)
        if inner is not None and not part.isdigit():
            kind = {field.encode_name: field.type for field in msgspec.structs.fields(inner)}.get(part)
    return [choice for choice in _arguments(kind) if isinstance(choice, str)]


def _is_settings(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Struct)


def _arguments(kind: Any) -> list[Any]:
    found: list[Any] = []
    for argument in typing.get_args(kind):
        found += [argument, *_arguments(argument)]
    return found


def _look_up(data: Any, path: str) -> Any:
    for part in path.split(".") if path else []:
        if isinstance(data, Mapping):
            data = data.get(part)
        elif isinstance(data, list | tuple) and _INDEX.fullmatch(part) and int(part) < len(data):
            data = data[int(part)]
    return data


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; a missing or broken one is an InputError that says where."""
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot read {path}: {reason}") from None
    except ValueError as error:  # of its name
        raise InputError(f"cannot read {str(path)!r}: {error}") from None
    try:
        data = _parse(text)
    except ValueError as error:
        raise InputError(f"{path} is not valid TOML: {error}") from None
    _check_plain(data, str(path))
    return data


def _parse(text: str) -> dict[str, Any]:
    """Read TOML.

    Raises:
        ValueError: it is none, or none that anybody writes: Python's reader takes the square of a key's parts as long.
    """
    if len(text) > MOST_TEXT_BYTES:
        raise ValueError(f"it is longer than {MOST_TEXT_BYTES} characters")
    run = 0
    for part in text.split("."):
        run = run + 1 if _KEY_PART.fullmatch(part) else 0
        if run > _MOST_PARTS:
            raise ValueError(f"a key has more than {_MOST_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists and tables lie within each other too deep") from None


def to_toml(settings: Struct) -> str:
    """Return every setting, resolved, as TOML that 'check' reads back to equal settings.

    TOML has no word for None: such a setting is left out, and None is what it is then.

    Example:
        >>> from coevo.config import ConditionSettings, to_toml
        >>> print(to_toml(ConditionSettings(objects=("ball",), expression="area >= 40")), end="")
        objects = [
            "ball",
        ]
        expression = "area >= 40"
    """
    return tomli_w.dumps(_without_none(msgspec.to_builtins(settings)))


def _without_none(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    if isinstance(data, list | tuple):
        return [_without_none(value) for value in data]
    return data


def override(data: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """Return plain data with settings replaced, each given as ``dotted.key=value`` (the value as in TOML).

    Example:
        >>> from coevo.config import override
        >>> override({"gp": {"population": 80}}, ["gp.population=40", "fitness.kind=varying"])
        {'gp': {'population': 40}, 'fitness': {'kind': 'varying'}}
    """
    result = typing.cast("dict[str, Any]", _thaw(data))
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--set expects KEY=VALUE, such as gp.population=40; got {assignment!r}")
        try:
            value = _parse(f"value = {text}")["value"]
        except ValueError:  # not TOML, or a number of thousands of digits: take it as text
            value = text.strip()
        said = f"--set {assignment if len(assignment) <= _MOST_SHOWN else assignment[:_MOST_SHOWN] + '...'}"
        _check_plain(value, said)
        _put(result, key.strip(), value, said)
    return result


def assign(data: Mapping[str, Any], values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return plain data with settings replaced, each given by its dotted key.

    Args:
        data: as TOML gives it.
        values: what is put where, in this order.
        where: in which file or table they stand, for messages.

    Raises:
        InputError: a key leads into a single value, or past the end of a list.

    Example:
        >>> from coevo.config import assign
        >>> assign({"gp": {"population": 80}}, {"gp.population": 40, "fitness.kind": "varying"}, "mine.toml")
        {'gp': {'population': 40}, 'fitness': {'kind': 'varying'}}
    """
    result = typing.cast("dict[str, Any]", _thaw(data))
    for key, value in values.items():
        _put(result, key, _thaw(value), f"{where}: {key}")
    return result


def _put(result: dict[str, Any], key: str, value: Any, said: str) -> None:
    """Put a value at its dotted key; ``said`` is what the user gave, for messages."""
    if key.count(".") >= _MOST_PARTS // 2:
        raise InputError(f"{said}: a key has {_MOST_PARTS // 2} parts at most")
    *folders, last = key.split(".")
    node: Any = result
    for folder in folders:
        node = _step_into(node, folder, said)
    if isinstance(node, list):
        node[_index(node, last, said)] = value
    elif isinstance(node, dict):
        node[last] = value
    else:
        raise InputError(f"{said}: {'.'.join(folders)} is a single value and has no parts")


def _step_into(node: Any, part: str, said: str) -> Any:
    if isinstance(node, list):
        return node[_index(node, part, said)]
    if isinstance(node, dict):
        return node.setdefault(part, {})
    raise InputError(f"{said}: {part!r} lies below a single value, which has no parts")


def _index(items: list[Any], part: str, said: str) -> int:
    if not _INDEX.fullmatch(part) or int(part) >= len(items):
        raise InputError(f"{said}: expected an index from 0 to {len(items) - 1}, got {_shown(part)}")
    return int(part)


def _thaw(data: Any) -> Any:
    if isinstance(data, Mapping | types.MappingProxyType):
        return {key: _thaw(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_thaw(value) for value in data]
    return data
