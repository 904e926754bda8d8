"""How the pressures move when the next waves of a surface are added.

    python -m laboratory.walls [--full]

The theory lets the pressure of a point diffuse at one rate, without drift, until it is
absorbed at zero or at the hardness, its two walls.  Here the same surface is solved
without and with its last ring of waves, weakened to a fraction w of its power and with
either sign, so that odd effects of the ring cancel.  With dG, what the ring adds to G
in full contact, and d, the change of a point's pressure, points of pressure sigma have
the diffusion <d^2>/(2 dG) (1 in full contact) and the drift <d>/dG.

Any change of P that keeps the load is one without drift, between absorbing walls, by

    dP/dG = d^2(S P)/dsigma^2,    S P = dM/dG,    M(sigma) = <max(p - sigma, 0)>,

because M'' = P.  This S is the only one that a theory needs, and it has a limit for
weak rings, which diffusion and drift near the walls do not have: the front of a contact
moves as the root of w.
"""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.harness.gates import estimate
from epcontact.output.charts.plot import Axis, Plot
from epcontact.persson import near_bounds
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import Study
from epcontact.surfaces import filtered
from laboratory import charts

#: The ring is the last of so many parts of the wave numbers; fractions w of its power.
PARTS = 16
FRACTIONS = (1.0, 1 / 4, 1 / 16)
#: p0 and hardness over E* xi, with the slope xi without the ring.
PLACES = [(p, h) for h in (0.3, 0.6, 1.2) for p in (0.02, 0.1, 0.25)]
PLACES += [(p, math.inf) for p in (0.02, 0.1, 0.4)]
#: The load and the hardness that charts show.
SHOWN_LOAD = 0.1
SHOWN_HARDNESS = 1.2
#: Intervals of the pressure, to the hardness or three times E* xi, and the fewest
#: points of an interval whose mean is shown.
BINS = 20
FEWEST = 30
_X = Axis("relative_pressure", r"contact pressure $\sigma / (E^* \xi)$ (–)")
_ROOT = Axis("root_of_step", r"root of the step, $\sqrt{\Delta G / G}$ (–)")


def mean_excess(pressure, sigma):
    """Return the mean of max(p - sigma, 0) over the field `pressure`, at each of the
    pressures `sigma` (n,).
    """
    return np.array([np.maximum(pressure - s, 0).mean() for s in sigma])


def bin_edges(hardness):
    """Return the ends (BINS + 1,) of the intervals of pressure, which are dense next to
    zero pressure and the hardness.
    """
    angle = np.pi * np.arange(BINS + 1) / BINS
    if math.isinf(hardness):
        return 3 - 3 * np.cos(angle / 2)
    return hardness / 2 * (1 - np.cos(angle))


def returned(before, after):
    """Return the number of points that come back to a bound over that of the points
    that leave it, as the mean over the fields in `after`.

    `before` and each of `after` are masks of the points at the bound (zero pressure or
    the hardness); None if no point leaves.
    """
    gone = np.mean([(mask & ~before).mean() for mask in after])
    back = np.mean([(before & ~mask).mean() for mask in after])
    return back / gone if gone else None


def steps(seed, bandwidth, place, points, fractions):
    """Solve one surface without its shortest waves, and with these waves added at
    several strengths.

    Args:
        seed: seed of the rough surface.
        bandwidth: longest over shortest wavelength.
        place: mean pressure and hardness, both over E* times the rms slope.
        points: grid points a shortest wave.
        fractions: variances of the added waves over their full variance.

    Returns a table of the fraction of points that return to each bound (zero pressure
    or the hardness), and a table of the drift and the diffusion of elastic pressures by
    intervals of pressure.
    """
    complete = paper.rough_scene(points, seed, bandwidth).surface
    base = filtered(complete, (1 - 1 / PARTS) * bandwidth * paper.LOWEST)
    ring = complete.heights - base.heights
    before = persson.roughness_of(base, "surface").rms_slope ** 2
    after = persson.roughness_of(complete, "surface").rms_slope ** 2
    p0, hardness = place
    unit = paper.MODULUS * before**0.5
    body = Material(paper.MODULUS, 0.0, hardness * unit)
    cap = hardness * (1 - 1e-12)

    def solve(strength):
        """Return the pressures over E* times the rms slope, with the added waves
        multiplied by `strength`.
        """
        surface = replace(base, heights=base.heights + strength * ring)
        result = bem.solve(Scene(surface, body, Load(p0 * unit)))
        return result.fields["pressure"] / unit

    p = solve(0.0)
    edges = bin_edges(hardness)
    middle = (edges[1:] + edges[:-1]) / 2
    elastic = (p > 0) & (p < cap)
    bins = np.searchsorted(edges, p[elastic], side="right") - 1
    bins = np.minimum(bins, BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    density = np.maximum(count, 1) / p.size / np.diff(edges)
    flows = []
    tables = []
    for fraction in fractions:
        signs = (1, -1)
        changed = [solve(sign * math.sqrt(fraction)) for sign in signs]
        step = fraction * (after / before - 1)
        dG = step / 8
        columns = {
            "seed": seed,
            "bandwidth": bandwidth,
            "p0": p0,
            "hardness": hardness,
            "w": fraction,
            "step": f"ΔG/G = {100 * step:.2g} %",
            _ROOT.column: round(math.sqrt(step), 6),
        }
        at_zero = returned(p <= 0, [q <= 0 for q in changed])
        at_hardness = returned(p >= cap, [q >= cap for q in changed])
        for wall, ratio in (("at zero", at_zero), ("at hardness", at_hardness)):
            if ratio is not None:
                flows.append(columns | {"wall": wall, "returned": ratio})
        d = np.array([q[elastic] - p[elastic] for q in changed])
        drift = np.bincount(bins, d.mean(axis=0), BINS) / np.maximum(count, 1) / dG
        square = np.bincount(bins, (d**2).mean(axis=0), BINS) / np.maximum(count, 1)
        excess = np.mean([mean_excess(q, middle) for q in changed], axis=0)
        change = excess - mean_excess(p, middle)
        table = pd.DataFrame(
            {
                _X.column: middle,
                "diffusion": square / dG / 2,
                "drift": drift,
                "reduction": change / dG / density,
            }
        )
        tables.append(table[count >= FEWEST].assign(**columns))
    return pd.DataFrame(flows), pd.concat(tables)


def limits(flows):
    """Return a table of the returned fraction for vanishing added waves, at each bound
    of the pressure, with its 95 % half-width.

    For each surface it is the intercept of a line over the square root of the added
    variance.
    """
    keys = ["hardness", "p0", "bandwidth", "wall"]
    rows = []
    for place, group in flows.groupby(keys, sort=False):
        table = group.pivot(index="seed", columns="w", values="returned").dropna()
        if len(table) > 1:
            roots = np.sqrt(table.columns)
            ends = [np.polyfit(roots, row, 1)[1] for row in table.to_numpy()]
            limit = estimate(ends)
            rows.append((*place, limit.mean, limit.half_width))
    return pd.DataFrame(rows, columns=[*keys, "limit", "half_width"])


def walls(say, bandwidths=(16,), seeds=range(1, 9), points=8):
    """How pressures move as waves are added.

    They add ΔG to G, half the pressures' variance in full contact.  Load 0.1 E* xi,
    hardness in E* xi.
    """
    all_flows = []
    all_tables = []
    for bandwidth, place, seed in product(bandwidths, PLACES, seeds):
        say(f"bandwidth {bandwidth}, p0 and hardness {place} E* xi, seed {seed}")
        flows, table = steps(seed, bandwidth, place, points, FRACTIONS)
        all_flows.append(flows)
        all_tables.append(table)
    flows = pd.concat(all_flows, ignore_index=True)
    table = pd.concat(all_tables, ignore_index=True)
    ends = limits(flows)
    known = ends[ends["half_width"] < 0.1]["limit"]
    bodies = {h: f"hardness {h:g}" for h in (0.3, 0.6, 1.2)}

    def select(rows):
        """Return the rows of the widest band at the shown load, with a column `body`
        that names the hardness.
        """
        widest = rows["bandwidth"] == max(bandwidths)
        shown = rows[widest & (rows["p0"] == SHOWN_LOAD)]
        return shown.assign(body=shown["hardness"].map(bodies).fillna("no hardness"))

    caption = "Do more points return through a wall in weaker steps?"
    if len(known):
        caption += (
            f" Limits are {known.min():.2f} to {known.max():.2f} at the {len(known)} "
            f"of {len(ends)} walls that are known to 0.1."
        )
    y = Axis("returned", "points that return over those that go (–)")
    plot = Plot(
        _ROOT,
        y,
        ("body", "wall"),
        level=1.0,
        colour="body",
        mark="wall",
        limits={"ylim": (0.5, 1.1)},
    )
    yield plot, select(flows), caption

    table = select(table).sort_values(["hardness", _X.column], kind="stable")
    near = table[table["hardness"] == SHOWN_HARDNESS]
    note = f"d: a point's change of pressure; hardness {SHOWN_HARDNESS:g}"
    for name, label, level in (
        ("diffusion", r"diffusion $\langle d^2 \rangle / 2 \Delta G$ (–)", 1.0),
        ("drift", r"drift $\langle d \rangle E^* \xi / \Delta G$ (–)", 0.0),
    ):
        caption = f"Does the {name} near the walls grow as the step shrinks? {note}."
        yield Plot(_X, Axis(name, label), ("step",), level=level), near, caption

    y = Axis("reduction", "reduction S without drift (–)")
    ranges = {"ylim": (0, 1.2), "xlim": (0, 1.5)}
    plot = Plot(
        _X, y, ("body", "source"), level=paper.GAMMA, limits=ranges, colour="body"
    )
    caption = (
        "Which reduction S gives the distribution? It rises away from the walls; "
        "marks: measured, curves: the rule near_bounds, dotted: gamma = 0.536."
    )
    measured = table[table["w"] == max(FRACTIONS)]
    keys = ["hardness", "p0", "bandwidth", _X.column]
    measured = measured.groupby(keys, as_index=False)["reduction"].mean()
    measured = measured.assign(source="measured", style="marks")
    places = [place for place in PLACES if place[0] == SHOWN_LOAD]
    rules = [rule_reduction(max(bandwidths), place) for place in places]
    yield plot, select(pd.concat([measured, *rules])), caption


def rule_reduction(bandwidth, place):
    """Return a table of the reduction S by the rule "near_bounds" against the pressure.

    The surface is that of `steps` without its shortest waves; S is taken at the areas
    that the rule's own diffusion equation gives.

    Args:
        bandwidth: longest over shortest wavelength.
        place: mean pressure and hardness, both over E* times the rms slope.
    """
    p0, hardness = place
    shortest = (1 - 1 / PARTS) * bandwidth * paper.LOWEST
    spectrum = SelfAffineSpectrum(0.8, paper.LOWEST, 4 * paper.LOWEST, shortest, 1.0)
    roughness = persson.analytic_roughness(spectrum)
    variance, breadth = near_bounds.relative_wavenumbers(roughness)
    end = near_bounds.integrate(variance / 8, breadth, p0, hardness).areas
    edges = bin_edges(hardness)
    pressure = np.linspace(0.02, 0.98, 99) * edges[-1]
    reduction = near_bounds.energy_reduction_at(
        pressure, hardness, 0.5, breadth[-1], end.plastic, end.separated
    )
    columns = {"p0": p0, "hardness": hardness, "bandwidth": bandwidth}
    table = pd.DataFrame({_X.column: pressure, "reduction": reduction})
    return table.assign(**columns, source="rule", style="curve")


STUDY = Study("walls", walls, {"bandwidths": (16, 32, 64), "seeds": range(1, 17)})

if __name__ == "__main__":
    charts.save(STUDY)
