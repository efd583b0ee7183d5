"""How often what is rewarded happened while a skill was learned, block by block: Figs. 5.4 and 5.7."""

from __future__ import annotations

from behaviors.recipe import Recipe
from behaviors.trials.kernels import Results
from behaviors.trials.task import STRAY_GOAL, SUCCESS
from coevo.study import table_bytes

__all__ = ["FREQUENCIES", "frequency_table", "tells_frequencies"]

FREQUENCIES = "frequencies.csv"  # beside the skill
_TRIALS = 250  # a row


def tells_frequencies(recipe: Recipe) -> bool:
    """Tell whether a learning is of the kind whose frequencies are written: that of chapter 5."""
    return recipe.ends == "goal" or recipe.is_vector


def frequency_table(results: Results) -> bytes:
    """Return ``frequencies.csv``: counts over blocks of trials.

    Columns: ``trial`` at the end of the block, ``trials`` in it, ``steps`` of them; ``goals`` that count, ``stray``
    goals of the other robot; ``kicks``, steps of contact with the ball, and ``kicked``, trials with any;
    ``collisions``, and ``collided``, trials with any.
    """
    rows = []
    for first in range(0, len(results.ends), _TRIALS):
        block = Results(*(column[first : first + _TRIALS] for column in results))
        rows.append(
            {
                "trial": first + len(block.ends),
                "trials": len(block.ends),
                "steps": int(block.steps.sum()),
                "goals": int((block.ends == SUCCESS).sum()),
                "stray": int((block.ends == STRAY_GOAL).sum()),
                "kicks": int(block.kicks.sum()),
                "kicked": int((block.kicks > 0).sum()),
                "collisions": int(block.collisions.sum()),
                "collided": int((block.collisions > 0).sum()),
            }
        )
    return table_bytes(rows)
