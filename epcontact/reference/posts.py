"""One flat post per period, pressed without friction: formulas and closed forms.

Symbols: F = force (N), P' = force per length (N/m), a = radius or half-width (m), E* =
effective_modulus (Pa), L = period (m), p0 = mean pressure (Pa), sigma_P = hardness
(Pa).

Sources: Johnson, Contact Mechanics (1985), sections 2.8 and 3.4.  The periodic strip is
Westergaard's stress function for a row of cracks (1939); the capped strip is the
counterpart of a row of cracks with Dugdale's zones (Smith 1965).  A smooth strip on a
perfectly plastic half-space carries at most the mean pressure (2 + pi) k of Prandtl's
slip lines, where k = sigma_Y/sqrt(3) is von Mises' yield stress in shear.
"""

from __future__ import annotations

import math

import numpy as np

from epcontact.materials.moduli import effective_modulus
from epcontact.reference.bumps import LATTICE_SUM_3, LATTICE_SUM_5, MADELUNG
from epcontact.reference.form import ClosedForm
from epcontact.results import FloatArray
from epcontact.scene import Scene

FLAT_PUNCH = ClosedForm(
    "flat_punch",
    "Johnson, Contact Mechanics (1985), sections 2.8 and 3.4; Westergaard 1939 for the "
    "row",
)
CAPPED_STRIP = ClosedForm(
    "capped_strip",
    "Dugdale, J. Mech. Phys. Solids 8 (1960) 100, for a row of cracks (Smith 1965)",
)
PRANDTL = ClosedForm("prandtl", "Prandtl (1920): (2 + pi) k under a smooth strip")


def strip_pressure_periodic(
    distance: FloatArray, force_per_length: float, half_width: float, period: float
) -> FloatArray:
    """Return the pressure in Pa under a row of flat strips, with t = pi x/L:

        p = (P'/L) cos(t) (sin^2 t_a - sin^2 t)^(-1/2)

    It is infinite at the rim t_a = pi a/L, and 0 outside of the strip.

    Args:
        distance: x from the middle of a strip in m, of any shape.
        force_per_length: P' on one strip, in N/m.
        half_width: a of a strip, in m.
        period: L, the distance of neighbours, in m.
    """
    angle = np.pi * np.asarray(distance) / period
    depth = math.sin(math.pi * half_width / period) ** 2 - np.sin(angle) ** 2
    with np.errstate(divide="ignore"):
        inside = np.cos(angle) / np.sqrt(np.maximum(depth, 0))
    return np.asarray(np.where(depth >= 0, force_per_length / period * inside, 0.0))


def _post(scene: Scene, form: ClosedForm) -> tuple[float, float]:
    """Measure the flat post on the heights of a scene.

    Args:
        scene: The scene.
        form: The closed form that an error names.

    Returns:
        Area of the post as a fraction of the nominal area; half-width of a strip, or
        radius of a disc of this area, in m.

    Raises:
        InvalidCase: The surface is no flat post on a floor, on a half-space.
    """
    form.require(scene.body.kind == "half_space", "a half-space")
    heights = scene.surface.heights
    period = scene.surface.periods[0]
    fraction = float((heights == heights.max()).mean())
    is_flat = np.unique(heights).size == 2 and fraction < 0.9
    is_square = len(set(scene.surface.periods)) == 1
    form.require(is_flat and is_square, "a flat post on a floor")
    if heights.ndim == 1:
        return fraction, fraction * period / 2
    return fraction, period * math.sqrt(fraction / math.pi)


def _row_stiffness(half_width: float, scene: Scene) -> float:
    """Return the stiffness of a row of elastic strips per nominal area in Pa/m.

    It is pi E*/(2 L ln(1/sin(pi a/L))), with the half-width a in m.

    Args:
        half_width: a of each strip, in m.
        scene: With the effective modulus E* and the period L.
    """
    E = effective_modulus(scene.material)
    period = scene.surface.periods[0]
    log_sine = math.log(math.sin(math.pi * half_width / period))
    return -math.pi * E / (2 * period * log_sine)


def _post_stiffness(scene: Scene) -> float:
    """Return the stiffness of elastic strips or discs per nominal area in Pa/m.

    The stiffness of discs is 1/(L^2/(2 a E*) + L/(pi E*) [-3.9003 + (S_3/3)(a/L)^2 +
    ...]), with the radius a and the period L.  The images act on the disc and are discs
    themselves, each with <r^2> = 2 a^2/3 under its pressure.  The first omitted term,
    3.2 (a/L)^6 in the brackets, is 3e-4 of the sum at a/L = 1/4 and 2e-2 at .4.

    Raises:
        InvalidCase: The scene is no elastic half-space with a flat post, or a disc's
            radius is above a quarter of the period.
    """
    _, a = _post(scene, FLAT_PUNCH)
    E = FLAT_PUNCH.elastic_half_space(scene)
    if scene.surface.heights.ndim == 1:
        return _row_stiffness(a, scene)
    period = scene.surface.periods[0]
    b = a / period
    FLAT_PUNCH.require(b <= 0.25, "discs of at most a quarter of the period in radius")
    images = -MADELUNG + LATTICE_SUM_3 / 3 * b**2 + 2 / 5 * LATTICE_SUM_5 * b**4
    images -= 2 / (45 * math.pi) * LATTICE_SUM_3**2 * b**5
    return E / (period**2 / (2 * a) + period / math.pi * images)


@FLAT_PUNCH.gives("area.total")
def _punch_fraction(scene: Scene) -> float:
    """Return the area of the scene's flat post as a fraction of the nominal area.

    Raises InvalidCase if the scene has no flat post on a half-space.
    """
    fraction, _ = _post(scene, FLAT_PUNCH)
    return fraction


@FLAT_PUNCH.gives("quantity.elastic_energy")
def _punch_energy(scene: Scene) -> float:
    """Return the elastic energy of a flat post in J per m^2 of nominal area.

    It is half of load times approach.  Raises InvalidCase if the scene has no flat post
    on an elastic half-space.
    """
    return scene.load.final**2 / (2 * _post_stiffness(scene))


@FLAT_PUNCH.gives("quantity.conductance")
def _punch_conductance(scene: Scene) -> float:
    """Return the conductance of a flat post, in 1/m.

    It is the conductance per nominal area times the sum of the bodies' resistivities.
    Raises InvalidCase if the scene has no flat post on an elastic half-space.
    """
    return 2 * _post_stiffness(scene) / effective_modulus(scene.material)


@FLAT_PUNCH.gives("quantity.smallest_contact_pressure")
def _middle_pressure(scene: Scene) -> float:
    """Return the smallest pressure under a flat strip, in its middle, in Pa.

    Raises InvalidCase if the scene has no strip on a half-space.
    """
    _, a = _post(scene, FLAT_PUNCH)
    period = scene.surface.periods[0]
    FLAT_PUNCH.require(scene.surface.heights.ndim == 1, "a strip, to know its middle")
    force = scene.load.final * period
    return float(strip_pressure_periodic(np.zeros(1), force, a, period)[0])


def _elastic_half_width(scene: Scene) -> float:
    """Return the half-width e in m of the elastic middle of a strip with a hardness.

    The elastic middle ends where the pressure reaches the hardness sigma_P without a
    singularity: cos(pi a/L) = cos(pi e/L) cos(pi p0/(2 sigma_P)), with the half-width
    a, the period L and the mean pressure p0.

    Raises:
        InvalidCase: The scene is no flat strip with a finite hardness, or all of the
            strip flows.
    """
    _, a = _post(scene, CAPPED_STRIP)
    period = scene.surface.periods[0]
    is_capped = math.isfinite(scene.material.hardness)
    is_strip = scene.surface.heights.ndim == 1
    CAPPED_STRIP.require(is_capped and is_strip, "a strip of finite hardness")
    load = scene.load.final / scene.material.hardness
    cosine = math.cos(math.pi * a / period) / math.cos(math.pi * load / 2)
    CAPPED_STRIP.require(cosine < 1, "a strip that does not flow altogether")
    return period / math.pi * math.acos(cosine)


@CAPPED_STRIP.gives("area.total")
def _strip_fraction(scene: Scene) -> float:
    """Return the width of the strip with a hardness, as a fraction of the period.

    Raises InvalidCase if the scene has no flat post on a half-space.
    """
    fraction, _ = _post(scene, CAPPED_STRIP)
    return fraction


@CAPPED_STRIP.gives("area.plastic")
def _plastic_fraction(scene: Scene) -> float:
    """Return the width of the strip's two plastic rims as a fraction of the period.

    Raises InvalidCase if the scene is no strip with a hardness, or all of it flows.
    """
    _, a = _post(scene, CAPPED_STRIP)
    rim = a - _elastic_half_width(scene)
    return 2 * rim / scene.surface.periods[0]


@CAPPED_STRIP.gives("area.elastic")
def _elastic_fraction(scene: Scene) -> float:
    """Return the elastic part of the strip's contact as a fraction of the period.

    A flat post presses hardest at its rims, so it flows there and stays elastic in the
    middle.  Raises InvalidCase if the scene is no strip with a hardness.
    """
    return _strip_fraction(scene) - _plastic_fraction(scene)


@CAPPED_STRIP.gives("quantity.stiffness_loading")
def _stiffness_loading(scene: Scene) -> float:
    """Return the strip's stiffness per nominal area in Pa/m under a growing load.

    The plastic rims do not contribute.  Raises InvalidCase if the scene is no strip
    with a hardness, or all of it flows.
    """
    return _row_stiffness(_elastic_half_width(scene), scene)


@CAPPED_STRIP.gives("quantity.stiffness_unloading")
def _stiffness_unloading(scene: Scene) -> float:
    """Return the strip's stiffness per nominal area in Pa/m under a falling load.

    All of the strip is elastic then.  Raises InvalidCase if the scene has no flat post
    on a half-space.
    """
    _, a = _post(scene, CAPPED_STRIP)
    return _row_stiffness(a, scene)


@CAPPED_STRIP.gives("quantity.conductance")
def _strip_conductance(scene: Scene) -> float:
    """Return the conductance of the strip with a hardness, in 1/m.

    It is the conductance per nominal area times the sum of the bodies' resistivities;
    the plastic rims conduct, too.  Raises InvalidCase if the scene has no flat post on
    a half-space.
    """
    return 2 * _stiffness_unloading(scene) / effective_modulus(scene.material)


@PRANDTL.gives("quantity.limit_pressure")
def _strip_limit(scene: Scene) -> float:
    """Return the largest mean pressure in Pa that a strip on a half-space carries.

    Neighbouring strips do not change it, if their slip lines, three half-widths from
    the middle of each, do not meet.  Raises InvalidCase if the scene has no flat strip
    on a half-space.
    """
    _post(scene, PRANDTL)  # raises InvalidCase without a post
    PRANDTL.require(scene.surface.heights.ndim == 1, "a strip")
    return (2 + math.pi) / math.sqrt(3) * scene.material.yield_stress
