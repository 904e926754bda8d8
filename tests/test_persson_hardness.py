"""The moving wall: an exact solution, constant hardness, orders, force, refusals."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from epcontact.errors import InvalidScene
from epcontact.persson import (
    EnergyReduction,
    Theory,
    analytic_roughness,
    areas,
    hardness_curve,
)
from epcontact.persson.moving_wall import StressState, evolve, start, unfelt_diffusion
from epcontact.persson.roughness import surface_roughness
from epcontact.scene import SelfAffineSpectrum
from epcontact.surfaces import SelfAffine

SPECTRUM = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 1.0)


def body(roughness, rule="constant"):
    return Theory(roughness, 250e9, EnergyReduction(0.536, rule))


METAL = body(analytic_roughness(SPECTRUM))


def run(state, diffusion, hardness):
    return deque(evolve(state, diffusion, hardness), maxlen=1).pop()


# ---- an exact solution ---------------------------------------------------------------------


def self_similar(kappa, cells, steps, growth=20.0):
    """A wall at Y = sqrt(2 kappa G): Q = (Y_0/Y) x exp(-kappa x^2/2), A_pl = Q(1) / kappa.

    It solves dQ/dG = d/dx (Q'/Y^2 + (Y'/Y) x Q) with Q(0) = 0, Q(1) = Y Y' A_pl = kappa A_pl and
    dA_pl/dG = J(1), and keeps the force Y (int x Q dx + A_pl).
    """
    x = np.linspace(0, 1, cells + 1)
    mean = -np.diff(np.exp(-kappa * x**2 / 2)) / kappa * cells
    plastic = math.exp(-kappa / 2) / kappa
    G = np.geomspace(1, growth, steps + 1) / (2 * kappa)
    Y = np.sqrt(2 * kappa * G)
    end = run(StressState(mean, plastic, 1.0), G, Y)
    force = StressState(mean, plastic, 1.0).mean_pressure
    return end, mean / Y[-1], plastic / Y[-1], force


@pytest.mark.parametrize("kappa", [0.5, 2.0])
def test_the_self_similar_solution_with_second_order(kappa):
    density, plastic = [], []
    for n in (128, 256, 512):
        end, exact, exact_plastic, force = self_similar(kappa, n, n)
        density.append(np.abs(end.density / exact - 1).max())
        plastic.append(abs(end.plastic / exact_plastic - 1))
        assert abs(end.mean_pressure / force - 1) < 1e-10
    orders = np.log2(np.divide(density[:-1], density[1:]))
    assert np.all(orders > 1.8)
    assert density[-1] < 1e-4
    # Here errors of either sign pass through zero, so the cap alone is sharp.
    assert plastic[-1] < 5e-5


# ---- constant hardness ---------------------------------------------------------------------


def test_constant_hardness_is_the_closed_form_with_second_order():
    p0, Y, G_end = 12.5, 150.0, 4187.5
    first, exact = unfelt_diffusion(p0, Y), areas(G_end, p0, Y)
    errors = []
    for n in (128, 256, 512):
        end = run(start(first, p0, Y, n), np.geomspace(first, G_end, n + 1), np.full(n + 1, Y))
        errors.append([abs(end.elastic - exact.elastic), abs(end.plastic - exact.plastic)])
        assert_allclose(end.separated, exact.separated, rtol=0, atol=1e-4)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 1.8) & (orders < 2.3))
    assert np.max(errors[-1]) < 2e-6


def test_a_constant_law_is_the_magnification_curve():
    found = hardness_curve(METAL, 12.5e9, lambda z: np.full(z.shape, 150e9))
    exact = replace(METAL, hardness=150e9).magnification_curve(12.5e9, found.areas.magnification)
    assert_allclose(found.areas.elastic, exact.elastic, rtol=0, atol=1e-6)
    assert_allclose(found.areas.plastic, exact.plastic, rtol=0, atol=1e-6)
    assert found.force_error < 1e-10


def test_the_start_is_the_elastic_closed_form():
    p0, Y = 12.5, 150.0
    G = unfelt_diffusion(p0, Y)
    state = start(G, p0, Y, 1024)
    assert_allclose(state.elastic, areas(G, p0).elastic, rtol=1e-14)
    assert_allclose(state.mean_pressure, p0, rtol=1e-13)
    assert areas(G, p0, Y).plastic < 1e-15


# ---- growing hardness ----------------------------------------------------------------------


def law(zeta):
    return 100e9 * zeta**0.15


def test_a_growing_hardness_converges_with_second_order_and_keeps_the_force():
    found = [
        hardness_curve(METAL, 12.5e9, law, [16.0, 256.0], (n, n // 2))
        for n in (128, 256, 512, 1024)
    ]
    for name in ("elastic", "plastic"):
        values = np.array([getattr(f.areas, name) for f in found])
        changes = np.abs(np.diff(values, axis=0))
        orders = np.log2(changes[:-1] / changes[1:])
        assert np.all(orders > 1.7), name
        assert np.all(changes[-1] < 1e-5)
    assert max(f.force_error for f in found) < 1e-10


def test_a_growing_hardness_leaves_less_plastic_area_than_its_own_value_kept_throughout():
    """The lower caps passed on the way left less spread of the pressures, d<p^2> = 2 A_el dG.

    The pressures are a martingale under either wall; the one that was capped earlier is the
    smaller in convex order, and so is what it has at the common cap.
    """
    found = hardness_curve(METAL, 12.5e9, law)
    kept = areas(found.areas.diffusion, 12.5e9, found.hardness)
    assert np.all(found.areas.plastic <= kept.plastic + 1e-6)
    assert found.areas.plastic[-1] < 0.8 * kept.plastic[-1]


def test_the_distribution_and_the_plastic_area_carry_the_load():
    curve = hardness_curve(METAL, 12.5e9, law)
    table, hardness = curve.pressures, curve.hardness[-1]
    assert_allclose(table.pressure[-1], hardness, rtol=1e-14)
    assert_allclose(table.cumulative[-1], curve.areas.elastic[-1], rtol=1e-13)
    middle = 0.5 * (table.pressure[1:] + table.pressure[:-1])
    force = middle @ np.diff(table.cumulative) + hardness * table.plastic
    assert_allclose(force, 12.5e9, rtol=1e-10)
    assert np.all(table.density >= 0)


def test_a_moving_wall_is_not_absorbing():
    """P(Y) = (dY/dG) A_pl > 0 where the hardness grows: the density does not vanish there."""
    end, exact, plastic, _ = self_similar(2.0, 256, 256)
    assert_allclose(1.5 * end.density[-1] - 0.5 * end.density[-2], 2.0 * plastic, rtol=1e-3)
    assert exact[-1] > 0


def test_a_kink_in_the_hardness_does_not_ring():
    def kinked(z):
        return np.where(z < 16, 100e9, 100e9 * (z / 16) ** 0.3)

    curve = hardness_curve(METAL, 12.5e9, kinked)
    assert np.all(curve.pressures.density >= 0)
    late = curve.areas.plastic[curve.areas.magnification > 20]
    assert np.all(np.diff(late, 2) > -1e-5)
    assert curve.force_error < 1e-10


def test_light_roughness_feels_no_wall():
    smooth = analytic_roughness(SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 0.01))
    curve = hardness_curve(body(smooth), 12.5e9, law)
    assert np.all(curve.areas.plastic == 0)
    assert curve.pressures is None
    assert_allclose(curve.areas.elastic, areas(curve.areas.diffusion, 12.5e9).elastic)


def test_a_surface_of_its_own_spectrum_is_near_its_analytic_one():
    spectrum = SelfAffineSpectrum(0.8, 1e5, 1e5, 32e5, 1.0)
    surface = SelfAffine(spectrum, (2 * math.pi / 1e5,) * 2, (128, 128), 4).build()
    own = hardness_curve(body(surface_roughness(surface)), 12.5e9, law, [16.0])
    smooth = hardness_curve(body(analytic_roughness(spectrum)), 12.5e9, law, [16.0])
    # Half the band: the share of slope below differs by the sampling of the long waves.
    assert_allclose(own.areas.plastic, smooth.areas.plastic, rtol=0.15)
    assert own.force_error < 1e-10


# ---- refusals ------------------------------------------------------------------------------


def test_a_falling_hardness_is_refused_with_the_reason():
    with pytest.raises(InvalidScene, match="force"):
        hardness_curve(METAL, 12.5e9, lambda z: 150e9 * z**-0.01)
    state = start(1.0, 12.5, 150.0, 1024)
    with pytest.raises(InvalidScene, match="must not decrease"):
        run(state, np.array([1.0, 2.0]), np.array([150.0, 149.0]))


def test_hardness_without_roughness_is_refused():
    state = start(1.0, 12.5, 150.0, 1024)
    with pytest.raises(InvalidScene, match="rate"):
        run(state, np.array([1.0, 1.0]), np.array([150.0, 151.0]))


@pytest.mark.parametrize(
    ("hardness", "magnifications", "resolution", "words"),
    [
        (lambda z: 10e9 * z, None, (1024, 400), "mean_pressure"),
        (lambda z: 150e9 * z * np.nan, None, (1024, 400), "positive"),
        (law, [0.5, 2.0], (1024, 400), "ascend"),
        (law, [4.0, 2.0], (1024, 400), "ascend"),
        (law, [2.0, 1e6], (1024, 400), "ascend"),
        (law, None, (16, 400), "cells"),
    ],
)
def test_other_nonsense_is_refused(hardness, magnifications, resolution, words):
    with pytest.raises(InvalidScene, match=words):
        hardness_curve(METAL, 12.5e9, hardness, magnifications, resolution)


def test_a_reduction_that_depends_on_the_area_is_refused():
    with pytest.raises(InvalidScene, match="must be constant"):
        hardness_curve(body(METAL.roughness, "persson"), 12.5e9, law)


def test_a_late_start_is_refused():
    with pytest.raises(InvalidScene, match="start"):
        start(2000.0, 12.5, 150.0, 1024)
