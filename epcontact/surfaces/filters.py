"""Surfaces without their short or long waves."""

from __future__ import annotations

import math
from dataclasses import replace

import ducc0
import numpy as np

from epcontact.results import FloatArray
from epcontact.scene import Surface, number, positive, require_kind
from epcontact.surfaces.power_spectrum import wavenumbers
from epcontact.surfaces.spectrum import BAND_TOLERANCE, truncated


def filtered(surface: Surface, wavenumber_high: float, wavenumber_low: float = 0.0) -> Surface:
    """Keep the modes of wavenumber_low <= |q| <= wavenumber_high (rad/m), on the same grid.

    Without a lower limit the result is the surface that the theory sees at the magnification
    wavenumber_high / q_0.  An analytic spectrum is cut off with the short waves, and dropped if
    long waves are removed or nothing of it remains.  The mean height is kept.

    Raises:
        InvalidScene: unless 0 <= wavenumber_low < wavenumber_high.

    Example:
        >>> surface = Surface(0.1 * np.cos(2 * math.pi * np.arange(8) / 4), (2 * math.pi,))
        >>> float(abs(filtered(surface, 1.0).heights).max()) < 1e-15
        True
    """
    require_kind("surface", surface, Surface)
    highest = positive("wavenumber_high", wavenumber_high, "rad/m", finite=False)
    right = f"a number between 0 and wavenumber_high = {highest:g} rad/m"
    lowest = number("wavenumber_low", wavenumber_low, right, lambda q: 0 <= q < highest)
    heights = kept_waves(surface.heights, surface.periods, highest, lowest)
    spectrum = surface.spectrum
    if spectrum is not None:
        left = highest > spectrum.wavenumber_low >= lowest * (1 - BAND_TOLERANCE)
        spectrum = truncated(spectrum, highest, heights.ndim) if left else None
    shortest = max(2 * math.pi / highest, surface.shortest_wavelength or 0.0) or None
    band = f"{lowest!r} to " if lowest else ""
    recipe = f"filtered/1 {band}{highest!r} of {surface.fingerprint}"
    return replace(
        surface,
        heights=heights,
        spectrum=spectrum,
        shortest_wavelength=shortest,
        recipe=recipe,
    )


def kept_waves(
    heights: FloatArray,
    periods: tuple[float, ...],
    wavenumber_high: float,
    wavenumber_low: float = 0.0,
) -> FloatArray:
    """Return heights of these periods without the waves outside a band; see `filtered`."""
    low, high = wavenumber_low * (1 - BAND_TOLERANCE), wavenumber_high * (1 + BAND_TOLERANCE)
    modes = ducc0.fft.r2c(heights)
    for rows, q in wavenumbers(heights.shape, periods):
        block = modes.reshape(-1, modes.shape[-1])[rows]
        block[(q > high) | ((q < low) & (q > 0))] = 0.0
    modes *= 1 / heights.size
    if heights.ndim == 2:
        ducc0.fft.c2c(modes, axes=(0,), forward=False, out=modes)
    kept = np.empty(heights.shape)
    ducc0.fft.c2r(modes, (heights.ndim - 1,), heights.shape[-1], forward=False, out=kept)
    kept.flags.writeable = False
    return kept
