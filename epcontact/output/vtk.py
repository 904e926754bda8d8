"""Field results as VTK image files (.vti) that pyvista and ParaView open at once.

A surface is a plane of nx by ny points, a line a row of nx; point (i, j) is at (i dx, j
dy, 0). The point one period further equals the first one and is not stored.  The point
data are heights, pressure, gap and, of a capped or unloaded body, plastic_displacement
as 32-bit floats, and state as 8-bit integers (0 apart, 1 elastic, 2 plastic), in SI
units, which each array has as VTK's UNITS_LABEL and in the field data `unit.<name>`.

The displacement is gap + heights less the height of the flat, so the field data hold
`flat_height` in its place.  Numbers of 32 bits keep seven digits at half the size;
zeros stay exactly zero. Rounding may lift a capped pressure above the hardness by one
part in 10^7, so use the state to find plastic points.  `precision="double"` keeps every
bit, and the displacement.

The field data give the origin of the file and its figures, and anything that the caller
adds.  The numbers are raw bytes behind the XML head, so writing needs neither VTK,
whose import takes long, nor a copy of the fields.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.files import atomic_write, read_bytes
from epcontact.results import ContactResult
from epcontact.scene import Surface

#: Units of the standard fields; other fields are written without a unit.
UNITS = {
    "heights": "m",
    "pressure": "Pa",
    "gap": "m",
    "displacement": "m",
    "plastic_displacement": "m",
    "state": "1",
    "filled": "1",
}
#: Fields of small whole numbers, which are stored as bytes.
BYTES = ("state", "filled")

Attribute = str | float | int
Precision = Literal["single", "double"]

#: VTK's names of the types of numbers.
_TYPES = {"<f4": "Float32", "<f8": "Float64", "|u1": "UInt8", "<i8": "Int64"}
_CLOSING = b"</VTKFile>"


@dataclass(frozen=True)
class FieldFile:
    """The content of a .vti file: arrays [x, y] or [x], their spacing in m, and the
    field data.
    """

    source: Path | str
    fields: Mapping[str, NDArray[Any]]
    spacing: tuple[float, ...]
    attributes: Mapping[str, Attribute]
    units: Mapping[str, str]  # of fields and attributes, if the file gives them

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return next(iter(self.fields.values())).shape

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths in m after which the fields repeat."""
        return tuple(n * d for n, d in zip(self.shape, self.spacing, strict=True))

    @property
    def hardness(self) -> float:
        """The hardness in Pa, infinite if the file gives none."""
        hardness = self.attributes.get("hardness")
        return hardness if isinstance(hardness, float) else math.inf

    def field(self, name: str) -> NDArray[Any]:
        """Return the field called `name`.  Raises OutputError if the file holds
        none.
        """
        if name not in self.fields:
            names = ", ".join(sorted(self.fields))
            raise OutputError(f"{self.source} holds no field {name}, only {names}")
        return self.fields[name]


def write_fields(
    path: Path | str,
    result: ContactResult,
    surface: Surface,
    attributes: Mapping[str, Attribute] | None = None,
    *,
    precision: Precision = "single",
    units: Mapping[str, str] | None = None,
) -> None:
    """Write the fields of a result and, as field data, what it says of itself and
    `attributes`.
    """
    if not result.fields:
        raise OutputError(
            f"cannot write {path}: the method {result.method} gives no fields"
        )
    fields = {"heights": surface.heights, **result.fields}
    if surface.filled is not None:
        fields["filled"] = surface.filled
    everything = {**_result_attributes(result), **(attributes or {})}
    level = _flat_height(fields) if precision == "single" else None
    if level is not None:
        del fields["displacement"]
        everything["flat_height"] = level
    about = {
        name: str(entry["unit"]) for name, entry in result.provenance.about.items()
    }
    known = {"flat_height": "m", **about, **(units or {})}
    write_image(
        path, fields, surface.spacing, everything, precision=precision, units=known
    )


def write_image(
    path: Path | str,
    fields: Mapping[str, NDArray[Any]],
    spacing: tuple[float, ...],
    attributes: Mapping[str, Attribute],
    *,
    precision: Precision = "single",
    units: Mapping[str, str] | None = None,
) -> None:
    """Write arrays [x, y] or [x] on one grid, and field data with the units of some of
    them.
    """
    if Path(path).suffix != ".vti":
        raise OutputError(f"cannot write {path}: a field file must be named .vti")
    shapes = {np.shape(field) for field in fields.values()}
    if len(shapes) != 1 or len(min(shapes)) != len(spacing) or len(spacing) > 2:
        raise ValueError(
            f"fields of the shapes {shapes} lie on no grid of spacing {spacing}"
        )
    planes = {
        name: np.reshape(field, (len(field), -1)) for name, field in fields.items()
    }
    known = UNITS | {
        name: unit for name, unit in (units or {}).items() if unit not in ("", "–")
    }
    named = {
        f"unit.{name}": known[name] for name in (*fields, *attributes) if name in known
    }
    told = {name: _stored(value) for name, value in {**attributes, **named}.items()}
    real = "<f4" if precision == "single" else "<f8"
    kinds = {name: np.dtype("|u1" if name in BYTES else real) for name in planes}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        file.write(_head(planes, kinds, spacing, told).encode())
        for values in told.values():
            file.write(np.array(values.nbytes, "<u8").tobytes() + values.tobytes())
        for name, plane in planes.items():
            file.write(np.array(plane.size * kinds[name].itemsize, "<u8").tobytes())
            # VTK stores x fastest; some columns at a time need no copy of the field.
            for j in range(0, plane.shape[1], 64):
                file.write(
                    np.ascontiguousarray(plane[:, j : j + 64].T, kinds[name]).data
                )
        file.write(b"\n</AppendedData>\n" + _CLOSING + b"\n")


def read_fields(path: Path | str) -> FieldFile:
    """Read a .vti file of this or another program.  Raises OutputError if it is
    damaged.
    """
    if b'type="ImageData"' not in read_bytes(path, 512):
        raise OutputError(f"cannot read {path}: it is no VTK image file (.vti)")
    image = read_quietly(path, "vtkXMLImageDataReader") if _closed(Path(path)) else None
    names = image.point_data.keys() if image is not None and image.n_points else ()
    if image is None or not names or None in names:
        raise OutputError(f"cannot read {path}: it is damaged or holds no point data")
    nx, ny, _ = image.dimensions
    shape = (nx,) if ny == 1 else (nx, ny)
    data = image.field_data
    names_of_data = data.keys()  # pyvista's own mapping, which cannot be iterated
    held = {n: data[n].tolist()[0] for n in names_of_data if len(data[n]) == 1}
    fields = {
        n: np.asarray(image.point_data[n]).reshape(shape, order="F") for n in names
    }
    return FieldFile(
        source=path,
        fields={name: np.ascontiguousarray(field) for name, field in fields.items()},
        spacing=tuple(image.spacing[: len(shape)]),
        attributes={k: v for k, v in held.items() if not k.startswith("unit.")},
        units={k[5:]: str(v) for k, v in held.items() if k.startswith("unit.")},
    )


def read_quietly(path: Path | str, reader: str) -> Any:
    """Read a file by a reader of VTK; None if it is damaged, with no complaint on the
    terminal.
    """
    import pyvista as pv
    from vtkmodules import vtkIOXML

    source = getattr(vtkIOXML, reader)()
    source.SetFileName(str(path))
    with pv.vtk_verbosity("off"), pv.VtkErrorCatcher(send_to_logging=False) as caught:
        source.Update()
    return None if caught.events else pv.wrap(source.GetOutput())


def _closed(path: Path) -> bool:
    """True if the file has its end: VTK takes numbers that are cut off for zeros."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 64))
        return file.read().rstrip().endswith(_CLOSING)


def _result_attributes(result: ContactResult) -> dict[str, Attribute]:
    """Return the field data of a result: figures of its last load step and its
    provenance.
    """
    final, provenance = result.final, result.provenance
    about = {name: entry["value"] for name, entry in provenance.about.items()}
    lists = {
        n: ", ".join(map(repr, v))
        for n, v in about.items()
        if isinstance(v, list | tuple)
    }
    attributes: dict[str, Any] = {
        "method": result.method,
        "converged": int(result.converged),
        "scene": provenance.scene,
        "mean_pressure": final.mean_pressure,
        **({} if provenance.seed is None else {"seed": provenance.seed}),
        **{
            f"area.{part}.{k}": v
            for k, a in final.areas.items()
            for part, v in vars(a).items()
        },
        **about,
        **lists,
        **({"notes": "; ".join(result.notes)} if result.notes else {}),
        **{f"residual.{name}": value for name, value in final.residuals.items()},
        **{f"iterations.{name}": value for name, value in final.iterations.items()},
        **{f"quantity.{name}": value for name, value in final.quantities.items()},
        **{f"version.{name}": value for name, value in provenance.versions.items()},
        **{f"option.{name}": value for name, value in provenance.options.items()},
    }
    return {
        k: v if isinstance(v, str | int | float) else str(v)
        for k, v in attributes.items()
    }


def _flat_height(fields: Mapping[str, NDArray[Any]]) -> float | None:
    """Return gap + heights - displacement if it is one number (in m), otherwise
    None.
    """
    if not {"gap", "displacement"} <= fields.keys():
        return None
    names = ("gap", "heights", "displacement")
    gap, heights, displacement = (np.atleast_2d(fields[name]) for name in names)
    # Row by row, because the sums of a large grid would be another copy of it.
    levels = (g + h - u for g, h, u in zip(gap, heights, displacement, strict=True))
    ends = np.array([(np.min(level), np.max(level)) for level in levels])
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    tolerance = 1e-6 * float(np.ptp(heights))  # ten roundings of a 32-bit number
    return (low + high) / 2 if high - low <= tolerance else None


def _stored(value: Attribute) -> NDArray[Any]:
    """Return an attribute as VTK stores it: a number, or the bytes of a string and a
    zero.
    """
    if isinstance(value, str) or (
        isinstance(value, int) and not -(2**63) <= value < 2**63
    ):
        return np.frombuffer(str(value).encode() + b"\0", "|u1")
    return np.array([value], "<i8" if isinstance(value, int) else "<f8")


def _head(
    planes: Mapping[str, NDArray[Any]],
    kinds: Mapping[str, np.dtype[Any]],
    spacing: tuple[float, ...],
    told: Mapping[str, NDArray[Any]],
) -> str:
    """Return the XML before the numbers, which follow in the order of `told` and
    `planes`.
    """
    offset, data, points = 0, "", ""
    for name, values in told.items():
        look = f'Name={quoteattr(name)} NumberOfTuples="1" format="appended" offset="{offset}"'
        kind = _TYPES[values.dtype.str]
        text = kind == "UInt8"
        data += (
            f'<Array type="String" {look}/>'
            if text
            else f'<DataArray type="{kind}" {look}/>'
        )
        offset += 8 + values.nbytes
    for name, plane in planes.items():
        look = f'Name={quoteattr(name)} format="appended" offset="{offset}"'
        label = f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{UNITS.get(name)}'
        inside = f"{label}</InformationKey>" if name in UNITS else ""
        points += (
            f'<DataArray type="{_TYPES[kinds[name].str]}" {look}>{inside}</DataArray>'
        )
        offset += 8 + plane.size * kinds[name].itemsize
    nx, ny = next(iter(planes.values())).shape
    extent = f"0 {nx - 1} 0 {ny - 1} 0 0"
    # A line has no spacing across; that along it keeps cells from collapsing.
    steps = " ".join(
        repr(float(d)) for d in (*spacing, *(spacing[0],) * (3 - len(spacing)))
    )
    shown = quoteattr("pressure" if "pressure" in planes else list(planes)[-1])
    return (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64">\n<ImageData WholeExtent="{extent}" Origin="0 0 0" '
        f'Spacing="{steps}">\n<FieldData>{data}</FieldData>\n<Piece Extent="{extent}">'
        f"<PointData Scalars={shown}>{points}</PointData></Piece>\n</ImageData>\n"
        '<AppendedData encoding="raw">\n_'
    )
