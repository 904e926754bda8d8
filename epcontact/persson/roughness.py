"""The roughness of a surface as the theory uses it: its slope variance by wave number.

A spectrum enters the theory only through xi^2(q) = 2 pi int_{q_0}^q q^3 C dq, which
sets the diffusion, and through m_1 = 2 pi int q^2 C dq = int dxi^2 / q, which weighs
elastic energies. Both are known in bands: in closed form for an analytic spectrum, and
as sums over the modes of each ring for a surface's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import (
    SelfAffineSpectrum,
    Surface,
    require_kind,
    require_one_of,
    whole,
)
from epcontact.surfaces.power_spectrum import cumulative_slope_variance, radial_spectrum
from epcontact.surfaces.spectrum import slope_variance_up_to, spectral_moment

SpectrumKind = Literal["analytic", "surface"]


@dataclass(frozen=True)
class Roughness:
    """The roughness of an isotropic surface, in n bands of ascending wave number."""

    upper_edge: FloatArray  # the largest wave number of each band, in rad/m
    slope_variance: FloatArray  # contribution of each band to xi^2
    first_moment: FloatArray  # contribution of each band to m_1 = int dxi^2 / q, in m
    lowest: float  # q_0 in rad/m, where the magnification is 1
    #: xi^2(q) at any wave numbers (rad/m, any shape).
    slope_variance_up_to: Callable[[ArrayLike], FloatArray] = field(repr=False)

    @property
    def rms_slope(self) -> float:
        """xi of the whole band."""
        return math.sqrt(self.slope_variance.sum())

    @property
    def highest(self) -> float:
        """The largest wave number in rad/m."""
        return float(self.upper_edge[-1])


def analytic_roughness(spectrum: SelfAffineSpectrum, bands: int = 512) -> Roughness:
    """Bands from q_0 to q_1, each with its exact moments.

    ln q grows with the square of the band's number: near q_0 the pressure of full
    contact goes to zero like sqrt(q - q_0), and equal ratios would not resolve it.

    Raises:
        InvalidScene: The spectrum has no width, or the number of bands is less than 1.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> rough = analytic_roughness(SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, rms_slope=0.1))
        >>> print(f"{rough.rms_slope:.6f} {rough.lowest:g} {rough.highest:g}")
        0.100000 100000 1.6e+06
    """
    require_kind("spectrum", spectrum, SelfAffineSpectrum)
    bands = whole("bands", bands, 1)
    q0, q1 = spectrum.wavenumber_low, spectrum.wavenumber_high
    edges = q0 * np.exp(np.linspace(0, 1, bands + 1) ** 2 * math.log(q1 / q0))
    edges[-1] = q1
    return Roughness(
        upper_edge=edges[1:],
        slope_variance=np.diff(slope_variance_up_to(spectrum, edges)),
        first_moment=np.diff(spectral_moment(spectrum, 1, wavenumber=edges)),
        lowest=spectrum.wavenumber_low,
        slope_variance_up_to=lambda q: slope_variance_up_to(spectrum, q),
    )


def roughness_of(surface: Surface, spectrum: SpectrumKind = "analytic") -> Roughness:
    """The roughness of a surface as the theory uses it.

    Args:
        surface: Heights over two directions.
        spectrum: "analytic" for the spectrum that the surface was drawn from, "surface"
            for the surface's own modes, with q_0 of its longest period and a band for
            each ring.

    Raises:
        InvalidScene: The surface is a line or has no analytic spectrum, or the kind is
            unknown.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> from epcontact.surfaces import SelfAffine
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, rms_slope=0.1)
        >>> surface = SelfAffine(spectrum, (6.2832e-5, 6.2832e-5), (64, 64), seed=7).build()
        >>> print(f"{roughness_of(surface, 'surface').rms_slope:.6f}")
        0.100000
    """
    if len(surface.shape) != 2:
        raise InvalidScene(
            "the surface is a line, but the theory is defined for isotropic surfaces: its "
            "pressure diffuses with roughness of every direction"
        )
    require_one_of("spectrum", spectrum, SpectrumKind)
    if spectrum == "analytic":
        if surface.spectrum is None:
            raise InvalidScene(
                "the surface was not drawn from an analytic spectrum; write spectrum = 'surface' "
                "for that of its heights"
            )
        return analytic_roughness(surface.spectrum)
    rings = radial_spectrum(surface)
    return Roughness(
        upper_edge=rings.upper_edge,
        slope_variance=rings.slope_variance,
        first_moment=rings.slope_variance / rings.wavenumber,
        lowest=2 * math.pi / max(surface.periods),
        slope_variance_up_to=lambda q: cumulative_slope_variance(surface, q),
    )
