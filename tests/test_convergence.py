"""Orders of convergence of the boundary elements against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from epcontact import bem
from epcontact.output.charts.plot import observed_order
from epcontact.reference import bumps, waves
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.surfaces import FlatPunch, Paraboloid

MATERIAL = Material(young_modulus=2.0e11, poisson_ratio=0.3)
STIFFNESS = 2.0e11 / (1 - 0.3**2)
SHARE = 0.3  # of the pressure of complete contact
PLACES = np.column_stack([(np.arange(16) + 0.5) / 16, np.random.default_rng(0).random(16)])


def on_a_wave(points: int, place: np.ndarray) -> list[float]:
    """Errors on one wave, its crest a share of a spacing from a grid point."""
    complete = waves.line_complete_pressure(1e-6, 1e-3, STIFFNESS)
    x = (np.arange(points) - place[0]) / points
    surface = Surface(1e-6 * np.cos(2 * np.pi * x), (1e-3,))
    result = bem.solve(Scene(surface, MATERIAL, Load(SHARE * complete)), threads=1)
    exact = complete * waves.line_pressure(x, SHARE)
    areas, area = result.final.areas, waves.line_contact_fraction(SHARE)
    return [
        float(np.linalg.norm(result.fields["pressure"] - exact) / np.linalg.norm(exact)),
        areas["raw"].total / area - 1,
        areas["corrected"].total / area - 1,
        result.final.quantities["mean_gap"] / (1e-6 * waves.line_mean_gap(SHARE)) - 1,
    ]


def on_a_sphere(points: int, place: np.ndarray) -> list[float]:
    """Errors of the areas of a sphere at a place."""
    force = bumps.sphere_force(0.2e-3, 1e-2, STIFFNESS)
    radius = bumps.sphere_contact_radius_periodic(force, 1e-2, STIFFNESS, 1e-3)
    recipe = Paraboloid((1e-3, 1e-3), (points, points), 1e-2, tuple(place))
    areas = bem.solve(Scene(recipe.build(), MATERIAL, Load(force / 1e-6)), threads=1).final.areas
    exact = math.pi * (radius / 1e-3) ** 2
    return [areas[kind].total / exact - 1 for kind in ("raw", "corrected")]


# The least order of each error, and its largest root mean square on the finest grid.
# Pressure, raw and corrected area, gap; the areas of the sphere.
ON_A_WAVE = [(0.9, 8e-4), (0.7, 2.5e-3), (1.6, 5e-7), (1.6, 4e-6)]
ON_A_SPHERE = [(0.9, 6e-3), (1.3, 8e-4)]


@pytest.mark.parametrize(
    ("errors", "sizes", "bounds"),
    [
        (on_a_wave, 2 ** np.arange(6, 11), ON_A_WAVE),
        (on_a_sphere, 2 ** np.arange(5, 9), ON_A_SPHERE),
    ],
)
def test_orders(errors, sizes, bounds) -> None:
    found = np.array([[errors(int(n), place) for place in PLACES] for n in sizes])
    rms = np.sqrt(np.mean(found**2, axis=1))
    for column, (order, most) in zip(rms.T, bounds, strict=True):
        assert observed_order(1 / sizes, column) > order
        assert column[-1] < most


def test_energy_of_a_strip_punch_converges_to_the_closed_form() -> None:
    """The pressure is singular at the rim: first order, and Richardson's limit of it is right."""
    recipes = [FlatPunch((1e-3,), (points,), 0.3e-3, 1e-5) for points in (80, 160, 320)]
    scenes = [Scene(recipe.build(), MATERIAL, Load(1e8)) for recipe in recipes]
    energy = [bem.solve(s, threads=1).final.quantities["elastic_energy"] for s in scenes]
    exact = -(1e8**2) * 1e-3 / (math.pi * STIFFNESS) * math.log(math.sin(0.3 * math.pi))
    first, second = np.diff(energy)
    assert math.log2(first / second) == pytest.approx(1.0, abs=0.1)
    assert energy[-1] + second / (first / second - 1) == pytest.approx(exact, rel=2e-4)
