"""The rule "near_bounds" of the theory: identities, limits, orders and refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import norm

from epcontact import persson
from epcontact.errors import InvalidScene
from epcontact.persson import (
    EnergyReduction,
    Theory,
    analytic_roughness,
    areas,
    near_bounds,
)
from epcontact.persson.near_bounds import (
    CONSTANTS,
    STRIPS,
    integrate,
    nayak_along,
    relative_wavenumbers,
    strip_area,
)
from epcontact.persson.separation import (
    elastic_energy,
    gap_distribution,
    mean_separation,
)
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

SPECTRUM = SelfAffineSpectrum(0.8, 1e5, 4e5, 64e5, 1.0)
ROUGH = analytic_roughness(SPECTRUM)
VARIANCE, BREADTH = relative_wavenumbers(ROUGH)
PATH = VARIANCE / 8, BREADTH  # E* xi = 1
#: Mean pressures and hardnesses, both over E* xi.
LOADS = [(0.05, 0.6), (0.02, 0.16), (0.3, 1.2), (0.05, math.inf)]


def fractions(state):
    """Return elastic, plastic and separated area at the end of a state, an array of
    shape (3,).
    """
    return np.array([state.elastic[-1], state.plastic[-1], state.separated[-1]])


def body(hardness=math.inf):
    """Return the theory of ROUGH by the rule "near_bounds" with E* = 1.

    `hardness` is in this unit.
    """
    return Theory(ROUGH, 1.0, EnergyReduction(CONSTANTS[0], "near_bounds"), hardness)


@settings(max_examples=25)
@given(st.floats(1e-3, 0.999), st.floats(0.05, 4.0))
def test_areas_sum_to_one_carry_the_load_and_are_those_of_the_mirror_image(
    load_fraction, hardness
):
    """Areas sum to 1 and carry the load, and the elastic area only falls.

    At the load 1 - `load_fraction`, a fraction of the hardness, plastic and separated
    area are exchanged. `hardness` is over E* xi.
    """
    state = integrate(*PATH, load_fraction * hardness, hardness, resolution=(25, 4))
    assert_allclose(state.elastic + state.plastic + state.separated, 1, rtol=1e-11)
    carried = (
        state.weights @ (state.pressure * state.density) + hardness * state.plastic[-1]
    )
    assert_allclose(carried, load_fraction * hardness, rtol=1e-10)
    assert_allclose(state.cumulative[-1], state.elastic[-1], rtol=1e-10)
    mirror = integrate(
        *PATH, (1 - load_fraction) * hardness, hardness, resolution=(25, 4)
    )
    assert_allclose(
        fractions(mirror), fractions(state)[[0, 2, 1]], rtol=1e-6, atol=1e-12
    )
    assert (np.diff(state.elastic) < 1e-12).all()


@pytest.mark.parametrize("load", LOADS)
def test_cells_and_steps_are_of_second_order_and_the_default_is_right(load):
    """Areas converge with the second order in the number of cells and steps, and by
    default are right to 0.4 %.

    `load` is mean pressure and hardness over E* xi.
    """
    finest = fractions(integrate(*PATH, *load, resolution=(400, 64)))
    # Cells, steps, and both at once are refined.
    for vary in ((1, 0), (0, 1), (1, 1)):
        factors = np.where(vary, np.array([[1], [2], [4]]), 8)
        sizes = [tuple(size) for size in (factors * (50, 8)).tolist()]
        off = [
            abs(fractions(integrate(*PATH, *load, resolution=n)) - finest).max()
            for n in sizes
        ]
        if vary == (1, 1):
            assert off[0] < 2e-4
            assert math.log2(off[0] / off[1]) > 1.6
        assert off[2] < off[0]
    usual = fractions(integrate(*PATH, *load))
    assert_allclose(usual[usual > 0], finest[usual > 0], rtol=4e-3)


@pytest.mark.parametrize("load", LOADS)
def test_one_reduction_for_all_pressures_gives_the_closed_form(load, monkeypatch):
    """With an energy reduction of 0.6 at all pressures the areas are the closed form.

    The march starts from full contact at its first diffusion. `load` is mean pressure
    and hardness over E* xi.
    """

    def reduction(pressure, *_):
        """Return 0.6 at each pressure."""
        return np.full_like(pressure, 0.6)

    monkeypatch.setattr(near_bounds, "energy_reduction_at", reduction)
    state = integrate(*PATH, *load, resolution=(200, 32))
    G = state.diffusion[0] + 0.6 * (state.diffusion - state.diffusion[0])
    for part in ("elastic", "plastic"):
        assert_allclose(getattr(state, part), getattr(areas(G, *load), part), atol=2e-4)
    exact = persson.pressure_density(state.pressure, G[-1], *load)
    assert_allclose(state.density, exact, atol=2e-3 * exact.max() + 1e-8)


def reduction(pressure, hardness, *, breadth=0.4, plastic=0.5, separated=0.5):
    """Return S at pressures (n,) over sqrt(2 tau), as the hardness is, by CONSTANTS."""
    return near_bounds.energy_reduction_at(
        np.asarray(pressure, dtype=float), hardness, 1.0, breadth, plastic, separated
    )


def test_the_reduction_is_that_of_its_formula():
    """S is gamma at a bound that is alone and 1 far from it, falls to half of its
    distance from 1 within the reach, and is the same at all pressures between two
    close bounds.

    The absorbed areas are 1/2, whose normal quantile is 0, where not given.
    """
    gamma, rho, c = CONSTANTS
    assert_allclose(reduction([0.0], math.inf), gamma)
    assert_allclose(reduction([1e4], math.inf), 1, rtol=1e-7)
    reach = math.sqrt(rho * 0.4**2.5)
    assert_allclose(reduction([reach], math.inf), 1 / (1 + (1 - gamma) / (1 + gamma)))
    # Where the normal quantile is 1, the reach is exp(kappa / 2) times as long.
    absorbed = 0.8413447460685429
    farther = reduction([reach * math.exp(1 / 3)], math.inf, separated=absorbed)
    assert_allclose(farther, reduction([reach], math.inf))
    narrow = reduction(np.linspace(0, 1e-3, 5), 1e-3)
    assert_allclose(narrow, c * 0.4**-0.5 * 1e-3**2.4, rtol=1e-5)


def test_bounds_exchange_their_parts_in_the_mirror_image():
    """S is the same at the mirror image of the pressure with plastic and separated area
    exchanged, and rises from both bounds to the middle.
    """
    sigma = np.linspace(0, 1.2, 7)
    S = reduction(sigma, 1.2, plastic=0.1, separated=0.7)
    mirror = reduction(1.2 - sigma, 1.2, plastic=0.7, separated=0.1)
    assert_allclose(S, mirror, rtol=1e-12)
    equal = reduction(sigma, 1.2)
    assert (np.diff(equal[:4]) > 0).all()
    assert_allclose(equal, equal[::-1], rtol=1e-12)


def test_limits_of_the_hardness_and_of_the_load():
    """A great hardness is the elastic body, a great load full contact with all its
    energy, and light loads have areas nearly proportional to the load.

    Of a soft body the elastic area falls as a power of the hardness, while one gamma
    lets it vanish.
    """
    elastic = fractions(integrate(*PATH, 0.05))
    assert_allclose(fractions(integrate(*PATH, 0.05, 20.0)), elastic, atol=2e-4)
    # Full contact stores all energy: the pressures have the variance 2 tau.
    full = integrate(*PATH, 5.0, resolution=(200, 8))
    assert_allclose(fractions(full), [1, 0, 0], atol=1e-8)
    assert_allclose(
        full.weights @ (full.density * (full.pressure - 5) ** 2), 1 / 4, rtol=1e-3
    )
    # At light loads the area is nearly proportional to the load: with the area that has
    # left contact the bound reaches farther, by few percent in a decade of the load.
    light = [integrate(*PATH, p).elastic[-1] / p for p in (1e-4, 1e-3)]
    assert light[1] < light[0] < 1.05 * light[1]
    # The elastic area falls as a power of the hardness, where one gamma lets it vanish.
    soft = [integrate(*PATH, 0.1 * h, h).elastic[-1] for h in (0.08, 0.16)]
    assert 0.5**5 < soft[0] / soft[1] < 0.5**2
    assert float(areas(0.536 / 8, 0.008, 0.08).elastic) < 1e-20 < soft[0]


def test_a_scene_is_solved_and_its_curves_end_at_its_areas():
    """A scene has the areas of its exact spectrum, and magnification and pressure
    curves end there.

    A lower gamma gives more area, as less pressure diffuses to zero.
    """
    surface = SelfAffine(SPECTRUM, (2 * math.pi / 1e5,) * 2, (256, 256), 3).build()
    scene = Scene(surface, Material(250e9, 0.0, 150e9), Load((5e9, 12.5e9)))
    rule = {"energy_reduction": CONSTANTS[0], "reduction": "near_bounds"}
    result = persson.solve(scene, **rule)
    exact = fractions(body(0.6).stress_state(0.05))
    assert_allclose(exact, fractions(integrate(*PATH, 0.05, 0.6)), rtol=1e-4)
    assert_allclose(result.final.areas["raw"].elastic, exact[0], rtol=1e-9)
    assert_allclose(result.final.areas["raw"].plastic, exact[1], rtol=1e-9)
    for step in result.steps:
        assert max(step.residuals.values()) < 1e-11
    assert result.distribution.cumulative[-1] == pytest.approx(exact[0], rel=1e-9)
    theory = Theory.of_scene(scene, **rule)
    curve = theory.magnification_curve(12.5e9, [1, 4, 64])
    assert curve.total[0] == 1
    assert curve.elastic[2] == pytest.approx(exact[0], rel=1e-3)
    at_four = theory.pressure_curve(12.5e9, 4.0)
    assert at_four.cumulative[-1] == pytest.approx(curve.elastic[1], rel=1e-3)
    assert theory.pressure_curve(12.5e9, 1.0).cumulative[-1] == 1
    other = persson.solve(scene, energy_reduction=0.3, reduction="near_bounds")
    assert other.final.areas["raw"].total > result.final.areas["raw"].total


def test_each_load_of_a_path_is_integrated_once(monkeypatch):
    """Areas, distribution and expected errors of a load share one integration."""
    ends = []

    def integrate_and_count(*arguments, **options):
        """Return the stress, and note the mean pressure in `ends`."""
        ends.append(arguments[2])
        return integrate(*arguments, **options)

    monkeypatch.setattr(persson.theory, "integrate", integrate_and_count)
    surface = SelfAffine(SPECTRUM, (2 * math.pi / 1e5,) * 2, (256, 256), 3).build()
    scene = Scene(surface, Material(250e9, 0.0, 150e9), Load((5e9, 12.5e9)))
    rule = {"energy_reduction": CONSTANTS[0], "reduction": "near_bounds"}
    result = persson.solve(scene, **rule)
    assert ends == [5e9, 12.5e9]
    assert "gap" in result.notes[-1]


@pytest.mark.parametrize("relative_hardness", [0.05, 0.3, 1.2])
def test_the_area_of_strips_is_the_integral_over_the_slopes(relative_hardness):
    """The area of strips agrees with adaptive quadrature of its definition.

    `relative_hardness` is over E* xi; a tenth of the area is in contact.
    """

    def integrand(slope):
        """Return the integrand of F at a slope over the rms slope."""
        decay = math.pi / (2 * relative_hardness)
        return slope**3 * math.exp(-(slope**2) - decay * slope)

    C, m, _ = STRIPS
    level = norm.ppf(0.1)
    exact = C * 20.0**m * math.exp(-(level**2) / 2) * quad(integrand, 0, 9)[0]
    found = strip_area(np.array([relative_hardness]), np.array([20.0]), 0.1)
    assert_allclose(found, exact, rtol=1e-7)


@pytest.mark.parametrize("load_fraction", [0.02, 0.4, 0.7])
def test_a_soft_body_has_the_elastic_area_of_strips_and_a_hard_one_has_not(
    load_fraction,
):
    """At a hardness of .08 E* xi the elastic area is that of strips, at 1.2 it is that
    of the diffusion equation; the load is carried and the mirror image is exact.

    `load_fraction` is p0 over the hardness.
    """
    soft = body(0.08).stress_state(0.08 * load_fraction)
    nayak = nayak_along(ROUGH)[-1:]
    exact = strip_area(np.array([0.08]), nayak, load_fraction)
    assert_allclose(soft.elastic[-1], exact, rtol=1e-3)
    load = soft.force + 0.08 * soft.plastic[-1]
    assert load == pytest.approx(0.08 * load_fraction, rel=1e-10)
    mirrored = body(0.08).stress_state(0.08 * (1 - load_fraction))
    assert_allclose(fractions(mirrored), fractions(soft)[[0, 2, 1]], rtol=1e-8)
    hard = body(1.2).stress_state(1.2 * load_fraction)
    diffusion = integrate(*PATH, 1.2 * load_fraction, 1.2)
    assert_allclose(fractions(hard), fractions(diffusion), rtol=1e-5)


def test_what_the_rule_does_not_have_is_refused():
    """Persson's energy and gap, the factor, a load beyond the hardness and a flat
    surface raise InvalidScene.
    """
    theory = body(0.6)
    for function, arguments in (
        (elastic_energy, (theory, 0.05)),
        (mean_separation, (theory, 0.05)),
        (gap_distribution, (theory, 0.05, [0.0])),
        (mean_separation, (body(), 0.05)),
        (theory.reduction.factor, (0.5,)),
    ):
        with pytest.raises(
            InvalidScene, match="no diffusion G: it gives no distribution"
        ):
            function(*arguments)
    with pytest.raises(InvalidScene, match="between 0 and the hardness"):
        theory.magnification_curve(0.7)
    flat = persson.roughness_of(Surface(np.zeros((8, 8)), (1.0, 1.0)), "surface")
    with pytest.raises(InvalidScene, match="flat"):
        replace(theory, roughness=flat).stress_state(0.05)


@pytest.mark.parametrize("pressure", [0, -1.0, 0.6, math.nan, "much", [0.1]])
def test_a_pressure_out_of_range_is_one_sentence(pressure):
    """A mean pressure that is no number from 0 to the hardness of 0.6 is refused."""
    theory = Theory(ROUGH, 2.0, EnergyReduction(0.385, "near_bounds"), hardness=0.6)
    with pytest.raises(InvalidScene, match=r"^mean_pressure is .* but must"):
        theory.contact_areas(pressure)


@pytest.mark.parametrize("field", ["effective_modulus", "hardness"])
def test_a_theory_of_a_body_without_stiffness_is_refused(field):
    """A modulus or a hardness that is not positive is refused by its name."""
    theory = Theory(ROUGH, 2.0, EnergyReduction(0.385, "constant"), hardness=0.6)
    with pytest.raises(InvalidScene, match=f"^{field} is -1"):
        replace(theory, **{field: -1.0})


def test_light_roughness_leaves_full_contact_and_the_breadth_is_a_mean_wave_number():
    """Light roughness leaves full contact.

    The breadth is the mean wave number by slope variance over the highest one.
    """
    state = integrate(np.array([1e-8]), np.array([1.0]), 0.05, 0.6)
    assert_allclose(fractions(state), [1, 0, 0], atol=1e-12)
    assert_allclose(BREADTH[0], 1, rtol=1e-4)
    q = np.linspace(1e5, 64e5, 200001)
    C = np.where(q < 4e5, 1.0, (q / 4e5) ** -3.6)
    weights = q**3 * C
    assert_allclose(BREADTH[-1], (weights @ q) / weights.sum() / 64e5, rtol=1e-4)
