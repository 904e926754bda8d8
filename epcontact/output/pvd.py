"""ParaView collections (.pvd): which file holds which load step."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from epcontact.errors import OutputError
from epcontact.output.files import write_text


@dataclass(frozen=True)
class Step:
    """One entry: the file and its place in the sequence (time, or the mean pressure in Pa)."""

    path: Path
    value: float


def write_pvd(path: Path | str, steps: Sequence[Step]) -> None:
    """Write the collection `path`, whose files are named relative to its own folder.

    Raises OutputError.
    """
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    folder = Path(path).resolve().parent
    for step in steps:
        try:
            name = step.path.resolve().relative_to(folder)
        except ValueError:
            name = step.path.resolve()
        ET.SubElement(
            collection, "DataSet", timestep=repr(float(step.value)), part="0", file=name.as_posix()
        )
    ET.indent(root)
    write_text(path, '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n")


def read_pvd(path: Path | str) -> list[Step]:
    """The steps of the collection `path`, in the order of their values.

    Raises OutputError if it is none, or names no file.
    """
    try:
        entries = ET.parse(path).getroot().findall("./Collection/DataSet")
        steps = [
            Step(Path(path).parent / entry.attrib["file"], float(entry.get("timestep", "0")))
            for entry in entries
        ]
    except OSError as error:
        raise OutputError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from None
    except (ET.ParseError, KeyError, ValueError):
        raise OutputError(f"cannot read {path}: it is no ParaView collection") from None
    if not steps:
        raise OutputError(f"cannot read {path}: it names no file")
    return sorted(steps, key=lambda step: step.value)
