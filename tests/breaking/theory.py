"""Faults of Persson's theory."""

import math
from dataclasses import replace

import numpy as np
from scipy.special import erf

from breaking.fault import Fault, at, changed, given, on_result, scaled
from epcontact.persson.elastoplastic import ContactAreas
from epcontact.persson.validity import ExpectedError

P = "epcontact.persson."
MAP = "tests/test_theory_map.py::"
NONE = ExpectedError(0.0, 0.0, 0.0)
LOCAL = "tests/test_persson_local.py::"


def _without_hardness(G, p0, hardness=np.inf):
    return G, p0, np.inf


def _a_third(G, p0, hardness=np.inf):
    return G, p0, hardness / 3


def _twice_as_fine(theory, mean_pressure, *magnification):
    return theory, mean_pressure, *(2 * np.asarray(zeta) for zeta in magnification)


def _with_rule(rule):
    return lambda reduction, *rest: (replace(reduction, rule=rule), *rest)


FAULTS = (
    Fault("factor 2 pi in the spectrum", "persson",
        scaled(P + "roughness.slope_variance_up_to", 2 * math.pi), "theory-elastoplastic",
        "quantity.rms_slope", 1.0),
    Fault(
        "one half of the modes", "persson",
        on_result(
            P + "roughness.radial_spectrum",
            lambda rings: replace(rings, slope_variance=rings.slope_variance / 2),
        ),
        "theory-surface", "quantity.rms_slope", "heights",
    ),
    Fault("gamma forgotten", "persson",
        changed(P + "theory.reduced_diffusion", lambda f: lambda rule, tau, *rest: tau),
        "theory-surface", "quantity.diffusion", "heights"),
    Fault(
        "gamma squared", "persson",
        changed(
            P + "theory.reduced_diffusion",
            lambda f: lambda rule, tau, *rest: rule.gamma * f(rule, tau, *rest),
        ),
        "theory-surface", "quantity.diffusion", "heights",
    ),
    Fault("the variance of the pressure for half of it", "persson",
        scaled(P + "theory.full_contact_diffusion", 2.0), "theory-surface", "quantity.diffusion",
        "heights"),
    Fault("E* for E*^2 in the diffusion", "persson",
        given(P + "theory.full_contact_diffusion", lambda E, v: (math.sqrt(E), v)),
        "theory-surface", "quantity.diffusion", "heights"),
    Fault("E for E* in the theory", "persson",
        at(P + "theory.effective_modulus", lambda material: material.young_modulus),
        "theory-surface", "quantity.diffusion", "heights"),
    Fault("another rule of the reduction than asked for", "persson",
        given(P + "theory.reduced_diffusion", _with_rule("persson")), "theory-surface",
        "quantity.diffusion", "heights"),
    Fault("modes beyond the first forgotten", "persson", at(P + "series.MODES", np.ones((1, 1))),
        "theory-elastoplastic", "area.elastic.raw"),
    Fault("modes counted from 2", "persson", at(P + "series.MODES", np.arange(2.0, 9.0)[:, None]),
        "theory-elastoplastic", "area.elastic.raw"),
    Fault("modes beyond the second forgotten", "persson",
        at(P + "series.MODES", np.arange(1.0, 3.0)[:, None]), "theory-elastoplastic",
        "area.elastic.raw"),
    Fault("cosines for sines", "persson",
        at(P + "series.sine", lambda n, s, r: np.cos(n * np.pi * s)), "theory-elastoplastic",
        "area.plastic.raw"),
    Fault("images beyond the first forgotten", "persson",
        at(P + "series.elastic_images", lambda walk: np.asarray(erf(walk.s / walk.c))),
        "theory-hard", "area.elastic.raw"),
    Fault("plastic wall as far as the hardness twice", "persson",
        given(P + "series.plastic_images", lambda walk: (walk._replace(r=2 * walk.r),)),
        "theory-hard", "area.plastic.raw"),
    Fault("the mass of a Gaussian over half its interval", "persson",
        given(P + "series.gaussian_mass", lambda c, h, low: (c, h / 2, c - h / 2)), "theory-hard",
        "area.plastic.raw"),
    Fault("plastic and separated area swapped", "persson",
        on_result(P + "driver.areas", lambda a: ContactAreas(a.elastic, a.separated, a.plastic)),
        "theory-hard", "area.plastic.raw"),
    Fault("hardness ignored by the theory", "persson", given(P + "driver.areas", _without_hardness),
        "theory-elastoplastic", "area.plastic.raw"),
    Fault("yield stress for hardness in the theory", "persson", given(P + "driver.areas", _a_third),
        "theory-elastoplastic", "area.plastic.raw"),
    Fault("force not conserved by the theory", "persson", scaled(P + "driver.elastic_force", 1.001),
        "theory-elastoplastic", "residual.force"),
    Fault("force of the images of the wrong half", "persson",
        given(P + "series.force_images", lambda walk: (walk.mirrored(),)), "theory-hard",
        "residual.force"),
    Fault("erfc for erf", "persson", changed(P + "series.erf", lambda f: lambda x: 1 - f(x)),
        "theory-elastic", "area.total.raw"),
    Fault("half the load in the theory", "persson",
        given(P + "driver.areas", lambda G, p0, *rest: (G, p0 / 2, *rest)), "theory-elastic",
        "area.total.raw"),
    Fault("the separation of the theory a tenth too large", "persson",
        scaled(P + "driver.mean_separation", 1.1), "paper-elastic", "quantity.mean_gap",
        surfaces=1),
    Fault("first moment of the roughness for the zeroth", "persson",
        given(P + "roughness.spectral_moment", lambda s, order, *rest: (s, 0, *rest)),
        "paper-elastic", "quantity.mean_gap", surfaces=1),
    Fault("the distribution of the theory at half the load", "persson",
        given(P + "driver.pressure_curve", lambda G, p0, *rest: (G, p0 / 2, *rest)),
        "paper-elastoplastic", "distribution", norm="supremum", surfaces=1),
    Fault("the distribution of the theory without its plastic part", "persson",
        on_result(P + "driver.pressure_curve", lambda curve: replace(curve, plastic=0.0)),
        "paper-elastoplastic", "distribution", surfaces=1),
    Fault("the energy of the theory doubled", "persson", scaled(P + "driver.elastic_energy", 2.0),
        "theory-elastic", "quantity.elastic_energy"),
    Fault("the gap of the theory halved", "persson", scaled(P + "driver.mean_separation", 0.5),
        "theory-path", "quantity.path_work"),
    Fault("slopes of the density at its ends swapped", "persson",
        on_result(P + "driver.boundary_slopes", lambda ends: (-ends[1], -ends[0])),
        "theory-elastoplastic", "quantity.density_slope_at_zero"),
    Fault("the density at its ends half as steep", "persson",
        on_result(P + "driver.boundary_slopes", lambda ends: (ends[0] / 2, ends[1] / 2)),
        "theory-elastoplastic", "quantity.density_slope_at_hardness"),
    Fault(
        "gamma for 1 - gamma in the reduction", "persson",
        given(P + "theory.reduced_diffusion",
            lambda rule, *rest: (replace(rule, gamma=1 - rule.gamma), *rest)),
        "theory-rule-persson", "quantity.diffusion",
    ),
    Fault(
        "the distribution of the theory ends too soon", "persson",
        on_result(P + "driver.pressure_curve",
            lambda curve: replace(curve, cumulative=0.9 * curve.cumulative)),
        "theory-elastoplastic", "quantity.distribution_balance",
    ),
    Fault("the separation of a surface that flow has not flattened", "persson",
        at(P + "separation.flattened_roughness", lambda theory, mean_pressure: theory.roughness),
        "theory-elastoplastic", "quantity.mean_gap"),
    Fault("the analytic spectrum for the surface's own", "persson",
        given(P + "theory.roughness_of", lambda surface, kind: (surface, "analytic")),
        "full-contact", "quantity.elastic_energy", of="persson"),
    Fault("the magnification counted twice", "persson",
        given(P + "theory.Theory.diffusion", _twice_as_fine),
        test="tests/test_persson_solve.py::test_the_magnification_curve_begins_and_ends_right"),
    Fault("a fifth less diffusion, away from the paper's scene", "persson",
        scaled(P + "theory.full_contact_diffusion", 0.8), "where-spots", "area.total.corrected"),
    Fault("the map of the theory's error upside down", "persson",
        on_result(P + "validity._fits", lambda found: (found[0], *(a[::-1] for a in found[1:]))),
        test=MAP + "test_at_its_places_the_map_has_the_errors_that_were_measured"),
    Fault("a note with the error at another load", "persson",
        given(P + "driver.expectation", lambda theory, p0: (theory, 3 * p0)),
        test=MAP + "test_a_result_of_the_theory_tells_its_error_or_that_it_is_not_known"),
    Fault(
        "a plan that believes the theory where the map says no", "planning",
        at(
            "epcontact.planning.plan.expected_errors",
            lambda *scene: dict.fromkeys(("total", "elastic", "plastic"), NONE),
        ),
        test="tests/test_plan.py::test_the_map_of_its_error_decides_where_the_theory_stands_in",
    ),
    Fault("full contact's S by the local rule", "persson",
        at(P + "local.local_reduction", lambda pressure, *rest: np.ones_like(pressure)),
        "theory-local-hard", "area.total.corrected"),
    Fault("the second wall forgotten by the local rule", "persson",
        given(P + "local.local_reduction", lambda p, hardness, *rest: (p, np.inf, *rest)),
        "theory-local-soft", "area.elastic.corrected"),
    Fault("the breadth of the roughness forgotten by the local rule", "persson",
        on_result(P + "theory.breadths", lambda found: (found[0], np.ones_like(found[1]))),
        "theory-local-hard", "area.total.corrected"),
    Fault("the paper's rule for the local one", "persson",
        at(P + "local.local_reduction", lambda pressure, *rest: np.full_like(pressure, 0.536)),
        "theory-local-soft", "area.elastic.corrected"),
    Fault("steps of first order by the local rule", "persson", at(P + "local._GAMMA", 1.0),
        test=LOCAL + "test_cells_and_steps_are_of_second_order_and_the_default_is_right"),
    Fault("the walls of the local rule swapped", "persson",
        given(P + "local.local_reduction",
            lambda p, hardness, *rest: (hardness - 0.9 * p, hardness, *rest)),
        test=LOCAL + "test_areas_sum_to_one_carry_the_load_and_are_those_of_the_mirror_image"),
)  # fmt: skip
