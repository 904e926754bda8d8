"""The block for other codes, and CalculiX's results on it, where `ccx` is installed."""

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
ELASTIC = FemOptions(law="elastic")


def elastic_scene(slope=0.05):
    """Return an elastic rough scene of 8 x 8 nodes with the rms slope `slope`, E* xi =
    1.
    """
    return rough_scene(8, 2, slope=slope, hardness=np.inf)


# --- the block for other codes


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "msh", "med"])
def test_the_exported_block_is_the_one_that_is_solved(tmp_path, suffix):
    """`export` writes a mesh in each format, with the top, the base and the gap as
    point data.
    """
    if suffix == "med":
        pytest.importorskip("h5py")
    file = tmp_path / f"block.{suffix}"
    process = invoke("export", "fem-capped", file)
    assert process.returncode == 0, process.stderr
    mesh = meshio.read(file)
    size = f"{len(mesh.points)} nodes and {len(mesh.cells[0].data)} bricks"
    assert size in process.stdout
    height = mesh.points[:, 2]
    gap = mesh.point_data["gap"]
    top = mesh.point_data["top"] == 1
    base = mesh.point_data["base"] == 1
    assert (height[top] == 0).all()
    assert (height[base] == height.min()).all()
    assert not gap[~top].any()
    assert gap[top].min() == 0 < gap.max()


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_vtk_reads_the_exported_block(tmp_path, suffix):
    """pyvista reads the same points and point data from a VTK file as meshio does."""
    file = tmp_path / f"block.{suffix}"
    invoke("export", "fem-capped", file)
    mesh = meshio.read(file)
    grid = pyvista.read(file)
    np.testing.assert_array_equal(grid.points, mesh.points)
    for name in ("top", "base", "gap"):
        np.testing.assert_array_equal(grid[name], mesh.point_data[name])


@pytest.mark.parametrize(
    ("suffix", "message"), [("stl", "must end in .inp"), ("inp", "laws elastic")]
)
def test_what_cannot_be_exported_is_refused_and_nothing_is_written(
    tmp_path, suffix, message
):
    """An unknown suffix, or a law that CalculiX lacks, gives exit code 2 and no file.

    `message` is a part of the message on stderr.
    """
    process = invoke("export", "fem-capped", tmp_path / f"block.{suffix}")
    assert process.returncode == 2
    assert message in process.stderr
    assert not list(tmp_path.iterdir())


def test_the_gap_is_the_scenes_and_the_numbers_fit_the_format(tmp_path):
    """The CalculiX deck holds the scene's gaps, in words of at most 20 characters.

    The mesh of the deck is that of the problem, and the node of the flat lies a quarter
    of the period (2/8) above, so that a viewer shows the block, too.
    """
    scene = elastic_scene(1e-5)
    problem = problem_of(scene, ELASTIC)
    mesh = mesh_of(problem, reference=True)
    gap = mesh.point_data["gap"].reshape(-1, 9, 9)[0, :-1, :-1]
    heights = scene.surface.heights
    np.testing.assert_allclose(gap, heights.max() - heights, atol=1e-18)
    lines = calculix.deck(problem, scene, ELASTIC).splitlines()
    # Other programs can read the mesh, but not the springs that follow it.
    file = tmp_path / "mesh.inp"
    file.write_text("\n".join(lines[: lines.index("*NODE, NSET=flat")]))
    np.testing.assert_allclose(meshio.read(file).points, mesh.points, atol=1e-12)
    for line in lines[3:]:
        if not line.startswith("*"):
            assert all(len(word.strip()) <= 20 for word in line.split(","))
    # The flat is so near that a viewer shows the block, too.
    flat = lines[lines.index("*NODE, NSET=whole") + 1]
    assert float(flat.split(",")[3]) == 2 / 8
    clearances = [
        float(lines[number + 1].split(",")[0])
        for number, line in enumerate(lines)
        if line.startswith("*GAP")
    ]
    np.testing.assert_allclose(clearances, gap.ravel(), rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "load", "message"),
    [
        ({"law": "capped"}, 0.05, "laws elastic and j2"),
        ({"law": "j2", "geometry": "moved"}, 0.05, "geometry gap"),
        ({"law": "j2", "geometry": "punch"}, 0.05, "geometry gap"),
        ({"law": "elastic", "approach": 0.01}, 0.05, "under pressures"),
        ({"law": "elastic"}, (0.05, 0.0), "holds the flat"),
    ],
)
def test_what_calculix_does_not_answer_is_refused(options, load, message):
    """Laws, geometries, prescribed approaches and unloading beyond CalculiX raise
    `InvalidScene`.

    `load` is the mean pressure, or the path of them, in units of E* xi.
    """
    scene = rough_scene(8, 2, pressure=load)
    with pytest.raises(InvalidScene, match=message):
        calculix.solve(scene, options)


def test_a_program_that_fails_is_told(tmp_path, monkeypatch):
    """The error line that the program `ccx` prints is the message of `NotConverged`."""
    program = tmp_path / "ccx"
    program.write_text("#!/bin/sh\necho ' *ERROR reading *STEP: too bad'\n")
    program.chmod(0o755)
    monkeypatch.setattr(calculix, "PROGRAM", str(program))
    with pytest.raises(NotConverged, match="too bad"):
        calculix.solve(elastic_scene(), {"law": "elastic"})


# --- the results of CalculiX


def plain_compliance(problem, material):
    """Return the (nodes, nodes) normal compliance of the top of a problem's block, in
    m/N.

    It is that of scikit-fem's linear elasticity on the same mesh, without anything
    against locking. `problem` has the block, and `material` the moduli in Pa.
    """
    nx, ny = problem.block.shape
    nz = len(problem.block.layers)
    mesh = from_meshio(mesh_of(problem, reference=True))
    basis = Basis(mesh, ElementVector(ElementHex1()))
    moduli = lame_parameters(material.young_modulus, material.poisson_ratio)
    stiffness = linear_elasticity(*moduli).assemble(basis)
    # The mesh has copies of the first nodes at the periodic edges.
    node = np.arange((nz + 1) * nx * ny).reshape(nz + 1, nx, ny)
    node = np.pad(node, [(0, 0), (0, 1), (0, 1)], mode="wrap").ravel()
    freedom = 3 * node + np.arange(3)[:, None]
    pairs = basis.nodal_dofs.ravel(), freedom.ravel()
    periodic = coo_matrix((np.ones(freedom.size), pairs)).tocsr()
    free = slice(3 * nz * nx * ny)  # all nodes above the base
    stiffness = (periodic.T @ stiffness @ periodic).tocsc()[free, free]
    normal = slice(2, 3 * nx * ny, 3)
    forces = np.zeros((stiffness.shape[0], nx * ny))
    forces[normal] = np.eye(nx * ny)
    return splu(stiffness).solve(forces)[normal]


def plain_pressures(scene):
    """Return the (nx, ny) contact pressures with `plain_compliance`, in Pa."""
    problem = problem_of(scene, ELASTIC)
    compliance = plain_compliance(problem, scene.material)
    heights = problem.heights.ravel()
    load = scene.load.final * problem.area
    contact = heights >= np.quantile(heights, 0.75)
    for _ in range(50):  # an active set, solved completely each time
        inside = np.flatnonzero(contact)
        one = np.ones((inside.size, 1))
        matrix = np.block(
            [[compliance[np.ix_(inside, inside)], -one], [one.T, np.zeros((1, 1))]]
        )
        *forces, approach = np.linalg.solve(matrix, np.append(heights[inside], load))
        force = np.zeros(heights.size)
        force[inside] = forces
        gap = compliance @ force - heights - approach
        new_contact = np.where(contact, force > 0, gap < 0)
        if (new_contact == contact).all():
            return (force / problem.block.node_area).reshape(problem.block.shape)
        contact = new_contact
    raise AssertionError


def pressure_error(scene, expected, **changes):
    """Return sum |p - expected| / sum expected for CalculiX's elements C3D8 (no
    incompatible modes).

    `expected` are the (nx, ny) pressures in Pa; `changes` are arguments of
    `calculix.solve`.
    """
    result = calculix.solve(scene, {"law": "elastic"}, element="C3D8", **changes)
    return np.abs(result.fields["pressure"] - expected).sum() / expected.sum()


@needs_ccx
def test_calculix_has_the_pressures_of_a_plain_assembly_in_the_limit_of_small_slopes():
    """The difference falls with the slope, down to the difference that the contact
    springs cause.

    The springs' part is inversely proportional to their stiffness, `PENALTY`.
    """
    errors = []
    for slope in (0.05, 0.005, 0.0005):
        scene = elastic_scene(slope)
        plain = plain_pressures(scene)
        errors.append(pressure_error(scene, plain))
    assert errors[0] < 0.04  # measured .030, .0032 and .00062
    assert errors[1] < 0.15 * errors[0]
    assert errors[2] < 1e-3
    with_soft_springs = pressure_error(scene, plain, penalty=calculix.PENALTY / 10)
    assert errors[2] < 0.2 * with_soft_springs


@needs_ccx
def test_a_path_has_a_step_for_each_load_and_flow_is_read():
    """A path of two loads gives two steps with rising areas and the pressures of one
    step.

    The pressures agree to 0.2 %, and J2 flow is read as plastic area.
    """
    scene = rough_scene(8, 2)
    path_scene = replace(scene, load=Load((0.025, 0.05)))
    path = calculix.solve(path_scene, {"law": "j2", "steps": 4})
    single = calculix.solve(scene, {"law": "j2", "steps": 8})
    first, last = path.steps
    assert first.mean_pressure == 0.025
    assert last.mean_pressure == 0.05
    assert first.areas["raw"].total < last.areas["raw"].total
    assert last.areas["raw"].plastic == last.areas["raw"].total > 0
    assert last.residuals["force"] < 1e-5
    np.testing.assert_allclose(
        path.fields["pressure"], single.fields["pressure"], rtol=2e-3
    )


@needs_ccx
def test_neither_springs_nor_slopes_but_an_element_is_what_differs():
    """In the table of codes, the element type alone causes the difference of CalculiX.

    The last five rows are: `fem_check` itself (difference 0), CalculiX with
    incompatible modes, with plain bricks (more than twice as far), with stiffer springs
    and with a tenth of the slope (both as far as incompatible modes, within 20 %).
    """
    rows = crosscheck(load_case("calculix-elastic")).splitlines()[-5:]
    differences = [float(row[32:].split()[3]) for row in rows]
    zero, incompatible, plain, *others = differences
    assert zero == 0 < 2 * incompatible < plain
    np.testing.assert_allclose(others, incompatible, rtol=0.2)
