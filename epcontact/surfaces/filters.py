"""Surfaces without their short waves."""

from __future__ import annotations

import math
from dataclasses import replace

import ducc0
import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Surface
from epcontact.surfaces.spectrum import BAND_TOLERANCE, truncated


def filtered(surface: Surface, wavenumber_high: float) -> Surface:
    """Remove the modes of |q| > wavenumber_high (rad/m) from a surface, on the same grid.

    The result is the surface that the theory sees at the magnification wavenumber_high / q_0.  An
    analytic spectrum is cut off with the heights, and dropped if nothing of it remains.

    Raises:
        InvalidScene: unless wavenumber_high is a positive number.

    Example:
        >>> surface = Surface(np.cos(2 * math.pi * np.arange(8) / 4), (2 * math.pi,))
        >>> float(abs(filtered(surface, 1.0).heights).max()) < 1e-15
        True
    """
    good = isinstance(wavenumber_high, int | float) and wavenumber_high > 0
    if not good:
        raise InvalidScene(
            f"wavenumber_high is {wavenumber_high!r}, but must be a positive number in rad/m"
        )
    n = surface.shape[-1]
    limit = wavenumber_high * (1 + BAND_TOLERANCE)
    axes = tuple(range(len(surface.shape)))
    modes = ducc0.fft.r2c(surface.heights)
    rows = modes.reshape(-1, modes.shape[-1])
    q_last = 2 * math.pi / surface.periods[-1] * np.arange(n // 2 + 1)
    q_first: FloatArray = np.zeros(1)
    if len(surface.shape) == 2:
        q_first = np.asarray(2 * math.pi * np.fft.fftfreq(surface.shape[0], surface.spacing[0]))
    for row, q_row in zip(rows, q_first, strict=True):
        row[np.hypot(q_row, q_last) > limit] = 0.0
    modes *= 1 / surface.heights.size
    if len(axes) == 2:
        ducc0.fft.c2c(modes, axes=(0,), forward=False, out=modes)
    heights = np.empty(surface.shape)
    ducc0.fft.c2r(modes, axes[-1:], n, forward=False, out=heights)
    heights.flags.writeable = False
    spectrum = surface.spectrum
    if spectrum is not None:
        left = wavenumber_high > spectrum.wavenumber_low
        spectrum = truncated(spectrum, wavenumber_high, len(axes)) if left else None
    shortest = max(2 * math.pi / wavenumber_high, surface.shortest_wavelength or 0.0)
    recipe = f"filtered/1 {float(wavenumber_high)!r} of {surface.fingerprint}"
    return replace(
        surface,
        heights=heights,
        spectrum=spectrum,
        shortest_wavelength=shortest,
        recipe=recipe,
    )
