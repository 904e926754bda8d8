"""The same surface on a finer grid, or without its short waves; both exact in Fourier space."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Surface
from epcontact.surfaces.spectrum import BAND_TOLERANCE, truncated

ComplexArray = NDArray[np.complex128]


def refined(surface: Surface, factor: int) -> Surface:
    """The band-limited interpolant on a grid `factor` times as fine each way.

    Points in common keep their heights to rounding.  The Nyquist mode of an even grid is a
    cosine on the finer one: of all interpolants, the one of least slope.
    Raises InvalidScene unless factor is a whole number >= 1.
    """
    import ducc0

    if not isinstance(factor, int | np.integer) or factor < 1:
        raise InvalidScene(f"factor is {factor!r}, but must be a whole number >= 1")
    if factor == 1:
        return surface
    shape = tuple(int(factor) * n for n in surface.shape)
    modes = ducc0.fft.r2c(surface.heights)
    modes *= 1 / surface.heights.size
    if surface.shape[-1] % 2 == 0:
        modes[..., -1] *= 0.5  # the other half lies in the mirrored half plane
    if len(shape) == 2:
        modes = _padded_rows(modes, shape[0])
        ducc0.fft.c2c(modes, axes=(0,), forward=False, out=modes)
    padded = np.zeros((*shape[:-1], shape[-1] // 2 + 1), np.complex128)
    padded[..., : modes.shape[-1]] = modes
    del modes
    heights = np.empty(shape)
    ducc0.fft.c2r(padded, (len(shape) - 1,), shape[-1], forward=False, out=heights)
    heights.flags.writeable = False
    recipe = f"refined/1 {factor} of {surface.fingerprint}"
    return replace(surface, heights=heights, recipe=recipe)


def _padded_rows(modes: ComplexArray, rows: int) -> ComplexArray:
    """`modes` with rows of zeros put in at the high wave numbers of the first axis."""
    n = modes.shape[0]
    half = (n + 1) // 2  # rows 0 .. half - 1 hold k >= 0, the last n - half hold k < 0
    padded = np.zeros((rows, modes.shape[1]), np.complex128)
    padded[:half] = modes[:half]
    padded[rows - (n - half) :] = modes[half:]
    if n % 2 == 0:  # the Nyquist row, at k = -n / 2 so far, is shared with k = n / 2
        padded[rows - n // 2] *= 0.5
        padded[n // 2] = padded[rows - n // 2]
    return padded


def filtered(surface: Surface, wavenumber_high: float) -> Surface:
    """The surface without its modes of |q| > wavenumber_high (rad/m), on the same grid.

    What the theory sees at the magnification wavenumber_high / q_0.  An analytic spectrum is cut
    off with it, and dropped where nothing is left of it.
    Raises InvalidScene unless wavenumber_high is a positive number.
    """
    import ducc0

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
