"""Where the trees of a run came from: parents and operators of all, and each node of a champion back to its origin."""

from analysis.ancestry.breeding import lineage
from analysis.ancestry.family import ancestry_chart, family_chart, family_table, origin_chart, origin_table
from analysis.ancestry.inheritance import Ancestry, ancestors
from analysis.ancestry.words import sentences, summary

__all__ = [
    "Ancestry",
    "ancestors",
    "ancestry_chart",
    "family_chart",
    "family_table",
    "lineage",
    "origin_chart",
    "origin_table",
    "sentences",
    "summary",
]
