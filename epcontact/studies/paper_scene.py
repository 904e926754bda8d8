"""The scenes that studies share: the roughness, material and load of the paper, at any width.

Self-affine surfaces of Hurst exponent 0.8 and rms slope 1, roll-off at four times the lowest
wave number, E* = 250 GPa, hardness 150 GPa, mean pressure 12.5 GPa (Almqvist and Persson,
"Multiscale contact mechanics for elastoplastic contacts").  `bandwidth` is the ratio of the
highest to the lowest wave number, 256 in the paper; a narrower band costs less and keeps
p0/(E* xi) = 0.05 and hardness/(E* xi) = 0.6, the only groups that small-slope contact knows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from epcontact.results import Areas, ContactResult
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

LOWEST = 2.5e4  # rad/m
MODULUS, HARDNESS, MEAN_PRESSURE = 250e9, 150e9, 12.5e9  # Pa; Poisson's ratio is 0, E* = E
GAMMA = 0.536
PARTS = ("total", "elastic", "plastic")


def rough_surface(points_per_wavelength: float, seed: int, bandwidth: int = 256) -> Surface:
    """A square period of the paper's roughness with so many points per shortest wavelength."""
    spectrum = SelfAffineSpectrum(0.8, LOWEST, 4 * LOWEST, bandwidth * LOWEST, 1.0)
    period, points = 2 * math.pi / LOWEST, round(points_per_wavelength * bandwidth)
    return SelfAffine(spectrum, (period, period), (points, points), seed).build()


def rough_scene(
    points_per_wavelength: float, seed: int, bandwidth: int = 256, hardness: float = HARDNESS
) -> Scene:
    """The paper's scene on that surface; an infinite hardness makes it the elastic one."""
    surface = rough_surface(points_per_wavelength, seed, bandwidth)
    return Scene(surface, Material(MODULUS, 0.0, hardness), Load(MEAN_PRESSURE))


def on_surface(scene: Scene, surface: Surface) -> Scene:
    """The same material and load on another surface."""
    return replace(scene, surface=surface)


def mean_and_half_width(values: Sequence[float]) -> tuple[float, float]:
    """Mean and half the 95 % Student interval of independent values; of one value, 0."""
    array = np.asarray(values, dtype=np.float64)
    if array.size < 2:
        return float(array.mean()), 0.0
    quantile = float(stdtrit(array.size - 1, 0.975))
    return float(array.mean()), quantile * float(array.std(ddof=1)) / math.sqrt(array.size)


def area_of(result: ContactResult, part: str, kind: str = "corrected") -> float:
    """One area of the last load step, as a fraction of the nominal area."""
    areas: Areas = result.final.areas[kind]
    return float(getattr(areas, part))


def area_band(results: Iterable[ContactResult], part: str) -> tuple[float, float]:
    """Mean of a corrected area over surfaces and the half-width of its 95 % interval.

    The estimated errors of the areas, which the surfaces share, are added to that of the scatter.
    """
    found = list(results)
    mean, scatter = mean_and_half_width([area_of(r, part) for r in found])
    return mean, math.hypot(scatter, float(np.mean([area_of(r, part, "error") for r in found])))
