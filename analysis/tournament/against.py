"""All generations of a run against outsiders, who stay the same: single skills, hand-typed trees, other runs.

Progress against the other side may be running on the spot. Outsiders do not run.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coevo.contest import LineUp, champions, evolving_teams, line_up
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator, Match
from coevo.game import Game
from coevo.run import Run, open_run
from coevo.seeds import RunStream, game_seeds
from coevo.tree import compile_program, parse, tree_codes

__all__ = ["Against", "Outsider", "play_against", "read_outsider", "single_skill_outsiders"]


@dataclass(frozen=True)
class Outsider:
    """A line-up that does not evolve with the run.

    Attributes:
        name: as it was given.
        trees: for each role that evolves the text of a tree.
    """

    name: str
    trees: tuple[tuple[int, str], ...]

    def line_up(self, game: Game, team: int) -> LineUp:
        """Return the programs of a team.

        Raises:
            InputError: a tree asks or chooses what its role does not know.
        """
        found = {}
        for role, text in self.trees:
            if game.roles[role].team == team:
                functions = game.function_set(role)
                found[role] = compile_program(tree_codes(parse(text, functions), functions), functions)
        return found


def single_skill_outsiders(run: Run) -> list[Outsider]:
    """Return an outsider for each terminal that every role has: all robots use it throughout."""
    game, roles = run.game, list(run.evolving)
    common = [
        name
        for name in game.function_set(roles[0]).terminals
        if all(name in game.function_set(role).terminals for role in roles)
    ]
    return [Outsider(name, tuple((role, name) for role in roles)) for name in common]


def read_outsider(run: Run, text: str) -> Outsider:
    """Return the outsider that a person names.

    Args:
        run: whose generations it is to meet.
        text: a tree, which every robot plays; trees joined by ``+``, one for each robot of a side in turn; or the
            folder of another run, whose last champions play.

    Raises:
        InputError: says what was expected.
    """
    folder = Path(text)
    if _is_run(folder):
        other = open_run(folder)
        names = {name: role for role, name in run.evolving.items()}
        if set(names) != set(other.evolving.values()):
            raise InputError(
                f"{folder} evolves {', '.join(other.evolving.values())}, {run.path} {', '.join(names)}:"
                " champions can only take the places of robots that evolve in both"
            )
        last = other.finished - 1
        if last < 0:
            raise InputError(f"{folder} has no finished generation")
        champions = tuple((role, str(other.champion_tree(name, last))) for name, role in names.items())
        return _checked(run, Outsider(text, champions))
    given = [part.strip() for part in text.split("+")]
    trees = []
    for team in evolving_teams(run.game):
        roles = [role for role in run.evolving if run.game.roles[role].team == team]
        if len(given) not in (1, len(roles)):
            continue  # meant for another side
        chosen = given * len(roles) if len(given) == 1 else given
        trees += list(zip(roles, chosen, strict=True))
    if not trees:
        raise InputError(f"--against {text}: no side has {len(given)} robots; give one tree for all, or one for each")
    return _checked(run, Outsider(text, tuple(trees)))


def _is_run(folder: Path) -> bool:
    try:
        return (folder / "config.toml").is_file()
    except OSError:  # a tree may be longer than names of files can be
        return False


def _checked(run: Run, outsider: Outsider) -> Outsider:
    for team in evolving_teams(run.game):
        outsider.line_up(run.game, team)
    return outsider


@dataclass(frozen=True)
class Against:
    """What generations of a run won against outsiders.

    Attributes:
        teams: numbers of the teams that evolve.
        outsiders: their names.
        generations: which took part.
        games: of each generation against each outsider.
        wins, lost: (teams, n, outsiders) int64, games that the team won, and that the outsider won; -1 where the
            outsider has no place on the other side. With one team there is no other side: ``wins`` is what the
            outsider won in its place, the same for all generations, and ``lost`` is -1.
    """

    teams: tuple[int, ...]
    outsiders: tuple[str, ...]
    generations: tuple[int, ...]
    games: int
    wins: NDArray[np.int64]
    lost: NDArray[np.int64]


def _name(outsider: Outsider, generations: Sequence[int], games: int) -> str:
    digest = hashlib.sha256(repr(outsider).encode() + repr(tuple(generations)).encode()).hexdigest()[:12]
    return f"against-{games}-{digest}"


def play_against(
    run: Run,
    evaluator: Evaluator,
    outsiders: Sequence[Outsider],
    *,
    generations: Sequence[int],
    games: int,
    report: Callable[[int, int], None] | None = None,
) -> Against:
    """Let the champions of generations meet outsiders; what was played before is taken from the run folder.

    Args:
        run: with these generations finished.
        evaluator: plays.
        outsiders: whom they meet.
        generations: which take part.
        games: of each generation against each outsider, from the same starts for all.
        report: called after each outsider with how many are done, and of how many.
    """
    chosen, game = tuple(generations), run.game
    teams = evolving_teams(game)
    wins = np.full((len(teams), len(chosen), len(outsiders)), -1, np.int64)
    lost = wins.copy()
    own = [champions(run, generation) for generation in chosen]
    for k, outsider in enumerate(outsiders):
        name = _name(outsider, chosen, games)
        kept = run.result(name)
        if kept is None:
            kept = _meet(run, evaluator, outsider, own, games)
            run.save_result(name, kept)
        wins[:, :, k], lost[:, :, k] = kept["wins"], kept["lost"]
        if report is not None:
            report(k + 1, len(outsiders))
    return Against(teams, tuple(one.name for one in outsiders), chosen, games, wins, lost)


def _meet(
    run: Run, evaluator: Evaluator, outsider: Outsider, own: Sequence[dict[int, LineUp]], games: int
) -> dict[str, NDArray[np.int64]]:
    game, teams = run.game, evolving_teams(run.game)
    found = {key: np.full((len(teams), len(own)), -1, np.int64) for key in ("wins", "lost")}
    seeds = game_seeds(run.config.seed, RunStream.TOURNAMENT, run.config.gp.generations, count=games)
    for at, team in enumerate(teams):
        parts = {other: outsider.line_up(game, other) for other in teams if other != team or len(teams) == 1}
        if not all(parts.values()):
            continue
        if len(teams) == 1:
            (played,) = evaluator.play([Match(line_up(game, parts[team]), seeds)])
            found["wins"][at] = (played.winner == team).sum()
            continue
        matches = [Match(line_up(game, mine[team], *parts.values()), seeds) for mine in own]
        for i, played in enumerate(evaluator.play(matches)):
            found["wins"][at, i] = (played.winner == team).sum()
            found["lost"][at, i] = np.isin(played.winner, list(parts)).sum()
    return found
