"""The finite-element contact problem as a set of equations: what is given, what is sought, and
the residuals by which a state is judged.

Signs: F presses down, the body feels -F; R = -(internal force) - (capped forces) is the residual
with the contact forces left in it, so R = F on the contact nodes of a solution.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from epcontact.results import ELASTIC, PLASTIC, FloatArray
from fem_check import plasticity
from fem_check.contact import States
from fem_check.element import Elements
from fem_check.linear_solver import Factor
from fem_check.mesh import Block
from fem_check.plasticity import History, Law
from fem_check.vectors import norm


@dataclass(frozen=True)
class Problem:
    """What stays the same over a load path.

    bricks: of the true geometry; `flat` says that the factor's block has the same.
    heights: (nx, ny) of the top, in m.  cap: the largest nodal force, in N.
    """

    block: Block
    bricks: Elements
    factor: Factor
    law: Law
    heights: FloatArray
    cap: float = np.inf
    flat: bool = True

    @property
    def plastic(self) -> bool:
        """Whether the material can flow."""
        return bool(np.isfinite(self.law.yield_stress))


@dataclass(frozen=True)
class Control:
    """Prescribed: the total force `load` in N, or where it is None the `approach` in m.
    `scale` is the force that residuals are divided by; 0: the force reached."""

    load: float | None = None
    approach: float = 0.0
    scale: float = 0.0


@dataclass(frozen=True)
class State:
    """A state of the block: displacement (nz + 1, nx, ny, 3), approach, contact states and
    nodal forces (nx, ny)."""

    displacement: FloatArray
    approach: float
    states: States
    forces: FloatArray


@dataclass
class Counts:
    """Iterations of a load step and its relative residual after each Newton iteration."""

    newton: int = 0
    cg: int = 0
    sweeps: int = 0
    cuts: int = 0
    largest_cg: int = 0
    largest_newton: int = 0
    increments: int = 0
    history: list[float] = field(default_factory=list)


def internal_force(
    problem: Problem, u: FloatArray, history: History
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The internal force of the displacement `u`, same shape, and which elements flow."""
    out = np.empty_like(u)
    flat = out.reshape(-1, 3)
    if problem.plastic:
        yielded = plasticity.force(u.reshape(-1, 3), problem.bricks, problem.law, history, flat)
    else:
        plasticity.elastic_force(u.reshape(-1, 3), problem.bricks, problem.law, flat)
        yielded = np.zeros(problem.bricks.number, dtype=np.bool_)
    return out, yielded


def release_base(problem: Problem, force: FloatArray) -> None:
    """Drops the base's reactions from a force, in place; one cut off above the base has none."""
    if len(force) <= len(problem.block.layers):
        return
    if problem.block.sliding:
        force[-1, ..., 2] = 0
    else:
        force[-1] = 0


def split_residual(
    problem: Problem, R: FloatArray, states: States, control: Control
) -> tuple[FloatArray, float, FloatArray]:
    """(r, r_d, F): the residual without the contact forces, the missing load, and the forces."""
    contact = states == ELASTIC
    forces = np.where(contact, R[0, ..., 2], 0.0)
    r = R.copy()
    r[0, ..., 2][contact] = 0
    total = float(forces.sum())
    if np.isfinite(problem.cap):
        total += problem.cap * float((states == PLASTIC).sum())
    return r, 0.0 if control.load is None else control.load - total, forces


def open_residual(problem: Problem, states: States, internal: FloatArray) -> FloatArray:
    """R of the module's docstring."""
    R = -internal
    release_base(problem, R)
    if np.isfinite(problem.cap):
        R[0, ..., 2] -= problem.cap * (states == PLASTIC)
    return R


def residuals(
    problem: Problem, state: State, internal: FloatArray, control: Control
) -> dict[str, float]:
    """Dimensionless residuals of a state with its `internal` force.

    balance: norm of the unbalanced nodal forces over the total force; load: missing share of it;
    gap: largest gap on the elastic contact, penetration: deepest node elsewhere, both over the
    rms height; tension: largest pull of a contact node, over the total force.
    """
    R = open_residual(problem, state.states, internal)
    capped = state.states == PLASTIC
    r, r_d, forces = split_residual(problem, R, state.states, control)
    pressed = float(forces.sum()) + (problem.cap * int(capped.sum()) if capped.any() else 0.0)
    total = control.scale or pressed or 1.0
    rms = float(np.std(problem.heights)) or float(np.abs(state.approach)) or 1.0
    gap = -state.displacement[0, ..., 2] - problem.heights - state.approach
    contact = state.states == ELASTIC
    apart = ~contact & ~capped
    return {
        "balance": norm(r) / total,
        "load": abs(r_d) / total,
        "gap": float(np.abs(gap[contact]).max(initial=0.0)) / rms,
        "penetration": max(
            float((-gap[apart]).max(initial=0.0)), float(gap[capped].max(initial=0.0))
        )
        / rms,
        "tension": float((-forces[contact]).max(initial=0.0)) / total,
    }
