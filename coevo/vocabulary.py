"""The words of Table 6.1: what soccer's trees are made of unless settings say otherwise."""

from __future__ import annotations

import re

__all__ = ["CATEGORIES", "PREFIX", "SKILLS", "THINGS", "in_words", "is_standard"]

PREFIX = "IF_"  # how the name of every function begins, and of no terminal
CATEGORIES = ("left", "middle", "right", "small", "medium", "large", "lost")
SKILLS = ("shoot", "pass", "avoid", "search")
THINGS = ("ball", "own_goal", "opponent_goal")  # and every other robot: r0, r1, ...
_STANDARD = re.compile(rf"{PREFIX}({'|'.join(THINGS)}|r\d+)_is_({'|'.join(CATEGORIES)})")


def in_words(name: str) -> str:
    """Return the name of a node as people say it.

    Example:
        >>> from coevo.vocabulary import in_words
        >>> in_words("IF_opponent_goal_is_large"), in_words("shoot")
        ('opponent goal is large?', 'shoot')
    """
    if not name.startswith(PREFIX):
        return name
    return name[len(PREFIX) :].replace("_is_", " is ").replace("_", " ") + "?"


def is_standard(name: str) -> bool:
    """Tell whether ``name`` is a function of Table 6.1, for any number of robots, or one of its four terminals."""
    return name in SKILLS or _STANDARD.fullmatch(name) is not None
