"""What a generation leaves behind: its individuals, its lines in the table of generations, and what comes next."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from coevo.errors import InputError
from coevo.files import DamagedFileError, digest_of, pack_arrays, read_arrays

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = [
    "CHOSE",
    "OPERATORS",
    "Checkpoint",
    "GenerationRecord",
    "Origins",
    "best_first",
    "columns",
    "individuals_table",
    "lacking_column",
    "read_checkpoint",
    "read_record",
    "table_lines",
]

# How an individual came into being; a stored one has the number of its operator.
OPERATORS = ("creation", "elite", "reproduction", "crossover", "mutation")
_FORMAT = 3  # of the checkpoint; 2 kept digests of parts, 1 did not tell where individuals came from
CHOSE = "chose_"  # before the name of a terminal: the column that says how often it was chosen


def best_first(fitness: NDArray[np.float64], depth: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of individuals from best to worst: by fitness, then depth, then index; all (population,)."""
    return np.lexsort((np.arange(len(fitness)), depth, fitness)).astype(np.int64)


@dataclass(frozen=True)
class Origins:
    """Where the individuals of a population came from.

    operator: (population,) uint8, place in ``OPERATORS``.
    parents: (population, 2) int32, index in the generation before, -1 for none; the first gave the root.
    """

    operator: NDArray[np.uint8]
    parents: NDArray[np.int32]


@dataclass(frozen=True)
class GenerationRecord:
    """All individuals of one role in one generation.

    role: its number. robot: its name, as in the column of this name.
    codes: per individual its tree, (nodes,) uint8 in prefix order.
    group: (population,) int64, the first group that counted for it. fitness: (population,) float64.
    counts: by name (population,) int64, summed over its games, in the order of the game's counts.
    depth, nodes: (population,) int64.
    origins: where they came from; None in runs of older versions, which did not keep it.
    chosen: by terminal of the role (population,) int64, decisions for it in its games; nothing in older runs.
    rounds: (population, rounds) float64, what the fitness would be if all its games were like those of each round; None
        of a single round.
    """

    role: int
    robot: str
    codes: Sequence[NDArray[np.uint8]]
    group: NDArray[np.int64]
    fitness: NDArray[np.float64]
    counts: Mapping[str, NDArray[np.int64]]
    depth: NDArray[np.int64]
    nodes: NDArray[np.int64]
    origins: Origins | None
    chosen: Mapping[str, NDArray[np.int64]]
    rounds: NDArray[np.float64] | None = None

    @property
    def order(self) -> NDArray[np.int64]:
        """(population,) indices, as of ``best_first``."""
        return best_first(self.fitness, self.depth)


@dataclass(frozen=True)
class Checkpoint:
    """What is needed to go on: the number of the next generation, and per role its trees' codes and their origins."""

    generation: int
    populations: Mapping[int, Sequence[NDArray[np.uint8]]]
    origins: Mapping[int, Origins]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all of it as named arrays."""
        arrays: dict[str, NDArray[Any]] = {"generation": np.array([self.generation])}
        for role, codes in self.populations.items():
            arrays[f"sizes_{role}"] = np.array([len(tree) for tree in codes], np.int64)
            arrays[f"codes_{role}"] = np.concatenate(codes)
            arrays[f"operator_{role}"] = self.origins[role].operator
            arrays[f"parents_{role}"] = self.origins[role].parents
        return arrays

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], roles: Iterable[int]) -> Self:
        """Return what ``arrays`` gave of these roles.

        Raises:
            LookupError, TypeError, ValueError: something is missing, or is something else.
        """
        roles = list(roles)
        for role in roles:
            _check_population(*(arrays[f"{part}_{role}"] for part in ("sizes", "codes", "operator", "parents")))
        populations = {r: np.split(arrays[f"codes_{r}"], np.cumsum(arrays[f"sizes_{r}"])[:-1]) for r in roles}
        origins = {r: Origins(arrays[f"operator_{r}"], arrays[f"parents_{r}"]) for r in populations}
        return cls(int(arrays["generation"][0]), populations, origins)

    def to_bytes(self, run: bytes, head: str) -> bytes:
        """Return the file that holds it.

        Args:
            run: identity of the run.
            head: of the chain of its digests, as it stands.
        """
        arrays: dict[str, NDArray[Any]] = {
            "format": np.array([_FORMAT]),
            "run": np.frombuffer(run, np.uint8),
            "chain": np.frombuffer(bytes.fromhex(head), np.uint8),
            **self.arrays(),
        }
        return pack_arrays({**arrays, "digest": digest_of(arrays)})


def _check_population(sizes: NDArray[Any], codes: NDArray[Any], operator: NDArray[Any], parents: NDArray[Any]) -> None:
    """Refuse arrays that are not of one population: what takes them does not look at their shapes."""
    kinds = [f"{array.dtype} {array.ndim}" for array in (sizes, codes, operator, parents)]
    if kinds != ["int64 1", "uint8 1", "uint8 1", "int32 2"]:
        raise ValueError("its arrays are of other kinds")
    if len(sizes) != len(operator) or parents.shape != (len(sizes), 2) or np.any(operator >= len(OPERATORS)):
        raise ValueError("its arrays are not of one population")
    if np.any(sizes < 1) or np.any(sizes > len(codes)) or sizes.sum() != len(codes):
        raise ValueError("its trees are not as long as it says")


def read_checkpoint(path: Path, run: bytes, heads: Iterable[str], roles: Iterable[int]) -> Checkpoint:
    """Read what ``Checkpoint.to_bytes`` gave.

    Args:
        path: the file.
        run: identity of the run.
        heads: of the chain of its digests: what was its head when a checkpoint was written.
        roles: that evolve.

    Raises:
        InputError: it is damaged, or belongs to another run.
    """
    remedy = "delete it and resume again: it is made anew from individuals.parquet"
    try:
        arrays = read_arrays(path)
        stored = arrays.pop("digest")
        if not np.array_equal(stored, digest_of(arrays)):
            raise InputError(f"{path} is damaged: its contents do not match its digest; {remedy}")
        if int(arrays["format"][0]) != _FORMAT:
            raise InputError(f"{path} has format {int(arrays['format'][0])}, this version reads {_FORMAT}; {remedy}")
        if bytes(arrays["run"]) != run:
            raise InputError(f"{path} belongs to another run: its settings are not those of config.toml; {remedy}")
        if bytes(arrays["chain"]).hex() not in set(heads):
            raise InputError(f"{path} belongs to another run, which went otherwise: digests.txt says so; {remedy}")
        return Checkpoint.of(arrays, roles)
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, OSError, DamagedFileError) as error:
        raise InputError(f"{path} is damaged ({error}); {remedy}") from None


def columns(counts: Sequence[str]) -> list[str]:
    """Return the columns of generations.csv."""
    sizes = [f"{size}_{which}" for size in ("depth", "nodes") for which in ("best", "mean", "worst")]
    return ["generation", "robot", "fitness_best", "fitness_mean", "fitness_worst", *counts, *sizes]


def table_lines(generation: int, records: Sequence[GenerationRecord]) -> list[str]:
    """Return the lines of a generation in generations.csv."""
    lines = []
    for record in records:
        best, worst = int(record.order[0]), int(record.order[-1])
        row: list[Any] = [generation, record.robot]
        row += [float(record.fitness[best]), float(record.fitness.mean()), float(record.fitness[worst])]
        row += [int(values[best]) for values in record.counts.values()]
        for sizes in (record.depth, record.nodes):
            row += [int(sizes[best]), float(sizes.mean()), int(sizes[worst])]
        lines.append(",".join(str(value) for value in row))
    return lines


def individuals_table(generation: int, records: Sequence[GenerationRecord], terminals: Sequence[str]) -> Any:
    """Return a generation's part of individuals.parquet, as a table of Arrow.

    Args:
        generation: its number.
        records: a record a role.
        terminals: of all roles; a role without one has chosen it 0 times.
    """
    import pyarrow as pa

    def joined(values: Iterable[NDArray[Any]], kind: type[np.generic]) -> NDArray[Any]:
        return np.concatenate([array.astype(kind) for array in values])

    origins = [record.origins for record in records if record.origins is not None]
    assert len(origins) == len(records)  # older runs are not gone on with
    total = sum(len(record.fitness) for record in records)
    table: dict[str, Any] = {"generation": np.full(total, generation, np.int32)}
    table["robot"] = pa.array([record.robot for record in records for _ in record.fitness])
    table["index"] = joined((np.arange(len(record.fitness)) for record in records), np.int32)
    table["group"] = joined((record.group for record in records), np.int32)
    table["fitness"] = joined((record.fitness for record in records), np.float64)
    for name in records[0].counts:
        table[name] = joined((record.counts[name] for record in records), np.int32)
    table["depth"] = joined((record.depth for record in records), np.int16)
    table["nodes"] = joined((record.nodes for record in records), np.int32)
    codes = [tree for record in records for tree in record.codes]
    ends = np.cumsum([0, *(len(tree) for tree in codes)]).astype(np.int32)
    table["tree"] = pa.ListArray.from_arrays(pa.array(ends), pa.array(np.concatenate(codes)))
    operators = pa.array(joined((of.operator for of in origins), np.int32))
    table["operator"] = pa.DictionaryArray.from_arrays(operators, pa.array(OPERATORS))
    for number in range(2):
        table[f"parent_{number + 1}"] = joined((of.parents[:, number] for of in origins), np.int32)
    for name in terminals:
        none = [np.zeros(len(record.fitness), np.int32) for record in records]
        chosen = (record.chosen.get(name, zeros) for record, zeros in zip(records, none, strict=True))
        table[CHOSE + name] = joined(chosen, np.int32)
    if all(record.rounds is not None for record in records):
        rounds = np.concatenate([record.rounds for record in records if record.rounds is not None])
        table["rounds"] = pa.FixedSizeListArray.from_arrays(pa.array(rounds.ravel()), rounds.shape[1])
    return pa.table(table)


def lacking_column(table: pa.Table) -> str:
    """Return a column that a part of individuals.parquet lacks, or that holds something else; "" if there is none."""
    from pyarrow import types

    whole = dict.fromkeys(("generation", "index", "group", "depth", "nodes"), types.is_integer)
    whole |= {"robot": types.is_string, "fitness": types.is_floating, "tree": types.is_list}
    for name, is_right in whole.items():
        there = name in table.column_names and is_right(table.schema.field(name).type)
        if not there or table.column(name).null_count:
            return str(name)
    trees = table.column("tree")
    if not types.is_integer(trees.type.value_type) or any(chunk.flatten().null_count for chunk in trees.chunks):
        return "tree"
    return ""


def read_record(
    role: int, robot: str, rows: pd.DataFrame, counts: Sequence[str], terminals: Sequence[str]
) -> GenerationRecord:
    """Return the record of a role from its rows of individuals.parquet.

    Args:
        role, robot: number and name.
        rows: of one generation.
        counts: of the game.
        terminals: of the role.
    """
    rows = rows.sort_values("index")
    origins = None
    if "operator" in rows:
        operator = np.array([OPERATORS.index(name) for name in rows["operator"]], np.uint8)
        origins = Origins(operator, rows[["parent_1", "parent_2"]].to_numpy(np.int32))
    return GenerationRecord(
        role,
        robot,
        [np.asarray(tree, np.uint8) for tree in rows["tree"]],
        rows["group"].to_numpy(np.int64),
        rows["fitness"].to_numpy(np.float64),
        {name: rows[name].to_numpy(np.int64) for name in counts},
        rows["depth"].to_numpy(np.int64),
        rows["nodes"].to_numpy(np.int64),
        origins,
        {name: rows[CHOSE + name].to_numpy(np.int64) for name in terminals if CHOSE + name in rows},
        np.array(rows["rounds"].tolist(), np.float64) if "rounds" in rows else None,
    )
