"""The J2 law and its bricks: point by point, as limit loads of small bodies, and as a
block.
"""

import math

import numpy as np
import pytest
import reference_plasticity as reference
import scipy.sparse as sp
from fem_scenes import rough_scene

from epcontact.errors import InvalidScene
from epcontact.scene import Body
from fem_check import FemOptions, mesh_of, plasticity, surface_compliance
from fem_check.driver import problem_of
from fem_check.element import CORNERS, elastic_stiffness, elements_of
from fem_check.limit_load import STRIP_LIMIT, push, strip_punch
from fem_check.mesh import (
    GROWTH,
    block_for,
    graded_layers,
    half_space_depth,
    moved_elements,
)

# The law, point by point
# ---------------------------------------------------------------------


def return_map(strain, rule):
    """Stress and accumulated plastic strain at a (3, 3) strain from the virgin state:
    Simo and Hughes, box 3.1, written with tensors.
    """
    mean = np.trace(strain) * np.eye(3)
    trial = 2 * rule.shear_modulus * (strain - mean / 3)
    norm = np.linalg.norm(trial)
    over = max(norm - np.sqrt(2 / 3) * rule.yield_stress, 0.0)
    multiplier = over / (2 * rule.shear_modulus + 2 / 3 * rule.hardening_modulus)
    stress = (
        trial * (1 - 2 * rule.shear_modulus * multiplier / norm)
        + rule.bulk_modulus * mean
    )
    return stress, np.sqrt(2 / 3) * multiplier


def six(tensor):
    """Components xx, yy, zz, xy, yz, zx."""
    return tensor[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]


def brick(seed, yield_stress=0.02, hardening=0.0):
    """One skewed brick, a random displacement that makes it yield, its law and
    history.
    """
    rng = np.random.default_rng(seed)
    bricks = elements_of(
        np.arange(8)[None],
        np.zeros(1),
        (CORNERS + 0.1 * rng.standard_normal((8, 3)))[None],
    )
    u = 0.05 * rng.standard_normal((8, 3))
    return (
        bricks,
        u,
        plasticity.j2_law(2.0, 0.3, yield_stress, hardening),
        plasticity.initial_history(1),
    )


@pytest.mark.parametrize("hardening", [0.0, 0.3])
def test_the_element_tangent_is_the_derivative_of_the_internal_force(hardening):
    bricks, u, rule, history = brick(3, hardening=hardening)
    _, flowing = plasticity.internal_force(u, bricks, rule, history)
    assert flowing.all()
    correction = plasticity.tangent_correction(u, bricks, rule, history, flowing)
    for v in np.random.default_rng(4).standard_normal((5, 8, 3)):
        product, _ = plasticity.internal_force(v, bricks, rule, None)
        plasticity.add_correction(v, bricks, correction, 1.0, product)
        up, down = (
            plasticity.internal_force(u + s * 1e-7 * v, bricks, rule, history)[0]
            for s in (1, -1)
        )
        np.testing.assert_allclose(
            product, (up - down) / 2e-7, atol=1e-6 * np.abs(product).max()
        )


@pytest.mark.parametrize("yield_stress", [0.02, 1e3])
def test_the_compiled_element_agrees_with_the_point_law(yield_stress):
    bricks, u, rule, history = brick(5, yield_stress, 0.1)
    stress = plasticity.stresses(u, bricks, rule, history)[0]
    _, flowing = plasticity.internal_force(u, bricks, rule, history)
    history = plasticity.commit(u, bricks, rule, history, flowing)
    assert (history.rows > 0).all() == flowing.all() == (yield_stress < 1)
    dilatation = float(np.einsum("ja,aj->", bricks.mean_gradients[0], u))
    for q in range(8):
        local = np.einsum("ja,ai->ij", bricks.gradients[0, :, :, q], u)
        e = (local + local.T) / 2
        e += np.eye(3) * (dilatation - np.trace(e)) / 3
        expected, accumulated = return_map(e, rule)
        np.testing.assert_allclose(stress[:, q], six(expected), rtol=1e-12, atol=1e-15)
        assert history.accumulated[history.rows[0], q] == pytest.approx(
            accumulated, rel=1e-12
        )


def test_the_elastic_element_passes_the_patch_test_and_has_six_rigid_motions():
    bricks, _, rule, _ = brick(7, math.inf)
    corners = CORNERS + 0.1 * np.random.default_rng(7).standard_normal((8, 3))
    gradient = 1e-3 * np.random.default_rng(8).standard_normal((3, 3))
    expected, _ = return_map((gradient + gradient.T) / 2, rule)
    stress = plasticity.stresses(corners @ gradient.T, bricks, rule, None)[0]
    np.testing.assert_allclose(stress, np.tile(six(expected)[:, None], 8), rtol=1e-11)
    values = np.linalg.eigvalsh(elastic_stiffness(bricks, 0, 0.4, 0.9))
    assert (np.abs(values[:6]) < 1e-14).all()
    assert values[6] > 1e-3


# Limit loads
# ---------------------------------------------------------------------------------

SLICE = 0.01  # half of the angle that a column of bricks subtends, rad
SPHERE_PATH = 8e-3 * np.linspace(
    0.02, 1.5, 12
)  # to half as much again as full yield takes


def column(count, poisson_ratio, path, *, sphere):
    """Internal pressures and outer displacements of a thick sphere or, in plane strain,
    cylinder of radii 1 to 2, Y = 1 and E = 1000; unknown i moves the radius r_i.
    """
    radii, lean = np.geomspace(1.0, 2.0, count + 1), math.tan(SLICE)
    across = np.array(
        [(x * lean, y * lean * sphere, 1.0) for x in (-1, 1) for y in (-1, 1)]
    )
    directions = across / np.linalg.norm(across, axis=1)[:, None]
    nodes = 4 * (np.arange(count)[:, None] + CORNERS[:, 2]) + CORNERS @ [2, 1, 0]
    points = (radii[:, None, None] * directions).reshape(-1, 3)
    if not sphere:
        points[1::2, 1] += 2 * lean
    rows = np.arange(12 * (count + 1))
    motion = sp.csr_matrix((np.tile(directions.ravel(), count + 1), (rows, rows // 12)))
    bricks, free = (
        elements_of(nodes, np.arange(count), points[nodes]),
        np.arange(count + 1) > 0,
    )
    done = push(
        bricks,
        plasticity.j2_law(1000.0, poisson_ratio, 1.0),
        free,
        np.array([0]),
        path,
        motion=motion,
    )
    # A facet about r = 1: its area, and how its corners' radii lean.
    direction = directions[0, 2]
    area = (2 * lean * direction) * (2 * lean * (direction if sphere else 1.0))
    pressure = np.array([step.forces[0] for step in done]) / (area * direction)
    return pressure, np.array([step.unknowns[-1] for step in done])


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.499])
def test_the_thick_sphere_follows_hill_to_collapse(nu):
    """While it is plastic to the radius c, its outer surface moves by (1 - nu) Y c^3/(E
    b^2).
    """
    pressure, outer = column(20, nu, (1 - nu) * SPHERE_PATH, sphere=True)
    c = np.cbrt(outer * 4000 / (1 - nu))
    plastic = [reference.thick_sphere_pressure(r, 1, 2, 1) for r in np.clip(c, 1, 2)]
    elastic = 7 / 3 * 1000 * outer / (1 - nu)
    np.testing.assert_allclose(pressure, np.where(c <= 1, elastic, plastic), rtol=2e-3)
    assert pressure[-1] == pytest.approx(pressure[-2], rel=1e-6)


def test_the_thick_spheres_error_falls_with_second_order():
    counts = np.array([8, 16, 32])
    found = [column(int(n), 0.3, 0.7 * SPHERE_PATH, sphere=True)[0][-1] for n in counts]
    errors = np.abs(np.array(found) / (2 * math.log(2)) - 1)
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > 1.7
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.499])
def test_the_thick_cylinder_collapses_at_its_limit(nu):
    pressure, _ = column(20, nu, 4e-3 * np.linspace(0.1, 4.0, 12), sphere=False)
    # nu = 0.3 still creeps up by 1e-4 a step at this push; 20 elements err by 0.05 %.
    assert pressure[-1] == pytest.approx(2 / math.sqrt(3) * math.log(2), rel=2e-3)


def test_elements_without_mean_dilatation_lock():
    """Their load under a strip punch overshoots and keeps climbing; B-bar stands on a
    plateau.
    """
    locked, free = (
        strip_punch(4, mean_dilatation=mean) / STRIP_LIMIT for mean in (False, True)
    )
    assert locked[-1] > max(1.3, 1.02 * locked[-2])
    assert free[-1] < min(1.09, 1.001 * free[-2])  # 1.077, and 1.040 at eight elements


@pytest.mark.long
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.499])
def test_prandtls_punch_is_met_by_richardson(nu):
    coarse, fine = (strip_punch(n, poisson_ratio=nu) / STRIP_LIMIT for n in (4, 8))
    assert fine[-1] < 1.045
    assert 2 * fine[-1] - coarse[-1] == pytest.approx(1, rel=5e-3)  # first order in h
    assert fine[-1] == pytest.approx(
        fine[-2], rel=2e-3
    )  # the load has stopped climbing


# The block
# -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("depth", "first"), [(1.0, 1 / 64), (0.1, 0.05), (1e7, 1.0)])
def test_the_layers_fill_the_depth_and_thicken_slowly(depth, first):
    layers = graded_layers(depth, first)
    assert layers.sum() == pytest.approx(depth, rel=1e-12)
    assert layers[0] == pytest.approx(first, rel=0.1)
    assert (layers[1:] / layers[:-1]).max() <= GROWTH * (1 + 1e-9)


def test_grading_changes_no_wave_by_more_than_its_bound():
    scene, depth = rough_scene(64, 4, dimensions=1), half_space_depth(1.0, 0.3)
    n = round(depth * 64)
    # 0.7 %, as `GROWTH` says; 64 points a wave are off by 0.4 % on their own.
    graded = surface_compliance(scene, depth=depth)
    equal = surface_compliance(scene, depth=depth, layers=n, first_layer=depth / n)
    np.testing.assert_allclose(graded, equal, rtol=7e-3)
    deeper = surface_compliance(scene, depth=2 * depth)
    np.testing.assert_allclose(graded[1:], deeper[1:], rtol=3e-3)


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_mesh_for_other_codes_fills_one_period(dimensions):
    import pyvista

    problem = problem_of(
        rough_scene(8, 2, dimensions=dimensions), FemOptions(law="elastic")
    )
    mesh, block = mesh_of(problem), problem.block
    volumes = pyvista.from_meshio(mesh).compute_cell_sizes()["Volume"]
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(
        problem.heights.size * block.node_area * block.depth
    )
    top, base = (mesh.points[mesh.point_sets[name], 2] for name in ("top", "base"))
    np.testing.assert_allclose(base, -block.depth)
    assert np.ptp(top) == pytest.approx(np.ptp(problem.heights))


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_what_cannot_be_meshed_is_refused():
    with pytest.raises(InvalidScene, match=r"depth is 1 m.*0\.5 m"):
        block_for(
            rough_scene(8, 2, body=Body("bonded_layer", 0.5)), FemOptions(depth=1.0)
        )
    rough = rough_scene(16, 6, slope=20.0, body=Body("bonded_layer", 0.2))
    with pytest.raises(InvalidScene, match="inside out"):
        moved_elements(block_for(rough, FemOptions(geometry="moved")))
