"""Where the trees of a run came from: parents and operators of all, and each node of a champion back to its origin.

Charts are in ``analysis.ancestry.charts``, which needs altair.
"""

from analysis.ancestry.breeding import lineage
from analysis.ancestry.family import family_table, link_table, origin_table
from analysis.ancestry.inheritance import Ancestry, ancestors
from analysis.ancestry.words import sentences, summary

__all__ = [
    "Ancestry",
    "ancestors",
    "family_table",
    "lineage",
    "link_table",
    "origin_table",
    "sentences",
    "summary",
]
