"""Field results as .vti files: what was written is read back, by us and by pyvista."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista

from epcontact.errors import OutputError
from epcontact.output.vtk import read_fields, write_fields, write_image
from epcontact.results import APART, ELASTIC, PLASTIC, Areas, ContactResult, LoadStep, Provenance
from epcontact.scene import Surface

# Heights that are told apart at a glance are steep.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

HARDNESS = 5e8


def asymmetric(shape: tuple[int, ...]) -> ContactResult:
    """Fields that no transposition, reflection or shift maps on themselves."""
    rng = np.random.default_rng(20260721)
    heights = 1e-6 * rng.standard_normal(shape)
    pressure = np.clip(heights * 1e15, 0, HARDNESS)
    state = np.where(pressure >= HARDNESS, PLASTIC, np.where(pressure > 0, ELASTIC, APART))
    return ContactResult(
        method="bem",
        steps=(
            LoadStep(
                1.25e8,
                {"raw": Areas(0.3, 0.1, 0.2), "corrected": Areas(0.28, 0.11, 0.17)},
                {"gap": 1.5e-9},
                {"newton": 4},
                {"mean_gap": 2e-7},
            ),
        ),
        provenance=Provenance("digest", 7, {"law": "capped", "levels": [1, 2]}),
        fields={
            "heights": heights,
            "pressure": pressure,
            "gap": -0.3 * heights,
            "displacement": 2 * heights + 1e-7,
            "state": state.astype(np.int8),
        },
    )


def surface_of(result: ContactResult, *periods: float) -> Surface:
    return Surface(result.fields["heights"], periods, seed=7)


@pytest.fixture
def written(tmp_path: Path) -> tuple[Path, ContactResult]:
    result = asymmetric((6, 4))
    path = tmp_path / "out" / "bem.vti"
    write_fields(path, result, surface_of(result, 6e-6, 8e-6), {"hardness": HARDNESS, "µ": "ü"})
    return path, result


def test_pyvista_finds_every_value_at_its_place(written: tuple[Path, ContactResult]) -> None:
    path, result = written
    image = pyvista.read(path)
    assert image.dimensions == (6, 4, 1)
    assert image.origin == (0, 0, 0)
    assert image.spacing[:2] == (1e-6, 2e-6)
    for i, j in np.ndindex(6, 4):
        at = image.find_closest_point((i * 1e-6, j * 2e-6, 0.0))
        for name, field in result.fields.items():
            assert image.point_data[name][at] == np.float32(field[i, j])
    assert set(image.point_data.keys()) == set(result.fields)


def test_fields_come_back_at_single_precision_and_exact_in_double(
    written: tuple[Path, ContactResult], tmp_path: Path
) -> None:
    path, result = written
    surface = surface_of(result, 6e-6, 8e-6)
    write_fields(tmp_path / "double.vti", result, surface, precision="double")
    single, double = read_fields(path), read_fields(tmp_path / "double.vti")
    for name, field in result.fields.items():
        assert np.array_equal(double.fields[name], field)
        assert np.array_equal(single.fields[name], field.astype(single.fields[name].dtype))
    assert single.fields["pressure"].dtype == np.float32
    assert single.fields["state"].dtype == np.uint8
    assert np.array_equal(single.fields["pressure"] == 0, result.fields["pressure"] == 0)
    assert single.shape == (6, 4)
    assert single.periods == pytest.approx((6e-6, 8e-6), rel=1e-15)


def test_the_file_says_where_it_comes_from(written: tuple[Path, ContactResult]) -> None:
    path, _ = written
    read = read_fields(path)
    expected = {
        "method": "bem",
        "converged": 1,
        "scene": "digest",
        "seed": 7,
        "mean_pressure": 1.25e8,
        "hardness": HARDNESS,
        "area.total.raw": 0.3,
        "area.plastic.corrected": 0.17,
        "residual.gap": 1.5e-9,
        "iterations.newton": 4,
        "quantity.mean_gap": 2e-7,
        "option.law": "capped",
        "option.levels": "[1, 2]",
        "µ": "ü",
    }
    assert expected.items() <= read.attributes.items()
    assert read.attributes["version.numpy"] == np.__version__
    assert read.units == {
        "heights": "m",
        "pressure": "Pa",
        "gap": "m",
        "displacement": "m",
        "state": "1",
    }
    held = pyvista.read(path).field_data
    assert held["hardness"][0] == HARDNESS
    assert held["unit.pressure"][0] == "Pa"


def test_spacing_and_numbers_keep_every_bit(tmp_path: Path) -> None:
    spacing = (2.513274e-4 / 1024, math.pi * 1e-7)
    attributes = {"third": 1 / 3, "inf": math.inf, "big": 2**100, "seed": 2**62 + 1, "empty": ""}
    write_image(tmp_path / "x.vti", {"a": np.ones((3, 2))}, spacing, attributes)
    read = read_fields(tmp_path / "x.vti")
    assert read.spacing == spacing
    assert read.attributes == {**attributes, "big": str(2**100)}


def test_a_line_is_a_row(tmp_path: Path) -> None:
    result = asymmetric((7,))
    write_fields(tmp_path / "line.vti", result, surface_of(result, 7e-6))
    image = pyvista.read(tmp_path / "line.vti")
    assert image.dimensions == (7, 1, 1)
    assert np.array_equal(image.points[:, 0], np.arange(7) * image.spacing[0])
    read = read_fields(tmp_path / "line.vti")
    assert read.shape == (7,)
    assert np.array_equal(read.fields["gap"], result.fields["gap"].astype(np.float32))
    assert read.periods == pytest.approx((7e-6,), rel=1e-15)


def consistent(shape: tuple[int, ...]) -> ContactResult:
    """Fields whose displacement follows from gap and heights, under a flat at 3e-7 m."""
    result = asymmetric(shape)
    fields = dict(result.fields)
    fields["displacement"] = fields["gap"] + fields["heights"] - 3e-7
    return replace(result, fields=fields)


def test_a_displacement_that_follows_from_the_rest_is_left_out(tmp_path: Path) -> None:
    result = consistent((6, 4))
    surface = surface_of(result, 6e-6, 8e-6)
    write_fields(tmp_path / "single.vti", result, surface)
    write_fields(tmp_path / "double.vti", result, surface, precision="double")
    single, double = read_fields(tmp_path / "single.vti"), read_fields(tmp_path / "double.vti")
    assert set(single.fields) == {"heights", "pressure", "gap", "state"}
    assert single.units["flat_height"] == "m"
    restored = single.fields["gap"] + single.fields["heights"] - single.attributes["flat_height"]
    scale = np.ptp(result.fields["heights"])
    assert restored == pytest.approx(result.fields["displacement"], abs=1e-6 * scale)
    assert np.array_equal(double.fields["displacement"], result.fields["displacement"])


def test_the_file_says_what_was_computed(tmp_path: Path) -> None:
    result = asymmetric((6, 4))
    about = {
        "young_modulus": {"value": 2e11, "unit": "Pa", "meaning": "E"},
        "periods": {"value": [6e-6, 8e-6], "unit": "m", "meaning": "period"},
        "body": {"value": "half-space", "unit": "", "meaning": "body"},
    }
    told = replace(result, notes=("one", "two"), provenance=replace(result.provenance, about=about))
    units = {"quantity.mean_gap": "m", "area.total.raw": "–", "quantity.absent": "Pa"}
    path = tmp_path / "x.vti"
    write_fields(path, told, surface_of(result, 6e-6, 8e-6), units=units)
    read = read_fields(path)
    assert read.attributes["young_modulus"] == 2e11
    assert read.attributes["periods"] == "6e-06, 8e-06"
    assert read.attributes["body"] == "half-space"
    assert read.attributes["notes"] == "one; two"
    own = {n: unit for n, unit in read.units.items() if n not in read.fields}
    assert own == {"young_modulus": "Pa", "periods": "m", "quantity.mean_gap": "m"}


def test_heights_are_added_where_the_result_has_none(tmp_path: Path) -> None:
    full = asymmetric((5, 3))
    bare = ContactResult("fem", full.steps, full.provenance, fields={"pressure": np.ones((5, 3))})
    write_fields(tmp_path / "x.vti", bare, surface_of(full, 1.0, 1.0), precision="double")
    read = read_fields(tmp_path / "x.vti")
    assert np.array_equal(read.fields["heights"], full.fields["heights"])


def test_what_cannot_be_written(tmp_path: Path) -> None:
    result = asymmetric((4, 4))
    surface = surface_of(result, 1.0, 1.0)
    none = ContactResult("persson", result.steps, result.provenance)
    with pytest.raises(OutputError, match="persson gives no fields"):
        write_fields(tmp_path / "x.vti", none, surface)
    with pytest.raises(OutputError, match=r"must be named \.vti"):
        write_fields(tmp_path / "x.vtk", result, surface)
    wrong = ContactResult("bem", result.steps, result.provenance, fields={"gap": np.ones((4, 5))})
    with pytest.raises(ValueError, match="gap has shape"):
        write_fields(tmp_path / "x.vti", wrong, surface)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        write_fields(tmp_path / "file" / "x.vti", result, surface)
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.skipif(os.name == "nt", reason="needs a limit on the size of files")
@pytest.mark.parametrize("limit", [0, 300, 3000, 60_000])
def test_a_full_disk_leaves_nothing(tmp_path: Path, limit: int) -> None:
    code = f"""
import os, resource, sys
import numpy as np
from epcontact.errors import OutputError
from epcontact.output.vtk import write_image
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
field = np.random.default_rng(3).random((200, 100))
try:
    write_image("x.vti", {{"gap": field}}, (1.0, 1.0), {{"hardness": 1.0}})
except OutputError as error:
    sys.exit(0 if "x.vti" in str(error) and not os.listdir() else f"{{error}}, {{os.listdir()}}")
sys.exit("it was written")
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_what_cannot_be_read(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(OutputError, match="no such file"):
        read_fields(tmp_path / "gone.vti")
    with pytest.raises(OutputError, match="cannot read"):
        read_fields(tmp_path)
    (tmp_path / "x.vti").write_text("not a picture of anything")
    with pytest.raises(OutputError, match="no VTK image file"):
        read_fields(tmp_path / "x.vti")
    assert capfd.readouterr() == ("", "")


def test_no_truncated_file_is_taken_for_a_whole_one(
    written: tuple[Path, ContactResult], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, _ = written
    whole, content = read_fields(path), path.read_bytes()
    cut = tmp_path / "cut.vti"
    refused = 0
    for length in range(0, len(content), 61):
        cut.write_bytes(content[:length])
        try:
            read = read_fields(cut)
        except OutputError:
            refused += 1
        else:  # only the closing tags were lost
            assert all(np.array_equal(read.fields[n], whole.fields[n]) for n in whole.fields)
    assert refused > 0.9 * len(content) / 61
    assert capfd.readouterr() == ("", "")
