"""The surface compliance of each body, its limits and its independence of scale."""

import numpy as np
import pytest

from epcontact.bem.kernel import (
    quarter_compliance,
    rfft_wavenumbers,
    surface_compliance,
)
from epcontact.materials.moduli import effective_modulus, oedometric_modulus
from epcontact.reference.layers import surface_compliance as plane_strain_compliance
from epcontact.scene import Body, Material

E = 250e9
DEPTH = 1e-5
RATIOS = (-0.5, 0.0, 0.3, 0.45, 0.499)
LAYERS = ("bonded_layer", "sliding_layer")


@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("kind", LAYERS)
def test_layer_agrees_with_the_plane_strain_solve(kind, nu):
    # The reference solves the 4 x 4 boundary-value problem of the layer, no closed
    # form.
    x = np.geomspace(0.05, 30, 60)
    ours = surface_compliance(x / DEPTH, Body(kind, DEPTH), Material(E, nu))
    theirs = plane_strain_compliance(
        x / DEPTH, DEPTH, E, nu, bonded=kind == "bonded_layer"
    )
    # Its matrix loses digits towards incompressibility and shallow waves.
    np.testing.assert_allclose(ours, theirs, rtol=1e-10)


@pytest.mark.parametrize("nu", RATIOS)
def test_long_waves_see_the_uniform_layer_and_the_mean_uniaxial_strain(nu):
    material, q = Material(E, nu), np.array([0.0, 1e-7, 1e-5]) / DEPTH
    bonded, sliding = (
        surface_compliance(q, Body(kind, DEPTH), material) for kind in LAYERS
    )
    uniform = DEPTH / oedometric_modulus(material)
    assert bonded[0] == sliding[0] == pytest.approx(uniform, rel=1e-15)
    # The next term of either series is (q d)^2 times up to about (1 - 2 nu)^-2 = 2.5e5.
    np.testing.assert_allclose(bonded, uniform, rtol=1e-4)
    np.testing.assert_allclose(
        sliding[1:], DEPTH / effective_modulus(material), rtol=1e-9
    )


def test_deep_layer_is_the_half_space_without_overflow():
    q = np.array([20.0, 400.0, 1e6, 1e200]) / DEPTH
    half_space = surface_compliance(q, Body(), Material(E, 0.3))
    for (
        kind
    ) in LAYERS:  # at q d = 20 the difference is about (q d)^2 exp(-2 q d) = 2e-15
        layer = surface_compliance(q, Body(kind, DEPTH), Material(E, 0.3))
        np.testing.assert_allclose(layer, half_space, rtol=1e-14)
    assert surface_compliance(np.zeros(1), Body(), Material(E, 0.3)) == 0


@pytest.mark.parametrize("shape", [(8, 6), (7, 6), (5, 9)])
def test_quarter_holds_every_mode(shape):
    periods = (3e-4, 1e-4)
    material, body = Material(E, 0.2), Body("bonded_layer", DEPTH)
    full = surface_compliance(rfft_wavenumbers(shape, periods), body, material)
    quarter = quarter_compliance(shape, periods, body, material)
    rows = np.minimum(np.arange(shape[0]), shape[0] - np.arange(shape[0]))
    np.testing.assert_array_equal(full, quarter[rows])
