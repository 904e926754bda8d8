"""Analytic self-affine spectra: densities and moments in closed form.

With f(q) = 1 from q_0 to q_r and (q/q_r)^(-s) from there to q_1 (s = 2 + 2H on a
surface, 1 + 2H on a line), the density is C = C_0 f, and C_0 follows from the rms slope
xi.  The moments are

    surface   m_j = 2 pi int q^(j+1) C dq        line   m_j = int q^j C1 dq

with m_0 = h_rms^2 and m_2 = xi^2.  Both pieces of each integrand are powers of
q.  The integral of a power, int_a^b q^(n-1) dq = a^n L exprel(n L) with L = ln(b/a) and
exprel(t) = (e^t - 1)/t, has no cancellation at any exponent, n = 0 included.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import exprel

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum

#: Relative distance from a limit of a band within which a wave number counts as inside.
#: Without it a period of seven digits would lose the modes at the limits.
BAND_TOLERANCE = 1e-6


def amplitude_shape(
    spectrum: SelfAffineSpectrum, wavenumber: ArrayLike, dimension: int
) -> FloatArray:
    """Return sqrt(f(q)): the amplitudes without their common factor, of the shape of q.

    Args:
        spectrum: its band, roll-off and Hurst exponent count.
        wavenumber: q in rad/m, of any shape; outside the band the result is 0.
        dimension: 1 for a line, 2 for a surface.
    """
    q = np.asarray(wavenumber, dtype=np.float64)
    relative = np.maximum(q / spectrum.wavenumber_roll_off, 1.0)
    shape = relative ** -(spectrum.hurst + dimension / 2)
    below = q < spectrum.wavenumber_low * (1 - BAND_TOLERANCE)
    above = q > spectrum.wavenumber_high * (1 + BAND_TOLERANCE)
    return np.where(below | above, 0.0, shape)


def density(
    spectrum: SelfAffineSpectrum, wavenumber: ArrayLike, dimension: int = 2
) -> FloatArray:
    """Return the power spectral density C(q) of a surface, or C1(q) of a line.

    C is in m^4 and the one-sided C1 in m^3.

    Args:
        spectrum: the spectrum.
        wavenumber: q in rad/m, of any shape.
        dimension: 1 for a line, 2 for a surface.

    Raises:
        InvalidScene: The band has no width, or the dimension is another.
    """
    factor = spectrum.rms_slope**2 / _shape_moment(spectrum, 2, dimension)
    return factor * amplitude_shape(spectrum, wavenumber, dimension) ** 2


def spectral_moment(
    spectrum: SelfAffineSpectrum,
    order: float,
    dimension: int = 2,
    wavenumber: ArrayLike = math.inf,
) -> FloatArray:
    """Return the moment m_order of the spectrum, in m^(2 - order).

    Args:
        spectrum: the spectrum.
        order: any real number.
        dimension: 1 for a line, 2 for a surface.
        wavenumber: the moment is taken up to this q in rad/m, of any shape.

    Raises:
        InvalidScene: The band has no width, or the dimension is another.
    """
    factor = spectrum.rms_slope**2 / _shape_moment(spectrum, 2, dimension)
    return factor * _shape_moment(spectrum, order, dimension, wavenumber)


def slope_variance_up_to(
    spectrum: SelfAffineSpectrum, wavenumber: ArrayLike, dimension: int = 2
) -> FloatArray:
    """Return xi^2(q), the slope variance of all roughness up to a wave number.

    It is in m^2/m^2, and 0 below the band; see `spectral_moment` for arguments and
    errors.
    """
    return spectral_moment(spectrum, 2, dimension, wavenumber)


def _shape_moment(
    spectrum: SelfAffineSpectrum,
    order: float,
    dimension: int,
    wavenumber: ArrayLike = math.inf,
) -> FloatArray:
    """Return the moment of f(q), which is that of C for C_0 = 1."""
    if dimension not in (1, 2):
        raise InvalidScene(
            f"dimension is {dimension!r}, but must be 1 (a line) or 2 (a surface)"
        )
    q0 = spectrum.wavenumber_low
    qr = spectrum.wavenumber_roll_off
    q1 = spectrum.wavenumber_high
    hurst = spectrum.hurst
    if q1 <= q0:
        raise InvalidScene(
            f"wavenumber_low and wavenumber_high are both {q1:g} rad/m, but a density "
            "needs a band of some width"
        )
    q = np.clip(np.asarray(wavenumber, dtype=np.float64), q0, q1)
    flat = _power_integral(order + dimension, q0, np.minimum(q, qr))
    # q^(j + d - 1) (q/q_r)^(-(2H + d)) = q_r^(2H + d) q^(n - 1) with n = j - 2H
    fractal = _power_integral(order - 2 * hurst, qr, np.maximum(q, qr))
    weight = 2 * math.pi if dimension == 2 else 1.0
    return np.asarray(weight * (flat + qr ** (2 * hurst + dimension) * fractal))


def _power_integral(n: float, a: float, b: FloatArray) -> FloatArray:
    """Return int_a^b q^(n-1) dq, for any n and b >= a > 0."""
    log_ratio = np.log1p((b - a) / a)
    return np.asarray(a**n * log_ratio * exprel(n * log_ratio))


def truncate(
    spectrum: SelfAffineSpectrum, wavenumber_high: float, dimension: int = 2
) -> SelfAffineSpectrum:
    """Return the part of a spectrum below a wave number, with its own rms slope.

    Args:
        spectrum: the spectrum.
        wavenumber_high: the wave number of the cut in rad/m; beyond the band it changes
            nothing.
        dimension: 1 for a line, 2 for a surface.

    Raises:
        InvalidScene: Nothing of the band is left.
    """
    high = min(wavenumber_high, spectrum.wavenumber_high)
    if not high > spectrum.wavenumber_low:
        raise InvalidScene(
            f"a cut-off at {wavenumber_high:g} rad/m leaves nothing of a spectrum that "
            f"begins at {spectrum.wavenumber_low:g} rad/m"
        )
    return replace(
        spectrum,
        wavenumber_roll_off=min(spectrum.wavenumber_roll_off, high),
        wavenumber_high=high,
        rms_slope=math.sqrt(slope_variance_up_to(spectrum, high, dimension)),
    )
