"""The elastic block inverted wave by wave: against the assembled matrix and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.sparse as sp
from skfem import Basis, BilinearForm, ElementHex1, ElementVector, LinearForm
from skfem.helpers import ddot, div, sym_grad

from epcontact.reference.layers import surface_compliance as exact_compliance
from fem_check import plasticity
from fem_check.certify import layer_mesh
from fem_check.linear_solver import eliminate, factorise, substitute, top_descent
from fem_check.mesh import PeriodicBlock, flat_elements, graded_layers

RULE = plasticity.law(1.7, 0.3, math.inf)


def assembled_stiffness(block: PeriodicBlock, shear: float, bulk: float):  # type: ignore[no-untyped-def]
    """The sparse elastic stiffness of a small block, degrees of freedom 3 node + component.

    With b_e the integral of the divergence over element e, the dilatational part is the sum of
    K/V_e b_e b_e^T: the mean dilatation's energy.
    """
    nx, ny = block.shape
    size = 3 * (len(block.layers) + 1) * nx * ny
    total = sp.csr_matrix((size, size))
    positions = block.positions()
    deviatoric = BilinearForm(  # dev e : dev f = e : f - tr e tr f / 3
        lambda u, v, w: 2 * shear * (ddot(sym_grad(u), sym_grad(v)) - div(u) * div(v) / 3)
    )
    divergence = LinearForm(lambda v, w: div(v))
    for k in range(len(block.layers)):
        mesh, at = layer_mesh(block, positions[k : k + 2])
        basis = Basis(mesh, ElementVector(ElementHex1()), intorder=2)
        local = divergence.coo_data(basis)
        element = np.tile(np.arange(basis.nelems), basis.Nbfun)
        b = sp.csr_matrix((local.data, (local.indices[0], element)), (basis.N, basis.nelems))
        K = deviatoric.assemble(basis) + b @ sp.diags(bulk / basis.dx.sum(axis=1)) @ b.T
        node = ((k + at[0]) * nx + at[1]) * ny + at[2]
        target = np.empty(basis.N, dtype=np.int64)
        for component in range(3):
            target[basis.nodal_dofs[component]] = 3 * node + component
        join = sp.csr_matrix((np.ones(basis.N), (np.arange(basis.N), target)), (basis.N, size))
        total = total + join.T @ K @ join
    return total.tocsr()


def random_field(block: PeriodicBlock, seed: int) -> np.ndarray:
    """A displacement that vanishes where the base is held."""
    u = np.random.default_rng(seed).standard_normal(block.field_shape)
    if block.sliding:
        u[-1] -= u[-1].mean(axis=(0, 1))
        u[-1, ..., 2] = 0
    else:
        u[-1] = 0
    return u


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("shape", [(8, 6), (7, 5), (12, 1), (2, 2)])
def test_it_inverts_the_stiffness_that_scikit_fem_assembles(
    shape: tuple[int, int], sliding: bool
) -> None:
    block = PeriodicBlock(shape, (0.1, 0.13), graded_layers(0.6, 0.1, 5), sliding)
    K = assembled_stiffness(block, RULE.shear, RULE.bulk)
    factor = factorise(block, flat_elements(block), RULE)
    u = random_field(block, 21)
    force = (K @ u.ravel()).reshape(u.shape)
    if sliding:
        force[-1, ..., 2] = 0
    else:
        force[-1] = 0
    found = substitute(factor, eliminate(factor, force), np.zeros(shape))
    assert np.abs(found - u).max() < 1e-12 * np.abs(u).max()


def test_scikit_fems_stiffness_is_the_one_the_elements_apply() -> None:
    for shape in ((6, 4), (6, 1)):
        block = PeriodicBlock(shape, (0.1, 0.13), graded_layers(0.6, 0.1, 5))
        K = assembled_stiffness(block, RULE.shear, RULE.bulk)
        u = np.random.default_rng(22).standard_normal((K.shape[0] // 3, 3))
        product, _ = plasticity.internal_force(u, flat_elements(block), RULE, None)
        difference = np.abs(K @ u.ravel() - product.ravel()).max()
        assert difference < 1e-12 * np.abs(product).max()


def test_pressing_forces_act_downward_on_the_top() -> None:
    block = PeriodicBlock((8, 8), (0.1, 0.1), graded_layers(0.8, 0.1))
    factor = factorise(block, flat_elements(block), RULE)
    pressing = np.random.default_rng(23).random((8, 8))
    force = np.zeros(block.field_shape)
    force[0, ..., 2] = -pressing
    spectrum = eliminate(factor, force)
    descent = top_descent(factor, spectrum)
    u = substitute(factor, spectrum, np.zeros((8, 8)))
    np.testing.assert_allclose(descent, -u[0, ..., 2], atol=1e-14)
    same = substitute(factor, eliminate(factor, 0 * force), pressing)
    np.testing.assert_allclose(same, u, atol=1e-14)


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.45])
def test_every_waves_compliance_converges_to_the_closed_form(
    poisson_ratio: float, sliding: bool
) -> None:
    """Layer of depth 1/2 and equal layers: second order in the points a wave."""
    rule = plasticity.law(1.0, poisson_ratio, math.inf)
    errors = []
    grids = np.array([32, 64, 128])
    waves = np.array([1, 2, 4])
    for n in grids:
        block = PeriodicBlock((n, 1), (1 / n, 1 / n), np.full(n // 2, 1 / n), sliding)
        found = factorise(block, flat_elements(block), rule).surface[:, 0] * block.node_area
        exact = exact_compliance(2 * np.pi * waves, 0.5, 1.0, poisson_ratio, bonded=not sliding)
        errors.append(np.abs(found[waves] / exact - 1))
        # Uniform compression is exact on any mesh.
        depth_over_modulus = 0.5 * (1 + poisson_ratio) * (1 - 2 * poisson_ratio)
        assert found[0] == pytest.approx(depth_over_modulus / (1 - poisson_ratio), rel=1e-12)
    order = -np.polyfit(np.log(grids), np.log(errors), 1)[0]
    assert (np.abs(order - 2) < 0.1).all(), order
    # 32 points a wave; measured 0.2 to 0.4 %.
    assert errors[-1][2] < 5e-3
