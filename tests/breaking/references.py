"""Faults of the exact solutions, which would let a wrong solver pass."""

from breaking.fault import Fault, at, changed, given, on_result

R = "epcontact.reference."
M = "epcontact.materials.hardness_map."
MAPPED = "tests/test_hardness_map.py::test_the_"


def _form(what, patch, *seen, **more):
    return Fault(what, "reference", patch, *seen, **more)


def _one_row_lower(known):
    inverse = known["inverse_hardness"].copy()
    inverse[60] *= 0.85
    return {**known, "inverse_hardness": inverse}


FAULTS = (
    Fault(
        "a row of the map of the hardness too hard",
        "materials",
        on_result(M + "hardness_map", _one_row_lower),
        test=MAPPED + "map_covers_what_it_says_and_is_smooth",
    ),
    Fault(
        "a hardness that falls with the breadth",
        "materials",
        on_result(M + "by_breadth", lambda told: (-told[0], told[1])),
        test=MAPPED + "breadth_is_judged_by_ensembles_that_taught_nothing",
    ),
    _form(
        "pressure of a wave with sine for cosine",
        given(R + "waves.line_pressure", lambda x, s: (x + 0.25, s)),
        "westergaard-line",
        "field.pressure",
    ),
    _form(
        "mean gap of a wave without its logarithm",
        at(R + "waves.line_mean_gap", lambda s: 1 - s),
        "westergaard-heavy",
        "quantity.mean_gap",
    ),
    _form(
        "gaps near full contact with the load for the rest",
        given(R + "waves.surface_contact_fraction_heavy", lambda s: (1 - 2 * (1 - s),)),
        "waviness-heavy",
        "area.total.corrected",
    ),
    _form(
        "lattice sum over half the neighbours",
        changed(R + "bumps.LATTICE_SUM_3", lambda s: s / 2),
        "hertz-sphere-dense",
        "area.total.corrected",
    ),
    _form(
        "a single cylinder for a row",
        changed(
            R + "bumps.cylinder_half_width_periodic",
            lambda f: lambda P, R, E, L: f(P, R, E, 100 * L),
        ),
        "hertz-cylinder",
        "area.total.corrected",
    ),
    _form(
        "the images of a disc of the wrong sign",
        changed(R + "posts.MADELUNG", lambda m: -m),
        "punch-disc",
        "quantity.elastic_energy",
    ),
    _form(
        "pressure in the middle of a single strip",
        given(R + "posts.strip_pressure_periodic", lambda x, P, a, L: (x, P, a, 2 * L)),
        "punch-strip",
        "quantity.smallest_contact_pressure",
    ),
    _form(
        "sliding for bonded in the reference",
        changed(
            R + "layers.surface_compliance",
            lambda f: lambda *a, bonded=True: f(*a, bonded=not bonded),
        ),
        "layer-bonded",
        "field.pressure",
    ),
    _form(
        "the depth of a layer twice in the reference",
        given(R + "layers.surface_compliance", lambda q, d, E, nu: (q, 2 * d, E, nu)),
        "rough-layer",
        "quantity.measured_gap",
    ),
    _form(
        "Lame's compliance for E",
        at(R + "layers.lame_compliance", lambda d, E, nu: d / E),
        "layer-sliding",
        "quantity.elastic_energy",
    ),
    _form(
        "yield pressure of uniaxial stress",
        at(R + "layers.uniaxial_yield_pressure", lambda m: m.yield_stress),
        "fem-uniaxial",
        "quantity.approach",
        status="error",
    ),
    _form(
        "E for E* in the slope's pressures",
        at(R + "roughness.effective_modulus", lambda m: m.young_modulus),
        "theory-surface",
        "quantity.diffusion",
    ),
)
