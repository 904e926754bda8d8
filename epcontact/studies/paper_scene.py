"""The scenes that studies share: the roughness, material and load of the paper, at any width.

Self-affine surfaces of Hurst exponent 0.8 and rms slope 1, roll-off at four times the lowest
wave number, E* = 250 GPa, hardness 150 GPa, mean pressure 12.5 GPa (Almqvist and Persson,
"Multiscale contact mechanics for elastoplastic contacts").  `bandwidth` is the ratio of the
highest to the lowest wave number, 256 in the paper; a narrower band costs less and keeps
p0/(E* xi) = 0.05 and hardness/(E* xi) = 0.6, the only groups on which small-slope contact depends.
"""

from __future__ import annotations

import math
from typing import Any

from epcontact.results import ContactResult
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

LOWEST = 2.5e4  # rad/m
MODULUS, HARDNESS, MEAN_PRESSURE = 250e9, 150e9, 12.5e9  # Pa; Poisson's ratio is 0, E* = E
GAMMA = 0.536
PARTS = ("total", "elastic", "plastic")
#: Hardness over yield stress (Tabor), as in the paper.
CONSTRAINT = 3.0
LAWS = {"capped": HARDNESS, "elastic": math.inf}  # Pa
#: How captions name the scene.
PAPER = "the paper's roughness, material and load (p0/(E* xi) = 0.05, hardness/(E* xi) = 0.6)"


def rough_surface(points_per_wavelength: float, seed: int, bandwidth: int = 256) -> Surface:
    """A square period of the paper's roughness with so many points per shortest wavelength."""
    spectrum = SelfAffineSpectrum(0.8, LOWEST, 4 * LOWEST, bandwidth * LOWEST, 1.0)
    period, points = 2 * math.pi / LOWEST, round(points_per_wavelength * bandwidth)
    return SelfAffine(spectrum, (period, period), (points, points), seed).build()


def rough_scene(
    points_per_wavelength: float, seed: int, bandwidth: int = 256, hardness: float = HARDNESS
) -> Scene:
    """The paper's scene on a surface of `rough_surface`; the hardness is in Pa, or infinite."""
    surface = rough_surface(points_per_wavelength, seed, bandwidth)
    return Scene(surface, Material(MODULUS, 0.0, hardness), Load(MEAN_PRESSURE))


def area_of(result: ContactResult, part: str, kind: str = "corrected") -> float:
    """One area of the last load step, as a fraction of the nominal area."""
    return float(getattr(result.final.areas[kind], part))


def area_rows(result: ContactResult) -> list[dict[str, Any]]:
    """A row for each part of the corrected area: part, area_fraction and its estimated_error."""
    return [
        {
            "part": part,
            "area_fraction": area_of(result, part),
            "estimated_error": area_of(result, part, "error"),
        }
        for part in PARTS
    ]
