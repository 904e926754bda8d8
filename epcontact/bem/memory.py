"""Estimate the memory of a solve before it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from epcontact.errors import NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.results import FloatArray


def estimated_memory(
    heights: FloatArray, spacing: Sequence[float], pressure: float, effective_modulus: float
) -> int:
    """Estimate the bytes that a solve needs beside the heights, from the arrays that it keeps.

    Every point takes about 42 bytes: pressure, displacement and modes (8 each), the compliance (2),
    the sets (1), the cheap operator and the preconditioner (6), and the gap with its areas.  An
    elastic point takes 88 more, those of a dense contact's transforms in single precision among
    them.  The share of elastic points is taken as erf(sqrt(pi) p/(E* xi)), which is 2 p/(E* xi) at
    light loads.  Ten scenes of 1024 to 2048 points a side, elastic and capped, from 1 % of contact
    to full contact, took from 16 % less to 24 % more than this.

    Args:
        heights: (nx, ny) or (nx,), in m.
        spacing: of the points in each direction, in m.
        pressure: p in Pa, the smaller of the mean pressure and the hardness less the mean
            pressure (near full plasticity gaps and plastic points change places).
        effective_modulus: E* in Pa.

    Example:
        >>> estimated_memory(np.zeros((8, 8)), (1.0, 1.0), 1.0, 1.0)  # flat: all elastic
        8320
    """
    slope = 0.0
    for axis, step in enumerate(spacing):
        sample = heights[: max(2, 65536 // heights.shape[-1])] if axis else heights
        rise = np.diff(sample[..., :64] if axis == 0 and heights.ndim > 1 else sample, axis=axis)
        slope += float(np.mean(rise**2)) / step**2
    return int(heights.size * bytes_per_point(pressure, effective_modulus * math.sqrt(slope)))


def bytes_per_point(pressure: float, stiffness: float) -> float:
    """Return the bytes of a point; see `estimated_memory`.

    Args:
        pressure: p in Pa.
        stiffness: E* xi in Pa; 0 where the rms slope is not known, as if all points were elastic.

    Example:
        >>> bytes_per_point(0.0, 1.0), bytes_per_point(1.0, 0.0)
        (42.0, 130.0)
    """
    share = math.erf(math.sqrt(math.pi) * pressure / stiffness) if stiffness > 0 else 1.0
    return 42 + 88 * share


def require_memory(needed: int, shape: tuple[int, ...]) -> None:
    """Raise NotEnoughMemory if this machine has less than `needed` bytes free."""
    available = available_memory()
    if needed > available:
        raise NotEnoughMemory(
            f"a grid of {' x '.join(map(str, shape))} needs about "
            f"{needed / 2**30:.1f} GiB beside its heights, but {available / 2**30:.1f} GiB are "
            "free; take a coarser grid or a larger machine"
        )
