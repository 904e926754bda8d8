"""Estimate the memory of a solve before it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from epcontact.errors import NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.results import FloatArray


def estimated_memory(
    heights: FloatArray,
    spacing: Sequence[float],
    pressure: float,
    hardness: float,
    effective_modulus: float,
) -> int:
    """Estimate the bytes that a solve needs beside the heights, from the arrays that it keeps.

    Every point takes about 34 bytes: pressure, displacement and modes (8 each), the compliance (2),
    the sets (1), the cheap operator (2), and what coarser grids leave; afterwards the gap and the
    plastic displacement (8 each) are in the place of the latter and the modes.  An elastic point
    takes 64 more, those of a dense contact's transforms in single precision among them.  Thirteen
    scenes of 1280 to 2048 points a side, elastic and capped, from 1 % of contact to full contact,
    took from 9 % less to 9 % more than this.

    Args:
        heights: (nx, ny) or (nx,), in m.
        spacing: of the points in each direction, in m.
        pressure: the mean pressure p in Pa.
        hardness: in Pa, may be infinite.
        effective_modulus: E* in Pa.

    Example:
        >>> flat = np.zeros((8, 8))  # all elastic
        >>> estimated_memory(flat, (1.0, 1.0), 1.0, math.inf, effective_modulus=1.0)
        6272
    """
    slope = 0.0
    for axis, step in enumerate(spacing):
        sample = heights[: max(2, 65536 // heights.shape[-1])] if axis else heights
        rise = np.diff(sample[..., :64] if axis == 0 and heights.ndim > 1 else sample, axis=axis)
        slope += float(np.mean(rise**2)) / step**2
    return int(
        heights.size * bytes_per_point(pressure, hardness, effective_modulus * math.sqrt(slope))
    )


def bytes_per_point(pressure: float, hardness: float, stiffness: float) -> float:
    """Return the bytes of a point; see `estimated_memory`.

    The share of elastic points is that of Persson's theory, erf(sqrt(pi) p/(E* xi)), and with a
    hardness H the first term of its series, 4/pi sin(pi p/H) exp(-pi/4 (E* xi/H)^2), if it is less,
    but at least a tenth: more points than in the end are elastic while the sets settle.

    Args:
        pressure, hardness: p and H in Pa.
        stiffness: E* xi in Pa; 0 where the rms slope is not known, as if all points were elastic.

    Example:
        >>> bytes_per_point(0.0, math.inf, 1.0), bytes_per_point(1.0, math.inf, 0.0)
        (34.0, 98.0)
    """
    if not stiffness > 0:
        return 98.0
    lightest = min(pressure, hardness - pressure)  # gaps and plastic points change places
    share = math.erf(math.sqrt(math.pi) * lightest / stiffness)
    if math.isfinite(hardness):
        decay = math.exp(-math.pi / 4 * (stiffness / hardness) ** 2)
        capped = 4 / math.pi * math.sin(math.pi * lightest / hardness) * decay
        share = min(share, max(capped, share / 10))
    return 34 + 64 * share


def require_memory(needed: int, shape: tuple[int, ...]) -> None:
    """Raise NotEnoughMemory if this machine has less than `needed` bytes free."""
    available = available_memory()
    if needed > available:
        raise NotEnoughMemory(
            f"a grid of {' x '.join(map(str, shape))} needs about "
            f"{needed / 2**30:.1f} GiB beside its heights, but {available / 2**30:.1f} GiB are "
            "free; take a coarser grid or a larger machine"
        )
