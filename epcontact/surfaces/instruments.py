"""Heights from the files of instruments that SurfaceTopography reads.

The readers that a file's ending belongs to are tried first, and their reason is the
message if they fail.  A reader of another ending is used only if it recognises the
first bytes of the file.
"""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.surfaces.height_map import HeightMap
from epcontact.surfaces.map_errors import errors_of, require_small_archive
from epcontact.surfaces.profiles import profile_map
from epcontact.surfaces.text_headers import unit_in_metres

#: First bytes of a file by which a reader may recognise it.
_FIRST_BYTES = 512
#: Most names that a message or a note lists.
_LISTED = 12
#: Formats with units that epcontact reads, which a message recommends.
_GOOD_FORMATS = (".x3p", ".sur")


def read_instrument(path: Path, channel: str | None = None) -> HeightMap:
    """Return the heights of a file in any format of SurfaceTopography.

    The unit and the lengths are those that the file states.  A note names the channel
    that was read if the file has several.

    Args:
        path: the file.
        channel: the name of the channel; None for the reader's default, or for the
            first channel of heights if the default has none.

    Raises:
        InvalidScene: SurfaceTopography is not installed or cannot read the file, the
            file has no such channel or no heights in it, its points are on no regular
            grid, or an archive is far larger than a map.
    """
    try:
        import SurfaceTopography
    except ImportError:
        raise InvalidScene(
            f"{path}: reading {path.suffix or 'such'} files needs SurfaceTopography; "
            "pip install 'epcontact[instruments]', or convert it to .npy or text"
        ) from None
    if zipfile.is_zipfile(path):
        require_small_archive(path)
    opened, name = _opened(path, SurfaceTopography.IO)
    problem = f"the reader of {name} files cannot read it"
    with errors_of(path, problem, _remedy(path)), opened as reader:
        info, note = _channel(reader, channel, path)
        # A reader needs lengths for a map that states none; these replace them.
        has_even_steps = info.is_uniform is not False
        absent = info.physical_sizes is None and has_even_steps
        sizes = tuple(map(float, info.nb_grid_pts)) if absent else None
        topography = info.topography(physical_sizes=sizes)
        heights = np.ma.asarray(topography.heights(), np.float64)
        # Points without a height are masked.
        stored = HeightMap(np.ma.filled(heights, np.nan), notes=note)
        if not topography.is_uniform:
            if heights.ndim != 1:
                raise InvalidScene(
                    f"{path}: its points lie on no regular grid; resample it first"
                )
            stored = profile_map(topography.positions(), stored.heights)
        return _with_stated_scale(stored, topography, absent, note)


def _with_stated_scale(
    stored: HeightMap, topography: Any, absent: bool, note: tuple[str, ...]
) -> HeightMap:
    """Return a map with the unit and the lengths of a topography.

    Args:
        stored: the map with the heights.
        topography: the topography of SurfaceTopography.
        absent: whether the file states no lengths.
        note: the note on the channel.
    """
    word = topography.unit
    unit = None if word is None else unit_in_metres(word)
    periods = None
    if unit is not None and not absent:
        periods = stored.periods or tuple(map(float, topography.physical_sizes))
    return replace(
        stored,
        unit=unit,
        periods=periods,
        length_unit=unit,
        unit_source=f"its unit is {word}",
        size_source="the size that it stores",
        notes=(*note, *(n for n in stored.notes if n not in note)),
    )


def _opened(path: Path, library: Any) -> tuple[Any, str]:
    """Return the reader of SurfaceTopography that has opened a file, and its format.

    Args:
        path: the file.
        library: the module SurfaceTopography.IO.

    Raises:
        InvalidScene: No reader can read the file.  The message is that of the reader
            that the ending belongs to, if there is one.
    """
    suffix = path.suffix.lower().removeprefix(".")
    with path.open("rb") as file:
        first_bytes = file.read(_FIRST_BYTES)
    of_ending = []
    by_content = []
    for reader in library.readers:
        if reader.format() == "asc" and b"\0" in first_bytes:
            continue  # the reader of text cannot read a binary file
        if suffix in (reader.file_extensions() or ()):
            of_ending.append(reader)
        elif _recognises(reader, first_bytes):
            by_content.append(reader)
    failure: Exception | None = None
    failed = ""
    for reader in (*of_ending, *by_content):
        try:
            opened = library.open_topography(str(path), format=reader.format())
            return opened, reader.name()
        except Exception as error:
            # Text readers come last in a message: binary files have the same endings.
            if failure is None or reader.format() != "asc":
                failure = failure or error
                failed = failed or reader.name()
    if failure is None:
        raise InvalidScene(
            f"{path}: no reader knows the ending {path.suffix or 'of this file'}, and "
            f"none recognises its content; {_remedy(path)}"
        )
    problem = f"the reader of {failed} files cannot read it"
    library_error = getattr(library, "ReadFileError", OSError)
    if not isinstance(failure, library_error | OSError | ValueError):
        problem += ", which may be damaged or of another version: "
        problem += type(failure).__name__
    with errors_of(path, problem, _remedy(path)):
        raise RuntimeError(str(failure)) from failure


def _recognises(reader: Any, first_bytes: bytes) -> bool:
    """Return True if a reader recognises the first bytes of a file.

    A reader that does not refuse zeros accepts any file and recognises none.

    Args:
        reader: a class of SurfaceTopography.
        first_bytes: the beginning of the file.
    """
    refuses_zeros = reader.can_read(bytes(_FIRST_BYTES)).value == "no"
    return bool(refuses_zeros and reader.can_read(first_bytes).value != "no")


def _remedy(path: Path) -> str:
    """Return what a user can do with a file that no reader reads."""
    formats = [name for name in _GOOD_FORMATS if name != path.suffix.lower()]
    return (
        f"export the map from the instrument's software as {' or '.join(formats)}, "
        "which state their units, or as text, one line of heights after the other"
    )


def _channel(
    reader: Any, wanted: str | None, path: Path
) -> tuple[Any, tuple[str, ...]]:
    """Return the channel of a file that is read, and a note on it.

    Args:
        reader: the opened reader of SurfaceTopography.
        wanted: the name of the channel, or None.
        path: the file, for messages.

    Returns:
        What SurfaceTopography knows of the channel; and a note that names it and the
        others, or () if the file has one channel only.

    Raises:
        InvalidScene: The file has no such channel, or the channel holds no heights.
    """
    channels = list(reader.channels)
    names = [getattr(info, "channel_id", info.name) for info in channels]
    listed = ", ".join(f'"{name}"' for name in names[:_LISTED])
    if len(names) > _LISTED:
        listed += f" and {len(names) - _LISTED} others"
    if not channels:
        raise InvalidScene(
            f"{path}: holds no channel with a map of heights; {_remedy(path)}"
        )
    if wanted is None:
        default = reader.default_channel
        candidates = [info for info in (default, *channels) if info.is_height_channel]
        if not candidates:
            raise InvalidScene(f"{path}: none of its channels holds heights: {listed}")
        info = candidates[0]
    else:
        matching = [i for n, i in zip(names, channels, strict=True) if n == wanted]
        if not matching:
            raise InvalidScene(
                f'{path}: has no channel "{wanted}"; set channel to one of {listed}'
            )
        info = matching[0]
    name = getattr(info, "channel_id", info.name)
    if not info.is_height_channel:
        raise InvalidScene(
            f'{path}: its channel "{name}" is in {info.data_unit} and holds no '
            f"heights; set channel to another of {listed}"
        )
    if len(channels) == 1:
        return info, ()
    return info, (f'the channel "{name}" was read, of {listed}',)
