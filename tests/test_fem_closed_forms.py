"""Finite elements against Westergaard, Hertz, published spheres, and the boundary
elements.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import reference_plasticity as reference
from fem_scenes import rough_scene, sphere_scene
from scipy.optimize import brentq

from epcontact import bem
from epcontact.reference import bumps, waves
from epcontact.scene import Load, Material, Scene, Surface
from fem_check import plasticity, solve, solve_path, surface_compliance
from fem_check.vtu import von_mises


def effective(poisson_ratio):
    return 1 / (1 - poisson_ratio**2)


# Elastic waves, spheres and cylinders
# ----------------------------------------------------------


def wave(nodes, shift, load, nu=0.3):
    """(L2 error of the pressure, area error in spacings, peak error) of a sinusoid of
    unit wavelength under `load` times the pressure of complete contact.  At a depth of
    1.5 wavelengths the base changes the wave's compliance by 1e-6.
    """
    x = (np.arange(nodes) + shift) / nodes
    complete = waves.line_complete_pressure(0.01, 1.0, effective(nu))
    surface = Surface(0.01 * np.cos(2 * np.pi * x), (1.0,))
    scene = Scene(surface, Material(1.0, nu), Load(load * complete))
    result = solve(scene, law="elastic", depth=1.5, certified=False)
    found, exact = (
        result.fields["pressure"],
        complete * waves.line_pressure(x - np.round(x), load),
    )
    area = result.final.areas["raw"].total - waves.line_contact_fraction(load)
    error = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    return error, area * nodes, float(found.max() / exact.max() - 1)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_a_rough_body_and_a_rough_punch_in_full_contact_are_mirror_images(nu):
    """To first order in the slope, p0 turned by the punch's slopes adds its share to
    the wave, and p0 on the body's own slopes takes as much away: (1 - 2 nu)/(1 - nu)
    p0/E* (by hand).
    """
    complete = waves.line_complete_pressure(0.004, 1.0, effective(nu))
    surface = Surface(0.004 * np.cos(2 * np.pi * np.arange(32) / 32), (1.0,))
    scene = Scene(surface, Material(1.0, nu), Load(1.5 * complete))
    solved = {
        name: solve(scene, law="elastic", geometry=name)
        for name in ("gap", "moved", "punch")
    }
    gap, *others = (np.fft.fft(r.fields["pressure"])[1].real for r in solved.values())
    share = (1 - 2 * nu) / (1 - nu) * scene.load.final / effective(nu)
    changes = [other / gap - 1 for other in others]
    np.testing.assert_allclose(changes, [-share, share], rtol=0.03, atol=2e-4)


SHIFTS = (np.arange(8) + 0.5) / 8


def test_westergaards_pressure_is_met_with_first_order():
    grids = np.array([64, 128, 256, 512])
    found = np.array([[wave(n, s, 0.3) for s in SHIFTS] for n in grids])
    errors = np.sqrt((found[..., 0] ** 2).mean(axis=1))
    # Order 1 by the square-root edge of the pressure; measured 0.95, and 0.29 % at 256.
    assert -np.polyfit(np.log(grids), np.log(errors), 1)[0] > 0.8
    assert errors[2] < 0.004
    # The peak is free of the edge's error; measured 0.03 %, the grading's share.
    assert np.abs(found[2:, :, 2]).max() < 1.5e-3


@pytest.mark.long
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_the_rim_of_a_line_lies_where_the_areas_say(nu):
    loads = (0.1, 0.2, 0.35, 0.5, 0.7)
    found = [wave(n, s, p, nu)[1] / 2 for n in (96, 128) for p in loads for s in SHIFTS]
    # The counted area jumps by whole nodes (scatter about 0.3 an end, of 80 means:
    # 0.03).
    assert np.mean(found) == pytest.approx(0.25 + 0.21 * nu, abs=0.04)


def test_hertz_spheres_area_is_met_once_the_rim_is_taken_off():
    rng, found = np.random.default_rng(41), []
    force = 4 * effective(0.3) * 0.15**3 / (3 * 10.0)
    exact = bumps.sphere_contact_radius_periodic(force, 10.0, effective(0.3), 1.0)
    for _ in range(8):
        x, y = ((np.arange(64) + s) / 64 - 0.5 for s in rng.random(2))
        surface = Surface(-(x[:, None] ** 2 + y[None, :] ** 2) / 20, (1.0, 1.0))
        scene = Scene(surface, Material(1.0, 0.3), Load(force))
        areas = solve(scene, law="elastic", depth=1.5, certified=False).final.areas
        found.append((areas["raw"].total, areas["corrected"].total))
    raw, corrected = np.mean(found, axis=0) / (math.pi * exact**2)
    # About 9.6 nodes along the radius: the count is 6 to 7 % too large.
    assert 1.04 < raw < 1.09
    assert corrected == pytest.approx(1, abs=0.01)


# J2 spheres: from first yield to full plasticity
# ----------------------------------------------- The sphere is the paraboloid -r^2/(2
# R) on a periodic block, R = E = 1; neighbours at distance L act as extra curvature,
# 1/R_eff = (1/R)(1 + 1.917 (a/L)^3).

SLENDER = 0.05  # contact radius over sphere radius at the Hertzian load: small strains


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_yield_sets_in_where_hertz_and_mises_say(nu):
    """The elastic stresses scale with the pressure, so one solve is enough.  They are
    read at the elements' centres; between the layers the largest one is that of the
    parabola through three.

    The block's sides cannot move apart: a mean pressure p presses them with nu/(1 - nu)
    p, where that of isolated spheres does so with (1 + 2 nu)/2 p in the mean.  The
    tension between the two is taken off: 2 % at L = 8 a.
    """
    force = 4 / 3 * effective(nu) * SLENDER**3
    scene = sphere_scene(force, nodes=64, nodes_to_rim=8, poisson_ratio=nu)
    path = solve_path(scene, law="elastic", certified=False)
    u, problem = path.points[-1].state.displacement.reshape(-1, 3), path.problem
    stress = plasticity.stresses(u, problem.bricks, problem.law, None)
    centre = (
        von_mises(np.moveaxis(stress, 1, 2).mean(axis=1)).reshape(-1, 64**2).max(axis=1)
    )
    depths = -(problem.block.levels[1:] + problem.block.levels[:-1]) / 2
    three = centre.argmax() + np.arange(-1, 2)
    curve = np.polynomial.Polynomial.fit(depths[three], centre[three], 2)
    depth = float(curve.deriv().roots()[0].real)
    radius = SLENDER * (1 + 1.917 * (SLENDER / scene.surface.periods[0]) ** 3) ** (
        -1 / 3
    )
    tension = ((1 + 2 * nu) / 2 - nu / (1 - nu)) * scene.load.final
    pressure = force / (math.pi * radius**2) / (float(curve(depth)) - tension)
    peak, where = reference.sphere_onset(nu)
    # Measured +0.7 to +1.9 %: half of it the grid's, with elements a sixth of a deep
    # there.
    assert pressure == pytest.approx(2 / 3 * peak, rel=0.02)
    assert depth / radius == pytest.approx(where, abs=0.04)


def sphere(severity, nodes_to_rim=10, **offset):
    """(force in N, area in m^2, yield stress in Pa, the area's claim) of the J2 sphere
    whose contact, at about E* a/(sigma_Y R) = `severity`, has so many nodes in radius;
    nu = 0.3.
    """
    yield_stress = effective(0.3) * SLENDER / severity
    # A guess of the load: Hertz below, Johnson's cavity model above, 2.8 Y at most.
    guess = 0.4 * severity if severity < 3.5 else 2 / 3 * (1 + math.log(severity / 3))
    force = min(2.8, guess) * yield_stress * math.pi * SLENDER**2
    nodes = round(6.4 * nodes_to_rim)
    scene = sphere_scene(
        force,
        nodes=nodes,
        nodes_to_rim=nodes_to_rim,
        yield_stress=yield_stress,
        **offset,
    )
    areas, cell = (
        solve(scene, steps=4, certified=False).final.areas,
        scene.surface.periods[0] ** 2,
    )
    return (
        force,
        areas["corrected"].total * cell,
        yield_stress,
        areas["error"].total * cell,
    )


def test_spheres_of_two_nodes_in_radius_are_within_the_claims_of_their_areas():
    """A quarter of the correction alone, without the rounding of the rim, holds 85 of
    100.
    """
    rng, (_, exact, _, _) = np.random.default_rng(7), sphere(42.0)
    found = [sphere(42.0, 2.5, offset=rng.random(2))[1::2] for _ in range(14)]
    assert (
        np.mean([abs(area - exact) < claim < 0.16 * area for area, claim in found])
        > 0.9
    )


@pytest.mark.long
@pytest.mark.parametrize("severity", [3.0, 8.0, 20.0, 42.0])
def test_the_sphere_lies_between_the_published_fits(severity):
    """The fits differ from each other by up to 7 %: no tighter gate would mean
    anything.
    """
    force, area, yield_stress, _ = sphere(severity)
    solid = (1.0, effective(0.3), yield_stress, 0.3)
    for (_, first_force, first_area), fit in (
        (
            reference.kogut_etsion_critical(*solid),
            lambda w: reference.kogut_etsion(w, 0.3),
        ),
        (
            reference.jackson_green_critical(*solid),
            lambda w: reference.jackson_green(w, *solid),
        ),
    ):
        w = brentq(
            lambda x, f=fit, wanted=force / first_force: f(x)[0] - wanted, 1e-2, 1e4
        )
        assert area / (fit(w)[1] * first_area) == pytest.approx(1, abs=0.07)


@pytest.mark.long
def test_the_mean_pressure_rises_along_johnsons_curve():
    found = {}
    for severity in (5.0, 10.0, 20.0, 42.0):
        force, area, yield_stress, _ = sphere(severity)
        found[severity] = force / area / yield_stress
        if severity >= 10.0:
            # The cavity model (Johnson 1970) gives the pressure of a hydrostatic core,
            # a lower estimate; a core that is itself at yield (Studman, Moore and Jones
            # 1977) adds 2/3 Y.
            radius = math.sqrt(area / math.pi)
            core = reference.cavity_mean_pressure(radius, 1.0, 1.0, yield_stress, 0.3)
            assert 0 < found[severity] - core / yield_stress < 1
    assert sorted(found.values()) == list(found.values())
    assert 2.6 < found[42.0] < 2.9  # full plasticity (Johnson 1985)


# Finite elements against boundary elements
# -----------------------------------------------------


@pytest.mark.parametrize("law", ["elastic", "capped"])
@pytest.mark.parametrize("seed", [7, 8, pytest.param(11, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("nodes", "highest", "dimensions"), [(32, 4, 2), (64, 16, 2), (256, 16, 1)]
)
@pytest.mark.parametrize("pressure", [0.02, 0.2])
def test_on_the_same_body_they_agree_node_by_node(
    law, seed, nodes, highest, dimensions, pressure
):
    scene = rough_scene(
        nodes, highest, dimensions=dimensions, seed=seed, pressure=pressure
    )
    if law == "elastic":
        scene = replace(scene, material=replace(scene.material, hardness=math.inf))
    fem = solve(scene, law=law, certified=False).fields
    other = bem.solve(scene, compliance=surface_compliance(scene), threads=1).fields
    np.testing.assert_array_equal(fem["state"], other["state"])
    rms = scene.surface.heights.std()
    for name, unit in {"pressure": 1.0, "gap": rms, "displacement": rms}.items():
        assert np.abs(fem[name] - other[name]).max() < 1e-6 * unit  # both solve to 1e-8
