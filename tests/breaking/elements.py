"""Faults of the finite elements."""

import math
from dataclasses import replace

import numpy as np

from breaking.fault import Fault, at, changed, given, on_result, quantity, scaled
from epcontact.results import PressureDistribution

F = "fem_check."


def _law(what, change, *seen, **more):
    return Fault(
        what, "fem_check", changed(F + "plasticity.law", change), *seen, **more
    )


def _moduli(**changes):
    def change(original):
        def wrong(E, nu, Y, H=0.0):
            return original(E, nu, Y, H)._replace(
                **{k: f(E, nu) for k, f in changes.items()}
            )

        return wrong

    return change


def _fem(what, patch, *seen, **more):
    return Fault(what, "fem_check", patch, *seen, **more)


def _early(original):
    """History committed at an iterate beyond the converged displacement, then once
    more.
    """

    def wrong(u, bricks, law, history, flowing):
        return original(
            u, bricks, law, original(1.3 * u, bricks, law, history, flowing), flowing
        )

    return wrong


def _smeared(pressure, *rest):
    """Pressures of the elements between the nodes in the place of those of the
    nodes.
    """
    for axis in (0, 1):
        pressure = (pressure + np.roll(pressure, 1, axis)) / 2
    return pressure, *rest


def _step(name, change):
    return quantity("epcontact.harness.methods.registry.contact_result", name, change)


def _field(name, change):
    return on_result(F + "result.surface_fields", lambda f: f | {name: change(f[name])})


FAULTS = (
    # the law
    _law(
        "yield in the wrong norm",
        lambda f: lambda E, nu, Y, H=0.0: f(E, nu, Y * math.sqrt(1.5), H),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _law(
        "tangent hardening that nobody asked for",
        lambda f: lambda E, nu, Y, H=0.0: f(E, nu, Y, H + E / 9),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _law(
        "bulk modulus",
        _moduli(bulk=lambda E, nu: E / (3 * (1 - nu))),
        "fem-elastic-line",
        "quantity.mean_gap",
    ),
    _law(
        "shear modulus",
        _moduli(shear=lambda E, nu: E / (2 * (1 - nu))),
        "fem-elastic-line",
        "quantity.mean_gap",
    ),
    _law(
        "Lame's modulus for the bulk modulus",
        _moduli(bulk=lambda E, nu: E * nu / ((1 + nu) * (1 - 2 * nu))),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _law(
        "Poisson's ratio 0.33 for 0.3",
        lambda f: lambda E, nu, *rest: f(E, 1.1 * nu, *rest),
        "fem-sliding-line",
        "quantity.elastic_energy",
    ),
    _law(
        "hardness for yield stress",
        lambda f: lambda E, nu, Y, H=0.0: f(E, nu, 3 * Y, H),
        "fem-uniaxial",
        "quantity.approach",
    ),
    # history
    _fem(
        "history never committed",
        at(F + "plasticity.commit", lambda *given: given[3]),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _fem(
        "history committed too early",
        changed(F + "plasticity.commit", _early),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _fem(
        "the path in the reverse order",
        on_result(F + "driver.path_targets", lambda t: t[::-1]),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _fem(
        "the last load of a path left out",
        on_result(
            F + "driver.path_targets", lambda t: (*t[:-1], t[-2]) if len(t) > 1 else t
        ),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _fem(
        "loads a hundredth short",
        on_result(F + "driver.path_targets", lambda t: tuple(0.99 * p for p in t)),
        "fem-elastic",
        "quantity.measured_force",
    ),
    # mesh and block
    _fem(
        "half the depth",
        on_result(F + "driver.block_for", lambda b: replace(b, layers=b.layers / 2)),
        "fem-sliding-line",
        "quantity.mean_gap",
    ),
    _fem(
        "base held that should slide",
        on_result(F + "driver.block_for", lambda b: replace(b, sliding=False)),
        "fem-sliding-line",
        "quantity.elastic_energy",
    ),
    _fem(
        "layers from the base upward",
        on_result(F + "mesh.graded_layers", lambda t: t[::-1].copy()),
        "fem-elastic-line",
        "quantity.mean_gap",
    ),
    _fem(
        "weights of the Gauss points doubled",
        on_result(F + "mesh.elements", lambda e: e._replace(weights=2 * e.weights)),
        "fem-elastic-line",
        "quantity.mean_gap",
        status="error",
    ),
    _fem(
        "elements without mean dilatation in x",
        on_result(
            F + "mesh.elements",
            lambda e: e._replace(
                mean_gradients=e.mean_gradients * np.array([0.9, 1, 1])[:, None]
            ),
        ),
        "fem-elastic-line",
        "quantity.mean_gap",
    ),
    _fem(
        "nodes of an element a column off",
        on_result(F + "mesh.connectivity", lambda nodes: np.roll(nodes, 1, axis=1)),
        "fem-elastic-line",
        "quantity.mean_gap",
        status="error",
    ),
    # contact
    _fem(
        "cap of the nodes 5 % low",
        on_result(F + "driver.problem_of", lambda p: replace(p, cap=0.95 * p.cap)),
        "fem-capped",
        "area.plastic.corrected",
    ),
    _fem(
        "heights of the wrong sign",
        on_result(F + "driver.problem_of", lambda p: replace(p, heights=-p.heights)),
        "fem-elastic",
        "quantity.mean_gap",
    ),
    # what is reported
    _fem(
        "rim of the elements not taken off",
        on_result(F + "result.areas", lambda a: (a[0], a[0], a[2])),
        "fem-capped",
        "area.total.corrected",
    ),
    _fem(
        "1 - nu for nu in the rim",
        given(F + "result.areas", lambda s, nu, capped: (s, 1 - nu, capped)),
        "fem-elastic",
        "area.total.error",
    ),
    _fem(
        "the rim of the plastic area of the wrong sign",
        given(F + "result.areas", lambda s, nu, capped: (s, nu, False)),
        "fem-capped",
        "area.plastic.corrected",
    ),
    _fem(
        "energy of the elements not halved",
        _step("elastic_energy", lambda U: 2 * U),
        "fem-elastic-line",
        "quantity.elastic_energy",
    ),
    _fem(
        "mean gap with the plastic displacement",
        _step("mean_gap", lambda g: 0.98 * g),
        "fem-capped",
        "quantity.mean_gap",
    ),
    _fem(
        "pressures of the nodes over twice their area",
        _field("pressure", lambda p: p / 2),
        "fem-elastic",
        "quantity.measured_force",
    ),
    _fem(
        "approach from the mean plane",
        _step("approach", lambda d: d / 2),
        "fem-uniaxial",
        "quantity.approach",
    ),
    _fem(
        "pressures between the nodes",
        given(F + "result.distribution", _smeared),
        "fem-model-5",
        "quantity.model_distance",
        surfaces=1,
    ),
    # what J2 does differently from a cap
    _fem(
        "rows of the elements taken for columns",
        on_result(
            F + "result.surface_fields",
            lambda f: {name: values.T for name, values in f.items()},
        ),
        "fem-model-5",
        "quantity.model_overlap",
        surfaces=1,
    ),
    _fem(
        "contact of the elements a node off",
        _field("state", lambda s: np.roll(s, (1, 1), (0, 1))),
        "fem-model-5",
        "quantity.effective_overlap",
        surfaces=1,
    ),
    _law(
        "bulk modulus of the J2 solid",
        _moduli(bulk=lambda E, nu: E / (3 * (1 - nu))),
        "fem-model-5",
        "quantity.elements_area",
        surfaces=1,
    ),
    _fem(
        "gap of the elements of the wrong sign",
        _field("gap", lambda g: -g),
        "path-fem",
        "quantity.measured_figures",
    ),
    _fem(
        "displacement of the elements upward",
        _field("displacement", lambda u: -u),
        "path-fem",
        "quantity.measured_figures",
    ),
    _fem(
        "a node's pressure beside it",
        _field("pressure", lambda p: np.roll(p, 1, 0)),
        "path-fem",
        "quantity.measured_figures",
    ),
    _fem(
        "mean contact pressure over the nominal area",
        _step("mean_contact_pressure", lambda p: p / 10),
        "path-fem",
        "quantity.measured_figures",
    ),
    _fem(
        "largest plastic strain in per cent",
        _step("largest_plastic_strain", lambda e: 100 * e),
        "fem-uniaxial",
        "quantity.largest_plastic_strain",
    ),
    _fem(
        "plastic volume of the elements that never flowed",
        _step("plastic_volume", lambda v: 1 - v),
        "fem-uniaxial",
        "quantity.plastic_volume",
    ),
    _fem(
        "plastic depth a layer too deep",
        _step("plastic_depth", lambda d: 1.3 * d),
        "fem-uniaxial",
        "quantity.plastic_depth",
    ),
    _fem(
        "distribution of the elements over the contact",
        on_result(
            F + "result.distribution",
            lambda d: PressureDistribution(d.pressure, d.cumulative / 2, d.plastic),
        ),
        "path-fem",
        "quantity.measured_distribution",
    ),
    # the block
    _fem(
        "the block of a half-space too shallow",
        scaled(F + "mesh.half_space_depth", 0.4),
        "fem-half-space",
        "quantity.mean_gap",
    ),
    _fem(
        "a bonded base that slides",
        on_result(F + "driver.block_for", lambda b: replace(b, sliding=True)),
        "fem-elastic",
        "quantity.mean_gap",
    ),
    _fem(
        "a certificate that is not computed",
        at(
            F + "driver.certify",
            lambda *_: dict.fromkeys(("certified_balance", "certified_load"), 0.0),
        ),
        "path-fem-j2",
        "residual.certified_balance",
    ),
    _fem(
        "the sides of the block exchanged",
        on_result(
            F + "driver.block_for", lambda b: replace(b, spacing=b.spacing[::-1])
        ),
        "fem-oblong",
        "quantity.mean_gap",
    ),
    _fem(
        "layers too few for the waves",
        given(F + "mesh.graded_layers", lambda depth, first, *_: (depth, first, 4)),
        "fem-elastic-line",
        "quantity.mean_gap",
    ),
    _fem(
        "an error of the areas that is not estimated",
        on_result(
            F + "result.areas", lambda a: (a[0], a[1], type(a[2])(0.0, 0.0, 0.0))
        ),
        "fem-elastic",
        "area.total.error",
    ),
    _fem(
        "contact sets that need not carry the load",
        at(F + "contact.carrying", lambda forces, cap, load: forces),
        test="tests/test_fem_linear.py::test_lines_where_full_steps_cycle_or_whole_nodes_carry_the_load",
    ),
)
