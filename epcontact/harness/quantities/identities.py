"""Identities between the parts of one result: each must hold whatever the scene is.

A method reports a result several times over: as fields, as figures of them, as a distribution and
as the steps of a load path.  These quantities are how far two of its reports are apart.  A part
that a method does not report is not compared.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness.quantities.answered import Answered, largest, mean
from epcontact.harness.quantities.measurements import carried
from epcontact.harness.quantities.registry import quantity
from epcontact.reference.layers import compliance
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray, PressureDistribution

_SAME = 1e-6  # share of the largest energy of a path below which a change of it is an error


@quantity("measured_areas", "–")
def areas(a: Answered) -> float:
    """largest error of the areas that needs no reference: counts of the pressures, sums.

    The raw areas are counts of the points of the pressure field; total = elastic + plastic in the
    raw and the corrected areas of every load step; the mean pressures are those of the load path.
    """
    final = a.result.final.areas["raw"]
    total = float((a.pressure > 0).mean())
    # J2 flow has no pressure of its own: its plastic area is that of the reported states.
    plastic = float((a.field("state") == PLASTIC if a.flows else a.at_the_cap).mean())
    wrong = [final.total - total, final.plastic - plastic, final.elastic - (total - plastic)]
    path = a.scene.load.path
    if len(path) != len(a.result.steps):
        raise InvalidCase(
            f"{a.result.method} has {len(a.result.steps)} load steps for {len(path)} mean pressures"
        )
    for mean_pressure, step in zip(path, a.result.steps, strict=True):
        wrong.append((step.mean_pressure - mean_pressure) / a.load_scale)
        parts = (area for kind, area in step.areas.items() if kind != "error")
        wrong += [area.total - area.elastic - area.plastic for area in parts]
    return float(np.abs(wrong).max())


@quantity("measured_figures", "–")
def figures(a: Answered) -> float:
    """largest difference of a reported mean, energy or pressure from that of the fields.

    Lengths are divided by the rms height, pressures by p0 and energies by p0 times the rms height
    or by the energy itself, whichever is larger.  J2 flow has no elastic energy at the surface.
    """
    p, height, p0 = a.pressure, a.scene.surface.rms_height, a.load_scale
    reported = a.result.final.quantities
    expected = {"largest_pressure": (float(p.max()), p0)}
    if "mean_contact_pressure" in reported and (p > 0).any():
        expected["mean_contact_pressure"] = (float(p[p > 0].mean()), p0)
    if "gap" in a.result.fields:
        gap = a.field("gap")
        if "plastic_displacement" in a.result.fields and not a.flows:
            sunk = a.field("plastic_displacement")
        else:
            sunk = np.where(a.at_the_cap & (not a.flows), -gap, 0)
        expected["mean_gap"] = (mean(lambda g, w: np.maximum(g + w, 0), gap, sunk), height)
        expected["mean_separation"] = (float(gap.mean()), height)
        expected["mean_plastic_displacement"] = (float(sunk.mean()), height)
        if sunk.any():
            work = a.scene.material.hardness * float(sunk.mean())
            expected["plastic_work"] = (work, p0 * height)
    if "displacement" in a.result.fields and not a.flows:
        energy = mean(np.multiply, p, a.field("displacement")) / 2
        expected["elastic_energy"] = (energy, max(p0 * height, abs(energy)))
    wrong = [
        (reported[name] - x) / unit for name, (x, unit) in expected.items() if name in reported
    ]
    parts = ("mean_gap", "mean_plastic_displacement", "mean_separation")
    for step in a.result.steps:  # fields show the last step only
        if all(name in step.quantities for name in parts):
            gap_left, lowered, apart = (step.quantities[name] for name in parts)
            wrong.append((gap_left - lowered - apart) / height)
    return float(np.abs(wrong).max(initial=0.0))


@quantity("measured_fields", "–")
def fields(a: Answered) -> float:
    """largest error of heights, displacement, gap (over the rms height) and state.

    They follow from the pressures and the heights alone; a point in a wrong state counts as 1.
    """
    heights, found = a.scene.surface.heights, a.result.fields
    height = a.scene.surface.rms_height
    wrong = []
    if "heights" in found:
        wrong.append(largest(_distance, a.field("heights"), heights) / height)
    if "displacement" in found:
        wrong.append(largest(_distance, a.field("displacement"), a.displacement) / height)
    if "gap" in found:
        own, touching = a.open_gap
        reported = a.field("gap")
        if a.unloads:
            reported = reported + a.field("plastic_displacement")
        if not touching.any():  # the flat may be anywhere between the points on their bounds
            own = own + mean(np.subtract, reported, own)
        wrong.append(largest(_distance, reported, own) / height)
    if "state" in found:
        wrong.append(largest(_wrong_state, a.field("state"), a.pressure, a.at_the_cap))
    return float(max(wrong, default=0.0))


def _distance(one: Any, other: Any) -> Any:
    return np.abs(one - other)


def _wrong_state(state: Any, p: Any, at_the_cap: Any) -> Any:
    return state != np.where(p > 0, np.where(at_the_cap, PLASTIC, ELASTIC), APART)


def _distribution(a: Answered) -> PressureDistribution:
    if a.result.distribution is None:
        raise InvalidCase(f"{a.result.method} gives no pressure distribution for a gate")
    return a.result.distribution


@quantity("measured_distribution", "–")
def distribution(a: Answered) -> float:
    """largest difference of the distribution from a count of the pressures.

    The count is that of the definition of `PressureDistribution`; it is a share of the whole area.
    """
    found = _distribution(a)
    plastic = a.at_the_cap & (not a.flows)
    elastic = np.sort(a.pressure[(a.pressure > 0) & ~plastic])
    counted = np.searchsorted(elastic, found.pressure, side="right") / a.pressure.size
    wrong = np.abs(found.cumulative - counted).max()
    return float(max(wrong, abs(found.plastic - plastic.mean()), abs(found.pressure[0])))


@quantity("measured_residuals", "–")
def residuals(a: Answered) -> float:
    """largest relative error of the reported residuals of the gap.

    It is for a loose solve, whose residuals are far above rounding.
    """
    gap, touching = a.open_gap
    rest, height = ~touching, a.scene.surface.rms_height
    wrong_sign = np.where(a.pressure <= 0, -gap, gap)
    own = {
        "gap_elastic": float(np.abs(gap[touching]).max(initial=0.0)) / height,
        "gap_sign": float(wrong_sign[rest].max(initial=0.0)) / height,
    }
    reported = a.result.final.residuals
    missing = sorted(own.keys() - reported.keys())
    if missing:
        raise InvalidCase(f"{a.result.method} does not report the residual {missing[0]}")
    scale = max(own.values())
    return max(abs(reported[name] - value) for name, value in own.items()) / scale


@quantity("distribution_balance", "–", needs=())
def balance(a: Answered) -> float:
    """largest error of the distribution's areas (over the contact) and of its load (over p0).

    The load of a table is linear between its pressures.
    """
    found, raw = _distribution(a), a.result.final.areas["raw"]
    elastic = raw.total if a.flows else raw.elastic
    wrong = [found.cumulative[-1] - elastic, found.plastic - (raw.total - elastic)]
    return float(max(np.abs(wrong).max() / raw.total, abs(carried(a))))


@quantity("path_work", "–", needs=())
def work(a: Answered) -> float:
    """work of the load path over the energy that it leaves, less 1; by Simpson's rule.

    The flat approaches by d = p d(q = 0) - separation, and its work int p dd is stored as elastic
    energy or spent on flow.  It is integrated by parts over the loads of each branch, up or down.
    """
    if len(a.result.steps) < 3:
        raise InvalidCase("the work of a path is measured along three mean pressures or more")
    load = np.array(a.scene.load.path)
    approach, energy = _flowing_path(a) if a.flows else _capped_path(a, load)
    left = float(energy[-1] - energy[0])
    if abs(left) <= _SAME * float(np.abs(energy).max()):
        raise InvalidCase(
            "the work of a path is measured by the energy that it leaves, but this path ends with "
            "the energy that it began with; let it end at another load"
        )
    return _work(load, approach) / left - 1


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


@quantity("cycle_area", "–", needs=())
def cycle(a: Answered) -> float:
    """total area at the last load over that when the path first had this load, less 1."""
    last = a.result.final
    first = next(step for step in a.result.steps if step.mean_pressure == last.mean_pressure)
    if first is last:
        raise InvalidCase("the last mean pressure of the path is not one that it had before")
    if not first.areas["corrected"].total:
        raise InvalidCase("the path ends at a load at which there was no contact before")
    return last.areas["corrected"].total / first.areas["corrected"].total - 1


def _flowing_path(a: Answered) -> tuple[FloatArray, FloatArray]:
    """Approach (m) and energy (J/m^2, stored or spent) of a J2 body at each load step."""
    return _along(a, "approach"), _along(a, "stored_energy") + _along(a, "plastic_work")


def _capped_path(a: Answered, load: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Approach (m) and energy (J/m^2, stored or spent) of an elastic or capped body.

    The work of flow is the hardness times the mean plastic displacement or, where that is not
    reported, the mean gap less the separation.  The elastic theory reports a mean gap alone.
    """
    last, hardness = a.result.final.quantities, a.scene.material.hardness
    gap, energy = _along(a, "mean_gap"), _along(a, "elastic_energy")
    theory = np.isinf(hardness) and "mean_separation" not in last
    separation = gap if theory else _along(a, "mean_separation")
    if np.isfinite(hardness):
        known = "mean_plastic_displacement" in last
        sunk = _along(a, "mean_plastic_displacement") if known else gap - separation
        energy = energy + hardness * sunk
    compressed = load * float(compliance(a.scene).flat[0])  # of a layer, by the mean pressure
    return compressed - separation, energy


def _along(a: Answered, name: str) -> FloatArray:
    """Return a figure at each load step."""
    if not all(name in step.quantities for step in a.result.steps):
        raise InvalidCase(f"{a.result.method} does not report {name} at every load step")
    return np.array([step.quantities[name] for step in a.result.steps])
