"""Faults of Persson's theory."""

import math
from dataclasses import replace

import numpy as np
from scipy.special import erf

from breaking.fault import Fault, at, changed, given, on_result, scaled
from epcontact.persson.elastoplastic import ContactAreas
from epcontact.persson.validity import ExpectedError

P = "epcontact.persson."
NONE = ExpectedError(0.0, 0.0, 0.0)
LOCAL = "tests/test_persson_local.py::"


FAULTS = (
    Fault(
        "factor 2 pi in the spectrum",
        "persson",
        scaled(P + "roughness.slope_variance_up_to", 2 * math.pi),
        "theory-elastoplastic",
        "quantity.rms_slope",
        1.0,
    ),
    Fault(
        "one half of the modes",
        "persson",
        on_result(
            P + "roughness.radial_spectrum",
            lambda rings: replace(rings, slope_variance=rings.slope_variance / 2),
        ),
        "theory-surface",
        "quantity.rms_slope",
        "heights",
    ),
    Fault(
        "gamma forgotten",
        "persson",
        changed(P + "theory.reduced_diffusion", lambda f: lambda rule, tau, *rest: tau),
        "theory-surface",
        "quantity.diffusion",
        "heights",
    ),
    Fault(
        "gamma squared",
        "persson",
        changed(
            P + "theory.reduced_diffusion",
            lambda f: lambda rule, tau, *rest: rule.gamma * f(rule, tau, *rest),
        ),
        "theory-surface",
        "quantity.diffusion",
        "heights",
    ),
    Fault(
        "E* for E*^2 in the diffusion",
        "persson",
        given(P + "theory.full_contact_diffusion", lambda E, v: (math.sqrt(E), v)),
        "theory-surface",
        "quantity.diffusion",
        "heights",
    ),
    Fault(
        "E for E* in the theory",
        "persson",
        at(P + "theory.effective_modulus", lambda material: material.young_modulus),
        "theory-surface",
        "quantity.diffusion",
        "heights",
    ),
    Fault(
        "another rule of the reduction than asked for",
        "persson",
        given(
            P + "theory.reduced_diffusion",
            lambda rule, *rest: (replace(rule, rule="persson"), *rest),
        ),
        "theory-surface",
        "quantity.diffusion",
        "heights",
    ),
    Fault(
        "modes beyond the first forgotten",
        "persson",
        at(P + "series.MODES", np.ones((1, 1))),
        "theory-elastoplastic",
        "area.elastic.raw",
    ),
    Fault(
        "modes counted from 2",
        "persson",
        at(P + "series.MODES", np.arange(2.0, 9.0)[:, None]),
        "theory-elastoplastic",
        "area.elastic.raw",
    ),
    Fault(
        "modes beyond the second forgotten",
        "persson",
        at(P + "series.MODES", np.arange(1.0, 3.0)[:, None]),
        "theory-elastoplastic",
        "area.elastic.raw",
    ),
    Fault(
        "cosines for sines",
        "persson",
        at(P + "series.sine", lambda n, s, r: np.cos(n * np.pi * s)),
        "theory-elastoplastic",
        "area.plastic.raw",
    ),
    Fault(
        "images beyond the first forgotten",
        "persson",
        at(P + "series.elastic_images", lambda walk: np.asarray(erf(walk.s / walk.c))),
        "theory-hard",
        "area.elastic.raw",
    ),
    Fault(
        "plastic wall as far as the hardness twice",
        "persson",
        given(P + "series.plastic_images", lambda walk: (walk._replace(r=2 * walk.r),)),
        "theory-hard",
        "area.plastic.raw",
    ),
    Fault(
        "the mass of a Gaussian over half its interval",
        "persson",
        given(P + "series.gaussian_mass", lambda c, h, low: (c, h / 2, c - h / 2)),
        "theory-hard",
        "area.plastic.raw",
    ),
    Fault(
        "plastic and separated area swapped",
        "persson",
        on_result(
            P + "driver.areas",
            lambda a: ContactAreas(a.elastic, a.separated, a.plastic),
        ),
        "theory-hard",
        "area.plastic.raw",
    ),
    Fault(
        "hardness ignored by the theory",
        "persson",
        given(P + "driver.areas", lambda G, p0, *rest: (G, p0)),
        "theory-elastoplastic",
        "area.plastic.raw",
    ),
    Fault(
        "yield stress for hardness in the theory",
        "persson",
        given(P + "driver.areas", lambda G, p0, hardness: (G, p0, hardness / 3)),
        "theory-elastoplastic",
        "area.plastic.raw",
    ),
    Fault(
        "force of the images of the wrong half",
        "persson",
        given(P + "series.force_images", lambda walk: (walk.mirrored(),)),
        "theory-hard",
        "residual.force",
    ),
    Fault(
        "erfc for erf",
        "persson",
        changed(P + "series.erf", lambda f: lambda x: 1 - f(x)),
        "theory-elastic",
        "area.total.raw",
    ),
    Fault(
        "half the load in the theory",
        "persson",
        given(P + "driver.areas", lambda G, p0, *rest: (G, p0 / 2, *rest)),
        "theory-elastic",
        "area.total.raw",
    ),
    Fault(
        "the separation of the theory a tenth too large",
        "persson",
        scaled(P + "driver.mean_separation", 1.1),
        "paper-elastic",
        "quantity.mean_gap",
        surfaces=1,
    ),
    Fault(
        "first moment of the roughness for the zeroth",
        "persson",
        given(P + "roughness.spectral_moment", lambda s, order, *rest: (s, 0, *rest)),
        "paper-elastic",
        "quantity.mean_gap",
        surfaces=1,
    ),
    Fault(
        "the distribution of the theory at half the load",
        "persson",
        given(P + "driver.pressure_curve", lambda G, p0, *rest: (G, p0 / 2, *rest)),
        "paper-elastoplastic",
        "distribution",
        norm="supremum",
        surfaces=1,
    ),
    Fault(
        "the distribution of the theory without its plastic part",
        "persson",
        on_result(
            P + "driver.pressure_curve", lambda curve: replace(curve, plastic=0.0)
        ),
        "paper-elastoplastic",
        "distribution",
        surfaces=1,
    ),
    Fault(
        "slopes of the density at its ends swapped",
        "persson",
        on_result(P + "driver.boundary_slopes", lambda ends: (-ends[1], -ends[0])),
        "theory-elastoplastic",
        "quantity.density_slope_at_zero",
    ),
    Fault(
        "the density at its ends half as steep",
        "persson",
        on_result(
            P + "driver.boundary_slopes", lambda ends: (ends[0] / 2, ends[1] / 2)
        ),
        "theory-elastoplastic",
        "quantity.density_slope_at_hardness",
    ),
    Fault(
        "gamma for 1 - gamma in the reduction",
        "persson",
        given(
            P + "theory.reduced_diffusion",
            lambda rule, *rest: (replace(rule, gamma=1 - rule.gamma), *rest),
        ),
        "theory-rule-persson",
        "quantity.diffusion",
    ),
    Fault(
        "the distribution of the theory ends too soon",
        "persson",
        on_result(
            P + "driver.pressure_curve",
            lambda curve: replace(curve, cumulative=0.9 * curve.cumulative),
        ),
        "theory-elastoplastic",
        "quantity.distribution_balance",
    ),
    Fault(
        "the separation of a surface that flow has not flattened",
        "persson",
        at(
            P + "separation.flattened_roughness",
            lambda theory, mean_pressure: theory.roughness,
        ),
        "theory-elastoplastic",
        "quantity.mean_gap",
    ),
    Fault(
        "the analytic spectrum for the surface's own",
        "persson",
        given(P + "theory.roughness_of", lambda surface, kind: (surface, "analytic")),
        "full-contact",
        "quantity.elastic_energy",
        of="persson",
    ),
    Fault(
        "a plan that believes the theory where the map says no",
        "planning",
        at(
            "epcontact.planning.plan.expected_errors",
            lambda *scene: dict.fromkeys(("total", "elastic", "plastic"), NONE),
        ),
        test="tests/test_plan.py::test_the_map_of_its_error_decides_where_the_theory_stands_in",
    ),
    Fault(
        "full contact's S by the local rule",
        "persson",
        at(P + "local.local_reduction", lambda pressure, *rest: np.ones_like(pressure)),
        "theory-local-hard",
        "area.total.corrected",
    ),
    Fault(
        "the second wall forgotten by the local rule",
        "persson",
        given(
            P + "local.local_reduction", lambda p, hardness, *rest: (p, np.inf, *rest)
        ),
        "theory-local-soft",
        "area.elastic.corrected",
    ),
    Fault(
        "the breadth of the roughness forgotten by the local rule",
        "persson",
        on_result(
            P + "theory.relative_wavenumbers",
            lambda found: (found[0], np.ones_like(found[1])),
        ),
        "theory-local-hard",
        "area.total.corrected",
    ),
    Fault(
        "the paper's rule for the local one",
        "persson",
        at(
            P + "local.local_reduction",
            lambda pressure, *rest: np.full_like(pressure, 0.536),
        ),
        "theory-local-soft",
        "area.elastic.corrected",
    ),
    Fault(
        "steps of first order by the local rule",
        "persson",
        at(P + "local._DIAGONAL", 1.0),
        test=LOCAL
        + "test_cells_and_steps_are_of_second_order_and_the_default_is_right",
    ),
)
