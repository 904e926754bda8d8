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
RATIOS = pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.45, 0.499])
LAYERS = pytest.mark.parametrize("kind", ["bonded_layer", "sliding_layer"])


@RATIOS
@LAYERS
def test_layer_agrees_with_the_plane_strain_solve(kind, nu):
    # The reference solves the 4 x 4 boundary-value problem of the layer, no closed
    # form.
    """The compliance of a layer is that of the 4 x 4 boundary-value problem to 1e-10.

    `kind` is that of `Body`, and `nu` Poisson's ratio.
    """
    q = np.geomspace(0.05, 30, 60) / DEPTH
    found = surface_compliance(q, Body(kind, DEPTH), Material(E, nu))
    bonded = kind == "bonded_layer"
    expected = plane_strain_compliance(q, DEPTH, E, nu, bonded=bonded)
    # Its matrix loses digits towards incompressibility and shallow waves.
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@RATIOS
def test_long_waves_see_the_uniform_layer_and_the_mean_uniaxial_strain(nu):
    """For long waves a layer has the compliance d/M of uniaxial strain, or d/E* if it
    slides.

    d is the depth and M the oedometric modulus; the mean of a sliding layer has d/M,
    too.
    """
    material = Material(E, nu)
    q = np.array([0.0, 1e-7, 1e-5]) / DEPTH
    bonded = surface_compliance(q, Body("bonded_layer", DEPTH), material)
    sliding = surface_compliance(q, Body("sliding_layer", DEPTH), material)
    uniform = DEPTH / oedometric_modulus(material)
    assert bonded[0] == sliding[0] == pytest.approx(uniform, rel=1e-15)
    # The next term of either series is (q d)^2 times up to about (1 - 2 nu)^-2 = 2.5e5.
    np.testing.assert_allclose(bonded, uniform, rtol=1e-4)
    frictionless = DEPTH / effective_modulus(material)
    np.testing.assert_allclose(sliding[1:], frictionless, rtol=1e-9)


@LAYERS
def test_deep_layer_is_the_half_space_without_overflow(kind):
    """For wave numbers from 20 to 1e200 over the depth, a layer is a half-space to
    1e-14.
    """
    q = np.array([20.0, 400.0, 1e6, 1e200]) / DEPTH
    material = Material(E, 0.3)
    half_space = surface_compliance(q, Body(), material)
    layer = surface_compliance(q, Body(kind, DEPTH), material)
    # At q d = 20 the difference is about (q d)^2 exp(-2 q d) = 2e-15.
    np.testing.assert_allclose(layer, half_space, rtol=1e-14)


def test_the_mean_displacement_of_a_half_space_is_left_out():
    """The compliance of a half-space at wave number 0 is 0."""
    assert surface_compliance(np.zeros(1), Body(), Material(E, 0.3)) == 0


@pytest.mark.parametrize("shape", [(8, 6), (7, 6), (5, 9)])
def test_quarter_holds_every_mode(shape):
    """A quarter of the modes holds the compliance of all of them, on even and odd
    grids.
    """
    periods = (3e-4, 1e-4)
    material = Material(E, 0.2)
    body = Body("bonded_layer", DEPTH)
    full = surface_compliance(rfft_wavenumbers(shape, periods), body, material)
    quarter = quarter_compliance(shape, periods, body, material)
    i = np.arange(shape[0])
    np.testing.assert_array_equal(full, quarter[np.minimum(i, shape[0] - i)])
