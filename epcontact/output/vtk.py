"""Field results as VTK image files (.vti), which pyvista and ParaView open at once.

A surface of nx by ny points is a plane of nx + 1 by ny + 1 points, a line a row of
nx + 1 points.  Point (i, j) is at (i dx, j dy, 0).  The last row and column are those
of the next period and repeat the first ones, so that ParaView's integral of the
pressure is the load.  The field data `periodic_points` hold nx and ny, and
`read_fields` returns the fields without the repeated points.

The point data are heights, pressure, gap and, for a capped or unloaded body,
plastic_displacement as 32-bit floats, and state as 8-bit integers (0 apart, 1 elastic,
2 plastic).  All are in SI units.  Each array has its unit as VTK's UNITS_LABEL and in
the field data `unit.<name>`.

The displacement is gap + heights less the height of the flat, so the field data hold
`flat_height` instead.  Numbers of 32 bits keep seven digits at half the size; zeros
stay exactly zero.  Rounding may lift a capped pressure above the hardness by one part
in 10^7, so use the state to find plastic points.  `precision="double"` keeps every bit,
and the displacement.

The field data state the origin of the file, the quantities of the result, and anything
that the caller adds; lists of numbers, such as the load path, are arrays.  The numbers
are raw bytes behind the XML head, so writing needs neither VTK, whose import takes
long, nor a copy of the fields.
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
#: Fields of small whole numbers, which are stored in 8 bits: contact states, and the
#: mask of heights that were filled or replaced.
_SMALL = {"state", "filled"}

Attribute = str | float | int | tuple[float, ...]
Precision = Literal["single", "double"]

#: VTK's names of the types of numbers.
_TYPES = {"<f4": "Float32", "<f8": "Float64", "|u1": "UInt8", "<i8": "Int64"}
_REAL: Mapping[Precision, str] = {"single": "<f4", "double": "<f8"}
_CLOSING = b"</VTKFile>"
#: Each block of raw bytes begins with its length in bytes, a 64-bit integer.
_LENGTH = np.dtype("<u8")
#: Columns of a field that are written at a time, so that no copy of it is needed.
_COLUMNS = 64
#: Field data of this name hold the unit of a field or of other field data.
_UNIT = "unit."
#: Field data of this name hold the numbers of points of a period along each direction.
#: A file without them, which another program wrote, has no repeated points.
_PERIODIC = "periodic_points"


@dataclass(frozen=True)
class FieldFile:
    """The content of a .vti file.

    Attributes:
        source: the path of the file.
        fields: arrays [x, y] of a surface or [x] of a line, by name.
        spacing: distance of neighbouring points along each direction, in m.
        attributes: the field data by name, without the units.
        units: units of fields and attributes, as far as the file states them.
    """

    source: Path | str
    fields: Mapping[str, NDArray[Any]]
    spacing: tuple[float, ...]
    attributes: Mapping[str, Attribute]
    units: Mapping[str, str]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points of the fields of this file along each direction."""
        return next(iter(self.fields.values())).shape

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths along each direction, in m, after which the fields of this file
        repeat.

        A period is the number of grid points times their spacing.
        """
        return tuple(n * d for n, d in zip(self.shape, self.spacing, strict=True))

    @property
    def hardness(self) -> float:
        """The hardness in Pa, infinite if the file states none."""
        hardness = self.attributes.get("hardness")
        return hardness if isinstance(hardness, float) else math.inf

    def field(self, name: str) -> NDArray[Any]:
        """Return one field of this file, [x, y] of a surface or [x] of a line.

        Args:
            name: the name of the field, such as "pressure", which is in Pa.

        Raises:
            OutputError: if the file has no field of this name.
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
    """Write the fields of a result to a .vti file.

    Args:
        path: the file; its name ends with .vti.
        result: the result, whose quantities and provenance become field data.
        surface: the surface, which gives the spacing and, if the result has none, the
            heights.
        attributes: more field data, by name.
        precision: "single" (32 bits) or "double" (64 bits) for the fields.
        units: units of the attributes, by name.

    Raises:
        OutputError: if the result has no fields, or if the file cannot be written.
    """
    if not result.fields:
        raise OutputError(
            f"cannot write {path}: the method {result.method} gives no fields"
        )
    fields = {"heights": surface.heights, **result.fields}
    if surface.filled is not None:
        fields["filled"] = surface.filled
    field_data = _result_attributes(result) | dict(attributes or {})
    if precision == "single":
        flat_height = _flat_height(fields)
        if flat_height is not None:
            del fields["displacement"]
            field_data["flat_height"] = flat_height
    all_units = {"flat_height": "m"}
    for name, entry in result.provenance.about.items():
        all_units[name] = str(entry["unit"])
    all_units |= units or {}
    write_image(
        path, fields, surface.spacing, field_data, precision=precision, units=all_units
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
    """Write arrays on one grid to a .vti file.

    Args:
        path: the file; its name ends with .vti.
        fields: arrays [x, y] or [x] of one shape, by name.
        spacing: distance of neighbouring points along each direction, in m.
        attributes: the field data, by name.
        precision: "single" (32 bits) or "double" (64 bits) for the fields, except state
            and filled, which are stored as 8-bit integers.
        units: units of fields and attributes beside UNITS, by name.

    Raises:
        OutputError: if the file has another ending or cannot be written.
        ValueError: if the fields have different shapes or another dimension than the
            spacing.
    """
    if Path(path).suffix != ".vti":
        raise OutputError(f"cannot write {path}: a field file must be named .vti")
    shapes = {np.shape(field) for field in fields.values()}
    dimensions = {len(shape) for shape in shapes}
    if len(shapes) != 1 or dimensions != {len(spacing)} or len(spacing) > 2:
        raise ValueError(
            f"fields of the shapes {shapes} lie on no grid of spacing {spacing}"
        )
    planes = {n: np.reshape(field, (len(field), -1)) for n, field in fields.items()}
    all_units = dict(UNITS)
    for name, unit in (units or {}).items():
        if unit not in ("", "–"):
            all_units[name] = unit
    named_units = {
        f"{_UNIT}{name}": all_units[name]
        for name in (*fields, *attributes)
        if name in all_units
    }
    shape = next(iter(shapes))
    everything = {**attributes, **named_units, _PERIODIC: shape}
    field_data = {name: _stored_value(value) for name, value in everything.items()}
    kinds = {name: np.dtype(_REAL[precision]) for name in planes}
    for name in kinds.keys() & _SMALL:
        kinds[name] = np.dtype("|u1")
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        file.write(_xml_head(planes, kinds, spacing, field_data).encode())
        for values in field_data.values():
            file.write(np.array(values.nbytes, _LENGTH).tobytes())
            file.write(values.tobytes())
        for name, plane in planes.items():
            kind = kinds[name]
            size = math.prod(_closed_shape(plane.shape)) * kind.itemsize
            file.write(np.array(size, _LENGTH).tobytes())
            starts = range(0, plane.shape[1], _COLUMNS)
            blocks = [plane[:, start : start + _COLUMNS] for start in starts]
            if len(shape) == 2:
                blocks.append(plane[:, :1])  # of the next period
            for columns in blocks:
                closed = np.concatenate([columns, columns[:1]])
                # VTK stores x fastest.
                file.write(np.ascontiguousarray(closed.T, kind).data)
        file.write(b"\n</AppendedData>\n" + _CLOSING + b"\n")


def _closed_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the numbers of points (x, y) in a file, with those of the next period.

    Args:
        shape: the numbers of points of one period; (nx, 1) or (nx,) for a line.
    """
    nx, ny = (*shape, 1)[:2]
    if ny == 1:
        return nx + 1, 1
    return nx + 1, ny + 1


def read_fields(path: Path | str) -> FieldFile:
    """Return the fields and the field data of a .vti file of this or another program.

    Points that repeat those of the first row and column are left out.

    Raises:
        OutputError: if the file cannot be read, is no .vti file, is damaged, or holds
            no point data.
    """
    if b'type="ImageData"' not in read_bytes(path, 512):
        raise OutputError(f"cannot read {path}: it is no VTK image file (.vti)")
    image = _read_image(Path(path))
    if image is None:
        raise OutputError(f"cannot read {path}: it is damaged or holds no point data")
    nx, ny, _ = image.dimensions
    shape: tuple[int, ...] = (nx, ny)
    if ny == 1:
        shape = (nx,)
    data = image.field_data
    period = shape
    if _PERIODIC in data.keys():  # noqa: SIM118 - it cannot be iterated
        period = tuple(np.ravel(data[_PERIODIC]).tolist())
        if _closed_shape(period) != (nx, ny):
            raise OutputError(
                f"cannot read {path}: it has {nx} x {ny} points, but states a period "
                f"of {' x '.join(map(str, period))}, which are repeated at its end"
            )
    kept = tuple(slice(count) for count in period)
    fields = {}
    for name in image.point_data.keys():  # noqa: SIM118 - pyvista's own mapping
        values = np.asarray(image.point_data[name]).reshape(shape, order="F")
        fields[name] = np.ascontiguousarray(values[kept])
    attributes: dict[str, Attribute] = {}
    units = {}
    for name in data.keys():  # noqa: SIM118 - it cannot be iterated
        values = data[name].tolist()
        if name.startswith(_UNIT):
            units[name.removeprefix(_UNIT)] = str(values[0])
        elif len(values) == 1:
            attributes[name] = values[0]
        elif name != _PERIODIC and data[name].ndim == 1:
            attributes[name] = tuple(values)
    spacing = image.spacing[: len(period)]
    return FieldFile(path, fields, spacing, attributes, units)


def read_quietly(path: Path | str, reader: str) -> Any:
    """Return what VTK reads from a file, without VTK's messages on the terminal.

    Args:
        path: the file.
        reader: name of a class of vtkIOXML, such as "vtkXMLImageDataReader".

    Returns:
        The data set of pyvista; None if VTK finds the file damaged.
    """
    import pyvista as pv
    from vtkmodules import vtkIOXML

    source = getattr(vtkIOXML, reader)()
    source.SetFileName(str(path))
    with pv.vtk_verbosity("off"), pv.VtkErrorCatcher(send_to_logging=False) as caught:
        source.Update()
    if caught.events:
        return None
    return pv.wrap(source.GetOutput())


def _read_image(path: Path) -> Any:
    """Return the content of a .vti file as an image of pyvista.

    It is None if the file is damaged or has no point data.  Raises OSError if the file
    cannot be opened.
    """
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 64))
        # VTK takes numbers that are missing at the end of a file for zeros.
        if not file.read().rstrip().endswith(_CLOSING):
            return None
    image = read_quietly(path, "vtkXMLImageDataReader")
    if image is None or not image.n_points:
        return None
    names = image.point_data.keys()
    if not names or None in names:
        return None
    return image


def _result_attributes(result: ContactResult) -> dict[str, Attribute]:
    """Return what a .vti file states about a result, beside its fields.

    Args:
        result: the result of a method.

    Returns:
        Texts and numbers by name: method, convergence, scene, mean pressure (Pa), and
        the areas, residuals, iterations and quantities of the last load step (names
        such as "area.total.raw" and "quantity.mean_gap"), versions and options.
    """
    final = result.final
    provenance = result.provenance
    attributes: dict[str, Any] = {
        "method": result.method,
        "converged": int(result.converged),
        "scene": provenance.scene,
        "mean_pressure": final.mean_pressure,
    }
    if provenance.seed is not None:
        attributes["seed"] = provenance.seed
    for kind, areas in final.areas.items():
        for part, area in vars(areas).items():
            attributes[f"area.{part}.{kind}"] = area
    for name, entry in provenance.about.items():
        value = entry["value"]
        if isinstance(value, list):
            value = tuple(value)
        attributes[name] = value
    if result.notes:
        attributes["notes"] = "; ".join(result.notes)
    groups: dict[str, Mapping[str, Any]] = {
        "residual": final.residuals,
        "iterations": final.iterations,
        "quantity": final.quantities,
        "version": provenance.versions,
        "option": provenance.options,
    }
    for group, values in groups.items():
        for name, value in values.items():
            attributes[f"{group}.{name}"] = value
    for name, value in attributes.items():
        if not isinstance(value, str | int | float | tuple):
            attributes[name] = str(value)
    return attributes


def _flat_height(fields: Mapping[str, NDArray[Any]]) -> float | None:
    """Return the height of the rigid flat in m: gap + heights - displacement.

    Args:
        fields: arrays of one shape, (nx, ny) or (nx,), in m, by name.

    Returns:
        The height; None if gap or displacement is missing, if a value is NaN, or if the
        height is not the same at all points up to the rounding of a 32-bit number.
    """
    if not {"gap", "displacement"} <= fields.keys():
        return None
    names = ("gap", "heights", "displacement")
    gap, heights, displacement = (np.atleast_2d(fields[name]) for name in names)
    lowest, highest = math.inf, -math.inf
    # Row by row, because the sums of a large grid would be another copy of it.
    for gap_row, heights_row, moved_row in zip(gap, heights, displacement, strict=True):
        levels = gap_row + heights_row - moved_row
        lowest = np.minimum(lowest, levels.min())
        highest = np.maximum(highest, levels.max())
    tolerance = 1e-6 * float(np.ptp(heights))  # ten roundings of a 32-bit number
    if highest - lowest <= tolerance:
        return float(lowest + highest) / 2
    return None  # also for NaN


def _stored_value(value: Attribute) -> NDArray[Any]:
    """Return an entry of the field data as the array that VTK stores.

    A float becomes an array of one 64-bit float, an integer of at most 64 bits an array
    of one integer, and a tuple of such numbers an array of its length.  Anything else
    becomes the bytes of its text, ended by a zero.
    """
    if isinstance(value, tuple) and value:
        numbers = np.array(value)
        if numbers.dtype.kind == "f":
            return numbers.astype("<f8")
        if numbers.dtype.kind == "i":
            return numbers.astype("<i8")
    if isinstance(value, float):
        return np.array([value], "<f8")
    if isinstance(value, int) and -(2**63) <= value < 2**63:
        return np.array([value], "<i8")
    return np.frombuffer(str(value).encode() + b"\0", "|u1")


def _xml_head(
    planes: Mapping[str, NDArray[Any]],
    kinds: Mapping[str, np.dtype[Any]],
    spacing: tuple[float, ...],
    field_data: Mapping[str, NDArray[Any]],
) -> str:
    """Return the text of a .vti file that is before its numbers.

    The numbers must follow in the order of `field_data` and `planes`, each block of
    them after its length in bytes.

    Args:
        planes: the fields (nx, ny) by name; ny is 1 for a line.
        kinds: the type of the numbers of each field in the file, by name.
        spacing: distance of neighbouring points along each direction, in m.
        field_data: the entries of the field data as arrays, see `_stored_value`.
    """
    offset = 0
    field_elements = ""
    for name, values in field_data.items():
        kind = _TYPES[values.dtype.str]
        element = f'<DataArray type="{kind}"'
        if kind == "UInt8":
            element = '<Array type="String"'
        count = 1 if kind == "UInt8" else values.size
        place = f'Name={quoteattr(name)} NumberOfTuples="{count}" format="appended"'
        field_elements += f'{element} {place} offset="{offset}"/>'
        offset += _LENGTH.itemsize + values.nbytes
    point_elements = ""
    for name, plane in planes.items():
        kind = _TYPES[kinds[name].str]
        place = f'Name={quoteattr(name)} format="appended" offset="{offset}"'
        label = ""
        if name in UNITS:
            key = 'name="UNITS_LABEL" location="vtkDataArray"'
            label = f"<InformationKey {key}>{UNITS[name]}</InformationKey>"
        point_elements += f'<DataArray type="{kind}" {place}>{label}</DataArray>'
        size = math.prod(_closed_shape(plane.shape))
        offset += _LENGTH.itemsize + size * kinds[name].itemsize
    nx, ny = _closed_shape(next(iter(planes.values())).shape)
    extent = f"0 {nx - 1} 0 {ny - 1} 0 0"
    # A direction without a spacing gets that of x, so that cells do not collapse.
    steps = (*spacing, spacing[0], spacing[0])[:3]
    spacing_text = " ".join(repr(float(step)) for step in steps)
    active = [*planes][-1]
    if "pressure" in planes:
        active = "pressure"
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">\n'
        f'<ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="{spacing_text}">\n'
        f"<FieldData>{field_elements}</FieldData>\n"
        f'<Piece Extent="{extent}">'
        f"<PointData Scalars={quoteattr(active)}>{point_elements}</PointData></Piece>\n"
        "</ImageData>\n"
        '<AppendedData encoding="raw">\n_'
    )
