"""Block Gauss-Seidel sweeps over the flowing nodes, for the preconditioner.

A perfectly plastic body yields along slip lines as thin as an element.  Neither the
elastic flat block nor a coarse grid can represent them, but sweeps over the flowing
nodes can, and these are only a few per cent of all nodes.  Together they form one
symmetric preconditioner,

    sweep up  ->  elastic block  ->  sweep down,

a multiplicative Schwarz method (Smith, Bjorstad and Gropp, Domain Decomposition, 1996,
section 1.1).  Its product with the tangent costs nothing extra, because each step
starts from the residual that the step before has left.

The tangent's rows of the flowing nodes consist of 3 x 3 blocks, one for each of the at
most 27 nodes that share an element with a node.  They are ordered in strips across the
surface, every other strip first: strips of one half have no element in common, so that
threads share one half and then the other.
"""

# mypy: allow-untyped-defs
# numba infers the types of the compiled functions.

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from epcontact.results import FloatArray
from fem_check.element import CORNERS
from fem_check.lanes import OPTIONS, compiled, inlined, invert_symmetric
from fem_check.plasticity import TangentCorrection
from fem_check.problem import Problem
from fem_check.workers import SERIAL, Workers

#: Sweeps on either side of the elastic block, an odd number.  They nearly halve the
#: iterations, and more sweeps save no work.
SWEEPS = 3
#: Least width of a strip, in nodes; it must be more than one.
STRIP_WIDTH = 4
#: Work on a row of 27 blocks relative to the work on an element, for threads: in a
#: sweep or product, and in the assembly.
_ROW_WORK = 0.5
_ASSEMBLY_WORK = 8.0


class FlowRows(NamedTuple):
    """The tangent's matrix rows of the flowing nodes.

    Attributes:
        nodes: (n,) numbers of the flowing nodes, strip by strip.
        neighbours: (n, 27) numbers of the nodes in each row; -1 where there is none.
        neighbour_rows: (n, 27) indices of the neighbours in `nodes`; n where a
            neighbour does not flow.
        blocks: (n, 27, 3, 3) stiffness, in N/m.
        strips: two halves (s, 2), the first row and the stop row of each strip.
    """

    nodes: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    neighbour_rows: NDArray[np.int32]
    blocks: FloatArray
    strips: tuple[NDArray[np.int64], NDArray[np.int64]]


class Smoother:
    """The sweeps over the flowing nodes.

    Args:
        rows: the tangent's rows.
        held: (nx, ny) True for the top nodes whose normal motion is zero.
        workers: threads that share the work.
    """

    def __init__(
        self, rows: FlowRows, held: NDArray[np.bool_], workers: Workers = SERIAL
    ) -> None:
        """Invert the diagonal blocks of the flowing nodes' matrix rows.

        Args:
            rows: the tangent's rows of the flowing nodes.
            held: (nx, ny) True for the top nodes whose normal motion is zero.
            workers: threads that share the work.
        """
        self.rows = rows
        self.workers = workers
        self._inverses = np.empty((len(rows.nodes), 3, 3))  # of the diagonal blocks
        _invert_diagonal(rows, held.ravel(), self._inverses)

    def smooth(self, residual: FloatArray, *, transposed: bool = False) -> FloatArray:
        """Return the displacements of the n flowing nodes after `SWEEPS` (3) sweeps.

        Args:
            residual: (levels, nx, ny, 3) forces, in N.
            transposed: sweep down, up, down instead of up, down, up.

        Returns:
            (n, 3) in m, in the order of the rows' nodes.
        """
        x = np.zeros((len(self.rows.nodes), 3))
        right = residual.reshape(-1, 3)
        for k in range(SWEEPS):
            up = (k % 2 == 0) != transposed
            sweep = partial(_sweep, self.rows, self._inverses, right, x, up)
            halves = self.rows.strips
            if not up:
                halves = halves[::-1]
            for strips in halves:
                self.workers.run(sweep, strips, work=_ROW_WORK)
        return x

    def add_product(self, scale: float, x: FloatArray, force: FloatArray) -> None:
        """Add `scale` times the tangent times x to a force, in place.

        Args:
            scale: dimensionless.
            x: (n, 3) displacements of the n flowing nodes, in m.
            force: (levels, nx, ny, 3) in N, which is changed.
        """
        multiply = partial(_multiply, self.rows, scale * x, force.reshape(-1, 3))
        for strips in self.rows.strips:
            self.workers.run(multiply, strips, work=_ROW_WORK)

    def add(self, x: FloatArray, displacement: FloatArray) -> None:
        """Add displacements of the flowing nodes to a field, in place.

        Args:
            x: (n, 3) of the n flowing nodes, in m.
            displacement: (levels, nx, ny, 3) in m, which is changed.
        """
        displacement.reshape(-1, 3)[self.rows.nodes] += x


def assemble_rows(
    problem: Problem, correction: TangentCorrection, scale: float
) -> FlowRows:
    """Assemble the tangent's matrix rows of the flowing nodes of a flat block.

    Args:
        problem: the finite-element problem, whose elements are those of a flat block.
        correction: consistent tangent less elastic stiffness, in the elements that
            flow.
        scale: factor of the correction, which is added to the elastic stiffness.

    Returns:
        The rows, without those of nodes of the base.
    """
    nx, ny = problem.block.shape
    bricks = problem.bricks
    flows = np.zeros(problem.block.field_shape[:3], dtype=np.bool_)
    flows.reshape(-1)[bricks.connectivity[correction.elements]] = True
    flows[-1] = False
    nodes, strips = _in_strips(np.flatnonzero(flows), nx, ny)
    row_of_node = np.full(flows.size, len(nodes), dtype=np.int32)
    row_of_node[nodes] = np.arange(len(nodes))
    correction_of_element = np.full(bricks.number, -1, dtype=np.int32)
    correction_of_element[correction.elements] = np.arange(correction.elements.size)
    # Element [k, i, j] has nodes of the levels k and k + 1, and of the columns i and
    # i + 1, j and j + 1.
    has_row = flows[:-1] | flows[1:]
    has_row |= np.roll(has_row, -1, 1)
    has_row |= np.roll(has_row, -1, 2)
    elements, element_strips = _in_strips(np.flatnonzero(has_row), nx, ny)
    neighbours = np.full((len(nodes), 27), -1, dtype=np.int32)
    blocks = np.zeros((len(nodes), 27, 3, 3))
    task = partial(
        _assemble,
        (bricks, *problem.stiffness),
        (correction_of_element, correction.terms, float(scale)),
        elements,
        (row_of_node, _slots(nx, ny), neighbours, blocks),
    )
    for half in element_strips:
        problem.workers.run(task, half, work=_ASSEMBLY_WORK)
    neighbour_rows = np.where(neighbours < 0, len(nodes), row_of_node[neighbours])
    return FlowRows(nodes, neighbours, neighbour_rows.astype(np.int32), blocks, strips)


def _in_strips(
    numbers: NDArray[np.int64], nx: int, ny: int
) -> tuple[NDArray[np.int64], tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return numbers of nodes or elements ordered by strips, and these strips.

    A strip is a group of neighbouring columns along x over the full depth, at least
    `STRIP_WIDTH` (4) nodes wide on larger grids.  Every other strip comes first,
    because strips of one half have no element in common.

    Args:
        numbers: ascending numbers (k nx + i) ny + j of level k and column i, j.
        nx: number of nodes along x.
        ny: number of nodes along y.

    Returns:
        The ordered numbers, and for each half an (s, 2) array with the first index and
        the stop index of its strips.
    """
    half = max(1, nx // (2 * STRIP_WIDTH))
    strip = numbers // ny % nx * 2 * half // nx
    position = strip // 2 + strip % 2 * half  # even strips first
    order = np.argsort(position, kind="stable")
    cuts = np.searchsorted(position[order], np.arange(2 * half + 1))
    strips = np.stack([cuts[:-1], cuts[1:]], axis=1)
    return numbers[order], (strips[:half], strips[half:])


def _slots(nx: int, ny: int) -> NDArray[np.int64]:
    """Return (8, 8) the slot, from 0 to 26, of corner b in the row of corner a.

    A node's row has 27 slots, 9 (dx + 1) + 3 (dy + 1) + dz + 1 for the neighbour at dx,
    dy, dz.  With one or two nodes along an axis, neighbours on both sides are the same
    node.

    Args:
        nx: number of nodes along x.
        ny: number of nodes along y.
    """
    step = CORNERS[None, :, :] - CORNERS[:, None, :]
    for axis, count in ((0, nx), (1, ny)):
        if count <= 2:
            step[..., axis] = np.abs(step[..., axis]) * (count - 1)
    slots: NDArray[np.int64] = ((step + 1) @ np.array([9, 3, 1])).astype(np.int64)
    return slots


#: Slot of a node in its own row.
_SELF = 13


@compiled
def subtract_correction(K, deviatoric, gradients, weights, terms, scale):
    """Subtract the scaled plastic correction of one element from its stiffness K.

    Args:
        K: (24 * 24,) stiffness row by row in N/m, changed in place.
        deviatoric: (8, 24 * 24) integrals of `layer_stiffness`, in m.
        gradients: (3, 8, 8) basis gradients as [axis, corner, Gauss point], in 1/m.
        weights: (8,) volumes of the Gauss points, in m^3.
        terms: (8, 8) of `TangentCorrection`: six components of the flow direction n and
            two moduli in Pa, by Gauss point.
        scale: dimensionless factor of the correction.
    """
    v = np.empty(24)
    for q in range(8):
        a = scale * terms[6, q]
        b = scale * weights[q] * terms[7, q]
        n = terms[:6, q]
        for m in range(24 * 24):
            K[m] -= a * deviatoric[q, m]
        for c in range(8):
            gx = gradients[0, c, q]
            gy = gradients[1, c, q]
            gz = gradients[2, c, q]
            v[3 * c] = n[0] * gx + n[3] * gy + n[5] * gz
            v[3 * c + 1] = n[3] * gx + n[1] * gy + n[4] * gz
            v[3 * c + 2] = n[5] * gx + n[4] * gy + n[2] * gz
        for i in range(24):
            f = b * v[i]
            for j in range(24):
                K[24 * i + j] -= f * v[j]


@compiled
def _add_rows(K, corners, row_of_node, slots, neighbours, blocks):
    """Add the stiffness of one element to the rows of its nodes that flow, in place.

    Args:
        K: (24 * 24,) stiffness of the element row by row, in N/m.
        corners: (8,) numbers of its nodes.
        row_of_node: (nodes,) row of each node; the number of rows for one without a
            row.
        slots: (8, 8) slot of corner b in the row of corner a, from `_slots`.
        neighbours: (rows, 27) receives the node numbers of the neighbours.
        blocks: (rows, 27, 3, 3) stiffness in N/m, to which K is added.
    """
    for a in range(8):
        row = row_of_node[corners[a]]
        if row >= blocks.shape[0]:
            continue  # the node does not flow
        for b in range(8):
            slot = slots[a, b]
            neighbours[row, slot] = corners[b]
            for i in range(3):
                for j in range(3):
                    blocks[row, slot, i, j] += K[24 * (3 * a + i) + 3 * b + j]


@compiled
def _assemble(body, flow, elements, rows, strips):
    """Add the stiffness of the elements in some strips to the rows of their nodes.

    Strips are groups of neighbouring columns.

    Args:
        body: the elements, and the elastic and the deviatoric stiffness of each layer,
            as in `layer_stiffness`.
        flow: index of each element's plastic correction (-1: none), the corrections'
            terms, and their factor.
        elements: numbers of elements, ordered by strips.
        rows: `row_of_node`, `slots`, `neighbours` and `blocks` of `_add_rows`; the last
            two are changed.
        strips: (s, 2) first index and stop index of each strip in `elements`.
    """
    bricks, elastic, deviatoric = body
    correction_of_element, terms, scale = flow
    row_of_node, slots, neighbours, blocks = rows
    K = np.empty(24 * 24)
    for first, stop in strips:
        for element in elements[first:stop]:
            k = bricks.shape_of[element]
            for m in range(K.size):  # the compiler takes seconds for K[:] = elastic[k]
                K[m] = elastic[k, m]
            index = correction_of_element[element]
            if index >= 0:
                subtract_correction(
                    K,
                    deviatoric[k],
                    bricks.gradients[k],
                    bricks.weights[k],
                    terms[index],
                    scale,
                )
            corners = bricks.connectivity[element]
            _add_rows(K, corners, row_of_node, slots, neighbours, blocks)


@compiled
def _invert_diagonal(rows, held, inverses):
    """Write the inverses of the rows' diagonal blocks.

    A held normal motion has neither row nor column.

    Args:
        rows: n matrix rows of the flowing nodes, in N/m.
        held: (nx ny,) True for the top nodes whose normal motion is zero.
        inverses: (n, 3, 3) receives the inverses, in m/N.
    """
    for r in range(rows.nodes.size):
        A = rows.blocks[r, _SELF]
        node = rows.nodes[r]
        zz = A[2, 2]
        yz = A[1, 2]
        zx = A[0, 2]
        is_held = node < held.size and held[node]
        if is_held:
            zz = 1.0
            yz = 0.0
            zx = 0.0
        inverse = invert_symmetric(A[0, 0], A[1, 1], zz, A[0, 1], yz, zx)
        for i in range(3):
            j = (i + 1) % 3
            inverses[r, i, i] = inverse[i]
            inverses[r, i, j] = inverses[r, j, i] = inverse[3 + i]
        if is_held:
            inverses[r, 2, 2] = 0


@inlined
def _product(A, x, y, z):
    """Return A (x, y, z), a 3 x 3 matrix times a vector, as three numbers."""
    return (
        A[0, 0] * x + A[0, 1] * y + A[0, 2] * z,
        A[1, 0] * x + A[1, 1] * y + A[1, 2] * z,
        A[2, 0] * x + A[2, 1] * y + A[2, 2] * z,
    )


# The sums keep their order.  If the compiler may reorder them, it gathers the
# neighbours into vectors, which is slower.
@njit(fastmath={"contract", "nsz"}, **OPTIONS)
def _sweep(rows, inverses, right, x, ascending, strips):
    """Make one Gauss-Seidel sweep over each strip of rows, which changes x in place.

    Args:
        rows: n matrix rows of the flowing nodes, in N/m.
        inverses: (n, 3, 3) inverses of the diagonal blocks, in m/N.
        right: (nodes, 3) right-hand side: forces on all nodes, in N.
        x: (n, 3) displacements of the flowing nodes, in m.
        ascending: whether rows are visited in ascending order.
        strips: (s, 2) first row and stop row of each strip.
    """
    count = rows.nodes.size
    for first, stop in strips:
        for k in range(stop - first):
            r = stop - 1 - k
            if ascending:
                r = first + k
            node = rows.nodes[r]
            b0 = right[node, 0]
            b1 = right[node, 1]
            b2 = right[node, 2]
            for slot in range(27):
                c = rows.neighbour_rows[r, slot]
                if c < count:
                    A = rows.blocks[r, slot]
                    f0, f1, f2 = _product(A, x[c, 0], x[c, 1], x[c, 2])
                    b0 -= f0
                    b1 -= f1
                    b2 -= f2
            d0, d1, d2 = _product(inverses[r], b0, b1, b2)
            x[r, 0] += d0
            x[r, 1] += d1
            x[r, 2] += d2


@compiled
def _multiply(rows, x, force, strips):
    """Add the tangent times the flowing nodes' displacements to the forces, in place.

    The rows of nodes that do not flow get the transposed blocks of their neighbours.

    Args:
        rows: n matrix rows of the flowing nodes, in N/m.
        x: (n, 3) displacements of the flowing nodes, in m.
        force: (nodes, 3) in N, which is changed.
        strips: (s, 2) first row and stop row of each strip.
    """
    count = rows.nodes.size
    for first, stop in strips:
        for r in range(first, stop):
            b0 = b1 = b2 = 0.0
            for slot in range(27):
                neighbour = rows.neighbours[r, slot]
                if neighbour < 0:
                    continue
                A = rows.blocks[r, slot]
                c = rows.neighbour_rows[r, slot]
                if c < count:
                    f0, f1, f2 = _product(A, x[c, 0], x[c, 1], x[c, 2])
                    b0 += f0
                    b1 += f1
                    b2 += f2
                else:
                    f0, f1, f2 = _product(A.T, x[r, 0], x[r, 1], x[r, 2])
                    force[neighbour, 0] += f0
                    force[neighbour, 1] += f1
                    force[neighbour, 2] += f2
            node = rows.nodes[r]
            force[node, 0] += b0
            force[node, 1] += b1
            force[node, 2] += b2
