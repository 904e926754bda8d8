"""The interface under load: its stiffness, its conductance, and the patches of contact and of gap.

Stiffness.  While no point changes its state, a change of the load is carried by the contact that
is not flowing, on which the gap stays zero:

    S dp + dz = 0 on F,   dp = 0 elsewhere,   k = d(mean p)/d(-z),

z being the separation of the flat from the mean of the surface.  On the *loading* branch F is the
elastic contact, because the points at the hardness carry no more; on the *unloading* branch all of
the contact is elastic, so the interface is stiffer.

Conductance.  By the analogy of Barber (Proc. R. Soc. Lond. A 459, 53 (2003)), the current through
the contact of two half-spaces follows the same equations as the pressure of an elastic flat punch
on the points in contact, whether they flow or not:

    conductance per nominal area = 2 k/(E* rho),   k of all of the contact (the unloading branch),

rho being the sum of the resistivities of the two bodies (electrical in ohm m, thermal in m K/W).
A conductance is that of the contact as it is, so it has one branch where the stiffness has two.
For one circle of radius a, k times the area is 2 a E*, and the resistance is rho/(4 a) (Holm).
"""

from __future__ import annotations

import bisect
import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidCase, NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.layers import compliance
from epcontact.results import APART, ELASTIC, ContactResult, FloatArray
from epcontact.scene import Scene

Branch = Literal["loading", "unloading"]
Mask = NDArray[np.bool_]

_REDUCTION = 1e-12  # of the residual of the linear solve


def carrying(result: ContactResult, branch: Branch) -> Mask:
    """Return the mask of the points that carry a change of the load, or raise InvalidCase."""
    if (state := result.fields.get("state")) is None:
        raise InvalidCase(f"{result.method} gives no field 'state' to find the contact by")
    if branch not in ("loading", "unloading"):
        raise InvalidCase(f"branch is {branch!r}, but must be loading or unloading")
    return np.asarray(state == ELASTIC if branch == "loading" else state != APART)


def interface_stiffness(scene: Scene, result: ContactResult, branch: Branch) -> float:
    """Return the stiffness of the interface at the last load, per nominal area.

    Args:
        scene, result: the scene and the answer to it, with the field state.
        branch: "loading" if the load grows next, "unloading" if it falls.

    Returns:
        d(mean pressure)/d(approach of the mean planes) in Pa/m.  The uniform compression of a layer
        is not part of it.  Zero if nothing can carry more; infinite in full contact.

    Raises:
        InvalidCase, NotConverged: no states, an unknown branch, or a linear solve that stalls.

    Example:
        Flat strips over half of each period L approach by (2 p L/(pi E*)) ln(1/sin(pi/4)).

        >>> from epcontact import Load, Material, Surface, bem
        >>> heights = np.where(np.arange(1024) < 512, 0.0, -1.0)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0), Load(0.01))
        >>> k = interface_stiffness(scene, bem.solve(scene), "loading")
        >>> round(k * 2 / math.pi * math.log(1 / math.sin(math.pi / 4)), 2)
        1.0
    """
    from scipy.sparse.linalg import LinearOperator, cg  # slow to load, and few cases measure it

    mask = carrying(result, branch)
    n = int(mask.sum())
    if n in (0, mask.size):
        return math.inf if n else 0.0
    C = compliance(scene)
    C.flat[0] = 0.0
    inverse = np.divide(1.0, C, out=np.zeros_like(C), where=C > 0)

    def displaced(modes: FloatArray, forces: FloatArray) -> FloatArray:
        """Apply the symbol `modes` to forces on F, and return what it gives on F."""
        field = np.zeros(mask.shape)
        field[mask] = forces
        answer = np.fft.irfftn(modes * np.fft.rfftn(field), mask.shape, axes=range(mask.ndim))
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
    x, failed = cg(S, right, rtol=_REDUCTION, atol=0.0, maxiter=2000, M=M)
    if failed:
        raise NotConverged("the stiffness of the interface did not converge in 2000 iterations")
    return 1 / float(displaced(C, uniform + (x - x.mean())).mean())


def contact_conductance(scene: Scene, result: ContactResult, resistivity: float) -> float:
    """Return the conductance of the contact at the last load per nominal area (Barber's analogy).

    Args:
        scene, result: a scene of half-spaces and the answer to it, with the field state.
        resistivity: sum of the resistivities of the two bodies, in ohm m or, of heat, in m K/W.

    Returns:
        In S/m^2 or W/(K m^2).  Zero without contact; infinite in full contact.

    Raises:
        InvalidCase, NotConverged: as the stiffness, or a layer, or a resistivity of 0 or less.

    Example:
        >>> from epcontact import Load, Material, Surface, bem
        >>> heights = np.where(np.arange(1024) < 512, 0.0, -1.0)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.0), Load(0.01))
        >>> round(contact_conductance(scene, bem.solve(scene), 2 / 50))  # steel on steel, heat
        226
    """
    if scene.body.kind != "half_space":
        raise InvalidCase("Barber's analogy gives the conductance of half-spaces, not of a layer")
    if not 0 < resistivity < math.inf:
        raise InvalidCase(f"resistivity is {resistivity!r}, but must be a positive number")
    stiffness = interface_stiffness(scene, result, "unloading")
    return 2 * stiffness / (effective_modulus(scene.material) * resistivity)


class Patches(NamedTuple):
    """The connected patches of a mask on a periodic grid.

    Attributes:
        areas: (n,) their areas over the nominal area, the largest first.
        spans: True if a patch connects with its own periodic image: it percolates.
    """

    areas: NDArray[np.float64]
    spans: bool


def patches(mask: Mask) -> Patches:
    """Find the patches of a mask; points join over their four sides, periodically.

    Args:
        mask: (nx, ny) or (nx,).

    Example:
        >>> found = patches(np.array([True, False, True, True]))
        >>> found.areas.tolist(), found.spans
        ([0.75], False)
    """
    areas = np.sort(np.bincount(_patch_of_points(mask)))[::-1] / mask.size
    # A patch that is connected with its own image is one patch of two periods; others are two.
    doubled = (np.concatenate([mask, mask], axis) for axis in range(mask.ndim))
    spans = any(np.unique(_patch_of_points(twice)).size < 2 * areas.size for twice in doubled)
    return Patches(areas, spans)


def percolation_share(closeness: NDArray[np.floating]) -> float:
    """Return the smallest share of the nominal area, the closest points first, that percolates.

    Args:
        closeness: (nx, ny), larger where the surfaces are closer: for example minus the gap.  With
            its sign changed, the same function gives the share at which the open gap percolates.

    Example:
        >>> percolation_share(np.array([[3.0, 2.0, 1.0], [0.0, -1.0, -2.0]]))
        0.5
    """
    rank = np.empty(closeness.shape, dtype=np.intp)
    rank.flat[np.argsort(-closeness, axis=None, kind="stable")] = np.arange(closeness.size)
    fewer = range(1, closeness.size)  # than all, which percolate
    first = bisect.bisect_left(fewer, True, key=lambda n: patches(rank < n).spans)
    return (first + 1) / closeness.size


def _patch_of_points(mask: Mask) -> NDArray[np.intp]:
    """Return the number of the periodic patch of each point of the mask, from 0 on."""
    from scipy.ndimage import label
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    labels, number = label(mask)
    ends = [np.take(labels, (0, -1), axis).swapaxes(0, axis) for axis in range(mask.ndim)]
    met = np.hstack([each.reshape(2, -1) for each in ends])  # over the period
    met = met[:, met.all(axis=0)] - 1
    seams = coo_array((np.ones(met.shape[1]), tuple(met)), shape=(number, number))
    patch_of_label = connected_components(seams, directed=False)[1]
    return np.asarray(patch_of_label[labels[mask] - 1])
