"""The laboratory of the effective hardness: it makes the map
`materials/hardness_map.csv`.

One load path of a J2 body passes every load of the map, and boundary elements capped at
a ladder of hardnesses answer each load on the same elements' compliance.  The paths are
the sweeps of `cases/hardness-map.toml`.  The effective hardness of an ensemble is the
cap under which the mean area of the capped bodies is that of the J2 bodies.  Its
inverse is used throughout, because the area of a capped body is nearly linear in it,
and because it is zero, not infinite, where elastic bodies have that area already.

`python -m laboratory.hardness_map --size large` makes the map of the package in some
four hours of one core (`fast`: a small one that shows how), and solves no path again
that `--output` holds.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pandas as pd

from epcontact.crosscheck.model_difference import (
    capped_body,
    elements_compliance,
)
from epcontact.errors import InvalidCase
from epcontact.harness.solving.saved import load_saved
from epcontact.materials.hardness_map import ERROR_COLUMNS, fit_formula, formula_terms
from epcontact.materials.moduli import effective_modulus
from epcontact.results import FloatArray
from epcontact.scene import Load
from laboratory import maps

#: Columns that name a place of the map, and those in which a check may differ from it:
#: nodes a side, shortest waves in a period, Hurst exponent, depth over the period,
#: increments.
PLACE = ["severity", "poisson_ratio", "load"]
VARIED = ["nodes", "waves", "hurst", "depth", "steps"]
#: The least standard error of a relative change between two grids, and the terms of its
#: fit.
LEAST_SCATTER = 0.004
TERMS_OF_GRID = 2
#: Bodies to 64 nodes a wave were 1.3 % off at severity 100, all that the fits of grids
#: claim.
CAUTION = 2
#: Caps over the yield stress that are tried, besides none.
LADDER = tuple(1.08**k for k in range(21))
HEADER = """\
# The effective hardness of rough J2 metals; see help(epcontact.effective_hardness).
# Made by `python -m laboratory.hardness_map --size {size}` with {versions}.
# Errors are relative, at 95 %: scatter by the surfaces of a place alone, the
# statistical one of the formula, which pools all places.
"""


def make_map(size, output, jobs=None):
    """Solve the load paths of a size ("fast" or "large") that `output` does not hold
    yet; return the map as a table, and its file.

    `jobs` is the number of processes.
    """
    areas = []
    for sweep in maps.solved("hardness-map", size, output, jobs):
        answers = ((task, load_saved(task, output)) for task in sweep.tasks)
        areas += [measured_areas(task, answer) for task, answer in answers if answer]
    made = mapped(pd.concat(areas, ignore_index=True))
    path = output / "hardness-map" / size / "hardness_map.csv"
    maps.write(path, size, HEADER, made.round(6).to_csv(index=False))
    return made, path


def measured_areas(task, j2):
    """Return a table of the raw areas of the J2 body at each load, and of capped bodies
    on the same compliance.

    `task` is the solved task and `j2` its result; the caps are multiples of the yield
    stress, from LADDER.
    """
    scene = task.case.scene(task.recipe)
    material = scene.material
    surface = scene.surface
    spectrum = surface.spectrum
    sigma_Y = material.yield_stress
    assert spectrum is not None
    compliance = elements_compliance(scene, j2)
    columns = {
        "nodes": surface.shape[0],
        "waves": round(spectrum.wavenumber_high * surface.periods[0] / (2 * math.pi)),
        "hurst": spectrum.hurst,
        "depth": _short(scene.body.depth / surface.periods[0]),
        "steps": j2.provenance.options["steps"],
        "severity": _short(effective_modulus(material) * spectrum.rms_slope / sigma_Y),
        "poisson_ratio": material.poisson_ratio,
        "seed": surface.seed,
    }
    tables = []
    for step in j2.steps:
        load = _short(step.mean_pressure / sigma_Y)
        area = step.areas["raw"].total
        # No capped body presses with more than its cap, so that the cap is at least
        # load/area.
        low = max(load, 0.9 * load / area)
        high = 2.4 * load / area
        caps = [*(cap for cap in LADDER if low < cap <= high), math.inf]
        single = replace(scene, load=Load(step.mean_pressure))
        capped = [capped_body(single, cap * sigma_Y, compliance).final for cap in caps]
        areas = [answer.areas["raw"].total for answer in capped]
        row = columns | {"load": load, "j2_area": area, "cap": caps, "cap_area": areas}
        tables.append(pd.DataFrame(row))
    return pd.concat(tables, ignore_index=True)


def _short(value):
    """Return a number rounded to nine digits, which removes the rounding error of a
    quotient.
    """
    return float(f"{value:.9g}")


#: A table of places, which are its index, and of the same places what the choice of
#: each surface adds to the error of a figure, by seed: the sum of the squares is the
#: variance of the figure.
Known = tuple[pd.DataFrame, pd.DataFrame]


def inverse_hardness(areas):
    """Find yield stress / hardness at which an ensemble under a cap has the area of its
    J2 bodies.

    `areas` are `measured_areas` of one kind of body. Returns two tables by place
    (severity, Poisson's ratio, load): one with the number of surfaces, the area of the
    J2 bodies and the inverse; the other with the jackknife's shift of the inverse by
    each surface, by seed.
    """
    rows = []
    shifts = []
    nodes = areas["nodes"].iloc[0]
    places = areas.groupby(PLACE, sort=False)
    for _, group in places:
        n = group["seed"].nunique()
        whole = _inverse(group, nodes)
        area = group.groupby("seed")["j2_area"].first().mean()
        rows.append({"surfaces": n, "area": area, "inverse": whole})
        shifts.append({})
        for seed in group["seed"].unique() if n > 1 else ():
            moved = _inverse(group[group["seed"] != seed], nodes) - whole
            shifts[-1][seed] = math.sqrt((n - 1) / n) * moved
    index = pd.MultiIndex.from_tuples([place for place, _ in places], names=PLACE)
    return pd.DataFrame(rows, index), pd.DataFrame(shifts, index).fillna(0.0)


def _inverse(bodies, nodes):
    """Return yield stress / cap under which the mean area of the capped bodies is that
    of the J2 bodies.

    `bodies` are the rows of one place, and `nodes` the number of nodes a side.
    """
    surfaces = [
        surface.sort_values("cap")[::-1] for _, surface in bodies.groupby("seed")
    ]
    # A cap as large as the load needs the whole area.
    inverse = [[*(1 / one["cap"]), 1 / one["load"].iloc[0]] for one in surfaces]
    areas = [[*one["cap_area"], 1.0] for one in surfaces]
    knots = np.unique(np.concatenate(inverse))
    capped = np.mean(
        [np.interp(knots, *known) for known in zip(inverse, areas, strict=True)], 0
    )
    wanted = float(np.mean([one["j2_area"].iloc[0] for one in surfaces]))
    # The mean area moves by whole nodes of single surfaces: both edges of a step are
    # averaged.
    half = 0.5 / (nodes**2 * len(surfaces))
    edges = np.interp(
        [wanted - half, wanted + half], np.maximum.accumulate(capped), knots
    )
    return float(edges.mean())


def changes(usual, other):
    """Compare the inverse hardness of two kinds of bodies on the surfaces that both
    have.

    `usual` and `other` are tables of `measured_areas`. Returns two tables by place: one
    with the number of surfaces, the area of the usual bodies and the relative change;
    the other with the shift of the change by each surface.
    """
    keys = [*PLACE, "seed"]
    common = usual[keys].drop_duplicates().merge(other[keys].drop_duplicates())
    one, shifts = inverse_hardness(usual.merge(common))
    two, more = (
        table.loc[one.index] for table in inverse_hardness(other.merge(common))
    )
    ratio = two["inverse"] / one["inverse"]
    shifts = shifts.mul(-ratio / one["inverse"], axis=0)
    more = more.mul(ratio / two["inverse"], axis=0)
    known = one[["area", "surfaces"]].assign(change=ratio - 1)
    return known, shifts.add(more, fill_value=0.0)


def mapped(areas):
    """Make the map from the areas of its bodies and of those that differ from them in
    one thing.

    Errors are relative and at 95 %.  The scatter of the few surfaces is pooled over all
    places of a load.  Shorter steps change all places in about the same way, so that
    their mean change is taken off; left is how it differs between places, and half of
    the mean for steps that are shorter yet. The part of the depth is all changes by it.
    The first body of `areas` is one of the map. Raises InvalidCase if a kind of
    `_kinds` or a second surface is missing.
    """
    usual, kinds = _kinds(areas)
    table, shifts = inverse_hardness(usual)
    if (table["surfaces"] == 1).any():
        raise InvalidCase(
            "a place of the map has one surface, but its scatter needs two or more"
        )
    grid, grid_error = off_the_grid(
        usual, kinds["nodes"], table, kinds.get("finer", ())
    )
    steps, depths = (
        np.concatenate([changes(usual, other)[0]["change"] for other in kinds[part]])
        for part in ("steps", "depth")
    )
    factor = (1 + grid) * (1 + steps.mean())
    made = table[["surfaces", "area"]].assign(
        inverse_hardness=table["inverse"] * factor
    )
    freedom = table["surfaces"] - 1
    square = (
        freedom * table["surfaces"] * (shifts**2).sum(axis=1) / table["inverse"] ** 2
    )
    of_load = [values.groupby("load").transform("sum") for values in (square, freedom)]
    made["scatter"] = 2 * np.sqrt(of_load[0] / of_load[1] / table["surfaces"])
    made = made.reset_index()
    made["statistical_error"] = _error_of_the_fit(made, shifts.mul(factor, axis=0))
    made["grid_error"] = grid_error
    made["steps_error"] = math.hypot(2 * steps.std(), steps.mean() / 2)
    made["depth_error"] = 2 * math.sqrt((depths**2).mean())
    return made.sort_values(["poisson_ratio", "severity", "load"], ignore_index=True)


def _kinds(areas):
    """Return the areas of the map's bodies, and lists of the other bodies' areas by the
    field of VARIED that differs.

    The key is "" for another spectrum, and "finer" for one with more nodes to the
    shortest wave. Raises InvalidCase if no body differs in nodes, steps or depth alone.
    """
    usual = areas[VARIED].iloc[0]
    kinds = dict[str, list[pd.DataFrame]]()
    for key, group in areas.groupby(VARIED):
        other = dict(zip(VARIED, key, strict=True))
        differ = [name for name, value in other.items() if value != usual[name]]
        varied = differ[0] if differ in (["nodes"], ["steps"], ["depth"]) else ""
        if (
            not varied
            and other["nodes"] / other["waves"] > usual["nodes"] / usual["waves"]
        ):
            varied = "finer"
        kinds.setdefault(varied if differ else "usual", []).append(group)
    if missing := {"nodes", "steps", "depth"} - kinds.keys():
        raise InvalidCase(
            f"no body differs from those of the map in {min(missing)} alone; solve one"
        )
    return kinds.pop("usual")[0], kinds


def off_the_grid(areas, finer, places, others=()):
    """Extrapolate the inverse hardness to a grid of vanishing spacing.

    The change by each halving of the spacing is fitted by (1 - area) area^-1/4 (k +
    l/(1 + severity/8)): it vanishes in full contact, grows as spots get smaller, and
    the last factor is that of the formula.  `areas` are on the grid of the map, `finer`
    on half the spacing and so on, `others` of other spectra, which are cheaper to solve
    with more nodes to the shortest wave. Returns for each of `places` the relative
    change of the inverse, and its error.
    """
    grids = [areas, *sorted(finer, key=lambda other: other["nodes"].iloc[0])]
    left, doubt = _share_left(grids[-1], others)
    whole = np.ones(len(places))
    moved = dict[int, FloatArray]()
    for coarse, fine in pairwise(grids):
        known, shifts = changes(coarse, fine)
        told = known["surfaces"] > 1  # a single one does not say how much it scatters
        known = known[told]
        shifts = shifts[told]
        if known.empty:
            raise InvalidCase(
                "no place of the map has two surfaces on a finer grid; solve two"
            )
        weight = _weight(shifts)
        fit = partial(_fit_at, known, weight)
        missed = (known["change"].to_numpy() - fit(known["change"], known)) * weight
        freedom = max(len(known) - TERMS_OF_GRID, 1)
        worse = max(1.0, math.sqrt(float(missed @ missed) / freedom))
        change = fit(known["change"], places)
        counted = 1 + left if fine is grids[-1] else 1.0
        whole *= 1 + counted * change
        for seed, shift in shifts.items():
            moved[seed] = moved.get(seed, 0.0) + counted * worse * fit(shift, places)
    by_surfaces = 4 * np.sum(np.square([*moved.values()]), axis=0)
    return whole - 1, CAUTION * np.sqrt((doubt * change) ** 2 + by_surfaces)


def _weight(shifts):
    """Return one over the standard error of each change (n,), from the shifts by
    surface.

    The error is at least LEAST_SCATTER, because a few surfaces that happen to agree do
    not make a place exact.
    """
    return 1 / np.hypot(np.sqrt((shifts**2).sum(axis=1)).to_numpy(), LEAST_SCATTER)


def _share_left(finest, others):
    """Return the error that the last halving of the spacing leaves, over its change,
    and the uncertainty of this ratio.

    The ratio is 1/3 for an error of second order in the spacing and 1 for first order:
    the middle is taken, with half of the range as uncertainty. Spectra in `others` with
    twice as many nodes to the shortest wave give the next change, and the same holds
    after that.
    """
    points = finest["nodes"].iloc[0] / finest["waves"].iloc[0]
    known = {other["nodes"].iloc[0] / other["waves"].iloc[0]: other for other in others}
    if not {points / 2, points, 2 * points} <= known.keys():
        return 2 / 3, 1 / 3
    before, _ = changes(known[points / 2], known[points])
    after, shifts = changes(known[points], known[2 * points])
    both = [place for place in before.index if place in after.index]
    weight = _weight(shifts.loc[both])
    first, second = (
        table["change"].loc[both].to_numpy() * weight for table in (before, after)
    )
    share = float(first @ second / (first @ first))
    missed = second - share * first
    error = 2 * math.sqrt((missed @ missed) / (first @ first) / (len(both) - 1))
    return share * 5 / 3, math.hypot(share / 3, error * 5 / 3)


def _fit_at(known, weight, change, places):
    """Fit a change by the two terms of `off_the_grid`, and return the fit at `places`,
    (n,).

    `known` has the area and the severity of the fitted places, `weight` their weights
    and `change` their relative changes.
    """

    def columns(at):
        """Return the two columns of the fit (n, 2) for a table of places: (1 - area)
        area^-1/4, and the same over 1 + severity / 8.
        """
        spots = ((1 - at["area"]) * at["area"] ** -0.25).to_numpy()
        return np.column_stack([spots, spots / (1 + at.index.get_level_values(0) / 8)])

    found, *_ = np.linalg.lstsq(
        columns(known) * weight[:, None], change * weight, rcond=None
    )
    return np.asarray(columns(places) @ found)


def _error_of_the_fit(made, shifts):
    """Return twice the relative standard error of the hardness formula at each place of
    the map, (n,).

    `made` is the map, and `shifts` what each surface shifts the inverse hardness of all
    places by.
    """
    columns = {name: made[name].to_numpy() for name in made}
    at = formula_terms(*(columns[name] for name in PLACE))
    inverse = columns["inverse_hardness"]
    ratio = at @ fit_formula(columns)[0]
    moved = [
        at @ fit_formula({**columns, "inverse_hardness": inverse + shift.to_numpy()})[0]
        - ratio
        for _, shift in shifts.items()
    ]
    return np.asarray(2 * np.sqrt(np.sum(np.square(moved), axis=0)) / ratio)


def main():
    """Make the map of a size and print the largest parts of its error."""
    options = maps.parser("hardness_map").parse_args()
    made, path = make_map(options.size, options.output, options.jobs)
    print(f"{len(made)} places of the map in {path}")
    for part in ERROR_COLUMNS:
        print(f"{part.replace('_', ' ')}: at most {100 * made[part].max():.1f} %")


if __name__ == "__main__":
    main()
