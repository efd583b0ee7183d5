"""The nodes of a tree by their names, and what follows from their order: what folding and drawing need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from coevo.vocabulary import PREFIX

__all__ = ["Nodes"]


@dataclass(frozen=True)
class Nodes:
    """The names of a tree's nodes in prefix order; every IF has two branches, every terminal is a leaf."""

    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def second(self) -> tuple[int, ...]:
        """For each node where its second branch begins; 0 for a leaf."""
        second = [0] * len(self.names)
        waiting: list[int] = []
        for position, name in enumerate(self.names):
            if name.startswith(PREFIX):
                waiting.append(position)
                continue
            while waiting and second[waiting[-1]]:
                waiting.pop()
            if waiting:
                second[waiting[-1]] = position + 1
        return tuple(second)

    @cached_property
    def depths(self) -> tuple[int, ...]:
        """Depth of each node; the root has 0."""
        depths: list[int] = []
        open_depths = [0]
        for name in self.names:
            depth = open_depths.pop()
            depths.append(depth)
            if name.startswith(PREFIX):
                open_depths += [depth + 1, depth + 1]
        return tuple(depths)

    @property
    def depth(self) -> int:
        """Depth of the deepest node; 0 for a single terminal."""
        return max(self.depths)

    @property
    def nodes(self) -> int:
        """Number of functions and terminals."""
        return len(self.names)
