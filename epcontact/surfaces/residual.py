"""The surface that plastic flow leaves behind, and statistics that tell it from the first one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Surface
from epcontact.surfaces.power_spectrum import radial_spectrum, surface_moments
from epcontact.surfaces.spectrum import BAND_TOLERANCE

#: A path counts as unloaded if it ends below this share of its largest mean pressure.
UNLOADED = 1e-2


def residual_surface(surface: Surface, result: ContactResult) -> Surface:
    """Return the surface that a result leaves behind, which another scene can take up.

    A capped contact keeps its plastic displacement, so any load will do.  J2 flow shows only after
    unloading: the displacement that remains is the plastic one.

    Args:
        surface: the surface of the scene that was solved.
        result: the answer to it, with fields.

    Raises:
        InvalidScene: the result has no fields, or its path does not unload a body without cap.

    Example:
        >>> from epcontact import Load, Material, Scene, bem
        >>> surface = Surface(np.cos(2 * np.pi * np.arange(64) / 64), (50.0,))
        >>> scene = Scene(surface, Material(1.0, 0.0, hardness=0.05), Load(0.02))
        >>> left = residual_surface(surface, bem.solve(scene))
        >>> bool(left.heights.max() < surface.heights.max())
        True
    """
    lowered = result.fields.get("plastic_displacement")
    if lowered is None:
        pressures = [step.mean_pressure for step in result.steps]
        if "displacement" not in result.fields or pressures[-1] > UNLOADED * max(pressures):
            raise InvalidScene(
                f"{result.method} gives no plastic displacement; let its load path end at 0, where "
                "the displacement that remains is the plastic one"
            )
        lowered = result.fields["displacement"]
    return replace(
        surface,
        heights=surface.heights - lowered,
        spectrum=None,
        recipe="",
        notes=(*surface.notes, f"the surface that {result.method} has left after plastic flow"),
    )


class Topography(NamedTuple):
    """Statistics of the heights about their mean.

    Attributes:
        rms_height: in m.
        rms_slope: that of the gradient.
        rms_curvature: in 1/m, that of half the Laplacian (of a line: the second derivative).
        skewness: third moment over rms_height^3; 0 if the heights are symmetric.
        excess_kurtosis: fourth moment over rms_height^4, less the 3 of Gaussian heights.
    """

    rms_height: float
    rms_slope: float
    rms_curvature: float
    skewness: float
    excess_kurtosis: float


def topography(surface: Surface) -> Topography:
    """Return the statistics of a surface's heights.

    Example:
        >>> wave = Surface(np.cos(2 * np.pi * np.arange(64) / 64), (2 * np.pi,))
        >>> found = topography(wave)
        >>> round(found.rms_slope**2, 9), round(found.excess_kurtosis, 9)
        (0.5, -1.5)
    """
    from scipy.stats import kurtosis, skew  # slow to load

    heights = surface.heights.ravel()
    return Topography(*surface_moments(surface), float(skew(heights)), float(kurtosis(heights)))


def power_by_octave(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """Return the height variance of each octave of wave numbers.

    Octave k holds the wave numbers from 2^k to 2^(k+1) times the lowest one, 2 pi over the longest
    period.

    Returns:
        lowest: (n,) the lowest wave number of each octave in rad/m.
        variance: (n,) its contribution to the square of the rms height, in m^2.

    Example:
        >>> wave = Surface(0.1 * np.cos(2 * np.pi * 5 * np.arange(64) / 64), (2 * np.pi,))
        >>> lowest, variance = power_by_octave(wave)
        >>> float(lowest[np.argmax(variance)]), float(variance.max().round(9))
        (4.0, 0.005)
    """
    rings = radial_spectrum(surface)
    first = 2 * math.pi / max(surface.periods)
    ratio = rings.wavenumber / first * (1 + BAND_TOLERANCE)
    octave = np.maximum(np.floor(np.log2(ratio)), 0).astype(np.intp)
    variance = np.bincount(octave, weights=rings.height_variance)
    lowest = np.asarray(first * np.exp2(np.arange(variance.size)))
    return lowest, np.asarray(variance, dtype=np.float64)
