"""Surface compliance of elastic bodies: the displacement that a pressure mode causes.

A pressure mode p_q exp(i q.x) on the top of a body displaces the surface downward by
u_q = C(|q|) p_q, in plane strain as well as in three dimensions.  With x = q d:

    half-space      C = 2/(E* q)
    bonded layer    C = 2/(E* q) [k sinh 2x - 2x] /
                        [k cosh 2x + 2x^2 + 5 - 12 nu + 8 nu^2],  k = 3 - 4 nu
                    (Carbone and Mangialardi, JMPS 56 (2008), equation A.30)
    sliding layer   C = 2/(E* q) [cosh 2x - 1] / [sinh 2x + 2x]

For q -> 0+ the bonded layer tends to d/M and the sliding one to d/E*; at exactly q = 0
no lateral strain is possible, so both have d/M, with M the oedometric modulus.  The
half-space's C is set to 0 at q = 0.  The hyperbolic functions are scaled by exp(-2x),
so that no depth overflows.
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
_MODES_AT_ONCE = 65536  # of `quarter_compliance`


def rfft_wavenumbers(shape: tuple[int, ...], periods: tuple[float, ...]) -> FloatArray:
    """Return |q| in rad/m of each mode of `numpy.fft.rfftn`, in the shape of the modes.

    shape, periods: points and length in m of each direction of a grid or a line.
    """
    last = np.arange(shape[-1] // 2 + 1) * np.float64(2 * np.pi / periods[-1])
    if len(shape) == 1:
        return np.asarray(last, dtype=np.float64)
    first = 2 * np.pi / periods[0] * np.abs(np.fft.fftfreq(shape[0], 1 / shape[0]))
    return np.asarray(np.hypot(first[:, None], last[None, :]), dtype=np.float64)


def surface_compliance(
    wavenumber: FloatArray, body: Body, material: Material
) -> FloatArray:
    """Return the compliance C(q) in m/Pa of a body at wave numbers.

    C(q) is the displacement of a pressure wave over its pressure.  At q = 0, a uniform
    pressure, it is 0 for a half-space, and depth over oedometric modulus for a layer.

    wavenumber: q in rad/m, of any shape.
    """
    q = np.asarray(wavenumber, dtype=np.float64)
    zero = q == 0
    positive = np.where(zero, 1.0, q)
    compliance = 2 / (effective_modulus(material) * positive)
    if body.kind == "half_space":
        compliance[zero] = 0.0
        return compliance
    x = np.minimum(positive * body.depth, _DEEP)
    if body.kind == "bonded_layer":
        compliance *= _bonded_factor(x, material.poisson_ratio)
    else:
        compliance *= _sliding_factor(x)
    compliance[zero] = body.depth / oedometric_modulus(material)
    return compliance


def _bonded_factor(x: FloatArray, nu: float) -> FloatArray:
    """Return the compliance of a bonded layer over that of the half-space.

    x: wave number q times depth d, of any shape; nu: Poisson's ratio.
    """
    k = 3 - 4 * nu
    decay = np.exp(-2 * x)
    numerator = k * (1 - decay * decay) / 2 - 2 * x * decay
    low = x < _SERIES_BELOW
    y = 2 * x[low]
    # k sinh y - y = (k - 1) y + k (y^3/6 + y^5/120 + ...)
    tail = y**3 * (1 / 6 + y**2 * (1 / 120 + y**2 * (1 / 5040 + y**2 / 362880)))
    numerator[low] = ((k - 1) * y + k * tail) * decay[low]
    rest = 2 * x**2 + 5 - 12 * nu + 8 * nu**2
    denominator = k * (1 + decay * decay) / 2 + decay * rest
    return np.asarray(numerator / denominator)


def _sliding_factor(x: FloatArray) -> FloatArray:
    """Return the compliance of a sliding layer over that of the half-space.

    x: wave number q times depth d, of any shape.
    """
    decay = np.exp(-2 * x)
    # expm1 gives cosh 2x - 1 without cancellation.
    numerator = np.expm1(-2 * x) ** 2 / 2
    return np.asarray(numerator / ((1 - decay * decay) / 2 + 2 * x * decay))


def quarter_compliance(
    shape: tuple[int, int], periods: tuple[float, float], body: Body, material: Material
) -> FloatArray:
    """Return the compliance C(q) in m/Pa on a quarter of the modes of a grid.

    The quarter holds the modes of non-negative wave numbers: (nx//2 + 1, ny//2 + 1).
    shape: (nx, ny) points; periods: length of the grid along x and y in m.  It is
    filled by a few rows at a time, so that no temporary array of the grid's size is
    made.
    """
    nx, ny = shape
    qx = 2 * np.pi / periods[0] * np.arange(nx // 2 + 1)
    qy = 2 * np.pi / periods[1] * np.arange(ny // 2 + 1)
    compliance = np.empty((qx.size, qy.size))
    rows = max(1, _MODES_AT_ONCE // qy.size)
    for start in range(0, qx.size, rows):
        block = np.hypot(qx[start : start + rows, None], qy[None, :])
        compliance[start : start + rows] = surface_compliance(block, body, material)
    return compliance
