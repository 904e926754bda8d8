"""Identities between the parts of one result: each must hold whatever the scene is.

A method reports the same result in several forms: as fields, as values that follow from
the fields, as a distribution and as the steps of a load path.  These quantities are the
differences of two of these forms.  A form that a method does not report is not
compared.
"""

from __future__ import annotations

import itertools

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness.quantities.measurements import measured_carried
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene, row_blocks
from epcontact.reference.layers import compliance
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray

#: Fraction of the largest energy of a path: a smaller change of the energy is an error
#: of rounding.
_SAME = 1e-6


@quantity("–")
def measured_areas(solved: SolvedScene) -> float:
    """largest error of the areas that needs no reference: counts of the pressures,
    sums.

    The raw areas are counts of the points of the pressure field; total = elastic +
    plastic in the raw and the corrected areas of every load step; the mean pressures
    are those of the load path.  The raw areas that a solver from outside the package
    reports are compared with the counts, too.
    """
    path, steps = solved.scene.load.path, solved.result.steps
    if len(path) != len(steps):
        raise InvalidCase(
            f"{solved.result.method} has {len(steps)} load steps for {len(path)} mean "
            "pressures"
        )
    raw = solved.result.final.areas["raw"]
    total = float((solved.pressure > 0).mean())
    plastic_points = solved.at_the_cap
    if solved.flows:  # no pressure shows J2 flow: the states that are reported do
        plastic_points = solved.field("state") == PLASTIC
    plastic = float(plastic_points.mean())
    errors = [
        raw.total - total,
        raw.plastic - plastic,
        raw.elastic - (total - plastic),
    ]
    reported = solved.result.final.quantities
    for part, area in vars(raw).items():
        errors.append(reported.get(f"reported_{part}_area", area) - area)
    for mean_pressure, step in zip(path, steps, strict=True):
        errors.append((step.mean_pressure - mean_pressure) / solved.load_scale)
        for kind, area in step.areas.items():
            if kind in ("raw", "corrected"):
                errors.append(area.total - area.elastic - area.plastic)
    return float(np.abs(errors).max())


@quantity("–")
def measured_figures(solved: SolvedScene) -> float:
    """largest difference of a reported mean, energy or pressure from that of the
    fields.

    Lengths are divided by the rms height, pressures by p0 and energies by p0 times the
    rms height or by the energy itself, whichever is larger.  J2 flow has no elastic
    energy at the surface.  Of a solver from outside the package, what it reported
    itself is compared.
    """
    pressure, height, p0 = solved.pressure, solved.height_scale, solved.load_scale
    fields = solved.result.fields
    # Value and scale of each quantity, as they follow from the fields.
    expected = {"largest_pressure": (float(pressure.max()), p0)}
    touching = pressure > 0
    if touching.any():
        mean = float(pressure[touching].mean())
        expected["mean_contact_pressure"] = (mean, p0)
    if "gap" in fields:
        expected |= _expected_of_gap(solved)
    if "displacement" in fields and not solved.flows:
        work = float(np.vdot(pressure, solved.field("displacement")))
        energy = work / pressure.size / 2
        expected["elastic_energy"] = (energy, max(p0 * height, abs(energy)))
    reported = solved.result.final.quantities
    errors = [
        (reported.get(f"reported_{name}", reported[name]) - value) / scale
        for name, (value, scale) in expected.items()
        if name in reported
    ]
    parts = ("mean_gap", "mean_plastic_displacement", "mean_separation")
    for step in solved.result.steps:  # fields show the last step only
        if all(name in step.quantities for name in parts):
            gap, lowered, separation = (step.quantities[name] for name in parts)
            errors.append((gap - lowered - separation) / height)
    return float(np.abs(errors).max(initial=0.0))


def _expected_of_gap(solved: SolvedScene) -> dict[str, tuple[float, float]]:
    """Return the quantities that follow from the fields of the gap and the pressure.

    Returns:
        By the name of the quantity, its value (m; the plastic work in J/m²) and the
        scale by which its error is divided, in the same unit.
    """
    gap, height = solved.field("gap"), solved.height_scale
    reported = None
    if "plastic_displacement" in solved.result.fields:
        reported = solved.field("plastic_displacement")
    sum_open = 0.0
    sum_lowered = 0.0
    is_lowered = False
    for block in row_blocks(gap):
        if solved.flows:
            lowered = np.zeros(gap[block].shape)
        elif reported is not None:
            lowered = reported[block]
        else:
            lowered = np.where(solved.at_the_cap[block], -gap[block], 0.0)
        sum_open += float(np.maximum(gap[block] + lowered, 0).sum())
        sum_lowered += float(lowered.sum())
        is_lowered |= bool(lowered.any())
    mean_lowered = sum_lowered / gap.size
    expected = {
        "mean_gap": (sum_open / gap.size, height),
        "mean_separation": (float(gap.mean()), height),
        "mean_plastic_displacement": (mean_lowered, height),
    }
    if is_lowered:
        work = solved.scene.material.hardness * mean_lowered
        expected["plastic_work"] = (work, solved.load_scale * height)
    return expected


@quantity("–")
def measured_fields(solved: SolvedScene) -> float:
    """largest error of state, and of heights, displacement, gap over the rms height.

    They follow from the pressures and the heights alone; a point in a wrong state
    counts as 1.
    """
    fields, height = solved.result.fields, solved.height_scale
    errors = [0.0]
    if "heights" in fields:
        heights = solved.scene.surface.heights
        errors.append(_largest_difference(solved.field("heights"), heights) / height)
    if "displacement" in fields:
        displacement = solved.field("displacement")
        difference = _largest_difference(displacement, solved.displacement)
        errors.append(difference / height)
    if "gap" in fields:
        gap, touching = solved.open_gap
        if solved.unloads:
            gap = gap - solved.field("plastic_displacement")
        if not touching.any():
            # The flat may be anywhere between the points on their bounds.
            gap = gap + (solved.field("gap") - gap).mean()
        errors.append(_largest_difference(solved.field("gap"), gap) / height)
    if "state" in fields:
        state = np.full(solved.pressure.shape, APART, dtype=np.int8)
        np.copyto(state, ELASTIC, where=solved.pressure > 0)
        np.copyto(state, PLASTIC, where=(solved.pressure > 0) & solved.at_the_cap)
        errors.append(float((solved.field("state") != state).any()))
    return float(np.max(errors))


def _largest_difference(first: FloatArray, second: FloatArray) -> float:
    """Return the largest absolute difference of two fields, NaN if one has a NaN.

    first, second: (nx, ny) or (nx,), of the same unit.
    """
    if first is second:
        return 0.0
    largest = [np.abs(first[rows] - second[rows]).max() for rows in row_blocks(first)]
    return float(np.max(largest))


@quantity("–")
def measured_distribution(solved: SolvedScene) -> float:
    """largest difference of the distribution from a count of the pressures.

    The count is that of the definition of `PressureDistribution`; it is a fraction of
    the nominal area.
    """
    pressure, reported = solved.pressure, solved.distribution
    plastic = solved.at_the_cap & (not solved.flows)
    elastic = np.sort(pressure[(pressure > 0) & ~plastic])
    counts = np.searchsorted(elastic, reported.pressure, side="right")
    errors = [
        np.abs(reported.cumulative - counts / pressure.size).max(),
        abs(reported.plastic - plastic.mean()),
        abs(reported.pressure[0]),
    ]
    return float(max(errors))


@quantity("–")
def measured_residuals(solved: SolvedScene) -> float:
    """largest relative error of the reported residuals of the gap.

    It is for a loose solve, whose residuals are far above rounding.
    """
    (gap, touching), height = solved.open_gap, solved.height_scale
    wrong_sign = np.where(solved.pressure <= 0, -gap, gap)
    residuals = {
        "gap_elastic": float(np.abs(gap[touching]).max(initial=0.0)) / height,
        "gap_sign": float(wrong_sign[~touching].max(initial=0.0)) / height,
    }
    reported = solved.result.final.residuals
    missing = sorted(residuals.keys() - reported.keys())
    if missing:
        raise InvalidCase(
            f"{solved.result.method} does not report the residual {missing[0]}"
        )
    errors = [abs(reported[name] - value) for name, value in residuals.items()]
    return max(errors) / max(residuals.values())


@quantity("–", needs=())
def distribution_balance(solved: SolvedScene) -> float:
    """largest error of the distribution's areas (over the contact) and of its load
    (over p0).

    The load of a table is linear between its pressures.
    """
    reported, raw = solved.distribution, solved.result.final.areas["raw"]
    elastic = raw.total if solved.flows else raw.elastic
    plastic = raw.total - elastic
    errors = [reported.cumulative[-1] - elastic, reported.plastic - plastic]
    area_error = np.abs(errors).max() / raw.total
    return float(max(area_error, abs(measured_carried(solved))))


# --- along a load path


@quantity("–", needs=())
def cycle_area(solved: SolvedScene) -> float:
    """total area at the last load over that when the path first had this load, less
    1.
    """
    steps, last = solved.result.steps, solved.result.final
    first = next(step for step in steps if step.mean_pressure == last.mean_pressure)
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
def path_work(solved: SolvedScene) -> float:
    """work of the load path over the energy that it leaves, less 1; by Simpson's rule.

    The flat approaches by d = p d(q = 0) - separation, and its work int p dd is stored
    as elastic energy or spent on flow.  It is integrated by parts over the loads of
    each branch, up or down.
    """
    if len(solved.result.steps) < 3:
        raise InvalidCase(
            "the work of a path is measured along three mean pressures or more"
        )
    load = np.array(solved.scene.load.path)
    approach, energy = _approach_and_energy(solved, load)
    left = float(energy[-1] - energy[0])
    if abs(left) <= _SAME * float(np.abs(energy).max()):
        raise InvalidCase(
            "the work of a path is measured by the energy that it leaves, but this "
            "path "
            "ends with the energy that it began with; let it end at another load"
        )
    return _work(load, approach) / left - 1


def _approach_and_energy(
    solved: SolvedScene, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the approach and the energy at each load step of a path.

    The energy is that stored elastically and that spent on flow.  The work of flow is
    that of J2, or the hardness times the mean plastic displacement.  If this
    displacement is not reported, it is the mean gap minus the separation.  The elastic
    theory reports a mean gap alone.

    Args:
        solved: the scene and its result.
        load: the mean pressure of each load step, in Pa.

    Returns:
        The approach of the flat in m and the energy in J/m², two arrays of the shape of
        `load`.

    Raises:
        InvalidCase: if a load step lacks one of the quantities.
    """
    if solved.flows:
        stored = _along(solved, "stored_energy")
        return _along(solved, "approach"), stored + _along(solved, "plastic_work")
    reported = solved.result.final.quantities
    hardness = solved.scene.material.hardness
    gap = _along(solved, "mean_gap")
    energy = _along(solved, "elastic_energy")
    is_theory = np.isinf(hardness) and "mean_separation" not in reported
    separation = gap if is_theory else _along(solved, "mean_separation")
    if np.isfinite(hardness):
        lowered = gap - separation
        if "mean_plastic_displacement" in reported:
            lowered = _along(solved, "mean_plastic_displacement")
        energy = energy + hardness * lowered
    # A layer is compressed by the mean pressure.
    compression = load * float(compliance(solved.scene).flat[0])
    return compression - separation, energy


def _along(solved: SolvedScene, name: str) -> FloatArray:
    """Return a quantity at each load step of a result, as an array in its unit.

    `name` is that in `LoadStep.quantities`.  Raises InvalidCase if a step lacks it.
    """
    steps = solved.result.steps
    if not all(name in step.quantities for step in steps):
        raise InvalidCase(
            f"{solved.result.method} does not report {name} at every load step"
        )
    return np.array([step.quantities[name] for step in steps])


def _work(load: FloatArray, approach: FloatArray) -> float:
    """Return the work of a load path in J/m²: the integral of the load over the
    approach.

    It is integrated by parts, with Simpson's rule on each branch of rising or falling
    load.

    Args:
        load: the mean pressure of each load step, in Pa.
        approach: the approach of the flat at each load step, in m.
    """
    from scipy.integrate import simpson  # slow to load

    moved = np.append(True, np.diff(load) != 0)  # a repeated load does no work
    load, approach = load[moved], approach[moved]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load)))) + 1
    ends = [0, *turns.tolist(), load.size - 1]
    work = load[-1] * approach[-1] - load[0] * approach[0]
    for first, last in itertools.pairwise(ends):
        branch = slice(first, last + 1)
        work -= simpson(approach[branch], x=load[branch])
    return float(work)
