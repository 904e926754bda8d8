"""Studies of the boundary elements: pressures at both ends, the mean gap, what a solve costs."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from epcontact import persson
from epcontact.bem import solve
from epcontact.scene import Load
from epcontact.studies import bem, gap, pressures, speed
from epcontact.studies import paper_scene as scenes


def quiet(_: str) -> None:
    pass


def rows_of(chart):
    return list(csv.DictReader(io.StringIO(chart.csv())))


# --- pressures ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def figures():
    return pressures.boundary_element_tables((4, 8, 16), 16, range(3), quiet)[0]


def values_of(table: pd.DataFrame, end: str, figure: str) -> np.ndarray:
    own = table[(table["end"] == end) & (table["figure"] == figure)]
    return own.sort_values("window")["value"].to_numpy()


def test_pressures_drawn_from_the_theory_have_the_theory_s_ends():
    scene = scenes.rough_scene(4, 1, 8)
    theory, _ = pressures.theory_tables(scene)
    exact = persson.solve(scene, energy_reduction=scenes.GAMMA, spectrum="surface")
    areas_, G = exact.final.areas["raw"], exact.final.quantities["diffusion"]
    # A million pressures, evenly by their share of the area, as a field of boundary elements.
    n = 1_000_000
    sigma = np.linspace(0, scenes.HARDNESS, 20001)
    cumulative = persson.pressure_cumulative(sigma, G, scenes.MEAN_PRESSURE, scenes.HARDNESS)
    share = (np.arange(n) + 0.5) / n
    pressure = np.interp(share, cumulative, sigma, right=0.0)
    pressure[share > 1 - areas_.plastic] = scenes.HARDNESS
    found = pressures.end_figures(replace(exact, fields={"pressure": pressure}), 4)
    for end in pressures.ENDS:
        mean, exact_mean = (values_of(t, end, pressures.MEAN_SLOPE) for t in (found, theory))
        # The smallest window holds 1300 of the pressures; the table of them is linear in steps.
        np.testing.assert_allclose(mean[2:], exact_mean[3:], rtol=2e-3)
        raw, exact_raw = (values_of(t, end, pressures.RAW_SLOPE) for t in (found, theory))
        np.testing.assert_allclose(raw, exact_raw, rtol=2e-2)
        assert abs(values_of(found, end, pressures.DENSITY)[0]) < 2e-3
        # P bends down from both its ends, so that the mean slope falls from that at the very end.
        assert np.all(np.diff(exact_mean) < 0)


def test_limits_of_exact_powers_are_exact():
    figures = {pressures.DENSITY: (0.1, 0.5), pressures.RAW_SLOPE: (0.1, 0.5)}
    figures |= {pressures.MEAN_SLOPE: (0.3, 1.0)}
    rows = [
        (seed, n, "0+", figure, 0.2, limit + 0.4 * n**-order)
        for seed in range(2)
        for n in (4, 8, 16)
        for figure, (limit, order) in figures.items()
    ]
    names = ["seed", "points_per_wavelength", "end", "figure", "window", "value"]
    found = pressures.grid_limits(pd.DataFrame(rows, columns=names)).set_index("figure")
    for figure, (limit, _) in figures.items():
        assert found["value"][figure] == pytest.approx(limit, abs=1e-12)
    # Surfaces that agree and a fit that is exact leave no error; slopes have but two grids left.
    assert found["value_high"]["density"] - found["value"]["density"] < 1e-12


def test_the_density_at_both_ends_falls_with_the_grid(figures):
    limits = pressures.grid_limits(figures)
    for end in pressures.ENDS:
        own = figures[figures["end"] == end]
        means = own.groupby(["figure", "window", "points_per_wavelength"])["value"].mean()
        density = means["density", pressures.WINDOW]
        assert density.is_monotonic_decreasing
        assert abs(values_of(limits, end, pressures.DENSITY)[0]) < 0.5 * density.iloc[-1]
        # The mean slope is positive where the raw one may still be hidden by the rims.
        assert means["mean slope", pressures.WINDOW].iloc[-1] > 0


def test_the_charts_of_pressures_tell_the_limits(figures):
    theory, _ = pressures.theory_tables(scenes.rough_scene(4, 0, 16))
    chart = pressures.draw_limits(figures, theory, pressures.DENSITY, "density", "Density")
    limits = pressures.grid_limits(figures)
    for end in pressures.ENDS:
        (limit,) = values_of(limits, end, pressures.DENSITY)
        assert f"{end}: {limit:+.3g} ±" in chart.caption
        rows = [row for row in rows_of(chart) if row["series"] == f"{end}, limit"]
        assert float(rows[0]["relative_density"]) == limit


# --- gap ----------------------------------------------------------------------------------------


SIZE = (4, 16)  # points per shortest wavelength, bandwidth


@pytest.fixture(scope="module")
def gaps():
    return gap.boundary_element_gaps(*SIZE, range(3), quiet)


@pytest.fixture(scope="module")
def theory():
    loads = np.geomspace(gap.LOADS[0], gap.LOADS[-1], gap.STEPS * (len(gap.LOADS) - 1) + 1)
    return gap.theory_gaps(*SIZE, 2, loads.tolist())


@pytest.fixture(scope="module")
def blocks():
    return gap.block_gaps((3, 6), 4, 7, quiet)


@pytest.mark.parametrize("hardness", [scenes.HARDNESS, math.inf])
def test_the_load_s_work_is_stored_or_spent_on_flow(hardness):
    """-p d<g> = dU_el + hardness d<max(-g, 0)>, by the trapezoidal rule of second order."""
    scene, errors = scenes.rough_scene(4, 7, 8, hardness), []
    for steps in (4, 8, 16):
        path = Load(tuple(np.linspace(0.04, 0.16, steps + 1) * scenes.MODULUS))
        result = solve(replace(scene, load=path), tolerance=1e-11)
        told = {
            name: np.array([s.quantities[key] for s in result.steps])
            for name, key in gap.QUANTITIES.items()
        }
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
    for _, found in gaps.groupby(["law", "seed"]):
        assert (found[gap.OPEN].diff().iloc[1:] < 0).all()
        assert (found[gap.PLASTIC].diff().iloc[1:] >= 0).all()
    capped, elastic = (gaps[gaps["law"] == law] for law in ("capped", "elastic"))
    assert (elastic[gap.PLASTIC] == 0).all()
    # Flow lets the flat come nearer than elasticity does.
    assert np.all(capped[gap.SEPARATION].to_numpy() < elastic[gap.SEPARATION].to_numpy())
    assert capped["plastic_share"].between(0, 1, inclusive="neither").all()


def test_the_gap_hardly_depends_on_the_grid(gaps):
    fine = gap.boundary_element_gaps(2 * SIZE[0], SIZE[1], range(1), quiet)[gap.OPEN].to_numpy()
    own = gaps[gaps["seed"] == 0][gap.OPEN].to_numpy()
    assert np.abs(fine / own - 1).max() < 0.01


def test_the_theory_s_gap_is_near_where_it_was_made_for(gaps, theory):
    deviations = gap.theory_deviations(gaps, theory)
    at = deviations[np.isclose(deviations["pressure_over_modulus"], 0.05)]
    # 16 waves a side are few; the module of the theory's separation tells 2 to 12 %.
    assert len(at) == 2
    assert (at["deviation_percent"].abs() < 20).all()


def test_finite_elements_near_the_gap_of_boundary_elements(blocks):
    deviations = gap.block_deviations(blocks)
    largest = deviations["deviation_percent"].abs().groupby(
        [deviations["law"], deviations["points_per_wavelength"]]
    ).max()  # fmt: skip
    for law in gap.LAWS:
        assert largest[law, 6] < 0.5 * largest[law, 3]
        assert largest[law, 6] < 5
    # J2 at 3 times the yield stress flows more than the cap: the model, not the grid.
    j2 = deviations[(deviations["law"] == "j2") & (deviations["points_per_wavelength"] == 6)]
    assert j2["deviation_percent"].iloc[-1] < -20


def test_the_charts_of_the_gap_define_and_tell_it(gaps, theory, blocks):
    charts = (*gap.draw_gaps(gaps, theory, gaps, "3 surfaces"), *gap.draw_blocks(blocks))
    assert "separation = mean of g = open gap - plastic displacement" in charts[1].caption
    last = gap.theory_deviations(gaps, theory)["deviation_percent"].iloc[-1]
    assert f"elastic {last:+.1f} % at 0.4" in charts[2].caption
    j2 = gap.block_deviations(blocks)["deviation_percent"].iloc[-1]
    assert f"j2 {j2:+.1f} % at 0.2" in charts[4].caption
    assert {row["series"] for row in rows_of(charts[3])} >= {"bem, capped", "fem, j2"}


# --- speed --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solves():
    return speed.solve_costs([64, 128], quiet, threads=1, most_solves=1)


def test_the_unit_of_time_is_made_of_transforms_alone(monkeypatch):
    """Arrays made while the clock runs would be cleared in it, and lengthen the unit."""
    import ducc0

    outs, r2c, c2r = [], ducc0.fft.r2c, ducc0.fft.c2r

    def recording(transform):
        return lambda *args, **more: outs.append(more["out"]) or transform(*args, **more)

    monkeypatch.setattr(ducc0.fft, "r2c", recording(r2c))
    monkeypatch.setattr(ducc0.fft, "c2r", recording(c2r))
    assert min(bem.bare_pair_times((32, 48), 1, repeats=3)) > 0
    assert [out.shape for out in outs] == [(32, 25), (32, 48)] * 3
    assert len({out.ctypes.data for out in outs}) == 2
    # A pair is what a convolution does, scaling included: there and back is where it began.
    assert np.abs(outs[1] - np.random.default_rng(1).random((32, 48))).max() < 1e-14


def test_a_solve_to_areas_costs_less_and_has_them(solves):
    assert len(solves) == 8
    by = ["law", "points_a_side"]
    aims = (solves[solves["aim"] == aim].set_index(by) for aim in (speed.TIGHT, speed.LOOSE))
    tight, loose = aims
    assert (loose["finest_pairs"] <= tight["finest_pairs"]).all()
    # Of these grids only the larger one has a coarser grid to start from.
    assert (tight.xs(128, level="points_a_side")["finest_pairs"] <= 12).all()
    assert (loose["all_pairs"] <= tight["all_pairs"]).all()
    assert (tight["area_error"] == 0).all()
    # So small a grid has areas in steps of one point, which is this share of the smallest.
    steps = 1 / (0.05 * loose.index.get_level_values("points_a_side") ** 2)
    assert (loose["area_error"] <= speed.AREA + steps).all()
    assert (solves[["time", "processor_time"]] > 0).all(axis=None)


def test_the_charts_of_speed_tell_every_solve_and_the_goals(solves):
    charts = speed.draw_speed(solves)
    speed_keys = ("finest_pairs", "all_pairs", "time", "processor_time")
    for key, chart in zip(speed_keys, charts[:4], strict=True):
        drawn = {(row["series"], float(row["points_a_side"])): row[key] for row in rows_of(chart)}
        for row in solves.to_dict("records"):
            name, side = f"{row['law']}, {row['aim']}", row["points_a_side"]
            assert float(drawn[name, side]) == row[key]
            assert f"{name}: {row[key]:.3g} at {side}²" in chart.caption
    for key, chart in zip(speed_keys[2:], charts[2:4], strict=True):
        goals = [(row["series"], row[key]) for row in rows_of(chart) if "goal" in row["series"]]
        assert goals == [("goal, residuals 1e-08", "300.0"), ("goal, areas 0.0001", "180.0")]
    assert [row["series"] for row in rows_of(charts[4])] == ["capped, areas 0.0001"] * 2 + [
        "elastic, areas 0.0001"
    ] * 2
