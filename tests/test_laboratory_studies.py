"""Studies of the laboratories: each runs at a small size, and its finding holds."""

import io
import math
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from laboratory import (
    areas,
    gap_distribution,
    hysteresis,
    persistence,
    pressure_ends,
    residual,
    rough_body,
    time_to_answer,
    treatment,
    walls,
)

from epcontact import persson
from epcontact.errors import EpcontactError
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.studies import paper_scene as scenes
from epcontact.studies.frame import tabulate

#: Options of the study of a map's treatment.
TREATMENT = {
    "points": (24,),
    "seeds": (2,),
    "tiles": 2,
    "kinds": ("rolled off", "turned"),
}
#: Each study with options of a few seconds, the number of its charts and the mean of
#: the numbers in the last.
SMALL = (
    (
        areas.STUDY,
        {"seeds": (100,), "points": 16, "kinds": ("self-affine", "worn", "spheres")},
        1,
        0.6125286,
    ),
    (
        gap_distribution.STUDY,
        {"points": 4, "wide": 16, "seeds": (33, 34), "narrow": 8},
        2,
        1.942632,
    ),
    (
        hysteresis.STUDY,
        {"points": 4, "bandwidth": 4, "seeds": (77, 78)},
        3,
        0.5237263,
    ),
    (
        pressure_ends.STUDY,
        {"bandwidth": 16, "points": (4, 8, 16), "seeds": range(3)},
        3,
        0.3101682,
    ),
    (
        residual.STUDY,
        {"points": 4, "wide": 16, "seeds": (5, 6), "narrow": 4, "hardnesses": (0.16,)},
        4,
        -0.4291133,
    ),
    (
        persistence.STUDY,
        {"severities": (5.0,), "seeds": (1, 2), "nodes": 16},
        1,
        0.7923929,
    ),
    (
        rough_body.STUDY,
        {"slopes": (0.05,), "seeds": (1, 2), "nodes": 12},
        3,
        0.01534767,
    ),
    (
        treatment.STUDY,
        TREATMENT,
        8,
        0.1583006,
    ),
    (
        walls.STUDY,
        {"bandwidths": (16,), "seeds": (1, 2, 3), "points": 4},
        4,
        0.5274431,
    ),
)


@pytest.mark.slow
@pytest.mark.parametrize(("study", "options", "count", "mean"), SMALL)
def test_a_study_of_the_laboratories_runs(study, options, count, mean):
    """A `study` with small `options` draws `count` charts with its description.

    The `mean` of all numbers in the table of the last chart is that of an earlier run.
    """
    charts = study.run(**options)
    assert len(charts) == count
    assert study.description in charts[0].caption
    numbers = pd.DataFrame(charts[-1].rows, columns=charts[-1].header)
    numbers = numbers.select_dtypes("number").to_numpy()
    assert np.nanmean(numbers) == pytest.approx(mean, rel=1e-6)


def test_distances_of_gaps_are_known():
    """Two equal distributions of gaps are 0 apart, and gaps twice as wide one mean
    gap.
    """
    gaps = gap_distribution.GAPS
    tables = []
    for method, width in (("bem", 2), ("fem", 4)):
        columns = {
            "ratio": 0.6,
            "seed": 1,
            "gap_over_rms_height": gaps,
            "method": method,
            "cumulative_area": np.minimum(gaps / width, 1),
        }
        tables.append(pd.DataFrame(columns))
    table = pd.concat(tables)
    same = gap_distribution.distances(table, "bem", "bem")
    wider = gap_distribution.distances(table, "fem", "bem")
    assert same["distance"].tolist() == [0.0]
    assert wider["distance"].item() == pytest.approx(1.0, abs=0.01)


def test_cap_and_theory_differ_on_the_way_down():
    """On unloading to 0.02 of the peak a capped body has 3 to 6 times the area of its
    loading, the theory the same.

    The capped body returns its energy: less than 5 % of the work is lost.
    """
    table = tabulate(
        lambda _: None,
        hysteresis.cycle,
        model=("cap", "theory"),
        seed=[77],
        points=[4],
        bandwidth=[16],
    )
    light = table[table["load_over_peak"] == 0.02].set_index(["model", "branch"])
    ratio = light.xs("down", level="branch") / light.xs("up", level="branch")
    assert 3 < ratio[hysteresis.AREA]["cap"] < 6
    assert 0.9 < ratio[hysteresis.AREA]["theory"] < 1.1
    assert 0.5 < ratio[hysteresis.GAP]["cap"] < 0.8
    work = table.groupby("model")[hysteresis.WORK]
    assert work.max()["cap"] < 1
    assert work.last()["cap"] > 0.95  # the energy stored at the peak is given back


def test_in_full_contact_pressures_diffuse_at_the_full_rate_without_drift():
    """Far from both walls the mean square of the pressure changes with each ring of
    waves is that of full contact, and the mean change is 0.

    The walls are pressure 0 and the hardness.
    """
    flows, table = walls.steps(1, 16, (5.0, math.inf), 4, (1.0, 0.25))
    assert flows.empty
    assert table["diffusion"].to_numpy() == pytest.approx(1, rel=1e-9)
    assert table["drift"].to_numpy() == pytest.approx(0, abs=1e-6)


def test_the_weaker_the_ring_the_more_points_return_through_a_wall():
    """A weaker ring of waves lets more points return into contact or from plastic flow,
    because fronts move to and fro as the root of the step.

    Near the walls the pressures hardly move: the rate of diffusion is below 0.1 of that
    in full contact.
    """
    all_flows = []
    all_tables = []
    for seed in range(1, 5):
        flows, table = walls.steps(seed, 16, (0.3, 0.6), 16, (1.0, 1 / 16))
        all_flows.append(flows)
        all_tables.append(table)
    returned = pd.concat(all_flows).groupby(["wall", "w"])["returned"].mean()
    for wall in ("at zero", "at hardness"):
        assert returned[wall, 1 / 16] > returned[wall, 1.0] + 0.05
    # Weak rings change the distribution as if the pressures hardly moved next to the
    # walls.
    table = pd.concat(all_tables)
    strongest = table[table["w"] == 1]
    reduction = strongest.groupby("relative_pressure")["reduction"].mean()
    assert reduction.iloc[0] < 0.1
    assert 0.2 < reduction.iloc[len(reduction) // 2] < 0.536


def test_the_limit_at_a_vanishing_step_is_that_of_a_line_in_its_root():
    """The limit at a step w of 0 is the constant of a line in the root of w.

    Its half-width is Student's 12.7062 for two seeds that differ by 0.01 from their
    mean.
    """
    rows = []
    for seed in (1, 3):
        for w in (1, 0.25):
            rows.append((seed, w, 1.02 - seed / 100 - 0.3 * w**0.5))
    flows = pd.DataFrame(rows, columns=["seed", "w", "returned"])
    flows = flows.assign(hardness=0.6, p0=0.1, bandwidth=16, wall="zero")
    (limit,) = walls.limits(flows).to_dict("records")
    assert limit["limit"] == pytest.approx(1.0)
    assert limit["half_width"] == pytest.approx(12.7062 * 0.01, rel=1e-4)


def test_the_coverage_of_each_kind_is_that_of_its_marks(monkeypatch):
    """The chart of the areas' errors states for each kind of surface the percentage of
    marks at or below 1.

    A mark is the error over its estimate, drawn between 1e-3 and 1e2.
    """
    times = {"a": [0.02, 0.5, 1.5], "b": [0.4, 700.0, 3.0], "c": [0.9, 0.7, 1e-5]}

    def judged(kind, seed, points):
        """Return the prescribed ratio of error and estimate, instead of a solve."""
        return {"times": times[kind][seed]}

    monkeypatch.setattr(areas, "judged", judged)
    (chart,) = areas.STUDY.run(seeds=range(3), kinds=tuple(times))
    labels = [text.get_text() for text in chart.figure.axes[0].get_yticklabels()]
    assert labels == ["c, 100%", "b, 33%", "a, 67%"]
    assert "? Of 9 areas 67% are within their error estimate. " in chart.caption
    marks = [
        (k, min(max(t, 1e-3), 1e2), "cba".index(k)) for k in times for t in times[k]
    ]
    assert [row[:3] for row in chart.rows] == marks


def test_a_load_takes_power_from_short_waves_and_the_theory_takes_all():
    """The fraction of the spectral power that a load leaves in each octave is 0.5 to
    0.9 with the cap; in the theory it falls from 1 to 0.
    """
    options = {"points": 4, "wide": 16, "narrow": 4, "hardnesses": (0.16,)}
    drawn = residual.STUDY.run(seeds=(5, 6), **options)[2]
    table = pd.read_csv(io.StringIO(drawn.csv()))
    remaining_power = table.set_index("series")["power_kept"]
    (cap,) = {name for name in remaining_power.index if name.startswith("cap")}
    (of_theory,) = {name for name in remaining_power.index if name.startswith("theory")}
    assert remaining_power[cap].between(0.5, 0.9).all()
    assert remaining_power[of_theory].iloc[0] == pytest.approx(1, abs=1e-6)
    assert remaining_power[of_theory].iloc[-1] < 1e-4
    assert np.diff(remaining_power[of_theory]).max() < 0


def test_a_mirrored_map_conducts_and_a_periodic_one_percolates_as_the_whole():
    """On cut-outs of known surfaces, mirroring has less than 10 % error of the
    conductance, and a periodic continuation less than 10 % of the gap's percolation.
    """
    errors = {}
    for chart in treatment.STUDY.run(**TREATMENT):
        quantity = re.match("How far is the (.*) of (crops|controls)", chart.caption)[1]
        table = pd.read_csv(io.StringIO(chart.csv()))
        table["square"] = table["error"] ** 2
        errors[quantity] = np.sqrt(table.groupby("series")["square"].mean())
    conductance = errors["conductance"]
    assert conductance["mirrored"] < 0.1 < conductance["periodic"]
    percolation = errors["gap percolation"]
    assert percolation["periodic"] < 0.1 < percolation["mirrored"]


def test_pressures_drawn_from_the_theory_have_the_theory_s_ends():
    """The density of pressures that are drawn from the theory has the theory's slope
    and value at zero pressure and at the hardness.
    """
    scene = scenes.rough_scene(4, 1, 8)
    result = scenes.solve_theory(scene)
    G = result.final.quantities["diffusion"]
    hardness = scenes.HARDNESS
    # A million pressures, evenly by their fraction of the area, as a field of boundary
    # elements.
    fraction = (np.arange(1_000_000) + 0.5) / 1_000_000
    sigma = np.linspace(0, hardness, 20001)
    cumulative = persson.pressure_cumulative(sigma, G, scenes.MEAN_PRESSURE, hardness)
    pressure = np.interp(fraction, cumulative, sigma, right=0.0)
    pressure[fraction > 1 - result.final.areas["raw"].plastic] = hardness
    drawn_result = replace(result, fields={"pressure": pressure})
    found = pd.DataFrame(pressure_ends.end_values(drawn_result, 4)).set_index("end")
    expected = pd.DataFrame(pressure_ends.theory_values(scene)).set_index("end")
    for end, place, sign in (("0+", "zero", 1), ("hardness-", "hardness", -1)):
        slope = expected[pressure_ends.SLOPE][end]
        assert found[pressure_ends.SLOPE][end] == pytest.approx(slope, rel=2e-3)
        assert abs(found[pressure_ends.DENSITY][end]) < 2e-3
        # P bends down from both its ends, so that the mean slope is below that at the
        # very end.  It rises from zero pressure, and falls towards the hardness.
        steepest = result.final.quantities[f"density_slope_at_{place}"]
        steepest *= sign * hardness**2
        assert 0.9 * steepest < slope < steepest


def test_limits_of_exact_powers_are_exact():
    """The limit of a density and of its slope for an infinitely fine grid is exact if
    the error is an exact power of the grid spacing.

    The invented values are limit + 0.4 n^-order on n points a wavelength, equal for
    both surfaces.
    """
    for figure, limit in {pressure_ends.DENSITY: 0.1, pressure_ends.SLOPE: 0.3}.items():
        _, _, order = pressure_ends.QUANTITIES[figure]
        rows = [
            (seed, n, "0+", limit + 0.4 * n**-order)
            for seed in (1, 2)
            for n in (4, 8, 16)
        ]
        table = pd.DataFrame(
            rows, columns=["seed", "points_per_wavelength", "end", figure]
        )
        (found,) = pressure_ends.grid_limits(table, figure).to_dict("records")
        # Surfaces that agree and a fit that is exact leave no error; slopes have two
        # grids left.
        assert found[figure] == pytest.approx(limit, abs=1e-12)
        width = found[f"{figure}_high"] - found[f"{figure}_low"]
        assert width < 1e-12 or figure == pressure_ends.SLOPE


@pytest.mark.slow
def test_the_start_of_a_command_takes_longer_than_the_solve_of_a_small_grid():
    """Commands are run and timed; the start of Python outlasts a solve on 64 x 64."""
    _, parts = time_to_answer.STUDY.run(sides=(64,))
    table = pd.read_csv(io.StringIO(parts.csv())).set_index("series")
    seconds = table["processor_time"]
    assert seconds["run, start"] > seconds["run, solving"]


def test_the_processor_time_is_that_of_the_command(tmp_path):
    """A command that computes for 0.2 s takes as long, but for the ticks of 0.01 s in
    which the system counts, and the error of one that fails is raised.
    """
    program = "import time\nwhile time.process_time() < 0.2: pass"
    assert 0.15 <= time_to_answer._processor_seconds(tmp_path, "-c", program) < 2
    with pytest.raises(EpcontactError, match="no such module"):
        time_to_answer._processor_seconds(tmp_path, "-c", "exit('no such module')")


def test_the_time_of_a_command_is_split_by_differences_of_runs(monkeypatch, tmp_path):
    """Start and solving are timed alone; the other parts are differences of runs, and
    the charts have them and their sums over the time of a bare FFT pair, here 0.5 s.
    """
    seconds = {
        "run time.toml --jobs 1": 3.0,
        "run time.toml --jobs 1 --fresh --fields none": 5.0,
        "run time.toml --jobs 1 --fresh": 5.5,
        "run time.toml --jobs 1 --charts": 4.25,
        "verify time.toml --jobs 1 --fresh": 4.5,
        "report results": 3.5,
        "plan time.toml --tolerance 5%": 2.75,
        "import epcontact.cli.run_and_verify": 1.0,
    }

    def processor_seconds(folder, *arguments):
        """Return the seconds of a command by its last words."""
        text = " ".join(arguments)
        return next(s for words, s in seconds.items() if text.endswith(words))

    monkeypatch.setattr(time_to_answer, "_processor_seconds", processor_seconds)
    monkeypatch.setattr(time_to_answer, "timed", lambda _: (None, (9.0, 1.5)))
    monkeypatch.setattr(time_to_answer, "pair_times", lambda *_, **__: (9.0, 0.5))
    run = {"start": 1.0, "solving": 1.5, "measuring": 2.5, "writing": 0.5}
    commands = {
        "plan": {"start": 1.0, "solving": 1.75},
        "verify": {"start": 1.0, "solving": 1.5, "measuring": 2.0},
        "run": run,
        "run --charts": run | {"drawing": 1.25},
        "report": {"start": 1.0, "drawing": 2.5},
    }
    assert time_to_answer.parts_of_commands(tmp_path, 16) == commands
    totals, parts = (
        pd.read_csv(io.StringIO(chart.csv())).set_index("series")["processor_time"]
        for chart in time_to_answer.STUDY.run(sides=(16,))
    )
    for command, times in commands.items():
        assert totals[command] == pytest.approx(2 * sum(times.values()))
        for part, time in times.items():
            assert parts[f"{command}, {part}"] == pytest.approx(2 * time)
    scene = load_case(find_named(tmp_path / "time.toml")[0], "fast")
    exact = scenes.rough_scene(4, 7, 4)
    built = scene.scene(scene.recipes[0])
    assert np.array_equal(built.surface.heights, exact.surface.heights)
    assert built.load == exact.load
