"""The estimated memory of a block before it is made, and the peak memory of the process."""

from __future__ import annotations

import sys

import numpy as np
import psutil

from epcontact.errors import NotEnoughMemory
from epcontact.results import FloatArray
from fem_check.mesh import PeriodicBlock


def bytes_needed(
    block: PeriodicBlock, *, flow: FloatArray | None, certified: bool = False
) -> float:
    """An estimate of a solve's memory, in bytes.

    It counts the arrays that are alive in a linear solve, where memory peaks.  A node keeps its
    element's connectivity, shape and place in the history (44 bytes), half of the factor (15
    numbers a wave) and six displacement fields (24 each); ten more end a few levels below the flow.
    A layer keeps its stiffness (9 matrices).  An element that flows keeps its history and tangent
    correction (970), and its nodes, of which there are up to 1.6 times as many, the rows of the
    tangent (2250).  Without flow seven fields are alive.  In the moved geometry an element keeps
    its own gradients (2900 with what scikit-fem needs to make them), all fields reach the base, and
    no rows are made.

    Args:
        block: the block.
        flow: the share of each layer's elements that flow at once, from `flowing_shares`; None: the
            material is elastic.
        certified: whether scikit-fem assembles the last state.  It takes 7000 bytes, or
            10000 with flow, for each element of a single layer, after most of the fields have been
            given back.
    """
    surface, levels = block.shape[0] * block.shape[1], len(block.layers) + 1
    moved = block.moved is not None
    kept = levels * (44 + 15 * 8 / 2 + (2900 if moved else 0))
    solve = kept + levels * 7 * 24
    if flow is not None:
        history, upper = 970 * float(flow.sum()), min(levels, int((flow > 0).sum()) + 3)
        rows = 0.0 if moved else 2250 * float(np.minimum(1.0, 1.6 * flow).sum())
        fields = 24 * (6 * levels + 10 * (levels if moved else upper))
        solve = kept + fields + history + rows + 9 * 24 * 24 * 8 * len(block.layers) / surface
        kept += history
    certificate = kept + levels * 6 * 24 + (7000 if flow is None else 10000)
    return surface * (max(solve, certificate) if certified else solve)


def flowing_shares(
    block: PeriodicBlock, mean_pressure: float, yield_stress: float, severity: float
) -> FloatArray:
    """(layers,) the share of each layer's elements that is expected to flow at once.

    At the surface it is .6 times mean_pressure/yield_stress at a `severity` E* xi/sigma_Y of 5, and
    1.2 times at 50.  It falls to none at a depth that grows with the load, from .2 periods at a
    quarter of the yield stress to .4 at the whole of it, and with the spacing
    (tests/test_fem_memory.py).
    """
    load = mean_pressure / yield_stress
    at_top = min(1.0, 0.6 * min(max(severity / 5, 1.0), 10.0) ** 0.3 * load)
    longest = max(n * h for n, h in zip(block.shape, block.spacing, strict=True))
    middles = -(block.levels[1:] + block.levels[:-1]) / 2
    reach = (0.12 + 0.25 * load) * longest + 1.5 * max(block.spacing)
    shares: FloatArray = np.clip(at_top * (1 - (middles / reach) ** 1.5), 0.0, 1.0)
    return shares


def require_memory(block: PeriodicBlock, *, flow: FloatArray | None, certified: bool) -> None:
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
