"""An environment that co-evolves (6.5): on which level the games of each generation are played, and what is kept of it.

Levels are for the games of evolution, and those that are played again as they were. Contests, tournaments and games
that nobody has seen are played by the recipe's own settings, whatever the level: that is the game it is all for.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import msgspec
import numpy as np

from coevo.complexity import Controller, Counted, Rule, at_level, check_rates, check_wholes, rules_of, values_at
from coevo.config import CriterionSettings, EvolutionSettings, ForeignSettings, LevelsSettings
from coevo.errors import InputError
from coevo.files import parse_json
from coevo.game import Game, Played, check_playable, teams_of
from coevo.tree import Program

__all__ = ["LevelRecord", "Levels", "check_levels", "level_columns", "level_lines", "level_settings", "rates_of"]

_ENVIRONMENT = ("world", "game", "players", "categories", "conditions")
_KEY = b"coevo.level"
_WITH = "with_"


class LevelRecord(NamedTuple):
    """What is kept of a generation's level.

    level: on which its games were played. event: how it came to that: ``start``, ``raised``, ``lowered`` or ``stayed``.
    counted: by rate, how often it was achieved in the generation's games, and of how many.
    """

    level: int
    event: str
    counted: Counted

    @property
    def metadata(self) -> dict[bytes, bytes]:
        """What the generation's part of individuals.parquet says besides its table."""
        return {_KEY: json.dumps(self._asdict(), sort_keys=True).encode()}

    @classmethod
    def of(cls, metadata: Mapping[bytes, bytes] | None) -> Self:
        """Return what ``metadata`` said.

        Raises:
            LookupError, TypeError, ValueError: it did not, or something else.
        """
        kept = parse_json((metadata or {})[_KEY])
        return cls(
            int(kept["level"]), str(kept["event"]), {name: (int(a), int(n)) for name, (a, n) in kept["counted"].items()}
        )


def level_settings(settings: EvolutionSettings, level: int) -> EvolutionSettings:
    """Return the settings that games of a level are played by.

    Raises:
        InputError: there is no such setting, or it refuses its value.
    """
    assert settings.levels is not None
    return msgspec.structs.replace(at_level(settings, settings.levels, level), levels=None)


# -------------------------------------------------------------------------------------------------------------- rates


def rates_of(game: Game) -> tuple[str, ...]:
    """Return the rates that are measured: shares of the games of a generation.

    ``won_0`` and so on are shares of the decided games; ``with_passes`` is that of the games with at least one.
    """
    won = (f"won_{team}" for team in _teams(game))
    return (*won, "decided", "undecided", *(f"{_WITH}{name}" for name in game.counts))


def _teams(game: Game) -> list[int]:
    return [team for team in teams_of(game) if any(role.evolves for role in game.roles if role.team == team)]


def _counted(game: Game, outcomes: Sequence[Played]) -> Counted:
    winner = np.concatenate([played.winner for played in outcomes])
    games, decided = len(winner), int((winner >= 0).sum())
    found = {f"won_{team}": (int((winner == team).sum()), decided) for team in _teams(game)}
    found |= {"decided": (decided, games), "undecided": (games - decided, games)}
    for name in game.counts:
        there = sum(int((played.counts[name] > 0).any(axis=1).sum()) for played in outcomes)
        found[f"{_WITH}{name}"] = there, games
    return found


# ------------------------------------------------------------------------------------------------------- what moves it


def _rules(levels: LevelsSettings, game: Game) -> tuple[Rule, ...]:
    """Return what moves the level.

    Raises:
        InputError: there are no two sides that evolve, or not the one which levels are against; or criteria exclude
            each other.
    """
    if not levels.keep:
        return rules_of(levels)
    teams = _teams(game)
    if len(teams) < 2 or levels.against not in teams:
        raise InputError(
            f"levels: keep = {levels.keep!r} needs two teams that evolve, against = one of them;"
            f" got against = {levels.against}, evolving: {', '.join(map(str, teams))}"
        )
    more = CriterionSettings(at_least=math.nextafter(levels.most, 2.0))
    rules = [Rule("raise" if team == levels.against else "lower", {f"won_{team}": more}) for team in teams]
    both = {f"won_{team}": CriterionSettings(at_most=levels.most) for team in teams}
    for name, given in levels.raise_when.items():
        high = min(levels.most if name in both else 1.0, 1.0 if given.at_most is None else given.at_most)
        if given.at_least is not None and given.at_least > high:
            raise InputError(
                f"levels.raise_when.{name}: at_least {given.at_least:g} can never be met while no team wins more than"
                f" most = {levels.most:g}"
            )
        both[name] = CriterionSettings(at_least=given.at_least, at_most=high)
    down = (Rule("lower", levels.lower_when),) if levels.lower_when else ()
    return (*rules, *down, Rule("raise", both))


def check_levels(settings: EvolutionSettings, folders: Sequence[Path] = ()) -> None:
    """Refuse levels that cannot be played, so that what is wrong is told beforehand.

    Args:
        settings: of an experiment; without levels nothing is checked.
        folders: where a game of one's own is looked for.

    Raises:
        InputError: a key is no setting of the environment, a level is refused by the settings or the game, or changes
            what trees are made of; or a criterion can never be met, or is about what nobody measures.
    """
    levels = settings.levels
    if levels is None:
        return
    allowed = ("game",) if isinstance(settings, ForeignSettings) else _ENVIRONMENT
    for key in (key for table in levels.keys for key in table):
        if key.partition(".")[0] not in allowed or "." not in key or key == "game.kind":
            raise InputError(f"levels.keys: expected settings within {', '.join(allowed)}, got {key!r}")
    base = check_playable(settings, folders)
    check_rates(levels, rates_of(base), "levels")
    check_wholes(levels, [[f"won_{team}" for team in teams_of(base)], ["decided", "undecided"]], "levels")
    _rules(levels, base)
    for level in range(levels.levels):
        played_by = level_settings(settings, level)
        try:
            game = check_playable(played_by, folders)
        except InputError as error:
            raise InputError(f"level {level} of levels.keys ({_said(levels, level)}): {error}") from None
        if _made_of(game) != _made_of(base):
            raise InputError(
                f"level {level} of levels.keys ({_said(levels, level)}) changes who plays, or what trees are made of;"
                " levels may change the environment alone"
            )


def _said(levels: LevelsSettings, level: int) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values_at(levels, level).items())


def _made_of(game: Game) -> tuple[object, ...]:
    sets = [game.function_set(number) for number in range(len(game.roles))]
    return game.roles, tuple(game.counts), [(of.functions, of.terminals) for of in sets]


class Levels:
    """Where the level of a run stands.

    Args:
        settings: the experiment; without levels nothing ever moves.
        game: the game that is played.
        past: what was kept of the generations that are finished.
    """

    def __init__(self, settings: EvolutionSettings, game: Game, past: Iterable[LevelRecord]) -> None:
        self._settings, self._game = settings, game
        self._event, self._at = "start", 0
        self._controller: Controller | None = None
        self.settings: EvolutionSettings | None = None
        if settings.levels is not None:
            self._controller = Controller(settings.levels, _rules(settings.levels, game))
            self._at, self.settings = -1, settings
            self._stand()
            for record in past:
                self._go_on(record.counted)

    @property
    def level(self) -> int | None:
        """The level of the games that come next; None if there are none."""
        return None if self._controller is None else self._controller.level

    def try_out(self, folders: Sequence[Path]) -> None:
        """Play one game on each level, so that a level that cannot be played is found before all others are.

        Raises:
            InputError: as the game has it.
        """
        if self._settings.levels is None:
            return
        alone = Program(np.array([-1], np.int16), np.zeros(1, np.int32))
        for level in range(self._settings.levels.levels):
            game = check_playable(level_settings(self._settings, level), folders)
            game.play([alone if role.evolves else None for role in game.roles], np.zeros(1, np.uint64))

    def observe(self, outcomes: Sequence[Played]) -> LevelRecord | None:
        """Return what is to be kept of a generation that was played on the level, and move it for the next."""
        if self._controller is None:
            return None
        record = LevelRecord(self._controller.level, self._event, _counted(self._game, outcomes))
        self._go_on(record.counted)
        return record

    def _go_on(self, counted: Counted) -> None:
        assert self._controller is not None
        event = self._controller.observe(counted)
        self._event = "stayed" if event is None else event.kind
        self._stand()

    def _stand(self) -> None:
        assert self._controller is not None
        if self._at != self._controller.level:
            self._at = self._controller.level
            self.settings = level_settings(self._settings, self._at)


# -------------------------------------------------------------------------------------------------------------- table


def level_columns(levels: LevelsSettings, game: Game) -> list[str]:
    """Return the columns of levels.csv: a generation, its event and level, the value of each key, and rates."""
    keys = [key for table in levels.keys for key in table]
    return ["generation", "event", "level", *keys, *_shown(levels, game)]


def _shown(levels: LevelsSettings, game: Game) -> list[str]:
    """Return the rates that stand in levels.csv: those of winners, and those that the level waits for."""
    wanted = {*levels.raise_when, *levels.lower_when}
    return [name for name in rates_of(game) if not name.startswith(_WITH) or name in wanted]


def level_lines(settings: EvolutionSettings, game: Game, records: Sequence[LevelRecord]) -> list[str]:
    """Return the lines of levels.csv: a generation each, and one more for the end."""
    levels = settings.levels
    assert levels is not None
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(level_columns(levels, game))
    rows = list(enumerate(records))
    if len(records) == settings.gp.generations:
        rows.append((len(records) - 1, records[-1]._replace(event="end")))
    for generation, record in rows:
        values = [json.dumps(value) for value in values_at(levels, record.level).values()]
        rates = [record.counted[name] for name in _shown(levels, game)]
        table.writerow(
            [generation, record.event, record.level, *values, *(a / n if n else "" for a, n in rates)],
        )
    return text.getvalue().splitlines()
