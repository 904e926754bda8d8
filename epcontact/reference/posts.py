"""One flat post a period, pressed without friction: formulas, and the closed forms for
gates.

Symbols: F = force (N), P' = force per length (N/m), a = radius or half-width (m), E* =
effective_modulus (Pa), L = period (m), p0 = mean pressure (Pa), sigma_P = hardness
(Pa).

Sources: Johnson, Contact Mechanics (1985), sections 2.8 and 3.4.  The periodic strip is
Westergaard's stress function for a row of cracks (1939); the capped strip is the
counterpart of a row of cracks with Dugdale's zones (Smith 1965).
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
    "Johnson, Contact Mechanics (1985), sections 2.8 and 3.4; Westergaard 1939 for the row",
)
CAPPED_STRIP = ClosedForm(
    "capped_strip",
    "Dugdale, J. Mech. Phys. Solids 8 (1960) 100, for a row of cracks (Smith 1965)",
)


def strip_pressure_periodic(
    distance: FloatArray, force_per_length: float, half_width: float, period: float
) -> FloatArray:
    """p = (P'/L) cos(t) (sin^2 t_a - sin^2 t)^(-1/2) in Pa, t = pi x/L; infinite at the
    rim.
    """
    angle = np.pi * np.asarray(distance) / period
    depth = math.sin(math.pi * half_width / period) ** 2 - np.sin(angle) ** 2
    with np.errstate(divide="ignore"):
        inside = np.cos(angle) / np.sqrt(np.maximum(depth, 0))
    return np.asarray(np.where(depth >= 0, force_per_length / period * inside, 0.0))


def _post(scene: Scene, form: ClosedForm) -> tuple[float, float]:
    """Share of the post's points, and the half-width of a strip or radius of a disc (m)
    of it.
    """
    form.needs(scene.body.kind == "half_space", "a half-space")
    heights, period = scene.surface.heights, scene.surface.periods[0]
    share = float((heights == heights.max()).mean())
    flat = np.unique(heights).size == 2 and share < 0.9
    form.needs(flat and len(set(scene.surface.periods)) == 1, "a flat post on a floor")
    return share, share * period / 2 if heights.ndim == 1 else period * math.sqrt(
        share / math.pi
    )


FLAT_PUNCH.gives("area.total")(lambda scene: _post(scene, FLAT_PUNCH)[0])


def _stiffness(half_width: float, scene: Scene) -> float:
    """Of a row of elastic strips, pi E*/(2 L ln(1/sin(pi a/L))), in Pa/m."""
    E, period = effective_modulus(scene.material), scene.surface.periods[0]
    return (
        -math.pi * E / (2 * period * math.log(math.sin(math.pi * half_width / period)))
    )


def _post_stiffness(scene: Scene) -> float:
    """Of the row of strips; of discs 1/(L^2/(2 a E*) + L/(pi E*) [-3.9003 +
    (S_3/3)(a/L)^2]), whose images act on the disc and are discs themselves, each with
    <r^2> = 2 a^2/3 under its pressure; what follows, 3.2 (a/L)^6 in the brackets, is
    3e-4 of the whole at a/L = 1/4 and 2e-2 at .4.
    """
    (_, a), E = _post(scene, FLAT_PUNCH), FLAT_PUNCH.elastic_half_space(scene)
    if scene.surface.heights.ndim == 1:
        return _stiffness(a, scene)
    b = a / (period := scene.surface.periods[0])
    FLAT_PUNCH.needs(b <= 0.25, "discs of at most a quarter of the period in radius")
    images = -MADELUNG + LATTICE_SUM_3 / 3 * b**2 + 2 / 5 * LATTICE_SUM_5 * b**4
    images -= 2 / (45 * math.pi) * LATTICE_SUM_3**2 * b**5
    return E / (period**2 / (2 * a) + period / math.pi * images)


# Half of the load times the sinking of the punch, per nominal area.
FLAT_PUNCH.gives("quantity.elastic_energy")(
    lambda scene: scene.load.final**2 / (2 * _post_stiffness(scene))
)
# Times the sum of the resistivities, in 1/m.
FLAT_PUNCH.gives("quantity.conductance")(
    lambda scene: 2 * _post_stiffness(scene) / effective_modulus(scene.material)
)


@FLAT_PUNCH.gives("quantity.smallest_contact_pressure")
def _middle_pressure(scene: Scene) -> float:
    """The smallest pressure under a strip, which is in its middle."""
    _, a = _post(scene, FLAT_PUNCH)
    period = scene.surface.periods[0]
    FLAT_PUNCH.needs(scene.surface.heights.ndim == 1, "a strip, to know its middle")
    force = scene.load.final * period
    return float(strip_pressure_periodic(np.zeros(1), force, a, period)[0])


def _elastic_middle(scene: Scene) -> float:
    """Half-width e of the elastic middle of a capped strip in m, which ends where no
    singularity is left: cos(pi a/L) = cos(pi e/L) cos(pi p0/(2 sigma_P)).
    """
    (_, a), period = _post(scene, CAPPED_STRIP), scene.surface.periods[0]
    capped = math.isfinite(scene.material.hardness) and scene.surface.heights.ndim == 1
    CAPPED_STRIP.needs(capped, "a strip of finite hardness")
    share = scene.load.final / scene.material.hardness
    cosine = math.cos(math.pi * a / period) / math.cos(math.pi * share / 2)
    CAPPED_STRIP.needs(cosine < 1, "a strip that does not flow altogether")
    return period / math.pi * math.acos(cosine)


@CAPPED_STRIP.gives("area.plastic")
def _yielded_rim(scene: Scene) -> float:
    rim = _post(scene, CAPPED_STRIP)[1] - _elastic_middle(scene)
    return 2 * rim / scene.surface.periods[0]


CAPPED_STRIP.gives("area.total")(lambda scene: _post(scene, CAPPED_STRIP)[0])
CAPPED_STRIP.gives("area.elastic")(
    lambda scene: _post(scene, CAPPED_STRIP)[0] - _yielded_rim(scene)
)


# The yielded rim carries no more of a growing load; all of the strip is elastic as soon
# as the load falls, and all of it conducts at any load.
CAPPED_STRIP.gives("quantity.conductance")(
    lambda scene: (
        2
        * _stiffness(_post(scene, CAPPED_STRIP)[1], scene)
        / effective_modulus(scene.material)
    )
)
CAPPED_STRIP.gives("quantity.stiffness_unloading")(
    lambda scene: _stiffness(_post(scene, CAPPED_STRIP)[1], scene)
)
CAPPED_STRIP.gives("quantity.stiffness_loading")(
    lambda scene: _stiffness(_elastic_middle(scene), scene)
)
