"""The J2 law and its bricks: at a point, as limit loads of small bodies, as a block."""

import math
from dataclasses import replace

import numpy as np
import pytest
import reference_plasticity as reference
import scipy.sparse as sp
from fem_scenes import rough_scene
from limit_load import STRIP_LIMIT, push, strip_punch

from epcontact.errors import InvalidScene
from epcontact.scene import Body, Material
from fem_check import FemOptions, mesh_of, plasticity, surface_compliance
from fem_check.driver import problem_of
from fem_check.element import CORNERS, elastic_stiffness, elements_of
from fem_check.mesh import (
    GROWTH,
    block_for,
    graded_layers,
    half_space_depth,
    moved_elements,
)
from fem_check.plasticity import j2_law, law_of

POISSON_RATIOS = [0.0, 0.3, 0.499]

# --- the law at a point


def return_map(strain, law):
    """Return (stress in Pa, accumulated plastic strain) of a J2 body without history.

    `strain` is the (3, 3) strain tensor, and `law` holds the moduli and the yield
    stress in Pa. The radial return is Simo and Hughes, box 3.1, written with (3, 3)
    tensors; the stress is a (3, 3) tensor.
    """
    mean = np.trace(strain) * np.eye(3)
    trial = 2 * law.shear_modulus * (strain - mean / 3)
    norm = np.linalg.norm(trial)
    over = max(norm - np.sqrt(2 / 3) * law.yield_stress, 0.0)
    multiplier = over / (2 * law.shear_modulus + 2 / 3 * law.hardening_modulus)
    stress = trial * (1 - 2 * law.shear_modulus * multiplier / norm)
    return stress + law.bulk_modulus * mean, np.sqrt(2 / 3) * multiplier


def components(tensor):
    """Return the components (xx, yy, zz, xy, yz, zx) of a (3, 3) tensor."""
    return tensor[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]


class Brick:
    """One skewed brick of unit size, with a random displacement of its corners that
    makes it yield.

    E = 2, nu = 0.3, and `yield_stress` and `hardening_modulus` are in the unit of E;
    `u` is the (8, 3) displacement of the corners, and `history` that of an unloaded
    brick.
    """

    def __init__(self, seed, yield_stress=0.02, hardening_modulus=0.0, curve=()):
        """Create the brick; `seed` draws its corners and the displacement.

        `yield_stress` and `hardening_modulus` are in Pa, with E = 2 Pa; `curve` is a
        hardening curve of points (plastic strain, stress in Pa).
        """
        rng = np.random.default_rng(seed)
        self.corners = CORNERS + 0.1 * rng.standard_normal((8, 3))
        self.elements = elements_of(np.arange(8)[None], np.zeros(1), self.corners[None])
        self.u = 0.05 * rng.standard_normal((8, 3))
        material = Material(
            2.0,
            0.3,
            yield_stress=yield_stress,
            hardening_modulus=hardening_modulus,
            hardening_curve=curve,
        )
        self.law = law_of(material, flows=True)
        self.history = plasticity.initial_history(1)

    def internal_force(self, u):
        """Return (forces, flowing) of the brick at the displacement `u` of its corners.

        The forces have the shape (8, 3); `flowing` tells of each element whether it
        yields.
        """
        return plasticity.internal_force(u, self.elements, self.law, self.history)


#: A hardening curve (plastic strain, stress in Pa) whose slope falls and rises.  The
#: strains of a `Brick` reach all of its segments and go beyond its end.
CURVE = ((0.0, 0.02), (0.01, 0.03), (0.04, 0.031), (0.07, 0.05))


@pytest.mark.parametrize(
    "hardening",
    [{}, {"hardening_modulus": 0.3}, {"curve": CURVE}],
)
def test_the_element_tangent_is_the_derivative_of_the_internal_force(hardening):
    """Elastic stiffness plus plastic correction is the central difference of the force.

    `hardening` are arguments of `Brick`. Five random directions with steps of 1e-7
    agree to 1e-6 of the largest component.
    """
    brick = Brick(3, **hardening)
    _, flowing = brick.internal_force(brick.u)
    assert flowing.all()
    correction = plasticity.tangent_correction(
        brick.u, brick.elements, brick.law, brick.history, flowing
    )
    for v in np.random.default_rng(4).standard_normal((5, 8, 3)):
        product, _ = plasticity.internal_force(v, brick.elements, brick.law, None)
        plasticity.add_correction(v, brick.elements, correction, 1.0, product)
        ahead, _ = brick.internal_force(brick.u + 1e-7 * v)
        behind, _ = brick.internal_force(brick.u - 1e-7 * v)
        derivative = (ahead - behind) / 2e-7
        scale = np.abs(product).max()
        np.testing.assert_allclose(product, derivative, atol=1e-6 * scale)


def test_every_return_ends_on_the_hardening_curve():
    """After two steps the von Mises stress at each Gauss point is that of the curve.

    The strains of the two steps end in all segments of the curve and beyond its end,
    and the plastic work is the curve's area up to the strain.
    """
    brick = Brick(3, curve=CURVE)
    history = brick.history
    strains = []
    for fraction in (0.2, 0.4, 1.0):
        arguments = fraction * brick.u, brick.elements, brick.law, history
        stress = plasticity.stresses(*arguments)[0]
        _, flowing = plasticity.internal_force(*arguments)
        history = plasticity.commit(*arguments, flowing)
        accumulated = history.accumulated[1]
        deviator = stress.copy()
        deviator[:3] -= stress[:3].mean(axis=0)
        squared = (deviator[:3] ** 2).sum(axis=0) + 2 * (deviator[3:] ** 2).sum(axis=0)
        von_mises = np.sqrt(1.5 * squared)
        curve = np.interp(accumulated, *np.transpose(CURVE))
        flowed = accumulated > 0
        np.testing.assert_allclose(von_mises[flowed], curve[flowed], rtol=1e-12)
        strains.extend(accumulated[flowed])
    segments = set(np.searchsorted([strain for strain, _ in CURVE], strains))
    assert segments == {1, 2, 3, 4}
    for strain in strains:
        a = np.append([x for x, _ in CURVE if x < strain], strain)
        work = np.trapezoid(np.interp(a, *np.transpose(CURVE)), a)
        computed = plasticity.plastic_work_density(np.array(strain), brick.law)
        assert computed == pytest.approx(work, rel=1e-12)


@pytest.mark.parametrize("yield_stress", [0.02, 1e3])
def test_the_compiled_element_agrees_with_the_point_law(yield_stress):
    """Stress and plastic strain at the 8 Gauss points are those of `return_map`.

    The strain of mean dilatation (B-bar) is put together here from the gradients. With
    the yield stress 0.02 all points flow, and with 1e3 none does.
    """
    brick = Brick(5, yield_stress, 0.1)
    arguments = brick.u, brick.elements, brick.law, brick.history
    stress = plasticity.stresses(*arguments)[0]
    _, flowing = plasticity.internal_force(*arguments)
    history = plasticity.commit(*arguments, flowing)
    assert (history.rows > 0).all() == flowing.all() == (yield_stress < 1)
    mean_gradients = brick.elements.mean_gradients[0]
    dilatation = np.einsum("ja,aj->", mean_gradients, brick.u)
    for q in range(8):
        gradients = brick.elements.gradients[0, :, :, q]
        local = np.einsum("ja,ai->ij", gradients, brick.u)
        strain = (local + local.T) / 2
        strain += np.eye(3) * (dilatation - np.trace(strain)) / 3
        expected, accumulated = return_map(strain, brick.law)
        np.testing.assert_allclose(
            stress[:, q], components(expected), rtol=1e-12, atol=1e-15
        )
        computed = history.accumulated[history.rows[0], q]
        assert computed == pytest.approx(accumulated, rel=1e-12)


def test_the_elastic_element_passes_the_patch_test_and_has_six_rigid_motions():
    """A uniform strain of a skewed brick gives a uniform stress, and 6 eigenvalues are
    0.
    """
    brick = Brick(7, math.inf)
    gradient = 1e-3 * np.random.default_rng(8).standard_normal((3, 3))
    expected, _ = return_map((gradient + gradient.T) / 2, brick.law)
    u = brick.corners @ gradient.T
    stress = plasticity.stresses(u, brick.elements, brick.law, None)[0]
    uniform = np.tile(components(expected)[:, None], 8)
    np.testing.assert_allclose(stress, uniform, rtol=1e-11)
    eigenvalues = np.linalg.eigvalsh(elastic_stiffness(brick.elements, 0, 0.4, 0.9))
    assert (np.abs(eigenvalues[:6]) < 1e-14).all()
    assert eigenvalues[6] > 1e-3


# --- limit loads

#: Half of the angle that a column of bricks subtends, in rad.
SLICE = 0.01
#: Displacements of the inner surface, up to half as much again as full yield takes.
SPHERE_PATH = 8e-3 * np.linspace(0.02, 1.5, 12)


def column(count, poisson_ratio, path):
    """Return (inner pressures, outer displacements), one value for each step of `path`.

    The body is a sphere with the radii 1 to 2, Y = 1 and E = 1000 (pressures are in
    units of Y, lengths in units of the inner radius), as a column of `count` bricks.
    `path` holds the displacements of the inner surface. Unknown i moves all nodes of
    the radius r_i along their directions.
    """
    radii = np.geomspace(1.0, 2.0, count + 1)
    lean = math.tan(SLICE)
    corners = [(x * lean, y * lean, 1.0) for x in (-1, 1) for y in (-1, 1)]
    directions = corners / np.linalg.norm(corners, axis=1)[:, None]
    points = (radii[:, None, None] * directions).reshape(-1, 3)
    nodes = 4 * (np.arange(count)[:, None] + CORNERS[:, 2]) + CORNERS @ [2, 1, 0]
    rows = np.arange(12 * (count + 1))
    motion = sp.csr_matrix((np.tile(directions.ravel(), count + 1), (rows, rows // 12)))
    steps = push(
        elements_of(nodes, np.arange(count), points[nodes]),
        j2_law(1000.0, poisson_ratio, 1.0),
        np.arange(count + 1) > 0,
        np.array([0]),
        path,
        motion=motion,
    )
    # The area of the facet at r = 1, and the lean of its corners' radii.
    direction = directions[0, 2]
    width = 2 * lean * direction
    forces = np.array([step.forces[0] for step in steps])
    outer = np.array([step.unknowns[-1] for step in steps])
    return forces / (width**2 * direction), outer


@pytest.mark.parametrize("poisson_ratio", POISSON_RATIOS)
def test_the_thick_sphere_follows_hill_to_collapse(poisson_ratio):
    """A thick sphere has Hill's pressure at each displacement, from elastic to
    collapse.

    While it is plastic to the radius c, its outer surface moves by (1 - nu) Y c^3/(E
    b^2).
    """
    path = (1 - poisson_ratio) * SPHERE_PATH
    pressure, outer = column(20, poisson_ratio, path)
    c = np.cbrt(outer * 4000 / (1 - poisson_ratio))
    elastic = 7 / 3 * 1000 * outer / (1 - poisson_ratio)
    plastic = [reference.thick_sphere_pressure(r, 1, 2, 1) for r in np.clip(c, 1, 2)]
    np.testing.assert_allclose(pressure, np.where(c <= 1, elastic, plastic), rtol=2e-3)
    assert pressure[-1] == pytest.approx(pressure[-2], rel=1e-6)


def test_the_thick_spheres_error_falls_with_second_order():
    """The collapse pressure converges to 2 Y ln(b/a) with the second order of the
    elements.
    """
    counts = [8, 16, 32]
    limits = []
    for count in counts:
        pressure, _ = column(count, 0.3, 0.7 * SPHERE_PATH)
        limits.append(pressure[-1])
    errors = np.abs(np.array(limits) / (2 * math.log(2)) - 1)
    assert np.polyfit(np.log(counts), np.log(errors), 1)[0] < -1.7
    assert errors[-1] < 1e-3


def test_elements_without_mean_dilatation_lock():
    """Under a strip punch, elements without mean dilatation never reach a limit load.

    Their load keeps climbing; that of elements with mean dilatation (B-bar) stays
    level. Loads are divided by Prandtl's limit.
    """
    locked = strip_punch(4, mean_dilatation=False) / STRIP_LIMIT
    assert locked[-1] > max(1.3, 1.02 * locked[-2])
    level = strip_punch(4) / STRIP_LIMIT
    assert level[-1] < min(1.09, 1.001 * level[-2])  # 1.077; 1.040 at eight elements


@pytest.mark.long
@pytest.mark.parametrize("poisson_ratio", POISSON_RATIOS)
def test_prandtls_punch_is_met_by_richardson(poisson_ratio):
    """The limit load of 4 and 8 elements extrapolates to Prandtl's (2 + pi) k within
    0.5 %.
    """
    coarse = strip_punch(4, poisson_ratio=poisson_ratio) / STRIP_LIMIT
    fine = strip_punch(8, poisson_ratio=poisson_ratio) / STRIP_LIMIT
    assert fine[-1] < 1.045
    assert 2 * fine[-1] - coarse[-1] == pytest.approx(1, rel=5e-3)  # first order in h
    assert fine[-1] == pytest.approx(fine[-2], rel=2e-3)  # the load is level


# --- the block


@pytest.mark.parametrize(("depth", "first"), [(1.0, 1 / 64), (0.1, 0.05), (1e7, 1.0)])
def test_the_layers_fill_the_depth_and_thicken_slowly(depth, first):
    """Layers sum up to `depth`, begin with `first`, and grow by a factor of GROWTH at
    most.

    `depth` and `first`, the thickness of the top layer, have the same unit.
    """
    layers = graded_layers(depth, first)
    assert layers.sum() == pytest.approx(depth, rel=1e-12)
    assert layers[0] == pytest.approx(first, rel=0.1)
    assert (layers[1:] / layers[:-1]).max() <= GROWTH * (1 + 1e-9)


def test_grading_changes_no_wave_by_more_than_its_bound():
    """Graded layers change the compliance of each wave by less than 0.7 %.

    The depth of a half-space's block is deep enough: twice the depth changes all waves
    but the mean by less than 0.3 %.
    """
    scene = rough_scene(64, 4, dimensions=1)
    depth = half_space_depth(1.0, 0.3)
    count = round(depth * 64)
    graded = surface_compliance(scene, depth=depth)
    equal = surface_compliance(
        scene, depth=depth, layers=count, first_layer=depth / count
    )
    # 0.7 %, as `GROWTH` says; 64 points a wave alone are off by 0.4 %.
    np.testing.assert_allclose(graded, equal, rtol=7e-3)
    deeper = surface_compliance(scene, depth=2 * depth)
    np.testing.assert_allclose(graded[1:], deeper[1:], rtol=3e-3)


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_mesh_for_other_codes_fills_one_period(dimensions):
    """The exported bricks have positive volumes that sum up to area times depth.

    The base lies at minus the depth, and the top has the range of the heights.
    """
    import pyvista

    scene = rough_scene(8, 2, dimensions=dimensions)
    problem = problem_of(scene, FemOptions(law="elastic"))
    mesh = mesh_of(problem)
    depth = problem.block.depth
    volumes = pyvista.from_meshio(mesh).compute_cell_sizes()["Volume"]
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(problem.area * depth)
    top = mesh.points[mesh.point_sets["top"], 2]
    base = mesh.points[mesh.point_sets["base"], 2]
    np.testing.assert_allclose(base, -depth)
    assert np.ptp(top) == pytest.approx(np.ptp(problem.heights))


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_what_cannot_be_meshed_is_refused():
    """A block that is deeper than its layer, or with elements inside out, raises
    `InvalidScene`.
    """
    layer = rough_scene(8, 2, body=Body("bonded_layer", 0.5))
    with pytest.raises(InvalidScene, match=r"depth is 1 m.*0\.5 m"):
        block_for(layer, FemOptions(depth=1.0))
    rough = rough_scene(16, 6, slope=20.0, body=Body("bonded_layer", 0.2))
    block = block_for(rough, FemOptions(geometry="moved"))
    valley = -rough.surface.heights.min()
    message = f"inside out: the deepest valley is {valley:.3g} m .* is 0.2 m deep"
    with pytest.raises(InvalidScene, match=message):
        moved_elements(block)
    deep = replace(rough, body=Body("bonded_layer", 1.01 * valley))
    moved_elements(block_for(deep, FemOptions(geometry="moved")))
