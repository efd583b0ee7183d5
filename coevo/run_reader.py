"""What a run folder holds, read back: see ``coevo.run``, which writes it."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coevo.chain import Chain, rows_digest, sha256
from coevo.config import EvolutionSettings, to_toml
from coevo.errors import InputError
from coevo.files import MOST_FILE_BYTES, DamagedFileError, read_arrays, read_text, read_whole
from coevo.folder import Folder, read_lines, read_table
from coevo.game import Game, make_game
from coevo.levels import LevelRecord, level_settings
from coevo.plugins import search_folders
from coevo.records import Checkpoint, GenerationRecord, columns, lacking_column, read_checkpoint, read_record
from coevo.tree import Tree, from_codes

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = [
    "AGAIN",
    "CHAMPIONS",
    "CHAMPION_COLUMNS",
    "DIGESTS",
    "OLDER",
    "RunReader",
    "part_name",
    "why_unsound",
]

CHAMPION_COLUMNS = ("team", "robot", "generation", "index", "fitness", "fitness_again", "games", "won", "lost")
CHAMPIONS, DIGESTS = "champions.csv", "digests.txt"
AGAIN = "run the experiment again from config.toml"
OLDER = (
    "was written by an older coevo, or has lost its digests.txt. The run can be read, but not gone on with; repeat it"
    " with 'coevo evolve' and its config.toml"
)


def part_name(generation: int) -> str:
    """Return the name of a generation's part in a run folder."""
    return f"individuals.parquet/part-{generation:05d}.parquet"


def why_unsound(folder: Path, name: str, digest: str, remedy: str = f"{AGAIN}, or put it back as it was") -> str:
    """Return in words why a file of a run is not as it was written; "" if it is."""
    path = folder / name
    try:
        found = sha256(read_whole(path))
    except FileNotFoundError:
        return f"{path} is lost; {AGAIN}, or put it back"
    except (OSError, ValueError) as error:
        return f"cannot read {path}: {getattr(error, 'strerror', None) or error}"
    if found == digest:
        return ""
    told = ": its settings are not those of config.toml when the run was begun" if name == "config.toml" else ""
    return f"{path} is damaged or was changed: it does not match its digest{told}; {remedy}"


class RunReader(Folder):
    """A run on disk, to be read."""

    def __init__(self, path: Path, settings: EvolutionSettings) -> None:
        # Kept under the settings as they were written, not as they are read: a later version may have more of them.
        config = path / "config.toml"
        written = read_whole(config) if config.is_file() else to_toml(settings).encode()
        super().__init__(path, hashlib.sha256(written).digest())
        self.config = settings
        self.folders = search_folders(path)  # where code of one's own is looked for
        self._levels: list[LevelRecord] = []  # of the first generations, as far as they were asked for

    # ------------------------------------------------------------------------------------------------ reading

    @property
    def generations(self) -> pd.DataFrame:
        """``generations.csv``: a row a generation and role.

        Raises:
            InputError: it is lost or damaged.
        """
        import pandas as pd

        path = self.path / "generations.csv"
        if not self.finished and not path.exists():
            return pd.DataFrame(columns=columns(self.game.counts))
        try:
            if self.chain is None:
                return pd.read_csv(io.BytesIO(read_whole(path)))
            return pd.read_csv(io.StringIO("\n".join(self._lines_as_written(path))))
        except (ValueError, OSError) as error:
            raise InputError(f"cannot read {path}: {error}") from None

    def _lines_as_written(self, path: Path) -> list[str]:
        """Return the lines of ``generations.csv``, compared with the chain; no code of one's own runs for that."""
        chain, (first, *lines) = self.chain or Chain(), read_lines(path)
        remedy = f"delete it; 'coevo resume {self.path}' makes it anew"
        header, fixed = first.split(","), len(columns(())) // 2
        counts = header[fixed : len(header) - len(columns(())) + fixed]
        known = self._table(0).column_names if self.finished else counts
        if header != columns(counts) or counts != [name for name in known if name in counts]:
            raise InputError(f"{path} is damaged: its first line does not say what was counted; {remedy}")
        parts: dict[str, list[str]] = {}
        for line in lines:
            parts.setdefault(line.partition(",")[0], []).append(line)
        wanted = [str(number) for number in range(max(self.finished, len(parts)))]  # a kill may have left one more
        for number in wanted:
            if rows_digest(parts.get(number, [])) != chain.digests.get(f"{path.name} {number}"):
                raise InputError(f"{path} is damaged: its rows of generation {number} were altered; {remedy}")
        if lines != [line for number in wanted for line in parts[number]]:
            raise InputError(f"{path} is damaged: its rows are in another order; {remedy}")
        return [first, *lines]

    def rows_of(self, name: str, header: Sequence[str], generations: int | None = None) -> list[str]:
        """Return a table's lines of the first generations, of all unless a number is given, without its header.

        Raises:
            InputError: it is not there, or they are not those that were written.
        """
        path, chain = self.path / name, self.chain or Chain()
        remedy = f"delete it; 'coevo resume {self.path}' makes it anew"
        try:
            lines = read_lines(path)
        except (OSError, ValueError) as error:
            raise InputError(f"cannot read {path}: {error}; {remedy}") from None
        if lines[:1] != [",".join(header)]:
            raise InputError(f"{path} is damaged: its first line is not {','.join(header)[:40]}...; {remedy}")
        width = len(self.evolving)
        if generations is None:  # a kill may have left more rows than individuals
            generations = max(self.finished, -(-(len(lines) - 1) // width))
        parts = [lines[1 + g * width : 1 + (g + 1) * width] for g in range(generations)]
        for generation, part in enumerate(parts):
            if rows_digest(part) != chain.digests.get(f"{name} {generation}"):
                raise InputError(f"{path} is damaged: its rows of generation {generation} were altered; {remedy}")
        return lines[1 : 1 + generations * width]

    @property
    def individuals(self) -> pd.DataFrame:
        """``individuals.parquet``: a row an individual of every finished generation."""
        import pandas as pd

        frames = [self._part(generation) for generation in range(self.finished)]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()

    @property
    def environment(self) -> str:
        """``environment.json``: versions, commit, digests of skills.

        Raises:
            InputError: it was altered.
        """
        self.require_as_begun("environment.json")
        try:
            return read_text(self.path / "environment.json")
        except (OSError, ValueError):
            return ""

    @property
    def chain(self) -> Chain | None:
        """The digests of all that was written; None in a run of an older version.

        Raises:
            InputError: they are damaged.
        """
        path = self.path / DIGESTS
        try:
            return Chain.read(read_text(path, MOST_FILE_BYTES))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise InputError(f"{path} is damaged ({error}); {AGAIN}") from None

    def require_as_begun(self, *names: str) -> None:
        """Refuse files that were altered since the run was begun; of an older run that is not known.

        Args:
            names: of files; none for those that decide what everything else means: settings, and cards of skills.
                Skills are compared when they are loaded, and code of one's own before it is called.

        Raises:
            InputError: one was altered or is lost.
        """
        digests = (self.chain or Chain()).digests
        for name in names or [one for one in digests if one.endswith(("config.toml", "/card.json"))]:
            why = why_unsound(self.path, name, digests[name]) if name in digests else ""
            if why:
                raise InputError(why)

    def require_no_gap(self) -> None:
        """Refuse a run that lost a generation: it would be read as if it had ended before.

        Raises:
            InputError: says which is lost.
        """
        finished = self.finished
        known = sum(name.startswith("individuals.parquet/") for name in (self.chain or Chain()).digests)
        reached = 0
        if finished < known:  # one of which a kill has left the digest only, or one that is lost
            with suppress(OSError, LookupError, TypeError, ValueError, DamagedFileError):
                reached = int(read_arrays(self.path / "checkpoint.npz")["generation"][0])
        if finished < reached or any(self._part_path(number).exists() for number in range(finished + 1, known)):
            raise InputError(f"{self._part_path(finished)} is lost; {AGAIN}, or put it back")

    @cached_property
    def game(self) -> Game:
        """The game that is played; one of one's own is imported when this is first asked for.

        Raises:
            InputError: its code was altered since the run was begun, or fails.
        """
        own = [name for name in (self.chain or Chain()).digests if name.endswith(".py")]
        if own:
            self.require_as_begun(*own)
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
            raise InputError(f"{self._part_path(generation)} does not tell its level ({error}); {AGAIN}") from None

    def config_of(self, generation: int) -> EvolutionSettings:
        """Return the settings that a generation's games were played by: those of its level, if there are levels."""
        if self.config.levels is None:
            return self.config
        return level_settings(self.config, self._level(generation).level)

    def game_of(self, generation: int) -> Game:
        """Return the game that was played in a generation: ``game``, on its level if there are levels."""
        game = self.game
        return game if self.config.levels is None else make_game(self.config_of(generation), self.folders)

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
        all_played = self.finished >= self.config.gp.generations
        return all_played and (not self.config.evaluation.champion_games or (self.path / CHAMPIONS).exists())

    def _part_path(self, generation: int) -> Path:
        return self.path / part_name(generation)

    def part_digest(self, generation: int) -> bytes | None:
        """Return the SHA-256 that a part had when it was written, None if nobody knows it (in older runs)."""
        chain = self.chain
        if chain is not None:
            digest = chain.digests.get(part_name(generation))
            if digest is None:
                raise InputError(f"{self._part_path(generation)} is not of this run: {DIGESTS} does not know it")
            return bytes.fromhex(digest)
        try:
            known = read_arrays(self.path / "checkpoint.npz")["parts"].reshape(-1, 32).astype(np.uint8)
        except (OSError, LookupError, ValueError, DamagedFileError):
            return None
        return known[generation].tobytes() if generation < len(known) else None

    def _part(self, generation: int) -> pd.DataFrame:
        frame: pd.DataFrame = self._table(generation).to_pandas(use_threads=False)
        return frame

    def _table(self, generation: int) -> pa.Table:
        path = self._part_path(generation)
        if not path.exists():
            last = self.finished - 1
            have = f"0 to {last}" if last >= 0 else "none yet"
            raise InputError(f"{self.path} has no generation {generation}; finished generations: {have}")
        table = read_table(path, self.part_digest(generation), AGAIN)
        lacking = lacking_column(table)
        if lacking:
            raise InputError(f"{path} is damaged: its column {lacking!r} is lost or holds something else; {AGAIN}")
        return table

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
            InputError: it is damaged or lost.
        """
        import pandas as pd

        path, chain = self.path / CHAMPIONS, self.chain
        if not self.config.evaluation.champion_games or not path.exists():
            if chain is not None and CHAMPIONS in chain.digests:  # others would be shown in their place
                raise InputError(f"{path} is lost; 'coevo resume {self.path}' makes it anew")
            return None
        try:
            data = read_whole(path)
            if chain is not None and sha256(data) != chain.digests.get(CHAMPIONS):
                raise ValueError("it does not match its digest")
            table = pd.read_csv(io.BytesIO(data), dtype=str)  # and then by Python's float, which is exact
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
        path = self.path / CHAMPIONS
        return InputError(f"{path} is damaged ({why}); delete it; 'coevo resume {self.path}' makes it anew")

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
                run is one of an older version.
        """
        path, chain = self.path / "checkpoint.npz", self.chain
        if chain is None:
            raise InputError(f"{self.path} {OLDER}")
        if not path.exists():
            return None
        return read_checkpoint(path, self._identity, chain.heads, self.evolving)

    def records(self, generation: int) -> list[GenerationRecord]:
        """Return what was saved of a generation, a record a role."""
        part, found = self._part(generation), []
        for role, robot in self.evolving.items():
            rows, terminals = part[part["robot"] == robot], self.game.function_set(role).terminals
            try:
                found.append(read_record(role, robot, rows, self.game.counts, terminals))
            except (LookupError, TypeError, ValueError) as error:
                raise InputError(f"{self._part_path(generation)} is damaged ({error}); {AGAIN}") from None
        return found
