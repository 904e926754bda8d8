"""The half-block with a rough top in plain scikit-fem: what the finite elements solve.

This module defines the problem of the check; `fem_check.solve` solves the same problem
faster, with loops of its own, and is compared with this module state by state.  Mesh,
forms, assembly and interpolation are scikit-fem's, the linear solver is scipy's, and
nothing here comes from the fast loops or uses a Fourier transform.

The body.  A block of trilinear bricks is periodic along x and y and rests on a base
that holds it (bonded) or lets it slide.  Its top is rough: either the top nodes are
moved to the real heights, or the roughness h is the initial gap over a flat top.

The law.  With the displacement u, the strain is

    e = dev sym grad u + I/3 <div u>,

where <.> is the mean over an element (mean dilatation, Nagtegaal, Parks and Rice 1974),
so that plastic flow, which keeps the volume, does not lock the elements.  The stress is
s + K <div u> I with s from radial return (`radial_return`): J2 flow with isotropic
hardening or none.

The contact.  A rigid flat at the height d above the undeformed mean plane presses on
the top without friction.  A node in contact has the gap g = d - (h + u_z) = 0 and a
force F >= 0; a node apart has g >= 0 and F = 0; the forces add up to the load.  Each
Newton step solves the linearised equilibrium with the nodes of the present contact set
fixed to the flat, whose height is one more unknown: the matrix stays symmetric and
positive definite, and conjugate gradients solve it.  The set then loses the nodes that
pull and gains those that penetrate.

The path.  Radial return assumes that the strain grows straight during an increment.  A
load P beyond all earlier ones is reached in n increments, at P sqrt(k/n), k = 1 ... n;
any other load in one.  Newton's method begins from the state before, and where that is
no good guess from the elastic contact with the plastic strains so far.  The solution
does not depend on the guess.

`PlainBlock`, `radial_return` and `Elements` are the problem; `equilibrium` and what
follows is a way to solve it.

Example:
    >>> steel = Material(young_modulus=2.1e11, poisson_ratio=0.3, yield_stress=5e8)
    >>> x = 2 * np.pi * np.arange(6) / 6
    >>> block = PlainBlock(
    ...     heights=1e-6 * np.add.outer(np.cos(x), np.cos(x)),
    ...     spacing=(1e-4, 1e-4),
    ...     law=law_of(steel, flows=True),
    ...     levels=np.linspace(0.0, 6e-4, 5),
    ... )
    >>> [state] = solve_path(block, [1e8], steps=2)
    >>> int(state.contact.sum())
    9
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import cg
from skfem import (
    Basis,
    BilinearForm,
    ElementHex0,
    ElementHex1,
    ElementVector,
    LinearForm,
    MeshHex,
)
from skfem.helpers import ddot, div, eye, grad, sym_grad, trace, transpose

from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import FloatArray
from epcontact.scene import Material

#: Newton steps of an increment at most; the increments of all cases take up to 15.
MOST_NEWTON_STEPS = 60
#: Iterations of conjugate gradients at most, in one Newton step.
MOST_CG_ITERATIONS = 20_000
#: Bounds of the residual of a linear solve, relative to its right-hand side.  Between
#: them it is the residual of Newton's method, which keeps its quadratic convergence.
LEAST_FORCING = 1e-7
LARGEST_FORCING = 1e-2
#: Newton steps of an increment that are always full ones.  Most increments need fewer.
FULL_STEPS = 10
#: Unbalanced force over the load above which later steps may be shortened, and the
#: shortest fraction.  Closer to the equilibrium full steps converge quadratically.
LARGEST_UNBALANCE = 1e-4
SHORTEST_STEP = 1e-3
#: Unbalanced force over the largest load that is rounding: a linear solve cannot reduce
#: the part of it that would move a sliding block sideways.
ROUNDED_FORCE = 1e-15
#: Fraction by which a stress must exceed the yield stress to flow: a few times the
#: rounding of a stress that is computed from strains.
ROUNDING = 1e-12


# --- the law


class Law(NamedTuple):
    """A J2 law with isotropic hardening along straight segments.

    Attributes:
        shear_modulus: mu, in Pa.
        bulk_modulus: K, in Pa.
        segments: of the yield stress over the accumulated plastic strain: for each the
            strain and the yield stress (Pa) where it begins, and its slope (Pa).  An
            elastic body has one segment of infinite stress.
    """

    shear_modulus: float
    bulk_modulus: float
    segments: tuple[tuple[float, float, float], ...]

    @property
    def flows(self) -> bool:
        """True if the yield stress is finite."""
        return math.isfinite(self.segments[0][1])

    @property
    def without_flow(self) -> Law:
        """The law of an elastic body with these moduli."""
        return self._replace(segments=((0.0, math.inf, 0.0),))


def law_of(material: Material, flows: bool) -> Law:
    """Return the law of a material.

    Args:
        material: elastic constants, yield stress and hardening.
        flows: whether it flows; otherwise the yield stress is infinite.
    """
    E = material.young_modulus
    nu = material.poisson_ratio
    curve = material.yield_curve
    slopes = (*np.diff(curve.stresses) / np.diff(curve.strains), curve.last_slope)
    segments = tuple(zip(curve.strains, curve.stresses, slopes, strict=True))
    law = Law(E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu)), segments)
    return law if flows else law.without_flow


class History(NamedTuple):
    """What m elements remember at their eight Gauss points.

    Attributes:
        plastic_strain: (3, 3, m, 8) plastic strain tensors; their trace is 0.
        accumulated: (m, 8) accumulated plastic strain, sqrt(2/3) of the path of the
            plastic strain.
    """

    plastic_strain: FloatArray
    accumulated: FloatArray


def initial_history(elements: int) -> History:
    """Return the history of a number of elements that have never flowed."""
    return History(np.zeros((3, 3, elements, 8)), np.zeros((elements, 8)))


class Return(NamedTuple):
    """The result of radial return at the Gauss points of m elements.

    Attributes:
        stress: (3, 3, m, 8) deviatoric stress s, in Pa.
        history: the history after the increment.
        flows: (m, 8) True where the plastic strain has grown.
        direction: (3, 3, m, 8) n = s/|s|.
        theta: (m, 8) |s| over the norm of the trial stress.
        theta_bar: (m, 8) factor of n (x) n in the consistent tangent.
    """

    stress: FloatArray
    history: History
    flows: NDArray[np.bool_]
    direction: FloatArray
    theta: FloatArray
    theta_bar: FloatArray


def yield_stress(law: Law, accumulated: FloatArray) -> FloatArray:
    """Return the yield stress in Pa after accumulated plastic strains, shape kept."""
    stress = np.zeros_like(accumulated)
    for begin, stress_there, slope in law.segments:
        line = stress_there + slope * (accumulated - begin)
        stress = np.where(accumulated >= begin, line, stress)
    return stress


def radial_return(law: Law, strain: FloatArray, history: History) -> Return:
    """Return the stresses after an increment, by the radial return of J2 plasticity.

    With the deviatoric strain e and the plastic strain e_p before the increment, the
    trial stress is 2 mu (e - e_p), and q = sqrt(3/2) |trial stress| its von Mises
    stress.  If q exceeds the yield stress, the accumulated plastic strain a grows by da
    until

        q - 3 mu da = yield stress(a + da),

    and the stress is scaled by theta = 1 - 3 mu da/q (Simo and Hughes, Computational
    Inelasticity, boxes 3.1 and 3.2).

    Args:
        law: of the material.
        strain: (3, 3, m, 8) deviatoric strains.
        history: before the increment.
    """
    mu = law.shear_modulus
    trial = 2 * mu * (strain - history.plastic_strain)
    norm = np.sqrt(ddot(trial, trial))
    q = math.sqrt(3 / 2) * norm
    a = history.accumulated
    # A stress that was returned before lies on the yield surface within rounding.
    flows = q > yield_stress(law, a) * (1 + ROUNDING)
    growth = np.zeros_like(a)
    stiffness_ratio = np.ones_like(a)  # d(3 mu da)/dq
    if flows.any():
        for begin, stress_there, slope in law.segments:
            # The growth that ends on this segment's line.  It is the right one if it
            # ends beyond the segment's begin, and a later segment may replace it.
            on_line = (q - stress_there - slope * (a - begin)) / (3 * mu + slope)
            reached = flows & (a + on_line >= begin)
            growth[reached] = on_line[reached]
            stiffness_ratio[reached] = 3 * mu / (3 * mu + slope)
    some = np.where(norm > 0, norm, 1.0)
    direction = trial / some
    theta = 1 - math.sqrt(6) * mu * growth / some
    theta_bar = np.where(flows, stiffness_ratio - (1 - theta), 0.0)
    plastic_strain = history.plastic_strain + math.sqrt(3 / 2) * growth * direction
    after = History(plastic_strain, a + growth)
    return Return(theta * trial, after, flows, direction, theta, theta_bar)


# --- the elements


def deviator(tensor: Any) -> Any:
    """Return a (3, 3, ...) tensor without its mean part."""
    return tensor - eye(trace(tensor) / 3, 3)


@BilinearForm
def _shear(u: Any, v: Any, w: Any) -> Any:
    """Integrand of the deviatoric stiffness over 2 mu."""
    return _deviatoric_product(u, v)


@BilinearForm
def _lost_to_flow(u: Any, v: Any, w: Any) -> Any:
    """Integrand of the deviatoric stiffness less the consistent tangent, over 2 mu.

    The tangent is 2 mu (theta I_dev - theta_bar n (x) n), so that (1 - theta) I_dev +
    theta_bar n (x) n is lost.  `w` has the direction n (a deviator), theta and
    theta_bar at the Gauss points.
    """
    along = ddot(w["n"], grad(u)) * ddot(w["n"], grad(v))
    return (1 - w["theta"]) * _deviatoric_product(u, v) + w["theta_bar"] * along


def _deviatoric_product(u: Any, v: Any) -> Any:
    """Return dev sym grad u : dev sym grad v, by products that take a third of the time
    of these tensors.
    """
    symmetric = ddot(grad(u), grad(v)) + ddot(grad(u), transpose(grad(v)))
    return symmetric / 2 - div(u) * div(v) / 3


@BilinearForm
def _divergence(u: Any, v: Any, w: Any) -> Any:
    """Integrand of the change of volume; v is 1 in one element and 0 elsewhere."""
    return div(u) * v


@LinearForm
def _volume(v: Any, w: Any) -> Any:
    """Integrand of the volume of each element."""
    return v


@LinearForm
def _stress_work(v: Any, w: Any) -> Any:
    """Integrand of the work of a deviatoric stress s (Pa) on a test function."""
    return ddot(w["s"], grad(v))


class Elements:
    """Trilinear bricks with mean dilatation, on a mesh of scikit-fem.

    Attributes:
        mesh: hexahedra.
        basis: of the displacement, three unknowns a node, 2 x 2 x 2 Gauss points.
        volumes: (m,) of the elements, in m^3.
        divergence: (m, unknowns) matrix from displacements to changes of volume.
    """

    def __init__(self, mesh: MeshHex) -> None:
        """Create the bases and the matrix of the changes of volume."""
        self.mesh = mesh
        self.basis = Basis(mesh, ElementVector(ElementHex1()), intorder=2)
        constants = self.basis.with_element(ElementHex0())
        self.volumes: FloatArray = _volume.assemble(constants)
        self.divergence = _divergence.assemble(self.basis, constants)

    def deviatoric_strain(self, u: FloatArray) -> FloatArray:
        """Return (3, 3, m, 8) deviatoric strains of the displacements u in m."""
        strain: FloatArray = deviator(sym_grad(self.basis.interpolate(u)))
        return strain

    def mean_dilatation(self, u: FloatArray) -> FloatArray:
        """Return (m,) mean dilatations of the displacements u in m."""
        return np.asarray(self.divergence @ u) / self.volumes

    def force(
        self, deviatoric_stress: FloatArray, mean_stress: FloatArray
    ) -> FloatArray:
        """Return the nodal forces in N, one for each unknown, of stresses in Pa.

        Args:
            deviatoric_stress: (3, 3, m, 8).
            mean_stress: (m,).
        """
        force: FloatArray = _stress_work.assemble(self.basis, s=deviatoric_stress)
        return np.asarray(force + self.divergence.T @ mean_stress)

    def internal_force(
        self, law: Law, u: FloatArray, history: History
    ) -> tuple[FloatArray, Return]:
        """Return the internal force in N, and the radial return behind it.

        Args:
            law: of the material, with or without flow.
            u: displacements, in m.
            history: of the elements before the increment.
        """
        returned = radial_return(law, self.deviatoric_strain(u), history)
        mean_stress = law.bulk_modulus * self.mean_dilatation(u)
        return self.force(returned.stress, mean_stress), returned

    def elastic_stiffness(self, law: Law) -> csr_matrix:
        """Return the elastic stiffness between all unknowns, in N/m."""
        shear = _shear.assemble(self.basis)
        compression = self.divergence.T @ diags(1 / self.volumes) @ self.divergence
        return 2 * law.shear_modulus * shear + law.bulk_modulus * compression

    def lost_stiffness(self, law: Law, returned: Return) -> csr_matrix:
        """Return the elastic stiffness less the consistent tangent, in N/m.

        Args:
            law: of the material.
            returned: from `radial_return`; only elements that flow are assembled.
        """
        flowing = np.flatnonzero(returned.flows.any(axis=1))
        if not flowing.size:
            return csr_matrix((self.basis.N, self.basis.N))
        part = Basis(
            self.mesh, ElementVector(ElementHex1()), intorder=2, elements=flowing
        )
        lost = _lost_to_flow.assemble(
            part,
            n=returned.direction[:, :, flowing],
            theta=returned.theta[flowing],
            theta_bar=returned.theta_bar[flowing],
        )
        return 2 * law.shear_modulus * lost


# --- the block


@dataclass(frozen=True)
class PlainBlock:
    """A periodic block of bricks with a rough top under a rigid flat.

    Attributes:
        heights: (nx, ny) of the rough top, in m.
        spacing: (hx, hy) distances between nodes, in m.
        law: of the material.
        levels: (nz + 1,) heights of the node levels above the base, in m, from 0.
        moved: whether the top nodes are moved to the heights; otherwise the heights are
            the initial gap over a flat top.
        sliding: whether the base slides; it is bonded otherwise.
    """

    heights: FloatArray
    spacing: tuple[float, float]
    law: Law
    levels: FloatArray
    moved: bool = False
    sliding: bool = False

    @property
    def area(self) -> float:
        """Nominal area of the top, in m^2."""
        return self.heights.size * self.spacing[0] * self.spacing[1]

    @cached_property
    def indices(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Numbers along x, along y and of the level of each node of the mesh."""
        nx, ny = self.heights.shape
        mesh = self._tensor_mesh
        i = np.rint(mesh.p[0] / self.spacing[0]).astype(np.int64) % nx
        j = np.rint(mesh.p[1] / self.spacing[1]).astype(np.int64) % ny
        level = np.abs(mesh.p[2][:, None] - self.levels).argmin(axis=1)
        return i, j, level

    @cached_property
    def _tensor_mesh(self) -> MeshHex:
        """The mesh with a flat top."""
        x, y = (
            np.arange(count + 1) * step
            for count, step in zip(self.heights.shape, self.spacing, strict=True)
        )
        return MeshHex.init_tensor(x, y, self.levels)

    @cached_property
    def elements(self) -> Elements:
        """The elements, with the top nodes moved if the block says so.

        The displacement of the nodes decreases linearly to 0 at the base.

        Raises InvalidScene if the top is so rough that an element is turned inside out.
        """
        mesh = self._tensor_mesh
        if self.moved:
            i, j, _ = self.indices
            points = mesh.p.copy()
            points[2] += self.heights[i, j] * points[2] / self.levels[-1]
            mesh = MeshHex(points, mesh.t)
            corners = Basis(mesh, ElementHex1(), intorder=2)
            jacobians = mesh.mapping().detDF(corners.X)
            if jacobians.min() * jacobians.max() <= 0:  # the signs differ
                raise InvalidScene(
                    "an element is turned inside out: the valleys are too deep for the "
                    "block; give a deeper block, or geometry='gap'"
                )
        return Elements(mesh)

    @cached_property
    def unknowns(self) -> csr_matrix:
        """Matrix from the free unknowns to those of all mesh nodes.

        The free unknowns are [x, y, level, component] of one period without the base;
        a sliding base keeps its two horizontal components.
        """
        nx, ny = self.heights.shape
        i, j, level = self.indices
        count = len(self.levels)
        node = (i * ny + j) * count + level
        free = np.ones((nx, ny, count, 3), dtype=bool)
        free[:, :, 0, int(self.sliding) * 2 :] = False
        number = np.cumsum(free.ravel()) - 1
        dofs = self.elements.basis.nodal_dofs.T.ravel()
        periodic = (3 * node[:, None] + np.arange(3)).ravel()
        kept = free.ravel()[periodic]
        entries = np.ones(kept.sum()), (dofs[kept], number[periodic[kept]])
        shape = self.elements.basis.N, int(free.sum())
        return csr_matrix(entries, shape)

    @cached_property
    def elastic_stiffness(self) -> csr_matrix:
        """Elastic stiffness between the free unknowns, in N/m."""
        stiffness = self.elements.elastic_stiffness(self.law)
        return self.unknowns.T @ stiffness @ self.unknowns

    @cached_property
    def top(self) -> NDArray[np.int64]:
        """(nx ny,) numbers of the free unknowns that are u_z of the top nodes."""
        count = self.heights.size
        horizontal_base = 2 * int(self.sliding)
        each = 3 * (len(self.levels) - 1) + horizontal_base
        return np.arange(1, count + 1) * each - 1


class State(NamedTuple):
    """An equilibrium of the block under a load.

    Attributes:
        displacement: (unknowns,) free unknowns, in m.
        flat: height d of the flat above the mean plane, in m.
        forces: (nx ny,) contact forces, in N, compression positive.
        contact: (nx ny,) True for the nodes in contact.
        history: of the elements.
        residuals: dimensionless, by name: "balance" and "load" over the largest load of
            the path, "gap", "penetration" and "tension" of the contact.
        newton_steps: of the last increment.
        cg_iterations: of the last increment.
    """

    displacement: FloatArray
    flat: float
    forces: FloatArray
    contact: NDArray[np.bool_]
    history: History
    residuals: dict[str, float]
    newton_steps: int = 0
    cg_iterations: int = 0


def solve_path(
    block: PlainBlock,
    mean_pressures: Sequence[float],
    steps: int = 10,
    tolerance: float = 1e-10,
) -> Iterator[State]:
    """Yield the state of the block at each mean pressure of a load path.

    Args:
        block: the body.
        mean_pressures: forces over the nominal area, in Pa, in order; 0 after a load
            removes the flat.
        steps: increments of a body that flows to a load beyond all earlier ones.
        tolerance: on the dimensionless residuals.

    Raises:
        NotConverged: an increment did not reach the tolerance.
    """
    largest = 0.0
    heights = block.heights.ravel()
    state = State(
        np.zeros(block.unknowns.shape[1]),
        float(heights.max()),
        np.zeros(heights.size),
        np.zeros(heights.size, dtype=bool),
        initial_history(block.elements.volumes.size),
        {},
    )
    for mean_pressure in mean_pressures:
        target = mean_pressure * block.area
        loads = [target]
        if block.law.flows and target > largest:
            ends = [target * math.sqrt(k / steps) for k in range(1, steps)]
            loads = [load for load in ends if load > largest] + loads
        for load in loads:
            is_elastic = load <= largest
            largest = max(load, largest)
            if load > 0 and (is_elastic or not state.contact.any()):
                # Newton's method begins from the elastic contact: a single node cannot
                # carry the load, and loads up to the largest one are nearly elastic.
                state = equilibrium(block, state, load, largest, 1e-3, flows=False)
            state = equilibrium(block, state, load, largest, tolerance)
        yield state


def equilibrium(
    block: PlainBlock,
    start: State,
    load: float,
    largest_load: float,
    tolerance: float,
    flows: bool = True,
) -> State:
    """Return the equilibrium at the end of an increment, by Newton's method.

    Args:
        block: the body.
        start: the state at the begin of the increment, with the history.
        load: total force at the end, in N; 0: no node touches the flat.
        largest_load: of the path so far, in N, which scales the residuals.
        tolerance: on the dimensionless residuals.
        flows: whether the body may flow; otherwise it stays elastic.

    Raises:
        NotConverged: the residuals are too large after `MOST_NEWTON_STEPS` steps; the
            error holds them.
    """
    expand = block.unknowns
    heights = block.heights.ravel()
    u = start.displacement
    flat = start.flat
    contact = start.contact & (load > 0)
    if load > 0 and not contact.any():
        contact = heights + u[block.top] == (heights + u[block.top]).max()
    law = block.law if flows else block.law.without_flow
    cg_iterations = 0
    for newton_steps in range(MOST_NEWTON_STEPS):
        internal, returned = _internal_force(block, law, u, start.history)
        forces = np.where(contact, -internal[block.top], 0.0)
        gap = flat - (heights + u[block.top])
        if load == 0:  # the flat just touches the highest node
            flat -= gap.min()
            gap -= gap.min()
        unbalanced = internal.copy()
        unbalanced[block.top] += forces
        residuals = _residuals(
            block, unbalanced, forces, gap, contact, load, largest_load
        )
        if max(residuals.values()) <= tolerance:
            steps = newton_steps, cg_iterations
            return State(u, flat, forces, contact, returned.history, residuals, *steps)
        if load > 0 and newton_steps > 0:
            contact = np.where(contact, forces > 0, gap < 0)
            if not contact.any():
                contact = gap == gap.min()
        lost = block.elements.lost_stiffness(law, returned)
        # Far from equilibrium a body that flows has hardly any stiffness: a tenth of
        # what it lost is kept there, and the linear solve need not be accurate.
        unbalance = min(1.0, residuals["balance"] + residuals["load"])
        fraction_lost = 1 - 0.1 * unbalance
        forcing = min(max(unbalance, LEAST_FORCING), LARGEST_FORCING)
        stiffness = block.elastic_stiffness - fraction_lost * (expand.T @ lost @ expand)
        tolerances = forcing, ROUNDED_FORCE * largest_load
        change, iterations = _newton_step(
            stiffness, internal, block.top[contact], gap[contact], load, tolerances
        )
        fraction = 1.0
        if newton_steps >= FULL_STEPS and unbalance > LARGEST_UNBALANCE:
            fraction = _step_length(block, law, u, start.history, change, load)
        u = u + fraction * change[:-1]
        flat += fraction * change[-1]
        cg_iterations += iterations
    raise NotConverged(
        f"plain finite elements: no equilibrium at the force {load:.4g} N after "
        f"{MOST_NEWTON_STEPS} Newton steps; give more steps or a smaller load",
        residuals=residuals,
    )


def _internal_force(
    block: PlainBlock, law: Law, u: FloatArray, history: History
) -> tuple[FloatArray, Return]:
    """Return the internal force on the free unknowns in N, and the stresses behind it.

    Args:
        block: the body.
        law: of its material, with or without flow.
        u: (unknowns,) free unknowns, in m.
        history: of the elements before the increment.
    """
    everywhere = block.unknowns @ u
    force, returned = block.elements.internal_force(law, everywhere, history)
    return block.unknowns.T @ force, returned


def _step_length(
    block: PlainBlock,
    law: Law,
    u: FloatArray,
    history: History,
    change: FloatArray,
    load: float,
) -> float:
    """Return the fraction of a Newton step at which the energy hardly falls any more.

    Over an increment, radial return has an energy, which is convex: its slope along the
    step grows.  A step that ends where the energy rises steeply goes too far, and is
    halved.

    Args:
        block: the body.
        law: of its material.
        u: (unknowns,) free unknowns at the begin of the step, in m.
        history: of the elements before the increment.
        change: (unknowns + 1,) the full step, of the unknowns and of the flat, in m.
        load: total force, in N, whose potential falls with the flat.
    """

    def slope_at(fraction: float) -> float:
        """Return the slope of the energy in J after a fraction of the step."""
        internal, _ = _internal_force(block, law, u + fraction * change[:-1], history)
        return float(internal @ change[:-1] + load * change[-1])

    first_slope = slope_at(0.0)
    fraction = 1.0
    while first_slope < 0 and slope_at(fraction) > 0.3 * abs(first_slope):
        fraction /= 2
        if fraction < SHORTEST_STEP:
            break
    return fraction


def _newton_step(
    stiffness: csr_matrix,
    internal: FloatArray,
    touching: NDArray[np.int64],
    gap: FloatArray,
    load: float,
    tolerances: tuple[float, float],
) -> tuple[FloatArray, int]:
    """Return the change of the unknowns and of the flat, and the iterations it took.

    The nodes in contact close their gap and move with the flat, so that their unknowns
    are replaced by the height of the flat: u = T v + g.

    Args:
        stiffness: (n, n) tangent between the free unknowns, in N/m.
        internal: (n,) internal forces, in N.
        touching: numbers of the unknowns of the nodes in contact.
        gap: of these nodes, in m.
        load: total force on the flat, in N.
        tolerances: on the residual of the linear solve: relative, and in N.

    Raises:
        NotConverged: conjugate gradients did not converge.
    """
    n = len(internal)
    free = np.ones(n, dtype=bool)
    free[touching] = False
    column = np.cumsum(free) - 1
    flat = int(free.sum())
    column[touching] = flat
    count = flat + int(len(touching) > 0)
    T = csr_matrix((np.ones(n), (np.arange(n), column)), (n, count))
    closing = np.zeros(n)
    closing[touching] = gap
    right = -(T.T @ (internal + stiffness @ closing))
    if len(touching):
        right[flat] -= load
    matrix = T.T @ stiffness @ T
    iterations = 0

    def count_iteration(_: FloatArray) -> None:
        nonlocal iterations
        iterations += 1

    solution, failed = cg(
        matrix,
        right,
        rtol=tolerances[0],
        atol=tolerances[1],
        maxiter=MOST_CG_ITERATIONS,
        M=diags(1 / matrix.diagonal()),
        callback=count_iteration,
    )
    if failed:
        raise NotConverged(
            "plain finite elements: conjugate gradients did not converge in "
            f"{MOST_CG_ITERATIONS} iterations"
        )
    moved = 0.0
    if len(touching):
        moved = solution[flat]
    return np.append(T @ solution + closing, moved), iterations


def _residuals(
    block: PlainBlock,
    unbalanced: FloatArray,
    forces: FloatArray,
    gap: FloatArray,
    contact: NDArray[np.bool_],
    load: float,
    largest_load: float,
) -> dict[str, float]:
    """Return the dimensionless residuals of a state, see `State`.

    Forces are relative to the largest load of the path, gaps to the rms height.
    """
    length = float(block.heights.std()) or float(block.levels[-1])
    return {
        "balance": float(np.linalg.norm(unbalanced)) / largest_load,
        "load": abs(float(forces.sum()) - load) / largest_load,
        "gap": float(np.abs(gap[contact]).max(initial=0.0)) / length,
        "penetration": float((-gap[~contact]).max(initial=0.0)) / length,
        "tension": float((-forces).max(initial=0.0)) / largest_load,
    }
