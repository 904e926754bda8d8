"""The scenes and laws that studies share: the paper's roughness, material and load.

Self-affine surfaces of Hurst exponent 0.8 and rms slope 1, roll-off at four times the
lowest wave number, E* = 250 GPa, hardness 150 GPa, mean pressure 12.5 GPa (Almqvist and
Persson, "Multiscale contact mechanics for elastoplastic contacts").  `bandwidth` is the
ratio of the highest to the lowest wave number, 256 in the paper.  A narrower band costs
less and keeps p0/(E* xi) = 0.05 and hardness/(E* xi) = 0.6, the only groups on which
small-slope contact depends.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import pandas as pd

import fem_check
from epcontact import bem, persson
from epcontact.output.charts.curves import pressure_density
from epcontact.results import ContactResult, PressureDistribution
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.studies.frame import Rows
from epcontact.surfaces import SelfAffine

#: The lowest wave number in rad/m.
LOWEST = 2.5e4
#: E* (Poisson's ratio is 0), hardness and mean pressure in Pa.
MODULUS = 250e9
HARDNESS = 150e9
MEAN_PRESSURE = 12.5e9
#: The theory's constant energy reduction.
GAMMA = 0.536
PARTS = ("total", "elastic", "plastic")
#: Hardness over yield stress, as in the paper.
TABOR = 3.0
#: The hardness in Pa of each law.
LAWS = {"capped": HARDNESS, "elastic": math.inf}
#: Number of intervals of the pressure, up to the hardness, of a density.
BINS = 40

#: Boundary elements, solved until the areas have settled.
solve_bem = partial(bem.solve, area_tolerance=1e-5)
#: The theory, on the spectrum of the surface itself.
solve_theory = partial(persson.solve, energy_reduction=GAMMA, spectrum="surface")
theory_of = partial(persson.Theory.of_scene, energy_reduction=GAMMA, spectrum="surface")
#: Finite elements of J2 flow, without the certificate, which takes time.
solve_j2 = partial(fem_check.solve, law="j2", certified=False)


def self_affine(
    lowest: float,
    shape: tuple[int, ...],
    seed: int,
    shortest: float,
    roll_off: float = 1.0,
    hurst: float = 0.8,
    slope: float = 1.0,
) -> Surface:
    """Return self-affine roughness whose period is the longest wave.

    Args:
        lowest: Lowest wave number in rad/m.
        shape: Shape of the grid.
        seed: Seed of the random phases.
        shortest: Number of the shortest waves in a period.
        roll_off: Number of the waves of the roll-off in a period.
        hurst: Hurst exponent.
        slope: rms slope.
    """
    spectrum = SelfAffineSpectrum(
        hurst, lowest, roll_off * lowest, shortest * lowest, slope
    )
    periods = (2 * math.pi / lowest,) * len(shape)
    return SelfAffine(spectrum, periods, shape, seed).build()


def rough_scene(
    points_per_wavelength: float,
    seed: int,
    bandwidth: int = 256,
    hardness: float = HARDNESS,
) -> Scene:
    """Return the paper's scene on a square period.

    Args:
        points_per_wavelength: Grid points per shortest wavelength.
        seed: Seed of the surface.
        bandwidth: Number of the shortest waves in a period.
        hardness: In Pa; infinite for an elastic body.
    """
    points = round(points_per_wavelength * bandwidth)
    surface = self_affine(
        LOWEST,
        (points, points),
        seed,
        bandwidth,
        roll_off=4,
    )
    return Scene(surface, Material(MODULUS, 0.0, hardness), Load(MEAN_PRESSURE))


def yielding(scene: Scene) -> Scene:
    """Return the scene with a J2 body instead of a capped one.

    The yield stress is the hardness of the given scene over TABOR; the hardness of the
    new scene is infinite, which means that no cap bounds the pressure.
    """
    yield_stress = scene.material.hardness / TABOR
    material = replace(scene.material, hardness=math.inf, yield_stress=yield_stress)
    return replace(scene, material=material)


def area_of(
    result: ContactResult,
    part: str,
    kind: str = "corrected",
) -> float:
    """Return one area of a result's last load as a fraction of the nominal area.

    `part` is total, elastic or plastic, and `kind` is raw, corrected or error.
    """
    return float(getattr(result.final.areas[kind], part))


def area_rows(result: ContactResult) -> Rows:
    """Return a row for each part of the corrected area of a result.

    The areas are those of the last load, over the nominal area.  Columns: part (total,
    elastic, plastic), area_fraction and its estimated_error.
    """
    rows = []
    for part in PARTS:
        area = area_of(result, part)
        error = area_of(result, part, "error")
        rows.append({"part": part, "area_fraction": area, "estimated_error": error})
    return rows


def binned(
    distribution: PressureDistribution | None, unit: float, names: tuple[str, str]
) -> pd.DataFrame:
    """Return the density of the pressure in BINS intervals up to the hardness.

    Args:
        distribution: Distribution of the pressure in Pa; None fails an assertion.
        unit: Unit of the columns in Pa, such as 1e9 for GPa.
        names: Names of the columns of pressures and densities.

    Returns:
        A row for each interval: its pressure, and the density in 1/unit.
    """
    assert distribution is not None
    pressure, density = pressure_density(distribution, BINS, HARDNESS)
    pressure_name, density_name = names
    columns = {pressure_name: pressure / unit, density_name: density * unit}
    return pd.DataFrame(columns)
