"""The scene whose cost is charted, and the unit of its time.

The unit is the time of a bare 2048 x 2048 real FFT pair on the same core: it makes the times of
different machines comparable.
"""

from __future__ import annotations

import time

import ducc0
import numpy as np

from epcontact.scene import Load, Material, Scene, Surface


def fft_pair_seconds(size: int = 2048, repeats: int = 3) -> float:
    """Seconds of a real FFT pair of size x size points on one core, the fastest of `repeats`."""
    field, best = np.random.default_rng(3).random((size, size)), np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        spectrum = ducc0.fft.r2c(field, nthreads=1)
        ducc0.fft.c2r(spectrum, lastsize=size, forward=False, inorm=2, nthreads=1)
        best = min(best, time.perf_counter() - begin)
    return best


def speed_scene(nodes: int, *, line: bool = False, load: float = 0.05, seed: int = 5) -> Scene:
    """A self-affine J2 scene with eight nodes to its shortest wave; 16 on a line.

    Args:
        nodes: along each side of the unit period.
        line: a line instead of a surface.
        load: mean pressure in units of E* xi, which is 1 at the rms slope of 0.05; the yield
            stress is 0.2, and nu = 0.3.
        seed: of the surface.

    Example:
        >>> speed_scene(16).surface.shape
        (16, 16)
    """
    highest = nodes // (16 if line else 8)
    frequency = np.abs(np.fft.fftfreq(nodes, 1 / nodes))
    q = frequency if line else np.hypot(frequency[:, None], frequency[None, :])
    inside = (q > 0) & (q <= highest)
    power = np.where(inside, np.where(inside, q, 1.0) ** (-1.3 if line else -1.8), 0.0)
    noise = np.random.default_rng(seed).standard_normal(q.shape)
    heights = np.fft.ifftn(power * np.fft.fftn(noise)).real
    spectrum = np.abs(np.fft.fftn(heights)) / heights.size
    slope = np.sqrt(np.sum((2 * np.pi * q * spectrum) ** 2))
    return Scene(
        Surface(heights * 0.05 / slope, (1.0,) * heights.ndim, seed=seed),
        Material((1 - 0.3**2) / 0.05, 0.3, yield_stress=0.2),
        Load(load),
    )
