"""What the dynamics of a tournament are called."""

from __future__ import annotations

from analysis.progress import MINIMUM_GENERATIONS, Diagnosis, diagnose
from analysis.tournament.play import Tournament

__all__ = ["TOO_FEW", "diagnoses"]

TOO_FEW = f"fewer than {MINIMUM_GENERATIONS} generations are too few to tell progress from luck."


def diagnoses(tournament: Tournament) -> list[Diagnosis | None]:
    """Return the diagnosis of each side of a finished tournament, None where generations are too few for one."""
    sides = range(len(tournament.teams))
    if len(tournament.generations) < MINIMUM_GENERATIONS:
        return [None for _ in sides]
    return [diagnose(tournament.share(side), games=tournament.games) for side in sides]
