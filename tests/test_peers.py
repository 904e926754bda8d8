"""Other solvers' answers, taken from their pressure alone."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from epcontact import bem
from epcontact.errors import InvalidScene, StudyUnavailable
from epcontact.harness import peers
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum
from epcontact.surfaces import SelfAffine

Q = 2 * np.pi / 1e-3


@pytest.fixture(scope="module")
def scene() -> Scene:
    spectrum = SelfAffineSpectrum(0.8, Q, 2 * Q, 8 * Q, 0.1)
    surface = SelfAffine(spectrum, (1e-3, 1e-3), (48, 48), seed=3).build()
    return Scene(surface, Material(1e11, 0.3, 6e9), Load(5e8))


def test_what_follows_from_a_pressure_is_what_the_solver_says(scene) -> None:
    own = bem.solve(scene)
    found = peers.result_of(scene, own.fields["pressure"], "own")
    assert found.final.areas["raw"] == own.final.areas["raw"]
    # The flat's position is a mean here and a bound there, equal to the solver's tolerance.
    np.testing.assert_allclose(
        found.fields["gap"], own.fields["gap"], atol=1e-7 * np.std(scene.surface.heights)
    )
    for name in ("mean_gap", "elastic_energy", "largest_pressure"):
        assert found.final.quantities[name] == pytest.approx(own.final.quantities[name], rel=1e-6)
    assert found.final.residuals["gap_elastic"] < 1e-7
    assert found.final.residuals["force"] < 1e-12


def test_a_wrong_pressure_shows_in_the_residuals(scene) -> None:
    wrong = 1.02 * bem.solve(scene).fields["pressure"]
    found = peers.result_of(scene, wrong, "wrong")
    assert found.final.residuals["force"] == pytest.approx(0.02)
    assert found.final.residuals["gap_elastic"] > 1e-3


def test_scenes_that_peers_do_not_know_are_refused(scene) -> None:
    layer = replace(scene, body=Body("bonded_layer", 1e-3))
    with pytest.raises(InvalidScene, match="half-spaces"):
        peers.tamaas(layer)


@pytest.mark.parametrize("name", ["ContactMechanics", "tamaas"])
def test_peer_or_one_sentence(scene, name) -> None:
    solve = {"ContactMechanics": peers.contact_mechanics, "tamaas": peers.tamaas}[name]
    if importlib.util.find_spec(name) is None:
        with pytest.raises(StudyUnavailable, match=r"epcontact\[peers\]"):
            solve(scene)
        return
    raw, own = solve(scene).final.areas["raw"], bem.solve(scene).final.areas["raw"]
    assert raw.total == pytest.approx(own.total, rel=1e-2)
