"""Identities between the parts of one result: each must hold whatever the scene is.

A method reports a result several times over: as fields, as figures of them, as a
distribution and as the steps of a load path.  These quantities are how far two of its
reports are apart.  A part that a method does not report is not compared.
"""

from __future__ import annotations

import itertools

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness.quantities.measurements import measured_carried
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.reference.layers import compliance
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray

_SAME = (
    1e-6  # share of the largest energy of a path below which a change of it is an error
)


@quantity("–")
def measured_areas(a: SolvedScene) -> float:
    """largest error of the areas that needs no reference: counts of the pressures,
    sums.

    The raw areas are counts of the points of the pressure field; total = elastic +
    plastic in the raw and the corrected areas of every load step; the mean pressures
    are those of the load path.
    """
    raw, path, steps = a.result.final.areas["raw"], a.scene.load.path, a.result.steps
    total = float((a.pressure > 0).mean())
    # J2 flow has no pressure of its own: its plastic area is that of the reported
    # states.
    plastic = float((a.field("state") == PLASTIC if a.flows else a.at_the_cap).mean())
    wrong = [raw.total - total, raw.plastic - plastic, raw.elastic - (total - plastic)]
    if len(path) != len(steps):
        method = a.result.method
        raise InvalidCase(
            f"{method} has {len(steps)} load steps for {len(path)} mean pressures"
        )
    for mean_pressure, step in zip(path, steps, strict=True):
        wrong.append((step.mean_pressure - mean_pressure) / a.load_scale)
        parts = (
            area for kind, area in step.areas.items() if kind in ("raw", "corrected")
        )
        wrong += [area.total - area.elastic - area.plastic for area in parts]
    return float(np.abs(wrong).max())


@quantity("–")
def measured_figures(a: SolvedScene) -> float:
    """largest difference of a reported mean, energy or pressure from that of the
    fields.

    Lengths are divided by the rms height, pressures by p0 and energies by p0 times the
    rms height or by the energy itself, whichever is larger.  J2 flow has no elastic
    energy at the surface.
    """
    p, height, p0 = a.pressure, a.height_scale, a.load_scale
    expected = {"largest_pressure": (float(p.max()), p0)}
    if (touching := p > 0).any():
        expected["mean_contact_pressure"] = (float(p[touching].mean()), p0)
    if "gap" in a.result.fields:
        gap = a.field("gap")
        if "plastic_displacement" in a.result.fields and not a.flows:
            sunk = a.field("plastic_displacement")
        else:
            sunk = np.where(a.at_the_cap & (not a.flows), -gap, 0)
        expected["mean_gap"] = (float(np.maximum(gap + sunk, 0).mean()), height)
        expected["mean_separation"] = (float(gap.mean()), height)
        expected["mean_plastic_displacement"] = (float(sunk.mean()), height)
        if sunk.any():
            work = a.scene.material.hardness * float(sunk.mean())
            expected["plastic_work"] = (work, p0 * height)
    if "displacement" in a.result.fields and not a.flows:
        energy = float(np.vdot(p, a.field("displacement"))) / p.size / 2
        expected["elastic_energy"] = (energy, max(p0 * height, abs(energy)))
    reported = a.result.final.quantities
    wrong = [
        (reported[k] - x) / unit for k, (x, unit) in expected.items() if k in reported
    ]
    parts = ("mean_gap", "mean_plastic_displacement", "mean_separation")
    for step in a.result.steps:  # fields show the last step only
        if all(name in step.quantities for name in parts):
            gap_left, lowered, apart = (step.quantities[name] for name in parts)
            wrong.append((gap_left - lowered - apart) / height)
    return float(np.abs(wrong).max(initial=0.0))


@quantity("–")
def measured_fields(a: SolvedScene) -> float:
    """largest error of heights, displacement, gap (over the rms height) and state.

    They follow from the pressures and the heights alone; a point in a wrong state
    counts as 1.
    """
    p, fields, height = a.pressure, a.result.fields, a.height_scale
    wrong = [0.0]
    if "heights" in fields:
        wrong.append(
            np.abs(a.field("heights") - a.scene.surface.heights).max() / height
        )
    if "displacement" in fields:
        wrong.append(np.abs(a.field("displacement") - a.displacement).max() / height)
    if "gap" in fields:
        gap, touching = a.open_gap
        missed = a.field("gap") - gap
        if a.unloads:
            missed += a.field("plastic_displacement")
        if (
            not touching.any()
        ):  # the flat may be anywhere between the points on their bounds
            missed -= missed.mean()
        wrong.append(np.abs(missed).max() / height)
    if "state" in fields:
        state = np.where(p > 0, np.where(a.at_the_cap, PLASTIC, ELASTIC), APART)
        wrong.append(float((a.field("state") != state).any()))
    return float(np.max(wrong))


@quantity("–")
def measured_distribution(a: SolvedScene) -> float:
    """largest difference of the distribution from a count of the pressures.

    The count is that of the definition of `PressureDistribution`; it is a share of the
    whole area.
    """
    found, plastic = a.distribution, a.at_the_cap & (not a.flows)
    elastic = np.sort(a.pressure[(a.pressure > 0) & ~plastic])
    counted = np.searchsorted(elastic, found.pressure, side="right") / a.pressure.size
    wrong = np.abs(found.cumulative - counted).max()
    return float(
        max(wrong, abs(found.plastic - plastic.mean()), abs(found.pressure[0]))
    )


@quantity("–")
def measured_residuals(a: SolvedScene) -> float:
    """largest relative error of the reported residuals of the gap.

    It is for a loose solve, whose residuals are far above rounding.
    """
    (gap, touching), height = a.open_gap, a.height_scale
    wrong_sign = np.where(a.pressure <= 0, -gap, gap)
    own = {
        "gap_elastic": float(np.abs(gap[touching]).max(initial=0.0)) / height,
        "gap_sign": float(wrong_sign[~touching].max(initial=0.0)) / height,
    }
    reported = a.result.final.residuals
    if missing := sorted(own.keys() - reported.keys()):
        raise InvalidCase(
            f"{a.result.method} does not report the residual {missing[0]}"
        )
    return max(abs(reported[name] - value) for name, value in own.items()) / max(
        own.values()
    )


@quantity("–", needs=())
def distribution_balance(a: SolvedScene) -> float:
    """largest error of the distribution's areas (over the contact) and of its load
    (over p0).

    The load of a table is linear between its pressures.
    """
    found, raw = a.distribution, a.result.final.areas["raw"]
    elastic = raw.total if a.flows else raw.elastic
    wrong = [found.cumulative[-1] - elastic, found.plastic - (raw.total - elastic)]
    return float(max(np.abs(wrong).max() / raw.total, abs(measured_carried(a))))


# --- along a load path
# ---------------------------------------------------------------------------


@quantity("–", needs=())
def cycle_area(a: SolvedScene) -> float:
    """total area at the last load over that when the path first had this load, less
    1.
    """
    last = a.result.final
    first = next(
        step for step in a.result.steps if step.mean_pressure == last.mean_pressure
    )
    if first is last:
        raise InvalidCase(
            "the last mean pressure of the path is not one that it had before"
        )
    if not first.areas["corrected"].total:
        raise InvalidCase(
            "the path ends at a load at which there was no contact before"
        )
    return last.areas["corrected"].total / first.areas["corrected"].total - 1


@quantity("–", needs=())
def path_work(a: SolvedScene) -> float:
    """work of the load path over the energy that it leaves, less 1; by Simpson's rule.

    The flat approaches by d = p d(q = 0) - separation, and its work int p dd is stored
    as elastic energy or spent on flow.  It is integrated by parts over the loads of
    each branch, up or down.
    """
    if len(a.result.steps) < 3:
        raise InvalidCase(
            "the work of a path is measured along three mean pressures or more"
        )
    load = np.array(a.scene.load.path)
    approach, energy = _approach_and_energy(a, load)
    left = float(energy[-1] - energy[0])
    if abs(left) <= _SAME * float(np.abs(energy).max()):
        raise InvalidCase(
            "the work of a path is measured by the energy that it leaves, but this path ends with "
            "the energy that it began with; let it end at another load"
        )
    return _work(load, approach) / left - 1


def _approach_and_energy(
    a: SolvedScene, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the approach (m) and the energy (J/m^2, stored or spent) at each load
    step.

    The work of flow is that of J2, or the hardness times the mean plastic displacement;
    where that is not reported, it is the mean gap less the separation.  The elastic
    theory reports a mean gap alone.
    """
    if a.flows:
        return _along(a, "approach"), _along(a, "stored_energy") + _along(
            a, "plastic_work"
        )
    last, hardness = a.result.final.quantities, a.scene.material.hardness
    gap, energy = _along(a, "mean_gap"), _along(a, "elastic_energy")
    theory = np.isinf(hardness) and "mean_separation" not in last
    separation = gap if theory else _along(a, "mean_separation")
    if np.isfinite(hardness):
        known = "mean_plastic_displacement" in last
        sunk = _along(a, "mean_plastic_displacement") if known else gap - separation
        energy = energy + hardness * sunk
    compressed = load * float(
        compliance(a.scene).flat[0]
    )  # of a layer, by the mean pressure
    return compressed - separation, energy


def _along(a: SolvedScene, name: str) -> FloatArray:
    """Return a figure at each load step."""
    if not all(name in step.quantities for step in a.result.steps):
        raise InvalidCase(
            f"{a.result.method} does not report {name} at every load step"
        )
    return np.array([step.quantities[name] for step in a.result.steps])


def _work(load: FloatArray, approach: FloatArray) -> float:
    """Integrate the load over the approach, branch by branch."""
    from scipy.integrate import simpson  # slow to load

    moved = np.append(True, np.diff(load) != 0)  # a load that is repeated does no work
    load, approach = load[moved], approach[moved]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load)))) + 1
    ends = [0, *turns.tolist(), load.size - 1]
    done = load[-1] * approach[-1] - load[0] * approach[0]
    for first, last in itertools.pairwise(ends):
        branch = slice(first, last + 1)
        done -= simpson(approach[branch], x=load[branch])
    return float(done)
