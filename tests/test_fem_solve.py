"""Solved scenes: laws, geometries, bodies, load paths, files and refusals."""

import math
import re
import tracemalloc
from dataclasses import replace
from unittest.mock import DEFAULT, Mock

import numpy as np
import pytest
from fem_scenes import rough_scene
from limit_load import STRIP_LIMIT

import fem_check
from epcontact.errors import (
    InvalidScene,
    NotConverged,
    NotEnoughMemory,
    OutputError,
    SurfaceWarning,
)
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.studies.hardness import model_scene
from fem_check import FemOptions, increments, mesh_of, newton, plasticity, vtu
from fem_check.driver import problem_of, solve_path
from fem_check.free_flow import FlowsFreely, require_equilibrium
from fem_check.mesh import bytes_needed
from fem_check.result import contact_result, nodes_across


def solve(scene, **options):
    """Return the `ContactResult` of `fem_check.solve` without the certificate, which is
    slow.

    `options` are fields of `FemOptions`, such as law="capped" or steps=4, and arguments
    of `fem_check.solve`. The default law is J2 flow.
    """
    return fem_check.solve(scene, certified=False, **options)


def solve_loads(scene, *loads, **options):
    """Return the result of a scene at a path of mean pressures.

    `loads` are the mean pressures in units of E* xi, in the order of the path;
    `options` are those of `solve`.
    """
    return solve(replace(scene, load=Load(loads)), **options)


def with_hardening(scene, **hardening):
    """Return the scene with other values of `hardening_modulus` (Pa) or
    `hardening_curve`, which are the keywords `hardening` of its material.
    """
    return replace(scene, material=replace(scene.material, **hardening))


def force_difference(result, other):
    """Return the relative L1 difference of two pressure fields, sum |p - q| / sum q.

    `result` has the pressures p and `other` the pressures q, on the same grid; 0 means
    equal pressures.
    """
    pressure = result.fields["pressure"]
    other_pressure = other.fields["pressure"]
    return np.abs(pressure - other_pressure).sum() / other_pressure.sum()


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("geometry", ["gap", "moved", "punch"])
@pytest.mark.parametrize("law", ["elastic", "capped", "j2"])
@pytest.mark.parametrize(
    "body", [Body(), Body("bonded_layer", 0.3), Body("sliding_layer", 0.3)]
)
def test_every_law_geometry_and_body_converges_and_is_certified(
    dimensions, geometry, law, body
):
    """Each law, geometry and body converges to 1e-7, and its fields fit their states.

    The pressure has the mean of 0.05 (in units of E* xi), is 0 apart from the contact,
    and equals the hardness where a capped body flows; gaps are positive only apart from
    the contact. A rough punch on a sliding layer is refused, since it would slide away.
    """
    hardness = 0.15 if dimensions == 1 else 0.4  # below the elastic peak
    scene = rough_scene(16, 2, dimensions=dimensions, body=body, hardness=hardness)
    if geometry == "punch" and body.kind == "sliding_layer":
        with pytest.raises(InvalidScene, match="would slide away"):
            fem_check.solve(scene, law=law, geometry=geometry)
        return
    result = fem_check.solve(scene, law=law, geometry=geometry)
    final = result.final
    assert max(final.residuals.values()) < 1e-7
    # scikit-fem's own assembly of the stresses balances the contact forces.
    assert final.residuals["certified_balance"] < 1e-8
    pressure = result.fields["pressure"]
    gap = result.fields["gap"]
    touching = result.fields["state"] != APART
    plastic = result.fields["state"] == PLASTIC
    assert pressure.mean() == pytest.approx(0.05, rel=1e-7)
    assert (pressure[~touching] == 0).all()
    assert (gap[~touching] > 0).all()
    assert plastic.any() == (law != "elastic")
    assert (final.areas["error"].plastic > 0) == (law != "elastic")
    if law == "capped":
        assert (gap[touching] <= 1e-9).all()
        np.testing.assert_allclose(pressure[plastic], hardness, rtol=1e-12)
    else:
        assert (gap[touching] <= 0).all()


# --- symmetries and limits


def shift(field):
    """Return the (nx, ny) field shifted by 3 and 5 nodes around its periodic edges."""
    return np.roll(field, (3, 5), (0, 1))


@pytest.mark.parametrize("move", [shift, np.flipud, np.transpose, np.rot90])
def test_the_answer_does_not_depend_on_place_and_orientation(move):
    """A surface that is shifted, mirrored or turned has the pressures moved alike.

    `move` maps an (n, n) field to the moved field.
    """
    scene = rough_scene(16, 3)
    moved = Surface(move(scene.surface.heights), (1.0, 1.0))
    pressure = solve(scene).fields["pressure"]
    of_moved = solve(replace(scene, surface=moved)).fields["pressure"]
    np.testing.assert_allclose(of_moved, move(pressure), atol=1e-6)


def test_the_answer_does_not_depend_on_the_scale_of_the_slope():
    """Pressures over E* xi do not change with the slope, at equal p0/(E* xi) and
    sigma_Y/(E* xi).

    p0 is the mean pressure, E* the effective modulus, xi the rms slope, sigma_Y the
    yield stress, and the geometry is `gap`.
    """
    pressure = solve(rough_scene(16, 3)).fields["pressure"]
    flatter = solve(rough_scene(16, 3, slope=0.005)).fields["pressure"]
    np.testing.assert_allclose(flatter, pressure, atol=1e-6)


def test_a_line_is_a_ridge_in_plane_strain():
    """A profile of 32 nodes has the pressures of a surface that is constant along y."""
    line = rough_scene(32, 4, dimensions=1)
    ridge = np.repeat(line.surface.heights[:, None], 2, 1)
    surface = Surface(ridge, (1.0, 2 / 32))
    of_line = solve(line, depth=0.9).fields["pressure"]
    of_ridge = solve(replace(line, surface=surface), depth=0.9).fields["pressure"]
    np.testing.assert_allclose(of_ridge, np.stack([of_line, of_line], 1), atol=1e-7)


def test_hardening_bears_more_on_less():
    """Linear hardening lowers the contact area and raises the largest pressure.

    The hardening modulus is 5, in units of E* xi (the yield stress is 0.2).
    """
    perfect = solve(rough_scene(16, 2)).final
    hardening = solve(with_hardening(rough_scene(16, 2), hardening_modulus=5.0)).final
    assert hardening.areas["raw"].total < perfect.areas["raw"].total
    largest = "largest_pressure"
    assert hardening.quantities[largest] > perfect.quantities[largest]


@pytest.mark.parametrize("geometry", ["moved", "punch"])
@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_rough_bodies_and_punches_tend_to_the_gap_as_the_slope_vanishes(law, geometry):
    """Pressures of the geometries `moved` and `punch` differ from `gap` in proportion
    to the slope.

    The rms slopes 0.0125 and 0.2 are compared at equal ratios of mean pressure and
    yield stress to E* times the rms slope; the fitted power of the slope is between 0.8
    and 1.8.
    """
    differences = []
    for slope in (0.0125, 0.2):
        scene = rough_scene(12, 2, slope=slope, pressure=0.2)
        gap = solve(scene, law=law)
        other = solve(scene, law=law, geometry=geometry)
        differences.append(force_difference(other, gap))
    at_small, at_large = differences
    assert at_small < 0.02 < at_large
    assert 0.8 < math.log(at_large / at_small, 16) < 1.8


def test_j2_flow_is_elastic_again_where_the_surface_has_not_yielded():
    """A node is reported as plastic if it touches and one of the four elements below it
    has yielded.

    A touching node above elastic elements is elastic, and every other node is apart.
    """
    path = solve_path(rough_scene(16, 3))
    point = path.points[-1]
    # The first 16 x 16 elements are the top layer; rows are 0 where none has yielded.
    rows = path.history.rows[:256].reshape(16, 16)
    for i, j in np.ndindex(16, 16):
        around = rows[[i - 1, i - 1, i, i], [j - 1, j, j - 1, j]]
        expected = APART
        if point.state.states[i, j] == ELASTIC:
            expected = ELASTIC
            if around.any():
                expected = PLASTIC
        assert point.surface_states[i, j] == expected


def test_the_figures_of_j2_flow_follow_from_its_gauss_points():
    """Strains, depth, volume and work of J2 flow are sums over yielded Gauss points.

    All Gauss points of an element have the same volume. The grid has 16 x 16 = 256
    columns of unit total area, and the yield stress is 0.2 E* xi.
    """
    path = solve_path(rough_scene(16, 3))
    thickness = -np.diff(path.problem.block.levels)
    flowed = np.flatnonzero(path.history.rows)
    layer = flowed // 256
    strain = path.history.accumulated[path.history.rows[flowed]]
    has_flowed = strain > 0
    assert 0 < has_flowed.mean() < 1
    final = contact_result(path).final
    volume = thickness[layer] @ has_flowed.mean(axis=1)
    expected = {
        "largest_plastic_strain": strain.max(),
        "plastic_depth": thickness[: layer.max() + 1].sum(),
        "plastic_volume": volume / thickness.sum() / 256,
        "plastic_work": 0.2 * thickness[layer] @ strain.mean(axis=1) / 256,
    }
    quantities = {name: final.quantities[name] for name in expected}
    assert quantities == pytest.approx(expected, rel=1e-9)


def test_unloading_is_elastic_at_first_and_leaves_its_mark():
    """J2 flow on a path with two unloadings: no new strain, more contact, a residual
    approach.
    """
    scene = rough_scene(16, 3, pressure=(0.05, 0.049, 0.01, 0.0, 0.05))
    steps = solve(scene).steps
    peak, eased, _, free, reloaded = (step.quantities for step in steps)
    areas = [step.areas["raw"].total for step in steps]
    assert eased["largest_plastic_strain"] == peak["largest_plastic_strain"]
    # Conforming on the way down: more contact than on the way up at the same load.
    up = solve_loads(scene, 0.01).final
    assert up.areas["raw"].total < areas[2] < areas[1] <= areas[0]
    assert areas[3] == free["largest_pressure"] == 0
    # The flat touches flattened asperities deeper than at first, but less deep than
    # under load.
    assert 0 < free["approach"] < peak["approach"]
    # Back at the peak load the body is where it was.
    assert reloaded["mean_gap"] == pytest.approx(peak["mean_gap"], rel=0.01)


# --- paths and increments


@pytest.mark.parametrize(
    ("law", "error"), [("elastic", 1e-7), ("capped", 1e-7), ("j2", 5e-3)]
)
def test_prescribing_the_approach_finds_the_load_that_gives_it(law, error):
    """The approach that a load of 0.05 E* xi causes, prescribed, gives this load again.

    `error` is the allowed relative error of the load. J2 flow depends on the path, and
    is not the same in one step of each kind.
    """
    scene = rough_scene(16, 3)
    by_load = solve(scene, law=law, steps=1).final
    approach = by_load.quantities["approach"]
    by_approach = solve(scene, law=law, steps=1, approach=approach).final
    assert by_approach.mean_pressure == pytest.approx(0.05, rel=error)


def test_a_capped_body_unloads_as_an_elastic_one_with_the_surface_left_behind():
    """A capped body unloads with the pressures of an elastic body whose heights are
    those left behind.

    Beyond its old largest load the body continues as if it had never been unloaded.
    """
    scene = rough_scene(16, 5, hardness=0.25, body=Body("bonded_layer", 0.3))
    loaded = solve_loads(scene, 0.05, law="capped")
    lowered = loaded.fields["plastic_displacement"]
    unloaded = solve_loads(scene, 0.05, 0.035, 0.02, law="capped")
    np.testing.assert_allclose(
        unloaded.fields["plastic_displacement"], lowered, atol=1e-12
    )
    assert unloaded.final.areas["raw"].plastic == 0.0
    flattened = replace(scene.surface, heights=scene.surface.heights - lowered)
    elastic = solve_loads(replace(scene, surface=flattened), 0.02, law="elastic")
    assert force_difference(unloaded, elastic) < 1e-6
    beyond = solve_loads(scene, 0.05, 0.0, 0.01, 0.065, law="capped").final.quantities
    direct = solve_loads(scene, 0.065, law="capped").final.quantities
    assert beyond == pytest.approx(direct, rel=1e-7)


def test_a_path_may_end_where_nothing_touches():
    """A flattened J2 body loses contact at an approach that touched the unloaded body.

    The certificate then has no contact force to divide by. Each load reports the
    fraction of the path as its progress.
    """
    progress = Mock()
    steps = fem_check.solve(
        rough_scene(12, 2), approach=(0.01, 1e-5), progress=progress
    ).steps
    assert steps[0].mean_pressure > steps[1].mean_pressure == 0
    assert steps[1].residuals["certified_balance"] < 1e-7
    reports = [call.args for call in progress.call_args_list]
    assert reports[1] == (1.0, "fem: mean pressure 0 Pa")
    assert reports[0][0] == 0.5


@pytest.mark.parametrize(("severity", "error"), [(5.0, 0.006), (25.0, 0.015)])
def test_the_error_of_the_increments_is_of_first_order(severity, error):
    """Doubling the increments of J2 flow halves the error of the pressures.

    `severity` is E* xi / sigma_Y; `error` is the largest difference of the pressures at
    the usual 10 increments from those of 160 equal ones, as a fraction of the force.
    The graded increments err less than as many equal ones.
    """
    scene = rough_scene(16, 2, yield_stress=1 / severity, pressure=0.25 / severity)

    def solve_equal(count):
        """Return the result at the final load in `count` equal increments."""
        loads = scene.load.final * np.arange(1, count + 1) / count
        return solve_loads(scene, *loads, steps=1)

    fine = solve_equal(160)
    coarse, usual, doubled = (
        force_difference(solve(scene, steps=steps), fine) for steps in (5, 10, 20)
    )
    assert 1.7 < coarse / usual < 2.5
    assert 1.7 < usual / doubled < 2.5
    assert usual < error
    assert usual < 0.9 * force_difference(solve_equal(10), fine)


def test_below_the_largest_load_one_increment_suffices():
    """On a path of four loads the three below the largest load take one increment each.

    The gap, approach, energy and work agree to 0.1 % with a path that is solved in
    eighths of the load.
    """
    scene = rough_scene(16, 2, yield_stress=0.04)
    few = solve_loads(scene, 0.01, 0.005, 0.0, 0.01).steps
    assert [step.iterations["increments"] for step in few] == [10, 1, 1, 1]
    eighths = np.array([8, 7, 6, 5, 4, 3, 2, 1, 0, 2, 4, 6, 8])
    many = solve_loads(scene, *(0.01 * eighths / 8)).steps
    for step, reference in zip(few, many[::4], strict=True):
        for name in ("mean_gap", "approach", "elastic_energy", "plastic_work"):
            expected = reference.quantities[name]
            assert step.quantities[name] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("length", "stress"), [(1e-9, 1e9), (10.0, 1.0)])
def test_units_do_not_matter(length, stress):
    """Lengths from 1 nm to 10 m and stresses in other units give the same dimensionless
    results.

    The path unloads fully. `length` is the period in m, and `stress` multiplies the
    modulus, the yield stress and the loads.
    """
    loads = np.array([0.05, 0.01, 0.0])
    scene = rough_scene(12, 2)
    modulus = scene.material.young_modulus
    scaled = Scene(
        Surface(scene.surface.heights * length, (length, length)),
        Material(modulus * stress, 0.3, yield_stress=0.2 * stress),
        Load(1.0),
    )
    steps = solve_loads(scene, *loads).steps
    scaled_steps = solve_loads(scaled, *(loads * stress)).steps
    for step, scaled_step in zip(steps, scaled_steps, strict=True):
        assert step.areas["raw"] == scaled_step.areas["raw"]
        for name, unit in {"mean_gap": length, "largest_pressure": stress}.items():
            expected = pytest.approx(step.quantities[name], rel=1e-8, abs=1e-10)
            assert scaled_step.quantities[name] / unit == expected


def test_increments_that_fail_are_halved(monkeypatch):
    """An increment that does not converge is solved again with patience, as the body
    carries the load; then it is halved, twice here, and a note reports the halvings.
    """
    failure = NotConverged("too far")
    outcomes = [DEFAULT, failure, failure, failure, DEFAULT, DEFAULT]
    solve_increment = Mock(wraps=increments.solve_increment, side_effect=outcomes)
    monkeypatch.setattr(increments, "solve_increment", solve_increment)
    result = solve(rough_scene(8, 2, pressure=(0.02, 0.06)), steps=1)
    loads = [call.args[3].load for call in solve_increment.call_args_list]
    assert loads == [0.02, 0.06, 0.06, 0.04, 0.03, 0.06]
    assert "an increment towards point 1 was halved 2 times" in result.notes


def test_what_does_not_converge_raises_with_its_residuals(monkeypatch):
    """`NotConverged` holds the residual of each Newton iteration and the last
    residuals.
    """
    monkeypatch.setattr(newton, "MAX_ITERATIONS", 1)
    with pytest.raises(NotConverged, match="did not converge in 1 Newton") as caught:
        solve(rough_scene(16, 3))
    assert len(caught.value.history) == 2
    assert caught.value.residuals["balance"] > 1e-8


def strip_scene(*contact_pressures):
    """Return the scene of a strip punch of 15 of 64 nodes on a J2 body.

    `contact_pressures` are the mean pressures of the path, in the strip and over the
    yield stress (1 Pa).  The spacing is 1 m, and no other node comes into contact.
    """
    heights = np.full(64, -10.0)
    heights[:15] = 0.0
    pressures = tuple(15 / 64 * pressure for pressure in contact_pressures)
    with pytest.warns(SurfaceWarning, match="slope"):
        surface = Surface(heights, (64.0,))
    return Scene(surface, Material(1000.0, 0.3, yield_stress=1.0), Load(pressures))


@pytest.mark.parametrize("path", [(3.09,), (3.3,), (30.0,), (2.5, 3.09)])
def test_a_punch_beyond_its_limit_load_flows_freely(path):
    """Beyond the limit load of a strip the error gives this load, on every path.

    `path` holds mean pressures in the strip over the yield stress.  The nodes carry
    between the outermost nodes and half a spacing beyond them: 14 to 15 spacings, and
    the expected load is Prandtl's for this width.
    """
    with pytest.raises(FlowsFreely, match=r"flows freely from 0\.681 Pa on") as caught:
        solve(strip_scene(*path))
    force = caught.value.limit * 64
    assert 14 < force / STRIP_LIMIT < 15


@pytest.mark.parametrize(
    ("round_punch", "bounds"), [(True, (5.69, 5.69)), (False, (5, 5.71))]
)
def test_the_limit_loads_of_a_disc_and_a_square_are_within_their_bounds(
    round_punch, bounds
):
    """A flat punch flows freely at a mean pressure between bounds of limit analysis.

    For Tresca's condition with the shear strength k, the pressure is 5.69 k under a
    smooth disc (Shield 1955) and 5 to 5.71 k under a square (Shield and Drucker 1953),
    the `bounds`.  The condition of von Mises lies between those with k = 1/2 and
    1/sqrt(3) yield stresses.  The punch is 6 spacings wide, and as under a strip the
    rim carries .18 spacings less on each side.
    """
    x = np.arange(24) - 2.5
    if round_punch:
        punch = x[:, None] ** 2 + x**2 <= 9
        area = (np.sqrt(punch.sum() * np.pi) - 0.18 * np.pi) ** 2 / np.pi
    else:
        punch = np.maximum(abs(x[:, None]), abs(x)) < 3
        area = (6 - 2 * 0.18) ** 2
    with pytest.warns(SurfaceWarning, match="slope"):
        surface = Surface(np.where(punch, 0.0, -10.0), (24.0, 24.0))
    metal = Material(1000.0, 0.3, yield_stress=1.0)
    scene = Scene(surface, metal, Load(4 * punch.mean()))
    with pytest.raises(FlowsFreely) as caught:
        solve(scene, steps=4, tolerance=1e-5)
    pressure = caught.value.limit * 24**2 / area
    lowest, highest = bounds
    assert lowest / 2 < pressure < highest / math.sqrt(3)
    assert pressure == pytest.approx(3.0, abs=0.07)


def test_a_load_beyond_the_limit_costs_at_most_twice_that_of_one_below(monkeypatch):
    """The limit load of a strip (2.907 yield stresses) is found in at most twice the
    iterations of conjugate gradients that a load just below it takes.
    """
    linear_contact = newton.linear_contact
    iterations = []

    def count_iterations(*arguments):
        """Solve the linearised contact, and add its iterations to the list."""
        solution, counts = linear_contact(*arguments)
        iterations.append(counts.cg)
        return solution, counts

    monkeypatch.setattr(newton, "linear_contact", count_iterations)
    result = solve(strip_scene(2.905))
    assert result.final.areas["raw"].total == 15 / 64
    below = sum(iterations)
    iterations.clear()
    with pytest.raises(FlowsFreely):
        solve(strip_scene(3.09))
    assert sum(iterations) < 2 * below


def test_a_body_that_carries_the_load_passes_the_check_of_free_flow(monkeypatch):
    """A load that the body carries, and a check without an answer, raise no error."""
    path = solve_path(strip_scene(2.0), certified=False)
    state = path.points[-1].state
    require_equilibrium(path.problem, state, path.history, load=2.2 * 15)
    lifted = replace(state, approach=-1.0)
    require_equilibrium(path.problem, lifted, path.history, load=3.3 * 15)
    monkeypatch.setattr(newton, "MAX_ITERATIONS", 1)
    require_equilibrium(path.problem, state, path.history, load=3.3 * 15)


def test_a_body_that_hardens_carries_every_load():
    """With hardening the strip carries 3.3 yield stresses, beyond its limit load."""
    result = solve(with_hardening(strip_scene(3.3), hardening_modulus=50.0))
    assert result.final.mean_pressure == 3.3 * 15 / 64


def test_a_body_whose_curve_ends_flows_freely_at_its_last_stress():
    """A strip on a body that hardens from 1 to 1.2 Pa within a strain of 1e-4 carries
    about 1.2 times the limit load without hardening (0.681 Pa).
    """
    curve = ((0.0, 1.0), (1e-4, 1.2))
    with pytest.raises(FlowsFreely) as caught:
        solve(with_hardening(strip_scene(4.5), hardening_curve=curve))
    assert caught.value.limit == pytest.approx(1.2 * 0.681, rel=2e-3)


def test_a_straight_curve_is_linear_hardening():
    """A curve with points on one line has the pressures of the hardening modulus."""
    scene = rough_scene(12, 2)
    modulus = solve(with_hardening(scene, hardening_modulus=5.0)).fields["pressure"]
    points = ((0.0, 0.2), (0.01, 0.25), (0.02, 0.3), (1.0, 5.2))
    curve = solve(with_hardening(scene, hardening_curve=points)).fields["pressure"]
    np.testing.assert_allclose(curve, modulus, rtol=1e-6, atol=1e-9)


def test_an_iteration_that_stagnates_goes_on_where_the_body_carries_the_load(
    monkeypatch,
):
    """Where each iteration counts as stagnation, the results keep their bits, because
    the increment is solved again with patience.
    """
    scene = rough_scene(8, 2, yield_stress=0.05)
    expected = solve(scene, steps=2).fields["pressure"]
    monkeypatch.setattr(newton, "STAGNATION", (1, 0.0))
    result = solve(scene, steps=2)
    assert result.fields["pressure"].tobytes() == expected.tobytes()
    assert result.final.iterations["increments"] == 2


@pytest.mark.parametrize(
    ("dimensions", "hardness"), [(1, 0.03), (1, 0.1), (2, 1e-5), (2, 0.3)]
)
def test_capped_paths_are_answered_at_every_load(dimensions, hardness):
    """Upward a capped path has the areas of its single loads; downward it keeps more
    contact.

    `dimensions` is 1 for a profile and 2 for a surface, and `hardness` is in units of
    E* xi. The loads are fractions of the hardness; at zero load one node at most
    touches.
    """
    loads = hardness * np.array([0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 0.5, 0.1, 0.0, 0.6])
    scene = rough_scene(
        32, 4, hardness=hardness, pressure=loads[0], dimensions=dimensions
    )
    steps = solve_loads(scene, *loads, law="capped").steps
    for load, step in zip(loads[:6], steps, strict=False):
        single = solve_loads(scene, load, law="capped").final
        assert step.areas["raw"] == single.areas["raw"]
        mean_gap = single.quantities["mean_gap"]
        assert step.quantities["mean_gap"] == pytest.approx(mean_gap, rel=1e-9)
    areas = [step.areas["raw"].total for step in steps]
    assert areas[8] <= 1 / 32**dimensions
    assert areas[6] > areas[2]


# --- warnings and refusals


@pytest.mark.parametrize(
    ("scene", "law", "notes"),
    [
        (
            rough_scene(16, 2, slope=0.3, pressure=0.1),
            "j2",
            [
                "the rms slope of 0.3 is too large for small strains (more than 0.1); "
                "scale heights, pressure and strengths down together",
                "the plastic strain reaches {strain:.2g}, too much for small strains",
            ],
        ),
        (
            rough_scene(32, 15, pressure=0.001),
            "elastic",
            [
                "the median contact is {nodes:.1f} nodes across, fewer than 4: areas "
                "and pressures depend on the grid"
            ],
        ),
        (
            rough_scene(16, 2, pressure=0.5),
            "j2",
            ["the plastic zone reaches the base; give a deeper block"],
        ),
        (rough_scene(32, 2, pressure=0.1), "j2", []),
    ],
    ids=["slope", "nodes", "base", "none"],
)
def test_a_scene_outside_its_limits_is_answered_with_a_warning(scene, law, notes):
    """Large slopes, coarse contacts and shallow blocks are solved, and notes name the
    limit.

    `notes` are all notes of the result, where {strain} is the largest plastic strain
    and {nodes} the breadth of the median contact in nodes.
    """
    result = solve(scene, law=law)
    strain = result.final.quantities.get("largest_plastic_strain")
    nodes = nodes_across(result.fields["pressure"] > 0)
    expected = [note.format(strain=strain, nodes=nodes) for note in notes]
    assert list(result.notes) == expected


def test_the_median_contact_joins_over_corners_and_edges():
    """Patches are joined over corners and periodic edges, and half of the nodes lie in
    larger patches.

    The patches have 9, 2 and 10 nodes. The breadth of a patch of n nodes is that of the
    circle of equal area, 2 sqrt(n/pi); on a line it is n.
    """
    touching = np.zeros((12, 14), dtype=bool)
    touching[np.ix_([11, 0, 1], [13, 0, 1])] = True
    touching[[4, 5], [4, 5]] = True
    touching[8:10, 5:10] = True
    assert nodes_across(touching) == 2 * math.sqrt(9 / math.pi)
    assert nodes_across(touching[:, :1]) == 3
    assert nodes_across(np.zeros_like(touching)) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"law": "viscous"}, "law is 'viscous', but must be elastic, capped or j2"),
        ({"geometry": "flat"}, "geometry is 'flat', but must be gap, moved or punch"),
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"steps": 0}, "steps is 0"),
        ({"approach": ()}, "approach is ()"),
        ({"depth": math.nan}, "depth is nan"),
        ({}, "finite yield_stress"),
        ({"law": "capped"}, "finite hardness"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(options, words):
    """Options outside of their range raise `InvalidScene` with the key and the value.

    `options` are fields of `FemOptions`, and `words` is a part of the message.
    """
    scene = rough_scene(8, 2, yield_stress=math.inf, hardness=math.inf)
    with pytest.raises(InvalidScene, match=re.escape(words)):
        fem_check.solve(scene, **options)


@pytest.mark.parametrize(
    ("nodes", "load", "severity", "options"),
    [
        (16, 0.25, 5.0, {"law": "elastic"}),
        (16, 0.25, 5.0, {"certified": True}),
        (16, 0.25, 5.0, {"geometry": "moved"}),
        (16, 0.25, 5.0, {"geometry": "punch"}),
        (24, 1.5, 5.0, {}),  # many elements flow
        (24, 0.25, 50.0, {}),  # few elements of a soft body flow
    ],
)
def test_the_estimate_of_memory_is_right_to_a_quarter(nodes, load, severity, options):
    """`bytes_needed` is within 25 % of the traced peak of memory of a solve.

    `nodes` are those along a side, `load` is the mean pressure over the yield stress,
    `severity` is E* xi / sigma_Y, and `options` are fields of `FemOptions`.
    """
    settings = FemOptions(**{"certified": False, "steps": 2, **options})
    scene = model_scene(severity, 0.3, 5, nodes, nodes // 8)
    pressure = load * scene.material.yield_stress
    scene = replace(scene, load=Load(pressure), body=Body())
    # Compiling needs memory, too.
    fem_check.solve(model_scene(5.0, 0.3, 5, 8, 1), settings)
    tracemalloc.start()
    block = solve_path(scene, settings).problem.block
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 0.75 < bytes_needed(scene, settings, block) / peak < 1.25


def test_a_block_that_does_not_fit_into_memory_is_refused():
    """A block of a million layers raises `NotEnoughMemory` before it is allocated."""
    with pytest.raises(NotEnoughMemory, match=r"x 1000000 elements needs about"):
        fem_check.solve(rough_scene(16, 2), layers=1_000_000)


# --- files


@pytest.fixture(scope="module", params=[(1, "gap"), (2, "moved")])
def written(request, tmp_path_factory):
    """Return a solved path, and pyvista's grids of the body and the top at its last
    load.

    The grids are read from the files that the solve wrote; the path is solved once for
    a line and once for a rough surface whose nodes are moved.
    """
    import pyvista

    folder = tmp_path_factory.mktemp("path")
    dimensions, geometry = request.param
    scene = rough_scene(8, 2, pressure=(0.02, 0.05), dimensions=dimensions)
    path = solve_path(scene, geometry=geometry, output=folder, certified=False)
    reader = pyvista.get_reader(folder / "path.pvd")
    reader.set_active_time_point(1)
    body, top = reader.read()
    return path, body, top


def test_pyvista_opens_the_top_with_its_fields(written):
    """The file of the surface holds the pressure, gap and state of each node of the
    result.
    """
    path, _, top = written
    result = contact_result(path)
    nx, ny = path.problem.block.shape
    assert top.n_cells == nx * ny
    names = {"contact_pressure": "pressure", "gap": "gap", "state": "state"}
    for name, field in names.items():
        # The last row and column are copies of the first.
        values = top[name].reshape(nx + 1, ny + 1)[:nx, :ny].squeeze()
        np.testing.assert_allclose(values, result.fields[field], atol=1e-15)


def test_pyvista_opens_the_body_with_means_over_the_gauss_points(written):
    """The file of the body holds means over the Gauss points of each element.

    The means, weighted by volume, are those of the stress (xx, yy, zz, xy, yz, zx) and
    of the accumulated plastic strain. The von Mises stress is that of the mean stress;
    its formula is tested where a sphere first yields.
    """
    path, body, _ = written
    bricks = path.problem.bricks
    names = {"stress", "von_mises", "equivalent_plastic_strain"}
    assert body.n_cells == bricks.number
    assert set(body.cell_data) == names
    assert set(body.point_data) == names | {"displacement"}
    state = path.points[-1].state
    u = path.problem.physical_displacement(state.displacement).reshape(-1, 3)
    stress = plasticity.stresses(u, bricks, path.problem.law, path.history)
    volumes = bricks.weights.sum(axis=1)
    fractions = (bricks.weights / volumes[:, None])[bricks.shape_of]
    mean = (stress * fractions[:, None]).sum(axis=2)
    accumulated = path.history.accumulated
    strain = (accumulated[path.history.rows] * fractions).sum(axis=1)
    assert 0 < strain.max() < accumulated.max()
    expected = {
        "stress": mean,
        "von_mises": vtu.von_mises(mean),
        "equivalent_plastic_strain": strain,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(body.cell_data[name], values, rtol=1e-9, atol=1e-12)


def test_displacements_bring_the_contact_to_one_height(written):
    """The displaced top is flat where it touches, to 1e-9 of the roughness."""
    path, _, top = written
    touching = top["contact_pressure"] > 0
    roughness = np.ptp(path.scene.surface.heights)
    warped = top.warp_by_vector("displacement")
    assert np.ptp(warped.points[touching, 2]) < 1e-9 * roughness
    assert np.ptp(top.points[touching, 2]) > 1e-3 * roughness


def test_files_have_the_units_of_their_arrays(written):
    """Field data of the files give the units of displacements (m) and moduli (Pa)."""
    for grid in written[1:]:
        assert grid.field_data["unit.displacement"][0] == "m"
        assert grid.field_data["unit.young_modulus"][0] == "Pa"


def test_files_that_cannot_be_written_raise(tmp_path):
    """A file in place of the folder raises `OutputError`, and a full disk raises
    `OSError`.
    """
    scene = rough_scene(8, 2)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(OutputError, match="cannot write"):
        solve(scene, output=file)
    mesh = mesh_of(problem_of(scene, FemOptions()))
    with pytest.raises(OSError, match="disk full"):
        vtu._write_grid(mesh, {}, "/dev/full")
