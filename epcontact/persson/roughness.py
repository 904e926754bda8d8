"""What the theory needs of a surface: the slope variance it shows up to a wave number.

The theory reads a spectrum only through xi^2(q) = 2 pi int_{q_0}^q q^3 C dq, which sets the
diffusion, and through m_1 = 2 pi int q^2 C dq = int dxi^2 / q, which weighs elastic energies.
Both are known in bands: exactly (closed form) for an analytic spectrum, and as exact sums over
the modes, by rings, for a surface's own.
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
from epcontact.scene import SelfAffineSpectrum, Surface
from epcontact.surfaces.power_spectrum import cumulative_slope_variance, radial_spectrum
from epcontact.surfaces.spectrum import slope_variance_up_to, spectral_moment

SpectrumKind = Literal["analytic", "surface"]


@dataclass(frozen=True)
class Roughness:
    """The roughness of an isotropic surface, in bands of ascending wave number.

    upper_edge: (n,) rad/m, the largest wave number of each band.
    slope_variance: (n,) what each band adds to xi^2.
    first_moment: (n,) what each band adds to m_1 = int dxi^2 / q, in m.
    lowest: q_0 in rad/m, where the magnification is 1.
    slope_variance_up_to: xi^2(q) at any wave numbers (rad/m, any shape).
    """

    upper_edge: FloatArray
    slope_variance: FloatArray
    first_moment: FloatArray
    lowest: float
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

    ln q grows with the square of the band's number: near q_0 the pressure of full contact goes
    to zero like sqrt(q - q_0), and equal ratios would not resolve it.

    Raises InvalidScene if the spectrum has no width.
    """
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


def surface_roughness(surface: Surface) -> Roughness:
    """One band a ring of the surface's own modes; q_0 belongs to its longest period.

    Raises InvalidScene for a line.
    """
    _require_surface(surface)
    rings = radial_spectrum(surface)
    return Roughness(
        upper_edge=rings.upper_edge,
        slope_variance=rings.slope_variance,
        first_moment=rings.slope_variance / rings.wavenumber,
        lowest=2 * math.pi / max(surface.periods),
        slope_variance_up_to=lambda q: cumulative_slope_variance(surface, q),
    )


def roughness_of(surface: Surface, spectrum: SpectrumKind = "analytic") -> Roughness:
    """The roughness the theory reads: of the spectrum drawn from, or of the surface itself.

    Raises InvalidScene for a line, an unknown kind, or a surface without analytic spectrum.
    """
    _require_surface(surface)
    if spectrum == "surface":
        return surface_roughness(surface)
    if spectrum != "analytic":
        raise InvalidScene(f"spectrum is {spectrum!r}, but must be 'analytic' or 'surface'")
    if surface.spectrum is None:
        raise InvalidScene(
            "the surface was not drawn from an analytic spectrum; use spectrum = 'surface', its own"
        )
    return analytic_roughness(surface.spectrum)


def _require_surface(surface: Surface) -> None:
    if len(surface.shape) != 2:
        raise InvalidScene(
            "the surface is a line, but the theory is defined for isotropic surfaces: its "
            "pressure diffuses with roughness of every direction"
        )
