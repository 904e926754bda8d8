"""The block for other codes, and CalculiX's results on it, where `ccx` is installed."""

import shutil
import sys
from dataclasses import replace

import meshio
import numpy as np
import pytest
import pyvista
from command_line import invoke
from fem_scenes import rough_scene

from epcontact.crosscheck.report import crosscheck
from epcontact.errors import InvalidScene, NotConverged
from epcontact.harness.case_files.case import load_case
from epcontact.harness.verdict.verification import verify
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

    pyvista reads the same points and point data from VTK's formats as meshio does.
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
    if suffix.startswith("vt"):
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
    ("hardening", "expected"),
    [
        ({}, [(0.2, 0.0), (0.2, 1.0)]),
        ({"hardening_modulus": 5.0}, [(0.2, 0.0), (5.2, 1.0)]),
        (
            {"hardening_curve": ((0.0, 0.2), (0.1, 0.5), (0.3, 0.6))},
            [(0.2, 0.0), (0.5, 0.1), (0.6, 0.3)],
        ),
    ],
)
def test_the_yield_curve_of_the_deck_is_that_of_the_material(
    tmp_path, hardening, expected
):
    """The table *PLASTIC has the points of the curve, and a comment describes it.

    `hardening` are arguments of the material, and `expected` are the rows (stress in
    Pa, plastic strain) of the table.
    """
    scene = rough_scene(8, 2)
    scene = replace(scene, material=replace(scene.material, **hardening))
    file = tmp_path / "block.inp"
    calculix.export(scene, file, {"law": "j2"})
    lines = file.read_text().splitlines()
    start = lines.index("*PLASTIC") + 1
    rows = [
        tuple(map(float, line.split(",")))
        for line in lines[start : start + 4]
        if not line.startswith("*")
    ]
    assert rows[: len(expected)] == expected
    comments = [line for line in lines if line.startswith("** ")]
    described = any("hardening modulus 5 Pa" in line for line in comments)
    assert described == ("hardening_modulus" in hardening)
    described = any("0.5 Pa at 0.1, 0.6 Pa at 0.3" in line for line in comments)
    assert described == ("hardening_curve" in hardening)


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


# --- a case with CalculiX, with and without its program

#: A case that compares CalculiX and the elements with a number each.
CASE = """
[case]
id = "block"
requirement = "Two codes touch on the same area."
source = "made for the tests"
methods = ["fem", "calculix"]

[surface]
kind = "sinusoid"
period = 1.0
shape = [8]
amplitude = 1.0e-3

[material]
young_modulus = 1.0e9
poisson_ratio = 0.3
hardness = 3.0e8

[fem]
law = "elastic"
layers = 3
depth = 0.5

[load]
mean_pressure = 1.0e5

[[gate]]
quantity = "area.total.raw"
of = "calculix"
against = 1.0
source = "made for the tests"
tolerance = 0.1
because = "The program of the tests presses on all nodes."
"""
OWN_GATE = """
[[gate]]
quantity = "quantity.mean_gap"
of = "fem"
against = 0.0
norm = "absolute"
source = "made for the tests"
tolerance = 1.0
because = "The gap is below the amplitude."
"""
#: A program that prints CalculiX's tables of this block: equal forces on the 8 nodes of
#: the flat, no displacement, and a line in a file for each run.
PROGRAM = f"""#!{sys.executable}
import pathlib
with open("{{runs}}", "a") as file:
    file.write("run ")
rows = [f"{{{{n}}}} 0 0 -12500" for n in range(8)]
top = [f"{{{{n}}}} 0 0 0" for n in range(18)]
text = "\\n".join(["forces", *rows, "top", *top, "whole", "1 0 0 -1e-3"])
pathlib.Path("block.dat").write_text(text)
"""


@pytest.fixture
def no_program(monkeypatch, tmp_path):
    """Hide the program `ccx`, and return an empty folder of the PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def test_without_ccx_the_other_methods_and_the_export_work(tmp_path, no_program):
    """Without `ccx`, `run` and `export` work; a verdict leaves the gates of CalculiX
    out, and says why.  A case of which nothing is left is skipped and does not pass.
    """
    path = tmp_path / "block.toml"
    path.write_text(CASE)
    reason = "there is no program ccx"
    file = tmp_path / "block.inp"
    assert invoke("export", path, file).returncode == 0
    assert file.is_file()
    done = invoke("run", path, "--output", tmp_path / "run", "--jobs", 1)
    assert done.returncode == 0
    assert f"calculix is left out: {reason}" in done.stderr
    assert [file.stem for file in tmp_path.glob("run/block/fast/*.json")] == ["fem"]
    done = invoke("run", path, "--method", "calculix")
    assert done.returncode == 2
    assert f"calculix: {reason}" in done.stderr
    (case,) = verify(path, output=tmp_path / "none", jobs=1).cases
    assert case.status == "skipped"
    assert reason in case.skipped_because
    verdict = verify(path, output=tmp_path / "none", jobs=1)
    assert (verdict.exit_code, verdict.passed) == (0, False)
    path.write_text(CASE + OWN_GATE)
    verdict = verify(path, output=tmp_path / "some", jobs=1)
    (case,) = verdict.cases
    assert (verdict.passed, case.status) == (True, "holds")
    assert {gate.of for gate in case.gates} == {"fem"}
    assert len(case.not_judged) >= 1
    assert all(f"needs calculix: {reason}" in text for text in case.not_judged)


def test_results_of_a_program_are_reused_until_its_file_changes(tmp_path, no_program):
    """A result of `ccx` is used again, but not if the file of the program changes; the
    hardness, which has no effect, is a note of the result.
    """
    path = tmp_path / "block.toml"
    path.write_text(CASE)
    runs = tmp_path / "runs"
    program = no_program / "ccx"
    for comment, expected in (("", 1), ("", 1), ("# new", 2)):
        program.write_text(PROGRAM.format(runs=runs) + comment)
        program.chmod(0o755)
        (case,) = verify(path, output=tmp_path / "out", jobs=1).cases
        assert case.status == "holds"
        assert len(runs.read_text().split()) == expected
    (result,) = case.results["calculix"].results
    assert any("has no effect on CalculiX" in note for note in result.notes)


# --- the results of CalculiX


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
