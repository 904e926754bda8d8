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

import bisect
import itertools
import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidCase, NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.layers import compliance
from epcontact.results import APART, ELASTIC, PLASTIC, ContactResult, FloatArray
from epcontact.scene import Scene

Branch = Literal["loading", "unloading"]
Mask = NDArray[np.bool_]

_REDUCTION = 1e-12  # of the residual of the linear solve


class Constants(NamedTuple):
    """Constants of the limit of a vanishing spacing."""

    sharp: float
    short: float  # d, in spacings
    chance: float  # claimed for the place of each link, in spacings
    area: float  # claimed for the place of all links, over the error that areas claim
    common: float  # claimed for d of all links alike, in spacings, where the rim is not straight


#: sharp and d of a straight rim along the grid; d is that of lines, `bem.areas.front`.
STRAIGHT = (2 * math.e / math.pi, 0.190009)
#: What a step of the surface adds to d, and to the claim.
STEP = (0.047, 0.068)
#: By `python -m laboratory.interface`; `common` by `laboratory.interface waves`, on
#: half of its scenes: of the others, with 32 to 128 shortest waves, 32 of 32 are
#: within, without it 25.
CONSTANTS = Constants(sharp=0.94, short=0.103, chance=0.54, area=1.75, common=0.015)
#: Of elastic contact beside points that flow, where only what is straight is moved.
SMOOTH = Constants(sharp=0.0, short=0.103, chance=0.82, area=1.08, common=0.0)


class Limit(NamedTuple):
    """A value in the limit of a vanishing grid spacing, as from the areas of a result.

    Attributes:
        corrected: the estimate of the limit.
        raw: the value of the grid's own points.
        error: the estimated absolute error of `corrected`, which covers some 94 of 100.
    """

    corrected: float
    raw: float
    error: float


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


class Rim(NamedTuple):
    """What the limit needs to know of the rim of a contact; see the module."""

    release: float  # in m
    scatter: float  # root of the sum of the squares of its terms
    straight: float  # 0 for a rim of all directions, 1 for one along the grid
    offset: float  # in spacings
    doubt: float  # its error, as areas claim it
    stepped: (
        float  # 1 if the contact presses as a punch does there, 0 if a quarter less
    )
    flows: bool  # True if points that flow bound it


def sinking_and_rim(
    scene: Scene, result: ContactResult, branch: Branch
) -> tuple[float, Rim]:
    """Return E* u in m of a flat punch on the points that carry, and the rim of these
    points.
    """
    mask = carrying(result, branch)
    sinking, pressure = _punch(scene, mask)
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


def limit_of(sinking: float, rim: Rim, constants: Constants | None = None) -> Limit:
    """Return k/E* of a punch that sinks by E* u = `sinking`, by its rim."""
    c = constants or (SMOOTH if rim.flows else CONSTANTS)
    sharp = c.sharp + (STRAIGHT[0] - c.sharp) * rim.straight
    short = c.short + STEP[0] * rim.stepped
    short += (STRAIGHT[1] - short) * rim.straight
    moved = sharp * (rim.offset + short) * rim.release / sinking
    alike = c.common * (1 - rim.straight)
    common = rim.release * math.hypot(c.area * rim.doubt, STEP[1] * rim.stepped, alike)
    limit = math.exp(moved) / sinking  # to first order, and positive on any grid
    return Limit(
        limit, 1 / sinking, limit * math.hypot(c.chance * rim.scatter, common) / sinking
    )


def _punch(scene: Scene, mask: Mask) -> tuple[float, FloatArray]:
    """Return the sinking (m/Pa) of a flat punch on the points of a mask by a mean
    pressure of 1, and its pressures.
    """
    from scipy.sparse.linalg import (
        LinearOperator,
        cg,
    )  # slow to load, and few cases measure it

    n = int(mask.sum())
    C = compliance(scene)
    C.flat[0] = 0.0
    inverse = np.divide(1.0, C, out=np.zeros_like(C), where=C > 0)

    def displaced(modes: FloatArray, forces: FloatArray) -> FloatArray:
        """Apply the symbol `modes` to forces on F, and return what it gives on F."""
        field = np.zeros(mask.shape)
        field[mask] = forces
        answer = np.fft.irfftn(
            modes * np.fft.rfftn(field), mask.shape, axes=range(mask.ndim)
        )
        return np.asarray(answer[mask])

    def of_zero_mean(modes: FloatArray) -> LinearOperator:
        def times(x: FloatArray) -> FloatArray:
            y = displaced(modes, x - x.mean())
            return np.asarray(y - y.mean())

        return LinearOperator((n, n), matvec=times, dtype=np.float64)

    uniform = np.full(n, mask.size / n)  # a unit of mean pressure
    sunk = displaced(C, uniform)
    right = sunk.mean() - sunk
    S, M = of_zero_mean(C), of_zero_mean(inverse)
    # Where a uniform pressure is the answer, what is right of it is noise.
    noise = _REDUCTION * float(np.linalg.norm(sunk))
    x, failed = cg(S, right, rtol=_REDUCTION, atol=noise, maxiter=2000, M=M)
    if failed:
        raise NotConverged(
            "the stiffness of the interface did not converge in 2000 iterations"
        )
    pressure = np.zeros(mask.shape)
    pressure[mask] = uniform + (x - x.mean())
    return float(displaced(C, pressure[mask]).mean()), pressure


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


class Patches(NamedTuple):
    """The connected patches of a mask on a periodic grid.

    Attributes:
        areas: (n,) their areas over the nominal area, the largest first.
        spans: True if a patch connects with its own periodic image: it percolates.
    """

    areas: NDArray[np.float64]
    spans: bool


def patches(mask: Mask, diagonals: bool = False) -> Patches:
    """Find the patches of a mask; points join over their four sides, periodically.

    Args:
        mask: (nx, ny) or (nx,).
        diagonals: True if points join over their corners as well.

    Example:
        >>> found = patches(np.array([True, False, True, True]))
        >>> found.areas.tolist(), found.spans
        ([0.75], False)
    """
    areas = np.sort(np.bincount(_patch_of_points(mask, diagonals)))[::-1] / mask.size
    # A patch that is connected with its own image is one patch of two periods; others
    # are two.
    doubled = (np.concatenate([mask, mask], axis) for axis in range(mask.ndim))
    spans = any(
        np.unique(_patch_of_points(twice, diagonals)).size < 2 * areas.size
        for twice in doubled
    )
    return Patches(areas, spans)


def percolation_share(closeness: NDArray[np.floating]) -> Limit:
    """Return the smallest share of the nominal area, the closest points first, that
    percolates.

    A neck of the contact between two points that touch at a corner is there or not:
    points that join over their sides only percolate too late, and over their corners
    too early.  The limit is the mean of the two, and its error half of their difference
    together with the root mean square of what the limits from every second point are
    off, which covers some 94 of 100.

    Args:
        closeness: (nx, ny), larger where the surfaces are closer: for example minus the
            gap.  With its sign changed, the same function gives the share at which the
            open gap percolates.

    Returns:
        The limit; its `raw` value is of points that join over their sides.

    Example:
        >>> percolation_share(np.array([[3.0, 2.0, 1.0], [0.0, -1.0, -2.0]])).raw
        0.5
    """
    raw, both = _share(closeness, False), _share(closeness, True)
    limit = (raw + both) / 2
    places = itertools.product(
        (slice(0, None, 2), slice(1, None, 2)), repeat=closeness.ndim
    )
    fewer = (closeness[place] for place in places)
    off = [(_share(few, False) + _share(few, True)) / 2 - limit for few in fewer]
    return Limit(
        limit, raw, math.hypot((raw - both) / 2, math.sqrt(np.mean(np.square(off))))
    )


def _share(closeness: NDArray[np.floating], diagonals: bool) -> float:
    rank = np.empty(closeness.shape, dtype=np.intp)
    rank.flat[np.argsort(-closeness, axis=None, kind="stable")] = np.arange(
        closeness.size
    )
    fewer = range(1, closeness.size)  # than all, which percolate
    first = bisect.bisect_left(
        fewer, True, key=lambda n: patches(rank < n, diagonals).spans
    )
    return (first + 1) / closeness.size


def _patch_of_points(mask: Mask, diagonals: bool = False) -> NDArray[np.intp]:
    """Return the number of the periodic patch of each point of the mask, from 0 on."""
    from scipy.ndimage import label
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    frame, middle = np.pad(mask, 1, mode="wrap"), (slice(1, -1),) * mask.ndim
    labels, number = label(frame, np.ones((3,) * mask.ndim) if diagonals else None)
    inside = labels[middle]
    frame[middle] = False  # a point of the frame is one over the period
    met = np.stack([labels[frame], np.pad(inside, 1, mode="wrap")[frame]]) - 1
    seams = coo_array((np.ones(met.shape[1]), tuple(met)), shape=(number, number))
    patch_of_label = connected_components(seams, directed=False)[1]
    return np.asarray(patch_of_label[inside[mask] - 1])
