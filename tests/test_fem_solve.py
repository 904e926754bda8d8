"""Solved scenes: laws, geometries, bodies, load paths, files and refusals."""

import math
import re
import tracemalloc
from dataclasses import replace
from unittest.mock import DEFAULT, Mock

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact.errors import InvalidScene, NotConverged, NotEnoughMemory, OutputError
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.studies.hardness import model_scene
from fem_check import FemOptions, increments, mesh_of, newton, plasticity, vtu
from fem_check.driver import problem_of, solve_path
from fem_check.mesh import bytes_needed
from fem_check.result import contact_result, nodes_across


def solve(scene, **options):
    """Solve without the certificate, which takes time."""
    return fem_check.solve(scene, certified=False, **options)


def solve_loads(scene, *loads, **options):
    """Solve along a path of mean pressures."""
    return solve(replace(scene, load=Load(loads)), **options)


def force_difference(result, other):
    """Return the fraction of the force that is on other nodes."""
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
    hardness = {1: 0.15, 2: 0.4}[dimensions]  # below the elastic peak
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
    return np.roll(field, (3, 5), (0, 1))


@pytest.mark.parametrize("move", [shift, np.flipud, np.transpose, np.rot90])
def test_the_answer_does_not_depend_on_place_and_orientation(move):
    scene = rough_scene(16, 3)
    moved = Surface(move(scene.surface.heights), (1.0, 1.0))
    pressure = solve(scene).fields["pressure"]
    np.testing.assert_allclose(
        solve(replace(scene, surface=moved)).fields["pressure"],
        move(pressure),
        atol=1e-6 * pressure.max(),
    )


def test_the_answer_does_not_depend_on_the_scale_of_the_slope():
    """In the gap geometry only p0/(E* xi) and sigma_Y/(E* xi) matter."""
    pressure = solve(rough_scene(16, 3)).fields["pressure"]
    flatter = solve(rough_scene(16, 3, slope=0.005)).fields["pressure"]
    np.testing.assert_allclose(flatter, pressure, atol=1e-6 * pressure.max())


def test_a_line_is_a_ridge_in_plane_strain():
    line = rough_scene(32, 4, dimensions=1)
    ridge = np.repeat(line.surface.heights[:, None], 2, 1)
    surface = Surface(ridge, (1.0, 2 / 32))
    of_line = solve(line, depth=0.9).fields["pressure"]
    of_ridge = solve(replace(line, surface=surface), depth=0.9).fields["pressure"]
    np.testing.assert_allclose(of_ridge, np.stack([of_line, of_line], 1), atol=1e-7)


def test_hardening_bears_more_on_less():
    perfect = solve(rough_scene(16, 2)).final
    hardening = solve(rough_scene(16, 2), hardening=5.0).final
    assert hardening.areas["raw"].total < perfect.areas["raw"].total
    largest = "largest_pressure"
    assert hardening.quantities[largest] > perfect.quantities[largest]


@pytest.mark.parametrize("geometry", ["moved", "punch"])
@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_rough_bodies_and_punches_tend_to_the_gap_as_the_slope_vanishes(law, geometry):
    """At equal groups the difference is of first order in the slope."""
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
    """Plastic nodes are contact nodes of yielded elements, and no others."""
    path = solve_path(rough_scene(16, 3))
    point = path.points[-1]
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
    """All Gauss points of an element have the same volume."""
    path = solve_path(rough_scene(16, 3))
    thickness = -np.diff(path.problem.block.levels)
    flowed = np.flatnonzero(path.history.rows)
    layer = flowed // 256
    strain = path.history.accumulated[path.history.rows[flowed]]
    has_flowed = strain > 0
    assert 0 < has_flowed.mean() < 1
    result = contact_result(path)
    pressure = result.fields["pressure"]
    touching = pressure > 0
    plastic_fraction = np.mean(result.fields["state"][touching] == PLASTIC)
    for kind in ("raw", "corrected"):
        areas = result.final.areas[kind]
        assert areas.plastic / areas.total == pytest.approx(plastic_fraction)
    volume = thickness[layer] @ has_flowed.mean(axis=1)
    expected = {
        "mean_contact_pressure": pressure[touching].mean(),
        "largest_pressure": pressure.max(),
        "largest_plastic_strain": strain.max(),
        "plastic_depth": thickness[: layer.max() + 1].sum(),
        "plastic_volume": volume / thickness.sum() / 256,
        "plastic_work": 0.2 * thickness[layer] @ strain.mean(axis=1) / 256,
    }
    quantities = {name: result.final.quantities[name] for name in expected}
    assert quantities == pytest.approx(expected, rel=1e-9)


def test_unloading_is_elastic_at_first_and_leaves_its_mark():
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


@pytest.mark.parametrize("body", [Body(), Body("sliding_layer", 0.4)])
def test_every_figure_of_a_capped_path_follows_from_its_states(body):
    """An oblong body is unloaded, and its quantities are computed in plain numpy."""
    square = rough_scene(16, 3, hardness=0.25, pressure=(0.08, 0.03), body=body)
    surface = Surface(square.surface.heights[:, :12], (1.0, 0.6))
    cell = 1.0 / 16 * 0.6 / 12
    heights = surface.heights - surface.heights.mean()
    progress = Mock()
    path = solve_path(
        replace(square, surface=surface),
        law="capped",
        geometry="moved",
        layers=4,
        progress=progress,
    )
    assert [call.args for call in progress.call_args_list] == [
        (0.5, "fem: mean pressure 0.08 Pa"),
        (1.0, "fem: mean pressure 0.03 Pa"),
    ]
    result = contact_result(path)
    loaded = path.points[0].state
    flow = loaded.displacement[0, ..., 2] + heights + loaded.approach
    flow[loaded.states != PLASTIC] = 0
    for point, step in zip(path.points, result.steps, strict=True):
        state = point.state
        pressure = state.forces / cell
        down = -state.displacement[0, ..., 2]
        touching = state.states != APART
        gap = np.where(touching, -flow, down - heights - state.approach)
        displacement = down
        if body.kind == "half_space":
            displacement = down - down.mean()
        assert pressure.mean() == pytest.approx(step.mean_pressure, rel=1e-7)
        expected = {
            "mean_gap": np.maximum(gap + flow, 0).mean(),
            "mean_separation": gap.mean(),
            "approach": state.approach + heights.max(),
            "largest_pressure": pressure.max(),
            "mean_contact_pressure": pressure[touching].mean(),
            "elastic_energy": (pressure * displacement).mean() / 2,
            "mean_plastic_displacement": flow.mean(),
            "plastic_work": 0.25 * flow.mean(),
        }
        assert step.quantities == pytest.approx(expected, rel=1e-9)
        assert step.areas["raw"].total == np.mean(touching)
        assert step.iterations == {
            "newton": point.counts.newton,
            "cg": point.counts.cg,
            "contact_sweeps": point.counts.sweeps,
            "increments": point.counts.increments,
            "line_searches": point.counts.line_searches,
        }
    counts = [point.counts for point in path.points]
    assert result.cost["most_cg_iterations"] == max(c.most_cg for c in counts)
    assert result.cost["most_newton_steps"] == max(c.most_newton for c in counts)


# --- paths and increments


@pytest.mark.parametrize(
    ("law", "error"), [("elastic", 1e-7), ("capped", 1e-7), ("j2", 5e-3)]
)
def test_prescribing_the_approach_finds_the_load_that_gives_it(law, error):
    """J2 flow depends on the path, and is not the same in one step of each kind."""
    scene = rough_scene(16, 3)
    by_load = solve(scene, law=law, steps=1).final
    approach = by_load.quantities["approach"]
    by_approach = solve(scene, law=law, steps=1, approach=approach).final
    assert by_approach.mean_pressure == pytest.approx(0.05, rel=error)


def test_a_capped_body_unloads_as_an_elastic_one_with_the_surface_left_behind():
    """From its largest load on it continues as if it had never been unloaded."""
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
    """A flattened J2 body leaves the flat before this is back at its first touch.

    The certificate then has no contact force to divide by.
    """
    steps = fem_check.solve(rough_scene(12, 2), approach=(0.01, 1e-5)).steps
    assert steps[0].mean_pressure > steps[1].mean_pressure == 0
    assert steps[1].residuals["certified_balance"] < 1e-7


@pytest.mark.parametrize(("severity", "error"), [(5.0, 0.006), (25.0, 0.015)])
def test_the_error_of_the_increments_is_of_first_order(severity, error):
    """It is smaller than that of as many equal increments."""
    scene = rough_scene(16, 2, yield_stress=1 / severity, pressure=0.25 / severity)

    def solve_equal(count):
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
    """From 1 nm to 10 m, on a path that unloads fully, groups are the same."""
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
    failure = NotConverged("too far")
    outcomes = [DEFAULT, failure, failure, DEFAULT, DEFAULT]
    solve_increment = Mock(wraps=increments.solve_increment, side_effect=outcomes)
    monkeypatch.setattr(increments, "solve_increment", solve_increment)
    result = solve(rough_scene(8, 2, pressure=(0.02, 0.06)), steps=1)
    loads = [call.args[3].load for call in solve_increment.call_args_list]
    assert loads == [0.02, 0.06, 0.04, 0.03, 0.06]
    assert "an increment towards point 1 was halved 2 times" in result.notes


def test_what_does_not_converge_raises_with_its_residuals(monkeypatch):
    monkeypatch.setattr(newton, "MAX_ITERATIONS", 1)
    with pytest.raises(NotConverged, match="did not converge in 1 Newton") as caught:
        solve(rough_scene(16, 3))
    assert len(caught.value.history) == 2
    assert caught.value.residuals["balance"] > 1e-8


@pytest.mark.parametrize(
    ("dimensions", "hardness"), [(1, 0.03), (1, 0.1), (2, 1e-5), (2, 0.3)]
)
def test_capped_paths_are_answered_at_every_load(dimensions, hardness):
    """Upward a path is its single loads; downward flow keeps more in contact."""
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
    result = solve(scene, law=law)
    strain = result.final.quantities.get("largest_plastic_strain")
    nodes = nodes_across(result.fields["pressure"] > 0)
    expected = [note.format(strain=strain, nodes=nodes) for note in notes]
    assert list(result.notes) == expected


def test_the_median_contact_joins_over_corners_and_edges():
    """The contacts have 9, 2 and 10 nodes: half of all nodes are in the first two."""
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
        ({"hardening": -1.0}, "hardening is -1.0"),
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"steps": 0}, "steps is 0"),
        ({"approach": ()}, "approach is ()"),
        ({"depth": math.nan}, "depth is nan"),
        ({}, "finite yield_stress"),
        ({"law": "capped"}, "finite hardness"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(options, words):
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
    with pytest.raises(NotEnoughMemory, match=r"x 1000000 elements needs about"):
        fem_check.solve(rough_scene(16, 2), layers=1_000_000)


# --- files


@pytest.fixture(scope="module", params=["line", "moved surface"])
def written(request, tmp_path_factory):
    """Return a solved path, and what pyvista reads of its last point: body and top."""
    import pyvista

    folder = tmp_path_factory.mktemp("path")
    dimensions, geometry = {"line": (1, "gap"), "moved surface": (2, "moved")}[
        request.param
    ]
    scene = rough_scene(8, 2, pressure=(0.02, 0.05), dimensions=dimensions)
    path = solve_path(scene, geometry=geometry, output=folder, certified=False)
    reader = pyvista.get_reader(folder / "path.pvd")
    reader.set_active_time_point(1)
    body, top = reader.read()
    return path, body, top


def test_pyvista_opens_the_top_with_its_fields(written):
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
    deviator = mean - mean[:, :3].mean(axis=1)[:, None] * [1, 1, 1, 0, 0, 0]
    von_mises = np.sqrt(1.5 * (deviator**2 @ [1, 1, 1, 2, 2, 2]))
    expected = {
        "stress": mean,
        "von_mises": von_mises,
        "equivalent_plastic_strain": strain,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(body.cell_data[name], values, rtol=1e-9, atol=1e-12)


def test_displacements_bring_the_contact_to_one_height(written):
    path, _, top = written
    touching = top["contact_pressure"] > 0
    roughness = np.ptp(path.scene.surface.heights)
    warped = top.warp_by_vector("displacement")
    assert np.ptp(warped.points[touching, 2]) < 1e-9 * roughness
    assert np.ptp(top.points[touching, 2]) > 1e-3 * roughness


def test_files_have_the_units_of_their_arrays(written):
    for grid in written[1:]:
        assert grid.field_data["unit.displacement"][0] == "m"
        assert grid.field_data["unit.young_modulus"][0] == "Pa"


def test_files_that_cannot_be_written_raise(tmp_path):
    scene = rough_scene(8, 2)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(OutputError, match="cannot write"):
        solve(scene, output=file)
    mesh = mesh_of(problem_of(scene, FemOptions()))
    with pytest.raises(OSError, match="disk full"):
        vtu._write_grid(mesh, {}, "/dev/full")
