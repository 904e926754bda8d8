"""Identities between the parts of a result: an honest one holds them, a wrong one does
not.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fem_scenes import rough_scene

from epcontact import Load, Material, Scene, Surface, bem
from epcontact.errors import InvalidCase
from epcontact.harness.quantities.registry import measure
from epcontact.results import (
    PLASTIC,
    Areas,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)
from epcontact.surfaces import Sinusoid
from fem_check import plain
from fem_check.driver import certify, solve_path

SURFACE = Sinusoid((1.0, 0.75), (16, 12), amplitude=0.01, direction="both").build()
SCENE = Scene(SURFACE, Material(1.0, 0.3, hardness=0.05), Load((0.008, 0.01, 0.012)))
#: Quantities and fields that `test_what_is_wrong_shows` changes in turn.
FIGURES = ("mean_gap", "mean_separation", "elastic_energy", "mean_plastic_displacement")
FIELDS = ("gap", "displacement", "state", "heights")
Wrong = Callable[[ContactResult], ContactResult]


@pytest.fixture(scope="module")
def honest():
    """Return the correct solution of SCENE by boundary elements."""
    return bem.solve(SCENE, threads=1)


def measured(name, result, scene=SCENE):
    """Return the value of the quantity `quantity.<name>` of a result of a scene."""
    return measure(f"quantity.{name}", scene, result)


def with_step(result, number, **changes):
    """Return a result with changed fields of the load step with an index (0 is the
    first).
    """
    steps = list(result.steps)
    steps[number] = replace(steps[number], **changes)
    return replace(result, steps=tuple(steps))


def too_large(name, number=-1):
    """Return a function that multiplies the quantity `name` of a result's load step by
    1.01.

    `number` is the index of the load step.
    """

    def wrong(result):
        """Return the result with the quantity 1 % too large."""
        known = dict(result.steps[number].quantities)
        return with_step(result, number, quantities=known | {name: 1.01 * known[name]})

    return wrong


def shifted(name):
    """Return a function that moves the field `name` of a result by three points along
    x.
    """

    def wrong(result):
        """Return the result with the field moved."""
        field = np.roll(result.fields[name], 3, 0)
        return replace(result, fields={**result.fields, name: field})

    return wrong


def in_reverse_order(result):
    """Return a result whose load steps stand in the reverse order."""
    return replace(result, steps=result.steps[::-1])


def test_an_honest_result_holds_every_identity(honest):
    """A correct result has measured errors at the rounding, and balances below 5 %, the
    error of its histogram and of the trapezoidal rule over three loads.
    """
    for name in ("areas", "fields", "distribution"):
        assert measured(f"measured_{name}", honest) < 1e-12
    # The open gap of an earlier load leaves out what the solver's tolerance lets
    # overlap.
    assert measured("measured_figures", honest) < 1e-8
    assert measured("distribution_balance", honest) < 0.05
    assert abs(measured("path_work", honest)) < 0.05


@pytest.mark.parametrize(
    ("quantity", "wrong", "least"),
    [
        *(("measured_figures", too_large(name), 1e-5) for name in FIGURES),
        *(("measured_fields", shifted(name), 1e-2) for name in FIELDS),
        *(
            ("path_work", too_large("mean_separation", number), 1e-3)
            for number in range(3)
        ),
        ("measured_areas", in_reverse_order, 0.1),
    ],
)
def test_what_is_wrong_shows(honest, quantity, wrong, least):
    """A mistake changes the measured `quantity` by more than `least`.

    `wrong` takes the correct result and returns one with a mistake.
    """
    assert abs(measured(quantity, wrong(honest)) - measured(quantity, honest)) > least


WAVE = np.cos(2 * np.pi * np.arange(16) / 16)
C = 1 / math.pi  # 2 / (E* q), the compliance of the wave
RMS = 0.1 / math.sqrt(2)  # rms height of the wave
WAVY = Scene(Surface(0.1 * WAVE, (1.0,)), Material(1.0, 0.0, 4.0), Load(1.0))
FLAT = {"heights": 0.1 * WAVE, "gap": -0.1 * WAVE, "displacement": 0 * WAVE}


def answer(**fields):
    """Return a made-up result of WAVY with a plastic and an elastic area of 0.5.

    `fields` are its fields, arrays of 16 points.
    """
    figures = {"largest_pressure": 2.0, "mean_gap": 0.1 / math.pi}
    step = LoadStep(1.0, {"raw": Areas(0.5, 0.5, 0.0)}, quantities=figures)
    table = PressureDistribution(np.array([0.0, 1.0]), np.array([0.0, 0.5]))
    return ContactResult("bem", (step,), Provenance("known"), table, fields)


def require(scores, result):
    """Require the values `scores` of the quantities `measured_<name>` of a result of
    WAVY.
    """
    found = {name: measured(f"measured_{name}", result, WAVY) for name in scores}
    assert found == pytest.approx(scores, rel=1e-12)


def test_wrong_answers_get_their_known_scores(honest):
    """Each measured_* quantity of a made-up wrong result has the value that its
    definition gives by hand.
    """
    areas = dict(honest.steps[0].areas) | {"corrected": Areas(0.5, 0.1, 0.1)}
    assert measured(
        "measured_areas", with_step(honest, 0, areas=areas)
    ) == pytest.approx(0.3)
    scores = {"force": 0.02, "bounds": 0.51, "fields": 0.53 * C / RMS, "carried": -0.75}
    require(scores, answer(pressure=1.02 * (1 + 1.5 * WAVE), displacement=C * WAVE))
    scores = {
        "gap": 0.1 / RMS,
        "areas": 0.5,
        "fields": 1.0,
        "figures": 1.0,
        "distribution": 0.5,
    }
    require(scores, answer(pressure=np.ones(16), state=np.full(16, PLASTIC), **FLAT))


def test_sign_of_the_gap_at_the_bounds():
    """measured_gap allows no heights above the flat without pressure, and none below it
    at the hardness.

    A point in the valley of the wave carries the load in the wrong results.
    """
    scene = replace(WAVY, load=Load(1e-5), material=Material(1.0, 0.0))
    crest, valley = (
        answer(pressure=16e-5 * (np.arange(16) == place)) for place in (0, 8)
    )
    assert measured("measured_gap", crest, scene) < 0.1
    # The wave is 2 sqrt(2) rms heights high.
    assert measured("measured_gap", valley, scene) > 2.7
    capped = replace(scene, material=Material(1.0, 0.0, hardness=16e-5))
    assert measured("measured_gap", valley, capped) > 2.7


def test_the_certificate_of_forces_a_hundredth_too_large():
    """The certificate of finite elements finds forces 1 % too large: certified_load is
    0.01, and certified_balance the norm of the error over the force.
    """
    scene = rough_scene(8, 2, dimensions=1)
    path = solve_path(scene, law="elastic", certified=False)
    state = path.points[-1].state
    forces = state.forces
    wrong = replace(state, forces=1.01 * forces)
    law = plain.law_of(scene.material, flows=False)
    nothing = path.history
    found = certify(path.problem, law, wrong, nothing, nothing, float(forces.sum()))
    balance = 0.01 * float(np.linalg.norm(forces) / forces.sum())
    assert found["certified_balance"] == pytest.approx(balance, rel=1e-6)
    assert found["certified_load"] == pytest.approx(0.01, rel=1e-6)


def test_what_cannot_be_measured_is_refused_by_the_name_of_the_quantity(honest):
    """`measure` raises InvalidCase for a result that lacks what a quantity needs."""
    first, second, last = honest.steps
    single = replace(SCENE, load=Load(0.012))
    back = replace(SCENE, load=Load((0.008, 0.01, 0.008)))
    nothing = replace(
        first, areas=dict(first.areas) | {"corrected": Areas(0.0, 0.0, 0.0)}
    )
    parted = replace(honest, steps=(nothing, second, replace(nothing)))
    without = replace(honest, distribution=None, fields={})
    coarse = answer(pressure=np.ones(4))
    for name, scene, wrong, sentence in (
        (
            "path_work",
            single,
            replace(honest, steps=(last,)),
            "three mean pressures or more",
        ),
        (
            "path_work",
            back,
            replace(honest, steps=(first, second, first)),
            "energy that it began",
        ),
        ("cycle_area", back, parted, "quantity.cycle_area: .*no contact before"),
        ("cycle_area", SCENE, honest, "not one that it had before"),
        (
            "measured_areas",
            SCENE,
            replace(honest, steps=(first, second)),
            "2 load steps for 3",
        ),
        ("distribution_balance", SCENE, without, "no pressure distribution"),
        ("measured_force", SCENE, without, "no field 'pressure'"),
        ("measured_force", SCENE, coarse, r"shape \(4,\) on a grid of \(16, 12\)"),
        (
            "measured_residuals",
            SCENE,
            with_step(honest, -1, residuals={}),
            "residual gap_elastic",
        ),
    ):
        with pytest.raises(InvalidCase, match=sentence):
            measured(name, wrong, scene)
