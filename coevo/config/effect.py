"""Settings that change nothing, as another decides that they are not asked."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter

from coevo.config.experiment import EvolutionSettings

__all__ = ["without_effect"]

# By the beginning of a key: the settings that decide, and whether the key counts as they stand.
_ASKED: tuple[tuple[str, tuple[str, ...], Callable[[EvolutionSettings], bool]], ...] = (
    ("evaluation.partners", ("evaluation.grouping",), lambda of: of.evaluation.grouping != "random"),
    ("evaluation.hall_share", ("evaluation.grouping",), lambda of: of.evaluation.grouping == "hall-of-fame"),
    ("evaluation.against_share", ("evaluation.against",), lambda of: bool(of.evaluation.against)),
    ("fitness.fixed", ("fitness.kind",), lambda of: of.fitness.kind == "fixed"),
    ("fitness.varying", ("fitness.kind",), lambda of: of.fitness.kind == "varying"),
    ("gp.tournament", ("gp.variation",), lambda of: of.gp.variation == "genetic"),
    ("gp.mutation_depth_max", ("gp.mutation",), lambda of: of.gp.mutation > 0.0),
    ("gp.leaf_probability", ("gp.crossover_points",), lambda of: of.gp.crossover_points == "any"),
    (
        "gp.walked_changes",
        ("gp.changed_leaves", "gp.inserted_conditions"),
        lambda of: of.gp.changed_leaves + of.gp.inserted_conditions > 0.0,
    ),
    (
        "gp.walk_stop",
        ("gp.walked_changes", "gp.inserted_conditions"),
        lambda of: of.gp.walked_changes * of.gp.inserted_conditions > 0.0,
    ),
)


def without_effect(settings: EvolutionSettings, keys: Iterable[str]) -> list[str]:
    """Return for each key that changes nothing beside the other settings a line that says by which that is so.

    Args:
        settings: an experiment.
        keys: of settings that somebody gave on purpose, with dots. What a recipe carries along is not complained of.

    Example:
        >>> from coevo.config import without_effect
        >>> from coevo.recipes import read_experiment
        >>> changes = ["fitness.varying.alpha_s=0.001", "gp.tournament=8"]
        >>> settings = read_experiment("two-learners", changes)
        >>> without_effect(settings, [change.split("=")[0] for change in changes])
        ["fitness.varying.alpha_s changes nothing here: see fitness.kind, which is 'fixed'"]
    """
    found = []
    for key in dict.fromkeys(keys):
        for beginning, deciding, counts in _ASKED:
            if (key == beginning or key.startswith(f"{beginning}.")) and not counts(settings):
                told = ", ".join(f"{name}, which is {attrgetter(name)(settings)!r}" for name in deciding)
                found.append(f"{key} changes nothing here: see {told}")
    return found
