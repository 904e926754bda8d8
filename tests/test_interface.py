"""Stiffness, conductance, patches and percolation of a contact under load."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from laboratory import patches
from scipy.ndimage import label

from epcontact import (
    Body,
    InvalidCase,
    Load,
    Material,
    NotConverged,
    Scene,
    SelfAffineSpectrum,
    Surface,
    bem,
)
from epcontact.harness.quantities.registry import measure, measure_all, measure_on
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.interface import (
    contact_conductance,
    find_patches,
    interface_stiffness,
    percolation_fraction,
    punch,
)
from epcontact.interface.punch import solve_punch
from epcontact.reference.layers import compliance
from epcontact.reference.posts import CAPPED_STRIP
from epcontact.results import APART, ELASTIC
from epcontact.surfaces import SelfAffine, residual_surface

#: A line of which the first half is 1 mm above the rest.
STRIPS = Scene(
    Surface(-0.001 * (np.arange(16) > 7), (1.0,)), Material(1.0, 0.0), Load(0.01)
)
SPECTRUM = SelfAffineSpectrum(
    0.8, 2 * math.pi, 8 * math.pi, 32 * math.pi, rms_slope=0.1
)
#: Roughness of unit period with four points on each of its shortest waves.
ROUGH = SelfAffine(SPECTRUM, (1.0, 1.0), (64, 64), seed=31).build()
BRANCHES = ("loading", "unloading")


# --- stiffness and conductance --------------------------------------------------------


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 0.2)])
def test_the_stiffness_is_the_derivative_of_the_load_on_both_branches(body):
    """The stiffness is the derivative of the mean pressure by the mean separation, on
    loading and unloading.

    `body` is a half-space and a layer; finite differences over load changes that move
    no front are exact to 1e-6.
    """
    pressure = 0.005
    change = 2e-6
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness=0.06), Load(pressure), body)

    def separation(*path):
        """Return the mean separation after a load path, in units of the period.

        `path` are mean pressures in units of Young's modulus.
        """
        result = bem.solve(replace(scene, load=Load(path)), tolerance=1e-13)
        return result.final.quantities["mean_separation"]

    result = bem.solve(scene, tolerance=1e-13)
    loading = interface_stiffness(scene, result, "loading").raw
    unloading = interface_stiffness(scene, result, "unloading").raw
    here = separation(pressure)
    closer = here - separation(pressure * (1 + change))
    wider = separation(pressure, pressure * (1 - change)) - here
    assert loading == pytest.approx(change * pressure / closer, rel=1e-6)
    assert unloading == pytest.approx(change * pressure / wider, rel=1e-6)
    assert unloading > 1.02 * loading


@pytest.mark.parametrize("hardness", [0.02, math.inf])
def test_a_contact_conducts_as_an_elastic_punch_of_its_shape_sinks(hardness):
    """The conductance is 2 / (E* resistivity) times the stiffness of a flat punch of
    the contact's shape, plastic points included.

    The punch is solved as a contact of elastic energy p0 u / 2, with the mean pressure
    p0 and the displacement u; `hardness` is over Young's modulus.
    """
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness), Load(0.005))
    result = bem.solve(scene)
    load = 1e-5
    flat = np.where(result.fields["state"] != APART, 0.0, -1e-3)
    flat_scene = Scene(Surface(flat, (1.0, 1.0)), Material(1.0, 0.3), Load(load))
    flat_result = bem.solve(flat_scene, tolerance=1e-12)
    flat_area = flat_result.final.areas["raw"].total
    assert flat_area == result.final.areas["raw"].total
    sinking = 2 * flat_result.final.quantities["elastic_energy"] / load
    stiffness = load / sinking
    modulus = 1 / (1 - 0.3**2)
    expected = 2 * stiffness / (modulus * 0.7)
    conductance = contact_conductance(scene, result, resistivity=0.7)
    assert conductance.raw == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("turned", [False, True])
def test_a_straight_rim_is_corrected_to_the_second_order(turned):
    """The stiffness of a flat strip has an error of first order in the spacing, and
    corrected one of second order.

    The cells are oblong, and `turned` exchanges the axes; the error that is left is 0.6
    (spacing over the strip's width)^2.
    """
    errors = []
    for n in (32, 128, 512):
        profile = np.where(np.arange(n) < 0.6 * n, 0.0, -1e-3)
        heights = np.repeat(profile[:, None], n // 2, 1)
        if turned:
            heights = heights.T
        scene = Scene(Surface(heights, (1.0, 1.0)), Material(1.0, 0.0), Load(1e-5))
        width = (profile == 0).mean()
        exact = -math.pi / 2 / math.log(math.sin(math.pi / 2 * width))
        limit = interface_stiffness(scene, bem.solve(scene, threads=1), "loading")
        errors.append((limit.raw / exact - 1, limit.corrected / exact - 1))
    raw, corrected = np.abs(errors).T
    raw_order = np.log2(raw[:-1] / raw[1:]) / 2
    order = np.log2(corrected[:-1] / corrected[1:]) / 2
    np.testing.assert_allclose(raw_order, 1, atol=0.05)
    np.testing.assert_allclose(order, 2, atol=0.1)
    assert corrected[-1] < 3e-5
    assert raw[-1] > 1e-3


def test_the_elastic_middle_of_a_capped_strip_is_corrected():
    """The corrected stiffness of a strip with plastic edges is closer to its closed
    form than the raw one, and its error estimate covers the rest.

    The edges of the strip and of its plastic part are resolved to a fraction of the
    spacing.
    """
    rows = []
    for half_width in (0.21, 0.33):
        distance = np.abs(np.arange(2048) / 2048 - 0.5)
        heights = np.where(distance < half_width, 0.0, -5e-3)
        scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0, 1e-3), Load(3e-4))
        result = bem.solve(scene)
        for branch in BRANCHES:
            exact = CAPPED_STRIP.scalar(f"quantity.stiffness_{branch}", scene)
            limit = interface_stiffness(scene, result, branch)
            corrected = limit.corrected / exact - 1
            rows.append((corrected, limit.raw / exact - 1, limit.error / exact))
    corrected, raw, estimate = np.abs(rows).T
    assert corrected.max() < 0.4 * raw.max()
    assert (corrected < estimate).all()


def test_limits_scale_with_units_and_do_not_depend_on_the_order_of_axes():
    """The stiffness times E / period does not depend on units, nor on exchanged
    axes.
    """
    heights = ROUGH.heights[:, ::2]
    material = Material(1.0, 0.3, hardness=0.06)
    scene = Scene(Surface(heights, (1.0, 1.0)), material, Load(0.005))
    stiff_material = Material(2e11, 0.3, hardness=0.06 * 2e11)
    small = Surface(3e-4 * heights, (3e-4, 3e-4))
    in_other_units = Scene(small, stiff_material, Load(0.005 * 2e11))
    turned = Scene(Surface(heights.T, (1.0, 1.0)), material, Load(0.005))
    for branch in BRANCHES:
        limit = interface_stiffness(scene, bem.solve(scene), branch)
        for factor, other in ((2e11 / 3e-4, in_other_units), (1.0, turned)):
            other_limit = interface_stiffness(other, bem.solve(other), branch)
            np.testing.assert_allclose(other_limit, limit.times(factor), rtol=1e-6)


def test_error_estimates_cover_the_errors_of_limits():
    """At least 80 % of the errors against a grid four times as fine are within their
    estimates, on surfaces that were used to fit no constant.

    At most half of the errors are within a tenth of the estimates, and of percolation
    at most six of ten.
    """
    spectrum = replace(SPECTRUM, wavenumber_high=24 * math.pi)
    names = ("conductance", "stiffness_loading", "contact_percolation")
    kinds = ("", ".raw", ".error")
    quantities = [f"quantity.{name}{kind}" for name in names for kind in kinds]
    rows = []
    for seed in range(500, 512):
        hardness = (0.02, 0.05, math.inf)[seed % 3]
        limits = []
        for n in (48, 192):
            surface = SelfAffine(spectrum, (1.0, 1.0), (n, n), seed).build()
            scene = Scene(surface, Material(1.0, 0.3, hardness), Load(0.004))
            result = bem.solve(scene, threads=1)
            values = measure_all(quantities, scene, result).values()
            limits.append(np.reshape([*values], (len(names), len(kinds))))
        coarse, fine = limits
        reference = fine[:, 0]
        error = abs(coarse[:, 0] - reference)
        raw_error = abs(coarse[:, 1] - reference)
        rows.append((error, raw_error, coarse[:, 2]))
    error, raw_error, estimate = np.moveaxis(rows, 1, 0)
    assert ((error <= estimate).mean(axis=0) >= 0.8).all()
    assert ((error <= estimate / 10).mean(axis=0) <= (0.5, 0.5, 0.6)).all()
    conductance = names.index("conductance")
    median = np.median(error[:, conductance])
    assert median < 0.7 * np.median(raw_error[:, conductance])


def with_states(scene, state):
    """Return the solution of a scene by boundary elements with one field only, the
    given states of its points.
    """
    return replace(bem.solve(scene), fields={"state": state})


def test_no_contact_has_no_stiffness_and_full_contact_an_infinite_one():
    """Stiffness (raw, corrected, error) is 0 without contact and infinite in full
    contact, and so is the conductance.
    """
    apart = with_states(STRIPS, np.full(16, APART))
    full = with_states(STRIPS, np.full(16, ELASTIC))
    assert interface_stiffness(STRIPS, apart, "unloading") == (0, 0, 0)
    assert interface_stiffness(STRIPS, full, "loading") == (math.inf, math.inf, 0)
    assert contact_conductance(STRIPS, full, 0.5) == (math.inf, math.inf, 0)


def test_limits_that_are_refused():
    """An unknown branch, a result without states, a negative resistivity and the
    conductance of a layer raise InvalidCase.
    """
    result = bem.solve(STRIPS)
    with pytest.raises(InvalidCase, match="branch is 'up'"):
        interface_stiffness(STRIPS, result, "up")
    without_fields = replace(result, fields={})
    with pytest.raises(InvalidCase, match="no field 'state'"):
        interface_stiffness(STRIPS, without_fields, "loading")
    with pytest.raises(InvalidCase, match="resistivity is -1"):
        contact_conductance(STRIPS, result, -1.0)
    layer = replace(STRIPS, body=Body("sliding_layer", 1.0))
    with pytest.raises(InvalidCase, match="half-spaces, not of a layer"):
        contact_conductance(layer, result, 0.5)


# --- the flat punch -------------------------------------------------------------------


@pytest.mark.parametrize("rows", [[3], [3, 4], [3, 19]], ids=str)
def test_a_punch_of_uniform_pressure_sinks_by_its_compliance(rows):
    """The stiffness of a punch that is whole rows of points is the sum over the modes
    of its uniform pressure.

    `rows` are the indices of rows in contact, which are all alike.
    """
    state = np.full((32, 16), APART)
    state[rows] = ELASTIC
    flat = Surface(np.zeros((32, 16)), (1.0, 1.0))
    scene = Scene(flat, Material(1.0, 0.0), Load(0.01))
    pressure = state[:, 0] / state[:, 0].mean()
    power = np.abs(np.fft.rfft(pressure) / 32) ** 2
    compliance = 1 / (np.pi * np.arange(1, 17))
    sinking = 2 * power[1:16] @ compliance[:15] + power[16] * compliance[15]
    limit = interface_stiffness(scene, with_states(scene, state), "loading")
    assert limit.raw == pytest.approx(1 / sinking, rel=1e-9)


def test_a_punch_on_the_papers_surface_takes_twelve_transform_pairs(monkeypatch):
    """The flat punches of the paper's surface on 256 x 256 points, of elastic and of
    all contact points, take at most 12 pairs of Fourier transforms.

    Their sinking is that of a punch to rounding, and the pressure at the rim, on which
    the limit of the stiffness depends, is right to 1e-5.
    """
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 16e5, rms_slope=1.0)
    period = 2 * math.pi / 2.5e4
    surface = SelfAffine(spectrum, (period, period), (256, 256), seed=7).build()
    scene = Scene(surface, Material(250e9, 0.0, hardness=150e9), Load(12.5e9))
    state = bem.solve(scene, threads=1).fields["state"]
    masks = (state == ELASTIC, state != APART)
    punches = [solve_punch(scene, mask) for mask in masks]
    monkeypatch.setattr(punch, "_TOLERANCE", 1e-12)
    for mask, found in zip(masks, punches, strict=True):
        exact = solve_punch(scene, mask)
        assert found.pairs <= 12 < exact.pairs
        assert found.sinking == pytest.approx(exact.sinking, rel=2e-12)
        difference = np.abs(found.pressure - exact.pressure)
        assert difference.max() < 1e-5 * exact.pressure.max()


def test_a_punch_on_a_large_grid_is_as_exact_as_its_error_estimate_needs(monkeypatch):
    """A punch as on a large grid takes half of the transform pairs, and its sinking is
    right to 1e-5; the limit of the stiffness to a hundredth of its error estimate.

    The rough surface with less than half of its points in contact counts as large here.
    On more than half of the points, the sinking stays exact.
    """
    scene = Scene(ROUGH, Material(1.0, 0.3), Load(0.005))
    result = bem.solve(scene, threads=1)
    masks = [result.fields["state"] != APART, ROUGH.heights > ROUGH.heights.min()]
    exact = [solve_punch(scene, mask) for mask in masks]
    exact_limit = interface_stiffness(scene, result, "unloading")
    monkeypatch.setattr(punch, "_LARGE", 1)
    fast, unchanged = (solve_punch(scene, mask, threads=2) for mask in masks)
    assert fast.pairs < exact[0].pairs / 1.5
    assert 0 < fast.sinking / exact[0].sinking - 1 < 1e-5
    assert unchanged.sinking == exact[1].sinking
    limit = interface_stiffness(scene, result, "unloading")
    difference = limit.corrected - exact_limit.corrected
    assert abs(difference) < exact_limit.error / 100


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 0.003)])
def test_a_punch_around_one_open_point_sinks_as_in_closed_form(body):
    """A punch with one open point sinks by the inverse of the sum of the stiffness of
    all waves.

    The displacement is uniform but at the open point, where it is smaller by the
    inverse of the mean stiffness of the waves. In the layer (`body`) it is near the
    rounding of the transforms.
    """
    flat = Surface(np.zeros((64, 64)), (1.0, 1.0))
    scene = Scene(flat, Material(1.0, 0.3), Load(0.01), body)
    waves = compliance(scene)
    waves.flat[0] = np.inf  # the mean pressure does not bend the surface
    on_both_sides = np.full(waves.shape, 2.0)
    on_both_sides[:, [0, -1]] = 1.0
    mask = np.ones((64, 64), dtype=bool)
    mask[5, 7] = False
    solution = solve_punch(scene, mask)
    expected = 1 / (on_both_sides / waves).sum()
    assert solution.sinking == pytest.approx(expected, rel=1e-9)
    assert solution.pressure[5, 7] == 0
    assert solution.pressure.mean() == pytest.approx(1, rel=1e-14)


def test_a_punch_whose_displacement_stays_uneven_is_an_error(monkeypatch):
    """`solve_punch` raises NotConverged if its displacement is uneven after the last
    correction.
    """
    monkeypatch.setattr(punch, "_MOST_CORRECTIONS", 1)
    scene = Scene(ROUGH, Material(1.0, 0.3), Load(0.005))
    sentence = r"after 1 corrections .* is uneven by .* times the tolerance"
    with pytest.raises(NotConverged, match=sentence):
        solve_punch(scene, ROUGH.heights > 0)


# --- patches and percolation ----------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "areas", "spans"),
    [
        ("x..x .... .... x..x", [4], False),  # one patch over the corner
        ("xxxx .... .... ....", [4], True),
        ("x... xx.. .xx. ..xx", [7], False),
        ("xx.. .xx. ..xx x..x", [8], True),  # winds around both periods once
        ("x.x. .... x.x. ....", [1, 1, 1, 1], False),
        (".... .... .... ....", [], False),
    ],
)
def test_patches_join_over_the_period(rows, areas, spans):
    """Patches join over the sides of points and over the period.

    `rows` is the contact (x) row by row, `areas` are the points of each patch, and
    `spans` tells whether a patch winds around a period.
    """
    mask = np.array([[letter == "x" for letter in row] for row in rows.split()])
    for same in (mask, mask.T, np.roll(mask, (1, 2), (0, 1))):
        patches = find_patches(same)
        np.testing.assert_array_equal(patches.areas * 16, areas)
        assert patches.spans == spans


def test_patches_that_join_over_their_corners_leave_no_way_around_them():
    """Either the contact percolates over sides and corners, or the rest does over
    sides.
    """
    for seed in range(20):
        mask = np.random.default_rng(seed).uniform(size=(6, 8)) < 0.45
        by_corners = find_patches(mask, diagonals=True)
        assert by_corners.spans or find_patches(~mask).spans
        assert by_corners.areas.size <= find_patches(mask).areas.size


def percolates(mask, diagonals):
    """Return whether a contact, repeated 7 x 7 times, has one label at two copies of a
    point.

    `mask` (rows, columns) is true in contact, and with `diagonals` points join over
    their corners, too.
    """
    structure = np.ones((3, 3)) if diagonals else None
    labels, _ = label(np.tile(mask, (7, 7)), structure)
    rows, columns = mask.shape
    copies = labels.reshape(7, rows, 7, columns).swapaxes(1, 2).reshape(49, *mask.shape)
    centre = copies[24]
    same_label = (copies == centre) & mask
    return bool(same_label.sum(axis=0).max() > 1)


@pytest.mark.parametrize("shape", [(6, 8), (7, 5), (2, 9)], ids=str)
@pytest.mark.parametrize("steps", [False, True])
def test_points_percolate_when_labels_of_many_periods_do(shape, steps):
    """Patches span, and the percolation fraction is reached, exactly when scipy's
    labels of 7 x 7 periods say so.

    `shape` is the grid; with `steps` many points have one height and join in the order
    of rows.
    """
    for seed in range(3):
        field = np.random.default_rng(seed).normal(size=shape)
        if steps:
            field = np.round(2 * field)
        order = np.argsort(-field, axis=None, kind="stable")
        first = {}
        for count in range(1, field.size + 1):
            mask = np.zeros(field.size, dtype=bool)
            mask[order[:count]] = True
            mask = mask.reshape(shape)
            for diagonals in (False, True):
                expected = percolates(mask, diagonals)
                assert find_patches(mask, diagonals).spans == expected
                if expected:
                    first.setdefault(diagonals, count)
        limit = percolation_fraction(field)
        assert limit.raw == first[False] / field.size
        mean = sum(first.values()) / 2 / field.size
        assert limit.corrected == pytest.approx(mean, rel=1e-14)


def test_measured_values_are_the_same_on_any_number_of_threads():
    """Stiffness and percolation on two threads have the bits of those on one."""
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness=0.03), Load(0.008))
    result = bem.solve(scene, threads=1)
    for name in ("stiffness_loading", "contact_percolation", "gap_percolation"):
        values = [
            measure_on(SolvedScene(scene, result, threads), f"quantity.{name}")
            for threads in (1, 2)
        ]
        assert values[0] == values[1]


def test_points_that_have_flowed_percolate_in_the_order_of_their_depth():
    """An unloaded contact percolates like an elastic one on its residual surface,
    within two points.
    """
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness=0.03), Load((0.008, 0.001)))
    unloaded = bem.solve(scene, threads=1)
    residual = residual_surface(ROUGH, unloaded)
    elastic = Scene(residual, Material(1.0, 0.3), Load(0.001))
    reloaded = bem.solve(elastic, threads=1)
    for name in ("quantity.contact_percolation", "quantity.gap_percolation"):
        expected = measure(name, elastic, reloaded)
        assert measure(name, scene, unloaded) == pytest.approx(expected, abs=2 / 64**2)
    # Points that are all plastic do not connect in the order of their rows, at 1/64.
    full = replace(scene, load=Load(0.0299))
    result = bem.solve(full, threads=1)
    assert measure("quantity.contact_percolation", full, result) > 0.2


def test_a_line_percolates_when_all_of_it_touches():
    """A line percolates when all of its points touch: (raw, corrected, error) is (1, 1,
    0).
    """
    assert percolation_fraction(np.arange(8.0)) == (1, 1, 0)
    assert not find_patches(np.arange(8) > 0).spans
    assert find_patches(np.arange(8) >= 0).spans


def test_errors_hold_where_one_saddle_decides():
    """At least nine of ten errors of spheres and ground surfaces are within the
    estimates, which are less than a tenth of the area.
    """
    rows = patches.of_kinds(("spheres", "ground"), range(5100, 5104))
    assert (rows["error"] <= rows["estimate"]).mean() >= 0.9
    assert rows["estimate"].median() < 0.03
    assert rows["estimate"].max() < 0.2


def test_the_error_of_percolation_has_three_parts():
    """The error joins sides and corners, every second point, and a grid twice as fine.

    The fine grid has the waves themselves instead of interpolated midpoints; they have
    five points or more on the coarse one.
    """

    def field(points):
        """Return ten waves (points, points) with random phases."""
        random = np.random.default_rng(6)
        x = np.arange(points) / points
        heights = np.zeros((points, points))
        for i, j in itertools.product(range(-6, 7, 3), range(0, 7, 3)):
            amplitude = random.uniform()
            phase = 2 * np.pi * (i * x[:, None] + j * x + random.uniform())
            heights += amplitude * np.cos(phase)
        return heights

    coarse = field(32)
    limit = percolation_fraction(coarse)
    seconds = [
        percolation_fraction(coarse[i::2, j::2]).corrected - limit.corrected
        for i, j in itertools.product((0, 1), repeat=2)
    ]
    grid = math.hypot(limit.raw - limit.corrected, np.std(seconds), np.mean(seconds))
    change = percolation_fraction(field(64)).corrected - limit.corrected
    assert abs(change) > 0.4 * grid
    by_hand = math.hypot(1.5 * grid, 2 * change)
    assert limit.error == pytest.approx(by_hand, rel=0.02)


def test_noise_percolates_at_the_thresholds_of_the_square_lattice():
    """Independent sites that connect over their sides percolate at .5927.

    Over sides and corners they percolate at 1 - .5927; the corrected fraction is the
    mean of both.
    """
    field = np.random.default_rng(4).normal(size=(128, 128))
    for noise in (field, -field):
        limit = percolation_fraction(noise)
        assert limit.raw == pytest.approx(0.5927, abs=0.02)
        assert limit.corrected == pytest.approx(0.5, abs=0.02)
        assert limit.error == pytest.approx(1.5 * 0.0927, abs=0.03)
