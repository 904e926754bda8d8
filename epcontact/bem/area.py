"""Contact areas in the limit of a vanishing grid spacing, from one solution on a grid.

Counting grid points overestimates a contact by its rim: the points at which contact is asked for
stand in for the gaps between them.  `perimeter_areas` is the published remedy, Yastrebov,
Anciaux and Molinari, Tribology International 114 (2017) 161:

    A = A_raw - (pi - 1 + ln 2)/24 S dx,

S the length of the rim, counted by the switches along rows and columns.  Particle-hole symmetry
(p -> hardness - p, g -> -g) carries it over to the front between elastic and plastic contact
with the other sign.  On a line each front is off by 0.19 dx.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from epcontact.results import Areas

FloatArray = NDArray[np.float64]

#: Yastrebov, Anciaux and Molinari (2017): of a grid cell's area, for each switch.
PERIMETER_FACTOR = (math.pi - 1 + math.log(2)) / 24
#: Offset of a front on a line in grid spacings: 1/4 - (1/2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
LINE_OFFSET = 0.189965421265238


@numba.njit(cache=True, nogil=True)
def _count(pressure: FloatArray, hardness: float) -> tuple[int, int, int, int]:
    """Points in contact and at the hardness, and switches of either along rows and columns."""
    nx, ny = pressure.shape
    contact = plastic = contact_switches = plastic_switches = 0
    for i in range(nx):
        for j in range(ny):
            p = pressure[i, j]
            touching, flowing = p > 0, p >= hardness
            contact += touching
            plastic += flowing
            if ny > 1:
                q = pressure[i, j - 1]
                contact_switches += touching != (q > 0)
                plastic_switches += flowing != (q >= hardness)
            q = pressure[i - 1, j]
            contact_switches += touching != (q > 0)
            plastic_switches += flowing != (q >= hardness)
    return contact, plastic, contact_switches, plastic_switches


def perimeter_areas(pressure: FloatArray, hardness: float = math.inf) -> tuple[Areas, Areas]:
    """(raw, corrected) areas by the published perimeter correction.

    pressure: (nx, ny) or (nx,), in Pa, zero where apart and `hardness` (Pa) where plastic.
    """
    grid = pressure.reshape(pressure.shape[0], -1)
    contact, plastic, contact_switches, plastic_switches = _count(grid, hardness)
    factor = LINE_OFFSET if pressure.ndim == 1 else PERIMETER_FACTOR
    corrected_contact = contact - factor * contact_switches
    corrected_plastic = plastic + factor * plastic_switches
    raw = (contact / grid.size, plastic / grid.size)
    corrected = (corrected_contact / grid.size, corrected_plastic / grid.size)
    return _areas(*raw), _areas(*corrected)


def _areas(total: float, plastic: float) -> Areas:
    return Areas(total=total, elastic=total - plastic, plastic=plastic)


def estimate_areas(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: tuple[float, ...],
    effective_modulus: float,
) -> tuple[Areas, Areas, Areas]:
    """(raw, corrected, error): areas as fractions of the nominal area, error absolute.

    pressure, gap: (nx, ny) or (nx,), in Pa and m; spacing: in m; hardness: Pa, may be infinite.
    """
    del gap, spacing, effective_modulus
    raw, corrected = perimeter_areas(pressure, hardness)
    # The published correction overshoots by up to a quarter of itself.
    total = abs(corrected.total - raw.total) / 4
    plastic = abs(corrected.plastic - raw.plastic) / 4
    error = Areas(total=total, elastic=math.hypot(total, plastic), plastic=plastic)
    return raw, corrected, error
