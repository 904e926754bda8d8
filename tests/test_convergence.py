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


def shifted_wave(points: int, shift: float) -> Scene:
    """One wave on a line, its crest `shift` spacings from a grid point."""
    x = (np.arange(points) - shift) / points
    complete = waves.line_complete_pressure(1e-6, 1e-3, STIFFNESS)
    surface = Surface(1e-6 * np.cos(2 * np.pi * x), (1e-3,))
    return Scene(surface, MATERIAL, Load(SHARE * complete))


def wave_errors(points: int, shift: float) -> dict[str, float]:
    result = bem.solve(shifted_wave(points, shift), threads=1)
    complete = waves.line_complete_pressure(1e-6, 1e-3, STIFFNESS)
    x = (np.arange(points) - shift) / points
    exact = complete * waves.line_pressure(x, SHARE)
    area = waves.line_contact_fraction(SHARE)
    final = result.final
    return {
        "pressure": float(
            np.linalg.norm(result.fields["pressure"] - exact) / np.linalg.norm(exact)
        ),
        "raw": abs(final.areas["raw"].total / area - 1),
        "corrected": abs(final.areas["corrected"].total / area - 1),
        "gap": abs(final.quantities["mean_gap"] / (1e-6 * waves.line_mean_gap(SHARE)) - 1),
    }


@pytest.fixture(scope="module")
def wave_study() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    sizes = np.array([64, 128, 256, 512, 1024])
    shifts = (np.arange(16) + 0.5) / 16
    errors = [[wave_errors(int(n), float(s)) for s in shifts] for n in sizes]
    return 1 / sizes, {
        name: np.array([[e[name] for e in row] for row in errors]) for name in errors[0][0]
    }


@pytest.mark.parametrize(
    ("quantity", "order", "cap"),
    [
        # The least order, and the largest root mean square of the error at 1024 points.
        # Measured over 16 shifts: 0.99 and 5.2e-4, 0.87 and 1.5e-3, 2.04 and 2.8e-7, 2.05 and
        # 2.0e-6, orders with standard errors of 0.03, 0.09, 0.20 and 0.19.
        ("pressure", 0.9, 8e-4),
        ("raw", 0.7, 2.5e-3),
        ("corrected", 1.6, 5e-7),
        ("gap", 1.6, 4e-6),
    ],
)
def test_order_on_westergaard(wave_study, quantity, order, cap) -> None:
    spacings, errors = wave_study
    found = np.sqrt(np.mean(errors[quantity] ** 2, axis=1))
    assert observed_order(spacings, found) > order
    assert found[-1] < cap


def test_order_on_hertz() -> None:
    # Measured over 16 places of the sphere: raw 1.02 and 4.9e-3, corrected 1.67 and 4.4e-4.
    radius = 0.2e-3
    force = bumps.sphere_force(radius, 1e-2, STIFFNESS)
    size = bumps.sphere_contact_radius_periodic(force, 1e-2, STIFFNESS, 1e-3)
    exact = math.pi * (size / 1e-3) ** 2
    rng = np.random.default_rng(0)
    raw, corrected = [], []
    sizes = (32, 64, 128, 256)
    for n in sizes:
        found = []
        for _ in range(16):
            recipe = Paraboloid((1e-3, 1e-3), (n, n), 1e-2, tuple(rng.random(2)))
            scene = Scene(recipe.build(), MATERIAL, Load(force / 1e-6))
            found.append(bem.solve(scene, threads=1).final.areas)
        raw.append([abs(a["raw"].total / exact - 1) for a in found])
        corrected.append([abs(a["corrected"].total / exact - 1) for a in found])
    spacings = 1 / np.array(sizes)
    raw, corrected = (np.sqrt(np.mean(np.square(e), axis=1)) for e in (raw, corrected))
    assert observed_order(spacings, raw) > 0.9
    assert raw[-1] < 6e-3
    assert observed_order(spacings, corrected) > 1.3
    assert corrected[-1] < 8e-4


def test_energy_of_a_strip_punch_converges_to_the_closed_form() -> None:
    # Singular at the rim: first order, and no single grid is near.
    energy = []
    for points in (80, 160, 320):
        recipe = FlatPunch((1e-3,), (points,), 0.3e-3, 1e-5)
        result = bem.solve(Scene(recipe.build(), MATERIAL, Load(1e8)), threads=1)
        energy.append(result.final.quantities["elastic_energy"])
    exact = -(1e8**2) * 1e-3 / (math.pi * STIFFNESS) * math.log(math.sin(0.3 * math.pi))
    first, second = np.diff(energy)
    assert math.log2(first / second) == pytest.approx(1.0, abs=0.1)
    assert abs(energy[-1] / exact - 1) > 5e-3
    # Richardson's limit at the observed order.
    assert energy[-1] + second / (first / second - 1) == pytest.approx(exact, rel=2e-4)
