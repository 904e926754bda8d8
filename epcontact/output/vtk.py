"""Field results as VTK image files (.vti) that pyvista and ParaView open at once.

A surface is a plane of nx by ny points, a line a row of nx; point (i, j) is at (i dx, j dy, 0).
The point one period further equals the first one and is not stored.  The point data are in SI units
(each array has its unit, as VTK's UNITS_LABEL and in the field data `unit.<name>`):

    heights, pressure, gap                  32-bit floats
    plastic_displacement                    32-bit floats, of a capped or unloaded body
    state                                   8-bit integers: 0 apart, 1 elastic, 2 plastic

The displacement is gap + heights less the height of the flat, so the field data hold `flat_height`
in its place.  Numbers of 32 bits keep seven digits at half the size; zeros stay exactly zero.
Rounding may lift a capped pressure above the hardness by one part in 10^7, so use the state to find
plastic points.  `precision="double"` keeps every bit, and the displacement.  VTK stores x fastest,
so the arrays [x, y] are transposed.

The data are compressed by LZ4, which VTK has read since 2017: on rough fields it takes a seventh of
the time of zlib for a tenth more bytes.  VTK asks for a large grid piece by piece, so that writing
needs extra memory for one piece and not for another copy of the fields.

The field data give the origin of the file: method, scene, surface, moduli, load, body, notes,
versions, areas, residuals, and anything that the caller adds, each with its unit if it has one.

VTK is imported where it is used, because its import takes long; fields are written without pyvista,
whose import takes longer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.machine import signals_wait
from epcontact.output.files import read_bytes, whole_file, write_text
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
}

Attribute = str | float | int
Precision = Literal["single", "double"]

#: Most points of a piece that is copied and compressed at once.
PIECE = 1 << 21
_CACHED = 1 << 16  # points whose sums stay in cache


@dataclass(frozen=True)
class FieldFile:
    """The content of a .vti file.

    Args:
        fields: Arrays [x, y] or [x] by name, in the precision of the file.
        spacing: Distance of grid points along each direction, in m.
        attributes: The field data: strings, integers and floats by name.
        units: The units of the fields by name, if the file gives them.
    """

    fields: Mapping[str, NDArray[Any]]
    spacing: tuple[float, ...]
    attributes: Mapping[str, Attribute]
    units: Mapping[str, str]

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return next(iter(self.fields.values())).shape

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths in m after which the fields repeat."""
        return tuple(n * d for n, d in zip(self.shape, self.spacing, strict=True))

    def field(self, name: str) -> NDArray[Any]:
        """Return the field called `name`.  Raises OutputError if the file holds none."""
        if name not in self.fields:
            names = ", ".join(sorted(self.fields))
            raise OutputError(f"the file holds no field {name}, only {names}")
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
        path: The path of the file, which must end in .vti.
        result: The result.  Its figures and residuals at the last load step, its notes and its
            provenance become field data.
        surface: The surface on whose grid the fields are.  Its heights are added if the result
            has none.
        attributes: Further field data, which override those of the result.
        precision: The precision of the numbers in the file; "double" keeps all fields, "single"
            leaves out a displacement that follows from gap and heights.
        units: Units of field data by name; those of `result.provenance.about` are known.

    Raises:
        OutputError: If the result has no fields or the file cannot be written.
        ValueError: If a field is not on the surface's grid.
    """
    if not result.fields:
        raise OutputError(f"cannot write {path}: the method {result.method} gives no fields")
    fields = {"heights": surface.heights, **result.fields}
    everything = {**_result_attributes(result), **(attributes or {})}
    level = _flat_height(fields) if precision == "single" else None
    if level is not None:
        del fields["displacement"]
        everything["flat_height"] = level
    about = {name: str(entry["unit"]) for name, entry in result.provenance.about.items()}
    known = {"flat_height": "m", **about, **(units or {})}
    write_image(path, fields, surface.spacing, everything, precision=precision, units=known)


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
        path: The path of the file, which must end in .vti.
        fields: Arrays [x, y] or [x] of one shape, by name.
        spacing: Distance of grid points along each direction, in m.
        attributes: The field data.
        precision: The precision of the numbers in the file.
        units: Units of attributes by name; attributes without a unit have no entry in the file.

    Raises:
        OutputError: If the file cannot be written or is not named .vti.
        ValueError: If the arrays differ in shape, or their dimension is not that of `spacing`.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     gap = {"gap": np.array([[0.0, 1e-9]])}
        ...     write_image(f"{folder}/a.vti", gap, (1e-6, 1e-6), {"method": "bem"})
        ...     read_fields(f"{folder}/a.vti").attributes["method"]
        'bem'
    """
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    if Path(path).suffix != ".vti":
        raise OutputError(f"cannot write {path}: a field file must be named .vti")
    arrays = _checked(fields, spacing)
    known = UNITS | {name: unit for name, unit in (units or {}).items() if unit not in ("", "–")}
    named = {f"unit.{name}": known[name] for name in (*fields, *attributes) if name in known}
    source = _streamed(arrays, spacing, precision, {**attributes, **named})
    # Not `image.save`, whose inline base64 makes files a third larger and takes twice the time.
    writer = vtkXMLImageDataWriter()
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetDataModeToAppended()
    writer.SetHeaderTypeToUInt64()  # arrays beyond 4 GiB
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToLZ4()
    writer.SetNumberOfPieces(-(-next(iter(arrays.values())).size // PIECE))
    with whole_file(path) as temporary:
        writer.SetFileName(str(temporary))
        shown = vtkObject.GetGlobalWarningDisplay()
        vtkObject.GlobalWarningDisplayOff()
        try:
            with signals_wait():
                written = writer.Write()
        finally:
            vtkObject.SetGlobalWarningDisplay(shown)
        if not written or writer.GetErrorCode():
            raise OutputError(f"cannot write {path}: {_reason(writer.GetErrorCode())}")


def write_collection(path: Path | str, mean_pressures: Sequence[float]) -> None:
    """Write a ParaView collection (.pvd) over the steps of a load path beside it.

    Args:
        path: The path of the collection; the step of number n is the file `step_name(n)` there.
        mean_pressures: In Pa, one for each step.  The time of a step is its number, because a path
            may unload; its mean pressure is its name.

    Raises:
        OutputError: If the file cannot be written.
    """
    entries = "".join(
        f'<DataSet timestep="{number}" part="0" name="mean pressure {float(pressure)!r} Pa" '
        f'file="{step_name(number)}"/>\n'
        for number, pressure in enumerate(mean_pressures)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n'
    write_text(path, f"{head}{entries}</Collection>\n</VTKFile>\n")


def step_name(number: int) -> str:
    """Return the file name of a step of a load path."""
    return f"step-{number:04d}.vti"


def read_fields(path: Path | str) -> FieldFile:
    """Read a file that `write_fields` or `write_image` has written.

    Args:
        path: The path of the file.

    Raises:
        OutputError: If there is no such file or it is not a whole image file.
    """
    import pyvista as pv
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    if b'type="ImageData"' not in read_bytes(path, 512):
        raise OutputError(f"cannot read {path}: it is no VTK image file (.vti)")
    # Not `pyvista.read`, which prints VTK's complaints about a damaged file.
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    with pv.vtk_verbosity("off"), pv.VtkErrorCatcher(send_to_logging=False) as caught:
        reader.Update()
    image: Any = pv.wrap(reader.GetOutput())
    names = image.point_data.keys()
    if caught.events or not names or not image.n_points or None in names:
        raise OutputError(f"cannot read {path}: it is damaged or holds no point data")
    nx, ny, _ = image.dimensions
    shape = (nx,) if ny == 1 else (nx, ny)
    data = image.field_data
    held = {name: data[name].tolist()[0] for name in data.keys() if len(data[name]) == 1}  # noqa: SIM118
    fields = {n: np.asarray(image.point_data[n]).reshape(shape, order="F") for n in names}
    return FieldFile(
        fields={name: np.ascontiguousarray(field) for name, field in fields.items()},
        spacing=tuple(image.spacing[: len(shape)]),
        attributes={k: v for k, v in held.items() if not k.startswith("unit.")},
        units={k[5:]: str(v) for k, v in held.items() if k.startswith("unit.")},
    )


def _result_attributes(result: ContactResult) -> dict[str, Attribute]:
    """Return the field data of a result: figures of its last load step and its provenance."""
    final, provenance = result.final, result.provenance
    attributes: dict[str, Attribute] = {
        "method": result.method,
        "converged": int(result.converged),
        "scene": provenance.scene,
        "mean_pressure": final.mean_pressure,
    }
    if provenance.seed is not None:
        attributes["seed"] = provenance.seed
    for kind, areas in final.areas.items():
        for part in ("total", "elastic", "plastic"):
            attributes[f"area.{part}.{kind}"] = getattr(areas, part)
    about = {name: entry["value"] for name, entry in provenance.about.items()}
    for name, value in about.items():
        attributes[name] = value if isinstance(value, str | int | float) else _listed(value)
    if result.notes:
        attributes["notes"] = "; ".join(result.notes)
    groups: dict[str, Mapping[str, Any]] = {
        "residual": final.residuals,
        "iterations": final.iterations,
        "quantity": final.quantities,
        "version": provenance.versions,
        "option": provenance.options,
    }
    for prefix, values in groups.items():
        for name, value in values.items():
            simple = isinstance(value, str | int | float)
            attributes[f"{prefix}.{name}"] = value if simple else str(value)
    return attributes


def _listed(value: Any) -> str:
    """Return a list of numbers as text with all digits."""
    return ", ".join(map(repr, value)) if isinstance(value, list | tuple) else str(value)


def _flat_height(fields: Mapping[str, NDArray[Any]]) -> float | None:
    """Return gap + heights - displacement if it is one number (in m), otherwise None."""
    names = ("gap", "heights", "displacement")
    if not all(name in fields for name in names):
        return None
    gap, heights, displacement = (np.asarray(fields[name]) for name in names)
    if not gap.shape == heights.shape == displacement.shape:
        return None
    ends: list[float] = []
    step = max(1, _CACHED // max(1, gap[0].size))
    for start in range(0, len(gap), step):
        rows = slice(start, start + step)
        level = gap[rows] + heights[rows] - displacement[rows]
        ends += [float(level.min()), float(level.max())]
    low, high = float(np.min(ends)), float(np.max(ends))
    tolerance = 1e-6 * float(np.ptp(heights))  # ten roundings of a 32-bit number
    return (low + high) / 2 if high - low <= tolerance else None


def _checked(
    fields: Mapping[str, NDArray[Any]], spacing: tuple[float, ...]
) -> dict[str, NDArray[Any]]:
    """Return the fields as arrays.  Raises ValueError unless all are on one grid."""
    arrays = {name: np.asarray(field) for name, field in fields.items()}
    shape = next(iter(arrays.values())).shape
    for name, array in arrays.items():
        if array.shape != shape or array.ndim != len(spacing) or array.ndim not in (1, 2):
            raise ValueError(
                f"the field {name} has shape {array.shape}, but {shape} on a grid of "
                f"{len(spacing)} directions is needed"
            )
    return arrays


def _streamed(
    arrays: Mapping[str, NDArray[Any]],
    spacing: tuple[float, ...],
    precision: Precision,
    attributes: Mapping[str, Attribute],
) -> Any:
    """Return a source of VTK that copies, with x fastest, only the part that a writer asks for."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
    from vtkmodules.vtkCommonCore import vtkDataArray
    from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData
    from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm, vtkStreamingDemandDrivenPipeline

    planes = {name: array.reshape(len(array), -1) for name, array in arrays.items()}
    nx, ny = next(iter(planes.values())).shape
    # A line has no spacing across; that along it keeps cells from collapsing.
    steps = (*spacing, *(spacing[0],) * (3 - len(spacing)))
    real = np.float32 if precision == "single" else np.float64

    class Source(VTKPythonAlgorithmBase):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkImageData")
            self._held: list[NDArray[Any]] = []

        def RequestInformation(self, _request: Any, _inputs: Any, outputs: Any) -> int:
            about = outputs.GetInformationObject(0)
            extent = (0, nx - 1, 0, ny - 1, 0, 0)
            about.Set(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT(), extent, 6)
            about.Set(vtkDataObject.SPACING(), steps, 3)
            about.Set(vtkDataObject.ORIGIN(), (0.0, 0.0, 0.0), 3)
            about.Set(vtkAlgorithm.CAN_PRODUCE_SUB_EXTENT(), 1)
            return 1

        def RequestData(self, _request: Any, _inputs: Any, outputs: Any) -> int:
            about = outputs.GetInformationObject(0)
            extent = about.Get(vtkStreamingDemandDrivenPipeline.UPDATE_EXTENT())
            x0, x1, y0, y1, *_ = extent
            part, self._held = vtkImageData(), []  # VTK uses the memory of the arrays
            part.SetExtent(extent)
            part.SetSpacing(steps)
            for name, plane in planes.items():
                kind = np.uint8 if name == "state" else real
                values = _transposed(plane[x0 : x1 + 1, y0 : y1 + 1], kind)
                self._held.append(values.ravel())
                array = numpy_to_vtk(self._held[-1])
                array.SetName(name)
                if name in UNITS:
                    array.GetInformation().Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
                part.GetPointData().AddArray(array)
            part.GetPointData().SetActiveScalars("pressure" if "pressure" in planes else name)
            _add_field_data(part, attributes)
            self.GetOutputData(outputs, 0).ShallowCopy(part)
            return 1

    return Source()


def _transposed(plane: NDArray[Any], kind: Any) -> NDArray[Any]:
    """Return a plane with its axes exchanged; a few rows at a time take half the time of all."""
    values = np.empty(plane.shape[::-1], dtype=kind)
    for i in range(0, len(plane), 8):
        values[:, i : i + 8] = plane[i : i + 8].T
    return values


def _add_field_data(image: Any, attributes: Mapping[str, Attribute]) -> None:
    """Add arrays of one value."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkStringArray

    for name, value in attributes.items():
        if isinstance(value, str) or (isinstance(value, int) and not -(2**63) <= value < 2**63):
            array: Any = vtkStringArray()
            array.InsertNextValue(str(value))
        else:
            array = numpy_to_vtk(np.array([value]), deep=True)
        array.SetName(name)
        image.GetFieldData().AddArray(array)


def _reason(code: int) -> str:
    """Return why VTK did not write."""
    from vtkmodules.vtkCommonMisc import vtkErrorCode

    return str(vtkErrorCode.GetStringFromErrorCode(code)).lower() if code else "no reason is given"
