"""Scenes answered: laws, geometries and bodies, paths and their increments, files,
refusals.
"""

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
from fem_check import FemOptions, driver, increments, mesh_of, newton, plasticity, vtu
from fem_check.driver import problem_of
from fem_check.mesh import bytes_needed
from fem_check.result import contact_result, nodes_across


def solved(scene, **options):
    return fem_check.solve(scene, certified=False, **options)


def distance(one, other):
    """The share of the force that lies on other nodes."""
    p, q = one.fields["pressure"], other.fields["pressure"]
    return float(np.abs(p - q).sum() / q.sum())


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("geometry", ["gap", "moved", "punch"])
@pytest.mark.parametrize("law", ["elastic", "capped", "j2"])
@pytest.mark.parametrize(
    "body", [Body(), Body("bonded_layer", 0.3), Body("sliding_layer", 0.3)]
)
def test_every_law_geometry_and_body_converges_and_is_certified(
    dimensions, geometry, law, body
):
    hardness = (
        0.4 if dimensions == 2 else 0.15
    )  # below the elastic peak of these scenes
    scene = rough_scene(16, 2, dimensions=dimensions, body=body, hardness=hardness)
    if (geometry, body.kind) == ("punch", "sliding_layer"):
        with pytest.raises(InvalidScene, match="would slide away"):
            fem_check.solve(scene, law=law, geometry=geometry)
        return
    result = fem_check.solve(scene, law=law, geometry=geometry)
    assert max(result.final.residuals.values()) < 1e-7
    # scikit-fem's own assembly of the stresses balances the contact forces.
    assert result.final.residuals["certified_balance"] < 1e-8
    pressure, gap, state = (
        result.fields[name] for name in ("pressure", "gap", "state")
    )
    touching, plastic = state != APART, state == PLASTIC
    assert pressure.mean() == pytest.approx(0.05, rel=1e-7)
    assert (pressure[~touching] == 0).all()
    assert (gap[~touching] > 0).all()
    assert (gap[touching] <= (1e-9 if law == "capped" else 0)).all()
    if law == "capped":
        np.testing.assert_allclose(pressure[plastic], hardness, rtol=1e-12)
    assert (
        plastic.any() == (law != "elastic") == (result.final.areas["error"].plastic > 0)
    )


# Symmetries and limits
# -----------------------------------------------------------------------


def test_the_answer_does_not_depend_on_place_orientation_or_scale_of_the_slope():
    """In the gap geometry only p0/(E* xi) and sigma_Y/(E* xi) matter."""
    scene = rough_scene(16, 3)
    heights, base = scene.surface.heights, solved(scene).fields["pressure"]
    for move in (
        lambda a: np.roll(a, (3, 5), (0, 1)),
        lambda a: a[::-1],
        lambda a: a.T,
        np.rot90,
    ):
        found = solved(replace(scene, surface=Surface(move(heights), (1.0, 1.0))))
        np.testing.assert_allclose(
            found.fields["pressure"], move(base), atol=1e-6 * base.max()
        )
    flatter = solved(rough_scene(16, 3, slope=0.005)).fields["pressure"]
    np.testing.assert_allclose(flatter, base, atol=1e-6 * base.max())


def test_a_line_is_a_ridge_in_plane_strain():
    line = rough_scene(32, 4, dimensions=1)
    ridge = np.repeat(line.surface.heights[:, None], 2, 1)
    one = solved(line, depth=0.9).fields["pressure"]
    two = solved(replace(line, surface=Surface(ridge, (1.0, 2 / 32))), depth=0.9)
    np.testing.assert_allclose(
        two.fields["pressure"], np.stack([one, one], 1), atol=1e-7
    )


def test_hardening_bears_more_on_less():
    soft, hard = (solved(rough_scene(16, 2), hardening=h).final for h in (0.0, 5.0))
    assert hard.areas["raw"].total < soft.areas["raw"].total
    assert hard.quantities["largest_pressure"] > soft.quantities["largest_pressure"]


@pytest.mark.parametrize("geometry", ["moved", "punch"])
@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_rough_bodies_and_punches_tend_to_the_gap_as_the_slope_vanishes(law, geometry):
    """At equal groups the answers differ by an amount of first order in the slope."""
    differences = []
    for slope in (0.0125, 0.2):
        scene = rough_scene(12, 2, slope=slope, pressure=0.2)
        gap, other = (
            solved(scene, law=law, geometry=name) for name in ("gap", geometry)
        )
        differences.append(distance(other, gap))
    assert differences[0] < 0.02 < differences[1]
    assert 0.8 < math.log(differences[1] / differences[0], 16) < 1.8


def test_j2_flow_is_elastic_again_where_the_surface_has_not_yielded():
    """Plastic nodes are contact nodes over yielded elements, and no others."""
    path = driver.solve_path(rough_scene(16, 3))
    last, rows = path.points[-1], path.history.rows[:256].reshape(16, 16)
    for i, j in np.ndindex(16, 16):
        around = rows[[i - 1, i - 1, i, i], [j - 1, j, j - 1, j]].any()
        touching = last.state.states[i, j] == ELASTIC
        expected = APART if not touching else PLASTIC if around else ELASTIC
        assert last.surface_states[i, j] == expected
    # What flowed, from the Gauss points of its elements, which have equal shares of
    # each.
    thick, flowed = (
        -np.diff(path.problem.block.levels),
        np.flatnonzero(path.history.rows),
    )
    a, layer = path.history.accumulated[path.history.rows[flowed]], flowed // 256
    assert 0 < (a > 0).mean() < 1
    found = contact_result(path)
    told, p, areas = found.final.quantities, found.fields["pressure"], found.final.areas
    shares = [areas[kind].plastic / areas[kind].total for kind in ("raw", "corrected")]
    assert shares == pytest.approx(
        [np.mean(found.fields["state"][p > 0] == PLASTIC)] * 2
    )
    expected = {
        "mean_contact_pressure": p[p > 0].mean(),
        "largest_pressure": p.max(),
        "largest_plastic_strain": a.max(),
        "plastic_depth": thick[: layer.max() + 1].sum(),
        "plastic_volume": thick[layer] @ (a > 0).mean(axis=1) / thick.sum() / 256,
        "plastic_work": 0.2 * thick[layer] @ a.mean(axis=1) / 256,
    }
    assert {name: told[name] for name in expected} == pytest.approx(expected, rel=1e-9)


def test_unloading_is_elastic_at_first_and_leaves_its_mark():
    steps = solved(rough_scene(16, 3, pressure=(0.05, 0.049, 0.01, 0.0, 0.05))).steps
    peak, eased, low, free, again = (
        {"area": s.areas["raw"].total} | s.quantities for s in steps
    )
    assert eased["largest_plastic_strain"] == peak["largest_plastic_strain"]
    # Conforming on the way down: more contact than on the way up at the same load.
    up = solved(rough_scene(16, 3, pressure=0.01)).final
    assert up.areas["raw"].total < low["area"] < eased["area"] <= peak["area"]
    assert free["area"] == free["largest_pressure"] == 0
    # Flattened asperities: the flat touches deeper than at first, and less deep than
    # pressed.
    assert 0 < free["approach"] < peak["approach"]
    # Back at the peak load the body is where it was.
    assert again["mean_gap"] == pytest.approx(peak["mean_gap"], rel=0.01)


@pytest.mark.parametrize("body", [Body(), Body("sliding_layer", 0.4)])
def test_every_figure_of_a_capped_path_follows_from_its_states(body):
    """Of an oblong body that is unloaded, in plain numpy, with what the solve tells of
    itself.
    """
    square = rough_scene(16, 3, hardness=0.25, pressure=(0.08, 0.03), body=body)
    surface = Surface(square.surface.heights[:, :12], (1.0, 0.6))
    scene, told = replace(square, surface=surface), Mock()
    path = driver.solve_path(
        scene, law="capped", geometry="moved", layers=4, progress=told
    )
    result, cell = contact_result(path), 1.0 / 16 * 0.6 / 12
    assert [call.args for call in told.call_args_list] == [
        (0.5, "fem: mean pressure 0.08 Pa"),
        (1.0, "fem: mean pressure 0.03 Pa"),
    ]
    heights = surface.heights - surface.heights.mean()
    for point, step in zip(path.points, result.steps, strict=True):
        state, p, down = (
            point.state,
            point.state.forces / cell,
            -point.state.displacement[0, ..., 2],
        )
        gap = down - heights - state.approach
        if step is result.steps[0]:
            flow = np.where(state.states == PLASTIC, -gap, 0.0)
        off = np.where(state.states == APART, gap, -flow)
        own = down - down.mean() if body.kind == "half_space" else down
        assert p.mean() == pytest.approx(step.mean_pressure, rel=1e-7)
        assert step.quantities == pytest.approx(
            {
                "mean_gap": np.maximum(off + flow, 0).mean(),
                "mean_separation": off.mean(),
                "approach": state.approach + heights.max(),
                "largest_pressure": p.max(),
                "mean_contact_pressure": p[state.states != APART].mean(),
                "elastic_energy": (p * own).mean() / 2,
                "mean_plastic_displacement": flow.mean(),
                "plastic_work": 0.25 * flow.mean(),
            },
            rel=1e-9,
        )
        assert step.areas["raw"].total == np.mean(state.states != APART)
        counts = {"newton": "newton", "cg": "cg", "contact_sweeps": "sweeps"}
        counts |= {name: name for name in ("increments", "line_searches")}
        assert step.iterations == {
            n: vars(point.counts)[of] for n, of in counts.items()
        }
    for most, name in (
        ("most_cg", "most_cg_iterations"),
        ("most_newton", "most_newton_steps"),
    ):
        assert result.cost[name] == max(vars(each.counts)[most] for each in path.points)


# Paths and increments
# ------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["elastic", "capped", "j2"])
def test_prescribing_the_approach_finds_the_load_that_gives_it(law):
    by_load = solved(rough_scene(16, 3), law=law, steps=1).final
    approach = by_load.quantities["approach"]
    by_approach = solved(rough_scene(16, 3), law=law, steps=1, approach=approach).final
    # One step each: J2 paths of load and of approach differ by their flow along the
    # way.
    assert by_approach.mean_pressure == pytest.approx(
        0.05, rel=5e-3 if law == "j2" else 1e-7
    )


def test_a_capped_body_unloads_as_an_elastic_one_with_the_surface_left_behind():
    """And from its largest load on it goes as if it had never been unloaded."""
    scene, peak = (
        rough_scene(16, 5, hardness=0.25, body=Body("bonded_layer", 0.3)),
        0.05,
    )

    def along(*path):
        return solved(replace(scene, load=Load(path)), law="capped")

    lowered = along(peak).fields["plastic_displacement"]
    result = along(peak, 0.7 * peak, 0.4 * peak)
    left = replace(scene.surface, heights=scene.surface.heights - lowered)
    elastic = solved(replace(scene, surface=left, load=Load(0.4 * peak)), law="elastic")
    np.testing.assert_allclose(
        result.fields["plastic_displacement"], lowered, atol=1e-12
    )
    assert distance(result, elastic) < 1e-6
    assert result.final.areas["raw"].plastic == 0.0
    beyond = along(peak, 0.0, 0.2 * peak, 1.3 * peak).final
    assert beyond.quantities == pytest.approx(
        along(1.3 * peak).final.quantities, rel=1e-7
    )


def test_a_path_may_end_where_nothing_touches():
    """Flattened for good, a J2 body leaves the flat before that is back at its first
    touch; the certificate has no contact force to divide by there.
    """
    steps = fem_check.solve(rough_scene(12, 2), approach=(0.01, 1e-5)).steps
    assert steps[0].mean_pressure > steps[1].mean_pressure == 0
    assert steps[1].residuals["certified_balance"] < 1e-7


@pytest.mark.parametrize(("severity", "error"), [(5.0, 0.006), (25.0, 0.015)])
def test_the_error_of_the_increments_is_of_first_order(severity, error):
    """And of equal increments, as many, it is larger."""
    scene = rough_scene(16, 2, yield_stress=1 / severity, pressure=0.25 / severity)
    peak = scene.load.final

    def equal(count):
        path = tuple(peak * k / count for k in range(1, count + 1))
        return solved(replace(scene, load=Load(path)), steps=1)

    fine = equal(160)
    coarse, usual, twice = (distance(solved(scene, steps=n), fine) for n in (5, 10, 20))
    assert 1.7 < coarse / usual < 2.5
    assert 1.7 < usual / twice < 2.5
    assert usual < min(error, 0.9 * distance(equal(10), fine))


def test_below_the_largest_load_one_increment_suffices():
    scene, peak = rough_scene(16, 2, yield_stress=0.04), 0.01
    few = solved(replace(scene, load=Load((peak, peak / 2, 0.0, peak))))
    assert [step.iterations["increments"] for step in few.steps] == [10, 1, 1, 1]
    down = tuple(peak * k / 8 for k in (8, 7, 6, 5, 4, 3, 2, 1, 0, 2, 4, 6, 8))
    many = solved(replace(scene, load=Load(down))).steps
    for one, other in zip(
        few.steps, (many[0], many[4], many[8], many[12]), strict=True
    ):
        for name in ("mean_gap", "approach", "elastic_energy", "plastic_work"):
            assert one.quantities[name] == pytest.approx(
                other.quantities[name], rel=1e-3
            )


@pytest.mark.parametrize(("length", "stress"), [(1e-9, 1e9), (10.0, 1.0)])
def test_units_do_not_matter(length, stress):
    """1 nm to 10 m, on a path that unloads to nothing: the same dimensionless
    answers.
    """
    one = rough_scene(12, 2, pressure=(0.05, 0.01, 0.0))
    other = Scene(
        Surface(one.surface.heights * length, (length, length)),
        Material(one.material.young_modulus * stress, 0.3, yield_stress=0.2 * stress),
        Load(tuple(p * stress for p in one.load.path)),
    )
    for a, b in zip(*(solved(scene).steps for scene in (one, other)), strict=True):
        assert a.areas["raw"] == b.areas["raw"]
        for name, unit in {"mean_gap": length, "largest_pressure": stress}.items():
            expected = pytest.approx(a.quantities[name], rel=1e-8, abs=1e-10)
            assert b.quantities[name] / unit == expected


def test_increments_that_fail_are_halved(monkeypatch):
    given = [DEFAULT, *[NotConverged("too far")] * 2, *[DEFAULT] * 2]
    solve = Mock(wraps=increments.solve_increment, side_effect=given)
    monkeypatch.setattr(increments, "solve_increment", solve)
    result = solved(rough_scene(8, 2, pressure=(0.02, 0.06)), steps=1)
    assert [call.args[3].load for call in solve.call_args_list] == [
        0.02,
        0.06,
        0.04,
        0.03,
        0.06,
    ]
    assert "an increment towards point 1 was halved 2 times" in result.notes


def test_what_does_not_converge_raises_with_its_residuals(monkeypatch):
    monkeypatch.setattr(newton, "MAX_ITERATIONS", 1)
    with pytest.raises(NotConverged, match="did not converge in 1 Newton") as caught:
        solved(rough_scene(16, 3))
    assert len(caught.value.history) == 2
    assert caught.value.residuals["balance"] > 1e-8


@pytest.mark.parametrize(
    ("dimensions", "hardness"), [(1, 0.03), (1, 0.1), (2, 1e-5), (2, 0.3)]
)
def test_capped_paths_are_answered_at_every_load(dimensions, hardness):
    """A path upward is its single loads; what has flowed keeps more in contact on the
    way down.
    """
    shares = (0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 0.5, 0.1, 0.0, 0.6)
    scene = rough_scene(
        32, 4, hardness=hardness, pressure=hardness / 2, dimensions=dimensions
    )
    path = solved(
        replace(scene, load=Load(tuple(s * hardness for s in shares))), law="capped"
    )
    for share, step in zip(shares[:6], path.steps, strict=False):
        alone = solved(replace(scene, load=Load(share * hardness)), law="capped").final
        assert step.areas["raw"] == alone.areas["raw"]
        assert step.quantities["mean_gap"] == pytest.approx(
            alone.quantities["mean_gap"], rel=1e-9
        )
    assert [step.areas["raw"].total for step in path.steps][8] <= 1 / 32**dimensions
    assert path.steps[6].areas["raw"].total > path.steps[2].areas["raw"].total


# Warnings and refusals
# -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "law", "expected"),
    [
        (rough_scene(16, 2, slope=0.3, pressure=0.1), "j2", ["slope", "strain"]),
        (rough_scene(32, 15, pressure=0.001), "elastic", ["nodes"]),
        (rough_scene(16, 2, pressure=0.5), "j2", ["base"]),
        (rough_scene(32, 2, pressure=0.1), "j2", []),
    ],
)
def test_a_scene_outside_its_limits_is_answered_with_a_warning(scene, law, expected):
    result = solved(scene, law=law)
    strain = result.final.quantities.get("largest_plastic_strain", 0.0)
    sentences = {
        "slope": f"the rms slope of {scene.surface.rms_slope:.2g} is too large for small strains "
        "(more than 0.1); scale heights, pressure and strengths down together",
        "nodes": f"the median contact is {nodes_across(result.fields['pressure'] > 0):.1f} nodes "
        "across, fewer than 4: areas and pressures depend on the grid",
        "base": "the plastic zone reaches the base; give a deeper block",
        "strain": f"the plastic strain reaches {strain:.2g}, too much for small strains",
    }
    assert [*result.notes] == [sentences[name] for name in expected]


def test_the_median_contact_joins_over_corners_and_edges():
    """Of 9, 2 and 10 nodes; half of all nodes are in contacts no larger than that of
    9.
    """
    touching = np.zeros((12, 14), dtype=bool)
    touching[np.ix_([11, 0, 1], [13, 0, 1])] = touching[[4, 5], [4, 5]] = touching[
        8:10, 5:10
    ] = True
    assert nodes_across(touching) == 2 * math.sqrt(9 / math.pi)
    assert nodes_across(touching[:, :1]) == 3
    assert nodes_across(touching & False) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"law": "viscous"}, "law is 'viscous', but must be elastic, capped or j2"),
        (
            {"geometry": "curved"},
            "geometry is 'curved', but must be gap, moved or punch",
        ),
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
        (24, 0.25, 50.0, {}),  # few do, of a soft body
    ],
)
def test_the_estimate_of_memory_is_right_to_a_quarter(nodes, load, severity, options):
    chosen = FemOptions(**{"certified": False, "steps": 2} | options)
    given = model_scene(severity, 0.3, 5, nodes, nodes // 8)
    given = replace(given, load=Load(load * given.material.yield_stress), body=Body())
    fem_check.solve(
        model_scene(5.0, 0.3, 5, 8, 1), chosen
    )  # compiling needs memory, too
    tracemalloc.start()
    block = driver.solve_path(given, chosen).problem.block
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.75 < bytes_needed(given, chosen, block) / peak < 1.25
    with pytest.raises(NotEnoughMemory, match=r"x 1000000 elements needs about"):
        fem_check.solve(given, layers=1_000_000)


# Files
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dimensions", "geometry"), [(1, "gap"), (2, "moved")])
def test_pyvista_opens_the_path_with_its_fields(tmp_path, dimensions, geometry):
    import pyvista

    scene = rough_scene(8, 2, pressure=(0.02, 0.05), dimensions=dimensions)
    path = driver.solve_path(scene, geometry=geometry, output=tmp_path, certified=False)
    result, state, bricks = (
        contact_result(path),
        path.points[-1].state,
        path.problem.bricks,
    )
    reader = pyvista.get_reader(tmp_path / "path.pvd")
    reader.set_active_time_point(1)
    body, top = reader.read()
    columns, whole = 8**dimensions, {"stress", "von_mises", "equivalent_plastic_strain"}
    assert (body.n_cells, top.n_cells) == (
        result.provenance.options["layers"] * columns,
        columns,
    )
    assert set(body.cell_data) == whole == set(body.point_data) - {"displacement"}
    # The periodic edge is closed by a copy, so look at the first copy alone.
    first = (slice(8), slice(8 if dimensions == 2 else 1))
    for name, field in (
        ("contact_pressure", "pressure"),
        ("gap", "gap"),
        ("state", "state"),
    ):
        values = top[name].reshape(9, -1)[first].squeeze()
        np.testing.assert_allclose(values, result.fields[field], atol=1e-15)
    # Means over the Gauss points of each element, which a node has of those around it.
    nodal = path.problem.physical_displacement(state.displacement).reshape(-1, 3)
    stress = plasticity.stresses(nodal, bricks, path.problem.law, path.history)
    parts = (bricks.weights / bricks.weights.sum(axis=1)[:, None])[bricks.shape_of]
    mean = (stress * parts[:, None]).sum(axis=2)
    strain = (path.history.accumulated[path.history.rows] * parts).sum(axis=1)
    assert 0 < strain.max() < path.history.accumulated.max()
    dev = mean - mean[:, :3].mean(axis=1)[:, None] * [1, 1, 1, 0, 0, 0]
    mises = np.sqrt(1.5 * (dev**2 @ [1, 1, 1, 2, 2, 2]))
    known = {"stress": mean, "von_mises": mises, "equivalent_plastic_strain": strain}
    for name, values in known.items():
        np.testing.assert_allclose(body.cell_data[name], values, rtol=1e-9, atol=1e-12)
    # The points are undeformed: only their displacement brings those in contact to one
    # height.
    touching, roughness = top["contact_pressure"] > 0, np.ptp(scene.surface.heights)
    warped = top.warp_by_vector("displacement")
    assert np.ptp(warped.points[touching, 2]) < 1e-9 * roughness
    assert np.ptp(top.points[touching, 2]) > 1e-3 * roughness
    for held in (body.field_data, top.field_data):
        assert (held["unit.displacement"][0], held["unit.young_modulus"][0]) == (
            "m",
            "Pa",
        )
    with pytest.raises(OutputError, match="cannot write"):
        solved(scene, output=tmp_path / "path.pvd")
    with pytest.raises(OSError, match="disk full"):
        vtu._write_grid(mesh_of(problem_of(scene, FemOptions())), {}, "/dev/full")
