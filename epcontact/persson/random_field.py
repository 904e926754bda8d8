"""Whether a surface can be a random isotropic field, for which the theory's error is
known.

A random field here is a sum of waves whose phases are independent.  With the
autocorrelation R(x) of one period of a field f, R(0) = 1, and means < > over the
period, the skewness of its values over many draws of the phases has

    mean 0,           variance 6 <R^3>,

and the excess kurtosis, with the part p_q of each wave vector q in the variance of f,

    mean -3 <R^2>,    variance 24 (<R^4> - 3 <R^2>^2 + 3 sum_q p_q^4).

The variances are sums over the triples and quadruples of wave vectors that add up to 0,
and the subtracted terms are the quadruples q, -q, q', -q', whose phases cancel: few
waves scatter much, many waves little.  Both are compared for the heights h and for the
pressure of full contact, whose waves are |q| h_q E*/2: its short waves are many and
show truncated summits, scratches and kinks.

The anisotropy of the slopes is t = |<(h_x + i h_y)^2>| / <|h_x + i h_y|^2>, from 0 to
1.  The variance of its two parts over random amplitudes is sum_k s_k^2 / n_k, with the
fraction s_k of the slope variance in the ring k of n_k waves.

A surface that is mirrored at its edges has four copies of each value, so that all these
variances, and the mean of the kurtosis, are four times as large.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Surface
from epcontact.surfaces.power_spectrum import radial_spectrum

#: Largest distance of the skewness from that of a random field, in standard deviations:
#: that of a normal distribution which 1 of 370 values exceeds.
_SKEWNESS_LIMIT = 3.0
#: Likewise of the kurtosis, whose distribution has a longer tail: 1 of some 300 random
#: fields exceeds it.
_KURTOSIS_LIMIT = 4.0
#: Likewise of the anisotropy, in standard deviations of one of its two parts: 1 of 90
#: random fields exceeds it.
_ANISOTROPY_LIMIT = 3.0
#: Skewness, excess kurtosis and anisotropy that change the area by some 1 %, and do not
#: matter.  A skewness of .3 changes it by 16 %, and an anisotropy of .6 by 8 %, in
#: proportion to its square.
_SMALL = {"skewness": 0.02, "excess kurtosis": 0.04, "anisotropy": 0.2}


def require_random_field(surface: Surface) -> None:
    """Raise InvalidScene if the surface cannot be a random isotropic field.

    A surface that was drawn from an analytic spectrum is such a field and is not
    examined.

    Args:
        surface: A surface with heights over two directions that is not flat.
    """
    if surface.spectrum is not None:
        return
    heights = surface.heights
    measured = heights
    copies = 1
    for axis, points in enumerate(heights.shape):
        if np.array_equal(heights, np.flip(heights, axis)):
            copies *= 2
            measured = measured.take(range(points // 2), axis)
    modes = np.fft.rfft2(heights)
    modes[0, 0] = 0.0
    _require_random_phases("heights", modes, surface, copies)
    q_x, q_y = (
        2 * math.pi * np.fft.fftfreq(points, spacing)
        for points, spacing in zip(surface.shape, surface.spacing, strict=True)
    )
    modes *= np.hypot(q_x[:, None], q_y[: modes.shape[1]])
    _require_random_phases("pressure of full contact", modes, surface, copies)
    _require_isotropy(measured, surface, copies)


def _require_random_phases(
    field_name: str, modes: NDArray[np.complex128], surface: Surface, copies: int
) -> None:
    """Raise InvalidScene if skewness or kurtosis are not those of random phases.

    Args:
        field_name: What the field is, for the message.
        modes: Fourier modes of the field, as of a real transform; the mean is 0.
        surface: The surface, whose shape the field has.
        copies: How often the field holds each value.
    """
    field = np.fft.irfft2(modes, surface.shape)
    field /= field.std()
    squares = field**2
    skewness = float(np.mean(field * squares))
    kurtosis = float(np.mean(squares * squares)) - 3
    power = modes.real**2 + modes.imag**2
    correlation = np.fft.irfft2(power, surface.shape)
    power /= correlation[0, 0] * field.size
    correlation /= correlation[0, 0]
    squares = correlation**2
    second = float(np.mean(squares))
    third = float(np.mean(squares * correlation))
    fourth = float(np.mean(squares * squares))
    power **= 2
    paired = 2 * float(np.vdot(power, power)) - float(np.sum(power[:, 0] ** 2))
    variance = 6 * third * copies
    _require_near("skewness", field_name, skewness, 0.0, _SKEWNESS_LIMIT, variance)
    variance = 24 * (fourth - 3 * second**2 + 3 * paired) * copies
    expected = -3 * second * copies
    _require_near(
        "excess kurtosis", field_name, kurtosis, expected, _KURTOSIS_LIMIT, variance
    )


def _require_isotropy(heights: FloatArray, surface: Surface, copies: int) -> None:
    """Raise InvalidScene if the slopes are larger along one direction than another.

    Args:
        heights: The heights without their mirror images, in m.
        surface: The surface.
        copies: How often the surface holds each of these heights.
    """
    along_x = np.diff(heights, axis=0)[:, 1:] / surface.spacing[0]
    along_y = np.diff(heights, axis=1)[1:] / surface.spacing[1]
    squares = (along_x + 1j * along_y) ** 2
    anisotropy = float(abs(squares.mean()) / abs(squares).mean())
    rings = radial_spectrum(surface)
    fractions = rings.slope_variance / rings.slope_variance.sum()
    variance = float(np.sum(fractions**2 / rings.modes)) * copies
    _require_near("anisotropy", "slopes", anisotropy, 0.0, _ANISOTROPY_LIMIT, variance)


def _require_near(
    name: str, of: str, value: float, expected: float, limit: float, variance: float
) -> None:
    """Raise InvalidScene if a statistic is farther from a random field's than it may.

    Args:
        name: Of the statistic.
        of: The field whose statistic it is.
        value: The surface's.
        expected: The mean over random fields.
        limit: Largest distance in standard deviations.
        variance: Over random fields; rounding may make it negative.
    """
    largest = max(limit * math.sqrt(max(variance, 0.0)), _SMALL[name])
    if not abs(value - expected) <= largest:
        raise InvalidScene(
            f"the {name} of the {of} is {value:.2g}, but a random isotropic surface "
            f"with as few waves has {expected:.1g} ± {largest:.2g}"
        )
