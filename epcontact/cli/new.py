"""The command `new`, which writes a commented case that is ready to run."""

from __future__ import annotations

import json
import os
import re
import string
from importlib.resources import files
from pathlib import Path

from epcontact.cli.main import print_text
from epcontact.errors import InvalidCase, OutputError
from epcontact.files import write_text

#: What `new` writes without a map: the id of the case and the command to run next.
_KINDS = {
    "rough": ("my-surface", "epcontact verify {file}"),
    "solver": (
        "my-solver",
        "PYTHONPATH=. epcontact verify {file} --solver mine=my_solver:solve",
    ),
}
#: Unit of heights that is assumed if a map does not state one, in m.
_USUAL_UNIT = 1e-6


def new(
    kind: str, unit: float | None, pixel_size: float | None, output: Path | None
) -> None:
    """Write a commented case file that is ready to run.

    The arguments are those of `commands.new`.
    """
    guesses: list[str] = []
    if kind in _KINDS:
        case_id, command = _KINDS[kind]
        values: dict[str, str] = {}
    elif Path(kind).is_file():
        case_id = re.sub(r"[^A-Za-z0-9_.-]+", "-", Path(kind).stem).lstrip("-.")
        case_id = case_id or "map"
        command = "epcontact run {file} --charts"
    else:
        raise InvalidCase(
            f"{kind}: is neither a file with a map of heights nor one of "
            f"{', '.join(_KINDS)}"
        )
    target = output or Path(f"{case_id}.toml")
    if target.suffix != ".toml":
        raise InvalidCase(f"--output is {target}, but a case file ends with .toml")
    _require_absent(target)
    if kind not in _KINDS:
        values, guesses = _values_of_map(Path(kind), target, unit, pixel_size)
    values |= {"id": target.stem, "file": str(target)}
    if kind == "solver":
        solver = target.with_name("my_solver.py")
        _require_absent(solver)
        write_text(solver, _template("my_solver.py.txt"))
        print_text(f"solver in {solver}")
    name = kind if kind in _KINDS else "map"
    text = string.Template(_template(f"{name}.toml")).substitute(values)
    write_text(target, text)
    print_text(f"case in {target}")
    for guess in guesses:
        print_text(f"check: {guess}")
    print_text(f"next: {command.format(file=target)}")


def _template(name: str) -> str:
    """Return the text of a file of the folder `templates`."""
    folder = files("epcontact.cli").joinpath("templates")
    return folder.joinpath(name).read_text(encoding="utf-8")


def _require_absent(path: Path) -> None:
    """Raise OutputError if a file that `new` would write exists already."""
    if path.exists():
        raise OutputError(
            f"{path} exists already; remove it, or name another file by --output"
        )


def _values_of_map(
    path: Path, target: Path, unit: float | None, pixel_size: float | None
) -> tuple[dict[str, str], list[str]]:
    """Return the values of the template for a map, and sentences on what was guessed.

    Args:
        path: the file of the map.
        target: the case file, beside which the map is found.
        unit: unit of the heights in m; None: what the file states, else µm.
        pixel_size: distance of neighbouring points in m; None: what the file states,
            else 1e-6 m.

    Raises:
        InvalidScene: if the file cannot be read as a map.
    """
    from epcontact.surfaces.readers import read_heights  # loads numpy

    heights = read_heights(path)
    guesses = []
    unit_line = f"unit = {unit:g}" if unit is not None else ""
    if unit is None and heights.unit is None:
        unit_line = f"unit = {_USUAL_UNIT:g}".ljust(48) + "# m; CHECK: µm is assumed"
        guesses.append("the file states no unit of its heights; µm is assumed")
    elif unit is None:
        unit_line = f"# the heights are in units of {heights.unit:g} m, by the file"
    size_line = f"pixel_size = {pixel_size:g}" if pixel_size is not None else ""
    if pixel_size is None and heights.periods is None:
        size_line = "pixel_size = 1e-06".ljust(48) + "# m; CHECK: 1 µm is assumed"
        guesses.append("the file states no distance of its points; 1 µm is assumed")
    elif pixel_size is None:
        size_line = "# the file states the size of the map"
    relative = os.path.relpath(path, target.parent)
    values = {
        "name": json.dumps(path.name, ensure_ascii=False),
        "path": json.dumps(Path(relative).as_posix(), ensure_ascii=False),
        "unit": unit_line,
        "size": size_line,
    }
    return values, guesses
