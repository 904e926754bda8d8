"""Field results as .vti files: what was written is read back, by us and by pyvista."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista

from epcontact.errors import OutputError
from epcontact.output.vtk import FieldFile, read_fields, write_fields, write_image
from epcontact.results import APART, ELASTIC, PLASTIC, Areas, ContactResult, LoadStep, Provenance
from epcontact.scene import Surface

# Heights that are told apart at a glance are steep.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

HARDNESS = 5e8
PERIODS = (6e-6, 2e-4)


def asymmetric(shape: tuple[int, ...]) -> ContactResult:
    """Fields that no transposition, reflection or shift maps on themselves."""
    heights = 1e-6 * np.random.default_rng(20260721).standard_normal(shape)
    pressure = np.clip(heights * 1e15, 0, HARDNESS)
    state = np.where(pressure >= HARDNESS, PLASTIC, np.where(pressure > 0, ELASTIC, APART))
    areas = {"raw": Areas(0.3, 0.1, 0.2), "corrected": Areas(0.28, 0.11, 0.17)}
    step = LoadStep(1.25e8, areas, {"gap": 1.5e-9}, {"newton": 4}, {"mean_gap": 2e-7})
    fields = {"heights": heights, "pressure": pressure, "gap": -0.3 * heights,
              "displacement": 2 * heights + 1e-7, "state": state.astype(np.int8)}  # fmt: skip
    made = Provenance("digest", 7, {"law": "capped", "levels": [1, 2]})
    return ContactResult("bem", (step,), made, fields=fields)


def write(path: Path, result: ContactResult, *rest: Any, **options: Any) -> FieldFile:
    """Write a result, and read it back."""
    heights = result.fields.get("heights", np.eye(5, 3))
    write_fields(path, result, Surface(heights, PERIODS[: heights.ndim], seed=7), *rest, **options)
    return read_fields(path)


def test_every_value_is_at_its_place_in_single_and_double_precision(tmp_path: Path) -> None:
    result = asymmetric((6, 100))  # more columns than are copied at a time
    path = tmp_path / "out" / "bem.vti"
    single = write(path, result, {"hardness": HARDNESS})
    double = write(tmp_path / "double.vti", result, precision="double")
    image = pyvista.read(path)
    assert (image.dimensions, image.origin) == ((6, 100, 1), (0, 0, 0))
    assert (image.spacing[:2], image.active_scalars_name) == ((1e-6, 2e-6), "pressure")
    assert set(image.point_data.keys()) == set(result.fields)
    i, j = np.rint(image.points[:, :2] / image.spacing[:2]).astype(int).T
    for name, field in result.fields.items():
        assert np.array_equal(image.point_data[name], np.float32(field[i, j]))
        kind = np.uint8 if name == "state" else np.float32
        assert single.fields[name].dtype == kind
        assert np.array_equal(single.fields[name], field.astype(kind))
        assert np.array_equal(double.fields[name], field)
    assert image.field_data["hardness"][0] == HARDNESS
    assert image.field_data["unit.pressure"][0] == "Pa"
    assert single.periods == pytest.approx(PERIODS, rel=1e-15)


def test_the_file_says_where_it_comes_from_and_what_was_computed(tmp_path: Path) -> None:
    result = asymmetric((6, 4))
    about = {
        "young_modulus": {"value": 2e11, "unit": "Pa", "meaning": "E"},
        "periods": {"value": [6e-6, 8e-6], "unit": "m", "meaning": "period"},
        "body": {"value": "half-space", "unit": "", "meaning": "body"},
    }
    told = replace(result, notes=("one", "two"), provenance=replace(result.provenance, about=about))
    units = {"quantity.mean_gap": "m", "area.total.raw": "–", "quantity.absent": "Pa"}
    added = {"hardness": HARDNESS, "µ": "ü"}
    read = write(tmp_path / "x.vti", told, added, units=units)
    expected = {
        "method": "bem", "converged": 1, "scene": "digest", "seed": 7, "mean_pressure": 1.25e8,
        "area.total.raw": 0.3, "area.plastic.corrected": 0.17, "residual.gap": 1.5e-9,
        "iterations.newton": 4, "quantity.mean_gap": 2e-7, "option.law": "capped",
        "option.levels": "[1, 2]", "young_modulus": 2e11, "periods": "6e-06, 8e-06",
        "body": "half-space", "notes": "one; two", "version.numpy": np.__version__,
    }  # fmt: skip
    assert (expected | added).items() <= read.attributes.items()
    of_fields = {"heights": "m", "pressure": "Pa", "gap": "m", "displacement": "m", "state": "1"}
    of_figures = {"young_modulus": "Pa", "periods": "m", "quantity.mean_gap": "m"}
    assert read.units == of_fields | of_figures


def test_spacing_and_numbers_keep_every_bit(tmp_path: Path) -> None:
    spacing = (2.513274e-4 / 1024, math.pi * 1e-7)
    attributes = {"third": 1 / 3, "inf": math.inf, "big": 2**100, "seed": 2**62 + 1, "empty": "",
                  '<a> & "b"': "<c> & 'd'"}  # fmt: skip
    write_image(tmp_path / "x.vti", {"a": np.ones((3, 2))}, spacing, attributes)
    read = read_fields(tmp_path / "x.vti")
    assert read.spacing == spacing
    assert read.attributes == {**attributes, "big": str(2**100)}


@pytest.mark.parametrize("shape", [(6, 4), (7,)])
def test_a_displacement_that_follows_from_the_rest_is_left_out(shape: Any, tmp_path: Path) -> None:
    result = asymmetric(shape)
    displacement = 0.7 * result.fields["heights"] - 3e-7  # under a flat
    result.fields["displacement"] = displacement
    read = write(tmp_path / "x.vti", result)
    assert read.fields.keys() == result.fields.keys() - {"displacement"}
    assert (read.shape, read.units["flat_height"]) == (shape, "m")
    restored = read.fields["gap"] + read.fields["heights"] - read.attributes["flat_height"]
    assert restored == pytest.approx(displacement, abs=1e-6 * np.ptp(displacement))


def test_what_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for error, sentence, path, fields in (
        (OutputError, "bem gives no fields", "x.vti", {}),
        (OutputError, r"must be named \.vti", "x.vtk", {"gap": np.ones((5, 3))}),
        (ValueError, "lie on no grid", "x.vti", {"gap": np.ones((4, 5))}),
        (OutputError, "file", "file/x.vti", {"gap": np.ones((5, 3))}),
    ):
        with pytest.raises(error, match=sentence):
            write(tmp_path / path, replace(asymmetric((5, 3)), fields=fields))
        assert os.listdir(tmp_path) == ["file"]


def test_what_cannot_be_read(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.vti"
    with pytest.raises(OutputError, match="no such file"):
        read_fields(path)
    write(path, asymmetric((6, 100)), {"hardness": HARDNESS})
    whole = path.read_bytes()
    spoilt = {b"not a picture of anything": "no VTK image file"}
    spoilt |= {whole.replace(b"</Piece>", b"</Peace>"): "damaged"}
    spoilt |= {whole[: k * len(whole) // 40]: "cannot read" for k in range(40)}
    for content, sentence in spoilt.items():
        path.write_bytes(content)
        with pytest.raises(OutputError, match=sentence):
            read_fields(path)
    assert capfd.readouterr() == ("", "")
