"""From the grid to the limit of a vanishing spacing, by the rim of the contact.

A flat punch on the grid's points in contact is a little too wide or too narrow.  By
Griffith's relation the sinking u of a punch under the mean pressure 1 falls, if its rim
moves out by e, by the integral of e K^2/E* along the rim over the nominal area; K is
the intensity of the pressure's singularity at the rim.  On the grid K^2 is `intensity`
h p^2, where p is the pressure of a last point before the rim and h the spacing across
the rim.  A link joins such a point to a neighbour off the punch, and each link stands
for a stretch of the rim.  So

    u_limit = u - intensity (offset + setback) release/E*,
    release = sum over the links of p^2 h/(points of the grid),

with two distances in spacings:

    offset   how far the true rim is beyond half a spacing from the last points, on
             average over the links; the correction of the area gives it
    setback  how much less than half a spacing the rim of the punch on the grid is
             beyond its last points

For a straight rim along the grid, intensity = 2 e/pi and the setback is the exact
offset of lines.  For rims of all directions both are measured (`laboratory.interface`).
The anisotropy of the release interpolates between the two.

Where the contact presses as a flat punch does, its rim is a step of the surface, and
not a front that depends on the load.  The setback of such a staircase of points is
larger by STEP_SETBACK, and less certain.  If the load grows and some points are
plastic, the elastic contact ends at smooth fronts, and only its straight parts are
corrected.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.interface.limit import Limit
from epcontact.interface.punch import Mask, solve_punch
from epcontact.materials.moduli import effective_modulus
from epcontact.results import PLASTIC, ContactResult
from epcontact.scene import Scene


class Constants(NamedTuple):
    """Constants of rims of all directions.

    Attributes:
        intensity: K^2 over h p^2; see the module.
        setback: in spacings; see the module.
        random_error: error of the position of each link, in spacings; independent from
            link to link.
        area_factor: error of the position of all links together, over the error that
            follows from that of the corrected area.
        systematic_error: error of the setback of all links alike, in spacings, where
            the rim is not straight.
    """

    intensity: float
    setback: float
    random_error: float
    area_factor: float
    systematic_error: float


#: Intensity of a straight rim along the grid, exact.
STRAIGHT_INTENSITY = 2 * math.e / math.pi
#: Setback of a straight rim along the grid, in spacings: that of lines, as in
#: `bem.areas.front`.
STRAIGHT_SETBACK = 0.190009
#: What a step of the surface adds to the setback, and the error of this addition, in
#: spacings.  By `python -m laboratory.interface`.
STEP_SETBACK = 0.047
STEP_ERROR = 0.068
#: Fitted by `python -m laboratory.interface`.  The systematic error is from half of the
#: scenes of `laboratory.interface waves`: of the other half, with 32 to 128 shortest
#: waves a period, all of 32 errors are within their estimates, and 25 without it.
CONSTANTS = Constants(
    intensity=0.94,
    setback=0.103,
    random_error=0.54,
    area_factor=1.75,
    systematic_error=0.015,
)
#: Constants of elastic contact beside plastic points, fitted by `python -m
#: laboratory.interface`.  Only straight rims are corrected.
SMOOTH = Constants(
    intensity=0.0,
    setback=0.103,
    random_error=0.82,
    area_factor=1.08,
    systematic_error=0.0,
)


class MeasuredPunch(NamedTuple):
    """The sinking of a flat punch on the grid, and the measures of its rim.

    Attributes:
        sinking: E* u in m under the mean pressure 1.
        release: see the module; in m.
        scatter: root of the sum of the squares of the terms of the release, in m.
        straightness: 0 for a rim of all directions, 1 for a straight one along the
            grid.
        offset: see the module; in spacings.
        offset_error: error of the offset that follows from that of the corrected area,
            in spacings.
        stepped: 1 if the contact presses on its rim as the punch does, 0 if by a
            quarter less or more than that.
        beside_plastic: True if the mask leaves out plastic points.
    """

    sinking: float
    release: float
    scatter: float
    straightness: float
    offset: float
    offset_error: float
    stepped: float
    beside_plastic: bool


def measure_punch(
    scene: Scene, result: ContactResult, mask: Mask, threads: int = 1
) -> MeasuredPunch:
    """Return how far a flat punch on a mask sinks, and measures of its boundary.

    Args:
        scene: the scene that was solved.
        result: its solution with the field `state`, and with corrected areas.
        mask: True at the points that carry; at least one, but not all.
        threads: the number of threads; the result is the same with any.

    Raises:
        NotConverged: the linear solve did not converge.
    """
    punch = solve_punch(scene, mask, threads)
    pressure = punch.pressure.reshape(-1)
    contact_pressure = np.ravel(result.fields.get("pressure", 0 * pressure))
    contact_pressure = contact_pressure / result.final.mean_pressure
    terms_by_axis = []
    rim_length_by_axis = []
    contact_release = 0.0
    for axis, spacing in enumerate(scene.surface.spacing):
        rim = _last_points(mask, axis)
        weight = spacing / mask.size
        terms = weight * pressure[rim] ** 2
        terms_by_axis.append(terms)
        # The stretch of the rim across links of this axis, weighted by K^2.
        rim_length_by_axis.append(float(terms.sum()) / spacing)
        contact_release += weight * float((contact_pressure[rim] * pressure[rim]).sum())
    terms = np.concatenate(terms_by_axis)
    release = float(terms.sum())
    total_length = sum(rim_length_by_axis)
    anisotropy = (2 * rim_length_by_axis[0] - total_length) / total_length
    plastic = result.fields["state"] == PLASTIC
    beside_plastic = bool((plastic & ~mask).any())
    correction, error = _area_correction(result, elastic=beside_plastic)
    spacings_of_area = mask.size / terms.size
    stepped = 0.0
    if not plastic.any():
        stepped = min(max(4 * contact_release / release - 3, 0.0), 1.0)
    return MeasuredPunch(
        sinking=punch.sinking * effective_modulus(scene.material),
        release=release,
        scatter=math.sqrt(float((terms**2).sum())),
        straightness=anisotropy**2,
        offset=correction * spacings_of_area,
        offset_error=error * spacings_of_area,
        stepped=stepped,
        beside_plastic=beside_plastic,
    )


def _last_points(mask: Mask, axis: int) -> NDArray[np.intp]:
    """Return the last points of a mask before its boundary, along one axis.

    A last point has a neighbour along the axis, periodically, that is off the mask.  A
    point with two such neighbours is returned twice.

    Args:
        mask: (nx, ny) or (nx,), True at the points of the contact.
        axis: 0 for neighbours along x, 1 along y.

    Returns:
        The flat indices of the points, shape (n,).
    """
    last_points = []
    for step in (1, -1):
        last = mask & ~np.roll(mask, step, axis)
        last_points.append(np.flatnonzero(last))
    return np.concatenate(last_points)


def _area_correction(result: ContactResult, elastic: bool) -> tuple[float, float]:
    """Return the correction of the contact area at the last load, and its error.

    Args:
        result: a result with raw and corrected areas.
        elastic: True for the elastic area, False for the total area.

    Returns:
        Corrected less raw area, and the error of the corrected area, both as fractions
        of the nominal area.  Without a stated error, the error is the size of the
        correction.
    """
    part = "elastic" if elastic else "total"
    areas = result.final.areas
    correction = getattr(areas["corrected"], part) - getattr(areas["raw"], part)
    if "error" in areas:
        return correction, getattr(areas["error"], part)
    return correction, abs(correction)


def stiffness_limit(punch: MeasuredPunch, constants: Constants | None = None) -> Limit:
    """Return the stiffness of a contact over E*, in the limit of a vanishing spacing.

    Args:
        punch: the flat punch on the contact points that carry a change of the load.
        constants: the constants of the boundary of a contact area in all directions;
            None: CONSTANTS, or SMOOTH beside plastic points.

    Returns:
        The stiffness over E* in 1/m: its limit, its value on the grid and its error.
    """
    if constants is None:
        constants = SMOOTH if punch.beside_plastic else CONSTANTS
    curved = 1 - punch.straightness
    intensity = constants.intensity * curved + STRAIGHT_INTENSITY * punch.straightness
    setback = constants.setback + STEP_SETBACK * punch.stepped
    setback = setback * curved + STRAIGHT_SETBACK * punch.straightness
    change = intensity * (punch.offset + setback) * punch.release / punch.sinking
    # 1/(u (1 - change)) to the first order, and positive on any grid.
    corrected = math.exp(change) / punch.sinking
    random_error = constants.random_error * punch.scatter
    systematic_error = punch.release * math.hypot(
        constants.area_factor * punch.offset_error,
        STEP_ERROR * punch.stepped,
        constants.systematic_error * curved,
    )
    error = corrected * math.hypot(random_error, systematic_error) / punch.sinking
    return Limit(corrected, 1 / punch.sinking, error)
