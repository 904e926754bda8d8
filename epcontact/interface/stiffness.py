"""The stiffness and the conductance of a contact under its last load.

Stiffness.  As long as no point changes its state, a small change of the load is carried
by the set F of elastic contact points, on which the gap stays zero:

    S dp + dz = 0 on F,   dp = 0 elsewhere,   k = d(mean p)/d(-z),

where z is the separation of the flat from the mean plane of the surface.  So k = 1/u,
with the sinking u of a flat punch on F under the mean pressure 1 (`punch`).  On the
*loading* branch F is the elastic contact, because points at the hardness carry no
further pressure.  On the *unloading* branch all of the contact is elastic, so the
interface is stiffer.

Conductance.  By the analogy of Barber (Proc. R. Soc. Lond. A 459, 53 (2003)), the
current through the contact of two half-spaces follows the same equations as the
pressure of an elastic flat punch on the points in contact, elastic and plastic:

    conductance per nominal area = 2 k/(E* rho),

where k is the stiffness of the unloading branch, and rho the sum of the resistivities
of the two bodies (electrical in ohm m, thermal in m K/W).  A conductance belongs to the
contact as it is, so it has one value, whereas the stiffness has two.  For one circle of
radius a, k times the nominal area is 2 a E*, and the resistance is rho/(4 a) (Holm).
"""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.interface.limit import Limit
from epcontact.interface.punch import Mask
from epcontact.interface.rim import measure_punch, stiffness_limit
from epcontact.materials.moduli import effective_modulus
from epcontact.results import APART, ELASTIC, ContactResult
from epcontact.scene import Scene

#: "loading" if the load grows next, "unloading" if it falls next.
Branch = Literal["loading", "unloading"]


def interface_stiffness(
    scene: Scene, result: ContactResult, branch: Branch, threads: int = 1
) -> Limit:
    """Return the stiffness of the interface at the last load, per nominal area.

    Args:
        scene: the scene that was solved.
        result: its solution with the field `state`, and with corrected areas.
        branch: "loading" if the load grows next, "unloading" if it falls next.
        threads: the number of threads; the result is the same with any.

    Returns:
        d(mean pressure)/d(approach of the mean planes) in Pa/m, without the uniform
        compression of a layer.  It is 0 if no point can carry a change, and infinite in
        full contact.

    Raises:
        InvalidCase: the result has no field `state`, or the branch is unknown.
        NotConverged: the linear solve did not converge.

    Example:
        Flat strips over half of each period L approach by (2 p L/(pi E*))
        ln(1/sin(pi/4)).

        >>> from epcontact import Load, Material, Surface, bem
        >>> heights = np.where(np.arange(1024) < 512, 0.0, -1.0)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0), Load(0.01))
        >>> k = interface_stiffness(scene, bem.solve(scene), "loading")
        >>> exact = math.pi / 2 / math.log(1 / math.sin(math.pi / 4))
        >>> print(f"{k.raw / exact - 1:.0e} {k.corrected / exact - 1:.0e}")
        -2e-03 3e-06
    """
    mask = carrying_points(result, branch)
    if not mask.any():
        return Limit(0.0, 0.0, 0.0)
    if mask.all():
        return Limit(math.inf, math.inf, 0.0)
    limit = stiffness_limit(measure_punch(scene, result, mask, threads))
    return limit.times(effective_modulus(scene.material))


def contact_conductance(
    scene: Scene,
    result: ContactResult,
    resistivity: float,
    stiffness: Limit | None = None,
) -> Limit:
    """Return the conductance of the contact at the last load, per nominal area.

    Args:
        scene: the scene that was solved, of half-spaces.
        result: its solution with the field `state`, and with corrected areas.
        resistivity: sum of the resistivities of the two bodies, in ohm m for electrical
            conductance and in m K/W for thermal conductance.
        stiffness: the stiffness of the unloading branch in Pa/m, if it is known; None:
            it is solved for.

    Returns:
        In S/m^2 or W/(K m^2).  It is 0 without contact, and infinite in full contact.

    Raises:
        InvalidCase: the body is a layer, the resistivity is not positive, or the result
            has no field `state`.
        NotConverged: the linear solve did not converge.

    Example:
        Heat flows from steel to steel.

        >>> from epcontact import Load, Material, Surface, bem
        >>> heights = np.where(np.arange(1024) < 512, 0.0, -1.0)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0), Load(0.01))
        >>> limit = contact_conductance(scene, bem.solve(scene), resistivity=2 / 50)
        >>> print(f"{limit.corrected:.1f} +- {limit.error:.1f}, raw {limit.raw:.1f}")
        226.6 +- 0.9, raw 226.2
    """
    if scene.body.kind != "half_space":
        raise InvalidCase(
            "Barber's analogy gives the conductance of half-spaces, not of a layer"
        )
    if not 0 < resistivity < math.inf:
        raise InvalidCase(
            f"resistivity is {resistivity!r}, but must be a positive number"
        )
    if stiffness is None:
        stiffness = interface_stiffness(scene, result, "unloading")
    return stiffness.times(2 / (effective_modulus(scene.material) * resistivity))


def carrying_points(result: ContactResult, branch: Branch) -> Mask:
    """Return the mask of the contact points that carry a small change of the load.

    On loading these are the elastic contact points, because plastic points carry no
    further pressure.  On unloading they are all contact points.

    Args:
        result: a result with the field `state`.
        branch: "loading" if the load grows next, "unloading" if it falls next.

    Returns:
        An array of the shape of the grid, True at these points.

    Raises:
        InvalidCase: the result has no field `state`, or the branch is unknown.
    """
    state = result.fields.get("state")
    if state is None:
        raise InvalidCase(
            f"{result.method} gives no field 'state' to find the contact by"
        )
    if branch not in get_args(Branch):
        raise InvalidCase(f"branch is {branch!r}, but must be loading or unloading")
    carries = state == ELASTIC if branch == "loading" else state != APART
    return np.asarray(carries)
