"""What a solve takes of the machine's memory, estimated before and measured after."""

from __future__ import annotations

import math

import numpy as np

from epcontact.errors import NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.moduli import effective_modulus
from epcontact.scene import Scene


def estimated_memory(scene: Scene) -> int:
    """Bytes a solve needs beside the heights, by the arrays it keeps.

    Per point: pressure, displacement and modes (8 each), the compliance (2), the sets (1), the
    cheap operator and the preconditioner (6), and two arrays of a gradient step (16), in whose
    place the gap and its areas come afterwards; and 68 for each elastic point, of which rough
    contact has about 2 p0/(E* xi), 3 to be safe: near full plasticity, where gaps and plastic
    points change places, with hardness - p0 for p0.
    """
    heights = scene.surface.heights
    slope = 0.0
    for axis, spacing in enumerate(scene.surface.spacing):
        sample = heights[: max(2, 65536 // heights.shape[-1])] if axis else heights
        step = np.diff(sample[..., :64] if axis == 0 and heights.ndim > 1 else sample, axis=axis)
        slope += float(np.mean(step**2)) / spacing**2
    stiffness = effective_modulus(scene.material) * math.sqrt(slope)
    load = min(scene.load.final, scene.material.hardness - scene.load.final)
    elastic = min(1.0, 3 * load / stiffness) if stiffness > 0 else 1.0
    return int(heights.size * (49 + 68 * elastic))


def require_memory(scene: Scene) -> None:
    """Raises NotEnoughMemory if a solve of the scene is estimated not to fit."""
    needed, available = estimated_memory(scene), available_memory()
    if needed > available:
        raise NotEnoughMemory(
            f"a grid of {' x '.join(map(str, scene.surface.shape))} needs about "
            f"{needed / 2**30:.1f} GiB beside its heights, but {available / 2**30:.1f} GiB are "
            "free; take a coarser grid or a larger machine"
        )
