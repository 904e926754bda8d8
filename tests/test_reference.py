"""Exact solutions: formulas against integrals and limits; closed forms as gates read them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from epcontact.errors import InvalidCase
from epcontact.harness.quantities.registry import QUANTITIES, measure
from epcontact.persson import areas
from epcontact.reference import CLOSED_FORMS, bumps, posts, waves
from epcontact.results import Areas, ContactResult, LoadStep, PressureDistribution, Provenance
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum
from epcontact.surfaces import FlatPunch, Paraboloid, SelfAffine, Sinusoid

RADIUS, MODULUS = 2.5e-3, 70e9
ELASTIC = Material(2.0e11, 0.3)
STIFFNESS = 2.0e11 / 0.91
L = 1e-3


def integral(function: Callable[[float], Any], low: float, high: float) -> float:
    found = quad(lambda x: float(function(x)), low, high, epsabs=1e-13, epsrel=1e-11, limit=200)
    return float(found[0])


def periodic_displacement(pressure: Any, points: Any, period: float) -> Any:
    """Displacement at a line's points under p, mean free: kernel -(2/(pi E*)) ln|2 sin(pi x/L)|.

    A spectral sum over cell-averaged samples; the pressure's kinks limit it to about 1e-5.
    """
    n = len(pressure)
    q = 2 * np.pi * np.fft.rfftfreq(n, period / n)
    symbol = np.divide(2 / MODULUS, q, out=np.zeros_like(q), where=q > 0)
    u = np.fft.irfft(symbol * np.fft.rfft(pressure), n)
    return np.interp(points, np.arange(n) * period / n, u)


# --- one sphere, one cylinder, one strip a period -------------------------------------------------


def test_lattice_sums() -> None:
    def known(power: float) -> float:
        return 4 * float(mpmath.zeta(power) * mpmath.dirichlet(power, [0, 1, 0, -1]))

    found = (bumps.LATTICE_SUM_3, bumps.LATTICE_SUM_5, -bumps.MADELUNG)
    assert found == pytest.approx([known(power) for power in (1.5, 2.5, 0.5)], rel=1e-14)


def test_spheres_on_a_lattice() -> None:
    """Hertz without images; the images act as extra curvature, and lower the middle of a load."""
    a = bumps.sphere_contact_radius(12.0, RADIUS, MODULUS)
    alone = bumps.sphere_contact_radius_periodic(12.0, RADIUS, MODULUS, math.inf)
    assert alone == pytest.approx(a, rel=1e-12)
    for ratio in (0.05, 0.1, 0.2):
        force = bumps.sphere_force(ratio * L, RADIUS, MODULUS)
        found = bumps.sphere_contact_radius_periodic(force, RADIUS, MODULUS, L) / (ratio * L)
        # What the leading order leaves out grows as (a/L)^5; its coefficient is below 3.
        assert found == pytest.approx((1 + 1.91699406 * ratio**3) ** (-1 / 3), abs=3 * ratio**5)
        assert found < 1
    n, width = 400, 0.02  # a Gaussian load: its own displacement at the middle is closed
    q = np.hypot(*np.meshgrid(*2 * [2 * np.pi * np.arange(-n, n + 1)], indexing="ij"))
    q[n, n] = np.inf
    lattice = np.sum(2 / (MODULUS * q) * np.exp(-((q * width) ** 2) / 2))
    own = 2 / MODULUS / (2 * math.pi) * math.sqrt(math.pi / 2) / width
    # Curvature of the image field over the load: S_3 w^2/2 of the unit F/(pi E* L).
    curvature = bumps.LATTICE_SUM_3 * width**2 / 2 / (math.pi * MODULUS)
    shift = -bumps.MADELUNG / (math.pi * MODULUS)
    assert lattice - own - curvature == pytest.approx(shift, rel=1e-6)


def cylinder_force(half_width: float) -> float:
    """P' = -(E* L^2/(2 pi R)) ln cos(pi a/L), which `cylinder_half_width_periodic` inverts."""
    sine = math.sin(math.pi * half_width / L)
    return -MODULUS * L**2 / (4 * math.pi * RADIUS) * math.log1p(-(sine**2))


def test_cylinders_in_a_row() -> None:
    """Their pressure carries the force, flattens the parabola, and is built up from punches."""

    def pressure(x: Any, a: float) -> Any:
        return bumps.cylinder_pressure_periodic(x, a, RADIUS, MODULUS, L)

    for a in (0.1 * L, 0.3 * L, 0.45 * L):
        force = cylinder_force(a)
        found = bumps.cylinder_half_width_periodic(force, RADIUS, MODULUS, L)
        assert found == pytest.approx(a, rel=1e-13)
        assert 2 * integral(lambda x, a=a: pressure(x, a), 0, a) == pytest.approx(force, rel=1e-8)
    # In the contact, g = x^2/(2 R) + u is constant.
    x = np.arange(1 << 15) * L / (1 << 15)
    inside, a = np.linspace(0, 0.98 * 0.35 * L, 50), 0.35 * L
    u = periodic_displacement(pressure(np.minimum(x, L - x), a), inside, L)
    assert np.ptp(inside**2 / (2 * RADIUS) + u) < 1e-5 * a**2 / RADIUS
    # dP'/da times the punch of half-width a is the growth of the pressure.
    a, step, x = 2e-4, 1e-9, np.linspace(0, 1.5e-4, 5)
    growth = (pressure(x, a + step) - pressure(x, a - step)) / (2 * step)
    rate = (cylinder_force(a + step) - cylinder_force(a - step)) / (2 * step)
    assert_allclose(growth, posts.strip_pressure_periodic(x, rate, a, L), rtol=1e-6)


def test_a_strip_carries_its_force_and_ends_at_its_rim() -> None:
    period, a = 4.0, 1.0
    edge = math.sin(math.pi * a / period)

    def substituted(t: float) -> float:  # sin(pi x/L) = sin(pi a/L) sin(t): no singularity
        sine = edge * math.sin(t)
        x = period / math.pi * math.asin(sine)
        slope = edge * math.cos(t) * period / math.pi
        pressure = posts.strip_pressure_periodic(np.array(x), 5.0, a, period)
        return float(pressure * slope / math.sqrt(1 - sine**2))

    # The part left out at the rim is 5/pi 2e-6.
    assert 2 * integral(substituted, 0, math.pi / 2 - 1e-6) == pytest.approx(5.0, rel=3e-6)
    middle, rim, outside = posts.strip_pressure_periodic(np.array([0.0, 1.0, 1.5]), 1.0, a, period)
    assert 0 < middle < rim
    assert outside == 0


# --- waves ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [0.0, 0.01, 0.05, 0.3, 0.5, 0.9, 0.95, 1.0])
def test_means_of_a_wave_s_pressure_and_gap(load: float) -> None:
    fraction = waves.line_contact_fraction(load)
    assert math.sin(math.pi * fraction / 2) ** 2 == pytest.approx(load, abs=1e-15)
    rim = fraction / 2
    mean = 2 * integral(lambda x: waves.line_pressure(x, load), 0, rim)
    assert mean == pytest.approx(load, rel=1e-7)
    gap = 2 * integral(lambda x: waves.line_gap(x, load), rim, 0.5)
    assert gap == pytest.approx(waves.line_mean_gap(load), rel=1e-8)
    if 0 < load < 1:  # the energy is the work of the mean pressure
        step = 1e-5
        slope = (waves.line_energy(load + step) - waves.line_energy(load - step)) / 2 / step
        closing = (waves.line_mean_gap(load - step) - waves.line_mean_gap(load + step)) / 2 / step
        assert slope == pytest.approx(load * closing, rel=1e-6)


def test_limits_of_waves() -> None:
    x = np.linspace(-1, 1, 41)
    assert_allclose(waves.line_gap(x, 0.0), 1 - np.cos(2 * np.pi * x), atol=1e-15)
    assert_allclose(waves.line_pressure(x, 1.0), 1 + np.cos(2 * np.pi * x), atol=1e-14)
    assert (waves.line_mean_gap(0), waves.line_mean_gap(1), waves.line_energy(1)) == (1, 0, 0.25)
    amplitude, load = 1e-6, 1e-6
    complete = waves.line_complete_pressure(amplitude, L, MODULUS)
    radius = 1 / (amplitude * (2 * math.pi / L) ** 2)
    a = math.sqrt(4 * load * complete * L * radius / (math.pi * MODULUS))  # Hertz
    assert waves.line_contact_fraction(load) == pytest.approx(2 * a / L, rel=1e-6)
    force = 1e-4 * waves.surface_complete_pressure(amplitude, L, MODULUS) * L**2 / 2
    a = bumps.sphere_contact_radius(force, radius, MODULUS)
    light = waves.surface_contact_fraction_light(1e-4)
    assert light == pytest.approx(2 * math.pi * a**2 / L**2, rel=1e-12)
    # The load on a hole of radius b has no stress intensity at its rim.
    hole = math.sqrt((1 - waves.surface_contact_fraction_heavy(0.99)) / (2 * math.pi))
    missing = integral(
        lambda r: r * (0.01 - 2 * math.pi**2 * r**2) / math.sqrt(hole**2 - r**2), 0, hole
    )
    assert missing == pytest.approx(0, abs=1e-9 * hole)


def test_pressure_and_gap_of_a_wave_solve_the_contact_problem() -> None:
    """The mean-free elastic displacement, less the waviness, is the gap less its mean."""
    n, load, amplitude = 16384, 0.4, 2e-6
    x = (np.arange(n) + 0.5) / n
    p = waves.line_complete_pressure(amplitude, L, MODULUS) * waves.line_pressure(x, load)
    gap = periodic_displacement(p, np.arange(n) * L / n, L) - amplitude * np.cos(2 * np.pi * x)
    expected = amplitude * waves.line_gap(x, load)
    assert_allclose(gap - gap.mean(), expected - expected.mean(), atol=1e-5 * amplitude)


# --- closed forms: one property each --------------------------------------------------------------


def wave(share: float, shape: tuple[int, ...] = (4096,), waves: int = 1) -> Scene:
    recipe = Sinusoid((L,) * len(shape), shape, 1e-6, waves)
    complete = math.pi * STIFFNESS * 1e-6 * waves / L
    return Scene(recipe.build(), ELASTIC, Load(share * complete))


def waviness(share: float, count: int = 1) -> Scene:
    recipe = Sinusoid((L, L), (64, 64), 1e-6, count, "both")
    complete = math.sqrt(2) * math.pi * STIFFNESS * 1e-6 * count / L
    return Scene(recipe.build(), ELASTIC, Load(share * complete))


def bump(shape: tuple[int, ...], pressure: float, centre: tuple[float, ...] = ()) -> Scene:
    recipe = Paraboloid((L,) * len(shape), shape, 1e-2, centre)
    return Scene(recipe.build(), ELASTIC, Load(pressure))


def punch(shape: tuple[int, ...], pressure: float, hardness: float = math.inf) -> Scene:
    recipe = FlatPunch((L,) * len(shape), shape, 0.3 * L, 1e-5)
    return Scene(recipe.build(), replace(ELASTIC, hardness=hardness), Load(pressure))


def rough(pressure: float = 2e10, body: Body | None = None, hardness: float = math.inf) -> Scene:
    spectrum = SelfAffineSpectrum(0.8, 7e3, 1.4e4, 6e4, 0.02)
    surface = SelfAffine(spectrum, (L, 1.2 * L), (48, 60), 3).build()
    return Scene(surface, Material(2.0e11, 0.3, hardness), Load(pressure), body or Body())


def scalar(form: str, quantity: str, scene: Scene) -> float:
    return CLOSED_FORMS[form].scalar(quantity, scene)


def pressure_of(form: str, scene: Scene) -> np.ndarray:
    return CLOSED_FORMS[form].field("pressure", scene)


def test_punch_sinks_by_the_integral_of_its_pressure() -> None:
    """u(0) = -(2/(pi E*)) int p(x) ln|2 sin(pi x/L)| dx, and the energy is half of p0 u."""
    scene = punch((1000,), 1e8)
    edge = math.sin(math.pi * 0.3005)  # 601 points of 1000

    def integrand(t: float) -> float:  # sin(pi x/L) = sin(pi a/L) sin t makes p a constant
        return -2 / (math.pi * STIFFNESS) * 1e8 * L / math.pi * math.log(2 * edge * math.sin(t))

    sinking = 2 * quad(integrand, 0, math.pi / 2, epsabs=0, epsrel=1e-10)[0]
    energy = scalar("flat_punch", "quantity.elastic_energy", scene)
    assert energy == pytest.approx(1e8 * sinking / 2, rel=1e-8)


def test_capped_strip_has_its_two_limits() -> None:
    # All of it flows when hardness times width carries the load; a light load yields a rim of
    # Irwin's size: 1 - cos(pi p0/(2 sigma_P)) times cot of the half-angle.
    width = 601 / 1000
    nearly = punch((1000,), 1e8, 1e8 / width * (1 + 1e-9))
    assert scalar("capped_strip", "area.plastic.raw", nearly) == pytest.approx(width, rel=1e-3)
    rim = scalar("capped_strip", "area.plastic.raw", punch((1000,), 1e8, 1e12))
    expected = 2 / math.pi * (math.pi * 1e-4 / 2) ** 2 / 2 / math.tan(math.pi * width / 2)
    assert rim == pytest.approx(expected, rel=1e-6)


def test_theory_tends_to_the_light_load_line_at_a_gamma_of_two_over_pi() -> None:
    """kappa = sqrt(8/(pi gamma)): equal in the limit, 0.6 % below at an area of 0.15."""
    for load, deviation in ((1e-6, 0), (0.0749, 6e-3)):
        scene = rough(load * 0.02 * STIFFNESS)
        line = scalar("light_load", "area.total.corrected", scene)
        assert line == pytest.approx(2 * load, rel=1e-12)
        theory = areas(2 / math.pi * (0.02 * STIFFNESS) ** 2 / 8, scene.load.final).elastic
        assert theory == pytest.approx(line * (1 - deviation), rel=deviation / 10 + 1e-10)


# --- refusals and measures ------------------------------------------------------------------------

REFUSED = {
    "two waves": ("westergaard", "area.total", rough()),
    "capped": ("westergaard", "area.total",
               replace(wave(0.3), material=replace(ELASTIC, hardness=1e11))),
    "layer": ("hertz", "area.total", replace(bump((64,), 1e7), body=Body("bonded_layer", 1e-3))),
    "no bump": ("hertz", "area.total", rough()),
    "closed": ("westergaard", "quantity.elastic_energy", wave(1.5)),
    "a line": ("waviness_light", "area.total", wave(0.3)),
    "a heavy load": ("waviness_light", "area.total", waviness(0.5)),
    "no post": ("flat_punch", "area.total", wave(0.3)),
    "elastic": ("capped_strip", "area.plastic", punch((100,), 1e8)),
    "all yielded": ("capped_strip", "area.plastic", punch((100,), 1e8, 1.1e8)),
    "infinite hardness": ("bearing_area", "area.plastic", rough()),
    "a capped body": ("light_load", "area.total", rough(1e6, hardness=1e9)),
    "a wave on a line": ("light_load", "area.total", wave(1e-4)),
    "too heavy a load": ("light_load", "area.total", rough(0.08 * 0.02 * STIFFNESS)),
    "gaps left": ("full_contact", "area.total", rough(1e6)),
    "no layer": ("flat", "quantity.approach", wave(0.3)),
    "no such quantity": ("hertz", "quantity.mean_gap", bump((64,), 1e7)),
}  # fmt: skip


@pytest.mark.parametrize("why", REFUSED)
def test_scene_that_a_form_does_not_describe(why) -> None:
    form, quantity, scene = REFUSED[why]
    name = quantity + ".raw" if quantity.startswith("area") else quantity
    with pytest.raises(InvalidCase, match=form) as caught:
        scalar(form, name, scene)
    assert "\n" not in str(caught.value)
    with pytest.raises(InvalidCase, match="hertz has no 'distribution'"):
        CLOSED_FORMS["hertz"].pressures(scene)


def result_of(scene: Scene, pressure: np.ndarray) -> ContactResult:
    raw = Areas(float((pressure > 0).mean()), float((pressure > 0).mean()), 0.0)
    table = PressureDistribution(np.array([0.0, pressure.max()]), np.array([0.0, 1.0]))
    step = LoadStep(scene.load.final, {"raw": raw, "corrected": raw})
    return ContactResult("bem", (step,), Provenance("x"), table, {"pressure": pressure})


def measured(name: str, scene: Scene, result: ContactResult) -> float:
    return measure(f"quantity.{name}", scene, result)


def test_measures_see_what_is_wrong_by_as_much_as_it_is() -> None:
    scene = rough()
    exact, p0 = pressure_of("full_contact", scene), scene.load.final
    heights = scene.surface.heights - scene.surface.heights.mean()
    names = ("measured_force", "measured_bounds", "measured_gap")
    for pressure, scores in (
        (exact, (0, 0, 0)),
        (1.01 * exact, (0.01, 0, None)),
        (exact - exact.min() - 0.1 * p0, (None, 0.1, None)),
        # Half of the fluctuation leaves half of the roughness as a gap, where gaps must be none.
        ((exact + p0) / 2, (0, 0, 0.5 * np.abs(heights).max() / heights.std())),
    ):
        for name, score in zip(names, scores, strict=True):
            found = measured(name, scene, result_of(scene, pressure))
            assert score is None or found == pytest.approx(score, rel=1e-9, abs=1e-11)
    # A uniform distribution up to the largest pressure carries half of it.
    carried = measured("measured_carried", scene, result_of(scene, exact))
    assert carried == pytest.approx(exact.max() / 2 / p0 - 1)


def test_sign_of_the_gap_at_the_bounds() -> None:
    # p = 0 where the surface would stand above the flat is a violation; so is p at the cap
    # where it would stand below.
    scene = wave(1e-4, (256,))
    crest, valley = np.zeros(256), np.zeros(256)
    crest[[255, 0, 1]] = valley[127:130] = scene.load.final * 256 / 3
    good, bad = (measured("measured_gap", scene, result_of(scene, p)) for p in (crest, valley))
    assert good < 0.1  # the crest stands 1e-4 of p* out, on three points
    assert bad > 2 * math.sqrt(2) * 0.99
    capped = replace(scene, material=replace(ELASTIC, hardness=scene.load.final * 256 / 3))
    assert measured("measured_gap", capped, result_of(capped, valley)) > 2


def test_measures_that_lack_a_field() -> None:
    scene = wave(0.3, (64,))
    flat = result_of(scene, np.ones(64))
    for name in (q.name for q in QUANTITIES.values() if q.measure and "fields" in q.needs):
        with pytest.raises(InvalidCase, match="no field 'pressure'"):
            measure(name, scene, replace(flat, fields={}))
    for name, result, words in (
        ("measured_force", result_of(scene, np.ones(32)), r"shape \(32,\) on a grid of \(64,\)"),
        ("measured_carried", replace(flat, distribution=None), "no pressure distribution"),
    ):
        with pytest.raises(InvalidCase, match=words):
            measured(name, scene, result)
