"""The estimated memory of a block before it is made, and the peak memory of the process."""

from __future__ import annotations

import sys

import numpy as np
import psutil

from epcontact.errors import NotEnoughMemory
from fem_check.mesh import PeriodicBlock


def bytes_needed(block: PeriodicBlock, *, flow: float | None, certified: bool = False) -> float:
    """An estimate of a solve's memory, in bytes.

    It counts the arrays of elements and nodes at their peak.  An element keeps its connectivity and
    shape (36 bytes) and, if it may flow, its history (448).  In the moved geometry it keeps its own
    gradients (2900 with what scikit-fem needs to make them).  An element that flows keeps its
    tangent correction and matrix rows (2700).  A node keeps displacement fields (24 each), 7 of
    them where nothing may flow and 11 otherwise, and its half of the factor (15 numbers a wave).

    Args:
        block: the block.
        flow: the share of the elements that flow at once, from `flowing_share`; None: the material
            is elastic.
        certified: whether scikit-fem assembles the last state.  It takes 7000 bytes for each
            element of a single layer, after most of the fields have been given back.
    """
    nodes = float(np.prod(block.field_shape[:3]))
    moved = 2900 if block.moved is not None else 0
    kept = 36 + moved + (448 if flow is not None else 0) + 15 * 8 / 2
    solve = nodes * (kept + (7 * 24 if flow is None else 11 * 24 + 2700 * flow))
    certificate = nodes * (kept + 6 * 24) + block.shape[0] * block.shape[1] * 7000
    return max(solve, certificate) if certified else solve


def flowing_share(mean_pressure: float, yield_stress: float) -> float:
    """The share of a block's elements that is expected to flow at once.

    The share grows about in proportion to the load, by .2 to .4 times mean_pressure/yield_stress at
    E* xi/sigma_Y from 5 to 50 (tests/test_fem_memory.py).
    """
    return min(1.0, 0.27 * mean_pressure / yield_stress)


def require_memory(block: PeriodicBlock, *, flow: float | None, certified: bool) -> None:
    """Raise NotEnoughMemory, before any array is made, if the block will not fit."""
    needed = bytes_needed(block, flow=flow, certified=certified)
    free = psutil.virtual_memory().available
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
