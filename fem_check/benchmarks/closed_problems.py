"""Closed problems that judge the elements and the plasticity: bodies, what they should answer.

Lengths, stresses and moduli are relative (Y: the uniaxial yield stress, k = Y/sqrt(3)); the
functions return what was computed beside what theory says, and leave the judgement to a gate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.results import FloatArray
from fem_check.benchmarks.bodies import SLICE, SmallBody, push, radial_column, slice_body
from fem_check.plasticity import law


@dataclass(frozen=True)
class Curve:
    """A computed quantity beside its exact one, along a path; `newton`: residuals by step."""

    computed: FloatArray
    exact: FloatArray
    newton: tuple[tuple[float, ...], ...]


def thick_sphere(
    elements: int = 40, *, ratio: float = 2.0, poisson_ratio: float = 0.3, steps: int = 12
) -> Curve:
    """Internal pressure over Y of a thick sphere, a < r < b = ratio a, up to collapse.

    Exact (Hill 1950): with the plastic radius c, p = 2 Y ln(c/a) + (2 Y/3)(1 - c^3/b^3), and
    the outer surface moves by (1 - nu) Y c^3/(E b^2); the limit is 2 Y ln(b/a).
    """
    b, Y, E, nu = ratio, 1.0, 1000.0, poisson_ratio
    column = radial_column(1.0, b, elements)
    # u(a) at full yield, and half as much again: from there the pressure stands still.
    full = (1 - nu) * Y / E * b**3
    path = full * np.linspace(0.02, 1.5, steps)
    done = push(column, law(E, nu, Y), np.array([0]), path)
    # A facet of half-angles SLICE about r = 1: its area, and how its corners' radii lean.
    direction = 1 / math.sqrt(1 + 2 * math.tan(SLICE) ** 2)
    area = (2 * math.tan(SLICE) * direction) ** 2
    pressure = np.array([step.forces[0] for step in done]) / (area * direction)
    outer = np.array([step.unknowns[-1] for step in done])
    c = np.cbrt(outer * E / ((1 - nu) * Y) * b**2)
    plastic = 2 * np.log(np.maximum(c, 1)) + 2 / 3 * (1 - np.clip(c / b, 0, 1) ** 3)
    elastic = 2 * E * outer * (b**3 - 1) / (3 * (1 - nu) * b)
    exact = np.where(c <= 1, elastic, np.where(c >= b, 2 * np.log(b), plastic))
    return Curve(pressure / Y, exact, tuple(step.residuals for step in done))


def thick_cylinder(
    elements: int = 40, *, ratio: float = 2.0, poisson_ratio: float = 0.3, steps: int = 12
) -> Curve:
    """Internal pressure over Y of a thick cylinder in plane strain, pushed to collapse at
    (2/sqrt(3)) Y ln(b/a); the exact curve is this limit throughout."""
    b, Y, E = ratio, 1.0, 1000.0
    column = radial_column(1.0, b, elements, sphere=False)
    path = Y / E * b**2 * np.linspace(0.1, 4.0, steps)
    done = push(column, law(E, poisson_ratio, Y), np.array([0]), path)
    direction = math.cos(SLICE)
    area = (2 * math.sin(SLICE)) * (2 * math.tan(SLICE))
    pressure = np.array([step.forces[0] for step in done]) / (area * direction)
    limit = 2 / math.sqrt(3) * math.log(b)
    return Curve(pressure, np.full(steps, limit), tuple(step.residuals for step in done))


def strip_punch(
    elements: int,
    *,
    poisson_ratio: float = 0.3,
    mean_dilatation: bool = True,
    steps: int = 6,
    domain: float = 5.0,
) -> Curve:
    """Mean pressure over Y under a smooth strip punch with `elements` to its half-width, in a
    domain of `domain` half-widths each way; exact: Prandtl's (2 + pi) k."""
    grid = np.linspace(0, domain, round(domain * elements) + 1)
    body = slice_body(grid, -grid, axisymmetric=False, mean_dilatation=mean_dilatation)
    return _punch(body, grid, elements, poisson_ratio, steps,
                  (2 + math.pi) / math.sqrt(3), 1.0)  # fmt: skip


def circular_punch(
    elements: int, *, poisson_ratio: float = 0.3, steps: int = 6, domain: float = 5.0
) -> Curve:
    """Mean pressure over Y under a smooth circular punch.  `exact` is Shield's 2.845 for the
    Tresca solid of the same Y, which bounds von Mises from below; 2/sqrt(3) of it from above."""
    grid = np.linspace(0, domain, round(domain * elements) + 1)
    body = slice_body(grid, -grid, axisymmetric=True)
    return _punch(body, grid, elements, poisson_ratio, steps, 2.845,
                  math.sin(SLICE) * math.cos(SLICE))  # fmt: skip


def _punch(
    body: SmallBody,
    grid: FloatArray,
    elements: int,
    poisson_ratio: float,
    steps: int,
    exact: float,
    area: float,
) -> Curve:
    Y, E = 1.0, 1000.0
    top = np.arange(elements + 1) * grid.size  # the nodes (i, level 0) under the punch
    path = -np.linspace(1 / steps, 1.0, steps) * 72 * Y / E
    done = push(body, law(E, poisson_ratio, Y), 2 * top + 1, path)
    force = -np.array([step.forces[2 * top + 1].sum() for step in done])
    return Curve(force / area, np.full(steps, exact), tuple(s.residuals for s in done))
