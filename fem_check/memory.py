"""The estimated memory of a block before it is made, and the peak memory of the process."""

from __future__ import annotations

import sys

import numpy as np
import psutil

from epcontact.errors import NotEnoughMemory
from fem_check.mesh import PeriodicBlock


def bytes_needed(block: PeriodicBlock, *, plastic: bool) -> float:
    """An estimate of a solve's memory, in bytes, from the arrays kept for elements and nodes.

    An element keeps its connectivity and shape (36 bytes) and the history (448).  One element in
    ten is assumed to flow; it keeps its tangent correction and matrix rows (2700).  In the moved
    geometry an element keeps its own gradients (1800, and as much again while scikit-fem makes
    them).  A node keeps about sixteen displacement fields (24 each) and its half of the factor (15
    numbers a wave).
    """
    nodes = float(np.prod(block.field_shape[:3]))
    element = 36 + (448 + 270 if plastic else 0) + (3600 if block.moved is not None else 0)
    return nodes * (element + 16 * 24 + 15 * 8 / 2)


def require_memory(block: PeriodicBlock, *, plastic: bool) -> None:
    """Raise NotEnoughMemory, before any array is made, if the block will not fit."""
    needed, free = bytes_needed(block, plastic=plastic), psutil.virtual_memory().available
    if needed > free:
        nx, ny = block.shape
        raise NotEnoughMemory(
            f"the block of {nx} x {ny} x {len(block.layers)} elements needs about "
            f"{needed / 2**30:.1f} GiB, but {free / 2**30:.1f} GiB are free; give fewer grid "
            "points or layers"
        )


def peak_memory() -> float:
    """The largest resident memory of this process so far, in bytes."""
    if sys.platform == "win32":
        return float(psutil.Process().memory_info().peak_wset)
    import resource  # not available on Windows

    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return peak if sys.platform == "darwin" else 1024 * peak
