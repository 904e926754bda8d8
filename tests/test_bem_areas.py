"""Areas in the continuum limit against exact ones and against finer grids.

They must be right within their error estimates.
"""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from laboratory import area_bank, area_scenes, rim
from laboratory.areas import solution
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import sici

from epcontact import bem
from epcontact.bem.areas import front, rim_correction
from epcontact.bem.areas.grid import Sums
from epcontact.bem.areas.hidden import MIX
from epcontact.bem.areas.rim_correction import areas_of_sums, copies, estimate_areas
from epcontact.errors import InvalidScene
from epcontact.reference import bumps, waves
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

# The walls of punches are steep.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

KEPT = Path(__file__).parent.parent / "cases" / "regression"
PARTS = ("total", "plastic", "elastic")
wave = rim.wave


def solved(heights, load, hardness=math.inf, periods=None):
    """Return the areas (raw, corrected, error) of a contact with E* = 1, as fractions.

    `heights` are on a period of 1 if no `periods` are given; `load` is the mean
    pressure, and `hardness` the largest pressure, in units of E*.
    """
    return estimate_areas(*solution(heights, load, hardness, periods))


def parts(areas, part):
    """Return one field of each of several `Areas`: "total", "plastic" or "elastic"."""
    return [getattr(one, part) for one in areas]


def shifts(count, seed, dimensions=2):
    """Return `count` random shifts of a grid in spacings, as an array (count,
    dimensions).
    """
    return np.random.default_rng(seed).uniform(size=(count, dimensions))


def coordinates(shape, shift=(0.0, 0.0)):
    """Return the (nx, 1) and (1, ny) coordinates of a grid on a period of 1."""
    x, y = ((np.arange(n) + s) / n for n, s in zip(shape, shift, strict=True))
    return x[:, None], y[None, :]


def bowl(shape, shift):
    """Return the heights of a paraboloid of radius 1 at the middle of a unit period.

    `shape` is (nx, ny), and `shift` moves the grid by fractions of a spacing along x
    and y.
    """
    x, y = coordinates(shape, shift)
    return -((x - 0.5) ** 2 + (y - 0.5) ** 2) / 2


def egg_box(n, shift):
    """Return n x n heights (cos 2 pi x + cos 2 pi y)/2, on a grid shifted by `shift`
    spacings.
    """
    x, y = coordinates((n, n), shift)
    return (np.cos(2 * np.pi * x) + np.cos(2 * np.pi * y)) / 2


def rough(n, seed):
    """Return n x n self-affine heights on a unit period, with 1 to 16 waves and rms
    slope 1.

    The waves do not depend on n: finer grids refine the surface of a `seed`.
    """
    spectrum = SelfAffineSpectrum(0.8, 2 * np.pi, 4 * np.pi, 32 * np.pi, 1.0)
    return SelfAffine(spectrum, (1.0, 1.0), (n, n), seed).build().heights


def test_offsets_of_straight_fronts():
    # The integrand is 1/3 at 0, where its terms cancel.
    """The constants of the correction for straight fronts are those of their integrals.

    A front is the boundary line between contact and gap. Its offset (in spacings) is
    how far the counted contact lies outside of the exact one.
    """

    def integrand(t):
        """Return the integrand of the offset of a front along an axis, at the angle t
        in rad.
        """
        return (1 / t - 1 / math.tan(t)) / math.tan(t)

    integral = quad(integrand, 1e-3, math.pi / 2)[0] + 1e-3 / 3
    axis = 0.25 - integral / (2 * math.pi)
    assert pytest.approx(axis, abs=1e-9) == front.AXIS_OFFSET
    # A diagonal front sees rows closer by sqrt 2; the cut of the integral leaves 2e-4.
    diagonal = rim.front_offset(math.pi / 4)
    assert rim.front_offset(0.0) == pytest.approx(axis, abs=2e-4)
    assert diagonal == pytest.approx(axis / math.sqrt(2), abs=2e-4)
    mix = sici(math.pi)[0] / math.pi
    inner = mix**2 / 2 + sici(2 * math.pi)[0] / (2 * math.pi)
    assert (mix, inner) == pytest.approx((MIX, front.INNER), abs=1e-12)


def test_what_counts_have_too_much_is_that_of_all_directions():
    """COUNTED is the mean offset of fronts over all directions, and POINTS is the
    variance of counting lattice points, from their lattice sum.
    """
    angles = (np.arange(8) + 0.5) * math.pi / 32
    mean = np.mean([rim.front_offset(angle, points=200_000) for angle in angles])
    assert mean == pytest.approx(rim_correction.COUNTED, abs=1e-3)
    k = np.hypot(*np.mgrid[-99:100, -99:100])
    lattice = np.sum(k[(k > 0) & (k < 99)] ** -3.0) + 2 * math.pi / 99
    variance = lattice / (4 * math.pi**3)
    assert variance == pytest.approx(rim_correction.POINTS, abs=5e-5)


#: Values v of six points of a link, from inside out: at a step; at a kink; and at a cap
#: on a step, where the pressure falls towards the step, but not as the gap jumps.
STEP = [0.7, 1.0, 2.0, -50.0, -50.0, -50.0]
KINK = [1.0, 1.1, 1.5, -3.0, -6.0, -9.0]
CAP = [0.303, 0.234, 0.054, -2.306, -2.178, -2.2]


def test_a_resolved_front_is_free_and_nearly_certain():
    """A front through smooth pressures and gaps lies between points, within 0.02
    spacings.

    A front that falls on a point is as uncertain as others are. The six numbers are
    pressures (negative: gaps) across the front, scaled alike.
    """
    link = rim.link_of([2.6, 2.0, 1.0, -0.5, -2.0, -4.0])
    assert 0.5 < link.position < 1
    assert link.pinned == 0
    assert link.hidden_width == 0
    assert link.at_kink == 0
    assert 0 < abs(link.uncertainty) < 0.02
    # A front that falls on a point is as uncertain as others are.
    at_point = rim.link_of([-2.0, -1.0, 1e-9, -1.0, -2.0, -4.5])
    assert abs(at_point.uncertainty) > 0.05


def test_a_step_pins_a_front():
    """A front at a step of the heights is pinned at half a spacing.

    There the pressure rises towards the edge, and the gap jumps. Two points with
    pressure may be a crest, and a steep flank beside plastic points has no jump: both
    are not pinned.
    """
    for v in (STEP, CAP):
        assert rim.link_of(v)[:6] == (0.5, 0, 1, 0, 0, 0)
    assert rim.link_of([-1.0, *CAP[1:]]).pinned == 0  # two points may be a crest
    # Plastic points beside apart ones: at a step the gap jumps, on a steep flank not.
    assert rim.link_of([1.3, 1.2, 1.1, -9.0, -9.0, -9.0], 1.0)[:3] == (0.5, 0, 1)
    flank = rim.link_of([9.0, 6.0, 3.0, -1.0, -4.0, -7.0], 1.0)
    assert flank.pinned == 0
    assert flank.hidden_width == 0


@pytest.mark.parametrize(
    ("v", "width"), [(STEP, (math.pi / 8) ** 2), (KINK, 3 ** (-2.5 / 0.4))]
)
def test_an_edge_hides_a_plastic_zone(v, width):
    """At an edge the singular pressure hides a plastic zone of the given `width`
    (spacings).

    `v` holds six pressures across a rim (negative ones: gaps), under a cap of 4. A
    pressure that rises ever more slowly towards the rim has no edge and hides nothing.
    """
    assert rim.link_of(v, 4.0).hidden_width == pytest.approx(width)
    # Here the pressure rises ever more slowly towards the rim: there is no edge.
    smooth = rim.link_of([0.2, 1.0, 1.5, -3.0, -6.0, -9.0], 2.0)
    assert smooth.pinned == 0
    assert smooth.hidden_width == 0


@pytest.mark.parametrize(
    ("gaps", "away"), [((3, 6, 9), 1), ((1, 4, 9), 1), ((3, 7, 11), 3 / 4)]
)
def test_gaps_that_close_before_a_kink_have_a_front_there(gaps, away):
    """Gaps (in spacings) that close before their first point pin the front at a kink.

    `away` is the distance in spacings from the first gap at which the gaps vanish; a
    full spacing pins the front at half a spacing, as a step does.
    """
    link = rim.link_of([*KINK[:3], *(-gap for gap in gaps)])
    if away == 1:
        assert link.position == 0.5
        assert link.pinned == 1
        assert link.at_kink == 0
    else:
        shift = front.AXIS_OFFSET * gaps[0] / (1.5 + gaps[0])
        assert link.position == pytest.approx(1 - away + shift)
        assert link.pinned == 0
        assert link.at_kink == 1


@pytest.mark.parametrize(
    ("points", "aspect", "count", "each", "mean"),
    [
        (4, 1, 16, 6e-3, 2e-3),
        (9.6, 1, 12, 1e-3, 4e-4),
        (20, 1, 6, 4e-4, 2e-4),
        pytest.param(38, 1, 6, 2e-4, 5e-5, marks=pytest.mark.slow),
        (12.6, 2, 6, 1, 5e-4),
        (12.6, 4, 6, 1, 2e-3),
    ],
)
def test_hertz_over_shifts_of_the_grid(points, aspect, count, each, mean):
    """The corrected area of a sphere is within its error estimate, at each shift of the
    grid.

    `points` are those along the contact radius, `aspect` is the ratio of the sides of a
    cell, and `count` is the number of shifts. Relative errors stay below `each`, and
    their mean below `mean`. The raw count is 0.7 to 6 % off; on square cells the order
    is higher than second.
    """
    shape = tuple(2 * round(points / 0.3 * aspect**power) for power in (-0.5, 0.5))
    radius = points / (2 * round(points / 0.3))
    force = 4 / 3 * radius**3
    exact = math.pi * bumps.sphere_contact_radius_periodic(force, 1.0, 1.0, 1.0) ** 2
    errors = []
    for shift in shifts(count, 3):
        raw, corrected, error = parts(solved(bowl(shape, shift), force), "total")
        assert abs(corrected - exact) <= error
        errors.append((raw - exact, corrected - exact))
    raw, corrected = np.array(errors).T / exact
    assert np.abs(corrected).max() < each
    assert abs(corrected.mean()) < min(mean, raw.mean() / 10)


@pytest.mark.parametrize("hardness", [0.095, 0.1, 0.105, 0.11, 0.115])
def test_strips_around_a_plastic_core(hardness):
    """Mean areas of a sphere whose plastic core is 0.8 to 2.4 spacings from its rim are
    right.

    The inner front of these elastic strips is less steep than the outer one: by the
    slope of one front alone the contact is 0.008 of a spacing too large. `hardness` is
    in units of E*.
    """
    force = 4 / 3 / 64
    exact = solved(bowl((512, 512), (0.3, 0.4)), force, hardness)[1]
    found = [solved(bowl((64, 64), s), force, hardness)[1] for s in shifts(6, 5)]
    for part, most in (("total", 0.004), ("plastic", 0.006)):
        area = getattr(exact, part)
        perimeter = 2 * math.sqrt(math.pi * area)
        off = np.mean(parts(found, part)) - area
        assert abs(off) * 64 < most * perimeter


@pytest.mark.parametrize(
    ("hardness", "most"), [(0.4, 0.05), (0.9, 0.05), (1.3, 0.3), (1.6, 0.3), (2, 0.3)]
)
def test_plastic_strips_of_any_width_on_a_line(hardness, most):
    """Areas with two fronts beside strips of 0 to 2.4 spacings are right by `most`
    spacings.

    `hardness` is in units of E*; the bound is 0.05 spacings where the load determines
    the area.
    """
    n = 64
    load = 0.487 * hardness  # no number of points at the hardness carries it
    exact = solved(wave(64 * n), load, hardness)[1]
    for shift in (0.05, 0.3, 0.55, 0.8):
        _, located, error = solved(wave(n, shift), load, hardness)
        for part in ("total", "plastic"):
            off = abs(getattr(located, part) - getattr(exact, part))
            assert off < min(getattr(error, part), most / n) + 1e-6


@pytest.mark.parametrize(
    ("slope", "near", "far", "times"),
    [(0.5, 0.08, 0.03, 9), (2, 0.18, 0.09, 2), (20, 0.18, 0.006, 1)],
)
def test_what_is_cut_away_outside_a_contact_does_not_change_it(slope, near, far, times):
    """A wave that falls steeply outside of its contact has the contact of the complete
    wave.

    The edges lie 0.05 to 2.5 spacings outside. `slope` is that of the flank beyond
    them; the contact is off by less than `near` (edges within 0.1 spacings) or `far`
    spacings a front, and by less than `times` error estimates. The pressures do not
    show an edge as gentle as the wave itself: the front is hardly off, but by up to
    nine error estimates.
    """
    n = 64
    fraction = 0.6
    exact = waves.line_contact_fraction(fraction)
    for outside in (0.05, 0.4, 0.8, 1.2, 1.8, 2.5):
        most = near if outside < 0.1 else far
        for shift in (0.05, 0.3, 0.55, 0.8):
            beyond = 0.5 - from_middle(n, shift) - exact / 2 - outside / n
            heights = wave(n, shift) - slope * np.maximum(beyond, 0)
            _, corrected, error = solved(heights, fraction * math.pi)
            off = abs(corrected.total - exact)
            assert off < min(2 / n * most, times * error.total)


@pytest.mark.parametrize("fraction", [0.5, 0.9, 0.98, 0.995, 0.999, 0.9999])
def test_gaps_in_a_contact_that_is_nearly_full(fraction):
    """Near full contact the error estimate covers gaps that may fit between points.

    `fraction` is the load over that of full contact (pi on a line or an egg box of E* =
    1). No error of 0 is claimed, unless the pressure excludes a gap.
    """
    load = fraction * math.pi
    n = 16
    exact = waves.line_contact_fraction(fraction)
    for phase in (0.1, 0.3, 0.5, 0.8):
        _, corrected, error = solved(wave(n, phase), load)
        assert abs(corrected.total - exact) <= error.total < 3 / n
    exact = solved(egg_box(384, (0.3, 0.6)), load)[1].total
    for shift in shifts(8, 4):
        raw, corrected, error = parts(solved(egg_box(32, shift), load), "total")
        if raw == 1:
            assert 1 - exact <= error < 3 / 32**2
        elif fraction < 0.99:
            assert abs(corrected - exact) < min(error, 0.25 / 32**2)


@pytest.mark.parametrize("load", [2e-9, 2e-8, 2e-7])
def test_the_area_of_a_summit_between_four_points_is_covered(load):
    """Under a light load four points around the summit of a ball carry all, however
    small the contact is; mirror images of the map tell no more.

    The radius of the ball is 3 in units of the map's side, and the contact of Hertz is
    at most 0.6 spacings wide.
    """
    n = 33
    x = (np.arange(n) - 14.5) / n
    ball = -(x[:, None] ** 2 + x**2) / 6
    heights = np.pad(ball, ((0, n), (0, n)), mode="symmetric")
    _, corrected, error = solved(heights, load, periods=(2.0, 2.0))
    # Each of four balls carries the mean pressure on a square of side 1.
    exact = math.pi * (0.75 * load * 3) ** (2 / 3)
    assert abs(corrected.total - exact) < error.total < 2 * corrected.total


def test_full_contact_with_pressure_to_spare_is_certain():
    """At 1.2 times the load of full contact the error estimate is 0."""
    assert solved(egg_box(16, (0.3, 0.6)), 1.2 * math.pi)[2].total == 0


def from_middle(n, shift=0.0):
    """Return distances from the middle of a line of n points, shifted by `shift`."""
    return abs(((np.arange(n) + shift) / n) % 1 - 0.5)


def plateau(n, slope):
    """Return n x n heights of a round plateau of radius 0.25 with flanks of a slope.

    For slope inf its edge is a step of 0.5.
    """
    x, y = coordinates((n, n))
    beyond = np.hypot(x - 0.503, y - 0.4988) - 0.25
    if slope == math.inf:
        return -0.5 * (beyond > 0)
    return -slope * np.maximum(beyond, 0)


def flat_wedge(n):
    """Return n heights of a flat of half-width 0.2, beyond which straight
    flanks fall.
    """
    return -np.maximum(from_middle(n, 0.3 * n / 96) - 0.2, 0)


def groove(n):
    """Return n heights that rise with the slope 0.2 from the bottom of a
    sharp groove.
    """
    return 0.2 * from_middle(n, -0.3 * n / 32)


def crest(n):
    """Return n heights of a sharp crest with flanks of the slope 0.2."""
    return -groove(n)


def disc(n):
    """Return n x n heights of a flat disc that ends with a step."""
    return plateau(n, math.inf)


def truncated_cone(n):
    """Return n x n heights of a flat disc with flanks of the slope 0.5."""
    return plateau(n, 0.5)


def oblique_groove(n):
    """Return n x n heights of a sharp groove along the diagonal of the grid, of slope
    sqrt 2.
    """
    x, y = coordinates((n, n))
    return abs((x + y + 0.5 + 0.25 / 32) % 1 - 0.5)


def dome(n):
    """Return a parabola across a line, with kinks where its flanks become steeper."""
    r = from_middle(n, 0.2989 * n)
    return -(r**2) / 2 - 0.713 * np.maximum(r - 0.1272, 0)


def cone(n):
    """Return n x n heights of a cone of slope 0.5, whose tip lies between points."""
    x, y = coordinates((n, n))
    centre = 0.5 - 0.3 / 24
    return -0.5 * np.hypot(x - centre, y - centre)


@pytest.mark.parametrize(
    ("heights", "load", "hardness", "n", "finer", "part", "largest_error", "count"),
    [
        (flat_wedge, 0.05, math.inf, 96, 8, "total", 0.6 / 96, None),
        (groove, 0.3, math.inf, 32, 64, "total", 0.1, 1),  # open at its bottom only
        (crest, 0.1, 0.5, 32, 64, "plastic", 0.1, 0),  # flows at its top only
        (disc, 0.05, 1.0, 48, 8, "plastic", 0.09, 0),  # flows at its rim only
        (truncated_cone, 0.03, math.inf, 48, 6, "total", 6e-3, None),
        (oblique_groove, 1.6 * math.sqrt(2), math.inf, 32, 6, "total", 2 / 32, 1),
        (dome, 0.017011, 0.09639, 64, 64, "plastic", 0.03, 0),  # flows at its edges
        (cone, 0.004, 0.6, 24, 8, "plastic", 4 / 576, 0),  # flows at its tip
    ],
)
def test_edges_and_what_no_point_shows(  # noqa: PLR0917 - a row of a table
    heights, load, hardness, n, finer, part, largest_error, count
):
    """Areas at edges and tips are within their errors of those of a finer grid.

    `heights(n)` are those of n points along an axis; the exact area is that of `finer`
    times as many points; `part` is the area compared; the error estimate is less than
    `largest_error`; `count` is the raw value of this part, None if it is not of
    interest.
    """
    exact = getattr(solved(heights(finer * n), load, hardness)[1], part)
    raw, corrected, error = parts(solved(heights(n), load, hardness), part)
    assert abs(corrected - exact) <= error < largest_error
    assert count in (None, raw)
    assert exact != raw


@pytest.mark.parametrize("width", [0.1, 0.3, 0.6, 1.0, 1.4])
def test_a_crease_narrower_than_a_spacing_is_exact(width):
    """Zones at a kink (`width` spacings wide) are exact by the closed form, at any
    shift.

    Parabolas that meet at a kink have p = c - k ln(2 sin(pi s)) in full contact, and
    beside a capped ridge of half-width b, H - k arccosh(sin(pi s)/sin(pi b)), wherever
    the points are.
    """
    n = 48
    k = 1 / math.pi
    load = 1.0
    hardness = load - k * math.log(math.sin(math.pi * width / 2 / n))
    for (shift,) in shifts(8, 3, dimensions=1):
        s = (np.arange(n) + shift) / n
        heights = math.pi * k * (s - 0.5) ** 2
        for h, p0, part, exact in (
            (heights, load, "plastic", width / n),
            (-heights, hardness - load, "total", 1 - width / n),
        ):
            raw, corrected, error = parts(solved(h, p0, hardness), part)
            off = abs(corrected - exact)
            assert off <= error + 1e-4 / n
            # The load moves the areas where a point is in the ridge, and not without.
            assert off < (1e-3 if raw in (0, 1) else 0.05) / n


@pytest.mark.parametrize("fraction", [0.02, 0.1, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("width", [0.2, 0.4, 0.6, 0.75])
def test_what_unloading_releases_at_an_edge_is_that_of_the_continuum(fraction, width):
    """The width that unloading opens at an edge agrees with the continuum to 2 %.

    `width` is that of the plastic zone at the edge in spacings, and `fraction` the
    fraction of the load that is taken off.
    """
    strip = front.strip_width.py_func(width)
    # The strip is that whose link between points has the steepness of 1/width.
    steepness = 1 + (math.acosh(1 / strip) - math.sqrt(1 - strip**2)) / math.e
    assert steepness == pytest.approx(1 / width, rel=0.02)
    # Equal parts of the pressure H (2/pi) arcsin sqrt(a/strip) begin at these a.
    a = strip * np.sin(np.pi / 2 * (np.arange(4096) + 0.5) / 4096) ** 2

    def lacking(x):
        """Return the intensity of pressure released within x spacings, minus that of
        the fraction.
        """
        intensity = 2 / np.pi * np.mean(np.sqrt(np.maximum(x - a, 0)))
        return intensity - fraction * math.sqrt(math.e) / math.pi

    found = front.released_width.py_func(fraction, strip)
    assert found == pytest.approx(brentq(lacking, 0, 9), rel=0.02)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", sorted({*area_bank.KINDS} - {"rounded"}))
def test_refinement_makes_no_claim_less_true(kind, seed):
    """Errors over their estimates do not grow as the grid is refined, or stay below
    1.5.

    `kind` is a family of random surfaces in the bank of scenes. Areas on n, 2n and 4n
    points are compared with those on 8n.
    """
    scene = area_bank.scene(kind, seed, 48)
    _, exact, doubt = area_bank.estimated(*scene.solved(8))
    times = []
    for factor in (1, 2, 4):
        _, found, error = area_bank.estimated(*scene.solved(factor))
        off = np.subtract(list(vars(found).values()), list(vars(exact).values()))
        allowed = np.add(list(vars(error).values()), list(vars(doubt).values()))
        times.append(np.max(abs(off) / (allowed + 1e-9)))
    assert all(fine <= max(1.5, coarse) for coarse, fine in pairwise(times)), times


@pytest.mark.parametrize("fall", [0.01, 0.05, 0.4, 0.5])
@pytest.mark.parametrize(
    ("hardness", "before"), [(0.3, 0.0332), (0.6, 0.05), (0.3, 0.14)]
)
def test_areas_after_unloading_are_those_of_finer_grids(hardness, before, fall):
    """Contact areas after unloading are within their errors of those of a 16 times
    finer grid.

    `before` is the largest load and `hardness` the largest pressure, in units of E*;
    `fall` is the fraction of the load taken off. A small fall moves no front.
    """
    after = (1 - fall) * before
    exact = unloaded(16 * 64, hardness, before, after)[1].total
    for factor, most in ((1, 0.03), (2, 0.006), (4, 0.006)):
        _, corrected, error = unloaded(factor * 64, hardness, before, after)
        assert abs(corrected.total - exact) <= min(error.total, most * exact)
        assert corrected.plastic == error.plastic == 0 < error.elastic == error.total


def unloaded(n, hardness, before, after):
    """Return the areas (raw, corrected, error) of n x n roughness at the load `after`.

    The surface was loaded to `before` first; loads and `hardness` are in units of E* =
    1.
    """
    material = Material(1.0, 0.0, hardness=hardness)
    surface = Surface(rough(n, 5), (1.0, 1.0))
    result = bem.solve(Scene(surface, material, Load((before, after))))
    # What has flowed before is no plastic area, but is reported.
    flowed = result.steps[0].areas["raw"].plastic
    assert result.final.quantities["flowed_share"] == flowed
    return [result.final.areas[name] for name in ("raw", "corrected", "error")]


@pytest.fixture(scope="module")
def capped():
    """Return (pressures, gaps, hardness, spacings, E*) of a contact with all three
    states.
    """
    return solution(rough(64, 5), 0.1, 0.6)


def test_particle_hole_partner(capped):
    """The map h -> -h, p0 -> hardness - p0 exchanges plastic area and non-contact
    exactly.
    """
    p, g, hardness, spacing, _ = capped
    expected = estimate_areas(*capped)
    mirrored = estimate_areas(hardness - p, -g, hardness, spacing, 1.0)
    other = solved(-rough(64, 5), hardness - 0.1, hardness)
    # The estimate itself to rounding; of another solution as its tolerance has it.
    for found, tolerance in ((mirrored, 1e-10), (other, 2e-6)):
        for area, mirror in zip(expected[:2], found[:2], strict=True):
            swapped = (1 - mirror.plastic, 1 - mirror.total)
            assert (area.total, area.plastic) == pytest.approx(swapped, abs=tolerance)
        error = expected[2]
        mirror = found[2]
        swapped = (mirror.plastic, mirror.total)
        assert (error.total, error.plastic) == pytest.approx(swapped, rel=1e-4)


def rolled(field):
    """Return the field shifted by 5 and 17 points around its periodic edges."""
    return np.roll(field, (5, 17), (0, 1))


def test_symmetries_and_units(capped):
    """Areas do not change if fields are mirrored, exchanged, shifted, scaled or
    big-endian.
    """
    p, g, hardness, spacing, _ = capped
    expected = estimate_areas(*capped)
    micron = (1e-6 / 64, 1e-6 / 64)
    steel = estimate_areas(p * 70e9, g * 1e-6, hardness * 70e9, micron, 70e9)
    others = [steel]
    for change in (np.flipud, np.transpose, rolled):
        fields = [np.ascontiguousarray(change(field)) for field in (p, g)]
        others.append(estimate_areas(*fields, hardness, spacing, 1.0))
    for other in others:
        for area, of_other in zip(expected, other, strict=True):
            assert vars(of_other) == pytest.approx(vars(area), rel=1e-9)
    big_endian = [field.astype(">f8") for field in (p, g)]
    assert expected == estimate_areas(*big_endian, hardness, spacing, 1.0)


def test_axes_of_oblong_cells_of_a_surface_that_has_flowed_may_be_exchanged(capped):
    """Areas after flow do not change when x and y are exchanged, on cells of 1/64 x
    1/32.
    """
    p, g, hardness, _, _ = capped
    fields = [np.maximum(p - hardness / 4, 0), abs(g), np.maximum(-g, 0)]
    p, g, flowed = (field[:, ::2] for field in fields)
    areas = estimate_areas(p, g, hardness, (1 / 64, 1 / 32), 1.0, flowed=flowed)
    spacing = (1 / 32, 1 / 64)
    turned = estimate_areas(p.T, g.T, hardness, spacing, 1.0, flowed=flowed.T)
    assert areas[1].total == pytest.approx(turned[1].total, rel=1e-9)


def noise():
    """Return the arguments of `sums_of_fronts` for noise after flow, with fronts
    everywhere.

    They are pressures, gaps (both (90, 150)), hardness, spacings, E*, threads, and the
    plastic displacement.
    """
    limits = (-1, -1, -1), (2, 1, 1)
    fields = np.random.default_rng(5).uniform(*limits, (150, 90, 3)).clip(0, 1)
    p, g, lowered = fields.T
    gap = np.where(p > 0, 0, g)
    return p, gap, 1.0, (1.0, 1.0), 1.0, 1, np.where(p < 1, lowered, 0)


@pytest.mark.parametrize("noisy", [False, True])
def test_blocks_do_not_change_the_sums(capped, noisy, monkeypatch):
    """Sums over small blocks equal those of one block, to the bit on any number of
    threads.

    `noisy` takes noise after flow instead of a rough contact.
    """
    solution = noise() if noisy else (*capped, 1, None)
    expected = rim_correction.sums_of_fronts(*solution)[0]
    monkeypatch.setattr(rim_correction, "_ROWS", 7)
    monkeypatch.setattr(rim_correction, "_COLUMNS", 25)
    of_threads = [
        rim_correction.sums_of_fronts(*solution[:5], threads, solution[6])[0]
        for threads in (1, 2)
    ]
    assert np.array(of_threads[0]) == pytest.approx(
        np.array(expected), rel=1e-12, abs=1e-9
    )
    assert np.array_equal(*of_threads)  # the same bits on any number


POINTS = (8, 8)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"flowed": np.zeros((8, 7))}, r"\(8, 7\), \(8, 8\)\] points and 2 spacings"),
        ({"spacing": 1.0}, "1 spacings do not fit"),
        ({"pressure": 1.0, "gap": 0.0, "spacing": ()}, "0 spacings do not fit"),
        ({"pressure": np.full(POINTS, np.nan)}, "pressure is empty or holds NaN"),
        ({"gap": np.full(POINTS, 1e300)}, "gap is .* or numbers beyond 1e"),
        ({"pressure": np.full(POINTS, 1.1)}, "a pressure is above the hardness"),
        ({"pressure": np.full(POINTS, -0.1)}, "pressure is negative at a point"),
        ({"pressure": np.full(POINTS, 1j)}, "must be an array of real numbers"),
        ({"hardness": math.nan}, "hardness is nan, but must be a positive number in"),
        ({"spacing": (1e-300, 1e300)}, "spacing is 1e-300 m, but must lie between"),
        ({"threads": 1.5}, "threads is 1.5, but must be"),
    ],
)
def test_areas_of_what_is_no_solution(changed, sentence):
    """Fields and numbers that are no solution raise `InvalidScene`.

    `changed` replaces arguments of a valid call, and `sentence` is a part of the
    message.
    """
    valid = {
        "pressure": np.zeros(POINTS),
        "gap": np.ones(POINTS),
        "hardness": 1.0,
        "spacing": (1.0, 1.0),
        "effective_modulus": 1.0,
    }
    with pytest.raises(InvalidScene, match=sentence):
        estimate_areas(**(valid | changed))


@pytest.mark.parametrize("load", [1e-6, 0.1, 0.9])
@pytest.mark.parametrize("hardness", [1e7, np.inf])
@pytest.mark.parametrize("shape", [(32, 32), (64,)])
def test_corrected_areas_can_carry_the_load_however_little_is_resolved(
    load, hardness, shape
):
    """On white noise, corrected areas lie between bounds that follow from the load
    alone.

    White noise shows no rim: bounds, not estimates, are left. `load` is a fraction of
    the hardness (Pa) or, without a hardness, of 1e9 Pa.
    """
    heights = 1e-6 * np.random.default_rng(11).standard_normal(shape)
    surface = Surface(heights, (1e-3,) * len(shape))
    pressure = load * (hardness if np.isfinite(hardness) else 1e9)
    scene = Scene(surface, Material(1e11, 0.3, hardness), Load(pressure))
    areas = bem.solve(scene).final.areas
    least_contact = pressure / hardness
    rounding = 1e-12  # the solver's force is right to rounding
    for part, least, most in (
        ("total", least_contact, 1),
        ("plastic", 0, least_contact),
        ("elastic", 0, 1),
    ):
        found = getattr(areas["corrected"], part)
        error = getattr(areas["error"], part)
        assert least - rounding <= found <= most + rounding
        assert 0 <= error <= max(found - least, most - found) + rounding
    if areas["raw"].total * heights.size < 1.5:  # any area may be there
        farthest = areas["corrected"].total - least_contact
        assert areas["error"].total >= farthest - rounding


@pytest.mark.parametrize("kind", ["bonded_layer", "sliding_layer"])
def test_claims_hold_on_a_layer_thinner_than_a_spacing(kind):
    """Error estimates hold on a layer that is 0.6 spacings deep, and are no five times
    too large.

    The rim on such a layer is not that of a half-space, so that the correction itself
    is off.
    """
    k = 2 * math.pi
    spectrum = SelfAffineSpectrum(0.8, k, k, 8 * k, 1.0)
    times = []
    for seed in range(4):
        areas = []
        for n in (32, 256):
            surface = SelfAffine(spectrum, (1, 1), (n, n), seed).build()
            body = Body(kind, 0.6 / 32)
            scene = Scene(surface, Material(1.0, 0.0), Load(0.1), body)
            areas.append(bem.solve(scene).final.areas)
        coarse, fine = areas
        off = coarse["corrected"].total - fine["corrected"].total
        times.append(abs(off) / coarse["error"].total)
    assert 0.2 < max(times) <= 1


def test_how_many_copies_a_grid_holds():
    """`copies` counts equal periods and mirror images inside of a pressure field,
    despite noise of 5 %.
    """
    cell = np.random.default_rng(5).uniform(size=(6, 10))
    tiled = np.tile(cell, (2, 2))
    noise = np.random.default_rng(6).uniform(-1, 1, tiled.shape)
    ripple = wave(17)  # which hardly changes in one step
    ripples = ripple[:, None] + 0.5 * ripple
    # Less than a fifth of the range meets the grid alike, too.
    for pressure, number in (
        (cell, 1),
        (tiled + 0.3 * noise, 1),
        (1 + 0.01 * cell, 1),
        (ripples, 1),
        (tiled + 0.05 * noise, 4),
        (np.tile(cell, (4, 3)), 12),
        (np.tile(cell[:1], (12, 1)), 12),
        (np.ones((6, 10)), 60),
        (np.vstack((cell, cell[::-1])), 2),
        (np.pad(cell, ((0, 6), (0, 10)), mode="symmetric"), 4),
        (np.hstack((cell, cell[::-1])), 1),
    ):
        assert copies(pressure) == number


@pytest.mark.slow
@pytest.mark.parametrize("capped", [False, True])
@pytest.mark.parametrize("n", [1024, 2048, 4096])
def test_areas_of_the_paper_are_those_of_its_finest_grid(n, capped):
    """Areas of the paper's surface on n x n points are within errors of those on 16384
    x 16384.

    A systematic error shows on large surfaces, where random errors are small. `capped`
    adds the hardness of 150 GPa.
    """
    name = f"paper-16384-64-{'elastoplastic' if capped else 'elastic'}-bem.json"
    finest = json.loads((KEPT / name).read_text())["areas"]["corrected"]
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, rms_slope=1.0)
    periods = (2 * math.pi / 2.5e4,) * 2
    surface = SelfAffine(spectrum, periods, (n, n), seed=7).build()
    material = Material(250e9, 0.0, hardness=150e9 if capped else math.inf)
    areas = bem.solve(Scene(surface, material, Load(12.5e9))).final.areas
    for part in PARTS:
        off = abs(getattr(areas["corrected"], part) - finest[part])
        assert off <= getattr(areas["error"], part) < 0.8 / n


def test_narrow_strips_are_as_uncertain_as_a_contact_without_plastic_points():
    """The elastic area is not more certain than the contact: the fronts of a strip move
    together.

    The sums are made up: 100 points of contact with an outline of 4 spacings, whose
    links to the plastic zone are shared by both fronts.
    """
    zeros = Sums(*np.zeros((len(Sums._fields), 2)))
    contact = np.array([100.0, 0.0])
    sums = zeros._replace(
        points=contact,
        area=contact,
        length=np.array([4.0, 0.0]),
        shared=np.array([40.0, 0.0]),
    )
    _, error = areas_of_sums(sums, 0.08, 1000.0, 1.0)
    assert error.elastic >= error.total > 0


@pytest.mark.parametrize("direction", [(1, 0), (3, 1), (2, 1), (1, 1)])
def test_fronts_without_a_strip_between_them_have_no_offset(direction):
    """The area of a rigid capped ridge of breadth 0.4 is exact in any direction of the
    grid.
    """
    i, j = np.indices((64, 64)) / 64
    across = (direction[0] * i + direction[1] * j) % 1
    gap = 1e3 * (abs(across - 0.5) - 0.2)
    pressure = np.where(gap < 0, 1.0, 0.0)
    _, found, _ = estimate_areas(pressure, gap, 1.0, (1 / 64, 1 / 64), 1.0)
    assert found.total == pytest.approx(0.4, abs=1e-4)


@pytest.mark.long
def test_the_tables_come_from_the_calibration():
    """The tables of offsets in `rim_correction` are those that the laboratory's fits
    give.
    """
    mean, amplitude, scatter = rim.calibrate_directions()
    assert mean == pytest.approx(rim_correction.OFFSETS[-1], abs=6e-4)
    assert amplitude == pytest.approx(rim_correction.HARMONIC, abs=5e-4)
    assert scatter == pytest.approx(0.4 * rim_correction.HARMONIC * mean, abs=5e-4)
    assert rim.calibrate_corner()[0] == pytest.approx(rim_correction.CORNER, abs=0.03)
    # What the choice of positions leaves: moving all of them by a thousandth of a
    # spacing changes the table by 2.2e-4.
    table, misfit = rim.calibrate_strips(rim.all_directions())
    np.testing.assert_allclose(table[:-1], rim_correction.OFFSETS[:-1], atol=3e-4)
    assert misfit < 1e-3
    assert rim.calibrate_release() == pytest.approx(1, abs=0.1)


@pytest.mark.slow
def test_scenes_that_once_were_wrong_are_within_their_claims():
    """Of the scenes that once were wrong, 90 % are within their errors, and none beyond
    1.5.

    Each is drawn with four seeds. `claimed` is the error estimate in the unit of the
    table: a lone point claims all it has.
    """
    small = [scene for scene in area_scenes.SCENES if scene.member.shape[0] < 128]
    tables = [area_scenes.judged(small, seeds=[seed]) for seed in (3, 1, 2, 4)]
    table = tables[0]
    assert len(table) == 11
    times = np.concatenate([one["times"] for one in tables])
    assert np.mean(times <= 1) >= 0.9
    assert (times < 1.5).all()
    assert (table["claimed"] < [1, 200, 50, 50, 70, *[50] * 6]).all()
