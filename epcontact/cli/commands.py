"""What the commands are called, what they take and what their help says.

The module that does the work of a command is imported when the command runs, so that
`--help` and a mistake on the command line do not wait for solvers and charts.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from epcontact.cli.options import (
    OutputFile,
    case_size,
    fields,
    folder,
    require_address_space,
    require_separate_outputs,
    run_options,
    size,
)
from epcontact.harness.case_files.text import SIZES
from epcontact.machine import LINEAR_ALGEBRA, single_threads

#: The module of each command, whose function has the name of the command.
COMMANDS = {
    "accuracy": "compare_and_accuracy",
    "benchmark": "compare_and_accuracy",
    "chart": "charts",
    "cite": "keys_gates_and_sources",
    "compare": "compare_and_accuracy",
    "crosscheck": "crosscheck_and_export",
    "export": "crosscheck_and_export",
    "gates": "keys_gates_and_sources",
    "hardness": "hardness_and_joint",
    "joint": "hardness_and_joint",
    "keys": "keys_gates_and_sources",
    "list": "list_cases",
    "new": "new",
    "plan": "plan",
    "report": "report_and_view",
    "run": "run_and_verify",
    "schema": "keys_gates_and_sources",
    "stability": "charts",
    "sweep": "sweep",
    "verify": "run_and_verify",
    "view": "report_and_view",
}

#: Examples at the end of the help of each command.
EXAMPLES = {
    "accuracy": ("accuracy results/accuracy-elastic",),
    "benchmark": ("benchmark", "benchmark mycode.csv --csv table.csv"),
    "chart": ("chart", "chart validity", "chart speed --full"),
    "cite": ("cite paper-elastoplastic",),
    "compare": ("compare results", "compare old/verdict.json results"),
    "crosscheck": ("crosscheck fem-elastic",),
    "export": ("export fem-elastic block.inp",),
    "gates": ("gates hertz-sphere", "gates --output results"),
    "hardness": (
        "hardness --yield-stress 1e9 --young-modulus 7e10 --poisson-ratio 0.2 "
        "--mean-pressure 2e8 --rms-slope 0.1",
    ),
    "joint": (
        "joint --conductivities 16 50 --hardness 3e9 --effective-modulus 2e10 "
        "--rms-height 3e-6 --rms-slope 0.2 --mean-pressure 3e7",
    ),
    "keys": ("keys",),
    "list": ("list", "list hertz", "list --all"),
    "new": ("new steel.csv --unit 1e-6 --pixel-size 8e-7", "new rough", "new solver"),
    "plan": ("plan paper-elastic --tolerance 2%",),
    "report": ("report results",),
    "run": ("run paper-elastic", "run steel.toml --charts --output steel"),
    "schema": ("schema case > case.schema.json",),
    "stability": ("stability",),
    "sweep": ("sweep my-surface.toml",),
    "verify": (
        "verify",
        "verify hertz-sphere --gates",
        "verify my-solver.toml --solver mine=my_solver:solve",
    ),
    "view": ("view results/paper-elastic/fast/bem.json --screenshot contact.png",),
}

_path = click.Path(path_type=Path)
_file = OutputFile()
_full = click.option(
    "--full", is_flag=True, help="Minutes instead of seconds, and finer."
)
_mean_pressure = click.option(
    "--mean-pressure", type=float, required=True, help="Force over nominal area, in Pa."
)


def _runs(command: Callable[..., None]) -> Callable[..., None]:
    """Return a function that imports the module of a command and runs the command.

    Args:
        command: A function with the name and the help of the command; its body is not
            run.  The function of the same name in the module gets the arguments.
    """

    @functools.wraps(command)
    def run_command(**arguments: Any) -> None:
        """Import the module and call its function with the arguments."""
        require_address_space()
        require_separate_outputs(click.get_current_context().command, arguments)
        name = command.__name__
        # No command has matrices that need threads, and to start them takes as long as
        # numpy's import.  A number of threads that the user sets counts.
        with single_threads(*({LINEAR_ALGEBRA} - os.environ.keys())):
            module = import_module(f"epcontact.cli.{COMMANDS[name]}")
        getattr(module, name)(**arguments)

    return run_command


@click.command()
@click.argument("folders", nargs=-1, type=_path)
@click.option(
    "--csv",
    "table",
    type=_file,
    help="Write the ledger, with every grid, to this file.",
)
@click.option(
    "--keep",
    "saved",
    type=_file,
    help="Write what it rests on, a row for each scene and pair.",
)
@click.option("--charts", type=_path, help="Draw the charts into this folder.")
@_runs
def accuracy(**_: Any) -> None:
    """Print bias, scatter and cost of each quantity between methods and references.

    FOLDERS are those of `epcontact sweep` (CASE/SIZE in its output) and of `epcontact
    verify`; with none it is the ledger of this release.  The bias is the median of the
    relative differences over scenes, the scatter half the width of their central 68 %.
    Differences of areas are over the reference, or over a thousandth of the nominal
    area where that is more.  Times are over those of boundary elements on 4 points per
    shortest wave.
    """


@click.command()
@click.argument("files", nargs=-1, type=_path)
@click.option(
    "--csv", "table", type=_file, help="Write each scene, load and code to this file."
)
@click.option(
    "--copy", type=_path, help="Write heights, materials and loads into a new folder."
)
@_runs
def benchmark(**_: Any) -> None:
    """Compare codes for elastoplastic contact on the six scenes of the benchmark.

    The table shows how far codes are from plain finite elements at the loads that they
    have solved: the median and the largest of the differences.  FILES are the fields of
    other codes, a CSV file each, whose name is that of the code: a row for each node
    with the columns scene, load, i, j, pressure (Pa) and, if it is known, gap (m).
    """


@click.command()
@click.argument("names", nargs=-1)
@_full
@click.option(
    "--peers", is_flag=True, help="Add the comparison with other solvers (extra peers)."
)
@folder(default=Path("charts"))
@_runs
def chart(**_: Any) -> None:
    """Draw the charts of the studies NAMES with data and captions; none: list them."""


@click.command()
@click.argument("case")
@case_size
@_runs
def cite(**_: Any) -> None:
    """Print the sources, papers and software versions that a case rests on.

    CASE is the name of a case of the package, or a file.  A size counts because each
    may have gates, and so papers, of its own.
    """


@click.command()
@click.argument("verdicts", type=_path, nargs=-1, required=True, metavar="[OLD] NEW")
@click.option(
    "--csv", "table", type=_file, help="Write every value that moved to this file."
)
@click.option(
    "--keep",
    "saved",
    type=_file,
    help="Save the values of NEW in this small .csv, a later OLD.",
)
@_runs
def compare(**_: Any) -> None:
    """Compare two verdicts and list the values that changed.

    Changes are in units of the error estimates.  OLD and NEW are verdict.json, a folder
    that holds it, or a table that --keep wrote; without OLD it is the table of this
    release.  The exit code is 1 if a value changed by more than its error estimate,
    though its band may hold, or if a gate that held does not.  A value without an error
    estimate may change by a ten-thousandth, and a value that must be 0 by its band.
    More work is listed in counts.  Seconds depend on the machine, and their ratio
    judges nothing.
    """


@click.command()
@click.argument("case")
@case_size
@click.option(
    "--seeds",
    default=None,
    metavar="FIRST-LAST",
    help="Surfaces of these seeds, not the case's.",
)
@click.option(
    "--steps", type=click.IntRange(1), help="Increments of the J2 body, not the case's."
)
@_runs
def crosscheck(**_: Any) -> None:
    """Split the difference of finite and boundary elements into grid, depth, model.

    A case that names calculix or tamaas_j2 is also solved by these codes, in a table.
    """


@click.command()
@click.argument("case")
@click.argument("file", type=_file)
@case_size
@_runs
def export(**_: Any) -> None:
    """Write the finite-element block of CASE, with its first surface, to FILE.

    FILE.inp is a complete input file of CalculiX, which `ccx FILE` runs without its
    ending.  .vtu, .vtk, .msh, .med and .xdmf (these two with the package h5py) hold the
    bricks, the nodes of "top" and "base", and the gap (m) of each top node to the rigid
    flat on the highest of them.
    """


@click.command()
@click.argument("cases", nargs=-1)
@folder(
    default=Path("results"), help="Folder of the verification whose margins are shown."
)
@_runs
def gates(**_: Any) -> None:
    """List the band, margin and reason of every gate.

    The margin is that of the verdict in the output folder: the band over the difference
    and its interval.
    """


@click.command()
@click.option("--yield-stress", type=float, required=True, help="sigma_Y in Pa.")
@click.option("--young-modulus", type=float, required=True, help="E in Pa.")
@click.option("--poisson-ratio", type=float, required=True, help="nu.")
@click.option(
    "--rms-slope",
    type=float,
    required=True,
    help="Of all roughness, short waves included.",
)
@_mean_pressure
@click.option(
    "--breadth",
    type=float,
    help="Longest (roll-off) over shortest wavelength; else any.",
)
@_runs
def hardness(**_: Any) -> None:
    """Print the pressure cap that represents a rough J2 metal, with its interval.

    hardness = "effective" in a case file is the same with the rms slope of the case's
    surface, which may be a measured map.
    """


@click.command()
@click.option(
    "--conductivities",
    type=float,
    nargs=2,
    required=True,
    help="Of both bodies, in W/(m K).",
)
@click.option(
    "--rms-height", type=float, required=True, help="Of both surfaces together, in m."
)
@click.option(
    "--rms-slope",
    type=float,
    required=True,
    help="Of both together: 1.77 times the mean absolute slope of a profile.",
)
@click.option(
    "--hardness", type=float, required=True, help="Of the softer body, in Pa."
)
@click.option(
    "--effective-modulus", type=float, required=True, help="E* of both bodies, in Pa."
)
@_mean_pressure
@click.option(
    "--breadth",
    type=float,
    help="Longest (roll-off) over shortest wavelength; else 2 to 12.",
)
@_runs
def joint(**_: Any) -> None:
    """Print the conductance of a rough joint, with its interval and textbook laws.

    Gaussian, isotropic roughness, vacuum, clean metals and a joint much larger than its
    longest waves are assumed.  The exact route is a case of this surface with a gate on
    quantity.conductance.
    """


@click.command()
@_runs
def keys(**_: Any) -> None:
    """Print every key of a case file and every quantity of a gate, with its unit."""


@click.command()
@click.argument("words", nargs=-1)
@click.option(
    "--all", "all_cases", is_flag=True, help="Each case with its requirement."
)
@_runs
def list(**_: Any) -> None:
    """List the cases by their methods, or what they require.

    A name stands for a case file, with the number of its cases if there are several.
    With WORDS, the files and cases with these words in their names are listed with
    their sizes, methods and requirements.
    """


@click.command()
@click.argument("kind", metavar="rough|solver|MAP")
@click.option(
    "--unit", type=float, help="Unit of the heights of MAP in m: 1e-6 for µm."
)
@click.option(
    "--pixel-size", type=float, help="Distance of neighbouring points of MAP in m."
)
@click.option(
    "--output",
    type=_file,
    help="File to write; else MAP.toml, my-surface.toml or my-solver.toml here.",
)
@_runs
def new(**_: Any) -> None:
    """Write a commented case file that is ready to run.

    It is for a measured map of heights (MAP is its file), for a rough surface like
    those of papers (rough), or for judging a solver (solver, with a my_solver.py).
    Existing files are not overwritten.
    """


@click.command()
@click.argument("case")
@click.option(
    "--tolerance",
    default="1%",
    show_default=True,
    help="Relative, at 95 % confidence: 1% or 0.01.",
)
@click.option(
    "--part",
    "parts",
    multiple=True,
    default=["total"],
    show_default=True,
    type=click.Choice(["total", "elastic", "plastic"]),
    help="Of the area; may be given again.",
)
@click.option(
    "--size",
    type=click.Choice(SIZES),
    default=None,
    help="Size of the case; else its largest.",
)
@click.option(
    "--check",
    is_flag=True,
    help="Run the plan and a finer grid; exit 1 if the error is larger.",
)
@run_options("executor")
@_runs
def plan(**_: Any) -> None:
    """Find the cheapest model of CASE whose contact area is within a tolerance.

    Prints the reasons and the cost.  --executor is for the solves of --check.
    """


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("results"))
@click.option(
    "--output", type=_file, help="Page to write; else report.html in the folder."
)
@_runs
def report(**_: Any) -> None:
    """Write one self-contained page of the verification run in FOLDER.

    FOLDER is the output folder of `epcontact verify`.
    """


@click.command()
@click.argument("case")
@click.option(
    "--method",
    "methods",
    multiple=True,
    metavar="METHOD",
    help="Only this method; may be repeated. Default: all that the case names.",
)
@size
@run_options("jobs", "output", "fresh", "precision")
@fields
@click.option(
    "--charts", is_flag=True, help="Draw charts, which take as long as a large solve."
)
@_runs
def run(**_: Any) -> None:
    """Solve one case and write its results and fields; no gate is judged."""


@click.command()
@click.argument("kind", type=click.Choice(["case", "verdict"]))
@_runs
def schema(**_: Any) -> None:
    """Print the JSON Schema of a case file, or of verdict.json."""


@click.command()
@click.argument("maps", nargs=-1)
@_full
@folder(default=Path("stability"))
@_runs
def stability(**_: Any) -> None:
    """Sweep loads and hardnesses; map where each method converges and how fast.

    MAPS are some of capped, elastic, theory and fem; all of them where none is named.
    """


@click.command()
@click.argument("case")
@case_size
@run_options("jobs", "output", "fresh", "executor", "precision")
@click.option(
    "--fields",
    type=click.Choice(["first", "all", "steps", "none"]),
    default="none",
    show_default=True,
    help="Write the fields (.vti) of the first surface of each point, of all, or at "
    "every load.",
)
@click.option(
    "--among",
    default="",
    metavar="WORDS",
    help="Write them where a point contains this, as the table shows it: 'hardness "
    "3e+09'.",
)
@click.option(
    "--charts", is_flag=True, help="Draw the loads of the points, and each field."
)
@_runs
def sweep(**_: Any) -> None:
    """Solve CASE at every point of its table [sweep], here or on a cluster.

    The results are saved in a folder as soon as they are solved: stop the command at
    any moment, and start it again to go on. `epcontact.harness.sweep.table(FOLDER)`
    reads them as a pandas table.
    """


@click.command()
@click.argument("cases", nargs=-1)
@size
@run_options("jobs", "output", "fresh", "executor", "precision")
@click.option(
    "--solver",
    default="",
    metavar="[NAME=]SOLVER",
    help="Judge another solver by the gates instead of bem, in a process of its own: "
    "MODULE:FUNCTION, which maps a Scene to a ContactResult; a method's name; or a "
    "command in any language with the placeholders {scene} and {result}.",
)
@click.option(
    "--report", "with_report", is_flag=True, help="Write charts and report.html too."
)
@click.option(
    "--gates", "all_gates", is_flag=True, help="Print each gate of each case."
)
@fields
@_runs
def verify(**_: Any) -> None:
    """Run the gates of the cases (all, where none is named) and write the verdict.

    Prints whether all gates hold, the gates nearest to falling short, how well the
    methods agree, what is not covered, and the cases by what they verify.  The margin
    of a gate is its band over the difference with its interval; 1 or more holds.  Of a
    case that does not hold, every gate follows.

    Writes verdict.json and junit.xml into the output folder, after those of an earlier
    run are deleted.

    \b
    A command reads the scene from one text file and writes its result to the other:
      --solver 'mine=./my_solver {scene} {result}'
    `python -m pydoc epcontact.harness.methods.foreign` describes them line by line.
    """


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--screenshot", type=_file, help="Draw to this PNG instead of a window.")
@click.option(
    "--map",
    "contact_map",
    type=_file,
    help="Draw contact state and pressure from above, as a .png; a name without an "
    "ending gives the picture, its data and a caption.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    help="With --screenshot: draw the pressures of RESULT and of this one, and their "
    "difference.",
)
@click.option(
    "--film",
    type=_file,
    help="Draw the load steps of a .pvd as a film: .gif, or .mp4 with imageio-ffmpeg.",
)
@click.option(
    "--factor", type=float, default=None, help="Stretch the deformation by this."
)
@_runs
def view(**_: Any) -> None:
    """Show the fields of a result in three dimensions.

    RESULT is a .vti, .vtu or .pvd file, or the .json file of a method.
    """
