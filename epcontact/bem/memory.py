"""Estimate the memory of a solve before it begins."""

from __future__ import annotations

import math

import numpy as np

from epcontact.errors import NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.materials.moduli import effective_modulus
from epcontact.scene import Load, Material, Surface


def bytes_per_point(pressure: float, hardness: float, stiffness: float) -> float:
    """The bytes of a grid point beside its heights, at a mean pressure and hardness in
    Pa.

    stiffness: E* xi in Pa; 0 if unknown, as if all points were elastic.  A point takes
    34 bytes, 42 if it can flow, an elastic one 64 more; 24 scenes took from 20 % less
    to 9 % more.  The share of elastic points is that of Persson's theory, erf(sqrt(pi)
    p/(E* xi)), and with a hardness the first term of its series, if less, but at least
    a tenth: more are elastic until sets settle.
    """
    each = 42.0 if math.isfinite(hardness) else 34.0
    if not stiffness > 0:
        return each + 64
    lightest = min(
        pressure, hardness - pressure
    )  # gaps and plastic points change places
    share = math.erf(math.sqrt(math.pi) * lightest / stiffness)
    if math.isfinite(hardness):
        decay = math.exp(-math.pi / 4 * (stiffness / hardness) ** 2)
        capped = 4 / math.pi * math.sin(math.pi * lightest / hardness) * decay
        share = min(share, max(capped, share / 10))
    return each + 64 * share


def require_memory(surface: Surface, load: Load, material: Material) -> None:
    """Raise NotEnoughMemory if this machine has less free than a solve is estimated to
    need.
    """
    heights, slope = surface.heights, 0.0
    for axis, step in enumerate(surface.spacing):  # of a part of the heights
        sample = heights[: max(2, 65536 // heights.shape[-1])] if axis else heights
        rise = np.diff(
            sample[..., :64] if axis == 0 and heights.ndim > 1 else sample, axis=axis
        )
        slope += float(np.mean(rise**2)) / step**2
    pressure = load.final or max(load.path)
    stiffness = effective_modulus(material) * math.sqrt(slope)
    needed = int(heights.size * bytes_per_point(pressure, material.hardness, stiffness))
    if needed > (available := available_memory()):
        raise NotEnoughMemory(
            f"a grid of {' x '.join(map(str, surface.shape))} needs about "
            f"{needed / 2**30:.1f} GiB beside its heights, but {available / 2**30:.1f} GiB are "
            "free; take a coarser grid or a larger machine"
        )
