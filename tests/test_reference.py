"""Exact solutions: integrals and limits, closed forms as gates read them, orders
towards them.
"""

import math
from dataclasses import replace
from functools import partial

import mpmath
import numpy as np
import pytest
import reference_plasticity
from numpy.testing import assert_allclose
from scipy.integrate import quad

from epcontact import bem
from epcontact.errors import InvalidCase
from epcontact.output.charts.plot import observed_order
from epcontact.persson import areas
from epcontact.reference import CLOSED_FORMS, bumps, posts, waves, yielding
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import FlatPunch, Paraboloid, SelfAffine, Sinusoid

RADIUS = 2.5e-3
MODULUS = 70e9
ELASTIC = Material(2.0e11, 0.3)
STIFFNESS = 2.0e11 / 0.91
L = 1e-3


def integral(function, low, high):
    """Return the integral of a function of one number from `low` to `high`."""
    found = quad(
        lambda x: float(function(x)), low, high, epsabs=1e-13, epsrel=1e-11, limit=200
    )
    return float(found[0])


def periodic_displacement(pressure, points, period):
    """Return the displacement in m at points of a line, without its mean, under a
    pressure.

    Args:
        pressure: mean over each of n equal cells of the period, in Pa, shape (n,).
        points: coordinates in m at which the displacement is interpolated.
        period: length of the line in m.

    The kernel is -(2 / (pi E*)) ln|2 sin(pi x / L)|. Kinks of the pressure limit the
    spectral sum to an accuracy of about 1e-5.
    """
    n = len(pressure)
    q = 2 * np.pi * np.fft.rfftfreq(n, period / n)
    symbol = np.divide(2 / MODULUS, q, out=np.zeros_like(q), where=q > 0)
    u = np.fft.irfft(symbol * np.fft.rfft(pressure), n)
    return np.interp(points, np.arange(n) * period / n, u)


def test_lattice_sums():
    """The constants of the square lattice equal products of the zeta and the beta
    function.
    """

    def known(power):
        """Return 4 zeta(power) beta(power), the sum over a square lattice."""
        return 4 * float(mpmath.zeta(power) * mpmath.dirichlet(power, [0, 1, 0, -1]))

    found = (bumps.LATTICE_SUM_3, bumps.LATTICE_SUM_5, -bumps.MADELUNG)
    assert found == pytest.approx(
        [known(power) for power in (1.5, 2.5, 0.5)], rel=1e-14
    )


def test_spheres_on_a_lattice():
    """Hertz without images, which act as extra curvature; the rest grows as (a/L)^5."""
    a = bumps.sphere_contact_radius(12.0, RADIUS, MODULUS)
    alone = bumps.sphere_contact_radius_periodic(12.0, RADIUS, MODULUS, math.inf)
    assert alone == pytest.approx(a, rel=1e-12)
    for ratio in (0.05, 0.1, 0.2):
        force = 4 * MODULUS * (ratio * L) ** 3 / (3 * RADIUS)
        found = bumps.sphere_contact_radius_periodic(force, RADIUS, MODULUS, L) / (
            ratio * L
        )
        assert found == pytest.approx(
            (1 + 1.91699406 * ratio**3) ** (-1 / 3), abs=3 * ratio**5
        )
        assert found < 1


def test_cylinders_in_a_row():
    """Cylinders in a row carry the force -(E* L^2 / (2 pi R)) ln cos(pi a / L) on the
    half-width a, and their surface is flat in the contact.
    """

    def pressure(x, a):
        """Return the pressure in Pa at x of a row of cylinders with half-width a, in
        m.
        """
        return bumps.cylinder_pressure_periodic(x, a, RADIUS, MODULUS, L)

    for a in (0.1 * L, 0.3 * L, 0.45 * L):
        force = (
            -MODULUS
            * L**2
            / (2 * math.pi * RADIUS)
            * math.log(math.cos(math.pi * a / L))
        )
        found = bumps.cylinder_half_width_periodic(force, RADIUS, MODULUS, L)
        assert found == pytest.approx(a, rel=1e-13)
        assert 2 * integral(partial(pressure, a=a), 0, a) == pytest.approx(
            force, rel=1e-8
        )
    x = np.arange(1 << 15) * L / (1 << 15)
    inside = np.linspace(0, 0.98 * 0.35 * L, 50)
    a = 0.35 * L
    u = periodic_displacement(pressure(np.minimum(x, L - x), a), inside, L)
    assert np.ptp(inside**2 / (2 * RADIUS) + u) < 1e-5 * a**2 / RADIUS


def test_a_strip_carries_its_force_and_ends_at_its_rim():
    """The pressure of a strip punch integrates to its force and is zero outside."""
    edge = math.sin(math.pi / 4)

    def substituted(t):  # sin(pi x/L) = sin(pi a/L) sin(t): no singularity
        """Return the integrand of the pressure over t, with sin(pi x/L) = sin(pi a/L)
        sin t.

        The substitution removes the singularity at the rim.
        """
        angle = math.asin(edge * math.sin(t))
        pressure = posts.strip_pressure_periodic(
            np.array(4 / math.pi * angle), 5.0, 1.0, 4.0
        )
        return float(pressure) * 4 / math.pi * edge * math.cos(t) / math.cos(angle)

    # The part left out at the rim is 5/pi 2e-6.
    assert 2 * integral(substituted, 0, math.pi / 2 - 1e-6) == pytest.approx(
        5.0, rel=3e-6
    )
    assert posts.strip_pressure_periodic(np.array(1.5), 1.0, 1.0, 4.0) == 0


@pytest.mark.parametrize("load", [0.0, 0.01, 0.05, 0.3, 0.5, 0.9, 0.95, 1.0])
def test_means_of_a_wave_s_pressure_and_gap(load):
    """Pressure and gap of a wave integrate to the load and the mean gap, and the
    energy's slope is the work of the mean pressure.

    `load` is the mean pressure over that of complete contact.
    """
    fraction = waves.line_contact_fraction(load)
    assert math.sin(math.pi * fraction / 2) ** 2 == pytest.approx(load, abs=1e-15)
    rim = fraction / 2
    mean = 2 * integral(lambda x: waves.line_pressure(x, load), 0, rim)
    assert mean == pytest.approx(load, rel=1e-7)
    gap = 2 * integral(lambda x: waves.line_gap(x, load), rim, 0.5)
    assert gap == pytest.approx(waves.line_mean_gap(load), rel=1e-8)
    if 0 < load < 1:  # the energy is the work of the mean pressure
        step = 1e-5
        slope = (
            (waves.line_energy(load + step) - waves.line_energy(load - step)) / 2 / step
        )
        closing = (
            (waves.line_mean_gap(load - step) - waves.line_mean_gap(load + step))
            / 2
            / step
        )
        assert slope == pytest.approx(load * closing, rel=1e-6)


def test_limits_of_waves():
    """Light loads on a wave tend to Hertz's contacts, and the pressure around a nearly
    closed hole has no stress intensity at its rim.
    """
    assert (waves.line_mean_gap(0), waves.line_mean_gap(1), waves.line_energy(1)) == (
        1,
        0,
        0.25,
    )
    amplitude = 1e-6
    load = 1e-6
    complete = waves.line_complete_pressure(amplitude, L, MODULUS)
    radius = 1 / (amplitude * (2 * math.pi / L) ** 2)
    a = math.sqrt(4 * load * complete * L * radius / (math.pi * MODULUS))
    assert waves.line_contact_fraction(load) == pytest.approx(2 * a / L, rel=1e-6)
    force = 1e-4 * waves.surface_complete_pressure(amplitude, L, MODULUS) * L**2 / 2
    a = bumps.sphere_contact_radius(force, radius, MODULUS)
    light = waves.surface_contact_fraction_light(1e-4)
    assert light == pytest.approx(2 * math.pi * a**2 / L**2, rel=1e-12)
    b = math.sqrt((1 - waves.surface_contact_fraction_heavy(0.99)) / (2 * math.pi))
    missing = integral(
        lambda r: r * (0.01 - 2 * (math.pi * r) ** 2) / math.sqrt(b**2 - r**2), 0, b
    )
    assert missing == pytest.approx(0, abs=1e-9 * b)


def test_pressure_and_gap_of_a_wave_solve_the_contact_problem():
    """The elastic displacement under the pressure of a wave, less the waviness, is the
    gap of the wave, apart from a constant.
    """
    n = 16384
    load = 0.4
    amplitude = 2e-6
    x = (np.arange(n) + 0.5) / n
    p = waves.line_complete_pressure(amplitude, L, MODULUS) * waves.line_pressure(
        x, load
    )
    gap = periodic_displacement(p, np.arange(n) * L / n, L) - amplitude * np.cos(
        2 * np.pi * x
    )
    expected = amplitude * waves.line_gap(x, load)
    assert_allclose(gap - gap.mean(), expected - expected.mean(), atol=1e-5 * amplitude)


def elastic(recipe, pressure, hardness=math.inf):
    """Return the scene of a recipe at a mean pressure in Pa.

    `hardness` is in Pa; by default the body is elastic.
    """
    return Scene(recipe.build(), replace(ELASTIC, hardness=hardness), Load(pressure))


def wave(share, points=4096, hardness=math.inf):
    """Return a line of one wave at a share of the pressure that closes it.

    `points` is the number of grid points, and `hardness` is in Pa.
    """
    complete = math.pi * STIFFNESS * 1e-6 / L
    return elastic(Sinusoid((L,), (points,), 1e-6), share * complete, hardness)


def punch(points, hardness=math.inf):
    """Return a line with a flat punch of 0.3 periods at 1e8 Pa; `hardness` is in Pa."""
    return elastic(FlatPunch((L,), (points,), 0.3 * L, 1e-5), 1e8, hardness)


def rough(pressure=2e10, hardness=math.inf):
    """Return a rough surface at a mean pressure in Pa; `hardness` is in Pa."""
    spectrum = SelfAffineSpectrum(0.8, 7e3, 1.4e4, 6e4, 0.02)
    return elastic(SelfAffine(spectrum, (L, 1.2 * L), (48, 60), 3), pressure, hardness)


BUMP = elastic(Paraboloid((L,), (64,), 1e-2), 1e7)
DISC = elastic(FlatPunch((L, L), (9, 9), 4e-4, 1e-6), 1e8)
LEVEL = Scene(Surface(np.zeros(16), (L,)), ELASTIC, Load(1e8))
RIDGE = elastic(Sinusoid((L, L / 128), (512, 4), 1e-6), 1e8)
WAVY_LAYER = replace(wave(1.5), body=Body("bonded_layer", 1e-3))


def scalar(form, quantity, scene):
    """Return a quantity of a scene by the closed form of this name."""
    return CLOSED_FORMS[form].scalar(quantity, scene)


def test_capped_strip_has_its_two_limits():
    """The plastic area of a capped strip punch tends to its whole width if the cap
    carries the load, and to Irwin's plastic zone at a high hardness.
    """
    # All of it flows when hardness times width carries the load; a light load yields a
    # rim of Irwin's size: 1 - cos(pi p0/(2 sigma_P)) times cot of the half-angle.
    width = 601 / 1000
    nearly = punch(1000, 1e8 / width * (1 + 1e-9))
    assert scalar("capped_strip", "area.plastic.raw", nearly) == pytest.approx(
        width, rel=1e-3
    )
    rim = scalar("capped_strip", "area.plastic.raw", punch(1000, 1e12))
    expected = (
        2 / math.pi * (math.pi * 1e-4 / 2) ** 2 / 2 / math.tan(math.pi * width / 2)
    )
    assert rim == pytest.approx(expected, rel=1e-6)


def largest_mises_stress(pressure, poisson_ratio, depths):
    """Return the largest von Mises stress below a periodic pressure, for each depth.

    The period is 1 m along both directions; `pressure` (nx, ny) in Pa, depths in m.
    """
    stresses = [
        yielding.mises_stress(pressure, (1.0, 1.0), poisson_ratio, depth)
        for depth in depths
    ]
    return np.array([stress.max() for stress in stresses])


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.45])
def test_a_sphere_yields_first_on_its_axis(poisson_ratio):
    """Below Hertz's pressure the largest von Mises stress, and its depth, are those of
    the formulas on the axis of a single sphere.

    The contact radius is a twentieth of the period, so that the periodic images change
    the stress by .25 %.
    """
    radius = 0.05
    x = np.arange(256) / 256 - 0.5
    pressure = np.sqrt(np.maximum(1 - (x[:, None] ** 2 + x**2) / radius**2, 0))
    depths = radius * np.linspace(0.3, 0.6, 31)
    largest = largest_mises_stress(pressure, poisson_ratio, depths)
    peak, depth = reference_plasticity.sphere_onset(poisson_ratio)
    assert largest.max() == pytest.approx(1 / peak, rel=5e-3)
    assert depths[largest.argmax()] / radius == pytest.approx(depth, abs=0.015)


def test_stresses_below_a_wave_do_not_depend_on_its_direction():
    """Below a wave at 45 degrees to the grid, von Mises' stress is that below a wave
    along the grid, although other components are not zero.

    With a Poisson's ratio of 1/2 it is sqrt(3) q z exp(-q z) everywhere.
    """
    turns = np.arange(32) / 32
    along = np.broadcast_to(np.cos(2 * np.pi * turns)[:, None], (32, 32))
    across = np.cos(2 * np.pi * np.add.outer(turns, turns))
    for nu in (0.2, 0.5):
        expected = yielding.mises_stress(along, (1.0, 1.0), nu, 0.1)
        found = yielding.mises_stress(across, (1.0, 1.0), nu, 0.1 / math.sqrt(2))
        assert_allclose(found[0], expected[:, 0], rtol=1e-12)
    depth = 2 * np.pi * 0.1
    assert_allclose(expected, math.sqrt(3) * depth * math.exp(-depth), rtol=1e-12)


def test_theory_tends_to_the_light_load_line_at_a_gamma_of_two_over_pi():
    """Persson's area at gamma = 2/pi is the straight line of light loads in the limit,
    and 0.6 % below at an area of 0.15.

    The slope of the line is kappa = sqrt(8 / (pi gamma)) = 2.
    """
    for load, deviation in ((1e-6, 0), (0.0749, 6e-3)):
        scene = rough(load * 0.02 * STIFFNESS)
        line = scalar("light_load", "area.total.corrected", scene)
        assert line == pytest.approx(2 * load, rel=1e-12)
        theory = areas(
            2 / math.pi * (0.02 * STIFFNESS) ** 2 / 8, scene.load.final
        ).elastic
        assert theory == pytest.approx(
            line * (1 - deviation), rel=deviation / 10 + 1e-10
        )


@pytest.mark.parametrize(
    ("form", "quantity", "scene", "words"),
    [
        ("hertz", "quantity.mean_gap", BUMP, ""),
        ("capped_strip", "area.plastic.raw", punch(100, 1.1e8), ""),
        ("flat_punch", "quantity.conductance", DISC, ""),
        ("flat", "quantity.approach", LEVEL, ""),
        ("flat", "quantity.elastic_energy", WAVY_LAYER, ""),
        (
            "light_load",
            "area.total.raw",
            rough(),
            "describes .*a contact area of at most 0.15",
        ),
        (
            "westergaard",
            "quantity.elastic_energy",
            wave(1.1),
            "describes .*partial contact",
        ),
        (
            "full_contact",
            "area.total.raw",
            wave(0.9),
            "describes .*that closes every gap",
        ),
        ("bearing_area", "area.total.raw", wave(0.5), "describes .*a finite hardness"),
        (
            "waviness_light",
            "area.total.raw",
            wave(0.5),
            "describes .*the product of two waves",
        ),
        ("first_yield", "quantity.plastic_depth", WAVY_LAYER, "describes a half-space"),
        ("prandtl", "quantity.limit_pressure", BUMP, "describes .*a flat post"),
        ("prandtl", "quantity.limit_pressure", DISC, "describes a strip"),
    ],
)
def test_a_refusal_says_what_the_form_describes(form, quantity, scene, words):
    """A closed form refuses a scene or a quantity that it does not describe.

    The message is one line that names the form and matches `words`.
    """
    with pytest.raises(InvalidCase, match=rf"\A.*{form}.*{words}.*\Z"):
        scalar(form, quantity, scene)


def test_a_form_without_a_distribution_says_so():
    """A closed form without a pressure distribution names itself in the refusal."""
    with pytest.raises(InvalidCase, match="hertz has no 'distribution'"):
        CLOSED_FORMS["hertz"].pressures(BUMP)


@pytest.mark.parametrize(
    ("form", "scene"),
    [
        ("westergaard", RIDGE),
        ("full_contact", replace(rough(), body=Body("sliding_layer", 1e-4))),
    ],
)
def test_the_pressures_of_a_form_carry_the_load_on_its_area(form, scene):
    """The pressure field of a closed form has the mean pressure of the load and the
    form's contact area.

    The cases compare the fields of the other closed forms with boundary elements.
    """
    pressure = CLOSED_FORMS[form].field("pressure", scene)
    area = scalar(form, "area.total.raw", scene)
    assert pressure.mean() == pytest.approx(scene.load.final, rel=1e-3)
    assert np.mean(pressure > 0) == pytest.approx(area, abs=2e-3)


def test_the_work_on_a_level_layer_is_stored_or_spent():
    """Elastic energy and plastic work of a level layer add up to the integral of the
    pressure over the approach, up to 8 GPa.
    """
    material = Material(2.0e11, 0.3, yield_stress=1e9)
    surface = Surface(np.zeros((4, 4)), (L, L))
    layer = Scene(surface, material, Load(1e9), Body("bonded_layer", 1e-3))

    def at(quantity, *path):
        """Return a quantity of the level layer after a path of mean pressures in Pa."""
        return scalar("flat", f"quantity.{quantity}", replace(layer, load=Load(path)))

    # At first all of it is elastic, with half of the pressure times the approach.
    assert at("plastic_work", 1e8) == 0
    energy = at("elastic_energy", 1e8)
    assert energy == pytest.approx(1e8 * at("approach", 1e8) / 2)
    pressure = np.linspace(1e8, 8e9, 4001)
    approach = [at("approach", p) for p in pressure]
    work = energy + np.trapezoid(pressure, approach)
    found = at("elastic_energy", 8e9) + at("plastic_work", 8e9)
    assert found == pytest.approx(work, rel=1e-6)
    # A small part of the load is taken off elastically, and gives its work back.
    given_back = (8e9 + 7e9) / 2 * (at("approach", 8e9) - at("approach", 8e9, 7e9))
    energy = at("elastic_energy", 8e9) - at("elastic_energy", 8e9, 7e9)
    assert energy == pytest.approx(given_back, rel=1e-9)


PLACES = np.column_stack(
    [(np.arange(16) + 0.5) / 16, np.random.default_rng(0).random(16)]
)


def on_a_wave(points, place):
    """Return the relative errors of boundary elements on a wave at 0.3 of the pressure
    that closes it.

    Args:
        points: number of grid points.
        place: (x, y); x is the distance of the crest from a grid point in spacings.

    Returns:
        The errors of pressure, raw area, corrected area and mean gap.
    """
    complete = waves.line_complete_pressure(1e-6, 1e-3, STIFFNESS)
    x = (np.arange(points) - place[0]) / points
    surface = Surface(1e-6 * np.cos(2 * np.pi * x), (1e-3,))
    result = bem.solve(Scene(surface, ELASTIC, Load(0.3 * complete)), threads=1)
    exact = complete * waves.line_pressure(x, 0.3)
    areas = result.final.areas
    area = waves.line_contact_fraction(0.3)
    return [
        float(
            np.linalg.norm(result.fields["pressure"] - exact) / np.linalg.norm(exact)
        ),
        areas["raw"].total / area - 1,
        areas["corrected"].total / area - 1,
        result.final.quantities["mean_gap"] / (1e-6 * waves.line_mean_gap(0.3)) - 1,
    ]


def on_a_sphere(points, place):
    """Return the relative errors of the raw and the corrected area of a sphere.

    `points` is the number of grid points a side, and `place` the centre in periods.
    """
    force = 4 * STIFFNESS * 0.2e-3**3 / (3 * 1e-2)
    radius = bumps.sphere_contact_radius_periodic(force, 1e-2, STIFFNESS, 1e-3)
    recipe = Paraboloid((1e-3, 1e-3), (points, points), 1e-2, tuple(place))
    areas = bem.solve(
        Scene(recipe.build(), ELASTIC, Load(force / 1e-6)), threads=1
    ).final.areas
    exact = math.pi * (radius / 1e-3) ** 2
    return [areas[kind].total / exact - 1 for kind in ("raw", "corrected")]


# The least order of each error, and its largest root mean square on the finest grid.
# Pressure, raw and corrected area, gap; the areas of the sphere.
ON_A_WAVE = [(0.9, 8e-4), (0.7, 2.5e-3), (1.6, 5e-7), (1.6, 4e-6)]
ON_A_SPHERE = [(0.9, 6e-3), (1.3, 8e-4)]


@pytest.mark.parametrize(
    ("errors", "sizes", "bounds"),
    [
        (on_a_wave, 2 ** np.arange(6, 11), ON_A_WAVE),
        (on_a_sphere, 2 ** np.arange(5, 9), ON_A_SPHERE),
    ],
)
def test_orders(errors, sizes, bounds):
    """Each error, as the root mean square over 16 places, falls with at least its
    order, and is below its bound on the finest grid.

    `errors` is the function of points and place, and `bounds` one pair (order, largest
    error) for each of its values.
    """
    found = np.array([[errors(int(n), place) for place in PLACES] for n in sizes])
    rms = np.sqrt(np.mean(found**2, axis=1))
    for column, (order, most) in zip(rms.T, bounds, strict=True):
        assert observed_order(1 / sizes, column) > order
        assert column[-1] < most
