"""One bump or post a period: Hertz with its images, flat punches, elastic and capped."""

from __future__ import annotations

import math

import numpy as np

from epcontact.reference import hertz, punch
from epcontact.reference.form import ClosedForm, areas, elastic_half_space, refuse_unless
from epcontact.results import FloatArray
from epcontact.scene import Scene

# --- Hertz ---------------------------------------------------------------------------------------


def _bump(scene: Scene) -> tuple[float, FloatArray, float, float]:
    """Radius (m), distance of each grid point from the summit (m), load (N or N/m), E*."""
    E = elastic_half_space(scene, "hertz")
    surface = scene.surface
    curvatures, squares = [], np.zeros(())
    for axis, d in enumerate(surface.spacing):
        centre, curvature = _parabola(scene, axis)
        curvatures.append(curvature)
        x = np.arange(surface.shape[axis]) * d - centre
        x -= np.rint(x / surface.periods[axis]) * surface.periods[axis]
        squares = squares + (x**2).reshape(
            [-1 if a == axis else 1 for a in range(len(surface.shape))]
        )
    radius = 1 / curvatures[0]
    round_bump = np.allclose(curvatures, curvatures[0], rtol=1e-6) and radius > 0
    square = len(set(surface.periods)) == 1
    refuse_unless(bool(round_bump) and square, "hertz", "one round bump in a square period")
    force = scene.load.final * math.prod(surface.periods)
    return radius, np.sqrt(squares), force, E


def _parabola(scene: Scene, axis: int) -> tuple[float, float]:
    """Summit (m) and curvature (1/m) of the parabola through the highest point and its
    neighbours along an axis: exact for a parabola."""
    heights, d = scene.surface.heights, scene.surface.spacing[axis]
    summit = np.unravel_index(int(np.argmax(heights)), heights.shape)
    line = np.moveaxis(heights, axis, -1)[tuple(j for a, j in enumerate(summit) if a != axis)]
    i = int(summit[axis])
    before, top, after = line[i - 1], line[i], line[(i + 1) % line.size]
    second = (after - 2 * top + before) / d**2
    first = (after - before) / (2 * d)
    return i * d - first / second, -second


def _size(scene: Scene) -> float:
    """Contact radius or half-width, m."""
    radius, _, force, E = _bump(scene)
    period = scene.surface.periods[0]
    if scene.surface.heights.ndim == 1:
        return hertz.cylinder_half_width_periodic(force, radius, E, period)
    return hertz.sphere_contact_radius_periodic(force, radius, E, period)


def _bump_fraction(scene: Scene) -> float:
    a, period = _size(scene), scene.surface.periods[0]
    return 2 * a / period if scene.surface.heights.ndim == 1 else math.pi * a**2 / period**2


def _bump_pressure(scene: Scene) -> FloatArray:
    """On the grid.  On a surface the semi-ellipse that carries the load on the area of the
    periodic problem: the images bend it by less than (a/L)^5."""
    radius, distance, force, E = _bump(scene)
    a, period = _size(scene), scene.surface.periods[0]
    if scene.surface.heights.ndim == 1:
        return hertz.cylinder_pressure_periodic(distance, a, radius, E, period)
    peak = 3 * force / (2 * math.pi * a**2)
    return np.asarray(peak * np.sqrt(np.maximum(1 - (distance / a) ** 2, 0)))


def _bump_peak(scene: Scene) -> float:
    radius, _, force, E = _bump(scene)
    a, period = _size(scene), scene.surface.periods[0]
    if scene.surface.heights.ndim == 1:
        return float(hertz.cylinder_pressure_periodic(np.zeros(1), a, radius, E, period)[0])
    return 3 * force / (2 * math.pi * a**2)


# --- flat punches --------------------------------------------------------------------------------


def _post(scene: Scene, name: str) -> float:
    """Half-width or radius of the post in m.

    On a line the post ends half a cell beyond its outermost points; on a surface the points of
    a disc count its area, up to the noise of counting.
    """
    refuse_unless(scene.body.kind == "half_space", name, "a half-space")
    heights = scene.surface.heights
    top = heights == heights.max()
    flat = np.unique(heights).size == 2 and float(top.mean()) < 0.9
    refuse_unless(flat and len(set(scene.surface.periods)) == 1, name, "a flat post on a floor")
    share, period = float(top.mean()), scene.surface.periods[0]
    return share * period / 2 if heights.ndim == 1 else period * math.sqrt(share / math.pi)


def _post_fraction(scene: Scene) -> float:
    _post(scene, "flat_punch")
    return float((scene.surface.heights == scene.surface.heights.max()).mean())


def _post_energy(scene: Scene) -> float:
    """Elastic energy per nominal area: half of the load times the sinking u of the punch.

    Strip: the potential of a row of strips, u = -(2 p0 L/(pi E*)) ln sin(pi a/L).
    Disc: F/(2 a E*) + F/(pi E* L) [-3.9003 + (S_3/3)(a/L)^2]: the images act on the disc and
    are discs themselves, each with <r^2> = 2 a^2/3 under the punch's pressure.
    """
    a, E = _post(scene, "flat_punch"), elastic_half_space(scene, "flat_punch")
    p0, period = scene.load.final, scene.surface.periods[0]
    if scene.surface.heights.ndim == 1:
        sinking = -2 * p0 * period / (math.pi * E) * math.log(math.sin(math.pi * a / period))
        return p0 * sinking / 2
    images = -hertz.MADELUNG + hertz.LATTICE_SUM_3 / 3 * (a / period) ** 2
    force = p0 * period**2
    sinking = force / (2 * a * E) + force / (math.pi * E * period) * images
    return p0 * sinking / 2


def _middle_pressure(scene: Scene) -> float:
    """The smallest pressure under a strip, in its middle."""
    a = _post(scene, "flat_punch")
    period = scene.surface.periods[0]
    refuse_unless(scene.surface.heights.ndim == 1, "flat_punch", "a strip, to know its middle")
    force = scene.load.final * period
    return float(punch.strip_pressure_periodic(np.zeros(1), force, a, period)[0])


def _yielded_rim(scene: Scene) -> float:
    """Plastic share of a capped strip: a row of cracks with Dugdale's zones, turned round.

    The elastic middle |x| < e ends where no singularity is left,
    cos(pi a/L) = cos(pi e/L) cos(pi p0/(2 sigma_P)).
    """
    name = "capped_strip"
    a, period = _post(scene, name), scene.surface.periods[0]
    capped = math.isfinite(scene.material.hardness) and scene.surface.heights.ndim == 1
    refuse_unless(capped, name, "a strip of finite hardness")
    share = scene.load.final / scene.material.hardness
    cosine = math.cos(math.pi * a / period) / math.cos(math.pi * share / 2)
    refuse_unless(cosine < 1, name, "a strip that does not flow altogether")
    return 2 * (a - period / math.pi * math.acos(cosine)) / period


# --- the bearing area ----------------------------------------------------------------------------


def _bearing_fraction(scene: Scene) -> float:
    """A = p0/sigma_P: the limit in which elasticity carries nothing."""
    refuse_unless(math.isfinite(scene.material.hardness), "bearing_area", "a finite hardness")
    return scene.load.final / scene.material.hardness


def _bearing_gap(scene: Scene) -> float:
    """Mean of what lies below the flat that cuts off the highest p0/sigma_P of the heights."""
    ordered = np.sort(scene.surface.heights, axis=None)[::-1]
    contact = _bearing_fraction(scene) * ordered.size
    flat = float(ordered[min(int(contact), ordered.size - 1)])
    return float(np.mean(np.maximum(flat - ordered, 0)))


FORMS = (
    ClosedForm(
        "hertz",
        "Johnson, Contact Mechanics (1985), with the curvature of the periodic images",
        areas(_bump_fraction) | {"quantity.largest_pressure": _bump_peak},
        {"pressure": _bump_pressure},
    ),
    ClosedForm(
        "flat_punch",
        "Johnson, Contact Mechanics (1985), sections 2.8 and 3.4; Westergaard 1939 for the row",
        areas(_post_fraction)
        | {
            "quantity.elastic_energy": _post_energy,
            "quantity.smallest_contact_pressure": _middle_pressure,
        },
    ),
    ClosedForm(
        "capped_strip",
        "Dugdale, J. Mech. Phys. Solids 8 (1960) 100, for a row of cracks (Smith 1965)",
        areas(_post_fraction, _yielded_rim),
    ),
    ClosedForm(
        "bearing_area",
        "the highest p0/sigma_P of the surface, flattened without springing back",
        areas(_bearing_fraction, _bearing_fraction) | {"quantity.mean_gap": _bearing_gap},
    ),
)
