"""Charts of the study of the mean gap; what they show is defined in `gap`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.output.charts.style import CYCLE
from epcontact.results import FloatArray
from epcontact.studies import paper_scene as scenes
from epcontact.studies.gap import CONSTRAINT, LAWS, LOADS, NAMES, OPEN, Blocks, Gaps

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart


_COLOURS = {"capped": CYCLE[0], "elastic": CYCLE[1], "j2": CYCLE[2]}
_PRESSURE = r"mean pressure over $E^*$ (–)"
_GAP = "mean gap over rms height (–)"


def draw_gaps(found: Gaps) -> tuple[Chart, Chart, Chart]:
    """Open gap of theory and boundary elements, parts of the capped one, deviation."""
    surfaces = found.found["capped"][OPEN].shape[0]
    told = (
        f"{surfaces} surfaces of the paper's roughness, 1/{found.bandwidth} of the longest wave "
        f"being the shortest, {found.points:g} grid points a shortest wave, E* xi = E*, and "
        f"hardness {scenes.HARDNESS / scenes.MODULUS:g} E* or none; the paper's load is 0.05 E*"
    )
    grid = ", ".join(f"{100 * e:.2g} % {law}" for law, e in found.grid_error.items())
    series = []
    for law in LAWS:
        series += [
            Series(f"persson, {law}", found.curve_loads, found.theory[law], line=True),
            _banded(f"bem, {law}", found.loads, found.found[law][OPEN]),
        ]
    parts = [_banded(name, found.loads, found.found["capped"][k]) for k, name in NAMES.items()]
    deviations = []
    for law in LAWS:
        mean, width = (100 * array for array in found.deviation(law))
        deviations.append(Series(law, found.loads, mean, mean - width, mean + width))
    shares = _listed(found.loads, 100 * found.plastic_share, ".2g", " %")
    return (
        _chart(
            series,
            "open " + _GAP,
            "gap_over_rms_height",
            f"Mean open gap against mean pressure of {told}. Boundary elements: mean of max(g, 0) "
            "with its 95 % interval; theory: its mean separation with gamma = "
            f"{scenes.GAMMA} and the spectrum of the same surfaces. On a grid twice as fine the "
            f"open gap of the first surface changes by at most {grid}.",
            log="xy",
        ),
        _chart(
            parts,
            _GAP,
            "length_over_rms_height",
            f"Parts of the mean gap of the capped body by boundary elements, {told}. The gap g is "
            "that to the elastically deformed surface, negative where it has flowed: open gap = "
            "mean of max(g, 0), plastic displacement = mean of max(-g, 0), separation = mean of g "
            "= open gap - plastic displacement, exactly. The work of the load is the elastic "
            "energy plus hardness times plastic displacement; of it the plastic part is, by "
            f"load over E*: {shares}.",
        ),
        _chart(
            deviations,
            "theory over boundary elements, less 1 (%)",
            "deviation_percent",
            f"Deviation of the theory's open gap from that of boundary elements, {told}, mean "
            f"with its 95 % interval. {_deviations_told(found)}",
            level=0.0,
        ),
    )


def _banded(name: str, loads: FloatArray, rows: FloatArray) -> Series:
    mean, width = np.array([scenes.mean_and_half_width(column) for column in rows.T]).T
    return Series(name, loads, mean, mean - width, mean + width)


def _chart(
    series: Sequence[Series],
    y: str,
    column: str,
    caption: str,
    *,
    log: str = "x",
    level: float | None = None,
) -> Chart:
    """Something against the mean pressure, each law in its colour."""
    last = max(float(one.x.max()) for one in series)
    colours = {one.name: c for one in series for law, c in _COLOURS.items() if law in one.name}
    return curves(
        series,
        x=_PRESSURE,
        y=y,
        columns=("pressure_over_modulus", column),
        caption=caption,
        log=log,
        colours=colours,
        level=level,
        ticks=[load for load in LOADS if load <= last],
        apart=[one.name for one in series if one.name.startswith("bem") and not one.line],
    )


def _listed(loads: FloatArray, values: FloatArray, digits: str, unit: str = "") -> str:
    return ", ".join(f"{v:{digits}}{unit} at {p:g}" for p, v in zip(loads, values, strict=True))


def _deviations_told(found: Gaps) -> str:
    return " ".join(
        f"{law.capitalize()}: {_listed(found.loads, 100 * found.deviation(law)[0], '+.1f', ' %')}."
        for law in LAWS
    )


def draw_blocks(found: Blocks) -> tuple[Chart, Chart]:
    """Open gaps of boundary and finite elements, and the deviation of the latter."""
    grids = sorted({points for _, _, points in found.gaps})
    finest = found.finest
    told = (
        f"one surface of the paper's roughness, 1/{found.bandwidth} of the longest wave being the "
        f"shortest, E* xi = E*, hardness {scenes.HARDNESS / scenes.MODULUS:g} E* or none, yield "
        f"stress hardness/{CONSTRAINT:g}"
    )
    gaps = [
        Series(f"{solver}, {law}", found.loads, values, line=solver == "bem")
        for (solver, law, points), values in found.gaps.items()
        if points == finest
    ]
    which = [(law, n) for law in LAWS for n in grids] + [("j2", finest)]
    deviations = [
        Series(f"{law}, {n} points", found.loads, 100 * found.deviation(law, n)) for law, n in which
    ]
    sentences = []
    for law in ("capped", "elastic", "j2"):
        per_grid = "; ".join(
            f"{n} points {_listed(found.loads, 100 * found.deviation(law, n), '+.1f', ' %')}"
            for n in grids
        )
        name = "J2 over capped" if law == "j2" else law.capitalize()
        sentences.append(f"{name}: {per_grid}.")
    return (
        _chart(
            gaps,
            "open " + _GAP,
            "gap_over_rms_height",
            f"Mean open gap against mean pressure by boundary and finite elements on {told}, "
            f"{finest} grid points a shortest wave for both. Finite elements, of small strain on "
            "a flat block so deep that the half-space is answered within 1e-3, have the same law; "
            "with J2 the body itself flows, no pressure is capped, and the gap is that to the "
            "surface as the flow has left it.",
            log="xy",
        ),
        _chart(
            deviations,
            "finite over boundary elements, less 1 (%)",
            "deviation_percent",
            f"Deviation of the open gap of finite elements from that of boundary elements on the "
            f"same grid, {told}, by grid points a shortest wave; of J2, from the capped law: a "
            f"difference of models, not an error. {' '.join(sentences)}",
            level=0.0,
        ),
    )
