"""An elastic layer on a rigid base: its surface compliance mode by mode, and uniaxial strain.

The compliance is not taken from a closed form but solved for, mode by mode, from the plane
strain boundary-value problem, so that a closed form elsewhere can be held against it.

Derivation.  With depth z downward, Airy's function phi = f(z) cos(q x) and
    f = (A + B q z) e^(-q z) + (C + D q (d - z)) e^(-q (d - z))
gives sigma_zz = -q^2 f cos, sigma_xz = q f' sin, sigma_xx = f'' cos, and with
k = nu/(1 - nu), s = 1/E* = (1 - nu^2)/E, m = 2 (1 + nu)/E the displacements
    u_x = (s/q) [f'' + k q^2 f] sin,    u_z = {(s/q^2) [f''' + k q^2 f'] - m f'} cos.
The load sigma_zz = -p cos at z = 0 without shear is f = p/q^2, f' = 0; the base is bonded,
u_x = u_z = 0, or slides without friction, f' = u_z = 0.  Both exponentials decay into the
layer, so that the 4 x 4 system stays well conditioned however deep the layer is.  The same
compliance serves a two-dimensional surface with q = |q| (rotate x into the wave vector).

Symbols: q = wavenumber (rad/m), d = depth (m), E = young_modulus (Pa), nu = poisson_ratio.
"""

from __future__ import annotations

import numpy as np

from epcontact.results import FloatArray


def surface_compliance(
    wavenumber: FloatArray,
    depth: float,
    young_modulus: float,
    poisson_ratio: float,
    *,
    bonded: bool = True,
) -> FloatArray:
    """Surface displacement per pressure, u_q/p_q in m/Pa, at each wavenumber q > 0.

    wavenumber: any shape; the result has the same.  bonded: to the base, or sliding on it.
    At q = 0 use `lame_compliance`.  Validity: relative accuracy falls as 1e-16/(q d)^3 for a
    thin layer, where the two exponentials become alike; 1e-10 at q d = 0.01.
    """
    q = np.atleast_1d(np.asarray(wavenumber, dtype=np.float64))
    x = (q * depth).ravel()
    value_0, value_d = _basis(np.zeros_like(x), x), _basis(x, x)
    k = poisson_ratio / (1 - poisson_ratio)
    shear = 2 / (1 - poisson_ratio)  # m / s

    def along(v: FloatArray) -> FloatArray:  # u_x without sin, in units of s q p / q^2
        return np.asarray(v[2] + k * v[0])

    def normal(v: FloatArray) -> FloatArray:  # u_z without cos, in the same units
        return np.asarray(v[3] + (k - shear) * v[1])

    base = along(value_d) if bonded else value_d[1]
    system = np.stack([value_0[0], value_0[1], base, normal(value_d)], axis=-2)
    load = np.zeros((x.size, 4, 1))
    load[:, 0] = 1
    coefficients = np.linalg.solve(system, load)[..., 0]
    shape = np.sum(normal(value_0) * coefficients, axis=-1)
    s = (1 - poisson_ratio**2) / young_modulus
    return np.asarray((s * shape / q.ravel()).reshape(np.shape(wavenumber)))


def _basis(x: FloatArray, depth: FloatArray) -> FloatArray:
    """Derivatives 0 to 3 (in units of q) of the four functions of f at q z = x: (4, n, 4)."""
    y = depth - x
    down, up = np.exp(-x), np.exp(-y)
    rows = []
    for n in range(4):
        sign = (-1.0) ** n
        rows.append(
            np.stack([sign * down, sign * (x - n) * down, up, (y - n) * up], axis=-1),
        )
    return np.stack(rows)


def lame_compliance(depth: float, young_modulus: float, poisson_ratio: float) -> float:
    """d/M in m/Pa, M = E (1 - nu)/((1 + nu)(1 - 2 nu)): uniaxial strain (Lame), mode q = 0."""
    nu = poisson_ratio
    return depth * (1 + nu) * (1 - 2 * nu) / (young_modulus * (1 - nu))


def uniaxial_yield_pressure(yield_stress: float, poisson_ratio: float) -> float:
    """Pressure in Pa at which a layer in uniaxial strain yields: Y (1 - nu)/(1 - 2 nu).

    By von Mises and Tresca alike, as two principal stresses are equal.  Beyond it the tangent
    is the bulk modulus: there is no limit load.
    """
    return yield_stress * (1 - poisson_ratio) / (1 - 2 * poisson_ratio)
