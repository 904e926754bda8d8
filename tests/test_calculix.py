"""The block for other codes, and CalculiX's answer on it, where its program is
installed.
"""

import shutil
from dataclasses import replace

import meshio
import numpy as np
import pytest
import pyvista
from command_line import invoke
from fem_scenes import rough_scene
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu
from skfem import Basis, ElementHex1, ElementVector
from skfem.io.meshio import from_meshio
from skfem.models.elasticity import lame_parameters, linear_elasticity

from epcontact.crosscheck.report import crosscheck
from epcontact.errors import InvalidScene, NotConverged
from epcontact.harness.case_files.case import load_case
from epcontact.peers import calculix
from epcontact.scene import Load
from fem_check.driver import FemOptions, mesh_of, problem_of

needs_ccx = pytest.mark.skipif(
    not shutil.which("ccx"), reason="there is no program ccx"
)


def elastic_scene(slope=0.05):
    scene = rough_scene(8, 2, slope=slope)
    return replace(scene, material=replace(scene.material, hardness=np.inf))


# The block for other codes
# -------------------------------------------------------------------


@pytest.mark.parametrize("end", ["vtu", "vtk", "msh", "med"])
def test_the_exported_block_is_the_one_that_is_solved(tmp_path, end):
    pytest.importorskip("h5py" if end == "med" else "meshio")
    file = tmp_path / f"block.{end}"
    done = invoke("export", "fem-capped", file)
    assert done.returncode == 0, done.stderr
    mesh = meshio.read(file)
    if end.startswith("vt"):  # by VTK's own reader
        seen = pyvista.read(file)
        np.testing.assert_array_equal(seen.points, mesh.points)
        for name in ("top", "base", "gap"):
            np.testing.assert_array_equal(seen[name], mesh.point_data[name])
    top = mesh.point_data["top"] == 1
    assert (mesh.points[top, 2] == 0).all()
    assert (
        mesh.points[mesh.point_data["base"] == 1, 2] == mesh.points[:, 2].min()
    ).all()
    assert not mesh.point_data["gap"][~top].any()
    assert mesh.point_data["gap"][top].min() == 0 < mesh.point_data["gap"].max()
    assert (
        f"{len(mesh.points)} nodes and {len(mesh.cells[0].data)} bricks" in done.stdout
    )


@pytest.mark.parametrize(
    ("end", "says"), [("stl", "must end in .inp"), ("inp", "laws elastic")]
)
def test_what_cannot_be_exported_is_refused_and_nothing_is_written(tmp_path, end, says):
    done = invoke("export", "fem-capped", tmp_path / f"block.{end}")
    assert (done.returncode, *tmp_path.iterdir()) == (2,)
    assert says in done.stderr


def test_the_gap_is_the_scenes_and_the_numbers_fit_the_format(tmp_path):
    scene = elastic_scene(1e-5)
    problem = problem_of(scene, FemOptions(law="elastic"), 1)
    mesh = mesh_of(problem, reference=True)
    gap = mesh.point_data["gap"].reshape(-1, 9, 9)[0, :-1, :-1]
    np.testing.assert_allclose(
        gap, scene.surface.heights.max() - scene.surface.heights, atol=1e-18
    )
    lines = calculix.deck(problem, scene, FemOptions(law="elastic")).splitlines()
    file = tmp_path / "mesh.inp"  # what other programs know of it, which have no GAPUNI
    file.write_text("\n".join(lines[: lines.index("*NODE, NSET=flat")]))
    np.testing.assert_allclose(meshio.read(file).points, mesh.points, atol=1e-12)
    data = [line for line in lines[3:] if not line.startswith("*")]
    assert max(len(word.strip()) for line in data for word in line.split(",")) <= 20
    whole = lines[lines.index("*NODE, NSET=whole") + 1]
    assert (
        float(whole.split(",")[3]) == 2 / 8
    )  # so near that a viewer shows the block, too
    cards = [lines[n + 1] for n, line in enumerate(lines) if line.startswith("*GAP")]
    np.testing.assert_allclose(
        [float(c.split(",")[0]) for c in cards], gap.ravel(), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("options", "load", "says"),
    [
        ({"law": "capped"}, 0.05, "laws elastic and j2"),
        ({"law": "j2", "geometry": "moved"}, 0.05, "geometry gap"),
        ({"law": "j2", "geometry": "punch"}, 0.05, "geometry gap"),
        ({"law": "elastic", "approach": 0.01}, 0.05, "under pressures"),
        ({"law": "elastic"}, (0.05, 0.0), "holds the flat"),
    ],
)
def test_what_calculix_does_not_answer_is_refused(options, load, says):
    with pytest.raises(InvalidScene, match=says):
        calculix.solve(replace(rough_scene(8, 2), load=Load(load)), options)


def test_a_program_that_fails_is_told(tmp_path, monkeypatch):
    program = tmp_path / "ccx"
    program.write_text("#!/bin/sh\necho ' *ERROR reading *STEP: too bad'\n")
    program.chmod(0o755)
    monkeypatch.setattr(calculix, "PROGRAM", str(program))
    with pytest.raises(NotConverged, match="too bad"):
        calculix.solve(elastic_scene(), {"law": "elastic"})


# Its answer
# ----------------------------------------------------------------------------------


def plain_pressures(scene):
    """The contact pressures by scikit-fem's linear elasticity, without anything against
    locking.
    """
    problem = problem_of(scene, FemOptions(law="elastic"), 1)
    (nx, ny), nz = problem.block.shape, len(problem.block.layers)
    basis = Basis(
        from_meshio(mesh_of(problem, reference=True)), ElementVector(ElementHex1())
    )
    moduli = lame_parameters(scene.material.young_modulus, scene.material.poisson_ratio)
    node = np.arange((nz + 1) * nx * ny).reshape(nz + 1, nx, ny)
    node = np.pad(node, [(0, 0), (0, 1), (0, 1)], mode="wrap").ravel()
    freedom, free = 3 * node + np.arange(3)[:, None], slice(3 * nz * nx * ny)
    pairs = basis.nodal_dofs.ravel(), freedom.ravel()
    joined = coo_matrix((np.ones(freedom.size), pairs)).tocsr()
    stiffness = joined.T @ linear_elasticity(*moduli).assemble(basis) @ joined
    held = stiffness.tocsc()[free, free]
    forces = np.zeros((held.shape[0], nx * ny))
    forces[2 : 3 * nx * ny : 3] = np.eye(nx * ny)
    compliance = splu(held).solve(forces)[2 : 3 * nx * ny : 3]
    heights, load = problem.heights.ravel(), scene.load.final * nx * ny
    touching = heights >= np.quantile(heights, 0.75)
    for _ in range(50):  # an active set, all of it solved each time
        inside = np.flatnonzero(touching)
        one = np.ones((inside.size, 1))
        matrix = np.block(
            [[compliance[np.ix_(inside, inside)], -one], [one.T, np.zeros((1, 1))]]
        )
        area = problem.block.node_area
        found = np.linalg.solve(matrix, np.append(heights[inside], load * area))
        force = np.zeros(heights.size)
        force[inside] = found[:-1]
        below = compliance @ force - heights - found[-1] < 0
        wanted = np.where(touching, force > 0, below)
        if (wanted == touching).all():
            return (force / area).reshape(nx, ny)
        touching = wanted
    raise AssertionError


@needs_ccx
def test_calculix_has_the_pressures_of_a_plain_assembly_in_the_limit_of_small_slopes():
    """What is left falls as the slope, and then is the springs' part, which falls as
    they yield.
    """
    left = []
    for slope in (0.05, 0.005, 0.0005):
        scene = elastic_scene(slope)
        found = calculix.solve(scene, {"law": "elastic"}, element="C3D8").fields[
            "pressure"
        ]
        plain = plain_pressures(scene)
        left.append(np.abs(found - plain).sum() / plain.sum())
    assert left[0] < 0.04  # measured .030, .0032 and .00062
    assert left[1] < 0.15 * left[0]
    assert left[2] < 1e-3
    soft = calculix.solve(
        scene, {"law": "elastic"}, element="C3D8", penalty=calculix.PENALTY / 10
    )
    assert left[2] < 0.2 * np.abs(soft.fields["pressure"] - plain).sum() / plain.sum()


@needs_ccx
def test_a_path_has_a_step_for_each_load_and_flow_is_read():
    scene = rough_scene(8, 2)
    options = {"law": "j2", "steps": 4}
    path = calculix.solve(replace(scene, load=Load((0.025, 0.05))), options)
    alone = calculix.solve(scene, {"law": "j2", "steps": 8})
    assert [step.mean_pressure for step in path.steps] == [0.025, 0.05]
    assert path.steps[0].areas["raw"].total < path.steps[1].areas["raw"].total
    np.testing.assert_allclose(
        path.fields["pressure"], alone.fields["pressure"], rtol=2e-3
    )
    assert path.final.areas["raw"].plastic == path.final.areas["raw"].total > 0
    assert path.final.residuals["force"] < 1e-5


@needs_ccx
def test_neither_springs_nor_slopes_but_an_element_is_what_differs():
    rows = crosscheck(load_case("calculix-elastic")).splitlines()[-5:]
    zero, own, plain, *others = (float(row[32:].split()[3]) for row in rows)
    assert zero == 0 < 2 * own < plain
    np.testing.assert_allclose(others, own, rtol=0.2)
