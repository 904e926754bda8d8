"""The interface under load: its stiffness, its conductance, and the patches of contact
and of gap.

Stiffness.  While no point changes its state, a change of the load is carried by the
contact that is not flowing, on which the gap stays zero:

    S dp + dz = 0 on F,   dp = 0 elsewhere,   k = d(mean p)/d(-z),

z being the separation of the flat from the mean of the surface.  On the *loading*
branch F is the elastic contact, because the points at the hardness carry no more; on
the *unloading* branch all of the contact is elastic, so the interface is stiffer.

Conductance.  By the analogy of Barber (Proc. R. Soc. Lond. A 459, 53 (2003)), the
current through the contact of two half-spaces follows the same equations as the
pressure of an elastic flat punch on the points in contact, whether they flow or not:

    conductance per nominal area = 2 k/(E* rho),   k of all of the contact (the unloading branch),

rho being the sum of the resistivities of the two bodies (electrical in ohm m, thermal
in m K/W). A conductance is that of the contact as it is, so it has one branch where the
stiffness has two. For one circle of radius a, k times the area is 2 a E*, and the
resistance is rho/(4 a) (Holm).

Grids.  A flat punch on the points in contact is a little too wide or too narrow.  By
Griffith's relation the sinking u = 1/k of a punch whose rim moves out by e falls by the
integral of e K^2/E* along the rim, over the nominal area.  On the grid K^2 is `sharp` h
p^2, h being the spacing across the rim, p the pressure of its last points for a mean
pressure of 1; each link of such a point to one beside the punch stands for a stretch of
rim.  So

    u_limit = u - sharp (offset + d) release/E*,    release = sum over links p^2 h/(points in all),

where d is how much less than half a spacing the rim of the discrete punch is beyond its
last points, and `offset` how far the true rim is from half a spacing beyond them: by
the correction of the area, on average over the links.  For a straight rim along the
grid sharp = 2 e/pi and d is the exact offset of lines; for rims of all directions both
are measured (`laboratory.interface`), and the anisotropy of the release leads from one
to the other.  Where the contact presses as a punch does, its rim is a step of the
surface, and not a front that has found its points: d of such a staircase is larger by
STEP, and less certain.  If the load grows and some points flow, the elastic contact is
bounded by smooth fronts, whose offset is that of the punch itself.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.interface.limit import Limit
from epcontact.interface.punch import Mask, solve_punch
from epcontact.interface.rim import Rim, limit_of
from epcontact.materials.moduli import effective_modulus
from epcontact.results import APART, ELASTIC, PLASTIC, ContactResult
from epcontact.scene import Scene

Branch = Literal["loading", "unloading"]


def carrying(result: ContactResult, branch: Branch) -> Mask:
    """Return the mask of the points that carry a change of the load, or raise
    InvalidCase.
    """
    if (state := result.fields.get("state")) is None:
        raise InvalidCase(
            f"{result.method} gives no field 'state' to find the contact by"
        )
    if branch not in ("loading", "unloading"):
        raise InvalidCase(f"branch is {branch!r}, but must be loading or unloading")
    return np.asarray(state == ELASTIC if branch == "loading" else state != APART)


def interface_stiffness(scene: Scene, result: ContactResult, branch: Branch) -> Limit:
    """Return the stiffness of the interface at the last load, per nominal area.

    Args:
        scene, result: the scene and the answer to it, with the field state and
        corrected areas. branch: "loading" if the load grows next, "unloading" if it
        falls.

    Returns:
        d(mean pressure)/d(approach of the mean planes) in Pa/m.  The uniform
        compression of a layer is not part of it.  Zero if nothing can carry more;
        infinite in full contact.

    Raises:
        InvalidCase, NotConverged: no states, an unknown branch, or a linear solve that
            stalls.

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
    mask = carrying(result, branch)
    if mask.all() or not mask.any():
        value = math.inf if mask.all() else 0.0
        return Limit(value, value, 0.0)
    stiffness = limit_of(*sinking_and_rim(scene, result, branch))
    modulus = effective_modulus(scene.material)
    return Limit(*(modulus * value for value in stiffness))


def sinking_and_rim(
    scene: Scene, result: ContactResult, branch: Branch
) -> tuple[float, Rim]:
    """Return E* u in m of a flat punch on the points that carry, and the rim of these
    points.
    """
    mask = carrying(result, branch)
    sinking, pressure, _ = solve_punch(scene, mask)
    # Over the mean pressure, as the punch's are.
    pressed = result.fields.get("pressure", 0 * pressure) / result.final.mean_pressure
    terms, press = [], 0.0
    for axis, h in enumerate(scene.surface.spacing):
        beside = [mask & ~np.roll(mask, step, axis) for step in (1, -1)]
        terms.append(
            np.concatenate([pressure[last] ** 2 * h / mask.size for last in beside])
        )
        press += sum(
            float(pressed[last] @ pressure[last]) * h / mask.size for last in beside
        )
    # The stretch of rim across links of each axis carries so much of K^2; on a line
    # there is one.
    shares = [
        each.sum() / h for each, h in zip(terms, scene.surface.spacing, strict=True)
    ]
    straight = (shares[0] - sum(shares[1:])) / sum(shares)
    every = np.concatenate(terms)
    flows = branch == "loading" and bool((result.fields["state"] == PLASTIC).any())
    areas, part = result.final.areas, "elastic" if flows else "total"
    raw, corrected = (getattr(areas[kind], part) for kind in ("raw", "corrected"))
    doubt = getattr(areas["error"], part) if "error" in areas else abs(corrected - raw)
    offset, doubt = (
        share * mask.size / every.size for share in (corrected - raw, doubt)
    )
    release, scatter = float(every.sum()), float(np.linalg.norm(every))
    stepped = (
        0.0 if (result.fields["state"] == PLASTIC).any() else 4 * press / release - 3
    )
    stepped = min(max(stepped, 0.0), 1.0)
    rim = Rim(release, scatter, float(straight) ** 2, offset, doubt, stepped, flows)
    return sinking * effective_modulus(scene.material), rim


def contact_conductance(
    scene: Scene,
    result: ContactResult,
    resistivity: float,
    stiffness: Limit | None = None,
) -> Limit:
    """Return the conductance of the contact at the last load per nominal area (Barber's
    analogy).

    Args:
        scene, result: a scene of half-spaces and the answer to it, as for the
        stiffness. resistivity: sum of the resistivities of the two bodies, in ohm m or,
        of heat, in m K/W. stiffness: that of the unloading branch if it is known, in
        Pa/m; else it is solved for.

    Returns:
        In S/m^2 or W/(K m^2).  Zero without contact; infinite in full contact.

    Raises:
        InvalidCase, NotConverged: as the stiffness, or a layer, or a resistivity of 0
            or less.

    Example:
        >>> from epcontact import Load, Material, Surface, bem
        >>> heights = np.where(np.arange(1024) < 512, 0.0, -1.0)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0), Load(0.01))
        >>> found = contact_conductance(scene, bem.solve(scene), 2 / 50)  # steel on steel, heat
        >>> print(f"{found.corrected:.1f} +- {found.error:.1f}, raw {found.raw:.1f}")
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
    stiffness = stiffness or interface_stiffness(scene, result, "unloading")
    scale = 2 / (effective_modulus(scene.material) * resistivity)
    return Limit(*(scale * value for value in stiffness))
