"""Studies of the boundary elements: pressures at both ends, the mean gap, what a solve costs."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest

from epcontact import persson
from epcontact.bem import solve
from epcontact.scene import Load
from epcontact.studies import bem, gap, gap_charts, pressures, pressures_charts, speed
from epcontact.studies import paper_scene as scenes


def quiet(_: str) -> None:
    pass


def rows_of(chart):
    return list(csv.DictReader(io.StringIO(chart.csv())))


# --- pressures ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ends():
    return pressures.measure((4, 8, 16), 16, range(3), quiet)


def test_pressures_drawn_from_the_theory_have_the_theory_s_ends():
    scene = scenes.rough_scene(4, 1, 8)
    theory, end_slopes, distribution = pressures.theory_of(scene)
    exact = persson.solve(scene, energy_reduction=scenes.GAMMA, spectrum="surface")
    areas_, G = exact.final.areas["raw"], exact.final.quantities["diffusion"]
    # A million pressures, evenly by their share of the area, as a field of boundary elements.
    n = 1_000_000
    sigma = np.linspace(0, scenes.HARDNESS, 20001)
    cumulative = persson.pressure_cumulative(sigma, G, scenes.MEAN_PRESSURE, scenes.HARDNESS)
    share = (np.arange(n) + 0.5) / n
    pressure = np.interp(share, cumulative, sigma, right=0.0)
    pressure[share > 1 - areas_.plastic] = scenes.HARDNESS
    found = pressures.figures_of(replace(exact, fields={"pressure": pressure}), 4)
    # The smallest window holds 1300 of the pressures; the table of them is linear in steps.
    np.testing.assert_allclose(found[:, pressures.MEAN_SLOPE :], theory[:, 4:], rtol=2e-3)
    np.testing.assert_allclose(found[:, pressures.RAW_SLOPE], theory[:, 1], rtol=2e-2)
    assert np.all(np.abs(found[:, pressures.DENSITY]) < 2e-3)
    # P bends down from both its ends, so that the mean slope falls from that at the very end.
    assert np.all(np.diff(np.column_stack([end_slopes, theory[:, 2:]])) < 0)
    assert distribution.plastic == pytest.approx(areas_.plastic)


def test_limits_of_exact_powers_are_exact():
    n = np.array([4.0, 8.0, 16.0])
    values = np.empty((2, 3, 2, 2 + len(pressures.WINDOWS)))
    values[:] = (0.3 + 0.2 / n)[:, None, None]
    values[..., :2] = (0.1 + 0.4 / np.sqrt(n))[:, None, None]
    found = pressures.Ends(n, values, np.ones((2, 8)), np.ones(2), 1.0, {}, 16)
    for figure, limit in ((0, 0.1), (1, 0.1), (2, 0.3)):
        assert found.limit(0, figure).limit == pytest.approx(limit, abs=1e-12)
    # Surfaces that agree and a fit that is exact leave no error; slopes have but two grids left.
    assert found.limit(0, pressures.DENSITY).error < 1e-12


def test_the_density_at_both_ends_falls_with_the_grid(ends):
    for end in range(2):
        raw = ends.limit(end, pressures.DENSITY)
        assert np.all(np.diff(raw.mean) < 0)
        assert abs(raw.limit) < 0.5 * raw.mean[-1]
        # The mean slope is positive where the raw one may still be hidden by the rims.
        assert ends.limit(end, pressures.MEAN_SLOPE).mean[-1] > 0


def test_the_charts_of_pressures_tell_the_limits(ends):
    charts = pressures_charts.draw_ends(ends)
    assert "zero lies" in charts[1].caption
    for end, name in enumerate(pressures.ENDS):
        one = ends.limit(end, pressures.DENSITY)
        assert f"limit {one.limit:+.2g} ± {one.error:.2g}" in charts[1].caption
        rows = [row for row in rows_of(charts[1]) if row["series"] == f"{name}, limit"]
        assert float(rows[0]["relative_density"]) == one.limit
    assert {row["series"] for row in rows_of(charts[0])} >= {"persson", "4 points a wavelength"}


# --- gap ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def gaps():
    return gap.measure(4, 16, range(3), quiet)


@pytest.fixture(scope="module")
def blocks():
    return gap.measure_blocks((3, 6), 4, 7, quiet)


@pytest.mark.parametrize("hardness", [scenes.HARDNESS, math.inf])
def test_the_load_s_work_is_stored_or_spent_on_flow(hardness):
    """-p d<g> = dU_el + hardness d<max(-g, 0)>, by the trapezoidal rule of second order."""
    scene, errors = scenes.rough_scene(4, 7, 8, hardness), []
    for steps in (4, 8, 16):
        path = Load(tuple(np.linspace(0.04, 0.16, steps + 1) * scenes.MODULUS))
        result = solve(replace(scene, load=path), tolerance=1e-11)
        told = {key: np.array([s.quantities[key] for s in result.steps]) for key in (*gap.NAMES,)}
        parts = told[gap.OPEN] - told[gap.PLASTIC]
        assert told[gap.SEPARATION] == pytest.approx(parts, rel=1e-12)
        p = np.array(path.path)
        work = -np.sum(0.5 * (p[1:] + p[:-1]) * np.diff(told[gap.SEPARATION]))
        stored = np.diff([s.quantities["elastic_energy"] for s in result.steps]).sum()
        spent = np.diff(told[gap.PLASTIC]).sum() * scenes.HARDNESS
        assert (spent > 0.1 * work) == math.isfinite(hardness)
        errors.append(abs(work / (stored + spent) - 1))
    assert errors[0] > 12 * errors[2]  # 16 times, but for nodes that change their state
    assert errors[2] < 1e-3


def test_gaps_close_and_flow_grows_with_the_load(gaps):
    for law in gap.LAWS:
        found = gaps.found[law]
        assert np.all(np.diff(found[gap.OPEN], axis=1) < 0)
        assert np.all(np.diff(found[gap.PLASTIC], axis=1) >= 0)
    assert np.all(gaps.found["elastic"][gap.PLASTIC] == 0)
    # Flow lets the flat come nearer than elasticity does.
    assert np.all(gaps.found["capped"][gap.SEPARATION] < gaps.found["elastic"][gap.SEPARATION])
    assert np.all((gaps.plastic_share > 0) & (gaps.plastic_share < 1))
    assert max(gaps.grid_error.values()) < 0.01


def test_the_theory_s_gap_is_near_where_it_was_made_for(gaps):
    at = int(np.argmin(np.abs(gaps.loads - 0.05)))
    for law in gap.LAWS:
        # 16 waves a side are few; the module of the theory's separation tells 2 to 12 %.
        assert abs(gaps.deviation(law)[0][at]) < 0.2


def test_finite_elements_near_the_gap_of_boundary_elements(blocks):
    for law in gap.LAWS:
        coarse, fine = (np.abs(blocks.deviation(law, n)).max() for n in (3, 6))
        assert fine < 0.5 * coarse
        assert fine < 0.05
    # J2 at 3 times the yield stress flows more than the cap: the model, not the grid.
    assert blocks.deviation("j2", 6)[-1] < -0.2


def test_the_charts_of_the_gap_define_and_tell_it(gaps, blocks):
    charts = (*gap_charts.draw_gaps(gaps), *gap_charts.draw_blocks(blocks))
    assert "separation = mean of g = open gap - plastic displacement" in charts[1].caption
    last = 100 * gaps.deviation("elastic")[0][-1]
    assert f"{last:+.1f} % at 0.4" in charts[2].caption
    assert f"{100 * blocks.deviation('j2', 6)[-1]:+.1f} % at 0.2" in charts[4].caption
    assert {row["series"] for row in rows_of(charts[3])} >= {"bem, capped", "fem, j2"}


# --- speed --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solves():
    return speed.measure([64, 128], quiet, threads=1, most_solves=1)


def test_the_unit_of_time_is_made_of_transforms_alone(monkeypatch):
    """Arrays made while the clock runs would be cleared in it, and lengthen the unit."""
    import ducc0

    outs, r2c, c2r = [], ducc0.fft.r2c, ducc0.fft.c2r

    def recording(transform):
        return lambda *args, **more: outs.append(more["out"]) or transform(*args, **more)

    monkeypatch.setattr(ducc0.fft, "r2c", recording(r2c))
    monkeypatch.setattr(ducc0.fft, "c2r", recording(c2r))
    assert bem.bare_pair_seconds((32, 48), 1, repeats=3) > 0
    assert [out.shape for out in outs] == [(32, 25), (32, 48)] * 3
    assert len({out.ctypes.data for out in outs}) == 2
    # A pair is what a convolution does, scaling included: there and back is where it began.
    assert np.abs(outs[1] - np.random.default_rng(1).random((32, 48))).max() < 1e-14


def test_a_solve_to_areas_costs_less_and_has_them(solves):
    assert len(solves) == 8
    for tight, loose in zip(solves[::2], solves[1::2], strict=True):
        assert (tight.aim, loose.aim) == (speed.TIGHT, speed.LOOSE)
        assert (tight.law, tight.side) == (loose.law, loose.side)
        assert loose.finest_pairs <= tight.finest_pairs <= speed.GOALS["finest_pairs"][speed.TIGHT]
        assert loose.all_pairs <= tight.all_pairs
        assert tight.area_error == 0
        # So small a grid has areas in steps of one point, which is this share of the smallest.
        assert loose.area_error <= speed.AREA + 1 / (0.05 * loose.side**2)
        assert min(tight.time, tight.processor_time, loose.time, loose.processor_time) > 0


def test_the_charts_of_speed_tell_every_solve_and_the_goals(solves):
    charts = speed.draw_speed(solves)
    speed_keys = ("finest_pairs", "all_pairs", "time", "processor_time")
    for key, chart in zip(speed_keys, charts[:4], strict=True):
        drawn = {(row["series"], float(row["points_a_side"])): row[key] for row in rows_of(chart)}
        for one in solves:
            assert float(drawn[f"{one.law}, {one.aim}", one.side]) == getattr(one, key)
            assert f"{getattr(one, key):.3g} at {one.side}²" in chart.caption
    assert "60 for residuals 1e-08" in charts[0].caption
    assert "120 for residuals 1e-08" in charts[2].caption
    assert [row["series"] for row in rows_of(charts[4])] == ["capped, areas 0.0001"] * 2 + [
        "elastic, areas 0.0001"
    ] * 2
