"""The map of the theory's error: its places, its intervals and its refusals."""

import math

import numpy as np
import pandas as pd
import pytest
from laboratory.theory_map import judged, random_scene

from epcontact import SelfAffineSpectrum
from epcontact.errors import InvalidScene
from epcontact.persson import EnergyReduction, Theory, analytic_roughness, validity
from epcontact.persson.near_bounds import CONSTANTS

LOWEST = 1e4
MODULUS = 100e9


def spectrum(hurst=0.8, wide=64.0, roll_off=4.0):
    """Return a spectrum with rms slope 0.1; `wide` and `roll_off` are over the lowest
    wave number.
    """
    return SelfAffineSpectrum(hurst, LOWEST, roll_off * LOWEST, wide * LOWEST, 0.1)


def theory(hardness=0.6, gamma=validity.GAMMA, rule="constant", **of_spectrum):
    """Return the theory of a body whose hardness is given over E* xi, the product of
    modulus and rms slope.

    `gamma` is the energy reduction, `rule` its kind, and `of_spectrum` the options of
    `spectrum`.
    """
    rough = analytic_roughness(spectrum(**of_spectrum))
    return Theory(
        rough, MODULUS, EnergyReduction(gamma, rule), hardness * 0.1 * MODULUS
    )


def expected(hardness=0.6, load=0.05, surfaces=1, **more):
    """Return the expected errors by the name of the area or gap, at a load over E* xi
    on a number of surfaces.

    `more` holds the options of `theory`.
    """
    return validity.expected_errors(
        theory(hardness, **more), load * 0.1 * MODULUS, surfaces
    )


def test_at_its_places_the_map_has_the_errors_that_were_measured():
    """The intervals of eight surfaces hold 90 to 99.9 % of the errors that were
    measured at the map's places.
    """
    held = []
    for place in pd.DataFrame(validity.theory_map()).to_dict("records"):
        hardness = place["hardness"]
        load = place["load"]
        if math.isfinite(hardness):
            load *= hardness  # of bodies with a hardness, the load is over it
        shape = {name: place[name] for name in ("hurst", "roll_off")}
        found = expected(hardness, load, 8, wide=place["wavelength_ratio"], **shape)
        for name in found.keys() & {"total", "elastic", "plastic", "mean_gap"}:
            error = found[name]
            measured = place[f"{name}_theory"]
            if not math.isnan(measured):
                held.append(error.low - 1e-3 <= measured <= error.high + 1e-3)
    assert len(held) > 2000
    assert 0.9 < np.mean(held) < 0.999


def test_intervals_hold_the_errors_on_other_surfaces_spectra_and_places():
    """Spectra, surfaces and places at random, on which no constant of the map was
    chosen.
    """
    held = [
        row["held"]
        for k in range(1000, 1024)
        for row in judged(random_scene(k, (16, 32)))
    ]
    assert len(held) > 60
    assert np.mean(held) > 0.85


def test_more_surfaces_and_larger_ones_scatter_less():
    """The interval of the error is narrower for eight surfaces than for one, and for a
    surface with several longest waves, but its middle stays.
    """

    def width(error):
        """Return the width of the interval of an expected error."""
        return error.high - error.low

    one_surface, eight_surfaces = (expected(surfaces=n)["total"] for n in (1, 8))
    assert width(eight_surfaces) < 0.7 * width(one_surface)
    assert eight_surfaces.middle == one_surface.middle
    wave_by_wave = expected(wide=16.0, roll_off=1.0)["total"]
    assert width(expected(wide=64.0, roll_off=4.0)["total"]) < 0.8 * width(wave_by_wave)


def test_a_body_harder_than_the_map_is_elastic_under_light_loads():
    """A hardness beyond the map gives the errors of an elastic body, without a plastic
    area; heavy loads are refused.
    """
    hard = expected(10.0, 0.1)
    elastic = expected(math.inf, 0.1)
    assert hard["total"] == pytest.approx(elastic["total"], abs=2e-3)
    hard = expected(2.0, 0.5, gamma=CONSTANTS[0], rule="near_bounds")
    assert ("total" in hard, "plastic" in hard) == (True, False)
    with pytest.raises(InvalidScene, match=r"ξ\) is 10, but .* from 0\.0599 to 3"):
        expected(10.0, 5.0)


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ({"gamma": 0.45}, "a constant gamma of 0.536"),
        ({"gamma": 0.5, "rule": "near_bounds"}, "0.385 with the rule 'near_bounds'"),
        ({"gamma": 0.536, "rule": "xu"}, "a constant gamma of 0.536"),
        ({"hardness": 0.03, "load": 0.01}, "ξ. is 0.03"),
        ({"load": 1e-4}, "p0/hardness is 0.000167"),
        ({"hardness": math.inf, "load": 2.0}, "ξ. is 2"),
        ({"wide": 4.0}, "Nayak's parameter is 1.2"),
        ({"hurst": 0.1, "wide": 512.0}, "waves along a side is 2"),
    ],
)
def test_outside_the_map_nothing_is_claimed(scene, said):
    """A scene that the map does not cover raises InvalidScene; `scene` holds the
    options of `expected`, `said` a part of the message.
    """
    with pytest.raises(InvalidScene, match=said):
        expected(**scene)


@pytest.mark.parametrize(
    ("hardness", "load", "wide", "known"),
    [
        (0.18, 0.09, 64.0, True),
        (
            0.18,
            0.09,
            256.0,
            False,
        ),  # wider than any with roll-off that the map has so soft
        (0.6, 0.09, 256.0, True),
        (3.0, 2.7, 64.0, False),  # a closed gap is of round-off
    ],
)
def test_a_gap_is_told_only_where_the_map_has_one_of_its_kind(
    hardness, load, wide, known
):
    """The error of the mean gap is reported only if the map has a gap for such a scene;
    `known` says whether.

    `hardness` is over E* xi, `load` over E* xi, and `wide` the ratio of the longest to
    the shortest wavelength.
    """
    found = expected(hardness, load, wide=wide)
    assert ("mean_gap" in found) is known
    assert "total" in found
    note = validity.expectation(theory(hardness, wide=wide), load * 0.1 * MODULUS)
    assert note.endswith("elements)" if known else "; not resolved: gap")


def test_where_nothing_flows_total_and_elastic_area_are_off_alike():
    """Without flow the intervals of the total and the elastic area's error overlap,
    which those of the map's last two hardnesses would not.
    """
    found = expected(2.3, 0.2 * 2.3, wide=256.0)
    assert found["total"].low < found["elastic"].high
    assert found["elastic"].low < found["total"].high
