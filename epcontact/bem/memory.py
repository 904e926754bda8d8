"""Estimate the memory of a solve before it begins."""

from __future__ import annotations

import math

import numpy as np

from epcontact.errors import NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.materials.moduli import effective_modulus
from epcontact.scene import Load, Material, Surface

# Bytes of a point of an elastic and of a plastic material, and those that a point adds
# while it is in elastic contact; 24 scenes took from 20 % less to 9 % more.
_ELASTIC_MATERIAL = 34.0
_PLASTIC_MATERIAL = 42.0
_IN_ELASTIC_CONTACT = 64.0
# Points of the part of the heights from which the slope is estimated, and its columns.
_SAMPLE_POINTS = 65536
_SAMPLE_COLUMNS = 64


def bytes_per_point(pressure: float, hardness: float, stiffness: float) -> float:
    """Return the bytes that a solve takes for a grid point, without its heights.

    The fraction of points in elastic contact is that of Persson's theory, erf(sqrt(pi)
    p/(E* xi)), and with a hardness the first term of its series, if this is less.  At
    least a tenth of the former is assumed, because more points are elastic until the
    sets settle.

    Args:
        pressure: mean pressure in Pa.
        hardness: in Pa, may be infinite.
        stiffness: E* times the rms slope, in Pa; 0 if unknown, as if all points were
            elastic.
    """
    finite = math.isfinite(hardness)
    every_point = _PLASTIC_MATERIAL if finite else _ELASTIC_MATERIAL
    if not stiffness > 0:
        return every_point + _IN_ELASTIC_CONTACT
    # Near a load that is at the hardness everywhere, gaps and plastic points change
    # places.
    lighter = min(pressure, hardness - pressure)
    elastic = math.erf(math.sqrt(math.pi) * lighter / stiffness)
    if finite:
        decay = math.exp(-math.pi / 4 * (stiffness / hardness) ** 2)
        capped = 4 / math.pi * math.sin(math.pi * lighter / hardness) * decay
        elastic = min(elastic, max(capped, elastic / 10))
    return every_point + _IN_ELASTIC_CONTACT * elastic


def require_memory(surface: Surface, load: Load, material: Material) -> None:
    """Raise NotEnoughMemory if a solve is estimated to need more memory than is free.

    surface, load, material: of the scene to be solved.
    """
    pressure = load.final or max(load.path)
    stiffness = effective_modulus(material) * _sampled_slope(surface)
    heights = surface.heights
    needed = int(heights.size * bytes_per_point(pressure, material.hardness, stiffness))
    available = available_memory()
    if needed > available:
        shape = " x ".join(map(str, surface.shape))
        raise NotEnoughMemory(
            f"a grid of {shape} needs about {needed / 2**30:.1f} GiB beside its "
            f"heights, but {available / 2**30:.1f} GiB are free; take a coarser grid "
            "or a larger machine"
        )


def _sampled_slope(surface: Surface) -> float:
    """Return the rms slope (m/m) of a small part of the heights.

    On a large grid the part is some rows and some columns of the surface, so that the
    estimate takes little time.
    """
    heights = surface.heights
    if heights.ndim == 1:
        rises = [np.diff(heights)]
    else:
        rows = max(2, _SAMPLE_POINTS // heights.shape[-1])
        rises = [
            np.diff(heights[:, :_SAMPLE_COLUMNS], axis=0),
            np.diff(heights[:rows], axis=1),
        ]
    squares = 0.0
    for rise, step in zip(rises, surface.spacing, strict=True):
        squares += float(np.mean(rise**2)) / step**2
    return math.sqrt(squares)
