"""Faults of the boundary elements."""

import math
from dataclasses import replace

import faults
import numpy as np
from faults import honest

from breaking.fault import Fault, at, changed, given, on_result, quantity, solver
from epcontact.bem import driver
from epcontact.results import APART, ELASTIC, PLASTIC, Areas, PressureDistribution
from epcontact.scene import Body, Load

B = "epcontact.bem."


def _wrong(what, wrong, *seen):
    return Fault(what, "bem", solver(wrong), *seen)


def _reported(what, name, change, *seen):
    return Fault(what, "bem", quantity(B + "solve", name, change), *seen)


def _loaded(scene, *path):
    return replace(scene, load=Load(path))


def _areas(what, change, *seen):
    return _wrong(what, lambda scene: faults.with_areas(honest(scene), change), *seen)


def _of_the_contact(found):
    total = found.cumulative[-1] + found.plastic
    return replace(
        found, cumulative=found.cumulative / total, plastic=found.plastic / total
    )


def _with_field(name, change):
    def wrong(result):
        return replace(
            result, fields=dict(result.fields) | {name: change(result.fields[name])}
        )

    return on_result(B + "solve", wrong)


def _turned_state(state):
    out = np.full_like(state, APART)
    out[state == ELASTIC], out[state == PLASTIC] = PLASTIC, ELASTIC
    return out


def _layer_with(**changes):
    return lambda q, body, material: (q, body, replace(material, **changes))


def _estimated(change):
    return on_result(B + "driver.estimate_areas", lambda found: change(*found))


def _total_alone(raw, good, error):
    return raw, Areas(good.total, good.total - raw.plastic, raw.plastic), error


def _largest_rows_first(original):
    def wrong(values, shape):
        symbol = original(values, shape)
        return replace(symbol, rows=np.roll(symbol.rows, 1))

    return wrong


def _longest_first(path):
    return path[::-1]


def _late(result):
    """Every step of a path with the figures of the step before it."""
    before = (result.steps[0], *result.steps[:-1])
    steps = (
        replace(step, quantities=late.quantities)
        for step, late in zip(result.steps, before, strict=True)
    )
    return replace(result, steps=tuple(steps))


FAULTS = (
    # material, load and cap
    _wrong(
        "the modulus 5 % too high",
        faults.stiff,
        "westergaard-line",
        "quantity.mean_gap",
    ),
    _wrong(
        "E for E*",
        lambda s: faults.with_material(s, poisson_ratio=0.0),
        "hertz-sphere",
        "area.total.corrected",
    ),
    _wrong(
        "2 % of the load lost",
        lambda s: honest(_loaded(s, *(0.98 * p for p in s.load.path))),
        "rough-elastic",
        "quantity.measured_force",
    ),
    _wrong(
        "half the load",
        lambda s: honest(_loaded(s, s.load.final / 2)),
        "punch-strip",
        "quantity.measured_force",
    ),
    _wrong("the cap lost", faults.no_cap, "rough-capped", "quantity.measured_bounds"),
    _wrong(
        "the cap 3 % too low",
        lambda s: faults.with_material(s, hardness=0.97 * s.material.hardness),
        "punch-capped",
        "area.plastic.corrected",
    ),
    _wrong(
        "the cap 3 % too high",
        lambda s: faults.with_material(s, hardness=1.03 * s.material.hardness),
        "punch-capped",
        "area.plastic.corrected",
    ),
    _wrong(
        "pressures clipped at the cap",
        faults.clipped,
        "rough-capped",
        "quantity.measured_force",
    ),
    _wrong(
        "pressures clipped and scaled",
        faults.clipped_and_scaled,
        "rough-capped",
        "quantity.measured_gap",
    ),
    # heights
    _wrong(
        "the surface upside down",
        lambda s: faults.with_heights(s, -s.surface.heights),
        "full-contact",
        "field.pressure",
    ),
    _wrong(
        "periods exchanged", faults.transposed, "westergaard-surface", "field.pressure"
    ),
    _wrong(
        "heights half a cell off", faults.half_cell, "full-contact", "field.pressure"
    ),
    _wrong(
        "fields an eighth of the grid off",
        faults.shifted,
        "westergaard-line",
        "field.pressure",
    ),
    _wrong(
        "every second point solved",
        faults.coarse,
        "rough-elastic",
        "quantity.measured_gap",
    ),
    Fault(
        "rows for columns in the pressure",
        "bem",
        _with_field("pressure", lambda p: p.T.reshape(p.shape)),
        "full-contact",
        "field.pressure",
    ),
    Fault(
        "the first axis turned round",
        "bem",
        _with_field("pressure", lambda p: p[::-1]),
        "full-contact",
        "field.pressure",
    ),
    # kernel
    _wrong(
        "half the compliance",
        lambda s: faults.with_compliance(s, lambda q, C: C / 2),
        "hertz-cylinder",
        "area.total.corrected",
    ),
    _wrong(
        "cycles for radians",
        lambda s: faults.with_compliance(s, lambda q, C: C * 2 * math.pi),
        "waviness-light",
        "area.total.corrected",
    ),
    _wrong(
        "a difference kernel",
        faults.difference_kernel,
        "full-contact",
        "field.pressure",
    ),
    _wrong(
        "no depth",
        lambda s: honest(replace(s, body=Body())),
        "layer-bonded",
        "field.pressure",
    ),
    _wrong("bonded for sliding", faults.wrong_base, "layer-sliding", "field.pressure"),
    _wrong(
        "no compression",
        faults.no_compression,
        "layer-bonded",
        "quantity.elastic_energy",
    ),
    Fault(
        "1 - nu for 1 - nu^2 in the kernel",
        "bem",
        at(
            B + "kernel.effective_modulus",
            lambda m: m.young_modulus / (1 - m.poisson_ratio),
        ),
        "hertz-cylinder",
        "area.total.corrected",
    ),
    Fault(
        "nu of the layer off by a tenth",
        "bem",
        given(B + "kernel.surface_compliance", _layer_with(poisson_ratio=0.33)),
        "layer-bonded",
        "field.pressure",
    ),
    Fault(
        "half the depth of a layer",
        "bem",
        given(
            B + "kernel.surface_compliance",
            lambda q, body, m: (q, replace(body, depth=body.depth / 2), m),
        ),
        "layer-sliding",
        "field.pressure",
    ),
    Fault(
        "the sides of the grid exchanged in the kernel",
        "bem",
        given(B + "driver.quarter_compliance", lambda n, L, *rest: (n, L[::-1], *rest)),
        "full-contact",
        "field.pressure",
    ),
    Fault(
        "E for the modulus of uniaxial strain",
        "bem",
        at(B + "driver.oedometric_modulus", lambda m: m.young_modulus),
        "layer-bonded",
        "quantity.elastic_energy",
    ),
    Fault(
        "the rows of the modes off by one",
        "bem",
        changed(B + "transforms.Symbol.from_quarter", _largest_rows_first),
        "full-contact",
        "field.pressure",
    ),
    Fault(
        "the compliance of a wave twice as long",
        "bem",
        given(B + "kernel.surface_compliance", lambda q, *rest: (q / 2, *rest)),
        "westergaard-light",
        "quantity.mean_gap",
    ),
    # solver
    _wrong(
        "impatient",
        lambda s: driver.solve(s, threads=1, area_tolerance=0.1),
        "rough-capped",
        "quantity.measured_gap",
    ),
    _wrong(
        "gaps closed by tension",
        faults.tensile,
        "rough-elastic",
        "quantity.measured_bounds",
    ),
    Fault(
        "single precision",
        "bem",
        _with_field("pressure", lambda p: p.astype(np.float32).astype(float)),
        "rough-elastic",
        "quantity.measured_force",
    ),
    Fault(
        "a tolerance a thousand times too large",
        "bem",
        changed(
            B + "solve",
            lambda f: (
                lambda scene, **options: f(scene, **options | {"tolerance": 1e-5})
            ),
        ),
        "rough-elastic",
        "quantity.measured_gap",
    ),
    Fault(
        "the force of a projection a thousandth too large",
        "bem",
        given(
            B + "solver.project",
            lambda w, cap, total, *rest: (w, cap, 1.001 * total, *rest),
        ),
        "rough-capped",
        "quantity.measured_force",
        status="error",
    ),
    # area estimate
    _areas(
        "raw called corrected",
        lambda areas: areas | {"corrected": areas["raw"]},
        "hertz-sphere",
        "area.total.corrected",
    ),
    _areas(
        "corrected called raw",
        lambda areas: areas | {"raw": areas["corrected"]},
        "rough-elastic",
        "quantity.measured_raw_total",
    ),
    _wrong(
        "corrected the wrong way",
        faults.corrected_the_wrong_way,
        "hertz-sphere-dense",
        "area.total.corrected",
    ),
    _areas(
        "elastic called total",
        lambda areas: {k: replace(a, total=a.elastic) for k, a in areas.items()},
        "bearing-area",
        "area.total.raw",
    ),
    _wrong(
        "plastic points counted by the gap",
        faults.plastic_from_gap,
        "rough-capped",
        "quantity.measured_raw_plastic",
    ),
    Fault(
        "the plastic area not corrected",
        "bem",
        _estimated(_total_alone),
        "paper-elastoplastic",
        "area.plastic.corrected",
        "persson",
        surfaces=1,
    ),
    Fault(
        "elastic and plastic area exchanged",
        "bem",
        _estimated(
            lambda *areas: tuple(Areas(a.total, a.plastic, a.elastic) for a in areas)
        ),
        "punch-capped",
        "area.plastic.corrected",
    ),
    Fault(
        "E for E* in the area estimate",
        "bem",
        given(
            B + "driver.estimate_areas",
            lambda p, g, H, d, E, n: (p, g, H, d, 0.91 * E, n),
        ),
        "hertz-cylinder",
        "area.total.corrected",
    ),
    Fault(
        "gap of the wrong sign in the area estimate",
        "bem",
        given(B + "driver.estimate_areas", lambda p, g, *rest: (p, -g, *rest)),
        "hertz-cylinder",
        "area.total.corrected",
    ),
    Fault(
        "half the offset of a front",
        "bem",
        changed(B + "areas.rim_correction.OFFSETS", lambda table: table / 2),
        "hertz-sphere",
        "area.total.corrected",
    ),
    Fault(
        "the front at the edge of a flattened spot taken for one of a first loading",
        "bem",
        changed(B + "driver.estimate_areas", lambda f: lambda *a, **_: f(*a)),
        test="tests/test_bem_areas.py::test_areas_after_unloading_are_those_of_finer_grids",
    ),
    # distribution
    Fault(
        "the plastic part lost",
        "bem",
        on_result(
            B + "driver.pressure_distribution", lambda d: replace(d, plastic=0.0)
        ),
        "rough-capped",
        "quantity.measured_carried",
    ),
    Fault(
        "normalised by the contact",
        "bem",
        on_result(B + "driver.pressure_distribution", _of_the_contact),
        "rough-capped",
        "quantity.measured_carried",
    ),
    Fault(
        "a distribution of 64 bins",
        "bem",
        given(B + "driver.pressure_distribution", lambda p, H, bins: (p, H, 64)),
        "westergaard-line",
        "distribution",
    ),
    Fault(
        "pressures of the distribution in units of p0",
        "bem",
        on_result(
            B + "driver.pressure_distribution",
            lambda d: PressureDistribution(d.pressure / 1e8, d.cumulative, d.plastic),
        ),
        "westergaard-line",
        "distribution",
    ),
    Fault(
        "a distribution of the density, not cumulative",
        "bem",
        on_result(
            B + "driver.pressure_distribution",
            lambda d: PressureDistribution(
                d.pressure, np.concatenate([[0.0], np.diff(d.cumulative)]), d.plastic
            ),
        ),
        "rough-elastic",
        "quantity.measured_carried",
    ),
    # further quantities and fields
    Fault(
        "the gap of the wrong sign",
        "bem",
        _with_field("gap", lambda g: -g),
        "westergaard-line",
        "field.gap",
    ),
    _reported(
        "energy not halved",
        "elastic_energy",
        lambda U: 2 * U,
        "westergaard-line",
        "quantity.elastic_energy",
    ),
    _reported(
        "mean gap over the open area",
        "mean_gap",
        lambda g: g / 0.63,
        "westergaard-line",
        "quantity.mean_gap",
    ),
    _reported(
        "largest pressure in GPa",
        "largest_pressure",
        lambda p: p / 1e9,
        "westergaard-line",
        "quantity.largest_pressure",
    ),
    # what a result says of itself
    Fault(
        "residuals that are always zero",
        "bem",
        changed(
            B + "solver.kkt_residuals", lambda f: lambda *a: dict.fromkeys(f(*a), 0.0)
        ),
        "rough-loose",
        "quantity.measured_residuals",
    ),
    Fault(
        "corner cells of the wrong sign",
        "bem",
        changed(B + "areas.rim_correction.CORNER", lambda c: -c),
        "hertz-sphere-coarse",
        "area.total.corrected",
    ),
    Fault(
        "the error of an area ten times too small",
        "bem",
        _estimated(
            lambda raw, good, e: (raw, good, Areas(*(v / 10 for v in vars(e).values())))
        ),
        "hertz-sphere-coarse",
        "area.total.error",
    ),
    Fault(
        "areas that are thirty times less sure",
        "bem",
        _estimated(
            lambda raw, good, e: (raw, good, Areas(*(30 * v for v in vars(e).values())))
        ),
        "fem-capped",
        "area.total.corrected",
    ),
    _reported(
        "energy of the capped body 3 % off",
        "elastic_energy",
        lambda U: 1.03 * U,
        "rough-capped",
        "quantity.measured_figures",
    ),
    _reported(
        "plastic displacement over the plastic area",
        "mean_plastic_displacement",
        lambda w: 10 * w,
        "rough-capped",
        "quantity.measured_figures",
    ),
    _reported(
        "separation of the wrong sign",
        "mean_separation",
        lambda g: -g,
        "rough-capped",
        "quantity.measured_figures",
    ),
    Fault(
        "elastic and plastic points exchanged in the field of states",
        "bem",
        _with_field("state", _turned_state),
        "rough-capped",
        "quantity.measured_fields",
    ),
    Fault(
        "displacement upward",
        "bem",
        _with_field("displacement", lambda u: -u),
        "full-contact",
        "quantity.measured_fields",
    ),
    Fault(
        "a gap that leaves out the offset of the flat",
        "bem",
        _with_field("gap", lambda g: g - g.mean()),
        "rough-capped",
        "quantity.measured_fields",
    ),
    Fault(
        "states by half of the pressures",
        "bem",
        given(B + "driver.states", lambda p, cap: (p / 2, cap)),
        "rough-capped",
        "quantity.measured_fields",
    ),
    Fault(
        "the steps of a load path in the reverse order",
        "bem",
        on_result(B + "solve", lambda r: replace(r, steps=r.steps[::-1])),
        "path-elastic",
        "quantity.measured_areas",
    ),
    Fault(
        "the figures of a path a step late",
        "bem",
        on_result(B + "solve", _late),
        "path-capped",
        "quantity.path_work",
    ),
    # fronts along the grid, which no sphere and no rough surface has
    Fault(
        "spacings of the two axes exchanged in the areas",
        "bem",
        given(
            B + "driver.estimate_areas",
            lambda p, g, H, d, *rest: (p, g, H, d[::-1], *rest),
        ),
        "ridge-oblong",
        "area.total.corrected",
    ),
    Fault(
        "the same offset for fronts of all directions",
        "bem",
        at(B + "areas.rim_correction.HARMONIC", 0.0),
        "ridge-square",
        "area.total.corrected",
    ),
)
