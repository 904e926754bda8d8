"""The scenes and laws that studies share: the paper's roughness, material and load, at
any width.

Self-affine surfaces of Hurst exponent 0.8 and rms slope 1, roll-off at four times the
lowest wave number, E* = 250 GPa, hardness 150 GPa, mean pressure 12.5 GPa (Almqvist and
Persson, "Multiscale contact mechanics for elastoplastic contacts").  `bandwidth` is the
ratio of the highest to the lowest wave number, 256 in the paper; a narrower band costs
less and keeps p0/(E* xi) = 0.05 and hardness/(E* xi) = 0.6, the only groups on which
small-slope contact depends.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import pandas as pd

import fem_check
from epcontact import bem, persson
from epcontact.output.charts.curves import pressure_density
from epcontact.results import ContactResult, PressureDistribution
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

LOWEST = 2.5e4  # rad/m
MODULUS, HARDNESS, MEAN_PRESSURE = (
    250e9,
    150e9,
    12.5e9,
)  # Pa; Poisson's ratio is 0, E* = E
GAMMA = 0.536
PARTS = ("total", "elastic", "plastic")
#: Hardness over yield stress, as in the paper.
TABOR = 3.0
LAWS = {"capped": HARDNESS, "elastic": math.inf}  # Pa
#: Intervals of densities of the pressure up to the hardness.
BINS = 40

#: Boundary elements until the areas have settled, and the theory on the surface's own
#: spectrum.
settled = partial(bem.solve, area_tolerance=1e-5)
by_theory = partial(persson.solve, energy_reduction=GAMMA, spectrum="surface")
theory_of = partial(persson.Theory.of_scene, energy_reduction=GAMMA, spectrum="surface")
#: Finite elements of J2 flow, without the certificate, which takes time.
flowed = partial(fem_check.solve, law="j2", certified=False)


def self_affine(
    q: float,
    shape: tuple[int, ...],
    seed: int,
    shortest: float,
    roll_off: float = 1.0,
    hurst: float = 0.8,
    slope: float = 1.0,
) -> Surface:
    """Self-affine roughness of the lowest wave number q, whose period has so many of
    its shortest waves, and of its roll-off.
    """
    spectrum = SelfAffineSpectrum(hurst, q, roll_off * q, shortest * q, slope)
    return SelfAffine(spectrum, (2 * math.pi / q,) * len(shape), shape, seed).build()


def rough_scene(
    points_per_wavelength: float,
    seed: int,
    bandwidth: int = 256,
    hardness: float = HARDNESS,
) -> Scene:
    """A square period of the paper's roughness with so many points per shortest
    wavelength.
    """
    shape = (round(points_per_wavelength * bandwidth),) * 2
    surface = self_affine(LOWEST, shape, seed, bandwidth, roll_off=4)
    return Scene(surface, Material(MODULUS, 0.0, hardness), Load(MEAN_PRESSURE))


def yielding(scene: Scene) -> Scene:
    """The scene of a J2 body whose yield stress is the hardness over TABOR."""
    stress = scene.material.hardness / TABOR
    return replace(
        scene, material=replace(scene.material, hardness=math.inf, yield_stress=stress)
    )


def area_of(result: ContactResult, part: str, kind: str = "corrected") -> float:
    """One area of the last load step, as a fraction of the nominal area."""
    return float(getattr(result.final.areas[kind], part))


def area_rows(result: ContactResult) -> list[dict[str, Any]]:
    """A row for each part of the corrected area: part, area_fraction and its
    estimated_error.
    """
    kinds = {"area_fraction": "corrected", "estimated_error": "error"}
    return [
        {"part": p} | {k: area_of(result, p, v) for k, v in kinds.items()}
        for p in PARTS
    ]


def binned(
    of: PressureDistribution | None, unit: float, names: tuple[str, str]
) -> pd.DataFrame:
    """The pressures of BINS intervals, in a unit of so many Pa, and the density in
    each.
    """
    assert of is not None
    pressure, density = pressure_density(of, BINS, HARDNESS)
    return pd.DataFrame(
        dict(zip(names, (pressure / unit, density * unit), strict=True))
    )
