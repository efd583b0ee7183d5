"""What came of a run, in plain words with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.tournament import Left
from coevo.contest import Judged
from coevo.evolution.grouping import games_of_run
from coevo.run import Run

__all__ = ["compared", "in_short", "percent", "who"]


def percent(interval: tuple[float, float, float]) -> str:
    """Return a share and its interval: ``19 % [16, 23]``."""
    share, low, high = (100.0 * value for value in interval)
    return f"{share:.0f} % [{low:.0f}, {high:.0f}]"


def who(robots: Sequence[str]) -> str:
    """Return names as a sentence has them: ``r0 and r1``."""
    return " and ".join(robots) if len(robots) < 3 else f"{', '.join(robots[:-1])} and {robots[-1]}"


def compared(above: tuple[float, float, float]) -> str:
    """Return what may be said of a difference of two shares with its interval."""
    _, low, high = above
    points = [round(100.0 * value) for value in above]
    if low > 0.0:
        return f"{points[0]} points [{points[1]}, {points[2]}] more than"
    if high < 0.0:
        return f"{-points[0]} points [{-points[2]}, {-points[1]}] fewer than"
    return f"as many, as far as these games can tell ({points[0]:+d} points [{points[1]:+d}, {points[2]:+d}]), as"


def in_short(run: Run, judged: Sequence[Judged], dynamics: Sequence[str], left: Sequence[Left]) -> list[str]:
    """Return a few paragraphs: what was run, what came of it, whether it was progress, and how much was luck."""
    config = run.config
    generations, gp = run.finished, config.gp
    games = games_of_run(config, run.game.roles, generations)
    sides = [who(one.robots) for one in judged]
    against = " against ".join(sides) if len(sides) > 1 else f"{sides[0]}, one team"
    unfinished = "" if run.is_finished else f" It is not finished: {gp.generations} generations were asked for."
    size = f"{generations} generations of {gp.population} trees a robot"
    texts = [f"{against} co-evolved for {size}, in {games:,} games.{unfinished}"]
    for one, named in zip(judged, dynamics, strict=True):
        skills = who([f"{robot} {skill}" for robot, skill in one.skills.items()])
        side = who(one.robots)
        opponents = " against the last of the other side" if len(judged) > 1 else ""
        text = (
            f"In {one.games} games that evolution has not seen, the last {side} {_win(one.robots)}"
            f" {percent(one.last)}{opponents}. That is {compared(one.over_first)} the first champions,"
            f" and {compared(one.over_single_skills)} the best team of single skills ({skills})."
        )
        texts.append(f"{text} {named}")
    if left:
        shares = ", ".join(f"{one.robot} {one.text}" for one in left)
        texts.append(
            "The best fitness of a generation is that of a tree that is good and lucky. Of the champions' advantage"
            f" over their generation, this much is left when they play again: {shares}. The curves of the best"
            " fitness are to be read with that in mind."
        )
    return texts


def _win(robots: Sequence[str]) -> str:
    return "win" if len(robots) > 1 else "wins"
