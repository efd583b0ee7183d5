"""Evolution in a study: a run folder as of ``coevo evolve``, and what is measured of it at the end."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from coevo.config import EvolutionSettings, FileSettings, check_experiment
from coevo.contest import Judged, judge, unseen_games
from coevo.errors import InputError
from coevo.evolution import evolve
from coevo.evolution.evaluation import Evaluator
from coevo.evolution.opponents import check_opponents, with_opponents
from coevo.fitness import Scorer
from coevo.game import check_playable, own_references, prepare
from coevo.hand_typed import hand_typed_teams
from coevo.levels import check_levels
from coevo.plugins import own_file
from coevo.recipes import recipe_names, recipe_path
from coevo.records import CHOSE
from coevo.run import Run, create_run, open_run
from coevo.settlement import PATTERNS, can_settle, settle, settled_name, settlement_columns
from coevo.study.kinds import Cell, Headlines

__all__ = ["EvolutionRuns", "Finished"]


class Finished:
    """A finished run, and who plays what is asked about it.

    Args:
        run: with all its generations.
        evaluator: plays.
    """

    def __init__(self, run: Run, evaluator: Evaluator) -> None:
        self.run, self.evaluator = run, evaluator

    @cached_property
    def judged(self) -> list[Judged]:
        """How the last champions do in games that evolution has not seen, as ``coevo evolve`` tells it at its end."""
        return list(judge(self.run, self.evaluator, games=unseen_games(self.run.config)))

    def best(self, robot: str) -> Any:
        """Return the row of the best individual of the last generation, as evolution judged it."""
        return self.run.record(self.run.finished - 1, robot).iloc[0]

    def champion(self, robot: str) -> Any:
        """Return the row of the last champion: the best, or who was chosen when champions were judged again."""
        generation, rank = self.run.champion(robot, self.run.finished - 1)
        return self.run.record(generation, robot).iloc[rank]


def _robots(of: Finished) -> dict[str, Cell]:
    found: dict[str, Cell] = {}
    again = of.run.champions()
    for robot in of.run.evolving.values():
        champion = of.champion(robot)
        found[f"{robot}_best_fitness"] = float(of.best(robot)["fitness"])
        if again is not None:
            found[f"{robot}_fitness_again"] = float(again.loc[again["robot"] == robot, "fitness_again"].iloc[0])
        found |= {f"{robot}_{size}": int(champion[size]) for size in ("depth", "nodes")}
    return found


def _unseen(of: Finished) -> dict[str, Cell]:
    found: dict[str, Cell] = {}
    for one in of.judged:
        found |= {f"team{one.team}_{who}": getattr(one, who)[0] for who in ("last", "first", "single_skills")}
    return found


def _use_of(of: Finished, robot: str) -> dict[str, float]:
    champion, terminals = of.champion(robot), of.run.game.function_set(of.run.number_of(robot)).terminals
    decisions = sum(int(champion[CHOSE + name]) for name in terminals)
    return {name: int(champion[CHOSE + name]) / max(decisions, 1) for name in terminals}


def _use(of: Finished) -> dict[str, Cell]:
    found: dict[str, Cell] = {}
    for one in of.judged:
        shares: dict[str, list[float]] = {}
        for robot in one.robots:
            for name, share in _use_of(of, robot).items():
                shares.setdefault(name, []).append(share)
        found |= {f"team{one.team}_use_{name}": float(np.mean(values)) for name, values in shares.items()}
    return found


def _use_of_each(of: Finished) -> dict[str, Cell]:
    return {
        f"{robot}_use_{name}": share for robot in of.run.evolving.values() for name, share in _use_of(of, robot).items()
    }


def _settled(of: Finished) -> dict[str, Cell]:
    if not can_settle(of.run.game):
        return {}
    settled = settle(of.run, of.evaluator, games=unseen_games(of.run.config))
    told: dict[str, Cell] = {
        name: value if math.isfinite(value) else "" for name, value in settlement_columns(settled).items()
    }
    if not settled.others:
        del told["take_over"]
        return told
    return {**told, "took_over": int(settled.take_over is not None)}


# What is measured of a finished run: a further measure is a line here, and finished runs are then measured again.
_MEASURES: dict[str, Callable[[Finished], dict[str, Cell]]] = {
    "robots": _robots,  # best fitness; what the champion of each robot was judged again at, its depth and nodes
    "unseen": _unseen,  # of each team that evolves, share of unseen games won by its last, first, and single skills
    "use": _use,  # of each such team, share of the decisions for each skill, mean over its champions
    "use of each": _use_of_each,  # the same of each robot's champion alone
    "settled": _settled,  # share of games between the last champions by pattern, and since when another side is ahead
}


class EvolutionRuns:
    """Runs of evolution; see ``coevo.study.kinds.StudyKind``."""

    headlines = (
        Headlines(("_last", "_first", "_single_skills")),
        Headlines((*(settled_name(name) for name in PATTERNS), "settled_ratio", "took_over")),
        Headlines(("take_over",), most=math.inf),
    )

    @property
    def measured(self) -> tuple[str, ...]:
        """What is measured of a finished run."""
        return tuple(_MEASURES)

    def recipes(self) -> dict[str, Path]:
        """Return the recipes that can be given by name."""
        return {name: recipe_path(name, "evolution") for name in recipe_names("evolution")}

    def settings(self, data: Mapping[str, Any], source: str) -> EvolutionSettings:
        """Make the settings of a run, with the opponents that do not evolve; see ``coevo.config.check_experiment``."""
        return with_opponents(check_experiment(data, source))

    def check(self, settings: FileSettings, folders: Sequence[Path]) -> list[Path]:
        """Make game and fitness once; return the modules of one's own that lie beside the recipe."""
        assert isinstance(settings, EvolutionSettings)
        game = check_playable(settings, folders)
        Scorer(settings, game.counts, folders)
        check_opponents(settings, game)
        hand_typed_teams(settings, game)
        check_levels(settings, folders)
        found = (own_file(reference, folders) for reference in own_references(settings))
        return [path for path in found if path is not None]

    def warm_up(self, settings: FileSettings, tell: Callable[[str], None]) -> None:
        """Load the machine code of games, or compile it."""
        assert isinstance(settings, EvolutionSettings)
        prepare(settings, tell)

    def is_whole(self, folder: Path, settings: FileSettings) -> bool:
        """Tell whether all generations are there."""
        assert isinstance(settings, EvolutionSettings)
        return Run(folder, settings).is_finished

    def run(
        self, settings: FileSettings, folder: Path, folders: Sequence[Path], tick: Callable[[], None]
    ) -> dict[str, Cell]:
        """Evolve to the last generation, and measure what came of it."""
        assert isinstance(settings, EvolutionSettings)
        run = _begun(settings, folder, folders)
        release = run.lock()
        try:
            with Evaluator(run.config, workers=1, backend="threads", folders=run.folders) as evaluator:
                evolve(run, evaluator, lambda _: tick())
                of = Finished(run, evaluator)
                found: dict[str, Cell] = {}
                for measure in _MEASURES.values():
                    found |= measure(of)
                return found
        finally:
            release()


def _begun(settings: EvolutionSettings, folder: Path, folders: Sequence[Path]) -> Run:
    """Return the run in a folder, made if it is not there; what was made by halves is made anew."""
    if not (folder / "config.toml").exists():
        shutil.rmtree(folder, ignore_errors=True)
        return create_run(folder, settings, folders)
    run = open_run(folder, altered=True)  # evolution refuses one that was altered
    if run.config != settings:
        raise InputError(f"{folder} holds a run of other settings; remove it, or give the study another --out")
    return run
