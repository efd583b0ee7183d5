"""A robot in words: what it plays and when, what of its tree matters, and how much its fitness says."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from coevo.tree.draw import percent
from coevo.tree.rules import Rule, question
from coevo.usage import UsedTree

__all__ = ["Description", "describe", "portrait", "questions"]

_RULES = 3  # of a terminal, that are told
_QUESTIONS = 5  # that are named
_NEVER = 4  # terminals that were never chosen, at most, that are named
_WIDTH = 100  # characters of a line


def questions(used: UsedTree) -> list[str]:
    """Return the questions that made a difference in the games of a tree, those asked most often first."""
    tree, steps = used.in_use
    asked: dict[str, int] = {}
    for node, name in enumerate(tree.names):
        if tree.second[node]:
            asked[name] = asked.get(name, 0) + int(steps[node])
    return [question(name) for name in sorted(asked, key=lambda name: -asked[name])]


@dataclass(frozen=True)
class Description:
    """What a robot does.

    Attributes:
        about: what it plays, by which questions, and how much of its tree it used.
        cases: for each terminal that was chosen a line on what it does, and in which share of the decisions; and the
            share and condition of each case in which it was chosen.
        worth: how its fitness compares, and how much to believe of it.
    """

    about: str
    cases: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
    worth: str


def describe(used: UsedTree) -> Description:
    """Return what a robot does in words."""
    return Description(" ".join([_plays(used), _decides(used), _unused(used)]), tuple(_cases(used)), _worth(used))


def portrait(used: UsedTree, unseen: str = "") -> str:
    """Return a few paragraphs on what a robot does.

    Args:
        used: its tree with its use.
        unseen: the command that plays games which evolution has not seen, if it is to be named.
    """
    told = describe(used)
    lines = []
    for heading, cases in told.cases:
        lines.append(_fill(heading))
        lines += [_fill(when, f"{share:>7}  ", " " * 9) for share, when in cases]
    worth = _fill(told.worth) + (f"\nJudge it by games that evolution has not seen:\n  {unseen}" if unseen else "")
    return "\n\n".join([_fill(told.about), "\n".join(lines) or "It was never asked.", worth])


def _plays(used: UsedTree) -> str:
    shares = sorted(used.usage.skill_use.items(), key=lambda item: -item[1])
    played = [f"{name} {percent(share)}" for name, share in shares if share]
    never = [name for name, share in shares if not share]
    if not played:
        return f"{used.robot} decided nothing in its games."
    often = f"{_listed(played)} of the time" if len(played) > 1 else f"{shares[0][0]} all the time"
    rest = f", and never {_listed(never, 'or')}" if 0 < len(never) <= _NEVER else ""
    return f"{used.robot} plays {often}{rest}."


def _decides(used: UsedTree) -> str:
    asked = questions(used)
    if not asked:
        return "No question made a difference." if used.tree.nodes > 1 else "It asks nothing."
    if len(asked) == 1:
        return f"It decides by one question: {asked[0]}"
    most = ", those asked most often" if len(asked) > _QUESTIONS else ""
    return f"It decides by {len(asked)} questions{most}: {' '.join(asked[:_QUESTIONS])}"


def _unused(used: UsedTree) -> str:
    unused, left = int((used.usage.node_steps == 0).sum()), used.simplified.nodes
    nodes, games = _counted(used.tree.nodes, "node"), _counted(used.games, "game")
    if unused:
        text = f"{unused} of its {nodes} {'was' if unused == 1 else 'were'} never used in its {games}"
    else:
        text = f"All of its {nodes} were used in its {games}" if used.tree.nodes > 1 else f"It has {nodes}"
    return (
        f"{text}; {_counted(left, 'node')} would do the same in every situation."
        if left < used.tree.nodes
        else f"{text}."
    )


def _cases(used: UsedTree) -> Iterator[tuple[str, tuple[tuple[str, str], ...]]]:
    """Yield for each terminal what it does, and in which share of the decisions it was chosen when."""
    cases: dict[str, list[Rule]] = {}
    for rule in used.rules_in_use:
        if rule.steps:
            cases.setdefault(rule.terminal, []).append(rule)
    for name, share in sorted(used.usage.skill_use.items(), key=lambda item: -item[1]):
        if name not in cases:
            continue
        said = used.functions.descriptions.get(name, "")
        # One case more takes no more room than the line that says that there is one.
        told = len(cases[name]) if len(cases[name]) <= _RULES + 1 else _RULES
        lines = [
            (percent(rule.share or 0.0), f"when {rule.when}" if rule.conditions else "whatever it sees")
            for rule in cases[name][:told]
        ]
        rest = cases[name][told:]
        if rest:
            lines.append((percent(sum(rule.share or 0.0 for rule in rest)), f"in {len(rest)} other cases"))
        yield f"{name} {percent(share)}{f': {said}' if said else ''}", tuple(lines)


def _worth(used: UsedTree) -> str:
    """Return what the fitness says: who is best of many in few games is lucky as well as good."""
    fitness = used.generation_fitness
    count, mean, worst = len(fitness), float(np.mean(fitness)), float(np.max(fitness))
    place = "the best" if used.rank == 0 else f"number {used.rank + 1}"
    text = f"Fitness {used.fitness:.4g}, where less is better: {place} of {count} in its generation"
    text += f" (best {fitness[0]:.4g}, mean {mean:.4g}, worst {worst:.4g})."
    if used.again is not None:
        return f"{text} Judged again it is {used.again[0]:.4g}, in the {used.again[1]} games by which it was chosen."
    if used.rank == 0 and count > 1:
        games = f"its {_counted(used.games, 'game')} overstate{'s' if used.games == 1 else ''} it"
        text += f" The best is the luckiest of {count} as well as a good one: {games}."
    return text


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' if number != 1 else ''}"


def _fill(text: str, first: str = "", following: str = "") -> str:
    return textwrap.fill(
        text, _WIDTH, initial_indent=first, subsequent_indent=following, break_on_hyphens=False, break_long_words=False
    )


def _listed(words: Sequence[str], link: str = "and") -> str:
    return f" {link} ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else words[0]
