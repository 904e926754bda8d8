"""The distribution of the open gap by all methods, and its distance from BEM's.

    python -m laboratory.gap_distribution [--full]

Boundary and finite elements (capped, on the same grid) count the gaps of their grid
points, the contact at 0; the theory's distribution has the spectrum of each surface.
"""

import math

import numpy as np
import pandas as pd

import fem_check
from epcontact.output.charts.plot import Axis, Plot
from epcontact.persson import separation
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import Study, list_rows, mean_with_interval, tabulate
from laboratory import charts

#: Hardness over E* xi, and gaps over the rms height at which distributions are
#: compared.
HARDNESSES = (math.inf, 0.6, 0.3, 0.16)
SHOWN = (0.6, 0.16)
GAPS = np.linspace(0, 6, 601)[1:]


def cumulative(method, scene):
    """Return the fraction of the area with a gap of at most GAPS times the rms height,
    (600,).

    `method` is "persson", "bem" or "fem".
    """
    u = GAPS * scene.surface.rms_height
    if method == "persson":
        theory = paper.theory_of(scene)
        return separation.gap_distribution(theory, scene.load.final, u)[1]
    if method == "bem":
        result = paper.solve_bem(scene)
    else:
        law = "capped" if math.isfinite(scene.material.hardness) else "elastic"
        result = fem_check.solve(scene, law=law, certified=False)
    gap = np.sort(np.maximum(result.fields["gap"], 0.0), axis=None)
    return np.searchsorted(gap, u, side="right") / gap.size


def distances(table, method, reference):
    """Return the Wasserstein distance of a method's distribution of the gap from that
    of a reference method, over the reference's mean gap, with 95 % intervals.

    `table` has the cumulative areas by hardness, seed and gap. The unit of the gap
    cancels in the ratio of the two sums.
    """
    index = ["ratio", "seed", "gap_over_rms_height"]
    wide = table.pivot_table(index=index, columns="method", values="cumulative_area")
    columns = {
        "difference": (wide[method] - wide[reference]).abs(),
        "mean": 1 - wide[reference],
    }
    sums = pd.DataFrame(columns).groupby(["ratio", "seed"], sort=False).sum()
    distance = sums["difference"] / sums["mean"]
    rows = sums.assign(distance=distance).reset_index()
    return mean_with_interval(rows, "distance", ["ratio"])


def gap_distribution(say, points=4, wide=64, seeds=range(401, 405), narrow=8):
    """Distribution of the open gap by all methods, and its distance from BEM's.

    Wasserstein distances from boundary elements are over their mean gap, by hardness
    over E* xi, with 95 % intervals.
    """
    x = Axis("gap_over_rms_height", "gap over rms height (–)")
    y = Axis("cumulative_area", "fraction of the area with a smaller gap (–)")

    def row(ratio, seed, method, points, bandwidth):
        """Return rows of the distribution at GAPS by a method on one surface.

        `ratio` is the hardness over E* times the rms slope, `points` the grid points a
        shortest wave, and `bandwidth` the longest over the shortest wavelength.
        """
        scene = paper.rough_scene(points, seed, bandwidth, ratio * paper.MODULUS)
        columns = {x.column: GAPS, y.column: cumulative(method, scene)}
        return pd.DataFrame(columns).to_dict("records")

    plot = Plot(
        x,
        y,
        ("hardness", "method"),
        style="curve",
        colour="hardness",
        mark="method",
        limits={"ylim": (0, 1)},
    )
    form = "{distance:.3f} [{distance_low:.3f}, {distance_high:.3f}] at {ratio:g}"
    sizes = ((points, narrow, ("fem", "persson")), (4, wide, ("persson",)))
    for grid, bandwidth, others in sizes:
        table = tabulate(
            say,
            row,
            ratio=HARDNESSES,
            seed=seeds,
            method=("bem", *others),
            points=[grid],
            bandwidth=[bandwidth],
        )
        groups = table.groupby(["method", "ratio", x.column], sort=False)
        means = groups[y.column].mean().reset_index()
        means["hardness"] = means["ratio"].map("{:g} E* xi".format)
        listed = []
        for other in others:
            found = list_rows(distances(table, other, "bem"), form)
            listed.append(f"{other}: {found}")
        caption = (
            "How is the open gap distributed? The bandwidth is "
            f"{bandwidth}; distances by {'; '.join(listed)}."
        )
        yield plot, means[means["ratio"].isin(SHOWN)], caption


FULL = {"points": 8, "wide": 256, "seeds": range(401, 417)}
STUDY = Study("gap_distribution", gap_distribution, FULL)

if __name__ == "__main__":
    charts.save(STUDY)
