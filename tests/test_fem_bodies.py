"""Plasticity without contact, and limit loads: what no half-block can show."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import reference_plasticity as reference
from fem_bodies import circular_punch, thick_cylinder, thick_sphere

from fem_check.benchmarks.limit_loads import strip_punch


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.499])
def test_the_thick_sphere_follows_hill_to_collapse(poisson_ratio: float) -> None:
    curve = thick_sphere(20, poisson_ratio=poisson_ratio)
    # 20 elements: measured 0.1 %; the last steps stand on the limit 2 Y ln(b/a).
    np.testing.assert_allclose(curve.computed, curve.exact, rtol=2e-3)
    assert curve.exact[-1] == pytest.approx(2 * math.log(2))
    assert curve.computed[-1] == pytest.approx(curve.computed[-2], rel=1e-6)


def test_the_thick_spheres_error_falls_with_second_order() -> None:
    counts = np.array([8, 16, 32])
    errors = [abs(thick_sphere(int(n)).computed[-1] / (2 * math.log(2)) - 1) for n in counts]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order > 1.7
    assert errors[-1] < 1e-3


def test_its_exact_curve_is_the_references() -> None:
    curve = thick_sphere(8)
    c = 1.3
    exact = reference.thick_sphere_pressure(c, 1.0, 2.0, 1.0)
    hill = 2 * math.log(c) + 2 / 3 * (1 - (c / 2) ** 3)
    assert exact == pytest.approx(hill)
    assert (np.diff(curve.exact) >= 0).all()


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.499])
def test_the_thick_cylinder_collapses_at_its_limit(poisson_ratio: float) -> None:
    curve = thick_cylinder(20, poisson_ratio=poisson_ratio)
    # nu = 0.3 still creeps up by 1e-4 a step at this push; 20 elements err by 0.05 %.
    assert curve.computed[-1] == pytest.approx(curve.exact[-1], rel=2e-3)


def test_newton_converges_quadratically() -> None:
    """Each residual is at most a constant times the square of the one before, near the end."""
    residuals = thick_sphere(20).newton[4]
    assert residuals[-1] < 1e-9
    last = [r for r in residuals if 1e-13 < r < 1e-2]
    assert len(last) >= 2
    for before, after in itertools.pairwise(last):
        # 0.1 of blending by the residual is itself quadratic.
        assert after < 10 * before**2


@pytest.mark.long
def test_prandtls_punch_is_met_by_richardson_at_every_poisson_ratio() -> None:
    limits = {}
    for nu in (0.0, 0.3, 0.499):
        coarse, fine = (strip_punch(n, poisson_ratio=nu) for n in (4, 8))
        limits[nu] = fine.computed[-1]
        exact = reference.strip_limit_pressure(1.0)
        assert exact == pytest.approx(fine.exact[-1])
        assert fine.computed[-1] / exact - 1 < 0.045
        # First order in h, the effective half-width being a + 0.31 h.
        assert 2 * fine.computed[-1] - coarse.computed[-1] == pytest.approx(exact, rel=5e-3)
        # A plateau: the load has stopped climbing.
        assert fine.computed[-1] == pytest.approx(fine.computed[-2], rel=2e-3)
    assert max(limits.values()) / min(limits.values()) - 1 < 1e-3


@pytest.mark.slow
def test_the_circular_punch_lies_in_its_bracket() -> None:
    coarse, fine = (circular_punch(n).computed[-1] for n in (4, 8))
    low, high = reference.circular_punch_bracket(1.0)
    assert low == pytest.approx(2.845, rel=1e-3)
    assert low < 2 * fine - coarse < high
