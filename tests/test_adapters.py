"""The adapters of codes that are not installed: what they are given, and what is read.

Stand-ins take the places of the program `ccx` and of the packages ContactMechanics and
tamaas.  They record what an adapter passes on and return numbers that are known here.
The scene has different periods, numbers of points and loads, so that values which are
exchanged differ.
"""

import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from epcontact import bem
from epcontact.errors import InvalidScene, NotConverged
from epcontact.peers import calculix
from epcontact.peers.public_codes import ITERATIONS, contact_mechanics, tamaas
from epcontact.peers.tamaas_j2 import tamaas_j2
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.scene import Body, Load, Material, Scene, Surface

SHAPE = (8, 12)
PERIODS = (1e-3, 1.8e-3)
CELL = 1e-3 / 8 * 1.8e-3 / 12  # m²
E_STAR = 1e11 / (1 - 0.3**2)


def make_scene(**material):
    """Return a scene with a bumpy surface under loads of 100 and 300 MPa.

    `material` are arguments of `Material` beside E = 100 GPa and nu = 0.3.
    """
    heights = 1e-6 * np.random.default_rng(4).normal(size=SHAPE)
    surface = Surface(heights, PERIODS)
    return Scene(surface, Material(1e11, 0.3, **material), Load((1e8, 3e8)))


# --- CalculiX ------------------------------------------------------------------------

OPTIONS = {"law": "j2", "steps": 5, "layers": 3, "depth": 1e-3}


def numbers_of(line):
    """Return the numbers of a line of an input file as a list; words are left out."""
    numbers = []
    for word in line.split(","):
        try:
            numbers.append(float(word))
        except ValueError:
            continue
    return numbers


def lines_after(lines, heading):
    """Return the lines of an input file between each `heading` and the next keyword."""
    found = []
    for index, line in enumerate(lines):
        if line.startswith(heading):
            for following in lines[index + 1 :]:
                if following.startswith("*"):
                    break
                found.append(following)
    return found


def printed(forces, lowered, approach, strains):
    """Return what CalculiX prints for a load, as text.

    Arguments: downward forces (nx, ny) in N, downward displacements (nx + 1, ny + 1) in
    m, that of the flat, and plastic strains (elements, points).
    """
    lines = [" forces (fx,fy,fz) for set FLAT and time  0.1E+01", ""]
    for number, force in enumerate(forces.ravel(), 1):
        lines.append(f"{number} 1e9 2e9 {-force:.12e}")
    lines.append(" displacements (vx,vy,vz) for set TOP and time  0.1E+01")
    for number, value in enumerate(lowered.ravel(), 1):
        lines.append(f"{number} 3e9 4e9 {-value:.12e}")
    lines.append(" displacements (vx,vy,vz) for set WHOLE and time  0.1E+01")
    lines.append(f"999 0 0 {-approach:.12e}")
    lines.append(" equivalent plastic strain (elem, integ.pnt.,pe) for set UPPER")
    for element, points in enumerate(strains, 1):
        for point, strain in enumerate(points, 1):
            lines.append(f"{element} {point} {strain:.6e}")
    return "\n".join(lines) + "\n"


@pytest.fixture
def calculix_answers(tmp_path, monkeypatch):
    """Return a function that installs a stand-in for `ccx` and returns the path at
    which the stand-in leaves the input file; its argument is the text it prints.
    """

    def install(text):
        """Install a program that prints `text` as block.dat, after two iterations."""
        (tmp_path / "answer").write_text(text)
        program = tmp_path / "ccx"
        program.write_text(
            f"#!/bin/sh\ncp '{tmp_path}/answer' block.dat\n"
            f"cp block.inp '{tmp_path}/block.inp'\n"
            "printf ' iteration 1\\n iteration 2\\n no iteration\\n'\n"
        )
        program.chmod(0o755)
        monkeypatch.setattr(calculix, "PROGRAM", str(program))
        return tmp_path / "block.inp"

    return install


def random_answer(seed):
    """Return invented tables of a load: forces (N), displacements and approach (m), and
    plastic strains of 8 points in each element.

    Nine nodes have no force, and three elements flow, each at one of its points.
    """
    random = np.random.default_rng(seed)
    forces = random.uniform(1, 2, SHAPE)
    forces[0, :9] = 0.0
    lowered = 1e-7 * random.uniform(1, 2, (SHAPE[0] + 1, SHAPE[1] + 1))
    strains = np.zeros((SHAPE[0] * SHAPE[1], 8))
    strains[[0, 17, 50], [3, 5, 7]] = 0.01
    return forces, lowered, 4e-7, strains


def test_an_answer_of_calculix_is_read_in_its_units_and_places(calculix_answers):
    """Pressures are forces over the area of a node, gaps the clearance plus the
    displacement of the node less that of the flat, and a node next to a flowing element
    is plastic.  Each load has its own tables.
    """
    scene = make_scene(yield_stress=2e9)
    first = random_answer(1)
    second = random_answer(2)
    calculix_answers(printed(*first) + printed(*second))
    result = calculix.solve(scene, OPTIONS)
    forces, lowered, approach, strains = second
    pressure = forces / CELL
    heights = scene.surface.heights
    gap = heights.max() - heights + lowered[:-1, :-1] - approach
    flowed = strains.any(axis=1).reshape(SHAPE)
    near = np.zeros(SHAPE, bool)
    for shift in ((0, 0), (0, 1), (1, 0), (1, 1)):
        near |= np.roll(flowed, shift, (0, 1))
    state = np.where(near, PLASTIC, ELASTIC)
    state[forces == 0] = APART
    np.testing.assert_allclose(result.fields["pressure"], pressure, rtol=1e-9)
    np.testing.assert_array_equal(result.fields["state"], state)
    open_gap = np.where(forces > 0, 0.0, gap)
    np.testing.assert_allclose(result.fields["gap"], open_gap, atol=1e-15)
    np.testing.assert_allclose(result.fields["displacement"], lowered[:-1, :-1])
    assert result.final.areas["raw"].total == 87 / 96
    assert result.final.areas["raw"].plastic == np.mean(state == PLASTIC)
    quantities = result.final.quantities
    assert quantities["approach"] == approach
    assert quantities["mean_gap"] == pytest.approx(np.maximum(open_gap, 0).mean())
    assert quantities["largest_pressure"] == pytest.approx(pressure.max())
    for step, (forces, *_), load in zip(
        result.steps, (first, second), (1e8, 3e8), strict=True
    ):
        error = abs(forces.mean() / CELL - load) / 3e8
        assert step.residuals["force"] == pytest.approx(error)
    assert result.cost["iterations"] == 2


@pytest.mark.parametrize("kind", ["bonded_layer", "sliding_layer"])
def test_the_input_file_has_loads_springs_and_supports(calculix_answers, kind):
    """The input file is that of the scene on a layer of each `kind`: the force of each
    load in N, springs in N/m, tied edges, and the supports of the base.
    """
    scene = make_scene(yield_stress=2e9)
    scene = replace(scene, body=Body(kind, 1e-3))
    file = calculix_answers(2 * printed(*random_answer(1)))
    calculix.solve(scene, OPTIONS)
    lines = file.read_text().splitlines()
    loads = [numbers_of(line)[-1] for line in lines_after(lines, "*CLOAD")]
    area = PERIODS[0] * PERIODS[1]
    assert loads == pytest.approx([-1e8 * area, -3e8 * area])
    increments = [numbers_of(line)[:2] for line in lines_after(lines, "*STATIC")]
    assert increments == [[0.2, 1.0], [0.2, 1.0]]
    springs = np.array([numbers_of(line) for line in lines_after(lines, "*GAP")])
    clearances = (scene.surface.heights.max() - scene.surface.heights).ravel()
    np.testing.assert_allclose(springs[:, 0], clearances, atol=1e-18)
    stiffness = calculix.PENALTY * 1e11 * 1e-3 / 8
    pull = calculix.PULL * 3e8 * CELL
    np.testing.assert_allclose(springs[:, -2:], [[stiffness, pull]] * 96, rtol=1e-9)
    equations = [line for line in lines_after(lines, "*EQUATION") if line != "2"]
    terms = np.array([numbers_of(line) for line in equations])
    assert (terms[:, 1] == terms[:, 4]).all()
    np.testing.assert_array_equal(terms[:, [2, 5]], [[1.0, -1.0]] * len(terms))
    # 8 + 12 + 1 copies on each of three levels, and the 96 nodes of the flat.
    axes, counts = np.unique(terms[:, 1], return_counts=True)
    assert dict(zip(axes, counts, strict=True)) == {1: 63, 2: 63, 3: 63 + 96}
    supports = lines_after(lines, "*BOUNDARY")
    assert supports[-2:] == ["flat, 1, 2", "whole, 1, 2"]
    base = [numbers_of(line)[1:] for line in supports[:-2]]
    if kind == "bonded_layer":
        assert base == [[1, 3]] * 117
    else:
        assert base == [[3, 3]] * 117 + [[1, 3]]


def test_springs_have_numbers_of_their_own_after_the_bricks(calculix_answers):
    """The bricks are elements 1 to 288, the springs 289 to 384, and the plastic strains
    are printed of the 96 bricks of the top layer.
    """
    file = calculix_answers(2 * printed(*random_answer(1)))
    calculix.solve(make_scene(yield_stress=2e9), OPTIONS)
    lines = file.read_text().splitlines()
    springs = [numbers_of(line) for line in lines_after(lines, "*ELEMENT, TYPE=GAP")]
    assert [int(spring[0]) for spring in springs] == list(range(289, 385))
    (upper,) = lines_after(lines, "*ELSET, ELSET=upper")
    assert numbers_of(upper) == [1, 96, 1]


@pytest.mark.parametrize(
    "options",
    [
        {"law": "capped"},
        {"law": "elastic", "geometry": "moved"},
        {"law": "elastic", "approach": 1e-7},
    ],
)
def test_calculix_refuses_what_its_input_file_cannot_say(options):
    """A pressure cap, a moved mesh and a given approach are refused in a sentence."""
    with pytest.raises(InvalidScene, match="calculix answers the laws elastic and j2"):
        calculix.solve(make_scene(hardness=6e9), options)


def test_an_error_in_the_log_of_calculix_counts_although_it_ends_well(
    calculix_answers, tmp_path
):
    """CalculiX may print tables and end with 0 after an error, whose line is shown."""
    calculix_answers(2 * printed(*random_answer(1)))
    program = tmp_path / "ccx"
    program.write_text(program.read_text() + "echo ' *ERROR in e_c3d: too large'\n")
    with pytest.raises(NotConverged, match=r"\*ERROR in e_c3d: too large"):
        calculix.solve(make_scene(yield_stress=2e9), OPTIONS)


# --- public codes of capped contact --------------------------------------------------


@pytest.fixture
def packages(monkeypatch):
    """Return a dictionary in which stand-ins for ContactMechanics and tamaas note their
    arguments; the value "pressure" (over E*, on the grid) is their answer.
    """
    seen = {}

    def half_space(shape, modulus, lengths):
        """Note the arguments of ContactMechanics' half-space."""
        seen["half_space"] = (tuple(shape), modulus, tuple(lengths))

    def gradients(_, heights, **options):
        """Note the heights and options, and return forces on the points."""
        seen.update(options, heights=np.array(heights))
        cell = 1.8 / heights.size
        return SimpleNamespace(jac=seen["pressure"] * cell)

    class Model:
        """tamaas' model: its lengths, its grid and its tractions."""

        def __init__(self, kind, lengths, shape):
            """Note lengths and shape; a volume has tractions along three axes."""
            seen.update(lengths=list(lengths), shape=list(shape))
            self.kind = kind
            self.traction = np.zeros(shape)
            if kind == "volume":
                self.traction = np.zeros((*shape[1:], 3))
            self.displacement = np.zeros((*shape, 3))

        def __getitem__(self, name):
            """Return the gap (over the period), or strains, which are 0."""
            return {"gap": seen["gap"], "cumulated_plastic_strain": np.zeros((2, 1))}[
                name
            ]

    class Solver:
        """tamaas' solvers of contact: they answer with the pressure that is given."""

        def __init__(self, model, heights, tolerance, hardness=np.inf):
            """Note the arguments."""
            self.model = model
            self.surface = np.array(heights).ravel()
            seen.update(heights=np.array(heights), tolerance=tolerance)
            seen.update(hardness=hardness, solver=self, model=model, loads=[])

        def solve(self, load):
            """Note the load and set the tractions."""
            seen["loads"].append(load)
            if self.model.kind == "volume":
                self.model.traction[..., 2] = load
            else:
                self.model.traction = seen["pressure"]

    class Flow:
        """tamaas' solver of flow, of a body that does not flow."""

        def __init__(self, residual):
            """Take a residual, which is not used."""

        def solve(self):
            """Leave no displacement."""

        def updateState(self):
            """Keep the state."""

    def hardening(_, yield_stress, modulus):
        """Note the yield stress and the hardening modulus."""
        seen.update(yield_stress=yield_stress, hardening=modulus)

    contact = ModuleType("ContactMechanics")
    contact.PeriodicFFTElasticHalfSpace = half_space
    optimization = ModuleType("ContactMechanics.Optimization")
    optimization.constrained_conjugate_gradients = gradients
    module = ModuleType("tamaas")
    module.set_log_level = lambda level: None
    module.LogLevel = SimpleNamespace(error=0)
    module.model_type = SimpleNamespace(basic_2d="surface", volume_2d="volume")
    module.Model = Model
    module.PolonskyKeerRey = module.KatoSaturated = Solver
    module.materials = SimpleNamespace(IsotropicHardening=hardening)
    module.Residual = lambda model, law: None
    nonlinear = ModuleType("tamaas.nonlinear_solvers")
    nonlinear.DFSANECXXSolver = Flow
    for stand_in in (contact, optimization, module, nonlinear):
        monkeypatch.setitem(sys.modules, stand_in.__name__, stand_in)
    return seen


@pytest.mark.parametrize("hardness", [np.inf, 6e9])
def test_contact_mechanics_is_given_the_scene_in_its_units(packages, hardness):
    """Lengths are over the first period, pressures over E*; forces are those of points,
    and the answer is the pressure in Pa.
    """
    scene = make_scene(hardness=hardness)
    pressure = bem.solve(scene).fields["pressure"]
    packages["pressure"] = pressure / E_STAR
    result = contact_mechanics(scene)
    assert packages["half_space"] == (SHAPE, 1.0, (1.0, pytest.approx(1.8)))
    np.testing.assert_allclose(packages["heights"], scene.surface.heights / 1e-3)
    assert packages["external_force"] == pytest.approx(3e8 / E_STAR * 1.8)
    expected = None
    if np.isfinite(hardness):
        expected = pytest.approx(6e9 / E_STAR * 1.8 / 96)
    assert packages["hardness"] == expected
    rms_height = np.std(scene.surface.heights)
    assert packages["pentol"] == pytest.approx(1e-6 * rms_height / 1e-3)
    np.testing.assert_allclose(result.fields["pressure"], pressure, rtol=1e-9)
    assert result.final.residuals["force"] < 1e-9


@pytest.mark.parametrize("hardness", [np.inf, 6e9])
def test_tamaas_is_given_the_scene_in_its_units(packages, hardness):
    """Lengths are over the first period, pressures over E*; a capped body is solved for
    a number of iterations, an elastic one to a tolerance.
    """
    scene = make_scene(hardness=hardness)
    pressure = bem.solve(scene).fields["pressure"]
    packages["pressure"] = pressure / E_STAR
    result = tamaas(scene)
    assert packages["lengths"] == pytest.approx([1.0, 1.8])
    assert packages["shape"] == [*SHAPE]
    assert (packages["model"].E, packages["model"].nu) == (1.0, 0.0)
    np.testing.assert_allclose(packages["heights"], scene.surface.heights / 1e-3)
    assert packages["loads"] == [pytest.approx(3e8 / E_STAR)]
    if np.isfinite(hardness):
        assert packages["hardness"] == pytest.approx(6e9 / E_STAR)
        assert packages["solver"].max_iter == ITERATIONS
    else:
        assert packages["tolerance"] == 1e-6
    np.testing.assert_allclose(result.fields["pressure"], pressure, rtol=1e-9)


def test_tamaas_with_flow_is_given_the_body_and_each_increment(packages, monkeypatch):
    """The layer is half a period deep and has the spacing of the first axis; moduli and
    yield stress are over E*, and each load is reached in four equal increments.
    """

    def settle(change, guess, **_):
        """Return the residual after one step, in the place of Anderson's method."""
        return guess + change(guess)

    monkeypatch.setattr("epcontact.peers.tamaas_j2.anderson", settle)
    scene = make_scene(yield_stress=2e9)
    gap = np.random.default_rng(5).uniform(1e-3, 2e-3, SHAPE)
    packages["gap"] = np.stack([np.zeros(SHAPE), np.zeros(SHAPE), gap], axis=-1)
    result = tamaas_j2(scene)
    assert packages["lengths"] == pytest.approx([0.5, 1.0, 1.8])
    assert packages["shape"] == [5, *SHAPE]
    assert pytest.approx(1 - 0.3**2) == packages["model"].E
    assert packages["model"].nu == 0.3
    assert packages["yield_stress"] == pytest.approx(2e9 / E_STAR)
    increments = np.array([0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3]) * 1e8 / E_STAR
    assert packages["loads"] == pytest.approx([*increments])
    np.testing.assert_allclose(result.fields["pressure"], 3e8, rtol=1e-12)
    np.testing.assert_allclose(result.fields["gap"], 1e-3 * gap, rtol=1e-12)


@pytest.mark.parametrize("solve", [contact_mechanics, tamaas])
def test_public_codes_refuse_a_line_and_a_layer(packages, solve):
    """Both solve half-spaces under surfaces, and neither another body nor a line."""
    scene = make_scene()
    line = replace(scene, surface=Surface(scene.surface.heights[0], (1.8e-3,)))
    layer = replace(scene, body=Body("bonded_layer", 1e-3))
    for refused in (line, layer):
        with pytest.raises(InvalidScene, match="half-spaces under surfaces only"):
            solve(refused)
