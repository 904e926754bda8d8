"""The finite-element body in files that VTK opens, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact.errors import OutputError
from fem_check import driver, vtu


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("geometry", ["gap", "moved"])
def test_pyvista_opens_the_path_with_its_fields(
    tmp_path: Path, dimensions: int, geometry: str
) -> None:
    import pyvista

    scene = rough_scene(8, 2, pressure=(0.02, 0.05), dimensions=dimensions)
    result = fem_check.solve(scene, output=tmp_path / "out", geometry=geometry)  # type: ignore[arg-type]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "path.pvd", "step-0000.vtu", "step-0001.vtu",
    ]  # fmt: skip
    umask = os.umask(0)
    os.umask(umask)
    for path in (tmp_path / "out").iterdir():
        assert path.stat().st_mode & 0o777 == 0o666 & ~umask  # as of any new file
    reader = pyvista.get_reader(tmp_path / "out" / "path.pvd")
    assert len(reader.time_values) == 2
    reader.set_active_time_point(1)
    mesh = reader.read()[0]
    layers = result.provenance.options["layers"]
    columns = 8 if dimensions == 1 else 64
    assert mesh.n_cells == layers * columns
    assert set(mesh.point_data) == {
        "displacement", "stress", "von_mises", "equivalent_plastic_strain",
        "contact_pressure", "gap", "state",
    }  # fmt: skip
    assert mesh.compute_cell_sizes()["Volume"].min() > 0
    top = np.isfinite(mesh["gap"])
    # The periodic edge is closed by a copy, so look at the first copy alone.
    count = 9 * (9 if dimensions == 2 else 2)
    assert top.sum() == count
    pressure = mesh["contact_pressure"][top].reshape(9, -1)[:8, : 8 if dimensions == 2 else 1]
    np.testing.assert_array_equal(pressure.squeeze(), result.fields["pressure"])
    # Contact nodes of the deformed rough body lie on the flat: one height for all.
    touching = mesh["contact_pressure"][top] > 0
    heights = mesh.points[top, 2][touching]
    assert np.ptp(heights) < 1e-9 * np.ptp(scene.surface.heights)
    assert mesh["equivalent_plastic_strain"].max() > 0
    assert mesh["von_mises"].max() <= 0.2 * (1 + 1e-9)


def test_the_von_mises_norm_is_that_of_simple_states() -> None:
    assert vtu.von_mises(np.array([2.0, 0, 0, 0, 0, 0])) == pytest.approx(2)
    assert vtu.von_mises(np.array([0.0, 0, 0, 0, 1, 0])) == pytest.approx(np.sqrt(3))
    assert vtu.von_mises(np.array([5.0, 5, 5, 0, 0, 0])) == pytest.approx(0)


def test_a_file_that_cannot_be_written_is_reported_and_none_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="could not be written"):
        fem_check.solve(rough_scene(8, 2), output=tmp_path / "file")


def test_a_write_that_fails_half_way_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = driver.solve_path(rough_scene(8, 2))
    args = (path.problem, path.points[-1], path.history)
    target = vtu.write_step(tmp_path, 0, *args)
    before = target.read_bytes()

    def fails(file: str, *_: object, **__: object) -> None:
        Path(file).write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr("meshio.write", fails)
    with pytest.raises(OutputError, match="disk full"):
        vtu.write_step(tmp_path, 0, *args)
    assert target.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["step-0000.vtu"]
