"""The roughness of a surface as the theory uses it: its slope variance by wave number.

A spectrum enters the theory only through xi^2(q) = 2 pi int_{q_0}^q q^3 C dq, which
sets the diffusion, and through m_1 = 2 pi int q^2 C dq = int dxi^2 / q, which weighs
elastic energies.  Both are given for bands of wave numbers: in closed form for an
analytic spectrum, and as sums over the modes of each ring for the spectrum of a
surface.
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
    integer,
    require_kind,
    require_one_of,
)
from epcontact.surfaces.power_spectrum import cumulative_slope_variance, radial_spectrum
from epcontact.surfaces.spectrum import slope_variance_up_to, spectral_moment

SpectrumKind = Literal["analytic", "surface"]


@dataclass(frozen=True)
class Roughness:
    """The roughness of an isotropic surface, in n bands of ascending wave number.

    Attributes:
        upper_edge: Largest wave number of each band in rad/m, (n,).
        slope_variance: Contribution of each band to xi^2, (n,).
        first_moment: Contribution of each band to m_1 = int dxi^2 / q in m, (n,).
        height_variance: Contribution of each band to the height variance in m^2, (n,).
        lowest: q_0 in rad/m, where the magnification is 1.
        slope_variance_up_to: Function from wave numbers in rad/m, of any shape, to
            xi^2 of the roughness up to them.
    """

    upper_edge: FloatArray
    slope_variance: FloatArray
    first_moment: FloatArray
    height_variance: FloatArray
    lowest: float
    slope_variance_up_to: Callable[[ArrayLike], FloatArray] = field(repr=False)

    @property
    def rms_slope(self) -> float:
        """The rms slope xi of all bands of this roughness, dimensionless."""
        return math.sqrt(self.slope_variance.sum())

    @property
    def highest(self) -> float:
        """The largest wave number of all bands of this roughness, in rad/m."""
        return float(self.upper_edge[-1])


def analytic_roughness(spectrum: SelfAffineSpectrum, bands: int = 512) -> Roughness:
    """Return the roughness of an analytic spectrum, with exact moments of each band.

    ln q grows with the square of the band's number, because near q_0 the pressure of
    full contact goes to zero like sqrt(q - q_0), which equal ratios would not resolve.

    Args:
        spectrum: The self-affine spectrum, from q_0 to q_1.
        bands: Number of bands.

    Raises:
        InvalidScene: The spectrum has no width, or the number of bands is less than 1.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, rms_slope=0.1)
        >>> rough = analytic_roughness(spectrum)
        >>> print(f"{rough.rms_slope:.6f} {rough.lowest:g} {rough.highest:g}")
        0.100000 100000 1.6e+06
    """
    require_kind("spectrum", spectrum, SelfAffineSpectrum)
    bands = integer("bands", bands, 1)
    q0 = spectrum.wavenumber_low
    q1 = spectrum.wavenumber_high
    edges = q0 * np.exp(np.linspace(0, 1, bands + 1) ** 2 * math.log(q1 / q0))
    edges[-1] = q1
    return Roughness(
        upper_edge=edges[1:],
        slope_variance=np.diff(slope_variance_up_to(spectrum, edges)),
        first_moment=np.diff(spectral_moment(spectrum, 1, wavenumber=edges)),
        height_variance=np.diff(spectral_moment(spectrum, 0, wavenumber=edges)),
        lowest=q0,
        slope_variance_up_to=lambda q: slope_variance_up_to(spectrum, q),
    )


def roughness_of(surface: Surface, spectrum: SpectrumKind = "analytic") -> Roughness:
    """Return the roughness of a surface as the theory uses it.

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
        >>> periods = (6.2832e-5, 6.2832e-5)
        >>> surface = SelfAffine(spectrum, periods, (64, 64), seed=7).build()
        >>> print(f"{roughness_of(surface, 'surface').rms_slope:.6f}")
        0.100000
    """
    if len(surface.shape) != 2:
        raise InvalidScene(
            "the surface is a line, but the theory is defined for isotropic surfaces: "
            "its pressure diffuses with roughness of every direction"
        )
    require_one_of("spectrum", spectrum, SpectrumKind)
    if spectrum == "analytic":
        if surface.spectrum is None:
            raise InvalidScene(
                "the surface was not drawn from an analytic spectrum; write spectrum = "
                "'surface' for that of its heights"
            )
        return analytic_roughness(surface.spectrum)
    rings = radial_spectrum(surface)
    return Roughness(
        upper_edge=rings.upper_edge,
        slope_variance=rings.slope_variance,
        first_moment=rings.slope_variance / rings.wavenumber,
        height_variance=rings.height_variance,
        lowest=2 * math.pi / max(surface.periods),
        slope_variance_up_to=lambda q: cumulative_slope_variance(surface, q),
    )
