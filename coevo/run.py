"""A run folder: the only place that reads and writes one.

``config.toml`` every setting, ``environment.json`` versions and digests, ``generations.csv`` and ``measures.csv`` a row
a generation and robot, ``individuals.parquet`` a folder with a part a generation, ``checkpoint.npz`` the population
that comes next, ``champions.csv`` the last champions, where they were judged again, ``levels.csv`` the levels of an
environment that co-evolves, ``skills`` what it plays with, ``digests.txt`` the chain of digests of all this.
Each file is written whole under another name and then renamed, parts first and the checkpoint last, so a kill at any
instant loses at most the generation under way. Nothing is in pickle. ``coevo.soundness`` tells whether all of it is as
it was written.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from coevo.chain import Chain, rows_digest, sha256
from coevo.config import EvolutionSettings, check_experiment, read_toml, to_toml
from coevo.environment import environment
from coevo.errors import InputError
from coevo.files import make_folder
from coevo.folder import held, save_lines, save_whole, writing
from coevo.game import own_references, terminals_of
from coevo.kept import skill_files
from coevo.levels import LevelRecord, level_lines
from coevo.measures import MEASURES, measure_lines
from coevo.plugins import own_file
from coevo.records import Checkpoint, GenerationRecord, columns, individuals_table, table_lines
from coevo.run_reader import AGAIN, CHAMPION_COLUMNS, CHAMPIONS, DIGESTS, OLDER, RunReader, part_name

__all__ = ["CHAMPION_COLUMNS", "Run", "create_run", "open_run"]

_Lines = Callable[[int, Sequence[GenerationRecord]], list[str]]
_BEGUN = ".begun"  # is there as long as a folder is being made


class Run(RunReader):
    """A run on disk; made by ``create_run`` and ``open_run``."""

    def _fix(self, digests: Mapping[str, str]) -> None:
        """Add digests to the chain before what they are of is written; some may stand there, and must be the same."""
        chain = self.chain
        if chain is None:
            raise InputError(f"{self.path} {OLDER}")
        known = chain.digests
        for name, digest in digests.items():
            if known.get(name, digest) != digest:
                raise InputError(
                    f"{self.path / name.partition(' ')[0]} came out otherwise than when it was written first: this is"
                    f" another machine, another version of a library or of coevo, or other skills; {AGAIN}"
                )
        new = {name: digest for name, digest in digests.items() if name not in known}
        if new:
            save_whole(self.path / DIGESTS, chain.extended(new).text().encode())

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
        buffer = pa.BufferOutputStream()  # Arrow's own, as in reading
        pq.write_table(table, buffer, compression="zstd")
        data, path = buffer.getvalue().to_pybytes(), self._part_path(generation)
        rows = {f"{name} {generation}": rows_digest(of(generation, records)) for name, (_, of) in self.tables.items()}
        self._fix({**rows, part_name(generation): sha256(data)})
        # First: a part on disk promises that its rows are in the tables.
        for name in self.tables:
            self.save_table(name, generation, records)
        if level is not None:
            self.save_levels(generation + 1)
        with writing(path):
            make_folder(path.parent, within=self.path)
        save_whole(path, data)

    def save_levels(self, generations: int) -> None:
        """Write the levels of the first generations."""
        save_lines(self.path / "levels.csv", level_lines(self.config, self.game, self.level_records(generations)))

    @property
    def tables(self) -> dict[str, tuple[list[str], _Lines]]:
        """Columns of each table with a row a generation and role, and what makes the lines of a generation."""
        functions = {role: self.game.function_set(role) for role in self.evolving}
        games = self.config.evaluation.games
        return {
            "generations.csv": (columns(self.game.counts), table_lines),
            "measures.csv": (list(MEASURES), lambda number, of: measure_lines(number, of, functions, games)),
        }

    def save_table(self, name: str, generations: int, records: Sequence[GenerationRecord] = ()) -> None:
        """Write a table with its lines of the generations before, and of one more if there are records of it."""
        header, lines_of = self.tables[name]
        try:
            earlier = self.table_lines(name, generations)
        except InputError:  # lost or damaged: made anew
            earlier = [line for number in range(generations) for line in lines_of(number, self.records(number))]
        lines = [",".join(header), *earlier, *(lines_of(generations, records) if records else [])]
        save_lines(self.path / name, lines)

    def table_lines(self, name: str, generations: int | None = None) -> list[str]:
        """Return a table's lines of the first generations, of all unless a number is given, without its header.

        Raises:
            InputError: it is not there, or they are not those that were written.
        """
        return self.rows_of(name, self.tables[name][0], generations)

    def save_champions(self, rows: Sequence[Sequence[object]]) -> None:
        """Write the last champions, a row of ``CHAMPION_COLUMNS`` each; what was found out of others is forgotten."""
        lines = [",".join(map(str, line)) for line in (CHAMPION_COLUMNS, *rows)]
        self._fix({CHAMPIONS: rows_digest(lines)})
        self.forget_results()
        save_lines(self.path / CHAMPIONS, lines)

    def save_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Write what comes next."""
        head = (self.chain or Chain()).head
        save_whole(self.path / "checkpoint.npz", checkpoint.to_bytes(self._identity, head))


def create_run(path: Path, settings: EvolutionSettings, folders: Sequence[Path] = ()) -> Run:
    """Make a run folder.

    Args:
        path: where.
        settings: the experiment.
        folders: where code of one's own is looked for; a file from there is copied into the run folder.

    Raises:
        InputError: there is a run already, or the folder cannot be written.
    """
    about = environment(settings, folders)  # a wrong skill is better found before there is a folder
    files = skill_files(settings, folders)
    own = (own_file(reference, folders) for reference in own_references(settings))
    files |= {file.name: file.read_bytes() for file in own if file is not None}
    files["environment.json"] = (json.dumps(about, indent=2) + "\n").encode()
    config = to_toml(settings).encode()
    digests = Chain().extended({name: sha256(data) for name, data in {"config.toml": config, **files}.items()})
    files[DIGESTS] = digests.text().encode()
    try:
        make_folder(path)
        with held(path):  # from here on this process alone
            _refuse_taken(path, files)
            (path / _BEGUN).touch()
            for name, data in files.items():
                make_folder((path / name).parent, within=path)
                save_whole(path / name, data)
            save_whole(path / "config.toml", config)  # last: it makes the folder a run
            (path / _BEGUN).unlink()
    except OSError as error:
        raise InputError(
            f"cannot make the run folder {path}: {error.strerror or error}; choose another --out"
        ) from None
    return Run(path, settings)


def _refuse_taken(path: Path, files: Mapping[str, bytes]) -> None:
    """Refuse a folder that holds anything but what a kill left of the making of this run."""
    if (path / "config.toml").exists():
        raise InputError(f"{path} holds a run already; go on with 'coevo resume {path}' or choose another --out")
    names = {Path(name).parts[0] for name in files} if (path / _BEGUN).is_file() else set[str]()
    left = {".lock", _BEGUN, *names, *(f".{name}.partial" for name in (*names, "config.toml"))}
    if any(one.name not in left for one in path.iterdir()):
        raise InputError(f"{path} exists and is not an empty folder; choose another --out")


def open_run(path: str | Path, *, altered: bool = False) -> Run:
    """Open a run folder for reading; see ``Run``.

    Args:
        path: of the folder.
        altered: whether to open one, too, whose settings or code are not those that it was begun with, or that lacks a
            generation.

    Raises:
        InputError: there is no run, or its config.toml is wrong or was altered.

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
        if (path / _BEGUN).is_file():
            what = "was stopped before the run was begun; nothing is lost"
        raise InputError(f"{path} {what}; start a run with 'coevo evolve'")
    run = Run(path, check_experiment(read_toml(path / "config.toml"), str(path / "config.toml")))
    if not altered:
        run.require_as_begun()
        run.require_no_gap()
    return run
