"""Recipes of surfaces: random phases, shapes with closed forms, and filters."""

import math
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import resample

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

# The heights are about as large as the period, which changes nothing of what is tested
# here.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

L = 2 * math.pi
NARROW = SelfAffineSpectrum(0.8, 1.0, 4.0, 20.0, 0.5)
PAPER = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 1.0)
PAPER_PERIOD = 2 * math.pi / 2.5e4
# Square, oblong, even, odd, mixed, lines; 41 points are the fewest for q_1 = 20 on 2
# pi.
GRIDS: list[tuple[tuple[int, ...], tuple[float, ...]]] = [
    ((48, 48), (L, L)),
    ((41, 41), (L, L)),
    ((48, 99), (L, 2 * L)),
    ((44, 45), (L * 1.03, L * 1.07)),
    ((64,), (L,)),
]


def assert_close(got, expected, absolute):
    """Every difference within `absolute`; quicker on large arrays than
    pytest.approx.
    """
    assert np.shape(got) == np.shape(expected)
    assert np.abs(np.asarray(got) - expected).max() <= absolute


def wavenumbers(surface):
    grid = zip(surface.shape, surface.spacing, strict=True)
    axes = [2 * np.pi * np.fft.fftfreq(n, d) for n, d in grid]
    return np.sqrt(sum(q**2 for q in np.meshgrid(*axes, indexing="ij")))


@pytest.mark.parametrize("hurst", [0.0, 0.8, 1.0])
@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_amplitudes_are_those_of_the_spectrum_and_the_rms_slope_is_exact(
    shape, periods, hurst
):
    spectrum = replace(NARROW, hurst=hurst)
    surface = SelfAffine(spectrum, periods, shape, seed=5).build()
    assert surface_moments(surface).rms_slope == pytest.approx(0.5, rel=1e-13)
    assert surface.heights.mean() == pytest.approx(0, abs=1e-15)
    amplitude = np.abs(np.fft.fftn(surface.heights)) / surface.heights.size
    q = wavenumbers(surface)
    cell = math.prod(2 * math.pi / p for p in periods)
    c = density(spectrum, q, len(shape)) / (
        1 if len(shape) == 2 else 2
    )  # C1 is one-sided
    band = (q > 0.9999) & (q < 20.0001)
    ratio = amplitude[band] / np.sqrt(c[band] * cell)
    assert ratio == pytest.approx(np.full(ratio.size, ratio[0]), rel=1e-11)
    # The one factor between the sum over these few modes and the integral.
    assert ratio[0] == pytest.approx(1, abs=0.06)
    assert_close(amplitude[~band], np.zeros(np.sum(~band)), 1e-16)


@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_a_finer_grid_shows_the_same_surface(shape, periods):
    factor = 3
    coarse = SelfAffine(NARROW, periods, shape, seed=11).build()
    fine = SelfAffine(
        NARROW, periods, tuple(factor * n for n in shape), seed=11
    ).build()
    common = fine.heights[tuple(slice(None, None, factor) for _ in shape)]
    scale = np.abs(coarse.heights).max()
    assert_close(common, coarse.heights, 1e-14 * scale)
    # And so does the band-limited interpolant of the coarse one, at every point.
    interpolant = coarse.heights
    for axis, n in enumerate(fine.shape):
        interpolant = resample(interpolant, n, axis=axis)
    assert_close(interpolant, fine.heights, 1e-14 * scale)


def test_a_wider_band_adds_to_the_surface():
    wide = replace(NARROW, wavenumber_high=45.0)
    surfaces = [SelfAffine(s, (L, L), (96, 96), seed=4).build() for s in (NARROW, wide)]
    narrow, below = (filtered(s, 20.0).heights for s in surfaces)
    ratio = narrow.std() / below.std()
    assert ratio > 1.01  # the narrower band has to be steeper for the same slope
    assert_close(narrow, ratio * below, 1e-14 * np.abs(narrow).max())


def test_limits_typed_with_seven_digits_lose_no_mode():
    exact = SelfAffine(PAPER, (PAPER_PERIOD,) * 2, (513, 513), seed=1).build()
    typed = SelfAffine(PAPER, (2.513274e-4,) * 2, (513, 513), seed=1).build()
    # Same modes, same phases; all else follows the period's seventh digit.  One of the
    # 205,000 modes missing or astray would show as 1e-4 of h_rms or more.
    assert_close(typed.heights, exact.heights, 1e-5 * exact.heights.std())


def test_phases_are_uniform_and_unrelated_and_never_change():
    k = np.arange(-400, 400)
    phase, other = (_phases(seed, k[:, None], k[None, :]) for seed in (7, 8))
    assert phase.min() >= 0
    pairs = [
        phase[1:] - phase[:-1],
        phase[:, 1:] - phase[:, :-1],
        phase[1:, 1:] - phase[:-1, :-1],
    ]
    for values in (phase, phase - other, *pairs, phase - phase.T, phase - phase[::-1]):
        for harmonic in (1, 2, 3):
            z = np.exp(1j * harmonic * values[np.abs(values) > 0])
            # |mean| is about 1/sqrt(N) for random phases; half of the last two pairs
            # repeat.
            assert abs(z.mean()) < 5 * math.sqrt(2 / z.size)
    counts = np.histogram(phase, 100, (0, 2 * math.pi))[0]
    chi_squared = float(np.sum((counts - phase.size / 100) ** 2 / (phase.size / 100)))
    assert abs(chi_squared - 99) < 5 * math.sqrt(2 * 99)
    # The seeds of published results must keep their surfaces.
    known = [
        6.112483745973802,
        0.03745723491760489,
        4.605412193590693,
        0.5557279354021715,
    ]
    found = _phases(7, np.array([0, 1, -1, 255]), np.array([1, 0, 1, 3]))
    assert found == pytest.approx(known, rel=1e-15)


ROUGH = SelfAffine(NARROW, (L, L), (48, 48), seed=1)
BUMP = Paraboloid((1.0,), (8,), 1.0)
WAVE = Sinusoid((1.0,), (8,), 0.1)


@pytest.mark.parametrize(
    ("good", "change", "message"),
    [
        (ROUGH, {"shape": (40, 48)}, "40 grid points .* needs at least 41"),
        (
            ROUGH,
            {"periods": (L, L / 2)},
            "wavenumber_low = 1 rad/m needs at least 6.28",
        ),
        (
            ROUGH,
            {"shape": (48, 48, 48), "periods": (L, L, L)},
            "one or two whole numbers",
        ),
        (ROUGH, {"periods": (L, L, L)}, "2 positive lengths"),
        (WAVE, {"waves": 4}, "needs at least 9"),
        (WAVE, {"direction": "both"}, "a line has only x"),
        (WAVE, {"direction": "z"}, "direction is 'z', but must be one of x, y, both"),
        (BUMP, {"centre": (0.5, 0.5)}, "must be 1 fractions"),
    ],
)
def test_recipes_refuse(good, change, message):
    with pytest.raises(InvalidScene, match=message):
        replace(good, **change)


def test_a_grid_that_fits_into_no_memory_is_refused():
    for recipe in (ROUGH, Paraboloid((L, L), (8, 8), 1.0)):
        with pytest.raises(EpcontactError, match="GiB"):
            replace(recipe, shape=(1 << 24, 1 << 24)).build()


def test_a_build_takes_the_heights_and_their_modes():
    tracemalloc.start()
    heights = replace(ROUGH, shape=(1024, 1024)).build().heights
    peak = tracemalloc.get_traced_memory()[1] / heights.nbytes
    tracemalloc.stop()
    assert 0.9 < peak <= 2.1


RECIPES: list[Any] = [
    SelfAffine(NARROW, (L, 2 * L), (48, 100), seed=3),
    SelfAffine(NARROW, (L,), (48,), seed=3),
    Sinusoid((2.0, 3.0), (16, 15), 0.1, 2, "both"),
    Sinusoid((2.0,), (16,), 0.1),
    Paraboloid((2.0, 3.0), (16, 15), 5.0),
    Sphere((2.0, 3.0), (16, 15), 0.4, (0.1, 0.2)),
    FlatPunch((2.0,), (16,), 0.4, 0.1),
]


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda r: type(r).__name__)
def test_a_recipe_knows_the_digest_of_its_scene(recipe):
    material, load, body = Material(1e9, 0.3), Load(1e5), Body()
    surface = recipe.build()
    known = scene_digest(
        recipe.fingerprint, recipe.shape, recipe.periods, material, body, load
    )
    assert Scene(surface, material, load, body).digest == known
    assert (surface.shape, surface.periods) == (recipe.shape, recipe.periods)
    assert not surface.heights.flags.writeable


def test_fingerprints_never_change():
    """Regression: results that are kept are found by them."""
    assert [recipe.fingerprint for recipe in RECIPES[3:]] == [
        "sinusoid/1 periods=(2) shape=(16) amplitude=0.1 waves=1 direction=x",
        "paraboloid/1 periods=(2,3) shape=(16,15) radius=5 centre=(0.5,0.5)",
        "sphere/1 periods=(2,3) shape=(16,15) radius=0.4 centre=(0.1,0.2)",
        "flat_punch/1 periods=(2) shape=(16) radius=0.4 depth=0.1 centre=(0.5)",
    ]
    assert ROUGH.fingerprint.startswith(
        "self_affine/1 spectrum=hurst=0.8 wavenumber_low=1 wavenumber_roll_off=4 "
        "wavenumber_high=20 rms_slope=0.5 periods=(6.283185307179586,6.283185307179586) "
    )


def test_every_parameter_is_in_the_fingerprint_and_equal_numbers_read_equal():
    spectrum = {"hurst": 0.7, "wavenumber_low": 1.1, "wavenumber_roll_off": 4.1}
    spectrum |= {"wavenumber_high": 19.0, "rms_slope": 0.51}
    changes: list[dict[str, Any]] = [
        {"seed": 4},
        {"shape": (48, 49)},
        {"periods": (L, 1.1 * L)},
    ]
    changes += [{"spectrum": replace(NARROW, **{k: v})} for k, v in spectrum.items()]
    recipes = [ROUGH, *(replace(ROUGH, **change) for change in changes)]
    assert len({recipe.fingerprint for recipe in recipes}) == 1 + len(changes)
    of_numpy = SelfAffineSpectrum(np.float64(0.8), 1, 4, np.float64(20), 0.5)
    same = SelfAffine(of_numpy, (7, np.float64(7)), (np.int64(48), 48), np.int64(1))
    assert same.fingerprint == replace(ROUGH, periods=(7.0, 7.0)).fingerprint
    assert hash(same) == hash(replace(ROUGH, periods=(7.0, 7.0)))
    assert (
        Surface(np.eye(3), (1.0, 1.0)).fingerprint
        != Surface(2 * np.eye(3), (1, 1)).fingerprint
    )


def test_sinusoids():
    x, y = np.arange(16) / 16, np.arange(15) / 15
    waves = {"x": np.cos(4 * np.pi * x)[:, None], "y": np.cos(4 * np.pi * y)}
    waves["both"] = waves["x"] * waves["y"]
    for direction, wave in waves.items():
        surface = Sinusoid((2.0, 3.0), (16, 15), 0.1, 2, direction).build()
        # Arguments up to 4 pi are rounded by 1e-15, so the waves of 0.1 by 1e-16 or
        # two.
        assert_close(surface.heights, np.broadcast_to(0.1 * wave, (16, 15)), 3e-16)
        assert surface.heights.max() == surface.heights[0, 0] == 0.1
        assert surface.shortest_wavelength == (1.5 if direction == "y" else 1.0)


def test_bumps_have_their_radius_and_place():
    periods, shape = (2.0, 3.0), (40, 50)
    x = np.arange(40) / 40 * 2 - 1.0
    y = np.arange(50) / 50 * 3 - 1.5
    r2 = x[:, None] ** 2 + y**2
    bump = Paraboloid(periods, shape, 7.0).build().heights
    assert_close(bump, -r2 / 14, 1e-15)
    assert bump[20, 25] == bump.max() == 0
    ball = Sphere(periods, shape, 0.83).build().heights
    exact = np.sqrt(np.maximum(0.83**2 - r2, 0)) - 0.83
    assert_close(
        ball, exact, 1e-14
    )  # the rim, infinitely steep, is 0.01 away from the grid
    punch = FlatPunch(periods, shape, 0.8, 0.3).build().heights
    # 0.8 = 16 spacings: the rim meets grid points, which rounding must not share out.
    assert np.array_equal(punch, np.where(r2 > 0.64 + 1e-12, -0.3, 0.0))
    assert np.array_equal(punch[1:], punch[1:][::-1])
    # The nearest image of a bump counts.
    for kind in (Paraboloid, Sphere):
        middle = kind(periods, shape, 0.87, (0.5, 0.5)).build().heights
        moved = kind(periods, shape, 0.87, (0.75, 1.02)).build().heights
        assert_close(np.roll(middle, (10, 26), (0, 1)), moved, 1e-14)
    assert Sphere((1.0,), (8, 8), 1.0) == Sphere(
        (1.0, 1.0), (8, 8), 1.0
    )  # one period for both


@pytest.mark.parametrize("shape", [(8, 8), (7, 9), (8,), (9,)])
def test_filtering_keeps_the_long_waves_alone(shape):
    heights = 3 + np.random.default_rng(0).standard_normal(shape)
    surface = Surface(heights, (1.0, 2.0)[: len(shape)])
    q = wavenumbers(surface)
    cut = 2.5 * 2 * math.pi
    once = filtered(surface, cut)
    modes = np.where(q <= cut, np.fft.fftn(surface.heights), 0)
    assert once.heights == pytest.approx(np.fft.ifftn(modes).real, rel=1e-13)
    assert filtered(once, cut).heights == pytest.approx(once.heights, rel=1e-14)
    assert filtered(surface, 1e9).heights == pytest.approx(surface.heights, rel=1e-13)


def test_a_cut_off_takes_its_spectrum_along():
    surface = ROUGH.build()
    cut = filtered(surface, 10.0)
    assert cut.spectrum is not None
    assert cut.spectrum.wavenumber_high == 10.0
    assert cut.spectrum.rms_slope**2 == pytest.approx(
        slope_variance_up_to(NARROW, 10.0)
    )
    # The surface's own partial slope, by its few modes, is near that of the integral.
    assert surface_moments(cut).rms_slope == pytest.approx(
        cut.spectrum.rms_slope, rel=0.05
    )
    assert cut.shortest_wavelength == pytest.approx(L / 10)
    assert filtered(surface, 10.0, 1.0).spectrum == cut.spectrum
    band, long = filtered(surface, 10.0, 2.0), filtered(surface, 1.99)
    assert band.heights == pytest.approx(cut.heights - long.heights, abs=1e-14)
    assert (band.spectrum, band.shortest_wavelength) == (None, cut.shortest_wavelength)
    assert (
        len({s.fingerprint for s in (surface, cut, band, filtered(surface, 10.0, 3.0))})
        == 4
    )
    flat = filtered(surface, 0.5)
    assert flat.spectrum is None
    assert np.abs(flat.heights).max() < 1e-15
    assert filtered(surface, 100.0).shortest_wavelength == surface.shortest_wavelength


# --- two bodies
# ----------------------------------------------------------------------------------


def test_two_surfaces_touch_as_the_sum_of_their_heights():
    """Two spheres have the sum of their curvatures: R = R1 R2 / (R1 + R2)."""
    grid: Any = {"periods": (1.0, 2.0), "shape": (16, 32), "centre": (0.3, 0.6)}
    both = Facing(Paraboloid(**grid, radius=6.0), Paraboloid(**grid, radius=3.0))
    one = Paraboloid(**grid, radius=2.0)
    assert (both.shape, both.periods) == (one.shape, one.periods)
    assert both.build().heights == pytest.approx(one.build().heights, abs=1e-15)
    assert both.build().fingerprint == both.fingerprint
    assert both.fingerprint != Facing(both.second, both.first).fingerprint
    for other in ({"shape": (16, 16)}, {"periods": (1.0, 1.9)}):
        with pytest.raises(
            InvalidScene, match="face each other on one grid and period"
        ):
            Facing(both.first, replace(one, **other))


def test_two_bodies_have_the_modulus_of_springs_in_series():
    steel, glass = Material(210e9, 0.3, hardness=2e9), Material(70e9, 0.2)
    half = effective_modulus(steel) / 2
    assert effective_modulus(combined_material(steel, steel)) == pytest.approx(
        half, rel=1e-15
    )
    expected = 1 / (0.91 / 210e9 + 0.96 / 70e9)
    for first, second in ((steel, glass), (glass, steel)):
        assert effective_modulus(combined_material(first, second)) == pytest.approx(
            expected, rel=1e-15
        )
        assert combined_material(first, second).hardness == first.hardness
    rigid = combined_material(steel, Material(1e30, 0.0))
    assert rigid.young_modulus == pytest.approx(steel.young_modulus, rel=1e-15)
