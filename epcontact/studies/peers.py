"""Public codes side by side: the same surface, the same areas, one run, ratios of time.

The codes and their adapters are those of `harness.peers`.  Each is run at rising effort (a tighter
tolerance, or more iterations: Kato's method reports an error of zero whatever it did) and stopped
as soon as its raw areas agree with those of `epcontact.bem` within AGREEMENT.  The time to the
right answer, stopped by someone who knows it, is the best that a code can do.  A code whose areas
never agree gets no time.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from epcontact.errors import StudyUnavailable
from epcontact.harness.peers import PEERS, Pressure
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.results import FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart

#: Largest relative difference of total and plastic raw areas that counts as the same answer.
AGREEMENT = 1e-3
#: Seconds after which a code that does not agree is not tried with more effort.
LONGEST = 60.0
LOAD, HARDNESS = 0.05, 0.6  # over E*, as everywhere in these studies


@dataclass(frozen=True)
class Race:
    """One code on one grid: seconds and areas (total, plastic), and whether they agree.

    effort: the setting that agreed, or the last one tried.
    """

    code: str
    points: int
    hardness: float
    seconds: float
    areas: tuple[float, float]
    agrees: bool
    effort: str


def efforts(code: str, heights: FloatArray, hardness: float) -> list[Any]:
    """What each code is tried with, from loose to tight."""
    if code == "tamaas" and not math.isinf(hardness):
        return [50, 100, 200, 400, 800, 1600, 3200]
    if code == "tamaas":
        return [1e-2, 1e-3, 1e-4, 1e-6, 1e-8]
    return [scale * float(heights.std()) for scale in (1e-2, 1e-3, 1e-4, 1e-5)]


def areas_of(pressure: FloatArray, hardness: float) -> tuple[float, float]:
    """Shares of grid points in contact and at the hardness, which codes reach but for rounding."""
    return float((pressure > 0).mean()), float((pressure >= hardness * (1 - 1e-9)).mean())


def agree(found: Sequence[float], exact: Sequence[float]) -> bool:
    """Whether areas are the same within AGREEMENT."""
    return all(abs(a - b) <= AGREEMENT * b for a, b in zip(found, exact, strict=True))


def race(points: int, bandwidth: int, hardness: float, peers: dict[str, Pressure]) -> list[Race]:
    """This package (areas settled to 1e-4) and every peer on one surface, one thread."""
    from epcontact import bem

    pascal = scenes.MODULUS * hardness
    scene = scenes.rough_scene(points, 7, bandwidth, pascal)
    bem.solve(scene, area_tolerance=1e-4, threads=1)  # compiled and cached before it is timed
    started = time.perf_counter()
    result = bem.solve(scene, area_tolerance=1e-4, threads=1)
    seconds = time.perf_counter() - started
    raw = result.final.areas["raw"]
    exact, side = (raw.total, raw.plastic), scene.surface.shape[0]
    found = [Race("epcontact", side, hardness, seconds, exact, True, "areas to 1e-4")]
    heights = np.array(scene.surface.heights) / scene.surface.periods[0]
    for code, solver in peers.items():
        for effort in efforts(code, heights, hardness):
            started = time.perf_counter()
            pressure = solver(heights, LOAD, hardness, effort)
            seconds = time.perf_counter() - started
            areas = areas_of(pressure, hardness)
            last = Race(code, side, hardness, seconds, areas, agree(areas, exact), f"{effort:.3g}")
            if last.agrees or seconds > LONGEST:
                break
        found.append(last)
    return found


def installed() -> dict[str, Pressure]:
    """The peers that can be imported.  Raises StudyUnavailable if none can."""
    found = {}
    for name, solver in PEERS.items():
        try:
            importlib.import_module(name)
        except ImportError:
            continue
        found[name] = solver
    if not found:
        raise StudyUnavailable(
            "no other code is installed to compare with; install ContactMechanics or tamaas "
            "(pip install ContactMechanics tamaas)"
        )
    return found


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Time against the grid, capped and elastic."""
    peers = installed()
    widths = (8, 16) if size == "fast" else (32, 64, 128, 256)
    races: dict[float, list[Race]] = {HARDNESS: [], math.inf: []}
    for hardness in races:
        race(8, 4, hardness, peers)  # what is imported and planned once is not timed
        for bandwidth in widths:
            progress(f"peers: {8 * bandwidth} points a side, hardness {hardness:g} E*")
            races[hardness] += race(8, bandwidth, hardness, peers)
    return tuple(draw_races(found) for found in races.values())


def draw_races(races: Sequence[Race]) -> Chart:
    """Times of the codes that agree; those that do not are told in the caption."""
    hardness = races[0].hardness
    codes = dict.fromkeys(one.code for one in races)
    series = []
    for code in codes:
        mine = [one for one in races if one.code == code and one.agrees]
        if mine:
            series.append(Series(code, [r.points for r in mine], [r.seconds for r in mine]))
    law = "elastic" if math.isinf(hardness) else f"capped at {hardness:g} E*"
    return curves(
        series,
        x="grid points a side (–)",
        y="time of a solve on one thread (s)",
        columns=("points_a_side", "seconds"),
        caption=f"Time to the raw areas of the paper's roughness and load, {law}, 8 points per "
        f"shortest wavelength. Every point stands for areas that agree within {AGREEMENT:g}. "
        f"{_told(races)} Each code was given the loosest of its settings whose areas agree, all "
        "in one run on one machine.",
        log="xy",
        ticks=sorted({r.points for r in races}),
    )


def _told(races: Sequence[Race]) -> str:
    own = {r.points: r.seconds for r in races if r.code == "epcontact"}
    others = [r for r in races if r.code != "epcontact"]
    ratios = ", ".join(
        f"{r.code} {r.seconds / own[r.points]:.3g} at {r.points} (setting {r.effort})"
        for r in others
        if r.agrees
    )
    lost = ", ".join(
        f"{r.code} at {r.points} (contact area {r.areas[0]:.4g} at setting {r.effort})"
        for r in others
        if not r.agrees
    )
    told = f"Times over those of epcontact: {ratios}." if ratios else ""
    return told + (f" Without agreement: {lost}." if lost else "")
