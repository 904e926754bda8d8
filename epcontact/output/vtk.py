"""Field results as VTK image files (.vti) that pyvista and ParaView open at once.

A surface is a plane of nx by ny points, a line a row of nx; point (i, j) lies at (i dx, j dy, 0).
The point one period further equals the first one and is not stored.  Point data, all in SI units
(each array carries its unit, as VTK's UNITS_LABEL and in the field data `unit.<name>`):

    heights, pressure, gap, displacement    32-bit floats
    state                                   8-bit integers: 0 apart, 1 elastic, 2 plastic

32 bits keep seven digits at half the size; zeros stay exactly zero.  As the rounding may lift a
capped pressure above the hardness by one part in 10^7, the state decides what is plastic.
`precision="double"` keeps every bit.  The data are compressed by zlib, which every reader of the
format knows.  VTK runs through x fastest where arrays here are [x, y], hence the transposition.

The field data hold what makes the file stand alone: method, scene digest, seed, versions, mean
pressure, areas, residuals, and whatever the caller adds, such as the hardness.

Memory: half the fields' own size on top of them in single precision, the same size in double.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.output.files import whole_file
from epcontact.results import ContactResult
from epcontact.scene import Scene, Surface

#: Units of the fields every method may give; other fields are written without a unit.
UNITS = {"heights": "m", "pressure": "Pa", "gap": "m", "displacement": "m", "state": "1"}

Attribute = str | float | int


@dataclass(frozen=True)
class FieldFile:
    """What a .vti file held.

    fields: arrays [x, y] or [x] by name, of the precision in the file.
    spacing: between grid points along each direction, in m.
    attributes: the field data: strings, integers and floats by name.
    units: of the fields, by name, where the file names them.
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


def scene_attributes(scene: Scene) -> dict[str, Attribute]:
    """What a field file should say about its scene, SI units."""
    material, body = scene.material, scene.body
    return {
        "scene": scene.digest,
        "young_modulus": material.young_modulus,
        "poisson_ratio": material.poisson_ratio,
        "hardness": material.hardness,
        "yield_stress": material.yield_stress,
        "body": body.kind,
        "depth": body.depth,
    }


def result_attributes(result: ContactResult) -> dict[str, Attribute]:
    """What a field file says about the result it comes from; the last load step's figures."""
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


def write_fields(
    path: Path | str,
    result: ContactResult,
    surface: Surface,
    attributes: Mapping[str, Attribute] | None = None,
    *,
    precision: Literal["single", "double"] = "single",
) -> None:
    """Write the fields of `result`, on the grid of `surface`, to the .vti file `path`.

    The surface's heights are added where the result has none; `attributes` (see
    `scene_attributes`) are added to those of the result, and win over them.

    Raises OutputError if the result has no fields or the file cannot be written, and ValueError
    if a field does not lie on the surface's grid.
    """
    if not result.fields:
        raise OutputError(f"cannot write {path}: the method {result.method} gives no fields")
    fields = {"heights": surface.heights, **result.fields}
    write_image(
        path,
        fields,
        surface.spacing,
        {**result_attributes(result), **(attributes or {})},
        precision=precision,
    )


def write_image(
    path: Path | str,
    fields: Mapping[str, NDArray[Any]],
    spacing: tuple[float, ...],
    attributes: Mapping[str, Attribute],
    *,
    precision: Literal["single", "double"] = "single",
) -> None:
    """Write arrays [x, y] or [x] of one shape, `spacing` (m) apart, to the .vti file `path`.

    Raises OutputError if the file cannot be written or is not named .vti, and ValueError if the
    arrays do not share one shape of as many directions as `spacing` has.
    """
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    if Path(path).suffix != ".vti":
        raise OutputError(f"cannot write {path}: a field file must be named .vti")
    image = _image(fields, spacing, np.float32 if precision == "single" else np.float64)
    units = {f"unit.{name}": UNITS[name] for name in fields if name in UNITS}
    for name, value in {**attributes, **units}.items():
        image.GetFieldData().AddArray(_attribute(name, value))
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetDataModeToAppended()
    writer.SetHeaderTypeToUInt64()  # arrays beyond 4 GiB
    writer.EncodeAppendedDataOff()  # raw bytes; base64 would add a third to the size
    writer.SetCompressorTypeToZLib()
    writer.SetCompressionLevel(1)  # level 5 took as long and saved half a per cent
    with whole_file(path) as temporary:
        writer.SetFileName(str(temporary))
        with _complaints() as complaints:
            written = writer.Write()
        if not written or complaints or writer.GetErrorCode():
            raise OutputError(f"cannot write {path}: {_why(complaints, writer.GetErrorCode())}")


def read_fields(path: Path | str) -> FieldFile:
    """Read a file that `write_fields` or `write_image` has written.

    Raises OutputError if there is no such file or it is no whole image file.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    try:
        with Path(path).open("rb") as file:
            head = file.read(512)
    except OSError as error:
        raise OutputError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from None
    if b'type="ImageData"' not in head:
        raise OutputError(f"cannot read {path}: it is no VTK image file (.vti)")
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    with _complaints() as complaints:
        reader.Update()
    image = reader.GetOutput()
    data = image.GetPointData()
    count = data.GetNumberOfArrays()
    if complaints or reader.GetErrorCode() or not count or not image.GetNumberOfPoints():
        raise OutputError(f"cannot read {path}: it is damaged or holds no point data")
    nx, ny, _ = image.GetDimensions()
    shape = (nx,) if ny == 1 else (nx, ny)
    arrays = [data.GetArray(i) for i in range(count)]
    held = _field_data(image.GetFieldData())
    if None in held or None in (a.GetName() for a in arrays):
        raise OutputError(f"cannot read {path}: it is damaged")
    return FieldFile(
        fields={
            a.GetName(): np.ascontiguousarray(vtk_to_numpy(a).reshape(shape, order="F"))
            for a in arrays
        },
        spacing=tuple(image.GetSpacing()[: len(shape)]),
        attributes={k: v for k, v in held.items() if not k.startswith("unit.")},
        units={k[5:]: str(v) for k, v in held.items() if k.startswith("unit.")},
    )


def _image(fields: Mapping[str, NDArray[Any]], spacing: tuple[float, ...], real: type) -> Any:
    """The vtkImageData of the fields; its arrays are copies, x running fastest."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkDataArray
    from vtkmodules.vtkCommonDataModel import vtkImageData

    arrays = {name: np.asarray(field) for name, field in fields.items()}
    shape = next(iter(arrays.values())).shape
    for name, array in arrays.items():
        if array.shape != shape or array.ndim != len(spacing) or array.ndim not in (1, 2):
            raise ValueError(
                f"the field {name} has shape {array.shape}, but {shape} on a grid of "
                f"{len(spacing)} directions is needed"
            )
    image = vtkImageData()
    image.SetDimensions(*shape, *(1,) * (3 - len(shape)))
    image.SetOrigin(0.0, 0.0, 0.0)
    # A direction of one point has no spacing; the other one's keeps the cells from collapsing.
    image.SetSpacing(*spacing, *(spacing[0],) * (3 - len(shape)))
    for name, array in arrays.items():
        kind = np.uint8 if name == "state" else real
        data = numpy_to_vtk(np.ascontiguousarray(array.T, dtype=kind).ravel(), deep=False)
        data.SetName(name)
        if name in UNITS:
            data.GetInformation().Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
        image.GetPointData().AddArray(data)
    image.GetPointData().SetActiveScalars("pressure" if "pressure" in arrays else name)
    return image


def _attribute(name: str, value: Attribute) -> Any:
    """A field-data array of one value."""
    from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkLongLongArray, vtkStringArray

    array: Any
    if isinstance(value, str):
        array = vtkStringArray()
    elif isinstance(value, int | np.integer) and -(2**63) <= value < 2**63:
        array, value = vtkLongLongArray(), int(value)
    elif isinstance(value, int):
        array, value = vtkStringArray(), str(value)
    else:
        array, value = vtkDoubleArray(), float(value)
    array.SetName(name)
    array.InsertNextValue(value)
    return array


def _field_data(data: Any) -> dict[str, Attribute]:
    held: dict[str, Attribute] = {}
    for i in range(data.GetNumberOfArrays()):
        array = data.GetAbstractArray(i)
        if array.GetNumberOfValues() == 1:
            held[array.GetName()] = array.GetValue(0)
    return held


@contextlib.contextmanager
def _complaints() -> Iterator[list[str]]:
    """Collect what VTK would print on the terminal."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    complaints: list[str] = []
    before, catcher = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(catcher)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)  # it logs beside the window
    try:
        yield complaints
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(before)
        if text := catcher.GetOutput().strip():
            complaints.append(text)


def _why(complaints: list[str], code: int) -> str:
    from vtkmodules.vtkCommonMisc import vtkErrorCode

    if code:
        return str(vtkErrorCode.GetStringFromErrorCode(code)).lower()
    return complaints[0].splitlines()[-1] if complaints else "VTK gives no reason"
