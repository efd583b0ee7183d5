"""An ancestry in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from analysis.ancestry.inheritance import Ancestry

__all__ = ["sentences", "summary"]

_MOST = 6  # generations that a sentence lists
_COPIES = ("elite", "reproduction")
_LATER = {"mutation": "from mutations", "crossover": "from small changes after crossovers"}  # nodes that no parent had


def summary(ancestry: Ancestry) -> dict[str, Any]:
    """Return what is to be said of an ancestry, as plain data.

    Returns:
        ``robot, generation, index, fitness, nodes, depth``; ``in_use``, how many nodes were passed at all (None where
        not known, here and below); ``origins``, a list of ``generation, operator, nodes, in_use, use``: when its nodes
        came into being, and their share of all passes of nodes; ``root_line``, a list of ``generation, index, operator,
        fitness, nodes, carried``; ``operators``, how many steps of the root line each made; ``last_change``, the step
        that made the tree what it is, with the number of nodes ``from_parent_1``, ``from_parent_2`` and ``new``;
        ``ancestors``, how many there are in the generations before, and ``contributing``, those of whom something is
        left.
    """
    table, nodes, line = ancestry.ancestors, ancestry.nodes, ancestry.root_line
    own = table.iloc[-1]
    by_origin: Any = nodes.groupby(["generation", "operator"])
    passes, known = nodes["steps"].sum(), bool(nodes["steps"].notna().all())
    origins = [
        {
            "generation": int(generation),
            "operator": operator,
            "nodes": len(rows),
            "in_use": int(rows["steps"].gt(0).sum()) if known else None,
            "use": float(rows["steps"].sum() / max(passes, 1.0)) if known else None,
        }
        for (generation, operator), rows in by_origin
    ]
    changed = line[~line["operator"].isin(_COPIES)].iloc[-1]
    before = table[table["generation"] < ancestry.generation]
    return {
        "robot": ancestry.robot,
        "generation": ancestry.generation,
        "index": ancestry.index,
        "fitness": float(own["fitness"]),
        "nodes": len(nodes),
        "depth": int(own["depth"]),
        "in_use": int(own["carried_used"]) if known else None,
        "origins": origins,
        "root_line": line[["generation", "index", "operator", "fitness", "nodes", "carried"]].to_dict("records"),
        "operators": {str(name): int(count) for name, count in line["operator"].iloc[1:].value_counts().items()},
        "last_change": {
            "generation": int(changed["generation"]),
            "operator": changed["operator"],
            "from_parent_1": int(changed["from_1"]),
            "from_parent_2": int(changed["from_2"]),
            "new": int(changed["arisen"]),
        },
        "ancestors": len(before),
        "contributing": int(before["carried"].gt(0).sum()),
    }


def _number(count: int, singular: str, plural: str = "") -> str:
    return f"{count} {singular if count == 1 else plural or singular + 's'}"


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _by_origin(origins: Sequence[dict[str, Any]], what: str) -> str:
    """Say how many nodes were created, in the first generation as a rule, and how many came later, and by what."""
    created = sum(origin[what] for origin in origins if origin["operator"] == "creation")
    first = min((origin["generation"] for origin in origins if origin["operator"] == "creation"), default=0)
    parts = [f"{created} from generation {first}"] if created else []
    for operator, words in _LATER.items():
        came = [origin for origin in origins if origin["operator"] == operator and origin[what]]
        if not came:
            continue
        total = sum(origin[what] for origin in came)
        largest = sorted(came, key=lambda origin: -origin[what])[:_MOST]
        told = [f"{origin[what]} in generation {origin['generation']}" for origin in came if origin in largest]
        rest = total - sum(origin[what] for origin in largest)
        told += [f"{rest} in {len(came) - len(largest)} others"] if rest else []
        parts.append(f"{total} {words} ({', '.join(told)})")
    return _listed(parts) if len(parts) > 1 or not created else f"all from generation {first}"


def _last_change(found: dict[str, Any]) -> str:
    change = found["last_change"]
    generation, new = change["generation"], change["new"]
    when = f"in generation {generation}"
    copied = f", and was copied as it is since: nothing in generation {found['generation']} is new"
    after = copied if generation < found["generation"] else ""
    if change["operator"] == "creation":
        return f"It was created {when}{after}."
    if change["operator"] == "mutation":
        return (
            f"It came about by mutation {when}, which put {_number(new, 'new node')} to"
            f" {change['from_parent_1']} inherited{after}."
        )
    parts = [
        f"{_number(change['from_parent_1'], 'node')} of its first parent",
        f"{change['from_parent_2']} of the second",
    ]
    parts += [f"{new} new by small changes"] if new else []
    return f"It came about by crossover {when}: {_listed(parts)}{after}."


def _called(found: dict[str, Any], rank: int, again: tuple[float, int] | None) -> str:
    """Say whose ancestry it is."""
    place = f"{'best' if rank == 0 else f'rank {rank}'} of generation {found['generation']}"
    if again is None:
        return f"{found['robot']}'s {place}"
    return f"{found['robot']}'s champion ({place}, chosen once more by {again[1]} games)"


def sentences(found: dict[str, Any], rank: int = 0, again: tuple[float, int] | None = None) -> list[str]:
    """Say what ``summary`` found.

    Args:
        found: what it returned.
        rank: of the individual in its generation; 0 is the best.
        again: of a champion that was chosen once more its fitness in these games, and their number.
    """
    who = _called(found, rank, again)
    told = [f"{who} has {_number(found['nodes'], 'node')}: {_by_origin(found['origins'], 'nodes')}."]
    if found["in_use"]:
        uses = _by_origin(found["origins"], "in_use")
        told.append(f"{_number(found['in_use'], 'node was', 'nodes were')} in use: {uses}.")
    told.append(_last_change(found))
    line = found["root_line"]
    if len(line) > 1:
        names = {"elite": ("elite copy", "elite copies")}
        order = ("crossover", "mutation", "reproduction", "elite")
        steps = [
            _number(found["operators"][name], *names.get(name, (name,))) for name in order if name in found["operators"]
        ]
        best = min(line, key=lambda member: member["fitness"])
        told.append(
            f"Its root line went through {_listed(steps)}, from fitness {line[0]['fitness']:.3f} to"
            f" {line[-1]['fitness']:.3f} (best {best['fitness']:.3f}, in generation {best['generation']})."
        )
        told.append(
            f"It has {_number(found['ancestors'], 'ancestor')}; of {found['contributing']} of them something is left."
        )
    return told
