"""The study of public codes side by side: the same surface, the same areas, one run.

Each code is run at rising effort (a tighter tolerance, or more iterations, because
Kato's method always reports an error of zero) until its raw areas agree with those of
`epcontact.bem`.  This time is a code's best, because only someone who knows the answer
can stop there.  A code whose areas never agree has no time, and neither has one that
takes more than MOST times as long as this package: codes run in a process of their own,
which is ended then.

Processor time is compared, as it does not count the waiting for other processes.  These
also take a share of the memory's bandwidth, so that solves of one code differ by up to
a half: this package solves before each solve of a peer, and the median of its times
counts.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.errors import StudyUnavailable
from epcontact.harness.workers import Worker, WorkerDied
from epcontact.output.charts.plot import Axis, Plot
from epcontact.peers.public_codes import PEERS, Pressure
from epcontact.results import FloatArray
from epcontact.studies.cost import AIMS, TIGHT, timed
from epcontact.studies.frame import Charts, Rows, Say, list_rows, study, tabulate
from epcontact.studies.paper_scene import LAWS, MODULUS, rough_scene

#: Largest relative difference of total and plastic raw areas that counts as the same
#: answer, and times the time of this package, beside the seconds for its start, after
#: which a code is ended.
AGREEMENT, MOST, STARTING = 1e-3, 200, 20.0
OWN = "epcontact"
LOAD = 0.05  # over E*, as in all studies of the paper's scene


def efforts(code: str, heights: FloatArray, hardness: float) -> list[Any]:
    """The settings to try for a code, from loose to tight."""
    if code == "tamaas":
        elastic = [1e-2, 1e-3, 1e-4, 1e-6, 1e-8]
        return elastic if math.isinf(hardness) else [50 * 2**k for k in range(7)]
    return [scale * float(heights.std()) for scale in (1e-2, 1e-3, 1e-4, 1e-5)]


def agree(areas: Sequence[float], exact: Sequence[float]) -> bool:
    """True if areas are the same within AGREEMENT."""
    return all(abs(a - b) <= AGREEMENT * b for a, b in zip(areas, exact, strict=True))


def race(law: str, bandwidth: int, peers: dict[str, Pressure], call: Any) -> Rows:
    """Solve one surface by this package to each aim of `cost.AIMS`, and by every peer.
    `call` makes the calls of the peers, as `Worker.call` does.  Returns a row for each
    code: code, seconds, total (raw area; NaN where the code was ended), agrees, setting
    (the one that agreed or the last one tried) and points_a_side.
    """
    hardness, scene = LAWS[law] / MODULUS, rough_scene(8, 7, bandwidth, LAWS[law])
    heights = np.array(scene.surface.heights) / scene.surface.periods[0]
    times: dict[str, list[tuple[float, float]]] = {aim: [] for aim in AIMS}

    def solve_here(aim: str) -> tuple[float, float]:
        """Solve by this package; note the time and return total and plastic raw
        area.
        """
        result, spent = timed(lambda: bem.solve(scene, threads=1, **AIMS[aim]))
        times[aim].append(spent)
        return result.final.areas["raw"].total, result.final.areas["raw"].plastic

    def row(
        code: str, setting: str, seconds: float, areas: tuple[float, float]
    ) -> dict[str, Any]:
        """Return the row of one code: see `race`."""
        told = {
            "seconds": seconds,
            "total": areas[0],
            "agrees": agree(areas, own[TIGHT]),
        }
        return {"code": code, "setting": setting, "points_a_side": len(heights)} | told

    # Kernels are compiled, and up to 1024 x 1024 points operators prepared, before it
    # is timed.
    own, found = {aim: solve_here(aim) for aim in AIMS}, []
    for code, solver in peers.items():
        for effort in efforts(code, heights, hardness):
            own = {aim: solve_here(aim) for aim in AIMS}
            solve = partial(solver, heights, LOAD, hardness, effort)
            usual = float(np.median([wall for wall, _ in times[TIGHT][1:]]))
            limit = seconds = STARTING + MOST * usual
            areas = math.nan, math.nan
            try:
                pressure, (_, seconds) = call(timed, solve, limit=limit)
                # Codes reach the hardness up to rounding.
                at_hardness = pressure >= hardness * (1 - 1e-9)
                areas = float((pressure > 0).mean()), float(at_hardness.mean())
            except WorkerDied as error:
                if "not finished within" not in str(error):
                    raise
            last = row(code, f"{effort:.3g}", seconds, areas)
            if last["agrees"] or math.isnan(areas[0]):
                break
        found.append(last)
    for aim in AIMS:
        own[aim] = solve_here(aim)
        seconds = float(np.median([processor for _, processor in times[aim][1:]]))
        found.append(row(OWN, aim, seconds, own[aim]))
    return found


def installed() -> dict[str, Pressure]:
    """The peers that can be imported; raises StudyUnavailable if none can."""
    solvers = {}
    for name, solver in PEERS.items():
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
            solvers[name] = solver
    if not solvers:
        raise StudyUnavailable(
            "no other code is installed to compare with; install ContactMechanics or "
            "tamaas "
            "(pip install ContactMechanics tamaas)"
        )
    return solvers


@study("peers", widths=(32, 64, 128, 256))
def peers(say: Say, widths: Sequence[int] = (8, 16)) -> Charts:
    """Time to the same areas beside public codes, where they are installed.

    The scene is the paper's with 8 points to its shortest wave.  Raw areas agree within
    0.1 %. Each code has the loosest of its settings that agrees, and one thread.
    """
    solvers = installed()
    if os.environ.get("OMP_NUM_THREADS") != "1":
        raise StudyUnavailable(
            "the codes are compared on one thread each, which some of them learn "
            "from the "
            "environment only; set OMP_NUM_THREADS=1"
        )
    child = Worker()
    for law in LAWS:
        race(
            law, 4, solvers, child.call
        )  # imports and plans of transforms are not timed
        on_all = partial(race, peers=solvers, call=child.call)
        yield race_chart(tabulate(say, on_all, law=[law], bandwidth=widths))
    child.end()


def race_chart(races: pd.DataFrame) -> tuple[Plot, pd.DataFrame, str]:
    """The times of the codes that agree; the caption names the others."""
    is_own, late = races["code"] == OWN, races["total"].isna()
    title, form = (
        f"Processor time, {races['law'].iloc[0]}",
        "{code} at {points_a_side} ({setting})",
    )
    for why, some in (
        ("Setting", races["agrees"] & ~is_own),
        ("Without agreement", ~races["agrees"] & ~late),
        (f"More than {MOST} times to {TIGHT}", late),
    ):
        title += f". {why}: {list_rows(races[some], form)}" if some.any() else ""
    # The settings of the peers change from grid to grid.
    drawn = races.assign(aim=races["setting"].where(is_own, ""))[races["agrees"]]
    x = Axis("points_a_side", "grid points a side (–)")
    y = Axis("seconds", "processor time of a solve (s)")
    ticks = sorted(races["points_a_side"].unique())
    return Plot(x, y, ("code", "aim"), log="xy", ticks=ticks), drawn, title
