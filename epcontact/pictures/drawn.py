"""Pictures of many cases: drawn side by side in processes, and drawn once.

A file `pictures.json` beside the pictures of a case lists them with a digest of all
that they were drawn from.  They are drawn again only if this digest has changed.
"""

from __future__ import annotations

import functools
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from epcontact.errors import OutputError
from epcontact.files import NAME_PATTERN, output_error, write_json
from epcontact.harness.case_files.case import Case
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.solving.tasks import Progress
from epcontact.harness.workers import WorkerPool, spread
from epcontact.machine import available_cores
from epcontact.output.charts.figures import PAGE_ENDINGS, Pictures
from epcontact.pictures.folder import draw_case, draw_saved, write_page_pictures

#: The file in the folder of a case that says what its pictures were drawn from.
_RECORD = "pictures.json"
#: The files of fields that pictures show.
_FIELDS = (".vti", ".pvd", ".vtu", ".gif")
#: Fewer cases for each process are drawn in this one: a process starts in a second, in
#: which the pictures of about two cases are drawn.
_CASES_PER_PROCESS = 3


@dataclass(frozen=True)
class _Drawing:
    """The pictures of one case that are wanted.

    Attributes:
        case_id: the id of the case.
        files: the JSON file of each method.
        folder: the folder of these files and of the pictures.
        draw: draws the pictures into the folder; can be pickled.
        of_case: whether charts that need the case itself are drawn, too.
    """

    case_id: str
    files: Sequence[Path]
    folder: Path
    draw: Callable[[], Pictures]
    of_case: bool


def draw_saved_cases(
    files: Mapping[str, Sequence[Path]], progress: Progress
) -> dict[str, Pictures]:
    """Draw the pictures of results that are in files.

    Args:
        files: the JSON file of each method of a case, by the ids of the cases; the
            files of a case are in one folder, which also has its files of fields.
        progress: called with the number of cases that are done, the number of all
            cases, and words that name the case that is done.

    Returns:
        The pictures of each case, by its id.

    Raises:
        OutputError: if a result is none of epcontact, or if a file cannot be read or
            written.
    """
    drawings = []
    for case_id, of_case in files.items():
        if of_case:
            folder = of_case[0].parent
            draw = functools.partial(draw_saved, case_id, of_case)
            drawings.append(_Drawing(case_id, of_case, folder, draw, of_case=False))
    return _draw_all(drawings, progress)


def draw_solved_cases(
    files: Mapping[str, Sequence[Path]],
    progress: Progress,
    solved: Mapping[str, tuple[Case, Mapping[str, MethodResults]]],
) -> dict[str, Pictures]:
    """Draw the pictures of cases that were solved; charts of the case are added.

    Args:
        files, progress: see `draw_saved_cases`; a skipped case has no files.
        solved: each case with the results of its methods, by the id of the case.

    Returns:
        The pictures of each case, by its id.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    drawings = []
    for case_id, of_case in files.items():
        if of_case:
            folder = of_case[0].parent
            case, results = solved[case_id]
            draw = functools.partial(draw_case, case, results, folder)
            drawings.append(_Drawing(case_id, of_case, folder, draw, of_case=True))
    return _draw_all(drawings, progress)


def _draw_all(drawings: Sequence[_Drawing], progress: Progress) -> dict[str, Pictures]:
    """Draw the pictures that are not up to date; return the pictures of all cases.

    Args:
        drawings: the pictures that are wanted of each case.
        progress: see `draw_saved_cases`.

    Returns:
        The pictures of each case, by its id.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    pictures = {}
    waiting = []
    for drawing in drawings:
        existing = _existing_pictures(drawing)
        if existing is None:
            waiting.append(drawing)
        else:
            pictures[drawing.case_id] = existing
    progress(len(pictures), len(drawings), "")
    for drawing, outcome in _draw_waiting(waiting):
        if isinstance(outcome, OutputError):
            raise outcome
        if isinstance(outcome, str):
            raise OutputError(f"cannot draw {drawing.case_id}: {outcome}")
        pictures[drawing.case_id] = outcome
        words = f"pictures of {drawing.case_id}"
        progress(len(pictures), len(drawings), words)
    return pictures


def _draw_waiting(
    waiting: Sequence[_Drawing],
) -> Iterator[tuple[_Drawing, Pictures | OutputError | str]]:
    """Yield drawings with their pictures as these are drawn.

    The error of a file takes the place of the pictures, or a sentence about the end of
    a process.

    Args:
        waiting: the drawings that are not up to date.
    """
    processes = min(available_cores(), len(waiting) // _CASES_PER_PROCESS)
    if processes > 1:
        yield from spread(_draw, waiting, WorkerPool(processes))
        return
    for drawing in waiting:
        yield drawing, _draw(drawing)


def _draw(drawing: _Drawing) -> Pictures | OutputError:
    """Draw the pictures of a case and their small copies, and write their record.

    Returns the pictures, or the error of a file that cannot be read or written.
    """
    record = drawing.folder / _RECORD
    try:
        # Pictures of an interrupted run must not pass for those of this one.
        record.unlink(missing_ok=True)
        pictures = drawing.draw()
        write_page_pictures(drawing.folder, pictures.names)
        if not pictures.missing:  # a picture that failed is tried again
            content = {
                "drawn_of": _digest(drawing),
                "of_case": drawing.of_case,
                "names": pictures.names,
            }
            write_json(record, content)
    except OutputError as error:
        return error
    return pictures


def _existing_pictures(drawing: _Drawing) -> Pictures | None:
    """Return the pictures of a case that an earlier run drew from the same files.

    Returns None if they have to be drawn: if a file is missing, if the results, the
    fields or the code that draws have changed, or if charts of the case are missing.
    """
    try:
        record = json.loads((drawing.folder / _RECORD).read_bytes())
        names = [*record["names"]]
        has_charts_of_case = record["of_case"] or not drawing.of_case
        digest = record["drawn_of"]
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        return None
    if not has_charts_of_case or digest != _digest(drawing):
        return None
    for name in names:
        # The record may come from somebody else, and a name must not be a path.
        if not isinstance(name, str) or not re.fullmatch(NAME_PATTERN, name):
            return None
        files = [drawing.folder / f"{name}{ending}" for ending in PAGE_ENDINGS]
        caption = drawing.folder / f"{name}.txt"
        if not caption.is_file() or not any(file.is_file() for file in files):
            return None
    return Pictures(names)


def _digest(drawing: _Drawing) -> str:
    """Return the SHA-256 of all that the pictures of a case are drawn from.

    This is the results, the files of fields and the code that draws.  Raises
    OutputError if a file cannot be read.
    """
    digest = hashlib.sha256(_code_digest())
    of_fields = [path for path in drawing.folder.rglob("*") if path.suffix in _FIELDS]
    for path in [*drawing.files, *sorted(of_fields)]:
        digest.update(str(path.relative_to(drawing.folder)).encode())
        try:
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise output_error("read", path, error) from None
    return digest.hexdigest()


@functools.cache
def _code_digest() -> bytes:
    """Return the SHA-256 of the source files of the package that draw pictures."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for room in ("output", "pictures"):
        for file in sorted((package / room).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.digest()
