"""Recipes of surfaces: random phases, shapes with closed forms, filters, two bodies."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import resample
from test_spectra import wave_vector

from epcontact.errors import EpcontactError, InvalidScene
from epcontact.materials.moduli import combined_material, effective_modulus
from epcontact.scene import (
    Body,
    Load,
    Material,
    Scene,
    SelfAffineSpectrum,
    Surface,
    scene_digest,
)
from epcontact.surfaces import (
    Facing,
    FlatPunch,
    Paraboloid,
    SelfAffine,
    Sinusoid,
    Sphere,
    filtered,
)
from epcontact.surfaces.power_spectrum import surface_moments
from epcontact.surfaces.self_affine import _phases
from epcontact.surfaces.spectrum import density, slope_variance_up_to

# The heights are about as large as the period, which changes nothing in these tests.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

L = 2 * math.pi
NARROW = SelfAffineSpectrum(0.8, 1.0, 4.0, 20.0, 0.5)
PAPER = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 1.0)
PAPER_PERIOD = 2 * math.pi / 2.5e4
#: Square, smallest for NARROW, oblong, with unequal spacings, and a line.
GRIDS = [
    ((48, 48), (L, L)),
    ((41, 41), (L, L)),
    ((48, 99), (L, 2 * L)),
    ((44, 45), (L * 1.03, L * 1.07)),
    ((64,), (L,)),
]


def assert_close(found, expected, tolerance):
    """Require that two arrays have one shape and differ by at most `tolerance` at every
    element.

    On large arrays this is quicker than pytest.approx.
    """
    assert np.shape(found) == np.shape(expected)
    assert np.abs(np.asarray(found) - expected).max() <= tolerance


def wavenumbers(surface):
    """Return |q| in rad/m of each mode of `numpy.fft.fftn` of a surface, with the
    surface's shape.
    """
    return np.hypot.reduce(wave_vector(surface))


@pytest.mark.parametrize("hurst", [0.0, 0.8, 1.0])
@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_amplitudes_are_those_of_the_spectrum(shape, periods, hurst):
    """Each mode inside of the band, 1 to 20 rad/m, has the amplitude of the spectrum
    times one common factor, and all others are zero.

    The factor makes the rms slope exactly 0.5.
    """
    spectrum = replace(NARROW, hurst=hurst)
    surface = SelfAffine(spectrum, periods, shape, seed=5).build()
    assert surface_moments(surface).rms_slope == pytest.approx(0.5, rel=1e-13)
    assert surface.heights.mean() == pytest.approx(0, abs=1e-15)
    q = wavenumbers(surface)
    inside = (q > 0.9999) & (q < 20.0001)
    amplitude = np.abs(np.fft.fftn(surface.heights)) / surface.heights.size
    assert amplitude[~inside].max() <= 1e-16
    sides = 3 - len(shape)  # the density of a line is one-sided
    cell = math.prod(2 * math.pi / period for period in periods)
    variance = density(spectrum, q[inside], len(shape)) * cell / sides
    ratio = amplitude[inside] / np.sqrt(variance)
    assert_close(ratio, np.full(ratio.size, ratio[0]), 1e-11)
    # The sum over these few modes differs from the integral by this factor.
    assert ratio[0] == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_a_finer_grid_shows_the_same_surface(shape, periods):
    """A surface on three times as many points along each side is the band-limited
    interpolant of the coarse one.

    `shape` is that of the coarse grid, and `periods` are in m.
    """
    coarse = SelfAffine(NARROW, periods, shape, seed=11).build().heights
    finer = tuple(3 * n for n in shape)
    fine = SelfAffine(NARROW, periods, finer, seed=11).build().heights
    tolerance = 1e-14 * np.abs(coarse).max()
    assert_close(fine[tuple(slice(None, None, 3) for _ in shape)], coarse, tolerance)
    interpolant = coarse  # band-limited, and right at every point
    for axis, points in enumerate(finer):
        interpolant = resample(interpolant, points, axis=axis)
    assert_close(interpolant, fine, tolerance)


def test_a_wider_band_adds_to_the_surface():
    """The narrow band has to be steeper for the same slope, by one factor."""
    wide = replace(NARROW, wavenumber_high=45.0)
    narrow, below = (
        filtered(SelfAffine(spectrum, (L, L), (96, 96), seed=4).build(), 20.0).heights
        for spectrum in (NARROW, wide)
    )
    ratio = narrow.std() / below.std()
    assert ratio > 1.01
    assert_close(narrow, ratio * below, 1e-14 * np.abs(narrow).max())


def test_limits_typed_with_seven_digits_lose_no_mode():
    """One of the 205,000 modes missing or astray would show as 1e-4 of h_rms."""
    exact = SelfAffine(PAPER, (PAPER_PERIOD,) * 2, (513, 513), seed=1).build()
    typed = SelfAffine(PAPER, (2.513274e-4,) * 2, (513, 513), seed=1).build()
    assert_close(typed.heights, exact.heights, 1e-5 * exact.heights.std())


def test_phases_are_uniform_and_unrelated():
    """The phases of 640000 modes are uniform, and so are their differences between
    seeds, neighbours and mirrored modes.

    The mean of exp(i m phase) over n modes has the standard error 1 / sqrt(n); chi
    squared of 100 bins has the mean 99 and the variance 198.
    """
    k = np.arange(-400, 400)
    phase, other = (_phases(seed, k[:, None], k[None, :]) for seed in (7, 8))
    assert phase.min() >= 0
    differences = [
        phase,
        phase - other,
        phase[1:] - phase[:-1],
        phase[:, 1:] - phase[:, :-1],
        phase[1:, 1:] - phase[:-1, :-1],
        phase - phase.T,
        phase - phase[::-1],
    ]
    for values in differences:
        for harmonic in (1, 2, 3):
            z = np.exp(1j * harmonic * values[np.abs(values) > 0])
            # Five standard errors; half of the values of the last two repeat.
            assert abs(z.mean()) < 5 * math.sqrt(2 / z.size)
    counts, _ = np.histogram(phase, 100, (0, 2 * math.pi))
    expected = phase.size / 100
    chi_squared = np.sum((counts - expected) ** 2 / expected)
    assert abs(chi_squared - 99) < 5 * math.sqrt(2 * 99)


def test_phases_of_a_seed_never_change():
    """The seeds of published results must keep their surfaces."""
    found = _phases(7, np.array([0, 1, -1, 255]), np.array([1, 0, 1, 3]))
    published = [
        6.112483745973802,
        0.03745723491760489,
        4.605412193590693,
        0.5557279354021715,
    ]
    assert found == pytest.approx(published, rel=1e-15)


ROUGH = SelfAffine(NARROW, (L, L), (48, 48), seed=1)
BUMP = Paraboloid((1.0,), (8,), 1.0)
WAVE = Sinusoid((1.0,), (8,), 0.1)


@pytest.mark.parametrize(
    ("recipe", "change", "message"),
    [
        (ROUGH, {"shape": (40, 48)}, "40 grid points .* needs at least 41"),
        (ROUGH, {"periods": (L, L / 2)}, "wavenumber_low = 1 rad/m needs at .* 6.28"),
        (
            ROUGH,
            {"shape": (48, 48, 48), "periods": (L, L, L)},
            "one or two whole numbers",
        ),
        (WAVE, {"waves": 4}, "needs at least 9"),
        (WAVE, {"direction": "both"}, "a line has only x"),
        (WAVE, {"direction": "z"}, "direction is 'z', but must be one of x, y, both"),
        (BUMP, {"centre": (0.5, 0.5)}, "must be 1 fractions"),
    ],
)
def test_recipes_refuse(recipe, change, message):
    """An invalid parameter of a recipe raises InvalidScene with a matching message.

    `change` replaces parameters of the valid `recipe`.
    """
    with pytest.raises(InvalidScene, match=message):
        replace(recipe, **change)


@pytest.mark.parametrize("recipe", [ROUGH, Paraboloid((L, L), (8, 8), 1.0)])
def test_a_grid_that_fits_into_no_memory_is_refused(recipe):
    """A grid of 2^48 points is refused with the memory it needs."""
    with pytest.raises(EpcontactError, match="GiB"):
        replace(recipe, shape=(2**24, 2**24)).build()


def test_a_build_takes_the_heights_and_their_modes():
    """Building a surface takes at most 2.1 times the memory of its heights."""
    tracemalloc.start()
    heights = replace(ROUGH, shape=(1024, 1024)).build().heights
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 0.9 < peak / heights.nbytes <= 2.1


RECIPES = [
    SelfAffine(NARROW, (L, 2 * L), (48, 100), seed=3),
    SelfAffine(NARROW, (L,), (48,), seed=3),
    Sinusoid((2.0, 3.0), (16, 15), 0.1, 2, "both"),
    Sinusoid((2.0,), (16,), 0.1),
    Paraboloid((2.0, 3.0), (16, 15), 5.0),
    Sphere((2.0, 3.0), (16, 15), 0.4, (0.1, 0.2)),
    FlatPunch((2.0,), (16,), 0.4, 0.1),
]


@pytest.mark.parametrize("recipe", RECIPES, ids=str)
def test_a_recipe_knows_the_digest_of_its_scene(recipe):
    """The digest, shape and periods that a recipe gives without its heights are those
    of the scene that is built from it.
    """
    material = Material(1e9, 0.3)
    load = Load(1e5)
    body = Body()
    surface = recipe.build()
    digest = scene_digest(
        recipe.fingerprint, recipe.shape, recipe.periods, material, body, load
    )
    assert Scene(surface, material, load, body).digest == digest
    assert surface.shape == recipe.shape
    assert surface.periods == recipe.periods
    assert not surface.heights.flags.writeable


def test_fingerprints_never_change():
    """Fingerprints hold every parameter, and equal those of saved results, which are
    found by them.
    """
    assert [recipe.fingerprint for recipe in RECIPES[3:]] == [
        "sinusoid/1 periods=(2) shape=(16) amplitude=0.1 waves=1 direction=x",
        "paraboloid/1 periods=(2,3) shape=(16,15) radius=5 centre=(0.5,0.5)",
        "sphere/1 periods=(2,3) shape=(16,15) radius=0.4 centre=(0.1,0.2)",
        "flat_punch/1 periods=(2) shape=(16) radius=0.4 depth=0.1 centre=(0.5)",
    ]
    assert ROUGH.fingerprint == (
        "self_affine/1 spectrum=hurst=0.8 wavenumber_low=1 wavenumber_roll_off=4 "
        "wavenumber_high=20 rms_slope=0.5 "
        "periods=(6.283185307179586,6.283185307179586) shape=(48,48) seed=1"
    )


def test_heights_without_a_recipe_are_identified_by_their_bytes():
    """Two surfaces with different heights and without recipes have different
    fingerprints.
    """
    surface = Surface(np.eye(3), (1.0, 1.0))
    twice_as_high = Surface(2 * np.eye(3), (1, 1))
    assert surface.fingerprint != twice_as_high.fingerprint


def test_equal_numbers_read_equal():
    """Numbers of numpy and of Python that are equal give recipes with one fingerprint
    and one hash.
    """
    of_numpy = SelfAffineSpectrum(np.float64(0.8), 1, 4, np.float64(20), 0.5)
    found = SelfAffine(of_numpy, (7, np.float64(7)), (np.int64(48), 48), np.int64(1))
    expected = replace(ROUGH, periods=(7.0, 7.0))
    assert found.fingerprint == expected.fingerprint
    assert hash(found) == hash(expected)


@pytest.mark.parametrize(("direction", "period"), [("x", 2), ("y", 3), ("both", 2)])
def test_sinusoids(direction, period):
    """A sinusoid has two waves of amplitude 0.1 along its direction, and its crest at
    the first point.

    `period` is that along which the shortest wavelength is measured.
    """
    wave_of_x = np.cos(4 * np.pi * np.arange(16) / 16)[:, None]
    wave_of_y = np.cos(4 * np.pi * np.arange(15) / 15)
    waves = {"x": wave_of_x, "y": wave_of_y, "both": wave_of_x * wave_of_y}
    surface = Sinusoid((2.0, 3.0), (16, 15), 0.1, 2, direction).build()
    expected = np.broadcast_to(0.1 * waves[direction], (16, 15))
    assert_close(surface.heights, expected, 3e-16)  # a rounding or two of the cosine
    assert surface.shortest_wavelength == period / 2


#: The grid of the shapes with a centre, and r^2 on it.
GRID = {"periods": (2.0, 3.0), "shape": (40, 50)}
R_SQUARED = np.add.outer(
    (np.arange(40) / 40 * 2 - 1.0) ** 2, (np.arange(50) / 50 * 3 - 1.5) ** 2
)


def test_a_paraboloid_has_its_radius_and_summit():
    """The heights are -r^2 / (2 R) with R = 7 m, and the summit is the middle point."""
    bump = Paraboloid(**GRID, radius=7.0).build().heights
    assert_close(bump, -R_SQUARED / 14, 1e-15)


def test_a_sphere_has_its_radius():
    """The heights are sqrt(R^2 - r^2) - R inside of the radius, and -R outside."""
    ball = Sphere(**GRID, radius=0.83).build().heights
    # The rim, which is infinitely steep, is 0.01 away from the grid.
    exact = np.sqrt(np.maximum(0.83**2 - R_SQUARED, 0)) - 0.83
    assert_close(ball, exact, 1e-14)


def test_points_on_the_rim_of_a_punch_belong_to_it():
    """Rounding takes no point on the rim away: the radius 0.8 is 16 grid spacings."""
    punch = FlatPunch(**GRID, radius=0.8, depth=0.3).build().heights
    assert np.array_equal(punch, np.where(R_SQUARED > 0.64 + 1e-12, -0.3, 0.0))


@pytest.mark.parametrize("shape", [Paraboloid, Sphere])
def test_the_nearest_image_of_a_bump_counts(shape):
    """A bump that is moved over the edge of the period is the rolled one."""
    middle = shape(**GRID, radius=0.87).build().heights
    moved = shape(**GRID, radius=0.87, centre=(0.75, 1.02)).build().heights
    assert_close(np.roll(middle, (10, 26), (0, 1)), moved, 1e-14)


def test_one_period_may_stand_for_both():
    """A tuple of one period on a 2D grid stands for both directions."""
    assert Sphere((1.0,), (8, 8), 1.0) == Sphere((1.0, 1.0), (8, 8), 1.0)


@pytest.mark.parametrize("shape", [(8, 8), (7, 9), (8,), (9,)])
def test_filtering_keeps_the_long_waves_alone(shape):
    """The filter keeps exactly the modes of white noise up to the cut-off, 2.5 waves
    per m, with the mean height; `shape` is that of the grid.
    """
    heights = 3 + np.random.default_rng(0).standard_normal(shape)
    surface = Surface(heights, (1.0, 2.0)[: len(shape)])
    cut = 2.5 * 2 * math.pi
    once = filtered(surface, cut)
    modes = np.where(wavenumbers(surface) <= cut, np.fft.fftn(heights), 0)
    assert once.heights == pytest.approx(np.fft.ifftn(modes).real, rel=1e-13)
    assert filtered(once, cut).heights == pytest.approx(once.heights, rel=1e-14)
    assert filtered(surface, 1e9).heights == pytest.approx(heights, rel=1e-13)


def test_a_cut_off_takes_its_spectrum_along():
    """A filtered surface has the spectrum that ends at the cut-off, with the rms slope
    of that spectrum.
    """
    cut = filtered(ROUGH.build(), 10.0)
    assert cut.spectrum.wavenumber_high == 10.0
    slope = cut.spectrum.rms_slope
    assert slope**2 == pytest.approx(slope_variance_up_to(NARROW, 10.0))
    # The slope by the few modes of the surface is near that of the integral.
    assert surface_moments(cut).rms_slope == pytest.approx(slope, rel=0.05)
    assert cut.shortest_wavelength == pytest.approx(L / 10)


def test_long_waves_are_removed_with_the_spectrum_that_has_them():
    """A band filter removes the waves below its second wavenumber, and the spectrum if
    that removes any; each filter changes the fingerprint.
    """
    surface = ROUGH.build()
    cut = filtered(surface, 10.0)
    band = filtered(surface, 10.0, 2.0)
    long_waves = filtered(surface, 1.99)
    difference = cut.heights - long_waves.heights
    assert band.heights == pytest.approx(difference, abs=1e-14)
    assert band.spectrum is None
    assert band.shortest_wavelength == cut.shortest_wavelength
    assert filtered(surface, 10.0, 1.0).spectrum == cut.spectrum
    narrower = filtered(surface, 10.0, 3.0)
    fingerprints = {each.fingerprint for each in (surface, cut, band, narrower)}
    assert len(fingerprints) == 4


def test_a_filter_beyond_the_band_leaves_nothing_or_all():
    """A cut-off below the lowest wave leaves a flat surface, and one above the highest
    changes no wavelength.
    """
    surface = ROUGH.build()
    flat = filtered(surface, 0.5)
    assert flat.spectrum is None
    assert np.abs(flat.heights).max() < 1e-15
    assert filtered(surface, 100.0).shortest_wavelength == surface.shortest_wavelength


# --- two bodies -----------------------------------------------------------------------

PLACE = {"periods": (1.0, 2.0), "shape": (16, 32), "centre": (0.3, 0.6)}
FACING = Facing(Paraboloid(**PLACE, radius=6.0), Paraboloid(**PLACE, radius=3.0))


def test_two_surfaces_touch_as_the_sum_of_their_heights():
    """Two paraboloids have the sum of their curvatures: 1/6 + 1/3 = 1/2."""
    sum_of_both = Paraboloid(**PLACE, radius=2.0)
    surface = FACING.build()
    assert surface.shape == FACING.shape == sum_of_both.shape
    assert surface.periods == FACING.periods == sum_of_both.periods
    assert surface.heights == pytest.approx(sum_of_both.build().heights, abs=1e-15)
    assert surface.fingerprint == FACING.fingerprint
    assert FACING.fingerprint != Facing(FACING.second, FACING.first).fingerprint


@pytest.mark.parametrize("change", [{"shape": (16, 16)}, {"periods": (1.0, 1.9)}])
def test_two_surfaces_on_different_grids_are_refused(change):
    """Surfaces that face each other must have the same shape and periods.

    `change` replaces one of them for the second surface.
    """
    with pytest.raises(InvalidScene, match="face each other on one grid and period"):
        Facing(FACING.first, replace(FACING.second, **change))


STEEL = Material(210e9, 0.3, hardness=2e9)
GLASS = Material(70e9, 0.2)


@pytest.mark.parametrize(
    ("first", "second", "compliance"),
    [
        (STEEL, STEEL, 2 * 0.91 / 210e9),
        (STEEL, GLASS, 0.91 / 210e9 + 0.96 / 70e9),
        (GLASS, STEEL, 0.91 / 210e9 + 0.96 / 70e9),
        (STEEL, Material(1e30, 0.0), 0.91 / 210e9),
    ],
)
def test_two_bodies_have_the_modulus_of_springs_in_series(first, second, compliance):
    """The combined effective modulus of two materials is one over the sum of their
    compliances (1 - nu^2) / E, in 1/Pa; the hardness is that of the first.
    """
    material = combined_material(first, second)
    assert effective_modulus(material) == pytest.approx(1 / compliance, rel=1e-15)
    assert material.hardness == first.hardness
