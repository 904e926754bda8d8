"""Block Gauss-Seidel sweeps over the flowing nodes: the part the elastic preconditioner
misses.

A perfectly plastic body yields along slip lines as thin as an element.  Neither the
elastic flat block nor a coarse grid can represent them, but sweeps over the flowing
nodes can, and these are only a few in a hundred.  The two together make one symmetric
preconditioner,

    sweep up  ->  elastic block  ->  sweep down,

a multiplicative Schwarz method (Smith, Bjorstad and Gropp, Domain Decomposition, 1996,
section 1.1).  Its product with the tangent comes for free, because each part starts
from the residual that the one before has left.

The tangent's rows of the flowing nodes are 3 x 3 blocks, one for each of the at most 27
nodes that share an element with a node.  They go strip by strip across the surface,
every other strip first: threads share one half and then the other, as strips that are
apart have no element in common.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from epcontact.results import FloatArray
from fem_check.element import CORNERS
from fem_check.lanes import OPTIONS, compiled, inverse_of_symmetric
from fem_check.plasticity import TangentCorrection
from fem_check.problem import Problem
from fem_check.workers import ALONE, Workers

#: Sweeps on either side of the elastic block, an odd number.  They nearly halve the
#: iterations, and more of them save no work.
SWEEPS = 3
#: Least width of a strip, in nodes.  It must be more than one.
STRIP = 4


class FlowRows(NamedTuple):
    """The tangent's matrix rows of the flowing nodes.

    nodes: (n,) their numbers, strip by strip.  neighbours: (n, 27) numbers of the nodes in their
    rows, -1 where there is none.  places: (n, 27) the neighbours' indices in `nodes`; n where one
    does not flow.  blocks: (n, 27, 3, 3) in N/m.  strips: two arrays (s, 2), the first row of each
    strip and the one after its last.
    """

    nodes: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    places: NDArray[np.int32]
    blocks: FloatArray
    strips: tuple[NDArray[np.int64], NDArray[np.int64]]


class Smoother:
    """The sweeps of `rows`; `held` (nx, ny) are the top nodes whose normal motion is
    zero.
    """

    def __init__(
        self, rows: FlowRows, held: NDArray[np.bool_], workers: Workers = ALONE
    ) -> None:
        self.rows, self.workers = rows, workers
        self._inverses = np.empty((len(rows.nodes), 3, 3))  # of the diagonal blocks
        _invert(rows, held.ravel(), self._inverses)

    def smooth(self, residual: FloatArray, *, transposed: bool = False) -> FloatArray:
        """The displacement (n, 3) of the flowing nodes after sweeps up, down, up, or
        transposed.
        """
        x, right = np.zeros((len(self.rows.nodes), 3)), residual.reshape(-1, 3)
        for k in range(SWEEPS):
            up = (k % 2 == 0) != transposed
            sweep = partial(_sweep, self.rows, self._inverses, right, x, up)
            for strips in self.rows.strips if up else self.rows.strips[::-1]:
                self.workers.share(sweep, strips, weight=0.5)
        return x

    def add_product(self, scale: float, x: FloatArray, force: FloatArray) -> None:
        """Add `scale` times K x to the (levels, nx, ny, 3) `force`, in place."""
        multiply = partial(_multiply, self.rows, scale * x, force.reshape(-1, 3))
        for strips in self.rows.strips:
            self.workers.share(multiply, strips, weight=0.5)

    def add(self, x: FloatArray, displacement: FloatArray) -> None:
        """Add x to the flowing nodes' part of a (levels, nx, ny, 3) field, in place."""
        displacement.reshape(-1, 3)[self.rows.nodes] += x


def assemble(problem: Problem, correction: TangentCorrection, scale: float) -> FlowRows:
    """The rows of a flat block, less `scale` times the correction, without those of the
    base.
    """
    (nx, ny), bricks = problem.block.shape, problem.bricks
    flows = np.zeros(problem.block.field_shape[:3], dtype=np.bool_)
    flows.reshape(-1)[bricks.connectivity[correction.which]] = True
    flows[-1] = False
    nodes, strips = _in_strips(np.flatnonzero(flows), nx, ny)
    places = np.full(flows.size, len(nodes), dtype=np.int32)
    places[nodes] = np.arange(len(nodes))
    number = np.full(bricks.number, -1, dtype=np.int32)
    number[correction.which] = np.arange(correction.which.size)
    neighbours = np.full((len(nodes), 27), -1, dtype=np.int32)
    blocks = np.zeros((len(nodes), 27, 3, 3))
    around = flows[:-1] | flows[1:]
    around |= np.roll(around, -1, 1)
    around |= np.roll(around, -1, 2)
    which, parts = _in_strips(np.flatnonzero(around), nx, ny)
    body, flow = (bricks, *problem.stiffness), (number, correction.terms, float(scale))
    task = partial(
        _assemble, body, flow, which, places, _slots(nx, ny), neighbours, blocks
    )
    for part in parts:
        problem.workers.share(task, part, weight=8.0)
    within = np.where(neighbours < 0, len(nodes), places[neighbours]).astype(np.int32)
    return FlowRows(nodes, neighbours, within, blocks, strips)


def _in_strips(
    numbers: NDArray[np.int64], nx: int, ny: int
) -> tuple[NDArray[np.int64], tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Numbers of nodes or elements in the order of strips, and the strips as in
    `FlowRows`.
    """
    half = max(1, nx // (2 * STRIP))
    strip = numbers // ny % nx * 2 * half // nx
    place = strip // 2 + strip % 2 * half
    order = np.argsort(place, kind="stable")
    cuts = np.searchsorted(place[order], np.arange(2 * half + 1))
    strips = np.stack([cuts[:-1], cuts[1:]], axis=1)
    return numbers[order], (strips[:half], strips[half:])


def _slots(nx: int, ny: int) -> NDArray[np.int64]:
    """(8, 8) the slot of corner b in the row of corner a; neighbours may be one
    node.
    """
    step = CORNERS[None, :, :] - CORNERS[:, None, :]
    for axis, count in ((0, nx), (1, ny)):
        if count <= 2:
            step[..., axis] = np.abs(step[..., axis]) * (count - 1)
    out: NDArray[np.int64] = ((step + 1) @ np.array([9, 3, 1])).astype(np.int64)
    return out


_SELF = 13  # the slot of a node in its own row


@compiled
def subtract_correction(K, deviatoric, gradients, weights, terms, scale):  # type: ignore[no-untyped-def]
    """Subtracts `scale` times the correction of one element from its stiffness K (24 x
    24).
    """
    v = np.empty(24)
    for q in range(8):
        a, b, n = scale * terms[6, q], scale * weights[q] * terms[7, q], terms[:6, q]
        for m in range(24 * 24):
            K[m] -= a * deviatoric[q, m]
        for c in range(8):
            gx, gy, gz = gradients[0, c, q], gradients[1, c, q], gradients[2, c, q]
            v[3 * c] = n[0] * gx + n[3] * gy + n[5] * gz
            v[3 * c + 1] = n[3] * gx + n[1] * gy + n[4] * gz
            v[3 * c + 2] = n[5] * gx + n[4] * gy + n[2] * gz
        for i in range(24):
            f = b * v[i]
            for j in range(24):
                K[24 * i + j] -= f * v[j]


@compiled
def _add_rows(K, corners, places, slots, neighbours, blocks):  # type: ignore[no-untyped-def]
    """Adds the stiffness K of the element with these `corners` to the rows of those
    that flow.
    """
    for a in range(8):
        row = places[corners[a]]
        if row >= blocks.shape[0]:
            continue
        for b in range(8):
            slot = slots[a, b]
            neighbours[row, slot] = corners[b]
            for i in range(3):
                for j in range(3):
                    blocks[row, slot, i, j] += K[24 * (3 * a + i) + 3 * b + j]


@compiled
def _assemble(  # type: ignore[no-untyped-def]  # noqa: PLR0913, PLR0917 - one sum
    body, flow, which, places, slots, neighbours, blocks, strips
):
    """Adds the stiffness of the elements `which` in the strips to the rows of the
    flowing nodes.
    """
    bricks, elastic, deviatoric = body
    number, terms, scale = flow
    K = np.empty(24 * 24)
    for first, stop in strips:
        for e in which[first:stop]:
            s = bricks.shape_of[e]
            for n in range(K.size):  # the compiler takes seconds for K[:] = elastic[s]
                K[n] = elastic[s, n]
            if number[e] >= 0:
                gradients, weights = bricks.gradients[s], bricks.weights[s]
                subtract_correction(
                    K, deviatoric[s], gradients, weights, terms[number[e]], scale
                )
            _add_rows(K, bricks.connectivity[e], places, slots, neighbours, blocks)


@compiled
def _invert(rows, held, out):  # type: ignore[no-untyped-def]
    """Inverses of the diagonal blocks; a held normal motion has neither row nor
    column.
    """
    for r in range(rows.nodes.size):
        A, node = rows.blocks[r, _SELF], rows.nodes[r]
        d, f, g = A[2, 2], A[1, 2], A[0, 2]
        fixed = node < held.size and held[node]
        if fixed:
            d, f, g = 1.0, 0.0, 0.0
        inverse = inverse_of_symmetric(A[0, 0], A[1, 1], d, A[0, 1], f, g)
        for i in range(3):
            j = (i + 1) % 3
            out[r, i, i] = inverse[i]
            out[r, i, j] = out[r, j, i] = inverse[3 + i]
        if fixed:
            out[r, 2, 2] = 0


# The sums keep their order: reassociated, they would be gathered into slow vectors of
# neighbours.
@njit(fastmath={"contract", "nsz"}, **OPTIONS)
def _sweep(rows, inverses, right, x, ascending, strips):  # type: ignore[no-untyped-def]
    """Makes one Gauss-Seidel sweep of each strip, which starts from x and changes
    it.
    """
    count = rows.nodes.size
    for first, stop in strips:
        for k in range(stop - first):
            r = first + k if ascending else stop - 1 - k
            n = rows.nodes[r]
            b0, b1, b2 = right[n, 0], right[n, 1], right[n, 2]
            for s in range(27):
                c = rows.places[r, s]
                if c < count:
                    A = rows.blocks[r, s]
                    b0 -= A[0, 0] * x[c, 0] + A[0, 1] * x[c, 1] + A[0, 2] * x[c, 2]
                    b1 -= A[1, 0] * x[c, 0] + A[1, 1] * x[c, 1] + A[1, 2] * x[c, 2]
                    b2 -= A[2, 0] * x[c, 0] + A[2, 1] * x[c, 1] + A[2, 2] * x[c, 2]
            D = inverses[r]
            for i in range(3):
                x[r, i] += D[i, 0] * b0 + D[i, 1] * b1 + D[i, 2] * b2


@compiled
def _multiply(rows, x, out, strips):  # type: ignore[no-untyped-def]
    """out += K x, in the rows of the strips' flowing nodes and, of all others, of
    neighbours.
    """
    count = rows.nodes.size
    for first, stop in strips:
        for r in range(first, stop):
            n = rows.nodes[r]
            b0 = b1 = b2 = 0.0
            x0, x1, x2 = x[r, 0], x[r, 1], x[r, 2]
            for s in range(27):
                m = rows.neighbours[r, s]
                if m < 0:
                    continue
                A, c = rows.blocks[r, s], rows.places[r, s]
                if c < count:
                    b0 += A[0, 0] * x[c, 0] + A[0, 1] * x[c, 1] + A[0, 2] * x[c, 2]
                    b1 += A[1, 0] * x[c, 0] + A[1, 1] * x[c, 1] + A[1, 2] * x[c, 2]
                    b2 += A[2, 0] * x[c, 0] + A[2, 1] * x[c, 1] + A[2, 2] * x[c, 2]
                else:
                    out[m, 0] += A[0, 0] * x0 + A[1, 0] * x1 + A[2, 0] * x2
                    out[m, 1] += A[0, 1] * x0 + A[1, 1] * x1 + A[2, 1] * x2
                    out[m, 2] += A[0, 2] * x0 + A[1, 2] * x1 + A[2, 2] * x2
            out[n, 0] += b0
            out[n, 1] += b1
            out[n, 2] += b2
