"""Every quantity has a value that is known: by a gate of a case, or by a scene here or
elsewhere.

Posts: three unequal ones stand out of a surface so rough that no more touches; the
highest is capped.  Strain: a flat layer hardens under uniaxial strain and is unloaded
(closed form).  Order: a made-up contact after unloading, of which the order of the
points is known.  Counts: parts of a sum.
"""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

import fem_check
from epcontact import (
    Body,
    Load,
    Material,
    Scene,
    SelfAffineSpectrum,
    Surface,
    bem,
    persson,
)
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES, measure, scalar_quantities
from epcontact.harness.solving.load_path import with_hardness_error
from epcontact.harness.verdict.compare import RELEASE_VALUES, read_values
from epcontact.materials.hardness_map import effective_hardness
from epcontact.results import CONDUCTING, Areas, ContactResult, LoadStep, Provenance
from epcontact.surfaces import SelfAffine

METAL = Material(210e9, 0.3, hardness=3e9, yield_stress=1e9)
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")


@functools.cache
def posts():
    """Return a scene of three flat posts of two heights, and its result by BEM."""
    heights = np.full((24, 20), -50e-6)
    heights[2:4, 3:6] = 3e-6
    heights[8:12, 10:14] = 0.0
    heights[16:21, 2:5] = 0.0
    scene = Scene(Surface(heights, (1.2e-3, 0.8e-3)), METAL, Load(60e6))
    return scene, bem.solve(scene, threads=1)


@functools.cache
def strain():
    """Return a level layer on a load path, and its result by J2 finite elements."""
    surface = Surface(1e-12 * np.cos(np.arange(6) * np.pi / 3), (1e-3,))
    metal = Material(210e9, 0.3, yield_stress=1e9, hardening_modulus=40e9)
    load = Load((0.5e9, 3.0e9, 1.0e9))
    scene = Scene(surface, metal, load, Body("bonded_layer", 2e-3))
    return scene, fem_check.solve(scene, law="j2", layers=3)


def hardened(peak=3e9, left=1e9, depth=2e-3, H=40e9):
    """Return the exact quantities of a flat layer that hardens under uniaxial strain
    and is unloaded.

    Args:
        peak: largest mean pressure in Pa.
        left: last mean pressure in Pa.
        depth: thickness of the layer in m.
        H: hardening modulus in Pa.

    With strain e and plastic strain a: 2 mu (e - 3a/2) = q = Y + H a and p = K e + 2q/3
    up to the peak; the unloading is elastic.
    """
    E = METAL.young_modulus
    nu = METAL.poisson_ratio
    Y = METAL.yield_stress
    mu = E / 2 / (1 + nu)
    K = E / 3 / (1 - 2 * nu)
    share = H / (3 * mu + H)
    e = (peak - 2 / 3 * Y * (1 - share)) / (K + 4 / 3 * mu * share)
    a = (2 * mu * e - Y) / (3 * mu + H)
    e -= (peak - left) / (K + 4 / 3 * mu)
    q = 2 * mu * (e - 1.5 * a)
    energy = (left - 2 / 3 * q) ** 2 / (2 * K) + q**2 / (6 * mu)
    return {
        "quantity.approach": e * depth,
        "quantity.largest_plastic_strain": a,
        "quantity.plastic_work": (Y * a + H * a**2 / 2) * depth,
        "quantity.stored_energy": energy * depth,
        "quantity.elastic_energy": energy * depth,
        "quantity.plastic_volume": 1.0,
        "quantity.plastic_depth": depth,
        "quantity.stiffness_loading": math.nan,  # that of a cap would be 0
    }


@functools.cache
def order():
    """Return an invented contact after unloading, whose order of contact is known.

    Of the 6 x 4 points column 1 is closest, though row 2 was closer before it flowed;
    column 2 has the widest gap.
    """
    gap = np.full((6, 4), 5.0)
    sunk = np.zeros((6, 4))
    gap[:, 1] = 1.0
    gap[:, 2] = 8.0
    gap[2, :] = (0.5, 0.4, 8.0, 0.5)
    sunk[2, :] = (3.0, 0.6, 0.0, 3.0)
    scene = Scene(Surface(np.eye(6, 4), (1.0, 1.0)), METAL, Load((2e6, 1e6)))
    step = LoadStep(1e6, {"raw": Areas(0.0, 0.0, 0.0)})
    fields = {"pressure": np.zeros((6, 4)), "gap": gap, "plastic_displacement": sunk}
    return scene, ContactResult("bem", (step,), Provenance("x"), fields=fields)


@functools.cache
def theory():
    """Return a rough scene and its result by the theory."""
    spectrum = SelfAffineSpectrum(0.7, 2e4, 4e4, 8e4, rms_slope=0.07)
    surface = SelfAffine(spectrum, (1e-3, 1e-3), (32, 32), seed=1).build()
    scene = Scene(surface, METAL, Load(1e8))
    return scene, persson.solve(scene, energy_reduction=0.41)


METALLIC = effective_hardness(
    yield_stress=1e9,
    mean_pressure=0.25e9,
    young_modulus=210e9,
    poisson_ratio=0.3,
    rms_slope=0.1,
)


@functools.cache
def by_hardness():
    """Return a scene and a result whose errors are half of the difference between
    results at both ends of the interval of an effective hardness.

    Total and plastic areas are fractions; mean gaps are in m.
    """
    step, soft, hard = (
        LoadStep(2.5e8, {"corrected": Areas(t, t - p, p)}, quantities={"mean_gap": g})
        for t, p, g in ((0.12, 0.05, 3e-6), (0.14, 0.08, 2.6e-6), (0.1, 0.03, 3.5e-6))
    )
    final = with_hardness_error(step, soft, hard, METALLIC)
    return posts()[0], ContactResult("bem", (final,), Provenance("x"))


POSTS = {
    "area.total.raw": 37 / 480,
    "area.plastic.raw": 6 / 480,
    "area.elastic.raw": 31 / 480,
    "quantity.total_patches": 3,
    "quantity.total_patches_largest": 16 / 480,
    "quantity.elastic_patches": 2,
    "quantity.elastic_patches_largest": 16 / 480,
    "quantity.plastic_patches": 1,
    "quantity.plastic_patches_largest": 6 / 480,
    "quantity.surface_curvature": 26.5e-6 * (50e-6**-2 + 40e-6**-2),
    "quantity.largest_pressure": 3e9,
    "mean_pressure": 60e6,
    "cost.unknowns": 480,
    # What is no area of the posts' own has no front at which an area could be wrong by
    # more.
    "quantity.measured_raw_total": 0.0,
    "quantity.measured_raw_plastic": 0.0,
}
ORDER = {"quantity.contact_percolation": 0.25, "quantity.gap_percolation": 0.25}
BY_HARDNESS = {
    "area.total.hardness_error": 0.02,
    "area.plastic.hardness_error": 0.025,
    "area.elastic.hardness_error": 0.005,
    "quantity.mean_gap_error_by_hardness": 0.45e-6,
    "quantity.hardness_error_by_map": METALLIC.value
    * (METALLIC.value / METALLIC.interval[0] - 1),
}
CASES = [
    (posts, POSTS),
    (by_hardness, BY_HARDNESS),
    (strain, hardened()),
    (order, ORDER),
    (theory, {"quantity.energy_reduction": 0.41, "quantity.rms_slope": 0.07}),
]


@pytest.mark.parametrize(
    ("made", "name", "value"),
    [(m, name, v) for m, known in CASES for name, v in known.items()],
)
def test_value(made, name, value):
    """A quantity (`name`) of a scene has its known value, in SI units; `made` returns
    the scene and its result.
    """
    scene, found = made()
    result = scalar_quantities(found).get(name)
    if result is None:
        result = measure(name, scene, found)
    assert result == pytest.approx(value, rel=2e-6, abs=1e-12, nan_ok=True)


SUMS = {
    "bem": {"fft_pairs": "fft_pairs", "equivalent_fft_pairs": "equivalent_fft_pairs"},
    "fem": {
        "newton_steps": "newton",
        "cg_iterations": "cg",
        "contact_sweeps": "contact_sweeps",
        "increments": "increments",
    },
}


def test_counts_are_those_of_the_steps_and_residuals_those_of_the_tolerance():
    """Costs are sums over the load steps, and residuals are below the tolerance.

    The estimated errors of the areas cover the areas of the posts, and the residual of
    a loose solve is the largest gap under a touching point over the rms height.
    """
    _, of_posts = posts()
    _, flow = strain()
    rough = 1e-7 * np.random.default_rng(5).normal(size=(8, 6))
    scene = Scene(Surface(rough, (1e-3, 0.6e-3)), METAL, Load(2e8))
    path = bem.solve(replace(scene, load=Load((2e8, 4e8, 1e8))), threads=1)
    for part in ("total", "elastic", "plastic"):
        corrected = getattr(of_posts.final.areas["corrected"], part)
        error = getattr(of_posts.final.areas["error"], part)
        # 0.018 of the nominal area is the largest error that may be estimated here.
        assert 0 < abs(corrected - POSTS[f"area.{part}.raw"]) <= error < 0.018
    for found in (of_posts, flow, path):
        for cost, step in SUMS[found.method].items():
            total = sum(load.iterations[step] for load in found.steps)
            assert found.cost[cost] == total > 0
        assert 0 < found.cost["seconds"] < 600
        assert found.final.iterations["newton"] >= 1
        assert found.final.iterations["cg"] >= found.final.iterations["newton"]
        assert 0 <= max(found.final.residuals.values()) <= 1e-8
    assert (
        of_posts.final.iterations["levels"],
        of_posts.final.iterations["gradient"],
    ) >= (1, 0)
    assert flow.cost["most_newton_steps"] <= flow.cost["newton_steps"]
    assert flow.cost["unknowns"] == 3 * 6 * 3
    assert (
        0 <= flow.final.iterations["line_searches"] <= flow.final.iterations["newton"]
    )
    loose = bem.solve(scene, tolerance=0.1, threads=1)
    gap = loose.fields["gap"] / rough.std()
    touching = loose.fields["state"] == 1
    largest = np.abs(gap[touching]).max(initial=0)
    assert loose.final.residuals["gap_elastic"] == pytest.approx(largest, rel=1e-9)


def test_no_quantity_is_without_a_value():
    """Every quantity of the registry is compared with a known value somewhere: by a
    gate of a case, in this file or in a test that is named here.

    A gate of one method against another does not count, because it proves only that
    both agree.
    """
    gates = [
        name.split(" ")
        for name in read_values(RELEASE_VALUES).dropna(subset="low")["name"].unique()
    ]
    tested = {quantity for quantity, *_, against, _ in gates if against not in METHODS}
    tested |= {name for _, values in CASES for name in values}
    for found in (posts()[1], strain()[1]):  # judged by their sums and their tolerance
        counted = ("residual.", "iterations.", "cost.")
        tested |= {
            name for name in scalar_quantities(found) if name.startswith(counted)
        }
    tested.add("field.heights")  # by test_shown
    tested.add("quantity.flowed_share")  # by test_bem_areas
    tested.add("quantity.hardness")  # by test_loads
    tested.add("cost.measuring_seconds")  # by test_loads
    # The gates of every case compute these from the pressures once more.
    tested.add("field.displacement")
    tested |= {"quantity.mean_plastic_displacement", "quantity.mean_separation"}
    tested |= {"quantity.filled_contact", "quantity.filled_load"}  # by test_filled
    tested |= {f"area.{part}.error" for part in ("total", "elastic", "plastic")}
    tested |= {
        name for name in QUANTITIES if name.rpartition(".")[0] in tested
    }  # of a known limit
    of_loads = (
        "mean_gap_error_by_grid",
        *(f"{kind}_conductance" for kind in CONDUCTING),
    )
    for name in of_loads:  # by test_loads
        tested |= {f"quantity.{name}", f"quantity.{name}.error"}
    assert sorted(QUANTITIES.keys() - tested) == []
