"""What the dynamics of a tournament are called."""

from __future__ import annotations

from analysis.progress import MINIMUM_GENERATIONS, Diagnosis, diagnose
from analysis.tournament.play import Tournament

__all__ = ["diagnoses", "in_words"]

_TOO_FEW = f"Fewer than {MINIMUM_GENERATIONS} generations are too few to tell progress from luck."


def diagnoses(tournament: Tournament) -> list[Diagnosis | None]:
    """Return the diagnosis of each side of a finished tournament, None where generations are too few for one."""
    sides = range(len(tournament.teams))
    if len(tournament.generations) < MINIMUM_GENERATIONS:
        return [None for _ in sides]
    return [diagnose(tournament.share(side), games=tournament.games) for side in sides]


def in_words(tournament: Tournament) -> list[str]:
    """Return in a sentence or two for each side what the dynamics are called, and why.

    Wins alone do not tell a side that loses from one whose games nobody wins; the tournament knows.
    """
    said = []
    for side, found in enumerate(diagnoses(tournament)):
        if found is None:
            said.append(_TOO_FEW)
        elif "disengagement" in found.labels and found.late_level < 0.5 and tournament.lost(side)[-1].mean() < 0.5:
            said.append(f"{found.text} Most of its games nobody wins.")
        else:
            said.append(found.text)
    return said
