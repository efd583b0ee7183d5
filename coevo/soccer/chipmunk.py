"""Chipmunk's own C functions, called from compiled code.

pymunk's extension module exports Chipmunk. Each function used here is looked up there once, registered with
LLVM under its own name, and declared with the C types it has, pointers as integers of pointer size. A kernel
then calls the very functions that pymunk's Python methods call, which is why both paths agree to the last bit.

Vectors passed by value are avoided, as their calling convention differs between platforms: bodies are read and
written through pymunk's batch functions, which move plain doubles through a buffer.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding
from numba import types
from pymunk import _chipmunk

__all__ = ["add_shape", "get_body", "remove_shape", "set_body", "set_shape_counter", "set_time_step", "step"]

_POINTER = types.uintp
_DOUBLE = types.float64


def _external(name: str, result: Any, *arguments: Any) -> types.ExternalFunction:
    address = int(_chipmunk.ffi.cast("uintptr_t", _chipmunk.ffi.addressof(_chipmunk.lib, name)))
    llvmlite.binding.add_symbol(name, address)  # calling a symbol that LLVM does not know is a segmentation fault
    return types.ExternalFunction(name, result(*arguments))


step = _external("cpSpaceStep", types.void, _POINTER, _DOUBLE)
add_shape = _external("cpSpaceAddShape", _POINTER, _POINTER, _POINTER)
remove_shape = _external("cpSpaceRemoveShape", types.void, _POINTER, _POINTER)
set_shape_counter = _external("cpSpaceSetShapeIDCounter", types.void, _POINTER, _POINTER)
set_time_step = _external("cpSpaceSetCurrentTimeStep", types.void, _POINTER, _DOUBLE)
get_body = _external("pmSpaceBodyGetIteratorFuncBatched", types.void, _POINTER, _POINTER)
set_body = _external("pmSpaceBodySetIteratorFuncBatched", types.void, _POINTER, _POINTER)
