"""Closed forms of a rough surface: slope, contact at light load and bearing area.

They use only the heights, not the recipe or the spectrum behind them.
"""

from __future__ import annotations

import math

import numpy as np

from epcontact.materials.moduli import effective_modulus
from epcontact.reference.form import ClosedForm
from epcontact.scene import Scene

BEARING_AREA = ClosedForm(
    "bearing_area",
    "the highest p0/sigma_P of the surface, flattened without springing back",
)
HEIGHTS = ClosedForm(
    "heights",
    "the surface's own heights: xi^2 = <|grad h|^2>, <(p - p0)^2> = E*^2 xi^2/4",
)
LIGHT_LOAD = ClosedForm(
    "light_load",
    "Almqvist and Persson, the contact area of an elastic rough surface at light load",
)
#: Largest area at which `light_load` is offered.  There the elastic area of the theory
#: is 0.6 % below its straight line (test_reference.py).
_LIGHT = 0.15


@BEARING_AREA.gives("area.total", "area.plastic")
def _bearing_fraction(scene: Scene) -> float:
    """Return the contact area p0/sigma_P where all of the contact flows, as a fraction.

    It is the limit in which elastic contact carries nothing; p0 is the last mean
    pressure and sigma_P the hardness.  Source: Abbott and Firestone (1933).

    Raises:
        InvalidCase: The scene has no finite hardness.
    """
    BEARING_AREA.require(math.isfinite(scene.material.hardness), "a finite hardness")
    return scene.load.final / scene.material.hardness


@BEARING_AREA.gives("area.elastic")
def _no_elastic_area(scene: Scene) -> float:
    """Return the elastic area 0 of a contact that flows everywhere.

    Raises:
        InvalidCase: The scene has no finite hardness.
    """
    return 0 * _bearing_fraction(scene)


@BEARING_AREA.gives("quantity.mean_gap")
def _bearing_gap(scene: Scene) -> float:
    """Return the mean gap in m of the surface under the flat that cuts off its top.

    The flat cuts off the fraction p0/sigma_P (mean pressure over hardness) of the
    heights.

    Raises:
        InvalidCase: The scene has no finite hardness.
    """
    ordered = np.sort(scene.surface.heights, axis=None)[::-1]
    contact = _bearing_fraction(scene) * ordered.size
    flat = float(ordered[min(int(contact), ordered.size - 1)])
    return float(np.mean(np.maximum(flat - ordered, 0)))


@HEIGHTS.gives("quantity.rms_slope")
def rms_slope(scene: Scene) -> float:
    """Return the rms of the gradient of a scene's heights, dimensionless.

    Spectral derivatives along each axis make it exact for band-limited heights.
    """
    surface = scene.surface
    total = 0.0
    for axis, (n, d) in enumerate(zip(surface.shape, surface.spacing, strict=True)):
        q = 2 * np.pi * np.fft.fftfreq(n, d)
        if n % 2 == 0:
            q[n // 2] = 0.0  # the unpaired mode has no derivative on the grid
        modes = np.fft.fft(np.moveaxis(surface.heights, axis, -1)) * q
        total += float(np.mean(np.abs(np.fft.ifft(modes)) ** 2))
    return math.sqrt(total)


@HEIGHTS.gives("quantity.diffusion")
def _half_variance(scene: Scene) -> float:
    """Return half the variance of the pressure in full contact, in Pa^2.

    It is E*^2 xi^2/8, with the effective modulus E* of the scene's material and the rms
    slope xi of its surface.
    """
    return effective_modulus(scene.material) ** 2 * rms_slope(scene) ** 2 / 8


def light_load_area(
    mean_pressure: float, effective_modulus: float, rms_slope: float
) -> float:
    """Return the elastic contact area at light load by equation (6) of the paper:

        A = 2 p_0 / (xi E*)

    Boundary elements give the factor 2, and Persson's theory sqrt(8/(pi gamma)).

    Args:
        mean_pressure: p_0 in Pa.
        effective_modulus: E* in Pa.
        rms_slope: xi.

    Returns:
        The area as a fraction of the nominal area.
    """
    return 2 * mean_pressure / (rms_slope * effective_modulus)


@LIGHT_LOAD.gives("area.total")
def _light_load(scene: Scene) -> float:
    """Return the contact area of a rough surface at light load, as a fraction.

    Raises:
        InvalidCase: The scene is no elastic half-space with a rough surface, or its
            contact area is above 0.15.
    """
    E = LIGHT_LOAD.elastic_half_space(scene)
    slope = rms_slope(scene)
    LIGHT_LOAD.require(scene.surface.heights.ndim == 2 and slope > 0, "a rough surface")
    area = light_load_area(scene.load.final, E, slope)
    LIGHT_LOAD.require(area <= _LIGHT, f"a contact area of at most {_LIGHT:g}")
    return area
