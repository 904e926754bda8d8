"""The memory of a solve, estimated before anything is made."""

from __future__ import annotations

import numpy as np

from epcontact.errors import NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.results import FloatArray
from epcontact.scene import Scene
from fem_check.mesh import PeriodicBlock
from fem_check.options import FemOptions


def bytes_needed(
    scene: Scene, options: FemOptions, block: PeriodicBlock, rms_slope: float | None = None
) -> float:
    """An estimate of the memory of a solve, in bytes; `rms_slope` replaces that of the surface.

    It counts the arrays that are alive in a linear solve, where memory peaks.  A node keeps its
    element's connectivity, shape and place in the history (44 bytes), half of the factor (15
    numbers a wave) and six displacement fields (24 each); ten more end a few levels below the flow.
    A layer keeps its stiffness (9 matrices).  An element that flows keeps its history and tangent
    correction (970), and its nodes, of which there are up to 1.6 times as many, the rows of the
    tangent (2250).  Without flow seven fields are alive.  In the moved geometry an element keeps
    its own gradients (2900 with what scikit-fem needs to make them), all fields reach the base, and
    no rows are made.  The certificate takes 7000 bytes, or 10000 with flow, for each element of a
    single layer, after most of the fields have been given back.
    """
    surface, levels = block.shape[0] * block.shape[1], len(block.layers) + 1
    moved, flows = block.moved is not None, options.law == "j2"
    kept = levels * (44 + 15 * 8 / 2 + (2900 if moved else 0))
    solve = kept + levels * 7 * 24
    if flows:
        material = scene.material
        stiff = material.young_modulus / (1 - material.poisson_ratio**2)
        slope = scene.surface.rms_slope if rms_slope is None else rms_slope
        limit = material.yield_stress
        flow = flowing_shares(block, max(scene.load.path), limit, stiff * slope / limit)
        history, upper = 970 * float(flow.sum()), min(levels, int((flow > 0).sum()) + 3)
        rows = 0.0 if moved else 2250 * float(np.minimum(1.0, 1.6 * flow).sum())
        fields = 24 * (6 * levels + 10 * (levels if moved else upper))
        solve = kept + fields + history + rows + 9 * 24 * 24 * 8 * len(block.layers) / surface
        kept += history
    certificate = kept + levels * 6 * 24 + (10000 if flows else 7000)
    return surface * (max(solve, certificate) if options.certified else solve)


def flowing_shares(
    block: PeriodicBlock, mean_pressure: float, yield_stress: float, severity: float
) -> FloatArray:
    """(layers,) the share of each layer's elements that is expected to flow at once.

    At the surface it is .6 times mean_pressure/yield_stress at a `severity` E* xi/sigma_Y of 5, and
    1.2 times at 50.  It falls to none at a depth that grows with the load, from .2 periods at a
    quarter of the yield stress to .4 at the whole of it, and with the spacing
    (tests/test_fem_solve.py).
    """
    load = mean_pressure / yield_stress
    at_top = min(1.0, 0.6 * min(max(severity / 5, 1.0), 10.0) ** 0.3 * load)
    longest = max(n * h for n, h in zip(block.shape, block.spacing, strict=True))
    middles = -(block.levels[1:] + block.levels[:-1]) / 2
    reach = (0.12 + 0.25 * load) * longest + 1.5 * max(block.spacing)
    shares: FloatArray = np.clip(at_top * (1 - (middles / reach) ** 1.5), 0.0, 1.0)
    return shares


def require_memory(scene: Scene, options: FemOptions, block: PeriodicBlock) -> None:
    """Raise NotEnoughMemory, before any array is made, if the block will not fit."""
    needed, free = bytes_needed(scene, options, block), available_memory()
    if needed > free:
        nx, ny = block.shape
        raise NotEnoughMemory(
            f"the block of {nx} x {ny} x {len(block.layers)} elements needs about "
            f"{needed / 2**30:.1f} GiB, but {free / 2**30:.1f} GiB are free; give fewer grid "
            "points or layers"
        )
