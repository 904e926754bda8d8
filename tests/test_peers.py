"""Other solvers' answers, taken from their pressure alone."""

import importlib.util
import os
import sys
from dataclasses import replace

import numpy as np
import pytest
from command_line import python

import fem_check
from epcontact import bem
from epcontact.errors import InvalidScene
from epcontact.harness.verdict.verification import verify
from epcontact.peers.pressure_result import result_of_pressures
from epcontact.peers.public_codes import contact_mechanics, tamaas
from epcontact.peers.tamaas_j2 import tamaas_j2
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum
from epcontact.surfaces import SelfAffine

Q = 2 * np.pi / 1e-3  # rad/m, the longest wave of a period of 1 mm
FLOWS = Material(1e11, 0.3, yield_stress=2e9)


@pytest.fixture(scope="module")
def scene():
    """Return a rough scene of 48 x 48 points that public codes solve quickly."""
    spectrum = SelfAffineSpectrum(0.8, Q, 2 * Q, 8 * Q, 0.1)
    surface = SelfAffine(spectrum, (1e-3, 1e-3), (48, 48), seed=3).build()
    return Scene(surface, Material(1e11, 0.3, 6e9), Load(5e8))


def test_what_follows_from_a_pressure_is_what_the_solver_says(scene):
    """Gap, areas and quantities computed from a pressure alone are those of the
    boundary elements that found it.

    A gap that is given is kept, and a pressure 2 % too large shows in the residuals.
    """
    own = bem.solve(scene)
    found = result_of_pressures(scene, {"pressure": own.fields["pressure"]}, "own")
    assert found.final.areas["raw"] == own.final.areas["raw"]
    atol = 1e-7 * np.std(scene.surface.heights)  # of the solver's tolerance
    np.testing.assert_allclose(found.fields["gap"], own.fields["gap"], atol=atol)
    for name in ("mean_gap", "elastic_energy", "largest_pressure"):
        assert found.final.quantities[name] == pytest.approx(
            own.final.quantities[name], rel=1e-6
        )
    assert found.final.residuals["gap_elastic"] < 1e-7
    assert found.final.residuals["force"] < 1e-12
    # A gap that a solver gives is taken as it is, and a wrong pressure shows in the
    # residuals.
    given = result_of_pressures(
        scene, {**own.fields, "gap": own.fields["gap"] + 1e-9}, "own"
    )
    np.testing.assert_array_equal(given.fields["gap"], own.fields["gap"] + 1e-9)
    wrong = result_of_pressures(
        scene, {"pressure": 1.02 * own.fields["pressure"]}, "wrong"
    )
    assert wrong.final.residuals["force"] == pytest.approx(0.02)
    assert wrong.final.residuals["gap_elastic"] > 1e-3


def test_the_residual_of_a_load_is_relative_to_this_load(scene):
    """After a larger load, a pressure 2 % too large is 2 % of the last load; at no load
    the error is relative to the largest.
    """
    elastic = replace(scene, material=Material(1e11, 0.3))
    pressure = bem.solve(replace(elastic, load=Load(3e8))).fields["pressure"]
    unloaded = replace(elastic, load=Load((5e8, 3e8)))
    found = result_of_pressures(unloaded, {"pressure": 1.02 * pressure}, "wrong")
    assert found.final.residuals["force"] == pytest.approx(0.02)
    none = replace(elastic, load=Load((5e8, 0.0)))
    found = result_of_pressures(none, {"pressure": 0.1 * pressure}, "wrong")
    assert found.final.residuals["force"] == pytest.approx(0.06)


@pytest.mark.parametrize("solve", [contact_mechanics, tamaas])
def test_peers_touch_where_the_boundary_elements_do(scene, solve):
    """The contact area of a public code (`solve`) agrees with that of the boundary
    elements to 1 %.
    """
    pytest.importorskip({"tamaas": "tamaas"}.get(solve.__name__, "ContactMechanics"))
    raw = solve(scene).final.areas["raw"]
    own = bem.solve(scene).final.areas["raw"]
    assert raw.total == pytest.approx(own.total, rel=1e-2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({}, "finite yield_stress"),
        ({"material": FLOWS, "load": Load((5e8, 4e8))}, "mean pressures that rise"),
        ({"material": FLOWS, "body": Body("bonded_layer", 1e-3)}, "half-spaces"),
    ],
)
def test_scenes_that_peers_do_not_know_are_refused(scene, change, says):
    """Tamaas' J2 solver raises InvalidScene with the words `says` for a scene that it
    cannot solve.

    `change` are fields of the scene.
    """
    with pytest.raises(InvalidScene, match=says):
        tamaas_j2(replace(scene, **change))


def test_second_opinion_on_j2_flow():
    """Tamaas and the finite elements agree on the contact area of a J2 body within 20
    %, on a grid of 17 x 17 points.
    """
    pytest.importorskip("tamaas")
    spectrum = SelfAffineSpectrum(0.8, Q, Q, 2 * Q, 0.05)
    surface = SelfAffine(spectrum, (1e-3, 1e-3), (17, 17), seed=101).build()
    flowing = Scene(surface, Material(9.1e10, 0.3, yield_stress=1e9), Load(2.5e8))
    found = tamaas_j2(flowing)
    own = fem_check.solve(flowing, law="j2", certified=False)
    assert found.final.residuals["gap_elastic"] < 1e-6
    # On so coarse a grid the two differ by a sixth in raw area
    # (cases/regression/j2_peer.csv).
    area = own.final.areas["raw"].total
    assert found.final.areas["raw"].total == pytest.approx(area, rel=0.2)


ONE_SURFACE = ("seeds = [3, 5, 7]", "seeds = [3]")


def test_peer_is_gated_against_the_boundary_elements_or_skipped(write_case, tmp_path):
    """A gate of Tamaas against the boundary elements holds, or its case is skipped with
    the reason if Tamaas is not installed.
    """
    peer = ('["persson", "bem"]', '["bem", "tamaas"]')
    gate = ('of = "bem"\nagainst = "persson"', 'of = "tamaas"\nagainst = "bem"')
    (case,) = verify(write_case(ONE_SURFACE, peer, gate), output=tmp_path, jobs=1).cases
    if importlib.util.find_spec("tamaas") is None:
        assert case.status == "skipped"
        assert "tamaas is not installed" in case.skipped_because
    else:
        assert case.status == "holds"
        assert case.results["tamaas"].results[0].method == "tamaas"


def test_solver_takes_the_place_of_bem_under_its_own_name(write_case, tmp_path):
    """`solver="own=..."` replaces the boundary elements in methods, gates and files,
    under the name `own`.
    """
    path = write_case(ONE_SURFACE)
    solver = "own=epcontact.bem:solve"
    verdict = verify(path, solver=solver, output=tmp_path, jobs=1)
    (case,) = verdict.cases
    assert verdict.passed
    assert set(case.methods) == {"persson", "own"}
    assert {gate.of for gate in case.gates} == {"own"}
    assert {file.name for file in tmp_path.rglob("fast/*.json")} == {
        "own.json",
        "persson.json",
    }


def test_entry_points_are_methods(tmp_path):
    """An installed package with the entry point `epcontact.methods` adds a method."""
    about = tmp_path / "other-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: other\nVersion: 1.0\n"
    )
    (about / "entry_points.txt").write_text(
        "[epcontact.methods]\nother = other:solve\n"
    )
    program = "from epcontact.harness.methods.registry import METHODS; "
    program += "print(METHODS['other'].source)"
    path = os.pathsep.join([str(tmp_path), *sys.path])
    done = python("-c", program, env=os.environ | {"PYTHONPATH": path})
    assert done.stdout == "other:solve\n"
