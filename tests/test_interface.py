"""Stiffness, conductance and patches of an interface under load."""

import math
from dataclasses import replace

import numpy as np
import pytest
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
from epcontact.harness.quantities.registry import measure, measure_all
from epcontact.interface import (
    contact_conductance,
    find_patches,
    interface_stiffness,
    percolation_fraction,
    punch,
)
from epcontact.interface.punch import solve_punch
from epcontact.reference.posts import CAPPED_STRIP
from epcontact.results import APART, ELASTIC
from epcontact.surfaces import SelfAffine, residual_surface

STRIPS = Scene(
    Surface(-0.001 * (np.arange(16) > 7), (1.0,)), Material(1.0, 0.0), Load(0.01)
)
SPECTRUM = SelfAffineSpectrum(
    0.8, 2 * math.pi, 8 * math.pi, 32 * math.pi, rms_slope=0.1
)
ROUGH = SelfAffine(SPECTRUM, (1.0, 1.0), (64, 64), seed=31).build()


@pytest.mark.parametrize(
    "body", [Body(), Body("bonded_layer", 0.2)], ids=lambda b: b.kind
)
def test_the_stiffness_is_the_derivative_of_the_load_on_both_branches(body):
    """Finite differences over load changes that move no front are exact to 1e-6."""
    p, change = 0.005, 2e-6
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness=0.06), Load(p), body)

    def separation(*path):
        found = bem.solve(replace(scene, load=Load(path)), tolerance=1e-13)
        return found.final.quantities["mean_separation"]

    at, here = bem.solve(scene, tolerance=1e-13), separation(p)
    loading, unloading = (
        interface_stiffness(scene, at, b).raw for b in ("loading", "unloading")
    )
    up, down = separation(p * (1 + change)), separation(p, p * (1 - change))
    assert loading == pytest.approx(change * p / (here - up), rel=1e-6)
    assert unloading == pytest.approx(change * p / (down - here), rel=1e-6)
    assert unloading > 1.02 * loading


@pytest.mark.parametrize("hardness", [0.02, math.inf])
def test_a_contact_conducts_as_an_elastic_punch_of_its_shape_sinks(hardness):
    """Plastic spots conduct, too: the punch is solved as a contact, and its energy is
    p0 u/2.
    """
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness), Load(0.005))
    found = bem.solve(scene)
    flat = np.where(found.fields["state"] != APART, 0.0, -1e-3)
    punch = Scene(Surface(flat, (1.0, 1.0)), Material(1.0, 0.3), Load(1e-5))
    solved = bem.solve(punch, tolerance=1e-12)
    assert solved.final.areas["raw"].total == found.final.areas["raw"].total
    sinking = 2 * solved.final.quantities["elastic_energy"] / 1e-5
    expected = 2 * 1e-5 / sinking * (1 - 0.3**2) / 0.7  # 2 k/(E* rho)
    assert contact_conductance(scene, found, 0.7).raw == pytest.approx(
        expected, rel=1e-8
    )


@pytest.mark.parametrize("turned", [False, True])
def test_a_straight_rim_is_corrected_to_the_second_order(turned):
    """On cells of any shape; what is left is .6 (dx over the strip's width)^2."""
    off = []
    for n in (32, 128, 512):
        heights = np.repeat(
            np.where(np.arange(n) < 0.6 * n, 0.0, -1e-3)[:, None], n // 2, 1
        )
        surface = Surface(heights.T if turned else heights, (1.0, 1.0))
        scene = Scene(surface, Material(1.0, 0.0), Load(1e-5))
        exact = -math.pi / 2 / math.log(math.sin(math.pi / 2 * (heights == 0).mean()))
        found = interface_stiffness(scene, bem.solve(scene, threads=1), "loading")
        off.append((found.raw / exact - 1, found.corrected / exact - 1))
    raw, corrected = np.abs(off).T
    np.testing.assert_allclose(np.log2(raw[:-1] / raw[1:]) / 2, 1, atol=0.05)
    np.testing.assert_allclose(np.log2(corrected[:-1] / corrected[1:]) / 2, 2, atol=0.1)
    assert corrected[-1] < 3e-5
    assert raw[-1] > 1e-3


def test_the_elastic_middle_of_a_capped_strip_is_corrected():
    """Where the plastic rim ends is known to a fraction of a point, as is the strip's
    own end.
    """
    off = []
    for half_width in (0.21, 0.25, 0.29, 0.33):
        heights = np.where(
            np.abs(np.arange(2048) / 2048 - 0.5) < half_width, 0.0, -5e-3
        )
        scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0, 1e-3), Load(3e-4))
        found = bem.solve(scene)
        for branch in ("loading", "unloading"):
            exact = CAPPED_STRIP.scalar(f"quantity.stiffness_{branch}", scene)
            off.append(
                np.array(interface_stiffness(scene, found, branch)) / exact - (1, 1, 0)
            )
    corrected, raw, claimed = np.abs(off).T
    assert np.abs(corrected).max() < 0.4 * raw.max()
    assert (corrected < claimed).all()


def test_limits_know_no_units_and_no_axes():
    heights, hard = ROUGH.heights[:, ::2], Material(1.0, 0.3, hardness=0.06)
    scene = Scene(Surface(heights, (1.0, 1.0)), hard, Load(0.005))
    scaled = Material(2.0e11, 0.3, hardness=0.06 * 2.0e11)
    others = {
        2e11 / 3e-4: Scene(Surface(3e-4 * heights, (3e-4, 3e-4)), scaled, Load(1e9)),
        1: Scene(Surface(heights.T, (1.0, 1.0)), hard, Load(0.005)),
    }
    for branch in ("loading", "unloading"):
        here = np.array(interface_stiffness(scene, bem.solve(scene), branch))
        for factor, other in others.items():
            there = interface_stiffness(other, bem.solve(other), branch)
            np.testing.assert_allclose(there, factor * here, rtol=1e-6)


def test_claims_cover_the_errors_of_limits():
    """At four points a shortest wave, on seeds that no constant has seen; a tenth would
    not.
    """
    rows = []
    for seed in range(500, 512):
        hardness = (0.02, 0.05, math.inf)[seed % 3]
        results = []
        for n in (48, 192):
            surface = SelfAffine(
                replace(SPECTRUM, wavenumber_high=24 * math.pi),
                (1.0, 1.0),
                (n, n),
                seed,
            )
            scene = Scene(surface.build(), Material(1.0, 0.3, hardness), Load(0.004))
            result = bem.solve(scene, threads=1)
            names = ("conductance", "stiffness_loading", "contact_percolation")
            kinds = [
                f"quantity.{name}{kind}"
                for name in names
                for kind in ("", ".raw", ".error")
            ]
            results.append(measure_all(kinds, scene, result))
        coarse, fine = (np.array([*each.values()]).reshape(3, 3) for each in results)
        rows.append(
            np.column_stack([abs(coarse[:, :2].T - fine[:, 0]).T, coarse[:, 2]])
        )
    error, raw, claimed = np.array(rows).transpose(2, 1, 0)
    assert ((error <= claimed).mean(1) >= 0.8).all()
    assert ((error <= claimed / 10).mean(1) <= 0.5).all()
    assert np.median(error[0]) < 0.7 * np.median(raw[0])


def test_what_can_carry_nothing_or_everything_and_what_is_refused():
    apart, full = (
        replace(bem.solve(STRIPS), fields={"state": np.full(16, state)})
        for state in (APART, ELASTIC)
    )
    assert interface_stiffness(STRIPS, apart, "unloading") == (0, 0, 0)
    assert interface_stiffness(STRIPS, full, "loading") == (math.inf, math.inf, 0)
    assert contact_conductance(STRIPS, full, 0.5) == (math.inf, math.inf, 0)
    layer = replace(STRIPS, body=Body("sliding_layer", 1.0))
    for function, arguments, sentence in (
        (interface_stiffness, (STRIPS, full, "up"), "branch is 'up'"),
        (
            interface_stiffness,
            (STRIPS, replace(full, fields={}), "loading"),
            "no field 'state'",
        ),
        (contact_conductance, (STRIPS, full, -1.0), "resistivity is -1"),
        (contact_conductance, (layer, full, 0.5), "half-spaces, not of a layer"),
    ):
        with pytest.raises(InvalidCase, match=sentence):
            function(*arguments)


@pytest.mark.parametrize("touching", [[3], [3, 4], [3, 19]], ids=str)
def test_a_punch_of_uniform_pressure_sinks_by_its_compliance(touching):
    """Rows of points that are all alike need no other pressure, and no iteration."""
    state = np.full((32, 16), APART)
    state[touching] = ELASTIC
    scene = Scene(
        Surface(np.zeros((32, 16)), (1.0, 1.0)), Material(1.0, 0.0), Load(0.01)
    )
    found = replace(bem.solve(scene), fields={"state": state})
    modes = np.abs(np.fft.rfft(state[:, 0] / state[:, 0].mean()) / 32) ** 2
    sinking = 2 * modes[1:-1] @ (1 / (np.pi * np.arange(1, 16))) + modes[16] / (
        np.pi * 16
    )
    assert interface_stiffness(scene, found, "loading").raw == pytest.approx(
        1 / sinking, rel=1e-9
    )


def test_a_punch_on_the_papers_surface_takes_twenty_transform_pairs():
    """Every state of a rough contact: its elastic points, and all of its points."""
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 16e5, rms_slope=1.0)
    surface = SelfAffine(spectrum, (2 * math.pi / 2.5e4,) * 2, (256, 256), 7).build()
    scene = Scene(surface, Material(250e9, 0.0, hardness=150e9), Load(12.5e9))
    state = bem.solve(scene, threads=1).fields["state"]
    for mask in (state == ELASTIC, state != APART):
        assert solve_punch(scene, mask).pairs <= 21


def test_a_punch_whose_displacement_stays_uneven_is_an_error(monkeypatch):
    mask = ROUGH.heights > 0
    scene = Scene(ROUGH, Material(1.0, 0.3), Load(0.005))
    monkeypatch.setattr(punch, "_MOST_CORRECTIONS", 1)
    sentence = r"after 1 corrections .* is uneven by .* times the tolerance"
    with pytest.raises(NotConverged, match=sentence):
        solve_punch(scene, mask)


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
    mask = np.array([[c == "x" for c in row] for row in rows.split()])
    for turned in (mask, mask.T, np.roll(mask, (1, 2), (0, 1))):
        found = find_patches(turned)
        np.testing.assert_array_equal(found.areas * 16, areas)
        assert found.spans == spans


def test_patches_that_join_over_their_corners_leave_no_way_around_them():
    """What joins over sides and corners percolates where the rest, over its sides, does
    not.
    """
    for seed in range(20):
        mask = np.random.default_rng(seed).uniform(size=(6, 8)) < 0.45
        apart = find_patches(~mask)
        assert find_patches(mask, diagonals=True).spans or apart.spans
        assert (
            find_patches(mask, diagonals=True).areas.size
            <= find_patches(mask).areas.size
        )


def test_what_has_flowed_percolates_in_the_order_of_its_depth():
    """An unloaded contact percolates like the elastic one on the surface that it has
    left.
    """
    scene = Scene(ROUGH, Material(1.0, 0.3, hardness=0.03), Load((0.008, 0.001)))
    unloaded = bem.solve(scene, threads=1)
    elastic = Scene(residual_surface(ROUGH, unloaded), Material(1.0, 0.3), Load(0.001))
    for name in ("quantity.contact_percolation", "quantity.gap_percolation"):
        expected = measure(name, elastic, bem.solve(elastic, threads=1))
        assert measure(name, scene, unloaded) == pytest.approx(expected, abs=2 / 64**2)
    # In the order of their rows, all of which flow, points would connect at 1/64.
    full = replace(scene, load=Load(0.0299))
    assert (
        measure("quantity.contact_percolation", full, bem.solve(full, threads=1)) > 0.2
    )


def percolates(mask, diagonals):
    """Whether a patch holds two copies of a point, by scipy's labels of 7 x 7 periods."""
    structure = np.ones((3, 3)) if diagonals else None
    labels = label(np.tile(mask, (7, 7)), structure)[0]
    rows, columns = mask.shape
    copies = labels.reshape(7, rows, 7, columns).swapaxes(1, 2).reshape(49, *mask.shape)
    centre = copies[24]
    return bool(((copies == centre) & mask).sum(axis=0).max() > 1)


@pytest.mark.parametrize("shape", [(6, 8), (7, 5), (2, 9), (12, 12)], ids=str)
def test_points_percolate_one_by_one_as_labels_of_many_periods_tell(shape):
    """On noise and on steps, whose points of one height join in the order of rows."""
    for seed in range(6):
        field = np.random.default_rng(seed).normal(size=shape)
        if seed % 2:
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


def test_percolation_shares_of_a_line_and_of_noise():
    """On independent sites of a square lattice joined over their sides the threshold is
    .5927, and over their corners as well it is 1 - .5927, so that no limit is nearer
    than .5 is to both.
    """
    line = np.arange(8.0)  # connects only if all of it touches
    assert percolation_fraction(line) == (1, 1, 0)
    assert not find_patches(np.arange(8) > 0).spans
    field = np.random.default_rng(4).normal(size=(128, 128))
    for one in map(percolation_fraction, (field, -field)):
        assert one.raw == pytest.approx(0.5927, abs=0.02)
        assert one.corrected == pytest.approx(0.5, abs=0.02)
        assert one.error == pytest.approx(0.0927, abs=0.03)
