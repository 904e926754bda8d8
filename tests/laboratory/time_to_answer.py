"""How long a user waits for an answer of a command, and for which part of the work.

Each command runs in a process of its own, whose processor time counts: on a busy
machine it does not depend on the work of others.

`python -m laboratory.time_to_answer [--full]` draws the charts.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from epcontact import bem
from epcontact.errors import EpcontactError
from epcontact.output.charts.plot import Axis, Plot
from epcontact.studies.cost import pair_times, timed
from epcontact.studies.frame import Charts, Ints, Rows, Say, Study, tabulate
from epcontact.studies.paper_scene import (
    HARDNESS,
    LOWEST,
    MEAN_PRESSURE,
    MODULUS,
    rough_scene,
)
from laboratory import charts

#: Grid points per shortest wavelength.
_POINTS = 4
#: Seed of the surface.
_SEED = 7
#: The paper's scene as a case file; `format` sets the highest wave number in rad/m.
_CASE = f"""
[case]
id = "time"
requirement = "The areas of the paper's scene."
source = "Almqvist and Persson"
methods = ["bem"]

[surface]
kind = "self_affine"
period = {2 * math.pi / LOWEST!r}
hurst = 0.8
wavenumber_low = {LOWEST!r}
wavenumber_roll_off = {4 * LOWEST!r}
wavenumber_high = {{highest!r}}
rms_slope = 1.0
points_per_shortest_wavelength = {_POINTS}
seeds = [{_SEED}]

[material]
young_modulus = {MODULUS!r}
poisson_ratio = 0.0
hardness = {HARDNESS!r}

[load]
mean_pressure = {MEAN_PRESSURE!r}

[[gate]]
quantity = "area.total.corrected"
of = "bem"
against = 0.11
source = "Almqvist and Persson, Table 1"
tolerance = 0.9
because = "the command is timed, and the area is not judged"
"""


def _processor_seconds(folder: Path, *arguments: str) -> float:
    """Run Python with arguments in a folder and return its processor time in s.

    The processes that it starts count, too.  Raises EpcontactError if it fails.
    """
    before = os.times()
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    after = os.times()
    if done.returncode:
        command = " ".join(arguments)
        raise EpcontactError(f"{command} failed: {done.stderr.strip()[-300:]}")
    user = after.children_user - before.children_user
    return user + after.children_system - before.children_system


def parts_of_commands(folder: Path, points_a_side: int) -> dict[str, dict[str, float]]:
    """Return the processor seconds of commands, by command and part of the work.

    The parts are the start (the imports of `run`, as those of the other commands differ
    little), solving, measuring (all else that is computed and printed), writing fields,
    and drawing.  All but the start and solving are differences of runs, and at least 0.

    Args:
        folder: An empty folder for the case and its results.
        points_a_side: Grid points along each side, a multiple of 4.

    Returns:
        The seconds of the parts of "plan" (its pilots count as solving), "verify",
        "run", "run --charts" and "report".
    """
    highest = LOWEST * points_a_side / _POINTS
    (folder / "time.toml").write_text(_CASE.format(highest=highest), encoding="utf-8")

    def command(*words: str) -> float:
        """Return the seconds of a command of epcontact."""
        return _processor_seconds(folder, "-m", "epcontact", *words)

    def run(*options: str) -> float:
        """Return the seconds of `epcontact run` with options."""
        return command("run", "time.toml", "--jobs", "1", *options)

    run()  # compiles the kernels, which the next runs find
    without_fields = run("--fresh", "--fields", "none")
    with_fields = run("--fresh")
    reused = run()
    with_charts = run("--charts")
    verify = command("verify", "time.toml", "--jobs", "1", "--fresh")
    report = command("report", "results")
    plan = command("plan", "time.toml", "--tolerance", "5%")
    start = _processor_seconds(folder, "-c", "import epcontact.cli.run_and_verify")
    scene = rough_scene(_POINTS, _SEED, points_a_side // _POINTS)
    bem.solve(scene)
    _, (_, solving) = timed(lambda: bem.solve(scene))

    solved = {"start": start, "solving": solving}
    parts_of_run = solved | {
        "measuring": max(0.0, without_fields - start - solving),
        "writing": max(0.0, with_fields - without_fields),
    }
    drawing = max(0.0, with_charts - reused)
    return {
        "plan": {"start": start, "solving": max(0.0, plan - start)},
        "verify": solved | {"measuring": max(0.0, verify - start - solving)},
        "run": parts_of_run,
        "run --charts": parts_of_run | {"drawing": drawing},
        "report": {"start": start, "drawing": max(0.0, report - start)},
    }


def time_to_answer(say: Say, sides: Ints = (256, 512)) -> Charts:
    """Processor time of commands on the paper's scene, and of each part of their work.

    Times are over that of a bare FFT pair of the grid.  The start is that of Python and
    all imports, and measuring is all that is neither solved, written nor drawn.
    """

    def row(points_a_side: int) -> Rows:
        """Return a row for each command and part of its time on a grid."""
        with TemporaryDirectory() as folder:
            commands = parts_of_commands(Path(folder), points_a_side)
        _, pair = pair_times((points_a_side, points_a_side), threads=1)
        return [
            {
                "command": command,
                "part": part,
                "processor_time": seconds / pair,
                "seconds": seconds,
            }
            for command, parts in commands.items()
            for part, seconds in parts.items()
        ]

    table = tabulate(say, row, points_a_side=sides)
    by_command = ["points_a_side", "command"]
    totals = table.groupby(by_command, sort=False).sum(numeric_only=True).reset_index()
    plot = Plot(
        Axis("points_a_side", "grid points a side (–)"),
        Axis("processor_time", "processor time in that of a bare FFT pair (–)"),
        ("command",),
        log="xy",
        ticks=sides,
    )
    yield plot, totals, "How long does a command take?"
    parts = replace(plot, series=("command", "part"), colour="part", mark="command")
    yield parts, table, "Which part of a command takes the time?"


STUDY = Study("time", time_to_answer, {"sides": (256, 512, 1024, 2048)})

if __name__ == "__main__":
    charts.save(STUDY)
