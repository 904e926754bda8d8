"""How large error estimates are: each has a number from a second computation.

The values are invented, so that a part that is left out, doubled or exchanged changes
the number.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from epcontact import Body, Load, Material, Scene, Surface, bem, effective_hardness
from epcontact.bem import driver
from epcontact.harness.methods.registry import METHODS
from epcontact.interface import Limit, percolation, percolation_fraction, rim
from epcontact.materials import hardness_map
from epcontact.output.loads import connection_sentences
from epcontact.planning.pilots import Candidate
from epcontact.reference.layers import compliance
from epcontact.results import Areas, ContactResult, LoadStep, Provenance

PUNCH = rim.MeasuredPunch(
    sinking=2.0,
    release=0.1,
    scatter=0.01,
    straightness=0.25,
    offset=0.3,
    offset_error=0.05,
    stepped=0.5,
    beside_plastic=False,
)
CONSTANTS = rim.Constants(
    intensity=0.9,
    setback=0.1,
    random_error=0.5,
    area_factor=1.7,
    systematic_error=0.02,
)


def test_the_error_of_a_stiffness_has_each_of_its_parts():
    """The error is the root sum of squares of the scatter along the rim, of the area's
    error, of a step and of the fit, over the sinking; straight rims have exact values.
    """
    limit = rim.stiffness_limit(PUNCH, CONSTANTS)
    setback = 0.75 * (0.1 + 0.047 * 0.5) + 0.25 * 0.190009
    intensity = 0.75 * 0.9 + 0.25 * 2 * math.e / math.pi
    corrected = math.exp(intensity * (0.3 + setback) * 0.1 / 2) / 2
    parts = (0.5 * 0.01, 0.1 * 1.7 * 0.05, 0.1 * 0.068 * 0.5, 0.1 * 0.02 * 0.75)
    assert limit.raw == 0.5
    assert limit.corrected == pytest.approx(corrected)
    assert limit.error == pytest.approx(corrected * math.hypot(*parts) / 2)
    assert limit.times(3.0) == Limit(3 * limit.corrected, 1.5, 3 * limit.error)


@pytest.mark.parametrize(("elastic", "corrected", "error"), [(False, 0.03, 0.01)] * 1)
def test_the_offset_of_a_rim_has_the_error_of_the_area(elastic, corrected, error):
    """The correction is that of the total area, with its error; without a stated error
    it is as uncertain as it is large.
    """
    areas = {
        "raw": Areas(0.2, 0.15, 0.05),
        "corrected": Areas(0.23, 0.17, 0.06),
        "error": Areas(0.01, 0.004, 0.007),
    }
    step = LoadStep(1.0, areas)
    result = ContactResult("bem", (step,), Provenance("digest"))
    assert rim._area_correction(result, elastic) == pytest.approx((corrected, error))
    assert rim._area_correction(result, True) == pytest.approx((0.02, 0.004))
    del areas["error"]
    assert rim._area_correction(result, False) == pytest.approx((0.03, 0.03))


def test_the_error_of_a_percolation_fraction_has_its_three_parts(monkeypatch):
    """1.5 times the root sum of squares of half the difference of sides and corners and
    of the scatter of every second point, and twice the change on a finer grid.
    """
    fractions = iter(
        [0.5, 0.40, 0.36, 0.42, 0.38, 0.44, 0.40, 0.46, 0.42, 0.41, 0.39, 0.415, 0.395]
    )

    def next_fraction(*_):
        """Return the next invented fraction, in the order in which they are asked."""
        return next(fractions)

    monkeypatch.setattr(percolation, "_spanning_fraction", next_fraction)
    found = percolation_fraction(np.arange(64.0).reshape(8, 8))
    scatter = math.sqrt((0.02**2 + 0.0 + 0.02**2 + 0.04**2) / 4)
    error = math.hypot(1.5 * 0.01, 1.5 * scatter, 2 * 0.005)
    assert (found.corrected, found.raw) == pytest.approx((0.40, 0.41))
    assert found.error == pytest.approx(error)


def test_the_interval_of_an_effective_hardness_is_that_of_its_inverse():
    """The relative error is that of sigma_Y/hardness, so that the interval reaches
    further up than down; the part of loads below the map is half of the largest fall.
    """
    given = {
        "yield_stress": 1e9,
        "young_modulus": 210e9,
        "poisson_ratio": 0.3,
        "rms_slope": 0.1,
        "breadth": 16,
    }
    found = effective_hardness(**given, mean_pressure=0.25e9)
    error = math.hypot(*found.errors.values())
    assert 0.02 < error < 0.3
    ends = (found.value / (1 + error), found.value / (1 - error))
    assert found.interval == pytest.approx(ends)
    assert "light_error" not in found.errors
    lightest = hardness_map.hardness_map()["load"].min()
    light = effective_hardness(**given, mean_pressure=0.4 * lightest * 1e9)
    half = 0.07 * math.log(1 / 0.4) / 2
    assert light.errors["light_error"] == pytest.approx(half / (1 - half))


@pytest.mark.parametrize("load", [0.05, 0.2])
@pytest.mark.parametrize("breadth", [None, 16.0, 64.0])
def test_the_error_of_a_breadth_has_its_four_parts(breadth, load):
    """Half of the correction, all that is beyond a breadth of 32, 3 % by other spectra,
    and half of the range if the breadth is not known.
    """
    slope = 0.04 * 24 / (8 + 24)
    low, high = (2.0, 300.0) if breadth is None else (breadth, breadth)
    size = 0.003 / max(load, 0.1)
    ends = (slope * math.log(low / 4), slope * math.log(high / 4))
    trend = sum(ends) / 2
    parts = (
        (abs(trend) + size) / 2,
        slope * math.log(max(high / 32, 1.0)),
        0.03,
        (ends[1] - ends[0]) / 2,
    )
    found = hardness_map.breadth_correction(breadth, 24.0, load)
    assert found == pytest.approx((trend + size, math.hypot(*parts)))


def test_the_error_of_a_gap_is_that_of_the_coarser_direction():
    """The error of a mean gap is 0.28 times slope, largest spacing and the fraction by
    which the area is corrected, with its error.
    """
    heights = 1e-6 * np.random.default_rng(3).normal(size=(16, 20))
    surface = Surface(heights, (1e-3, 1e-3), sampled=False)
    scene = Scene(surface, Material(1e11, 0.3), Load(5e8))
    final = bem.solve(scene).final
    raw, corrected = final.areas["raw"].total, final.areas["corrected"].total
    moved = (abs(raw - corrected) + final.areas["error"].total) / raw
    expected = 0.28 * moved * scene.surface.rms_slope * 1e-3 / 16
    assert final.quantities["mean_gap_error_by_grid"] == pytest.approx(expected)


def test_a_layer_adds_twice_its_stiffening_to_the_error_of_areas():
    """On a layer the correction is uncertain by twice the fraction by which the layer
    is stiffer than a half-space against waves of two spacings.
    """
    heights = 1e-6 * np.random.default_rng(3).normal(size=(16, 20))
    surface = Surface(heights, (1e-3, 1e-3))
    material = Material(1e11, 0.3)
    body = Body("bonded_layer", 3e-5)
    scene = Scene(surface, material, Load(5e8), body)
    raw = Areas(0.2, 0.15, 0.05)
    corrected = Areas(0.17, 0.13, 0.04)
    error = Areas(0.01, 0.004, 0.007)
    found = driver._error_on_layers(scene, raw, corrected, error)
    wavenumber = math.pi / (1e-3 / 16)
    modulus = 1e11 / (1 - 0.3**2)
    of_layer = float(compliance(scene)[8, 0])  # two of the coarser spacings
    stiffer = 1 - of_layer / (2 / (modulus * wavenumber))
    assert abs(stiffer) > 0.001
    expected = [
        math.hypot(0.01, 2 * stiffer * 0.03),
        math.hypot(0.004, 2 * stiffer * 0.02),
        math.hypot(0.007, 2 * stiffer * 0.01),
    ]
    assert [found.total, found.elastic, found.plastic] == pytest.approx(expected)


@pytest.mark.parametrize(("area", "answer"), [(0.43, "undecided"), (0.44, "yes")])
def test_a_connection_is_undecided_within_both_errors(area, answer):
    """An area that exceeds the fraction that connects by less than the root sum of
    squares of the errors of both, 0.01 and 0.03, does not decide.
    """
    step = LoadStep(
        1e6,
        {
            "corrected": Areas(area, area, 0.0),
            "error": Areas(0.03 / 1.19, 0.0, 0.0),
        },
        quantities={
            "contact_percolation": 0.40,
            "contact_percolation.error": 0.01 / 1.19,
        },
    )
    result = ContactResult("bem", (step,), Provenance("digest"))
    (sentence,) = connection_sentences([result])
    assert f"connects across the surface: {answer}" in sentence
    assert "0.4 ± 0.01" in sentence


def test_a_plan_joins_the_errors_of_grid_and_scatter_in_quadrature():
    """The error of a candidate is the root sum of squares of both parts."""
    assert Candidate((8, 8), 2, 0.03, 0.04, 1.0).error == pytest.approx(0.05)


def test_the_methods_of_users_are_not_taken_from_saved_results():
    """The code of a user's solver is not known, so that none of its results is used
    again; those of the package and of a program are.
    """
    assert METHODS["bem"].code_digest == ""
    mine = replace(METHODS["bem"], name="mine", source="mine:solve")
    assert mine.code_digest is None
