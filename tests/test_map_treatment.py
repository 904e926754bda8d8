"""The treatment of measured maps: outliers, form, holes, edges, band, and its notes."""

import functools
import itertools
import math
import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest
from laboratory.areas import KINDS, member
from laboratory.trial_map import trial_map
from test_surface_files import HILLS, MAP, L, X, refused

from epcontact import bem, persson
from epcontact.errors import SurfaceWarning
from epcontact.planning.grids import one_directional
from epcontact.results import COLUMNS
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import (
    HeightsFromArray,
    HeightsFromFile,
    SelfAffine,
    recipes_of,
)
from epcontact.surfaces.power_spectrum import even_moments, surface_moments
from epcontact.surfaces.treatment import (
    EDGE_ERRORS,
    EDGE_FRACTIONS,
    edge_jumps,
    fill_holes,
    find_outliers,
    remove_form,
)

# The heights are about as large as the period, which changes nothing in these tests.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

#: A piece of a larger surface, tilted: as a profilometer sees it.
CUT_OUT = MAP[:40, :31] + 0.01 * np.arange(40)[:, None] - 0.02 * np.arange(31)

# --- outliers -------------------------------------------------------------------------

#: Heights (m) of the trial map without spikes.
CLEAN = 1e-6 * trial_map(0)


def trial_surface(heights, outliers="keep"):
    """Return the surface of heights (m) on the grid of the trial map, levelled and with
    holes filled.

    `outliers` is "keep" or "remove".
    """
    recipe = HeightsFromArray(
        heights,
        (320e-6, 240e-6),
        "periodic",
        missing="harmonic",
        form=1,
        outliers=outliers,
    )
    return recipe.build()


@pytest.mark.parametrize("spikes", [1, 25])
def test_outliers_are_removed_on_demand(spikes):
    """The mean of its neighbours replaces an outlier, to 0.3 µm, and other heights stay
    as they are.

    `spikes` is the number of outliers in the map; all waves have four points or more.
    """
    given = 1e-6 * trial_map(spikes)
    moved = np.nan_to_num(np.abs(given - CLEAN)) > 1e-7
    exact = trial_surface(CLEAN)
    surface = trial_surface(given, "remove")
    error = np.abs(surface.heights - exact.heights)
    assert error[moved].max() < 0.3e-6
    assert error[~moved].max() < 0.01e-6
    assert surface.rms_slope == pytest.approx(exact.rms_slope, rel=1e-3)
    # Outliers are not counted as missing.
    missing = f"{np.count_nonzero(np.isnan(given))} of 120000 heights missing"
    assert any(missing in note for note in surface.notes)


@pytest.mark.parametrize(("spikes", "more"), [(1, ""), (25, " and 19 more")])
def test_outliers_are_kept_with_a_warning(spikes, more):
    """Outliers that are kept cause a SurfaceWarning with their number and up to six of
    their positions.

    `spikes` is their number, and `more` the end of the list of positions.
    """
    given = 1e-6 * trial_map(spikes)
    x, y = np.argwhere(np.abs(given - CLEAN) > 1e-7)[0] * 0.8e-6
    message = f"{spikes} of 120000 heights are outliers"
    with pytest.warns(SurfaceWarning, match=message):
        surface = trial_surface(given)
    (note,) = [note for note in surface.notes if message in note]
    assert f": at ({x:.3g}, {y:.3g})" in note
    assert f"){more} m; the contact sees them as roughness" in note
    assert surface.rms_slope > 1.02 * trial_surface(CLEAN).rms_slope


@pytest.mark.parametrize("seed", [21, 22])
@pytest.mark.parametrize("kind", sorted(KINDS.keys() - {"outliers"}))
def test_real_surfaces_have_no_outliers(kind, seed):
    """No point of a real surface counts as an outlier, also with heights rounded to 60
    steps.

    `kind` is the kind of roughness and `seed` that of its random numbers.
    """
    surface = member(KINDS, kind, seed, 96)
    heights = KINDS[kind](surface, np.random.default_rng(seed))
    assert not find_outliers(heights).any()
    assert not find_outliers(np.round(heights / np.ptp(heights) * 60)).any()


# --- form -----------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(40, 31), (60,)])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_form_is_removed_completely(shape, order):
    """A polynomial of an `order` added to heights changes nothing after its removal.

    `shape` is the grid; the heights have holes.
    """
    grids = np.meshgrid(*(np.arange(n) / 10 for n in shape), indexing="ij")
    form = np.full(shape, 3.0)  # 40 high at most, with the terms below
    if order >= 1:
        form += sum(grids)
    if order == 2:
        form += sum((grid - 1) ** 2 for grid in grids) + math.prod(grids)
    rough = np.random.default_rng(0).standard_normal(shape)
    rough[3:9] = np.nan
    rest = remove_form(rough, order)
    assert np.nanmax(np.abs(remove_form(rough + form, order) - rest)) < 1e-12
    # The rest is orthogonal to the form, as least squares leave it.
    assert np.nansum(rest * form) == pytest.approx(0, abs=1e-10)


#: Indices of the points of a grid along x and y.
GRID_X, GRID_Y = np.meshgrid(np.arange(40.0), np.arange(31.0), indexing="ij")


@pytest.mark.parametrize("form", [1, 2])
@pytest.mark.parametrize(
    ("order", "heights"),
    [
        (1, 0.1 + 0.3 * GRID_X - 0.7 * GRID_Y),
        (1, 0 * GRID_X + 0.1),
        (2, 5 + GRID_X**2 - GRID_X * GRID_Y),
    ],
)
def test_a_plane_or_constant_is_flat_to_the_last_digit(order, heights, form):
    """Heights of a polynomial are exactly 0, with a note, after removal of a `form` of
    its `order` or above.

    `heights` are in µm.
    """
    recipe = HeightsFromArray(1e-6 * heights, (1e-3, 1e-3), "periodic", form=form)
    surface = recipe.build()
    is_flat = form >= order
    assert (np.ptp(surface.heights) == 0) == is_flat
    assert ("the rest is rounding error" in str(surface.notes)) == is_flat


def test_small_roughness_on_a_large_height_is_no_rounding():
    """A roughness of 1 nm on heights of 1 m is kept."""
    recipe = HeightsFromArray(1e-9 * HILLS + 1.0, (1.0, 1.0), "periodic", form=1)
    assert recipe.build().rms_height > 1e-10


def test_a_tilt_that_makes_edges_jump_is_removed():
    """A periodic map that jumps at its edges is levelled with a note, unless `form` is
    0.
    """
    tilted = HeightsFromArray(
        MAP + 0.3 * np.arange(48)[:, None], (L, L), treatment="periodic"
    )
    surface = tilted.build()
    levelled = replace(tilted, form=1).build()
    assert np.array_equal(surface.heights, levelled.heights)
    assert "least-squares plane removed, because its tilt" in str(surface.notes)
    assert surface.treatment_errors
    assert replace(tilted, form=0).build().rms_height > 3 * surface.rms_height


# --- holes ----------------------------------------------------------------------------

SADDLE_X, SADDLE_Y = np.meshgrid(np.arange(20.0), np.arange(16.0), indexing="ij")
#: Harmonic on the grid, too.
SADDLE = SADDLE_X * SADDLE_Y + 3 * SADDLE_X
HOLED = SADDLE.copy()
HOLED[4:12, 3:9] = np.nan


def test_missing_points_of_arrays_and_files_are_filled(tmp_path):
    """Missing points of masked arrays and files are filled by a harmonic function,
    exactly for heights that are harmonic.
    """
    path = tmp_path / "map.npy"
    np.save(path, HOLED)
    steps = {"missing": "harmonic", "treatment": "periodic", "form": 0}
    masked = np.ma.masked_invalid(HOLED)
    for recipe in (
        HeightsFromArray(masked, (1e3, 1e3), **steps),
        HeightsFromFile(path, (1e3, 1e3), unit=1.0, **steps),
    ):
        heights = recipe.build().heights + np.nanmean(HOLED)
        assert heights == pytest.approx(SADDLE, abs=1e-10)


def test_the_nearest_point_fills_a_hole():
    """`fill_holes` with "nearest" takes the height of the nearest point."""
    assert fill_holes(HOLED, "nearest")[4, 5] == SADDLE[3, 5]


def test_a_harmonic_filling_meets_the_edge_at_a_right_angle():
    """A harmonic filling of a line is linear between points and constant up to the
    edges.
    """
    line = np.array([np.nan, np.nan, 1.0, np.nan, 4.0, np.nan])
    assert fill_holes(line, "harmonic") == pytest.approx([1, 1, 1, 2.5, 4, 4])


# --- edges and band -------------------------------------------------------------------


@pytest.mark.parametrize("shift", range(0, 48, 5))
def test_a_map_is_periodic_wherever_it_is_cut(shift):
    """A periodic map is left as it is, and a note states its jump at the edges.

    `shift` is the number of points by which it is moved.
    """
    moved = np.roll(MAP, (shift, shift), (0, 1))
    surface = HeightsFromArray(moved, (L, L)).build()
    assert np.array_equal(surface.heights, moved)
    assert "rms jump at the edges" in surface.notes[0]


#: Three steps of .7 and a jump at the edge.
STEPS_UP = np.array([0.0, 0.7, 1.4])
RAMP = np.zeros((20, 10)) + 0.5 * np.arange(20)[:, None]


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (RAMP, r"edges: 9.5 m across x \(between neighbours at most 0.5 m"),
        (CUT_OUT, "across y"),
        (np.append(STEPS_UP, 2.1 * 0.7), "not periodic"),
    ],
)
def test_a_map_that_jumps_at_its_edges_is_refused(heights, message):
    """A map that jumps more at its edges than between neighbours inside raises an error
    with `message`.
    """
    with refused(message):
        HeightsFromArray(heights, (1.0,) * heights.ndim).build()


@pytest.mark.parametrize(
    "heights",
    [
        np.append(STEPS_UP, 1.9 * 0.7),
        np.repeat([1.0, 0.0], 4)[:, None] * np.ones(8),  # as steep inside as outside
    ],
)
def test_a_map_that_is_as_steep_inside_is_periodic(heights):
    """A map is periodic if its jump at the edges is below twice the steps inside."""
    HeightsFromArray(heights, (1e3,) * heights.ndim).build()


def test_a_file_is_mirrored_so_that_no_edge_is_left(tmp_path):
    """A file that is not periodic is levelled and mirrored along both axes.

    It is then periodic, and its slopes and curvatures are those of the map.
    """
    path = tmp_path / "cut.npy"
    np.save(path, CUT_OUT)
    (recipe,) = recipes_of(HeightsFromFile(path, pixel_size=0.5, unit=1.0))
    surface = recipe.build()
    assert surface.shape == recipe.shape == (80, 62)
    assert surface.periods == recipe.periods == (40.0, 31.0)
    inside = remove_form(CUT_OUT, 1)
    assert surface.heights[:40, :31] == pytest.approx(inside, abs=1e-12)
    assert np.array_equal(surface.heights[::-1], surface.heights)
    assert np.array_equal(surface.heights[:, ::-1], surface.heights)
    assert [edge for edge, _ in edge_jumps(surface.heights)] == [0, 0]
    moments = surface_moments(surface)
    assert even_moments(inside, (0.5, 0.5)) == pytest.approx(moments, rel=1e-12)


#: A surface much larger than the maps that are cut from it.
LARGE_SPECTRUM = SelfAffineSpectrum(0.8, L / 64, L / 16, L / 4, 0.05)
LARGE = SelfAffine(LARGE_SPECTRUM, (256.0, 256.0), (256, 256), seed=3).build().heights


def surface_of_cut(points, treatment):
    """Return the levelled surface of a cut of LARGE, `points` times 3/4 of them points
    with a spacing of 1.

    `treatment` is "mirrored" or "periodic".
    """
    cut = LARGE[:points, : 3 * points // 4]
    return HeightsFromArray(cut, cut.shape, treatment, form=1).build()


def test_errors_of_edges_fall_with_the_size_of_the_map():
    """The relative errors by the edges are EDGE_ERRORS times slope over curvature and
    length of the map, and EDGE_FRACTIONS.

    They fall with the size, and are smaller if the map is mirrored.
    """
    errors = {}
    for points, treatment in itertools.product((48, 96), ("mirrored", "periodic")):
        surface = surface_of_cut(points, treatment)
        shorter = 3 * points // 4
        moments = even_moments(remove_form(LARGE[:points, :shorter], 1), (1.0, 1.0))
        length = moments.rms_slope / moments.rms_curvature / shorter
        expected = {n: length * factor for n, factor in EDGE_ERRORS[treatment].items()}
        expected |= EDGE_FRACTIONS[treatment]
        assert surface.treatment_errors == pytest.approx(expected, rel=1e-9)
        errors[treatment, points] = expected["elastic_area"]
    assert errors["mirrored", 96] < 0.6 * errors["mirrored", 48]
    assert errors["mirrored", 48] < errors["periodic", 48]


@pytest.mark.parametrize(
    "solve",
    [
        bem.solve,
        functools.partial(persson.solve, energy_reduction=1, spectrum="surface"),
    ],
    ids=["bem", "persson"],
)
def test_errors_of_edges_are_a_part_of_the_error_of_each_value(solve):
    """Each value of a result has the error by the treatment of its surface, which is a
    part of its error.

    `solve` is a method.
    """
    surface = surface_of_cut(96, "periodic")
    scene = Scene(surface, Material(1.0, 0.0, hardness=0.01), Load(5e-4))
    result = solve(scene)
    assert result.notes[: len(surface.notes)] == surface.notes
    row = result.final.row
    for name in COLUMNS.keys() & surface.treatment_errors.keys() & row.keys():
        scale = row["total_area"] if name.endswith("area") else row[name]
        expected = 1.19 * surface.treatment_errors[name] * scale  # at 95 %
        found = row[f"{name}_error_by_treatment"]
        assert found == pytest.approx(expected, rel=1e-12)
    assert row["mean_gap_error"] >= row["mean_gap_error_by_treatment"] > 0
    plastic = row["plastic_area_error_by_treatment"]
    assert row["elastic_area_error_by_treatment"] > plastic > 0


def test_a_periodic_map_has_no_errors_of_edges():
    """A periodic map has no error by its treatment, nor has a result on it."""
    surface = HeightsFromArray(LARGE, (256, 256)).build()
    assert not surface.treatment_errors
    scene = Scene(surface, Material(1.0, 0.0, hardness=0.01), Load(5e-4))
    assert "treatment_error" not in bem.solve(scene).final.areas


def test_the_slope_of_an_effective_hardness_does_not_see_jumps_at_the_edges():
    """The rms slope of `even_moments` leaves out jumps at the edges, which add more
    than 10 % to that of the periodic surface.
    """
    spectrum = SelfAffineSpectrum(0.8, L / 256, L / 64, L / 4, 0.05)
    large = SelfAffine(spectrum, (256.0, 256.0), (256, 256), seed=4).build()
    cut = remove_form(large.heights[:64, :64], 1)
    assert even_moments(cut, (1.0, 1.0)).rms_slope == pytest.approx(0.05, rel=0.05)
    assert surface_moments(Surface(cut, (64.0, 64.0))).rms_slope > 1.1 * 0.05


def test_waves_outside_a_band_are_removed():
    """A band of wavelengths leaves the one wave of three that lies inside."""
    x = np.arange(64) * L / 64
    heights = np.cos(x) + np.cos(3 * x) + np.cos(9 * x)
    recipe = HeightsFromArray(
        heights, (L,), longest_wavelength=L / 2, shortest_wavelength=L / 5
    )
    assert recipe.build().heights == pytest.approx(np.cos(3 * x), abs=1e-14)


# --- warnings -------------------------------------------------------------------------


def test_slopes_beyond_one_warn_at_the_line_that_makes_the_surface():
    """A surface with slopes beyond 1 causes a warning at the line of the caller, and
    has it as a note.
    """
    recipe = HeightsFromArray(MAP * 1e3, (L, L))
    with pytest.warns(SurfaceWarning, match="beyond the small slopes") as warned:
        steep = recipe.build()
    (warning,) = warned
    assert warning.filename == __file__
    assert str(warning.message) == steep.notes[-2]


@pytest.mark.filterwarnings("error")
def test_a_warning_comes_once():
    """Copies do not warn, nor surfaces that the package builds for itself."""
    recipe = HeightsFromArray(MAP * 1e3, (L, L))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        steep = recipe.build()
    assert replace(steep).notes == steep.notes
    assert pickle.loads(pickle.dumps(steep)).notes == steep.notes
    assert one_directional(recipe) is None
    assert len(HeightsFromArray(MAP / 10, (L, L)).build().notes) == 2


#: Parts of the notes about heights in steps, a mark for missing heights, and exchanged
#: periods.
STEPPED = "are in steps of"
MARKED = "heights are -9999, far from all others"
OBLONG = "times as long as wide"
STEP = MAP / MAP.std()
SQUARE = (1e3, 1e3)


@pytest.mark.parametrize(
    ("heights", "periods", "warning", "words"),
    [
        (np.round(STEP / 0.3), SQUARE, STEPPED, "neither for these steps nor"),
        (np.round(STEP / 0.01), SQUARE, STEPPED, "but not for its steps"),
        (np.round(STEP / 0.002), SQUARE, "", ""),
        (np.float32(np.round(8 * HILLS)) * np.float32(0.1), SQUARE, STEPPED, ""),
        (np.round(8 * HILLS[3]), (1e3,), STEPPED, ""),
        # Wide treads, and slopes that rise by one step from each point to the next.
        (
            np.round(np.sin(X / 10)[:, None] + np.sin(X / 10)),
            SQUARE,
            STEPPED,
            "for these steps, but",
        ),
        (-np.maximum(np.abs(X)[:, None], np.abs(X)), SQUARE, "", ""),
        (np.where(HILLS > 1.9, -9999.0, HILLS), SQUARE, MARKED, ""),
        (np.where(HILLS > 1.9, -9999.0, 0.0), SQUARE, "", ""),  # a post is no mark
        (HILLS > 0, (1e3, 2e3), "in a picture", ""),
        (HILLS, (2.1e3, 1e3), OBLONG, "the grid's cells are 2.1"),
        (HILLS, (1e3, 1e5), OBLONG, "the grid's cells are 100"),
    ],
)
def test_signs_of_a_mistake_are_noted(heights, periods, warning, words):
    """A surface has a note about `heights` or `periods` (m) that look like a mistake.

    `warning` is the start of the note, or "" for no note, and `words` are a part of it.
    """
    notes = " ".join(HeightsFromArray(heights, periods, "periodic").build().notes)
    assert warning in notes
    assert words in notes
    for other in {STEPPED, MARKED, OBLONG} - {warning}:
        assert other not in notes
