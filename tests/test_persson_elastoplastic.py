"""The closed forms against arbitrary precision, exact identities, limits and the paper."""

from __future__ import annotations

import math
from unittest import mock

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import erf, erfc

from epcontact.errors import InvalidScene
from epcontact.persson import series
from epcontact.persson.elastoplastic import (
    areas,
    boundary_slopes,
    elastic_force,
    pressure_cumulative,
    pressure_density,
)

mp.mp.dps = 45
#: Below this a double has lost digits to gradual underflow.
TINY = 1e-290


# ---- the referee ---------------------------------------------------------------------------


def _phi_mass(a, b, c):
    """Integral of the Gaussian of spread c from a to b."""
    return (mp.erf(b / c) - mp.erf(a / c)) / 2


def referee(G, p0, H, sigma=None):
    """Areas, density, cumulative and slopes with 45 digits, from the doubles as they are."""
    G, p0, H = mp.mpf(G), mp.mpf(p0), mp.mpf(H)
    s, c = p0 / H, 2 * mp.sqrt(G) / H
    x = mp.mpf(0 if sigma is None else sigma) / H
    if c < 1:
        ms = range(-6, 7)
        phi = lambda z: mp.exp(-((z / c) ** 2)) / (mp.sqrt(mp.pi) * c)  # noqa: E731
        upper = lambda t: mp.fsum(  # noqa: E731
            mp.erfc((2 * m + 1 - t) / c) - mp.erfc((2 * m + 1 + t) / c) for m in range(6)
        )
        mass = lambda y: mp.fsum(  # noqa: E731
            _phi_mass(-s - 2 * m, y - s - 2 * m, c) - _phi_mass(s - 2 * m, y + s - 2 * m, c)
            for m in ms
        )
        slope = lambda t: mp.fsum(4 / c**2 * (t + 2 * m) * phi(t + 2 * m) for m in ms)  # noqa: E731
        density = mp.fsum(phi(x - s - 2 * m) - phi(x + s - 2 * m) for m in ms)
        force = s - upper(s)
        plastic, separated, elastic, below = upper(s), upper(1 - s), mass(1), mass(x)
    else:
        ns = range(1, 10)
        mode = lambda n, t: mp.sin(n * mp.pi * t) * mp.exp(-((n * mp.pi * c / 2) ** 2))  # noqa: E731
        upper = lambda t: t + 2 / mp.pi * mp.fsum((-1) ** n * mode(n, t) / n for n in ns)  # noqa: E731
        mass = lambda y: mp.fsum(  # noqa: E731
            2 / mp.pi / n * mode(n, s) * (1 - mp.cos(n * mp.pi * y)) for n in ns
        )
        slope = lambda t: mp.fsum(2 * mp.pi * n * mode(n, t) for n in ns)  # noqa: E731
        density = mp.fsum(2 * mode(n, s) * mp.sin(n * mp.pi * x) for n in ns)
        force = -2 / mp.pi * mp.fsum((-1) ** n * mode(n, s) / n for n in ns)
        plastic, separated, elastic, below = upper(s), upper(1 - s), mass(1), mass(x)
    return {
        "plastic": plastic,
        "separated": separated,
        "elastic": elastic,
        "cumulative": below,
        "density": density / H,
        "slopes": (slope(s) / H**2, -slope(1 - s) / H**2),
        "force": H * force,
    }


def _relative(value, exact):
    return float(abs(mp.mpf(float(value)) - exact) / abs(exact))


_tail = st.floats(-12, -0.302).map(lambda u: 10.0**u)
_hardness = st.floats(-3, 12).map(lambda u: 10.0**u)


@st.composite
def contacts(draw, widest=1.7):
    """(G, p0, H): p0/H from 1e-12 to 1 - 1e-12, the spread 2 sqrt(G)/H from 1e-13 to 50."""
    H = draw(_hardness)
    share = draw(_tail)
    p0 = H * share if draw(st.booleans()) else H - H * share
    spread = 10.0 ** draw(st.floats(-13, widest))
    return (H * spread / 2) ** 2, p0, H


@settings(max_examples=300, deadline=None, derandomize=True)
@given(contacts())
@example((0.16, 1e-12, 1.0))
@example((0.16, 1 - 2.0**-40, 1.0))
@example((0.1599, 0.5, 1.0))
@example((100.0, 12.5, 150.0))
@example((3.0, 1e-3, 1.0))  # tiny elastic area
def test_areas_are_right_to_1e10_of_themselves(contact):
    exact = referee(*contact)
    found = areas(*contact)
    for name in ("elastic", "plastic", "separated"):
        true = exact[name]
        if true < TINY:
            assert getattr(found, name) < 2 * TINY
        else:
            assert _relative(getattr(found, name), true) < 1e-10, name
    if exact["elastic"] + exact["plastic"] > TINY:
        assert _relative(found.total, exact["elastic"] + exact["plastic"]) < 1e-10
    if exact["force"] > TINY:
        assert _relative(elastic_force(*contact), exact["force"]) < 1e-10


@settings(max_examples=250, deadline=None, derandomize=True)
@given(contacts(widest=1.0), st.floats(0, 1), st.floats(-4, 4), st.booleans())
def test_distribution_is_right(contact, share, offset, near_start):
    """Pressures anywhere, and within a few widths of the mean pressure."""
    G, p0, H = contact
    sigma = p0 + offset * math.sqrt(G) if near_start else share * H
    sigma = min(max(sigma, 0.0), H)
    exact = referee(G, p0, H, sigma)
    scale = max(1 / H, 1 / math.sqrt(4 * math.pi * G))
    assert abs(pressure_density(sigma, G, p0, H) - exact["density"]) < 1e-12 * scale
    error = abs(pressure_cumulative(sigma, G, p0, H) - exact["cumulative"])
    assert error <= 1e-12 * exact["elastic"] + TINY


@settings(max_examples=150, deadline=None, derandomize=True)
@given(contacts(widest=1.0))
def test_boundary_slopes_are_right(contact):
    exact = referee(*contact)["slopes"]
    for found, true in zip(boundary_slopes(*contact), exact, strict=True):
        if abs(true) > TINY:
            assert _relative(found, true) < 1e-10
        else:
            assert abs(found) < 2 * TINY


# ---- exact identities ----------------------------------------------------------------------


@settings(max_examples=250, deadline=None, derandomize=True)
@given(contacts())
def test_areas_sum_to_one_and_forces_to_the_load(contact):
    _, p0, H = contact
    found = areas(*contact)
    assert_allclose(found.total + found.separated, 1, rtol=0, atol=1e-13)
    assert_allclose(elastic_force(*contact) + H * found.plastic, p0, rtol=1e-12)


def test_force_is_the_first_moment_of_the_density():
    for G, p0, H in ((6.0e3, 12.5, 150.0), (300.0, 12.5, 150.0), (300.0, 12.5, np.inf)):
        top = min(H, p0 + 14 * math.sqrt(G))
        moment, _ = quad(lambda p, *a: p * pressure_density(p, *a), 0, top, (G, p0, H), epsabs=0)
        assert_allclose(elastic_force(G, p0, H), moment, rtol=1e-9)  # quad's own error


@settings(max_examples=300, deadline=None, derandomize=True)
@given(contacts())
def test_particle_hole_symmetry(contact):
    """Plastic and separated area swap places at the load hardness - mean_pressure."""
    G, p0, H = contact
    p0 = H - (H - p0)  # so that the partner's load is exact
    one, other = areas(G, p0, H), areas(G, H - p0, H)
    assert one.plastic == other.separated
    assert one.elastic == other.elastic


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.floats(0.7, 0.95), _tail, st.booleans(), st.floats(0, 1))
def test_eigenfunctions_and_images_are_one_function(c, share, mirrored, x):
    """To 1e-13 around the switch, where the areas take either."""
    G, p0 = c**2 / 4, 1 - share if mirrored else share

    def quantities():
        found = areas(G, p0, 1.0)
        return (
            found.plastic,
            found.elastic,
            found.separated,
            elastic_force(G, p0, 1.0),
            *boundary_slopes(G, p0, 1.0),
            pressure_density(x, G, p0, 1.0),
            pressure_cumulative(x, G, p0, 1.0),
        )

    with mock.patch.object(series, "SWITCH", 0.0):
        modes = quantities()
    with mock.patch.object(series, "SWITCH", math.inf):
        images = quantities()
    # The modes end at exp(-(4 pi 0.7)^2) = 3e-34, the images at exp(-(6.5 / 0.95)^2) = 5e-21.
    assert_allclose(images, modes, rtol=0, atol=1e-13)


def test_slopes_are_the_rates_of_the_areas():
    """dA_pl/dG = -dP/dsigma(hardness), d(separated)/dG = dP/dsigma(0); central differences."""
    p0, H = 12.5, 150.0
    for G in (500.0, 4189.0, 6000.0):
        h = 1e-3 * G
        before, after = areas(G - h, p0, H), areas(G + h, p0, H)
        at_zero, at_hardness = boundary_slopes(G, p0, H)
        # Second order: an error of (h/G)^2 times a factor of the fade, 1e2 at the most here.
        assert_allclose((after.plastic - before.plastic) / (2 * h), -at_hardness, rtol=1e-4)
        assert_allclose((after.separated - before.separated) / (2 * h), at_zero, rtol=1e-4)


def test_distribution_meets_its_ends():
    G, p0, H = 4189.0, 12.5, 150.0
    sigma = np.linspace(0, H, 1025)
    below = pressure_cumulative(sigma, G, p0, H)
    assert below[0] == 0
    assert below[-1] == areas(G, p0, H).elastic
    assert np.all(np.diff(below) > 0)
    density = pressure_density(sigma, G, p0, H)
    assert density[0] == density[-1] == 0
    step = 1e-6 * H
    slopes = boundary_slopes(G, p0, H)
    near = pressure_density([step, H - step], G, p0, H) / step
    assert_allclose(near, [slopes[0], -slopes[1]], rtol=1e-9)  # curvature at 0 is 0: step^2


# ---- limits --------------------------------------------------------------------------------


def test_no_roughness_is_full_contact_and_endless_roughness_the_bearing_area():
    found = areas(0.0, [1e-9, 0.5, 1 - 1e-9], 1.0)
    assert_allclose([found.elastic, found.plastic, found.separated], [[1] * 3, [0] * 3, [0] * 3])
    found = areas([1e3, 1e300], 0.3, 1.0)
    assert_allclose(found.plastic, 0.3, rtol=1e-15)
    assert_allclose(found.elastic, 0)
    mode = 4 / np.pi * np.sin(0.3 * np.pi) * np.exp(-2 * np.pi**2)  # the one that is left
    assert_allclose(areas(2.0, 0.3, 1.0).elastic, mode, rtol=1e-13)


def test_infinite_and_great_hardness_are_the_elastic_theory():
    G, p0 = np.array([0.0, 1e-8, 1.0, 4189.0, 1e30]), 12.5
    found = areas(G, p0, np.inf)
    with np.errstate(divide="ignore"):
        ratio = p0 / (2 * np.sqrt(G))
    assert_allclose(found.elastic, erf(ratio), rtol=1e-14)
    assert_allclose(found.separated, erfc(ratio), rtol=1e-14)
    assert np.all(found.plastic == 0)
    assert np.all(elastic_force(G, p0) == p0)
    assert boundary_slopes(4189.0, p0)[1] == 0
    assert_allclose(areas(4189.0, p0, 1e8).elastic, areas(4189.0, p0).elastic, rtol=1e-14)
    sigma = np.linspace(0, 500, 41)
    for curve in (pressure_density, pressure_cumulative):
        hard, elastic = curve(sigma, 4189.0, p0, 1e8), curve(sigma, 4189.0, p0)
        assert_allclose(hard, elastic, rtol=1e-12, atol=1e-18)


def test_small_loads_are_linear():
    """Both areas halve with the load; elastic, A = sqrt(8/pi) p0 / (E* xi) without reduction."""
    one, half = areas(4189.0, 1e-8, 150.0), areas(4189.0, 0.5e-8, 150.0)
    assert_allclose(half.elastic / one.elastic, 0.5, rtol=1e-14)
    assert_allclose(half.plastic / one.plastic, 0.5, rtol=1e-14)
    found = areas(250.0**2 * 0.7**2 / 8, 1e-9).elastic
    assert_allclose(found, math.sqrt(8 / math.pi) * 1e-9 / (250.0 * 0.7), rtol=1e-14)


# ---- the paper -----------------------------------------------------------------------------


def test_the_theory_row_of_the_paper():
    """E* = 250, hardness 150, p0 = 12.5 GPa, energy reduction 0.536, rms slope 1.

    The paper prints .0526 / .0572 / .1099 and elastic .1087 (Table 1).  Its surface has a
    tabulated spectrum whose slope is 1 to print only: the elastic figure, proportional to
    1/slope, puts it between .9990 and .9999 of 1; hence 2e-4 on figures of four decimals.
    """
    G = 250.0**2 * 0.536 / 8
    found, elastic = areas(G, 12.5, 150.0), areas(G, 12.5)
    printed = {"elastic": 0.0526, "plastic": 0.0572, "total": 0.1099}
    for name, value in printed.items():
        assert_allclose(getattr(found, name), value, rtol=0, atol=2.5e-4, err_msg=name)
    assert_allclose(elastic.elastic, 0.1087, rtol=0, atol=1e-4)
    # What equations (4), (5) and (1) give at a slope of exactly 1.
    assert_allclose(
        [found.elastic, found.plastic, found.total, elastic.total],
        [0.0525, 0.0572, 0.1097, 0.1086],
        rtol=0,
        atol=5e-5,
    )


# ---- shapes and refusals -------------------------------------------------------------------


def test_arguments_broadcast_and_scale():
    G = np.geomspace(1, 1e5, 7)[:, None]
    p0 = np.array([1.0, 12.5, 149.0])
    hardness = np.array([150.0, np.inf, 150.0])
    found = areas(G, p0, hardness)
    assert found.elastic.shape == (7, 3)
    for i, j in np.ndindex(7, 3):
        single = areas(G[i, 0], p0[j], hardness[j])
        # Not to the bit: sums over an array may be ordered otherwise.
        assert_allclose(single.elastic, found.elastic[i, j], rtol=1e-14)
        assert_allclose(single.plastic, found.plastic[i, j], rtol=1e-14)
    scaled = areas(G * 1e18, p0 * 1e9, hardness * 1e9)
    assert_allclose(scaled.plastic, found.plastic, rtol=1e-12)
    density = pressure_density(30.0, G, p0, hardness)
    assert_allclose(pressure_density(30e9, G * 1e18, p0 * 1e9, hardness * 1e9) * 1e9, density)


def test_pressures_outside_the_range_hold_no_contact():
    outside, elastic = [-1.0, 0.0, 150.0, 151.0], areas(4189.0, 12.5, 150.0).elastic
    assert np.all(pressure_density(outside, 4189.0, 12.5, 150.0) == 0)
    below = pressure_cumulative(outside, 4189.0, 12.5, 150.0)
    assert_allclose(below, [0, 0, elastic, elastic], rtol=0)


@pytest.mark.parametrize(
    ("function", "arguments", "word"),
    [
        *((areas, (G, 1.0, 2.0), "diffusion") for G in (-1.0, np.inf, np.nan)),
        *((areas, (1.0, p0, 2.0), "mean_pressure") for p0 in (0.0, 2.0, np.nan)),
        (areas, (1.0, np.inf, np.inf), "mean_pressure"),
        (pressure_density, (1.0, 0.0, 1.0, 2.0), "density"),
        (pressure_cumulative, (np.nan, 1.0, 1.0, 2.0), "NaN"),
    ],
)
def test_nonsense_is_refused(function, arguments, word):
    with pytest.raises(InvalidScene, match=word):
        function(*arguments)
