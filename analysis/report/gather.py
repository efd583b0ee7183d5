"""What a report tells of one run: games are played for it, or read where they are kept in the run folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.ancestry import Ancestry, ancestors
from analysis.tournament import (
    Against,
    Left,
    Tournament,
    chosen_generations,
    in_words,
    largest_tournament,
    left_over,
    play_again,
    play_against,
    play_tournament,
    single_skill_outsiders,
)
from coevo.contest import Judged, judge
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.game import SoccerGame, programs_of
from coevo.replay import game_recording, make_page
from coevo.run import Run
from coevo.usage import UsedTree, champions_in_words, play_seeds, used_tree

__all__ = ["Findings", "find_out"]

_GENERATIONS = 15  # of a tournament that is played for a report
_GAMES = 20  # of a pair
_OUTSIDE = 40  # of a generation against an outsider
_REPEATS = 4
_WATCHED = 3  # games to watch
_UNSEEN = 400  # games by which the last champions are judged


@dataclass(frozen=True)
class Findings:
    """What was found out about a run.

    Attributes:
        run: the run.
        judged: how its last champions do in unseen games.
        tournament: all generations against each other, or some.
        dynamics: what these are called for each side, in words.
        against: generations against single skills.
        left: how much of champions' advantage is left when they play again.
        trees: the champion of each robot of the last generation, with its use.
        ancestries: where these came from, or why that cannot be told.
        replay: a page that plays games of the last champions; empty where the game has no pictures.
    """

    run: Run
    judged: Sequence[Judged]
    tournament: Tournament
    dynamics: Sequence[str]
    against: Against
    left: Sequence[Left]
    trees: Sequence[UsedTree]
    ancestries: Sequence[Ancestry | str]
    replay: str

    @property
    def sides(self) -> dict[int, str]:
        """A name for each team."""
        return {
            team: ", ".join(names) for team, names in zip(self.tournament.teams, self.tournament.robots, strict=True)
        }


def find_out(run: Run, evaluator: Evaluator, tell: Callable[[str], None]) -> Findings:
    """Play what a report needs.

    Args:
        run: with at least one finished generation.
        evaluator: plays.
        tell: receives a line before each part.

    Raises:
        InputError: no generation is finished.
    """
    generations = chosen_generations(run.finished, max(1, -(-run.finished // _GENERATIONS)))
    tell(f"Judging the last champions by {_UNSEEN} games that evolution has not seen ...")
    judged = list(judge(run, evaluator, games=_UNSEEN))
    kept = largest_tournament(run)
    if kept is not None and len(kept.generations) >= len(generations):
        tournament = kept
    else:
        tell(f"Letting {len(generations)} generations play against each other ...")
        tournament = play_tournament(run, evaluator, generations=generations, games=_GAMES)
    tell("Letting them play against single skills, and once more ...")
    against = play_against(run, evaluator, single_skill_outsiders(run), generations=generations, games=_OUTSIDE)
    left = left_over(play_again(run, evaluator, generations=generations, repeats=_REPEATS))
    tell("Following trees and their ancestry ...")
    last = run.finished - 1
    trees = [used_tree(run, robot, last) for robot in run.evolving.values()]
    ancestries = [_ancestry(run, tree) for tree in trees]
    return Findings(run, judged, tournament, in_words(tournament), against, left, trees, ancestries, _replay(run))


def _ancestry(run: Run, tree: UsedTree) -> Ancestry | str:
    try:
        return ancestors(run, tree.robot, tree.generation, tree.index, node_steps=tree.usage.node_steps)
    except InputError as error:  # bred by another version
        return f"{tree.robot}: {error}"


def _replay(run: Run) -> str:
    """Return a page that plays games between the last champions."""
    game = run.game
    if not isinstance(game, SoccerGame):
        return ""
    names = [run.evolving.get(role) for role in range(len(game.roles))]
    trees = [None if name is None else run.champion_tree(name, run.finished - 1) for name in names]
    programs = programs_of(game, trees)
    traces = [game.arena.trace(programs, seed)[1] for seed in play_seeds(run.config.seed, _WATCHED)]
    name = f"{run.config.name}: {champions_in_words(run, run.finished - 1)}"
    return make_page(game_recording(game.settings, traces, trees=game.trees_of(trees), name=name))
