"""Whether a preset is worth evolving in: what small trees, both sides, passes and answers to answers come to there.

Teams are found by searches, and measured by other games. What was found can be kept in a file, so that its teams are
measured again in less time than they were searched for.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
import tomli_w

from analysis.baselines import Measured, gain, measure, team_line_up
from analysis.calibration.presets_search import Budget, search_preset, team_of
from coevo.config import read_toml
from coevo.console import note, output_options, show, table, worker_options
from coevo.contest import evolving_teams
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator, check_backend
from coevo.files import write_whole
from coevo.game import Game, check_playable, prepare
from coevo.recipes import read_experiment
from coevo.statistics import share_interval

__all__ = ["WANTED", "kept_teams", "presets", "properties"]

PRESETS = ("two-learners", "stationary-opponent", "three-learners")
WANTED: dict[str, tuple[float, float]] = {
    "small trees over single skills": (0.2, 1.0),
    "share of decided games": (0.3, 0.7),
    "time-outs": (0.0, 0.25),
    "passing over not passing": (0.05, 1.0),
    "rounds that moved": (4.0, np.inf),
}
"""What a preset should come to, from least to most."""

COLUMNS = ("recipe", "property", "side", "value", "low", "high", "holds", "teams")
_TURNS = 2  # the last turns of best answers, by which decided games are measured
_SMALL, _PASSING, _ROUNDS = 2000, 2100, 2200  # numbers of fresh games: with that of the team or round


def properties(
    game: Game,
    evaluator: Evaluator,
    found: Mapping[str, Any],
    *,
    games: int,
    seed: int,
    lost_weight: float = 0.0,
    recipe: str = "",
) -> pd.DataFrame:
    """Return what the properties of a preset are, as fresh games of teams that were found have it.

    Args:
        game, evaluator: what is played, and who plays.
        found: of ``search_preset``.
        games: of each team.
        seed: of these games.
        lost_weight: what a lost game takes away where answers are compared.
        recipe: its name.

    Returns:
        ``COLUMNS``, a row a property of ``WANTED`` and ``side`` (its robots, where a property has one): ``value`` with
        its interval over games (none for the number of rounds), ``holds`` (whether the value is as wanted), ``teams``
        that were compared. The share of decided games is that of the first team, none where only one evolves.
    """
    rows = []
    for side in found["sides"]:
        rows += _compared(game, evaluator, side, games, seed)
    rounds = [_round(game, evaluator, one, games, seed, _ROUNDS + number) for number, one in enumerate(found["rounds"])]
    gains = [gain(after, before, lost_weight) for before, after in rounds]
    teams = [one["team"] for one in found["rounds"]]
    last = [after if low > 0.0 else before for (before, after), (_, low, _) in zip(rounds, gains, strict=True)]
    rows += _decided(game, teams, last)
    moved = sum(low > 0.0 for _, low, _ in gains)
    rows.append(("rounds that moved", "", float(moved), np.nan, np.nan, f"of {len(rounds)}"))
    table_of = pd.DataFrame(rows, columns=["property", "side", "value", "low", "high", "teams"])
    limits = [WANTED[name] for name in table_of["property"]]
    holds = [least <= value <= most for (least, most), value in zip(limits, table_of["value"], strict=True)]
    return table_of.assign(recipe=recipe, holds=holds)[list(COLUMNS)]


def _compared(
    game: Game, evaluator: Evaluator, side: Mapping[str, Any], games: int, seed: int
) -> list[tuple[str, str, float, float, float, str]]:
    """Return by how much small trees beat single skills, and teams that pass those that do not."""
    team, robots = side["team"], ", ".join(side["single"])
    others = [team_line_up(game, team_of(game, one)) for one in side["met"]]
    rows = []
    pairs = [("small", "single", "small trees over single skills", _SMALL)]
    if "passing" in side:
        pairs.append(("passing", "silent", "passing over not passing", _PASSING))
    for first, second, name, number in pairs:
        parts = [team_line_up(game, team_of(game, side[which])) for which in (first, second)]
        one, two = measure(game, evaluator, team, parts, others, games=games, seed=seed, number=number + team)
        told = " against ".join(
            f"{_said(side[which])} ({of.share[0]:.3f})" for which, of in ((first, one), (second, two))
        )
        rows.append((name, robots, *gain(one, two), told))
    return rows


def _said(texts: Mapping[str, str]) -> str:
    return "; ".join(f"{robot}: {text}" for robot, text in texts.items())


def _round(
    game: Game, evaluator: Evaluator, one: Mapping[str, Any], games: int, seed: int, number: int
) -> tuple[Measured, Measured]:
    """Return fresh games of what was there before an answer, and of the answer."""
    met = [team_line_up(game, team_of(game, one["met"]))]
    parts = [team_line_up(game, team_of(game, one[which])) for which in ("before", "after")]
    before, after = measure(game, evaluator, one["team"], parts, met, games=games, seed=seed, number=number)
    return before, after


def _decided(
    game: Game, teams: Sequence[int], last: Sequence[Measured]
) -> list[tuple[str, str, float, float, float, str]]:
    """Return who wins decided games, and how many are not decided, over the last turns in which each side moved."""
    sides = evolving_teams(game)
    turn = len(sides) if len(sides) > 1 else sum(role.evolves for role in game.roles)
    shown = list(zip(teams, last, strict=True))[-_TURNS * turn :]
    first = [of.won if team == sides[0] else of.lost for team, of in shown]
    second = [of.lost if team == sides[0] else of.won for team, of in shown]
    won, lost = (int(np.concatenate(parts).sum()) for parts in (first, second))
    all_games = sum(len(of.won) for _, of in shown)
    names = ", ".join(role.name for role in game.roles if role.evolves and role.team == sides[0])
    rows = []
    if len(sides) > 1 and won + lost:
        rows.append(("share of decided games", names, won / (won + lost), *share_interval(won, won + lost), ""))
    none = all_games - won - lost
    rows.append(("time-outs", "", none / all_games, *share_interval(none, all_games), ""))
    return rows


@cache
def kept_teams() -> Mapping[str, Any]:
    """Return the teams by which the shipped presets are measured again, by the name of the recipe."""
    return tomllib.loads(Path(__file__).with_name("presets.toml").read_text(encoding="utf-8"))


@click.command()
@click.argument("recipes", nargs=-1, metavar="[RECIPE]...")
@click.option(
    "--games", type=click.IntRange(min=1), default=2000, show_default=True, help="Fresh games of each team compared."
)
@click.option(
    "--search-games", type=click.IntRange(min=1), default=60_000, show_default=True, help="Games of each search."
)
@click.option("--rounds", type=click.IntRange(min=1), default=8, show_default=True, help="Best answers, at most.")
@click.option(
    "--depth", type=click.IntRange(min=1, max=4), default=2, show_default=True, help="Of the deepest small tree."
)
@click.option(
    "--lost-weight",
    type=click.FloatRange(min=0.0),
    default=0.0,
    show_default=True,
    help="What a lost game takes away when teams are chosen, where one that is won is 1.",
)
@click.option(
    "--passing", multiple=True, default=("pass",), show_default=True, metavar="SKILL", help="Terminals that pass."
)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True)
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Replaces a setting; may be repeated.")
@click.option(
    "--again",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="Measure the teams of a file; search for none.",
)
@click.option("--teams", type=click.Path(path_type=Path), metavar="FILE.toml", help="Write the teams that were found.")
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE.json", help="Write the table.")
@worker_options
@output_options
def presets(
    *,
    recipes: tuple[str, ...],
    games: int,
    search_games: int,
    rounds: int,
    depth: int,
    lost_weight: float,
    passing: tuple[str, ...],
    seed: int,
    assignments: tuple[str, ...],
    again: Path | None,
    teams: Path | None,
    out: Path | None,
    workers: int,
    backend: str,
    as_json: bool,
    quiet: bool,
) -> None:
    """Measure whether recipes (by default the presets) are worth evolving in.

    \b
    Whether small trees beat single skills, both sides can win, games are decided, passing pays, and best answers move.
    Example: coevo reproduce presets three-learners
             coevo reproduce presets --search-games 200000 --teams teams.toml
    """
    check_backend(backend)
    names = list(dict.fromkeys(recipes or PRESETS))
    all_settings = {name: read_experiment(name, assignments) for name in names}
    games_of = {name: check_playable(settings) for name, settings in all_settings.items()}
    for name, game in games_of.items():
        _check_passing(name, game, passing)
    known = _read_teams(again, games_of) if again is not None else {}
    budget = Budget(search_games, games, rounds, depth, lost_weight, tuple(passing), seed)
    one = partial(properties, games=games, seed=seed, lost_weight=lost_weight)
    found, tables = {}, []
    for name, settings in all_settings.items():
        tell = _teller(name, quiet=quiet)
        prepare(settings, tell)
        with Evaluator(settings, workers=workers, backend=backend) as evaluator:
            game = games_of[name]
            found[name] = known[name] if again is not None else search_preset(game, evaluator, budget, tell)
            tables.append(one(game, evaluator, found[name], recipe=name))
    if teams is not None:
        _write_teams(teams, found)
    measured = pd.concat(tables, ignore_index=True)
    rows = [{key: _plain(value) for key, value in row.items()} for row in measured.to_dict("records")]
    show({"games": games, "search_games": search_games, "properties": rows}, _text(measured), as_json=as_json, out=out)


def _teller(name: str, *, quiet: bool) -> Callable[[str], None]:
    return lambda text: note(f"{name}: {text}", quiet=quiet)


def _check_passing(name: str, game: Game, passing: Sequence[str]) -> None:
    known = {t for k, role in enumerate(game.roles) if role.evolves for t in game.function_set(k).terminals}
    wrong = [skill for skill in passing if skill not in known]
    if wrong:
        raise InputError(f"--passing {wrong[0]}: {name} has no such terminal; it has {', '.join(sorted(known))}")


def _read_teams(path: Path, games: Mapping[str, Game]) -> dict[str, Any]:
    """Read teams of a file that the command wrote.

    Raises:
        InputError: it is no such file, or lacks a recipe.
    """
    data = read_toml(path)
    for name, game in games.items():
        if name not in data:
            raise InputError(f"{path} has no teams of {name}; it has those of {', '.join(data) or 'none'}")
        try:
            for one in data[name]["rounds"]:
                _check_team(game, one, [one[part] for part in ("before", "after", "met")])
            for side in data[name]["sides"]:
                passing = [side[part] for part in ("passing", "silent")] if "passing" in side else []
                _check_team(game, side, [side["single"], side["small"], *passing, *side["met"]])
            if not data[name]["rounds"]:
                raise IndexError("no round")
        except (KeyError, TypeError, AttributeError, IndexError) as error:
            raise InputError(
                f"{path}: {name}: expected what 'coevo reproduce presets --teams' writes ({error!r})"
            ) from None
    return data


def _check_team(game: Game, of: Mapping[str, Any], texts: Sequence[Mapping[str, str]]) -> None:
    if of["team"] not in evolving_teams(game):
        raise IndexError(f"no team {of['team']} that evolves")
    for one in texts:
        team_of(game, one)


def _write_teams(path: Path, found: Mapping[str, Any]) -> None:
    try:
        write_whole(path, tomli_w.dumps(found).encode())
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}; choose another --teams") from None


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _text(measured: pd.DataFrame) -> str:
    rows, told = [], []
    for row in measured.to_dict("records"):
        least, most = WANTED[row["property"]]
        wanted = f"{least:g} to {most:g}" if most < 1.0 else f"at least {least:g}"
        if np.isfinite(row["low"]):
            value = f"{row['value']:.3f} [{row['low']:.3f}, {row['high']:.3f}]"
        else:
            value = f"{row['value']:g} {row['teams']}"
        what = row["property"] + (f" ({row['side']})" if row["side"] else "")
        rows.append([row["recipe"], what, value, wanted, "yes" if row["holds"] else "no"])
        if " against " in row["teams"]:
            told.append(f"{row['recipe']}, {what}: {row['teams']}")
    return "\n".join([table(["recipe", "property", "measured [95 %]", "wanted", "holds"], rows), *told])
