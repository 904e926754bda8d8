"""Energy balance of finite elements along paths up and down."""

import math
from dataclasses import replace

import numpy as np
import pytest
from fem_scenes import sphere_scene
from reference_plasticity import kogut_etsion_critical

import fem_check
from epcontact import Body, Load, Scene
from epcontact.studies.paper_scene import rough_scene

SMALL = rough_scene(4, seed=3, bandwidth=4, hardness=math.inf)
FLOWING = replace(SMALL, material=replace(SMALL.material, yield_stress=25e9))


def balance(scene: Scene, steps: int) -> tuple[float, float]:
    """(stored + spent)/work - 1 at the peak and after unloading, work by the trapezoidal rule."""
    up = np.linspace(0, 1, steps + 1)[1:]
    path = np.concatenate([up, up[-2::-1], [0.0]]) * scene.load.final
    there_and_back = replace(scene, load=Load(tuple(path)))
    steps_of = fem_check.solve(there_and_back, law="j2", hardening=2e9, certified=False).steps
    p = np.array([0.0] + [step.mean_pressure for step in steps_of])
    of_steps = [step.quantities for step in steps_of]
    approach = np.array([0.0] + [of["approach"] for of in of_steps])
    held = np.array([of["stored_energy"] + of["plastic_work"] for of in of_steps])
    work = np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(approach))
    return held[steps - 1] / work[steps - 1] - 1, held[-1] / work[-1] - 1


@pytest.mark.long
@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 1e-4)], ids=lambda b: b.kind)
def test_the_work_on_a_j2_body_is_stored_or_spent_on_flow(body: Body) -> None:
    coarse, fine = (np.abs(balance(replace(FLOWING, body=body), steps)) for steps in (4, 8))
    assert fine.max() < 0.04
    assert (fine < 0.5 * coarse).all()


def test_an_elastic_half_space_has_the_same_energy_by_stress_and_by_surface() -> None:
    """Far below yield, the energy of the stresses is half of pressure times displacement."""
    light = replace(SMALL, load=Load(1e6))
    stiff = replace(light, material=replace(light.material, yield_stress=1e15))
    by_stress = fem_check.solve(stiff, law="j2", certified=False).final.quantities
    by_surface = fem_check.solve(light, law="elastic", certified=False).final.quantities
    energy = by_surface["elastic_energy"]
    assert by_stress["elastic_energy"] == pytest.approx(energy, rel=1e-6)
    assert by_stress["plastic_work"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("severity", [5.0, 12.0])
def test_a_j2_sphere_keeps_the_dent_of_etsion_and_reloads_elastically(severity: float) -> None:
    """(1 - x^-.28)(1 - x^-.69) of the largest interference, x = w/w_c up to 170 (Etsion, Kligerman
    and Kadin, Int. J. Solids Struct. 42 (2005) 3716), a fit of finite elements.

    The periodic images of the load F and the uniform compression of the block are no part of w:
    the images lower the approach by 3.9003 F/(pi E* L).
    """
    nu = 0.3
    E = 1 / (1 - nu**2)
    yield_stress = E * 0.05 / severity
    force = min(2.8, 2 / 3 * (1 + math.log(severity / 3))) * yield_stress * math.pi * 0.05**2
    scene = sphere_scene(
        force, nodes=32, nodes_to_rim=5.0, poisson_ratio=nu, yield_stress=yield_stress
    )
    p, period = scene.load.final, scene.surface.periods[0]
    result = fem_check.solve(replace(scene, load=Load((p, 0.0, p))), law="j2", certified=False)
    confined = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    compression = p * result.provenance.options["depth"] / confined
    loaded, left, again = (step.quantities for step in result.steps)
    interference = loaded["approach"] - compression + 3.9003 * force / (math.pi * E * period)
    x = interference / kogut_etsion_critical(1.0, E, yield_stress, nu)[0]
    assert 2 < x < 60
    expected = (1 - x**-0.28) * (1 - x**-0.69)
    assert left["approach"] / interference == pytest.approx(expected, abs=0.035)
    assert again["approach"] == pytest.approx(loaded["approach"], rel=0.01)
    assert again["plastic_work"] == pytest.approx(loaded["plastic_work"], rel=0.01)
