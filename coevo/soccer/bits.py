"""Counting the bits of a word: one instruction each, and LLVM knows how to do several words at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from coevo.compiled import inlined

__all__ = ["ones", "sum_of_places", "zeros_above", "zeros_below"]

_DEFINED_FOR_ZERO = ir.Constant(ir.IntType(1), 0)


@intrinsic
def ones(_typing: Any, _word: Any) -> Any:
    """Count the set bits of a 64-bit word."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), generate


@intrinsic
def zeros_above(_typing: Any, _word: Any) -> Any:
    """Count the zeros above the highest set bit of a 64-bit word, 64 if none is set."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctlz(arguments[0], _DEFINED_FOR_ZERO)

    return types.int64(types.uint64), generate


@intrinsic
def zeros_below(_typing: Any, _word: Any) -> Any:
    """Count the zeros below the lowest set bit of a 64-bit word, 64 if none is set."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], _DEFINED_FOR_ZERO)

    return types.int64(types.uint64), generate


@inlined
def sum_of_places(word: np.uint64) -> int:
    """Return the sum of the numbers (0 to 63) of the set bits, added up by the binary digits of these numbers."""
    total: int = ones(word & np.uint64(0xAAAAAAAAAAAAAAAA))
    total += ones(word & np.uint64(0xCCCCCCCCCCCCCCCC)) << 1
    total += ones(word & np.uint64(0xF0F0F0F0F0F0F0F0)) << 2
    total += ones(word & np.uint64(0xFF00FF00FF00FF00)) << 3
    total += ones(word & np.uint64(0xFFFF0000FFFF0000)) << 4
    total += ones(word & np.uint64(0xFFFFFFFF00000000)) << 5
    return total
