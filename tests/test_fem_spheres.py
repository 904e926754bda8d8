"""A J2 sphere from first yield to full plasticity, against theory and two published fits."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference_plasticity as reference
from fem_spheres import SphereAnswer, sphere, sphere_onset
from scipy.optimize import brentq


def onset_errors(poisson_ratio: float, **grid: int) -> tuple[float, float]:
    """Of the mean pressure at first yield, relative, and of its depth, over a."""
    pressure, depth = sphere_onset(poisson_ratio=poisson_ratio, **grid)
    peak, where = reference.sphere_onset(poisson_ratio)
    return pressure / (2 / 3 * peak) - 1, depth - where


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.2, 0.3, 0.4, 0.45])
def test_yield_sets_in_where_hertz_and_mises_say(poisson_ratio: float) -> None:
    pressure, depth = onset_errors(poisson_ratio, nodes=64, nodes_to_rim=8)
    # Measured +0.7 to +1.9 %: half of it the grid's, with elements a sixth of a deep there.
    assert abs(pressure) < 0.02
    assert abs(depth) < 0.04


def test_the_neighbours_of_a_sphere_are_taken_off() -> None:
    """With nu = 0 the sides of the block would let a sphere at L = 8 a yield 1.6 % before one at
    16 a."""
    near = onset_errors(0.0, nodes=32, nodes_to_rim=4)
    far = onset_errors(0.0, nodes=64, nodes_to_rim=4)
    assert abs(near[0] - far[0]) < 0.005


@pytest.mark.slow
def test_the_onset_of_yield_converges() -> None:
    """Where it is hardest to resolve: with nu = 0 yield sets in nearest to the surface."""
    grids = [(24, 3, 18), (48, 6, 36), (96, 12, 72)]
    errors = [onset_errors(0.0, nodes=n, nodes_to_rim=r, layers=k) for n, r, k in grids]
    pressures, depths = np.abs(errors).T
    # Better than first order: 4.4, 1.1, 0.44 %.
    assert (np.log2(pressures[:-1] / pressures[1:]) > 1.2).all()
    assert pressures[-1] < 0.005
    assert (depths[1:] < depths[:-1] / 2).all()


def fits(answer: SphereAnswer, poisson_ratio: float) -> tuple[float, float]:
    """Computed area over Kogut and Etsion's, and over Jackson and Green's, at equal force."""
    effective = 1 / (1 - poisson_ratio**2)
    solid = (1.0, effective, answer.yield_stress, poisson_ratio)
    ratios = []
    for critical, fit in (
        (
            reference.kogut_etsion_critical(*solid),
            lambda w: reference.kogut_etsion(w, poisson_ratio),
        ),
        (
            reference.jackson_green_critical(*solid),
            lambda w: reference.jackson_green(w, *solid),
        ),
    ):
        wanted = answer.force / critical[1]
        w = brentq(lambda x, f=fit, t=wanted: f(x)[0] - t, 1e-2, 1e4)
        ratios.append(answer.area / (fit(w)[1] * critical[2]))
    return ratios[0], ratios[1]


@pytest.mark.long
@pytest.mark.parametrize("severity", [3.0, 8.0, 20.0, 42.0])
def test_the_sphere_lies_between_the_published_fits(severity: float) -> None:
    """The fits differ from each other by up to 7 %: no tighter gate would mean anything."""
    answer = sphere(severity)
    for ratio in fits(answer, 0.3):
        assert ratio == pytest.approx(1, abs=0.07)


@pytest.mark.long
def test_the_mean_pressure_rises_along_johnsons_curve() -> None:
    answers = [sphere(x) for x in (2.0, 5.0, 10.0, 20.0, 42.0)]
    pressures = [a.mean_pressure for a in answers]
    assert pressures == sorted(pressures)
    # Elastic below first yield at p_m = 1.075 sigma_Y: 4/(3 pi) of the severity.
    assert pressures[0] == pytest.approx(4 / (3 * math.pi) * answers[0].severity, rel=0.02)
    # Full plasticity, 2.6 to 2.9 sigma_Y at a severity of 40 (Johnson 1985).
    assert 35 < answers[-1].severity < 45
    assert 2.6 < pressures[-1] < 2.9
    for a in answers[2:]:
        # The cavity model (Johnson 1970) gives the pressure of a hydrostatic core, a lower
        # estimate; a core that is itself at yield (Studman, Moore and Jones 1977) adds 2/3 Y.
        radius = math.sqrt(a.area / math.pi)
        core = reference.cavity_mean_pressure(radius, 1.0, 1.0, a.yield_stress, 0.3)
        excess = a.mean_pressure - core / a.yield_stress
        assert 0 < excess < 1


@pytest.mark.long
def test_the_answer_does_not_depend_on_the_grid() -> None:
    coarse = sphere(20.0, nodes=48, nodes_to_rim=6)
    fine = sphere(20.0, nodes=96, nodes_to_rim=14)
    assert coarse.mean_pressure == pytest.approx(fine.mean_pressure, rel=0.03)
