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

#: Largest relative difference of total and plastic raw areas that counts as agreement.
AGREEMENT = 1e-3
#: A code is ended after this many times the time of this package.
MOST = 200
#: Seconds that a code gets in addition, for its start.
STARTING = 20.0
#: Name of this package in the column `code`.
OWN = "epcontact"
#: Mean pressure over E*, as in all studies of the paper's scene.
LOAD = 0.05


def efforts(
    code: str,
    heights: FloatArray,
    hardness: float,
) -> list[Any]:
    """Return the settings of accuracy to try for a code, from loose to tight.

    They are what the code's function in `PEERS` takes as `effort`.

    Args:
        code: Name of the code, a key of `PEERS`.
        heights: Heights over the period, (nx, ny).
        hardness: Hardness over E*; infinite for an elastic body.
    """
    if code != "tamaas":
        rms_height = float(heights.std())
        return [scale * rms_height for scale in (1e-2, 1e-3, 1e-4, 1e-5)]
    if math.isinf(hardness):
        return [1e-2, 1e-3, 1e-4, 1e-6, 1e-8]
    return [50 * 2**k for k in range(7)]


def agree(areas: Sequence[float], exact: Sequence[float]) -> bool:
    """Return whether all areas have a relative difference of at most AGREEMENT.

    `areas` and `exact` are fractions of the nominal area, in the same order.  A NaN
    does not agree.
    """
    for area, reference in zip(areas, exact, strict=True):
        if not abs(area - reference) <= AGREEMENT * reference:
            return False
    return True


def race(
    law: str,
    bandwidth: int,
    peers: dict[str, Pressure],
    call: Any,
) -> Rows:
    """Solve one surface by this package and by other codes, and measure the times.

    Args:
        law: "capped" or "elastic".
        bandwidth: Number of the shortest waves in a period; a side has 8 times as many
            grid points.
        peers: The functions of the other codes by name, from `PEERS`.
        call: Calls a function with a limit in seconds, as `Worker.call` does.

    Returns:
        A row for each code, and for this package one for each accuracy of `cost.AIMS`:
        code, seconds (processor time), total (raw area over the nominal one; NaN where
        the code was ended), agrees, setting (the one that agreed, or the last one that
        was tried) and points_a_side.

    Raises:
        NotConverged: A code fails.
        WorkerDied: A code's process dies before its time is over.
    """
    hardness = LAWS[law] / MODULUS
    scene = rough_scene(8, 7, bandwidth, LAWS[law])
    heights = np.array(scene.surface.heights) / scene.surface.periods[0]
    times: dict[str, list[tuple[float, float]]] = {aim: [] for aim in AIMS}

    def solve_here(aim: str) -> tuple[float, float]:
        """Solve by this package to an accuracy, a key of `AIMS`, and note the time.

        Returns total and plastic raw area over the nominal area.
        """
        result, spent = timed(lambda: bem.solve(scene, threads=1, **AIMS[aim]))
        times[aim].append(spent)
        raw = result.final.areas["raw"]
        return raw.total, raw.plastic

    def row(
        code: str, setting: str, seconds: float, areas: tuple[float, float]
    ) -> dict[str, Any]:
        """Return the row of a code, with the columns that `race` describes.

        `setting` is that of its accuracy, `seconds` its processor time, and `areas`
        are total and plastic raw area over the nominal area.  The areas are compared
        with those of the last solve by this package.
        """
        total, _ = areas
        return {
            "code": code,
            "setting": setting,
            "points_a_side": len(heights),
            "seconds": seconds,
            "total": total,
            "agrees": agree(areas, own[TIGHT]),
        }

    # These first solves compile kernels and, up to 1024 x 1024 points, prepare the
    # operators; their times are not used.
    own = {aim: solve_here(aim) for aim in AIMS}
    found = []
    for code, solver in peers.items():
        for effort in efforts(code, heights, hardness):
            own = {aim: solve_here(aim) for aim in AIMS}
            solve = partial(solver, heights, LOAD, hardness, effort)
            usual = float(np.median([wall for wall, _ in times[TIGHT][1:]]))
            limit = STARTING + MOST * usual
            seconds = limit
            areas = (math.nan, math.nan)
            try:
                pressure, (_, seconds) = call(timed, solve, limit=limit)
                # Codes reach the hardness up to rounding.
                at_hardness = pressure >= hardness * (1 - 1e-9)
                areas = (float((pressure > 0).mean()), float(at_hardness.mean()))
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
    """Return the functions of the installed codes by name, from `PEERS`.

    Raises StudyUnavailable if none of the codes is installed.
    """
    solvers = {}
    for name, solver in PEERS.items():
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
            solvers[name] = solver
    if not solvers:
        raise StudyUnavailable(
            "no other code is installed to compare with; install ContactMechanics or "
            "tamaas (pip install ContactMechanics tamaas)"
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
            "the codes are compared on one thread each, which some of them read from "
            "the environment only; set OMP_NUM_THREADS=1"
        )
    child = Worker()
    for law in LAWS:
        # This race is not used: it imports the codes and plans their transforms.
        race(law, 4, solvers, child.call)
        on_all = partial(race, peers=solvers, call=child.call)
        yield race_chart(
            tabulate(
                say,
                on_all,
                law=[law],
                bandwidth=widths,
            )
        )
    child.end()


def race_chart(races: pd.DataFrame) -> tuple[Plot, pd.DataFrame, str]:
    """Return look, table and caption of the chart of processor times by grid points.

    The chart has the codes whose areas agree; the caption lists the settings of all
    other codes.  `races` has the rows of `race` for several grids, with a column `law`.
    """
    is_own = races["code"] == OWN
    was_ended = races["total"].isna()
    caption = f"Which code is fastest on the {races['law'].iloc[0]} body?"
    form = "{code} at {points_a_side} ({setting})"
    groups = {
        "Setting": races["agrees"] & ~is_own,
        "Without agreement": ~races["agrees"] & ~was_ended,
        f"More than {MOST} times to {TIGHT}": was_ended,
    }
    for reason, is_in_group in groups.items():
        if is_in_group.any():
            caption += f" {reason}: {list_rows(races[is_in_group], form)}."
    # The settings of the other codes change from grid to grid, so that they are not
    # series of the chart.
    drawn = races.assign(aim=races["setting"].where(is_own, ""))[races["agrees"]]
    x = Axis("points_a_side", "grid points a side (–)")
    y = Axis("seconds", "processor time of a solve (s)")
    ticks = sorted(races["points_a_side"].unique())
    return (
        Plot(
            x,
            y,
            ("code", "aim"),
            log="xy",
            ticks=ticks,
        ),
        drawn,
        caption,
    )
