"""Surface compliance of elastic bodies, mode by mode: the displacement that a pressure
causes.

A pressure mode p_q exp(i q.x) on the top of a body displaces the surface downward by
u_q = C(|q|) p_q, in plane strain as well as in three dimensions.  With x = q d:

    half-space      C = 2/(E* q)
    bonded layer    C = 2/(E* q) [k sinh 2x - 2x] / [k cosh 2x + 2x^2 + 5 - 12 nu + 8 nu^2],
                    k = 3 - 4 nu                (Carbone and Mangialardi, JMPS 56 (2008), A.30)
    sliding layer   C = 2/(E* q) [cosh 2x - 1] / [sinh 2x + 2x]

For q -> 0+ the bonded layer tends to d/M and the sliding one to d/E*; at exactly q = 0
no lateral strain is possible, so both have d/M.  The half-space's C is set to 0 at q =
0. The hyperbolic functions are scaled by exp(-2x), so that no depth overflows.
"""

from __future__ import annotations

import numpy as np

from epcontact.materials.moduli import effective_modulus, oedometric_modulus
from epcontact.results import FloatArray
from epcontact.scene import Body, Material

# Below this q d the numerator k sinh 2x - 2x is summed as a series: the closed form
# would lose more than ten digits for nu -> 1/2.
_SERIES_BELOW = 0.1
# Beyond this q d a layer's compliance is the half-space's to the last digit.
_DEEP = 300.0


def rfft_wavenumbers(shape: tuple[int, ...], periods: tuple[float, ...]) -> FloatArray:
    """|q| in rad/m of each mode of `numpy.fft.rfftn` on a grid or line, with its
    periods in m.
    """
    last = np.asarray(
        2 * np.pi / periods[-1] * np.arange(shape[-1] // 2 + 1), dtype=np.float64
    )
    if len(shape) == 1:
        return last
    first = 2 * np.pi / periods[0] * np.abs(np.fft.fftfreq(shape[0], 1 / shape[0]))
    return np.asarray(np.hypot(first[:, None], last[None, :]), dtype=np.float64)


def _bonded_factor(x: FloatArray, nu: float) -> FloatArray:
    k = 3 - 4 * nu
    e = np.exp(-2 * x)
    top = k * (1 - e * e) / 2 - 2 * x * e
    low = x < _SERIES_BELOW
    y = 2 * x[low]
    # k sinh y - y = (k - 1) y + k (y^3/6 + y^5/120 + ...)
    tail = y**3 * (1 / 6 + y**2 * (1 / 120 + y**2 * (1 / 5040 + y**2 / 362880)))
    top[low] = ((k - 1) * y + k * tail) * e[low]
    bottom = k * (1 + e * e) / 2 + e * (2 * x**2 + 5 - 12 * nu + 8 * nu**2)
    return np.asarray(top / bottom)


def surface_compliance(
    wavenumber: FloatArray, body: Body, material: Material
) -> FloatArray:
    """C(q) in m/Pa at wave numbers q in rad/m, of any shape."""
    q = np.asarray(wavenumber, dtype=np.float64)
    zero = q == 0
    safe = np.where(zero, 1.0, q)
    compliance = 2 / (effective_modulus(material) * safe)
    if not (endless := body.kind == "half_space"):
        x = np.minimum(safe * body.depth, _DEEP)
        if body.kind == "bonded_layer":
            compliance *= _bonded_factor(x, material.poisson_ratio)
        else:  # cosh 2x - 1 without cancellation, by sinh 2x + 2x, both times exp(-2x)
            e = np.exp(-2 * x)
            compliance *= np.expm1(-2 * x) ** 2 / 2 / ((1 - e * e) / 2 + 2 * x * e)
    compliance[zero] = 0.0 if endless else body.depth / oedometric_modulus(material)
    return compliance


def quarter_compliance(
    shape: tuple[int, int], periods: tuple[float, float], body: Body, material: Material
) -> FloatArray:
    """C(q) on the non-negative quarter of the modes, (nx//2 + 1, ny//2 + 1), in m/Pa.
    The grid is filled by a few rows, so that no temporary of the grid's size is made.
    """
    nx, ny = shape
    qx = 2 * np.pi / periods[0] * np.arange(nx // 2 + 1)
    qy = 2 * np.pi / periods[1] * np.arange(ny // 2 + 1)
    out = np.empty((qx.size, qy.size))
    rows = max(1, 65536 // qy.size)
    for start in range(0, qx.size, rows):
        block = np.hypot(qx[start : start + rows, None], qy[None, :])
        out[start : start + rows] = surface_compliance(block, body, material)
    return out
