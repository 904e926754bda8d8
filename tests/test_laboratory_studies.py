"""Studies of the laboratories: each runs at a small size, and its finding holds."""

import math

import numpy as np
import pandas as pd
import pytest
from laboratory import gap_distribution, hysteresis, persistence, rough_body, walls

from epcontact.studies.frame import tabulate

#: Each study with options of a few seconds, the number of its charts and the mean of
#: the numbers in the last.
SMALL = (
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
