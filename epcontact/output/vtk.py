"""Field results as VTK image files (.vti) that pyvista and ParaView open at once.

A surface is a plane of nx by ny points, a line a row of nx; point (i, j) is at (i dx, j dy, 0).
The point one period further equals the first one and is not stored.  The point data are in SI units
(each array has its unit, as VTK's UNITS_LABEL and in the field data `unit.<name>`):

    heights, pressure, gap, displacement    32-bit floats
    state                                   8-bit integers: 0 apart, 1 elastic, 2 plastic

Numbers of 32 bits keep seven digits at half the size; zeros stay exactly zero.  Rounding may lift
a capped pressure above the hardness by one part in 10^7, so use the state to find plastic points.
`precision="double"` keeps every bit.  The data are compressed by zlib, which every reader of the
format knows.  VTK stores x fastest, so the arrays [x, y] are transposed.

The field data give the origin of the file: method, scene digest, seed, versions, mean pressure,
areas, residuals, and anything that the caller adds, such as the hardness.

Writing needs extra memory of half the size of the fields in single precision, and of their size in
double.  pyvista is imported where it is used, because its import takes a second.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.output.files import read_bytes, whole_file
from epcontact.results import ContactResult
from epcontact.scene import Surface

#: Units of the standard fields; other fields are written without a unit.
UNITS = {"heights": "m", "pressure": "Pa", "gap": "m", "displacement": "m", "state": "1"}

Attribute = str | float | int


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
    precision: Literal["single", "double"] = "single",
) -> None:
    """Write the fields of a result to a .vti file.

    Args:
        path: The path of the file, which must end in .vti.
        result: The result.  Its figures and residuals at the last load step and its provenance
            become field data.
        surface: The surface on whose grid the fields are.  Its heights are added if the result
            has none.
        attributes: Further field data, which override those of the result.
        precision: The precision of the numbers in the file.

    Raises:
        OutputError: If the result has no fields or the file cannot be written.
        ValueError: If a field is not on the surface's grid.
    """
    if not result.fields:
        raise OutputError(f"cannot write {path}: the method {result.method} gives no fields")
    fields = {"heights": surface.heights, **result.fields}
    everything = {**_result_attributes(result), **(attributes or {})}
    write_image(path, fields, surface.spacing, everything, precision=precision)


def write_image(
    path: Path | str,
    fields: Mapping[str, NDArray[Any]],
    spacing: tuple[float, ...],
    attributes: Mapping[str, Attribute],
    *,
    precision: Literal["single", "double"] = "single",
) -> None:
    """Write arrays on one grid to a .vti file.

    Args:
        path: The path of the file, which must end in .vti.
        fields: Arrays [x, y] or [x] of one shape, by name.
        spacing: Distance of grid points along each direction, in m.
        attributes: The field data.
        precision: The precision of the numbers in the file.

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
    import pyvista as pv
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    if Path(path).suffix != ".vti":
        raise OutputError(f"cannot write {path}: a field file must be named .vti")
    image = _image(fields, spacing, np.float32 if precision == "single" else np.float64)
    units = {f"unit.{name}": UNITS[name] for name in fields if name in UNITS}
    _add_field_data(image, {**attributes, **units})
    # Not `image.save`, whose inline base64 makes files a third larger and takes twice the time.
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetDataModeToAppended()
    writer.SetHeaderTypeToUInt64()  # arrays beyond 4 GiB
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToZLib()
    writer.SetCompressionLevel(1)  # level 5 took as long and saved half a per cent
    with whole_file(path) as temporary:
        writer.SetFileName(str(temporary))
        with pv.vtk_verbosity("off"), pv.VtkErrorCatcher(send_to_logging=False) as caught:
            written = writer.Write()
        if not written or caught.events or writer.GetErrorCode():
            raise OutputError(f"cannot write {path}: {_reason(caught, writer.GetErrorCode())}")


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


def _image(fields: Mapping[str, NDArray[Any]], spacing: tuple[float, ...], real: type) -> Any:
    """Return the pyvista image of the fields; its arrays are copies with x fastest."""
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkDataArray

    arrays = {name: np.asarray(field) for name, field in fields.items()}
    shape = next(iter(arrays.values())).shape
    for name, array in arrays.items():
        if array.shape != shape or array.ndim != len(spacing) or array.ndim not in (1, 2):
            raise ValueError(
                f"the field {name} has shape {array.shape}, but {shape} on a grid of "
                f"{len(spacing)} directions is needed"
            )
    # A direction of one point has no spacing; that of the other one keeps cells from collapsing.
    missing = 3 - len(shape)
    image = pv.ImageData(
        dimensions=(*shape, *(1,) * missing), spacing=(*spacing, *(spacing[0],) * missing)
    )
    for name, array in arrays.items():
        kind = np.uint8 if name == "state" else real
        image.point_data[name] = np.ascontiguousarray(array.T, dtype=kind).ravel()
        if name in UNITS:
            information = image.GetPointData().GetArray(name).GetInformation()
            information.Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
    image.set_active_scalars("pressure" if "pressure" in arrays else name)
    return image


def _add_field_data(image: Any, attributes: Mapping[str, Attribute]) -> None:
    """Add arrays of one value; VTK adds the texts, because pyvista refuses non-ASCII text."""
    from vtkmodules.vtkCommonCore import vtkStringArray

    for name, value in attributes.items():
        if isinstance(value, str) or (isinstance(value, int) and not -(2**63) <= value < 2**63):
            array = vtkStringArray()
            array.SetName(name)
            array.InsertNextValue(str(value))
            image.GetFieldData().AddArray(array)
        else:
            image.field_data[name] = np.array([value])


def _reason(caught: Any, code: int) -> str:
    """Return why VTK did not write: its error code, or the last line of its first message."""
    from vtkmodules.vtkCommonMisc import vtkErrorCode

    if code:
        return str(vtkErrorCode.GetStringFromErrorCode(code)).lower()
    return str(caught.events[0].alert).splitlines()[-1] if caught.events else "no reason is given"
