"""What a surface's own heights say to the theory: slopes and full-contact pressures."""

from __future__ import annotations

import math

import numpy as np

from epcontact.moduli import effective_modulus
from epcontact.reference.form import ClosedForm
from epcontact.scene import Scene


def rms_slope(scene: Scene) -> float:
    """rms slope by spectral derivatives along each axis: exact for band-limited heights."""
    surface = scene.surface
    total = 0.0
    for axis, (n, d) in enumerate(zip(surface.shape, surface.spacing, strict=True)):
        q = 2 * np.pi * np.fft.fftfreq(n, d)
        if n % 2 == 0:
            q[n // 2] = 0.0  # the unpaired mode has no derivative on the grid
        along = q.reshape([-1 if a == axis else 1 for a in range(surface.heights.ndim)])
        modes = np.fft.fft(surface.heights, axis=axis) * along
        total += float(np.mean(np.abs(np.fft.ifft(modes, axis=axis)) ** 2))
    return math.sqrt(total)


def _half_variance(scene: Scene) -> float:
    """Half the variance that the pressure would have in full contact, E*^2 xi^2/8, in Pa^2."""
    return effective_modulus(scene.material) ** 2 * rms_slope(scene) ** 2 / 8


FORMS = (
    ClosedForm(
        "heights",
        "the surface's own heights: xi^2 = <|grad h|^2>, <(p - p0)^2> = E*^2 xi^2/4",
        {"quantity.rms_slope": rms_slope, "quantity.diffusion": _half_variance},
    ),
)
