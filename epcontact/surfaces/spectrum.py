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
    """Return the dimensionless amplitudes of the waves of a self-affine spectrum.

    The amplitude is sqrt(f(q)), where f is the power spectral density over its value in
    the roll-off: 1 up to q_r, (q/q_r)^(-(2 H + dimension)) above, and 0 outside the
    band.

    Args:
        spectrum: its band, roll-off q_r and Hurst exponent H are used.
        wavenumber: q in rad/m, of any shape.
        dimension: 1 for a line, 2 for a surface.

    Returns:
        An array of the shape of `wavenumber`.
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

    C is in m^4, with the variance of the heights 2 pi int q C dq; the one-sided C1 is
    in m^3, with the variance int C1 dq.

    Args:
        spectrum: the spectrum.
        wavenumber: q in rad/m, of any shape, which the result has, too.
        dimension: 1 for a line, 2 for a surface.

    Raises:
        InvalidScene: The band has no width, or the dimension is neither 1 nor 2.
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

    The moment of order j is the integral of q^j times the power spectral density over
    all waves; m_0 is the variance of the heights and m_2 that of the slope.

    Args:
        spectrum: the spectrum.
        order: any real number.
        dimension: 1 for a line, 2 for a surface.
        wavenumber: the waves up to this q (rad/m) count; of any shape, which the result
            has, too.

    Raises:
        InvalidScene: The band has no width, or the dimension is neither 1 nor 2.
    """
    factor = spectrum.rms_slope**2 / _shape_moment(spectrum, 2, dimension)
    return factor * _shape_moment(spectrum, order, dimension, wavenumber)


def slope_variance_up_to(
    spectrum: SelfAffineSpectrum, wavenumber: ArrayLike, dimension: int = 2
) -> FloatArray:
    """Return xi^2(q), the variance of the slope of all roughness up to a wave number.

    Args:
        spectrum: the spectrum.
        wavenumber: q in rad/m, of any shape.
        dimension: 1 for a line, 2 for a surface.

    Returns:
        The dimensionless variance, of the shape of `wavenumber`; 0 below the band.

    Raises:
        InvalidScene: The band has no width, or the dimension is neither 1 nor 2.
    """
    return spectral_moment(spectrum, 2, dimension, wavenumber)


def _shape_moment(
    spectrum: SelfAffineSpectrum,
    order: float,
    dimension: int,
    wavenumber: ArrayLike = math.inf,
) -> FloatArray:
    """Return the moment of f(q), the spectral density over its value in the roll-off.

    Args:
        spectrum: its band, roll-off and Hurst exponent are used.
        order: the order j of the moment, the integral of q^j f over all waves.
        dimension: 1 for a line, 2 for a surface.
        wavenumber: the waves up to this q (rad/m) count; of any shape.

    Returns:
        The moment in (rad/m)^(order + dimension), of the shape of `wavenumber`.

    Raises:
        InvalidScene: The band has no width, or the dimension is neither 1 nor 2.
    """
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
    """Return the integral of q^(n-1) over q from a to b, without cancellation.

    Args:
        n: any real number, 0 included.
        a: the lower limit, positive.
        b: the upper limits, at least a, of any shape.
    """
    log_ratio = np.log1p((b - a) / a)
    return np.asarray(a**n * log_ratio * exprel(n * log_ratio))


def truncate(
    spectrum: SelfAffineSpectrum, wavenumber_high: float, dimension: int = 2
) -> SelfAffineSpectrum:
    """Return the part of a spectrum below a wave number.

    The rms slope of the result is that of the waves that remain.

    Args:
        spectrum: the spectrum.
        wavenumber_high: the wave number of the cut in rad/m; beyond the band it changes
            nothing.
        dimension: 1 for a line, 2 for a surface.

    Raises:
        InvalidScene: The cut is at or below the lowest wave number of the band, or the
            dimension is neither 1 nor 2.
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
