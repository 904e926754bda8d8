"""Convergence studies on sequences of known limit, and the orders of the boundary elements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epcontact import bem
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.gates import Gate, judge_estimates
from epcontact.reference import hertz, sinusoid
from epcontact.results import ContactResult
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.studies.convergence import (
    fitted_order,
    observed_order,
    refine,
    refined,
    richardson,
    study,
    table,
)
from epcontact.surfaces import FlatPunch, HeightsFromArray, Paraboloid, Sinusoid

# --- sequences -----------------------------------------------------------------------------------


@given(
    limit=st.floats(-10, 10),
    factor=st.floats(0.1, 10).flatmap(lambda a: st.sampled_from([a, -a])),
    order=st.floats(0.3, 6),
    ratios=st.tuples(st.floats(1.3, 3), st.floats(1.3, 3)),
)
def test_exact_power_law_gives_its_order_and_limit(limit, factor, order, ratios) -> None:
    h = [0.01, 0.01 * ratios[0], 0.01 * ratios[0] * ratios[1]]
    f = [limit + factor * (x / 0.03) ** order for x in h]
    # Digits are lost as the changes vanish beside the values.
    lost = 1e-15 * max(map(abs, f)) / abs(f[1] - f[0])
    found = observed_order(f, h)
    assert found == pytest.approx(order, rel=1e-9 + 100 * lost)
    judged = study(f, h, formal_order=order)
    assert judged.kind == "monotone"
    assert judged.safety == 1.25
    assert judged.limit == pytest.approx(limit, abs=1e-9 * abs(factor) + 1e3 * lost * abs(factor))
    assert judged.uncertainty == pytest.approx(1.25 * abs(f[0] - judged.limit), rel=1e-12)


def test_sequence_may_come_in_any_order() -> None:
    h = [0.4, 0.1, 0.2]
    assert study([1 + x**2 for x in h], h, 2.0).limit == pytest.approx(1.0, rel=1e-12)


def test_published_example() -> None:
    # NASA Glenn, "Examining Spatial (Grid) Convergence": a pressure recovery on three grids,
    # p = 1.786170, limit 0.97130, index 0.103083 %.
    found = study([0.970500, 0.968540, 0.961780], [1, 2, 4], formal_order=2.0)
    assert found.order == pytest.approx(1.786170, abs=1e-6)
    assert found.limit == pytest.approx(0.97130, abs=5e-6)
    assert found.index == pytest.approx(0.00103083, abs=1e-8)


def test_strange_order_is_not_believed() -> None:
    # Order 6 where 2 is known: the formal order and a factor of 3 are taken.
    h = [1.0, 2.0, 4.0]
    found = study([1 + x**6 * 1e-3 for x in h], h, formal_order=2.0)
    assert found.orders[0] == pytest.approx(6.0)
    assert (found.order, found.safety) == (2.0, 3.0)
    assert found.uncertainty >= abs(found.limit - 1)


def test_oscillation_is_called_so_and_has_no_order() -> None:
    found = study([1.00, 1.02, 0.99, 1.08], [1, 2, 4, 8], 2.0)
    assert found.kind == "oscillating"
    assert math.isnan(found.order)
    assert found.limit == 1.00
    assert found.uncertainty == pytest.approx(3 * 0.03)


def test_divergence_is_called_so() -> None:
    found = study([1.5, 1.2, 1.1], [1, 2, 4], 1.0)
    assert found.kind == "diverging"
    assert found.uncertainty == pytest.approx(3 * 0.4)


def test_constant_and_two_grids() -> None:
    assert study([2.0, 2.0, 2.0], [1, 2, 4], 2.0).kind == "constant"
    two = study([1.01, 1.04], [1, 2], 2.0)
    assert (two.kind, two.safety) == ("two grids", 3.0)
    assert two.limit == pytest.approx(1.0)


def test_equal_finest_values_are_not_taken_for_convergence() -> None:
    # Two counts that agree by chance after a third that does not.
    assert study([1.0, 1.0, 1.2], [1, 2, 4], 1.0).kind == "oscillating"


def test_richardson_is_exact_for_a_power() -> None:
    assert richardson(1 + 0.1**3, 1 + 0.3**3, 3.0, 3.0) == pytest.approx(1.0, rel=1e-14)


def test_limit_with_its_uncertainty_is_what_a_gate_compares() -> None:
    found = study([1.01, 1.04, 1.16], [1, 2, 4], 2.0)  # 1 ± 0.0125
    exact = study([1.0, 1.0, 1.0], [1, 2, 4], 2.0).estimate

    def holds(tolerance: float) -> bool:
        gate = Gate("mean_pressure", "bem", 1.0, "relative", -tolerance, tolerance, "a test")
        return judge_estimates(gate, found.estimate, exact).holds

    assert holds(0.0126)
    assert not holds(0.0124)


def test_table_tells_grids_and_verdict() -> None:
    text = table(study([1.01, 1.04, 1.16], [1, 2, 4], 2.0))
    assert text.count("\n") == 4
    assert "monotone: 1 ± 0.013 (order 2.00, safety 1.25" in text
    assert "oscillating" in table(study([1.0, 1.2, 1.1], [1, 2, 4], 2.0))


@pytest.mark.parametrize(
    ("values", "spacings", "order", "word"),
    [
        ([1.0], [1.0], 2.0, "two grids"),
        ([1.0, 2.0], [1.0], 2.0, "two grids"),
        ([1.0, 2.0], [1.0, 1.0], 2.0, "differ"),
        ([1.0, 2.0], [1.0, -1.0], 2.0, "positive"),
        ([1.0, math.nan], [1.0, 2.0], 2.0, "finite"),
        ([1.0, 2.0], [1.0, 2.0], 0.0, "formal_order"),
    ],
)
def test_no_sequence(values, spacings, order, word) -> None:
    with pytest.raises(InvalidCase, match=word):
        study(values, spacings, order)


def test_fitted_order_knows_its_own_error() -> None:
    h = np.geomspace(0.01, 1, 5)
    exact = fitted_order(h, 3 * h**1.5)
    assert (exact.order, exact.factor) == pytest.approx((1.5, 3.0))
    assert exact.standard_error < 1e-12
    noise = np.random.default_rng(1).normal(0, 0.1, (5, 20))
    shaken = fitted_order(h, 3 * h[:, None] ** 1.5 * np.exp(noise))
    assert abs(shaken.order - 1.5) < 4 * shaken.standard_error + 0.05
    with pytest.raises(InvalidCase, match="positive"):
        fitted_order([1.0, 2.0], [0.0, 1.0])
    with pytest.raises(InvalidCase, match="two spacings"):
        fitted_order([1.0], [1.0])


def test_recipes_are_refined_in_proportion() -> None:
    recipe = Sinusoid((1.0, 0.5), (64, 32), 0.1)
    assert refined(recipe, 128).shape == (128, 64)
    with pytest.raises(InvalidScene):
        refined(Sinusoid((1.0,), (64,), 0.1, waves=9), 16)
    with pytest.raises(InvalidCase, match="grid they have"):
        refined(HeightsFromArray(np.zeros((4, 4)), (1.0, 1.0), treatment="periodic"), 8)


# --- orders of the boundary elements -------------------------------------------------------------

MATERIAL = Material(young_modulus=2.0e11, poisson_ratio=0.3)
STIFFNESS = 2.0e11 / (1 - 0.3**2)
SHARE = 0.3  # of the pressure of complete contact


def shifted_wave(points: int, shift: float) -> Scene:
    """One wave on a line, its crest `shift` spacings from a grid point."""
    x = (np.arange(points) - shift) / points
    complete = sinusoid.line_complete_pressure(1e-6, 1e-3, STIFFNESS)
    surface = Surface(1e-6 * np.cos(2 * np.pi * x), (1e-3,))
    return Scene(surface, MATERIAL, Load(SHARE * complete))


def wave_errors(points: int, shift: float) -> dict[str, float]:
    result = bem.solve(shifted_wave(points, shift), threads=1)
    complete = sinusoid.line_complete_pressure(1e-6, 1e-3, STIFFNESS)
    x = (np.arange(points) - shift) / points
    exact = complete * sinusoid.line_pressure(x, SHARE)
    area = sinusoid.line_contact_fraction(SHARE)
    final = result.final
    return {
        "pressure": float(
            np.linalg.norm(result.fields["pressure"] - exact) / np.linalg.norm(exact)
        ),
        "raw": abs(final.areas["raw"].total / area - 1),
        "corrected": abs(final.areas["corrected"].total / area - 1),
        "gap": abs(final.quantities["mean_gap"] / (1e-6 * sinusoid.line_mean_gap(SHARE)) - 1),
    }


@pytest.fixture(scope="module")
def wave_study() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    sizes = np.array([64, 128, 256, 512, 1024])
    shifts = (np.arange(16) + 0.5) / 16
    errors = [[wave_errors(int(n), float(s)) for s in shifts] for n in sizes]
    return 1 / sizes, {
        name: np.array([[e[name] for e in row] for row in errors]) for name in errors[0][0]
    }


@pytest.mark.parametrize(
    ("quantity", "order", "cap"),
    [
        # The least order, and the largest root mean square of the error at 1024 points.
        # Measured over 16 shifts: 0.99 and 5.2e-4, 0.87 and 1.5e-3, 2.04 and 2.8e-7, 2.05 and
        # 2.0e-6, orders with standard errors of 0.03, 0.09, 0.20 and 0.19.
        ("pressure", 0.9, 8e-4),
        ("raw", 0.7, 2.5e-3),
        ("corrected", 1.6, 5e-7),
        ("gap", 1.6, 4e-6),
    ],
)
def test_order_on_westergaard(wave_study, quantity, order, cap) -> None:
    spacings, errors = wave_study
    fit = fitted_order(spacings, errors[quantity])
    assert fit.order > order
    assert np.sqrt(np.mean(errors[quantity][-1] ** 2)) < cap


def test_order_on_hertz() -> None:
    # Measured over 16 places of the sphere: raw 1.02 and 4.9e-3, corrected 1.67 and 4.4e-4.
    radius = 0.2e-3
    force = hertz.sphere_force(radius, 1e-2, STIFFNESS)
    size = hertz.sphere_contact_radius_periodic(force, 1e-2, STIFFNESS, 1e-3)
    exact = math.pi * (size / 1e-3) ** 2
    rng = np.random.default_rng(0)
    raw, corrected = [], []
    sizes = (32, 64, 128, 256)
    for n in sizes:
        found = []
        for _ in range(16):
            recipe = Paraboloid((1e-3, 1e-3), (n, n), 1e-2, tuple(rng.random(2)))
            scene = Scene(recipe.build(), MATERIAL, Load(force / 1e-6))
            found.append(bem.solve(scene, threads=1).final.areas)
        raw.append([abs(a["raw"].total / exact - 1) for a in found])
        corrected.append([abs(a["corrected"].total / exact - 1) for a in found])
    spacings = [1 / n for n in sizes]
    assert fitted_order(spacings, raw).order > 0.9
    assert np.sqrt(np.mean(np.square(raw[-1]))) < 6e-3
    assert fitted_order(spacings, corrected).order > 1.3
    assert np.sqrt(np.mean(np.square(corrected[-1]))) < 8e-4


def test_limit_of_a_strip_punch_covers_the_closed_form() -> None:
    # Singular at the rim: first order, and no single grid is near.
    def scene_of(points: int) -> Scene:
        recipe = refined(FlatPunch((1e-3,), (20,), 0.3e-3, 1e-5), points)
        return Scene(recipe.build(), MATERIAL, Load(1e8))

    def solver(scene: Scene) -> ContactResult:
        return bem.solve(scene, threads=1)

    found = refine(scene_of, solver, "quantity.elastic_energy", [320, 160, 80, 40], 1.0)
    exact = -(1e8**2) * 1e-3 / (math.pi * STIFFNESS) * math.log(math.sin(0.3 * math.pi))
    assert found.kind == "monotone"
    assert found.order == pytest.approx(1.0, abs=0.1)
    assert abs(found.values[0] / exact - 1) > 5e-3
    assert abs(found.limit - exact) < found.uncertainty
    assert abs(found.limit / exact - 1) < 2e-4
