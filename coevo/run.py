"""A run folder: the only place that reads and writes one.

``config.toml`` every setting, ``environment.json`` versions and digests, ``generations.csv`` and ``measures.csv`` a row
a generation and robot, ``individuals.parquet`` a folder with a part a generation, ``checkpoint.npz`` the population
that comes next, ``champions.csv`` the last champions, where they were judged again, ``levels.csv`` the levels of an
environment that co-evolves. Each file is written whole under
another name and then renamed, parts first and the checkpoint last, so a kill at any instant loses at most the
generation under way. Nothing is in pickle.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coevo.config import EvolutionSettings, check_experiment, read_toml, to_toml
from coevo.environment import environment
from coevo.errors import InputError
from coevo.files import DamagedFileError, digest_of, pack_arrays, read_arrays
from coevo.folder import Folder, read_table, save_lines, save_whole, writing
from coevo.game import Game, make_game, own_references, terminals_of
from coevo.levels import LevelRecord, level_lines, level_settings
from coevo.measures import MEASURES, measure_lines
from coevo.plugins import own_file, search_folders
from coevo.records import Checkpoint, GenerationRecord, columns, individuals_table, read_record, table_lines
from coevo.tree import Tree, from_codes

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = ["CHAMPION_COLUMNS", "Run", "create_run", "open_run"]

CHAMPION_COLUMNS = ("team", "robot", "generation", "index", "fitness", "fitness_again", "games", "won", "lost")
_CHAMPIONS = "champions.csv"
_Lines = Callable[[int, Sequence[GenerationRecord]], list[str]]
_FORMAT = 2  # of the checkpoint; 1 did not tell where individuals came from
_AGAIN = "run the experiment again from config.toml"
_OLDER = (
    "was written by an older coevo, which did not keep where individuals came from. The run can be read, but not gone"
    " on with; repeat it with 'coevo evolve' and its config.toml"
)


class Run(Folder):
    """A run on disk; made by ``create_run`` and ``open_run``."""

    def __init__(self, path: Path, settings: EvolutionSettings) -> None:
        super().__init__(path, hashlib.sha256(to_toml(settings).encode()).digest())
        self.config = settings
        self.folders = search_folders(path)  # where code of one's own is looked for
        self._levels: list[LevelRecord] = []  # of the first generations, as far as they were asked for

    # ------------------------------------------------------------------------------------------------ reading

    @property
    def generations(self) -> pd.DataFrame:
        """``generations.csv``: a row a generation and role."""
        import pandas as pd

        path = self.path / "generations.csv"
        if not path.exists():
            return pd.DataFrame(columns=columns(self.game.counts))
        try:
            return pd.read_csv(path)
        except (ValueError, OSError) as error:
            raise InputError(f"cannot read {path}: {error}") from None

    @property
    def individuals(self) -> pd.DataFrame:
        """``individuals.parquet``: a row an individual of every finished generation."""
        import pandas as pd

        frames = [self._part(generation) for generation in range(self.finished)]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()

    @property
    def environment(self) -> str:
        """``environment.json`` as it stands: versions, commit, digests of skills."""
        try:
            return (self.path / "environment.json").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return ""

    @cached_property
    def game(self) -> Game:
        """The game that is played; one of one's own is imported when this is first asked for."""
        return make_game(self.config, self.folders)

    def level_records(self, generations: int) -> list[LevelRecord]:
        """Return what was kept of the levels of the first generations; nothing if there are no levels."""
        if self.config.levels is not None:
            self._levels += [self._level(number) for number in range(len(self._levels), generations)]
        return self._levels[:generations]

    def _level(self, generation: int) -> LevelRecord:
        metadata = self._table(generation).schema.metadata
        try:
            return LevelRecord.of(metadata)
        except (LookupError, TypeError, ValueError) as error:
            raise InputError(f"{self._part_path(generation)} does not tell its level ({error}); {_AGAIN}") from None

    def config_of(self, generation: int) -> EvolutionSettings:
        """Return the settings that a generation's games were played by: those of its level, if there are levels."""
        if self.config.levels is None:
            return self.config
        return level_settings(self.config, self._level(generation).level)

    def game_of(self, generation: int) -> Game:
        """Return the game that was played in a generation: ``game``, on its level if there are levels."""
        return self.game if self.config.levels is None else make_game(self.config_of(generation), self.folders)

    @cached_property
    def evolving(self) -> dict[int, str]:
        """Numbers and names of the roles that evolve."""
        return {number: role.name for number, role in enumerate(self.game.roles) if role.evolves}

    @property
    def finished(self) -> int:
        """Number of finished generations."""
        count = 0
        while self._part_path(count).exists():
            count += 1
        return count

    @property
    def is_finished(self) -> bool:
        """Whether every generation is there, and the last champions are chosen, if they are to be judged again."""
        chosen = not self.config.evaluation.champion_games or (self.path / _CHAMPIONS).exists()
        return self.finished >= self.config.gp.generations and chosen

    def _part_path(self, generation: int) -> Path:
        return self.path / "individuals.parquet" / f"part-{generation:05d}.parquet"

    def _part_digests(self) -> NDArray[np.uint8]:
        """Return the SHA-256 of the parts that the checkpoint knows, (generations, 32); none without a checkpoint."""
        try:
            return read_arrays(self.path / "checkpoint.npz")["parts"].reshape(-1, 32).astype(np.uint8)
        except (OSError, LookupError, ValueError, DamagedFileError):
            return np.zeros((0, 32), np.uint8)

    def _part(self, generation: int) -> pd.DataFrame:
        frame: pd.DataFrame = self._table(generation).to_pandas(use_threads=False)
        return frame

    def _table(self, generation: int) -> pa.Table:
        path, known = self._part_path(generation), self._part_digests()
        if not path.exists():
            last = self.finished - 1
            have = f"0 to {last}" if last >= 0 else "none yet"
            raise InputError(f"{self.path} has no generation {generation}; finished generations: {have}")
        return read_table(path, known[generation].tobytes() if generation < len(known) else None, _AGAIN)

    def record(self, generation: int, robot: str) -> pd.DataFrame:
        """Return the individuals of one role in one generation, best first (by fitness, depth, index)."""
        part = self._part(generation)
        names = part["robot"].unique().tolist()
        if robot not in names:
            raise InputError(f"{robot!r} does not evolve in this run; choose one of {', '.join(names)}")
        rows = part[part["robot"] == robot].sort_values(["fitness", "depth", "index"], kind="stable")
        return rows.reset_index(drop=True)

    def tree(self, robot: str, generation: int, rank: int = 0) -> Tree:
        """Return a tree of one role; rank 0 is the best of the generation."""
        rows = self.record(generation, robot)
        if not 0 <= rank < len(rows):
            raise InputError(f"rank must be from 0 to {len(rows) - 1}, got {rank}")
        return from_codes(np.asarray(rows["tree"][rank], np.uint8), self.game.function_set(self.number_of(robot)))

    def champions(self) -> pd.DataFrame | None:
        """Return ``champions.csv``, a row a robot of ``CHAMPION_COLUMNS``; None if none were judged again (yet).

        Raises:
            InputError: it is damaged.
        """
        import pandas as pd

        path = self.path / _CHAMPIONS
        if not self.config.evaluation.champion_games or not path.exists():
            return None
        try:
            table = pd.read_csv(path, dtype=str)  # and then by Python's float, which is exact
            if (
                table.columns.tolist() != list(CHAMPION_COLUMNS)
                or table.isna().any(axis=None)
                or table["robot"].tolist() != list(self.evolving.values())
            ):
                raise ValueError("it has other columns or robots")
            for name in table.columns.drop("robot"):
                table[name] = table[name].map(float if name.startswith("fitness") else int)
        except (ValueError, OSError) as error:
            raise self._damaged_champions(str(error)) from None
        return table

    def _damaged_champions(self, why: str) -> InputError:
        remedy = f"delete it; 'coevo resume {self.path}' makes it anew"
        return InputError(f"{self.path / _CHAMPIONS} is damaged ({why}); {remedy}")

    def champion(self, robot: str, generation: int) -> tuple[int, int]:
        """Return generation and rank of the champion of a role in a generation.

        That is the best of the generation; of the last one the one that was chosen when they were judged again, which
        random search may have found earlier.
        """
        table = self.champions() if generation == self.config.gp.generations - 1 else None
        if table is None or robot not in self.evolving.values():
            return generation, 0
        row = table[table["robot"] == robot].iloc[0]
        found = int(row["generation"])
        rows = self.record(found, robot)
        places = np.flatnonzero((rows["index"] == row["index"]) & (rows["fitness"] == row["fitness"]))
        if len(places) != 1:
            raise self._damaged_champions(f"{robot} has no such individual in generation {found}")
        return found, int(places[0])

    def champion_tree(self, robot: str, generation: int) -> Tree:
        """Return the tree of ``champion``."""
        return self.tree(robot, *self.champion(robot, generation))

    def number_of(self, robot: str) -> int:
        """Return the number of a role by its name."""
        return [role.name for role in self.game.roles].index(robot)

    def checkpoint(self) -> Checkpoint | None:
        """Return what comes next, or None if no generation is finished.

        Raises:
            InputError: the run cannot be gone on with: the checkpoint is damaged or belongs to another run, or the
                individuals are those of an older version.
        """
        path, last = self.path / "checkpoint.npz", self.finished - 1
        if not path.exists():
            if last >= 0 and "operator" not in self._part(last):
                raise InputError(f"{self._part_path(last)} {_OLDER}")
            return None
        remedy = "delete it and resume again: it is made anew from individuals.parquet"
        try:
            arrays = read_arrays(path)
            stored = arrays.pop("digest")
            if not np.array_equal(stored, digest_of(arrays)):
                raise InputError(f"{path} is damaged: its contents do not match its digest; {remedy}")
            if int(arrays["format"][0]) < _FORMAT:
                raise InputError(f"{path} {_OLDER}")
            if int(arrays["format"][0]) != _FORMAT:
                raise InputError(
                    f"{path} has format {int(arrays['format'][0])}, this version reads {_FORMAT}; {remedy}"
                )
            if bytes(arrays["run"]) != self._identity:
                raise InputError(f"{path} belongs to another run: its settings are not those of config.toml; {remedy}")
            return Checkpoint.of(arrays, self.evolving)
        except InputError:
            raise
        except (ValueError, TypeError, LookupError, OSError, DamagedFileError) as error:
            raise InputError(f"{path} is damaged ({error}); {remedy}") from None

    # ------------------------------------------------------------------------------------------------ writing

    def save_environment(self) -> None:
        """Write what the run depends on besides its settings, if that is not written yet."""
        path = self.path / "environment.json"
        if not path.exists():
            save_whole(path, (json.dumps(environment(self.config, self.folders), indent=2) + "\n").encode())

    def save_generation(
        self, generation: int, records: Sequence[GenerationRecord], level: LevelRecord | None = None
    ) -> None:
        """Write one generation: its rows in the tables, then its individuals, and what is kept of its level."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = individuals_table(generation, records, terminals_of(self.game))
        if level is not None:
            table = table.replace_schema_metadata(level.metadata)
            self._levels = [*self.level_records(generation), level]
            save_lines(self.path / "levels.csv", level_lines(self.config, self.game, self._levels))
        buffer = pa.BufferOutputStream()  # Arrow's own, as in reading
        pq.write_table(table, buffer, compression="zstd")
        path = self._part_path(generation)
        with writing(path):
            path.parent.mkdir(exist_ok=True)
        self._save_tables(generation, records)  # first: a part on disk promises that its rows are in the tables
        save_whole(path, buffer.getvalue().to_pybytes())

    def _save_tables(self, generation: int, records: Sequence[GenerationRecord]) -> None:
        functions = {role: self.game.function_set(role) for role in self.evolving}
        games = self.config.evaluation.games
        tables: list[tuple[str, list[str], _Lines]] = [
            ("generations.csv", columns(self.game.counts), table_lines),
            ("measures.csv", list(MEASURES), lambda number, of: measure_lines(number, of, functions, games)),
        ]
        for name, header, lines_of in tables:
            earlier = self._earlier_lines(self.path / name, len(header), generation, lines_of)
            lines = [",".join(header), *earlier, *lines_of(generation, records)]
            save_lines(self.path / name, lines)

    def _earlier_lines(self, path: Path, width: int, generation: int, lines_of: _Lines) -> list[str]:
        """Return a table's lines of the generations before; those that are lost or damaged are made anew."""
        expected = [[str(g), robot] for g in range(generation) for robot in self.evolving.values()]
        try:
            lines = path.read_text(encoding="utf-8").splitlines()[1 : len(expected) + 1]
        except (OSError, UnicodeDecodeError):
            lines = []
        parts = [line.split(",") for line in lines]
        if [part[:2] for part in parts] == expected and all(len(part) == width for part in parts):
            return lines
        return [line for earlier in range(generation) for line in lines_of(earlier, self.records(earlier))]

    def save_champions(self, rows: Sequence[Sequence[object]]) -> None:
        """Write the last champions, a row of ``CHAMPION_COLUMNS`` each; what was found out of others is forgotten."""
        self.forget_results()
        save_lines(self.path / _CHAMPIONS, [",".join(map(str, line)) for line in (CHAMPION_COLUMNS, *rows)])

    def records(self, generation: int) -> list[GenerationRecord]:
        """Return what was saved of a generation, a record a role."""
        part, found = self._part(generation), []
        for role, robot in self.evolving.items():
            rows, terminals = part[part["robot"] == robot], self.game.function_set(role).terminals
            found.append(read_record(role, robot, rows, self.game.counts, terminals))
        return found

    def save_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Write what comes next."""
        arrays = {
            "format": np.array([_FORMAT]),
            "run": np.frombuffer(self._identity, np.uint8),
            **checkpoint.arrays(),
        }
        parts = [self._part_path(generation) for generation in range(checkpoint.generation)]
        digests = [hashlib.sha256(path.read_bytes()).digest() for path in parts if path.exists()]
        arrays["parts"] = np.frombuffer(b"".join(digests), np.uint8)
        arrays["digest"] = digest_of(arrays)
        save_whole(self.path / "checkpoint.npz", pack_arrays(arrays))


def create_run(path: Path, settings: EvolutionSettings, folders: Sequence[Path] = ()) -> Run:
    """Make a run folder.

    Args:
        path: where.
        settings: the experiment.
        folders: where code of one's own is looked for; a file from there is copied into the run folder.

    Raises:
        InputError: there is a run already, or the folder cannot be written.
    """
    environment(settings, folders)  # a wrong skill is better found before there is a folder
    try:
        if (path / "config.toml").exists():
            raise InputError(f"{path} holds a run already; go on with 'coevo resume {path}' or choose another --out")
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise InputError(f"{path} exists and is not an empty folder; choose another --out")
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the run folder {path}: {error.strerror or error}; choose another --out"
        ) from None
    for own in (own_file(reference, folders) for reference in own_references(settings)):
        if own is not None:
            save_whole(path / own.name, own.read_bytes())
    save_whole(path / "config.toml", to_toml(settings).encode())
    run = Run(path, settings)
    run.save_environment()
    return run


def open_run(path: str | Path) -> Run:
    """Open a run folder for reading; see ``Run``.

    Raises:
        InputError: there is no run, or its config.toml is wrong.

    Example:
        >>> from pathlib import Path
        >>> from coevo.recipes import read_experiment
        >>> from coevo.run import create_run, open_run
        >>> made = create_run(Path("runs/mine"), read_experiment("smoke"))
        >>> run = open_run("runs/mine")
        >>> run.config.name, run.finished, list(run.evolving.values())
        ('smoke', 0, ['r0', 'r1', 'r2'])
    """
    path = Path(path)
    try:
        there = (path / "config.toml").exists()
    except OSError as error:
        raise InputError(f"cannot open {path}: {error.strerror or error}") from None
    if not there:
        what = "is not a run folder (it has no config.toml)" if path.exists() else "does not exist"
        raise InputError(f"{path} {what}; start a run with 'coevo evolve'")
    return Run(path, check_experiment(read_toml(path / "config.toml"), str(path / "config.toml")))
