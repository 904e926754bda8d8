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
        "path.pvd", "step-0000-surface.vtu", "step-0000.vtu", "step-0001-surface.vtu",
        "step-0001.vtu",
    ]  # fmt: skip
    umask = os.umask(0)
    os.umask(umask)
    for path in (tmp_path / "out").iterdir():
        assert path.stat().st_mode & 0o777 == 0o666 & ~umask  # as of any new file
    reader = pyvista.get_reader(tmp_path / "out" / "path.pvd")
    assert len(reader.time_values) == 2
    reader.set_active_time_point(1)
    mesh, top = reader.read()
    layers = result.provenance.options["layers"]
    columns = 8 if dimensions == 1 else 64
    assert (mesh.n_cells, top.n_cells) == (layers * columns, columns)
    assert set(mesh.point_data) == {
        "displacement", "stress", "von_mises", "equivalent_plastic_strain",
    }  # fmt: skip
    assert set(top.point_data) == {"displacement", "contact_pressure", "gap", "state"}
    assert mesh.compute_cell_sizes()["Volume"].min() > 0
    corners = top.points[top.cells.reshape(-1, 5)[:, 1:4]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    assert normals[:, 2].min() > 0  # outward
    # The periodic edge is closed by a copy, so look at the first copy alone.
    first = (slice(8), slice(8 if dimensions == 2 else 1))
    for name, field in (("contact_pressure", "pressure"), ("gap", "gap"), ("state", "state")):
        values = top[name].reshape(9, -1)[first].squeeze()
        np.testing.assert_allclose(values, result.fields[field], atol=1e-15)
    # The points are undeformed: only their displacement brings those in contact to one height.
    for part in (mesh, top):
        highest = part.points[:, 2].max() - part.points[:, 2].min()
        assert highest > 0
        assert np.isfinite(part["displacement"]).all()
    touching = top["contact_pressure"] > 0
    roughness = np.ptp(scene.surface.heights)
    assert np.ptp(top.points[touching, 2]) > 1e-3 * roughness
    warped = top.warp_by_vector("displacement")
    assert np.ptp(warped.points[touching, 2]) < 1e-9 * roughness
    assert mesh["equivalent_plastic_strain"].max() > 0
    assert mesh["von_mises"].max() <= 0.2 * (1 + 1e-9)
    for part in (mesh, top):
        held = part.field_data
        assert held["scene"][0] == scene.digest
        assert held["mean_pressure"][0] == pytest.approx(0.05)
        assert (held["law"][0], held["unit.displacement"][0]) == ("j2", "m")
        assert held["unit.young_modulus"][0] == "Pa"


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
    names = sorted(p.name for p in tmp_path.iterdir())

    def fails(file: str, *_: object, **__: object) -> None:
        Path(file).write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr(vtu, "_write_grid", lambda _, path: fails(path))
    with pytest.raises(OutputError, match="disk full"):
        vtu.write_step(tmp_path, 0, *args)
    assert target.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == names
