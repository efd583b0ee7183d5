"""What a tree does as rules: for each leaf when it is reached, in as few conditions as say it, and in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

from coevo.tree.fold import Steps
from coevo.tree.functions import FunctionSet, Situations
from coevo.tree.nodes import Nodes
from coevo.tree.situations import condition_groups
from coevo.vocabulary import PREFIX

__all__ = ["Rule", "in_words", "leaf_rules", "question"]

# A condition with its answer.
Answered = tuple[str, bool]

_MOST_NAMES = 16  # of conditions that belong together; of more, pairs that were not asked are not tried


@dataclass(frozen=True)
class Rule:
    """When a leaf is reached.

    Attributes:
        conditions: names of conditions with their answers, all of which have to be; none if it is always reached.
        terminal: what is done then.
        leaf: the number of the leaf in its tree.
        steps: how many came to it; None if nothing was counted.
        share: of all steps; None likewise.
    """

    conditions: tuple[Answered, ...]
    terminal: str
    leaf: int
    steps: int | None = None
    share: float | None = None

    @property
    def when(self) -> str:
        """The conditions in words."""
        return in_words(self.conditions)

    def holds(self, true: Collection[str]) -> bool:
        """Tell whether the leaf is reached where exactly the conditions ``true`` hold."""
        return all((name in true) == answer for name, answer in self.conditions)


def leaf_rules(tree: Nodes, functions: FunctionSet | None = None, steps: Steps | None = None) -> list[Rule]:
    """Return a rule for each leaf that can be reached; in every situation exactly one of them holds.

    Args:
        tree: any tree; the rules of a simplified one are shorter.
        functions: says which conditions depend on each other, as for ``coevo.tree.simplify``.
        steps: (nodes,) how often each node was passed.

    Example:
        >>> from coevo.tree import parse
        >>> from coevo.tree.rules import leaf_rules
        >>> tree = parse("IF_ball_is_lost(search, IF_ball_is_left(pass, IF_ball_is_right(pass, shoot)))")
        >>> for rule in leaf_rules(tree):
        ...     print(f"{rule.terminal} when {rule.when}")
        search when ball is lost
        pass when ball is left
        pass when ball is right
        shoot when ball is middle
    """
    groups, number = condition_groups(tree.names, functions)
    counted = steps is not None and int(steps[0]) > 0
    said: dict[tuple[int, Situations], tuple[Answered, ...]] = {}
    rules = []
    stack: list[tuple[int, dict[int, Situations]]] = [(0, {})]
    while stack:
        node, left = stack.pop()
        name = tree.names[node]
        if tree.second[node]:
            group = number[name]
            possible = left.get(group, groups[group])
            yes = tuple(situation for situation in possible if name in situation)
            no = tuple(situation for situation in possible if name not in situation)
            for child, remaining in ((tree.second[node], no), (node + 1, yes)):
                if remaining:
                    stack.append((child, {**left, group: remaining}))
            continue
        conditions: list[Answered] = []
        for group, remaining in left.items():
            if (group, remaining) not in said:
                said[group, remaining] = _shortest(groups[group], remaining)
            conditions += said[group, remaining]
        passed = int(steps[node]) if steps is not None and counted else None
        share = passed / int(steps[0]) if steps is not None and passed is not None else None
        rules.append(Rule(tuple(conditions), name, node, passed, share))
    return rules


def _shortest(group: Situations, remaining: Situations) -> tuple[Answered, ...]:
    """Return as few conditions as possible that hold in exactly ``remaining`` of the situations of a group."""
    if len(remaining) == len(group):
        return ()
    names = sorted(frozenset().union(*group), key=lambda name: (name.rsplit("_is_", 1)[0], name))
    literals = [*((name, True) for name in names), *((name, False) for name in names)]
    target = set(remaining)
    for count in (1, 2) if len(names) <= _MOST_NAMES else (1,):
        for chosen in combinations(literals, count):
            if {one for one in group if _fits(one, chosen)} == target:
                return chosen
    # What all have or none has says it, as every set that questions leave is cut out by such answers.
    kept = [
        (name, answer) for name, answer in literals if all((name in situation) == answer for situation in remaining)
    ]
    for literal in list(reversed(kept)):
        fewer = [one for one in kept if one != literal]
        if {one for one in group if _fits(one, fewer)} == target:
            kept = fewer
    return tuple(kept)


def _fits(situation: frozenset[str], literals: Sequence[Answered]) -> bool:
    return all((name in situation) == answer for name, answer in literals)


def question(name: str) -> str:
    """Return a condition as a question: ``IF_own_goal_is_left`` asks "own goal is left?"; a terminal is its name."""
    return f"{_said(name)}?" if name.startswith(PREFIX) else name


def _said(name: str) -> str:
    return name[len(PREFIX) :].replace("_", " ")


def in_words(conditions: Sequence[Answered]) -> str:
    """Return conditions with their answers as a clause; what is said of one thing stands together.

    Example:
        >>> from coevo.tree.rules import in_words
        >>> in_words([("IF_ball_is_left", True), ("IF_dark", False), ("IF_ball_is_small", False)])
        'ball is left and not small, and not dark'
    """
    about: dict[str, list[str]] = {}
    for name, answer in conditions:
        thing, is_, what = name[len(PREFIX) :].rpartition("_is_")
        said = (what if is_ else name[len(PREFIX) :]).replace("_", " ")
        about.setdefault(thing.replace("_", " ") if is_ else "", []).append(said if answer else f"not {said}")
    clauses: list[str] = []
    for thing, answers in about.items():
        clauses += [f"{thing} is {' and '.join(answers)}"] if thing else answers
    if len(clauses) < 2:
        return clauses[0] if clauses else "always"
    last = ", and " if any(" and " in clause for clause in clauses) else " and "
    return f"{', '.join(clauses[:-1])}{last}{clauses[-1]}"
