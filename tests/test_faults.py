"""Every gate can fail: a table of deliberate faults, and the gate of a case that each turns red.

`FAULTS` is the table.  A fault is a wrong solver of `faults.py`, put in the place of the boundary
elements, or a patch of one function of the package.  For each, the named gate must fall short
under the fault and hold without it; a fault that no gate sees is a gap in the catalogue.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import faults
import numpy as np
import pytest
from scipy.special import erf

from epcontact.harness.case import load_case
from epcontact.harness.gates import FALLS_SHORT, HOLDS
from epcontact.harness.verdict import CaseVerdict, verify
from epcontact.results import Areas

Patch = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True)
class Caught:
    """The case and the gate (quantity, and against what: None, whatever) that must see a fault.

    patch: what makes the fault; without it, the solver of that name in `faults`.
    surfaces: of the case's, so many are solved; None: all.  One has no interval, but a band that
        holds eight of them holds any one within 2.5 of its standard deviations, too.
    """

    case: str
    quantity: str
    against: str | float | None
    patch: Patch | None = None
    surfaces: int | None = None


def changed(path: str, change: Callable[[Any], Any]) -> Patch:
    """Patch `module.attribute` by `change(original)`."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        module_name, _, attribute = path.rpartition(".")
        importlib.import_module(module_name)
        # Some packages shadow a module by a function of its name: ask the table of modules.
        module = sys.modules[module_name]
        monkeypatch.setattr(module, attribute, change(getattr(module, attribute)))

    return patch


def at(path: str, value: Any) -> Patch:
    """Patch `module.attribute` with a value."""
    return changed(path, lambda original: value)


def scaled(path: str, factor: float) -> Patch:
    """The result of a function multiplied by a factor."""

    def change(original: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(original)
        def wrong(*args: Any, **kwargs: Any) -> Any:
            return original(*args, **kwargs) * factor

        return wrong

    return changed(path, change)


def on_result(path: str, wrong: Callable[[Any], Any]) -> Patch:
    """What a function returns, passed through `wrong`."""

    def change(original: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *args, **kwargs: wrong(original(*args, **kwargs))

    return changed(path, change)


# --- patches -------------------------------------------------------------------------------------


def _hurst_off(original: Any) -> Any:
    def wrong(spectrum: Any, *args: Any, **kwargs: Any) -> Any:
        return original(dataclasses.replace(spectrum, hurst=spectrum.hurst - 0.1), *args, **kwargs)

    return wrong


def _one_image(original: Any) -> Any:
    """Elastic area of the free particle and its mirror image at zero alone."""
    del original
    return lambda walk: np.asarray(erf(walk.s / walk.c))


def _without_hardness(original: Any) -> Any:
    def wrong(G: Any, p0: Any, hardness: Any = np.inf) -> Any:
        del hardness
        return original(G, p0, np.inf)

    return wrong


def _modulus_without_nu(material: Any) -> float:
    return float(material.young_modulus)


def _radius_from_yield_stress(original: Any) -> Any:
    """The radius of the yield surface taken as sigma_Y, not as sqrt(2/3) of it."""
    return lambda E, nu, Y, H=0.0: original(E, nu, Y * math.sqrt(1.5), H)


def _stiff_in_volume(original: Any) -> Any:
    """Bulk modulus E/(3 (1 - nu)): one factor 2 forgotten."""

    def wrong(E: float, nu: float, Y: float, H: float = 0.0) -> Any:
        return original(E, nu, Y, H)._replace(bulk=E / (3 * (1 - nu)))

    return wrong


def _early(original: Any) -> Any:
    """History committed at an iterate beyond the converged displacement, then once more."""

    def wrong(u: Any, bricks: Any, law: Any, history: Any) -> None:
        original(1.3 * u, bricks, law, history)
        original(u, bricks, law, history)

    return wrong


def _low_cap(original: Any) -> Any:
    def wrong(*args: Any, **kwargs: Any) -> Any:
        problem = original(*args, **kwargs)
        return dataclasses.replace(problem, cap=0.95 * problem.cap)

    return wrong


def _uncorrected(original: Any) -> Any:
    def wrong(*args: Any) -> tuple[Areas, Areas, Areas]:
        raw, _, error = original(*args)
        return raw, raw, error

    return wrong


def _with_block(**changes: Any) -> Callable[[Any], Any]:
    def change(original: Any) -> Any:
        return lambda *args, **kwargs: dataclasses.replace(original(*args, **kwargs), **changes)

    return change


def _half_depth(original: Any) -> Any:
    def wrong(*args: Any, **kwargs: Any) -> Any:
        block = original(*args, **kwargs)
        return dataclasses.replace(block, layers=block.layers / 2)

    return wrong


def _turned(fields: dict[str, Any]) -> dict[str, Any]:
    """Rows taken for columns."""
    return {name: values.T for name, values in fields.items()}


def _a_node_off(fields: dict[str, Any]) -> dict[str, Any]:
    """The contact a node beside where it is, along both directions."""
    return fields | {"state": np.roll(fields["state"], (1, 1), (0, 1))}


def _smeared(original: Any) -> Any:
    """Pressures of the elements between the nodes in the place of those of the nodes."""

    def wrong(pressure: Any, *rest: Any) -> Any:
        for axis in (0, 1):
            pressure = (pressure + np.roll(pressure, 1, axis)) / 2
        return original(pressure, *rest)

    return wrong


def _hardened(original: Any) -> Any:
    """A tangent modulus of a tenth of E, as solvers take it to converge the sooner."""
    return lambda E, nu, Y, H=0.0: original(E, nu, Y, H + E / 9)


def _double_amplitude(heights: Any) -> Any:
    return lambda recipe, h, *args, **kwargs: heights(recipe, 2 * np.asarray(h), *args, **kwargs)


FAULTS: dict[str, Caught] = {
    # surface
    "upside_down": Caught("full-contact", "field.pressure", "full_contact"),
    "transposed": Caught("westergaard-surface", "field.pressure", "westergaard"),
    "half_cell": Caught("full-contact", "field.pressure", "full_contact"),
    "shifted": Caught("westergaard-line", "field.pressure", "westergaard"),
    "coarse": Caught("rough-elastic", "quantity.measured_gap", 0.0),
    "amplitude from valley to crest": Caught(
        "westergaard-line", "quantity.surface_rms_height", 7.071067811865476e-7,
        changed("epcontact.surfaces.shapes.surface_with", _double_amplitude),
    ),
    "radius for diameter": Caught(
        "hertz-sphere", "quantity.surface_curvature", 100.0,
        changed("epcontact.surfaces.shapes.squared_distance", lambda f: lambda r: 2 * f(r)),
    ),
    # spectrum
    "slope of the band 5 % off": Caught(
        "rough-elastic", "quantity.surface_rms_slope", 0.02,
        scaled("epcontact.surfaces.self_affine.grid_heights", 1.05),
    ),
    "Hurst exponent of the surface": Caught(
        "rough-elastic", "quantity.surface_rms_height", 5.892907742410429e-7,
        changed("epcontact.surfaces.self_affine.amplitude_shape", _hurst_off),
    ),
    "factor 2 pi in the spectrum": Caught(
        "theory-elastoplastic", "quantity.rms_slope", 1.0,
        scaled("epcontact.persson.roughness.slope_variance_up_to", 2 * math.pi),
    ),
    "one half of the modes": Caught(
        "theory-surface", "quantity.rms_slope", "heights",
        on_result(
            "epcontact.persson.roughness.radial_spectrum",
            lambda rings: replace(rings, slope_variance=rings.slope_variance / 2),
        ),
    ),
    # theory
    "gamma forgotten": Caught(
        "theory-surface", "quantity.diffusion", "heights",
        changed(
            "epcontact.persson.theory.reduced_diffusion", lambda f: lambda rule, tau, *rest: tau
        ),
    ),
    "E for E* in the theory": Caught(
        "theory-surface", "quantity.diffusion", "heights",
        at("epcontact.persson.theory.effective_modulus", _modulus_without_nu),
    ),
    "modes beyond the first forgotten": Caught(
        "theory-elastoplastic", "area.elastic.raw", 0.052501984135568624,
        at("epcontact.persson.series.MODES", np.ones((1, 1))),
    ),
    "images beyond the first forgotten": Caught(
        "theory-hard", "area.elastic.raw", 0.40901231822310838,
        changed("epcontact.persson.series.elastic_images", _one_image),
    ),
    "plastic wall as far as the hardness twice": Caught(
        "theory-hard", "area.plastic.raw", 0.0061680596479676502,
        changed(
            "epcontact.persson.series.plastic_images",
            lambda f: lambda walk: f(replace(walk, r=2 * walk.r)),
        ),
    ),
    "hardness ignored by the theory": Caught(
        "theory-elastoplastic", "area.plastic.raw", 0.057184882122805008,
        changed("epcontact.persson.driver.areas", _without_hardness),
    ),
    "force not conserved by the theory": Caught(
        "theory-elastoplastic", "residual.force", 0.0,
        scaled("epcontact.persson.driver.elastic_force", 1.001),
    ),
    "erfc for erf": Caught(
        "theory-elastic", "area.total.raw", 0.10864479557735564,
        changed("epcontact.persson.series.erf", lambda f: lambda x: 1 - f(x)),
    ),
    # kernel
    "stiff": Caught("westergaard-line", "quantity.mean_gap", "westergaard"),
    "plane_stress": Caught("hertz-sphere", "area.total.corrected", "hertz"),
    "half_compliance": Caught("hertz-cylinder", "area.total.corrected", "hertz"),
    "cycles_for_radians": Caught("waviness-light", "area.total.corrected", "waviness_light"),
    "difference_kernel": Caught("full-contact", "field.pressure", "full_contact"),
    "no_depth": Caught("layer-bonded", "field.pressure", "full_contact"),
    "wrong_base": Caught("layer-sliding", "field.pressure", "full_contact"),
    "no_compression": Caught("layer-bonded", "quantity.elastic_energy", "full_contact"),
    # solver
    "light": Caught("rough-elastic", "quantity.measured_force", 0.0),
    "first_load": Caught("punch-strip", "quantity.measured_force", 0.0),
    "no_cap": Caught("rough-capped", "quantity.measured_bounds", 0.0),
    "low_cap": Caught("punch-capped", "area.plastic.corrected", "capped_strip"),
    "high_cap": Caught("punch-capped", "area.plastic.corrected", "capped_strip"),
    "clipped": Caught("rough-capped", "quantity.measured_force", 0.0),
    "clipped_and_scaled": Caught("rough-capped", "quantity.measured_gap", 0.0),
    "impatient": Caught("rough-capped", "quantity.measured_gap", 0.0),
    "tensile": Caught("rough-elastic", "quantity.measured_bounds", 0.0),
    "single_precision": Caught("rough-elastic", "quantity.measured_force", 0.0),
    # area estimate and what is reported
    "gap_sign": Caught("westergaard-line", "field.gap", "westergaard"),
    "raw_called_corrected": Caught("hertz-sphere", "area.total.corrected", "hertz"),
    "corrected_called_raw": Caught("rough-elastic", "quantity.measured_raw_total", 0.0),
    "corrected_the_wrong_way": Caught("hertz-sphere-dense", "area.total.corrected", "hertz"),
    "elastic_called_total": Caught("bearing-area", "area.total.raw", "bearing_area"),
    "plastic_from_gap": Caught("rough-capped", "quantity.measured_raw_plastic", 0.0),
    "lost_delta": Caught("rough-capped", "quantity.measured_carried", 0.0),
    "of_the_contact": Caught("rough-capped", "quantity.measured_carried", 0.0),
    # comparison
    "no distance between distributions": Caught(
        "yardstick",
        "distribution",
        "flat",
        at("epcontact.harness.verdict.distance", lambda *_: 0.0),
    ),
    "distance not divided by its scale": Caught(
        "yardstick", "distribution", "flat", scaled("epcontact.harness.verdict.distance", 1e9)
    ),
    "absolute for relative": Caught(
        "yardstick", "area.total.raw", 0.5,
        at("epcontact.harness.gates.deviation", lambda norm, value, reference: value - reference),
    ),
    "sign of a difference lost": Caught(
        "yardstick", "area.total.raw", 1.5,
        changed("epcontact.harness.gates.deviation", lambda f: lambda *a: abs(f(*a))),
    ),
    "distance of a field not measured": Caught(
        "yardstick", "field.pressure", "flat",
        at("epcontact.harness.quantities.l2_distance", lambda *_: 0.0),
    ),
    # finite elements: elements, return mapping, contact
    "yield in the wrong norm": Caught(
        "fem-uniaxial", "quantity.approach", "flat",
        changed("fem_check.plasticity.law", _radius_from_yield_stress),
    ),
    "history never committed": Caught(
        "fem-uniaxial", "quantity.approach", "flat",
        at("fem_check.plasticity.commit", lambda *_: None),
    ),
    "history committed too early": Caught(
        "fem-uniaxial", "quantity.approach", "flat",
        changed("fem_check.plasticity.commit", _early),
    ),
    "bulk modulus": Caught(
        "fem-elastic-line", "quantity.mean_gap", "bem",
        changed("fem_check.plasticity.law", _stiff_in_volume),
    ),
    "half the depth": Caught(
        "fem-sliding-line", "quantity.mean_gap", "bem",
        changed("fem_check.driver.block_for", _half_depth),
    ),
    "base held that should slide": Caught(
        "fem-sliding-line", "quantity.elastic_energy", "bem",
        changed("fem_check.driver.block_for", _with_block(sliding=False)),
    ),
    "rim of the elements not taken off": Caught(
        "fem-capped", "area.total.corrected", "bem",
        changed("fem_check.result.areas", _uncorrected),
    ),
    "cap of the nodes 5 % low": Caught(
        "fem-capped", "area.plastic.corrected", "bem",
        changed("fem_check.driver.problem_of", _low_cap),
    ),
    # finite elements: what J2 does differently from a cap
    "yield of J2 in the wrong norm": Caught(
        "fem-model-5", "quantity.effective_hardness", None,
        changed("fem_check.plasticity.law", _radius_from_yield_stress), surfaces=1,
    ),
    "tangent hardening that nobody asked for": Caught(
        "fem-model-15", "quantity.model_area", None,
        changed("fem_check.plasticity.law", _hardened), surfaces=1,
    ),
    "rows of the elements taken for columns": Caught(
        "fem-model-5", "quantity.model_overlap", None,
        on_result("fem_check.result.surface_fields", _turned), surfaces=1,
    ),
    "contact of the elements a node off": Caught(
        "fem-model-5", "quantity.effective_overlap", None,
        on_result("fem_check.result.surface_fields", _a_node_off), surfaces=1,
    ),
    "pressures between the nodes": Caught(
        "fem-model-5", "quantity.model_distance", None,
        changed("fem_check.result.distribution", _smeared), surfaces=1,
    ),
    "bulk modulus of the J2 solid": Caught(
        "fem-model-5", "quantity.elements_area", None,
        changed("fem_check.plasticity.law", _stiff_in_volume), surfaces=1,
    ),
}  # fmt: skip


def outcome_of(
    name: str, output: Path, solver: str = "", surfaces: int | None = None
) -> CaseVerdict:
    case = load_case(name)
    case = replace(case, recipes=case.recipes[:surfaces])
    return verify(case, jobs=1, output=output, solver=solver, fresh=True).cases[0]


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., CaseVerdict]:
    """The outcome of a case as the package itself answers it, once a session."""
    return functools.cache(
        lambda name, surfaces: outcome_of(
            name, tmp_path_factory.mktemp("honest"), surfaces=surfaces
        )
    )


def gate_of(outcome: CaseVerdict, caught: Caught) -> str:
    found = [
        g for g in outcome.gates
        if g.quantity == caught.quantity and caught.against in (None, g.against)
    ]  # fmt: skip
    assert len(found) == 1, f"{caught.case} has {len(found)} gates {caught.quantity}"
    return found[0].status


@pytest.mark.parametrize("name", FAULTS)
def test_fault_turns_its_gate_red(name, honest, tmp_path, monkeypatch) -> None:
    caught = FAULTS[name]
    assert gate_of(honest(caught.case, caught.surfaces), caught) == HOLDS
    solver = ""
    if caught.patch is None:
        monkeypatch.syspath_prepend(str(Path(__file__).parent))
        solver = f"faults:{name}"
    else:
        caught.patch(monkeypatch)
    wrong = outcome_of(caught.case, tmp_path, solver, caught.surfaces)
    assert gate_of(wrong, caught) == FALLS_SHORT


def test_every_wrong_solver_is_in_the_table() -> None:
    solvers = {
        name for name, value in vars(faults).items()
        if getattr(value, "__module__", "") == "faults" and not name.startswith("_")
    }  # fmt: skip
    told_otherwise = {"honest", "never_converges", "returns_nonsense", "crashes"}
    assert solvers - told_otherwise == {n for n, c in FAULTS.items() if c.patch is None}


def test_there_are_faults_of_every_kind() -> None:
    assert len(FAULTS) >= 25
    assert {c.case.split("-")[0] for c in FAULTS.values()} >= {"hertz", "theory", "fem", "layer"}


def prandtl_ratio(mean_dilatation: bool) -> np.ndarray:
    """Computed over exact limit pressure of a strip punch at four elements a half-width."""
    from fem_check.benchmarks.limit_loads import strip_punch

    curve = strip_punch(4, mean_dilatation=mean_dilatation)
    return curve.computed / curve.exact


def test_locked_element_never_reaches_a_limit_load() -> None:
    # No scene has a limit load under a given pressure: the element's gate is Prandtl's plateau.
    honest, locked = prandtl_ratio(True), prandtl_ratio(False)
    assert honest[-1] / honest[-2] - 1 < 1e-3
    assert honest[-1] < 1.1  # 1.077 at four elements, 1.040 at eight: first order
    assert locked[-1] / locked[-2] - 1 > 1e-2
    assert locked[-1] > 1.3
