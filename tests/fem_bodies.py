"""Bodies of bricks with known limit loads: thick sphere, thick cylinder, circular punch."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp

from fem_check.benchmarks.limit_loads import SLICE, Curve, SmallBody, punch, push, slice_body
from fem_check.element import CORNERS, elements
from fem_check.plasticity import law


def radial_column(inner: float, outer: float, count: int, *, sphere: bool = True) -> SmallBody:
    """A thick sphere or, in plane strain, cylinder: unknown i moves the radius r_i outward.

    The radii are spaced in a geometric series.
    """
    radii = np.geomspace(inner, outer, count + 1)
    directions = []
    for cx, cy in ((0, 0), (0, 1), (1, 0), (1, 1)):
        across = np.array([(2 * cx - 1) * np.tan(SLICE), (2 * cy - 1) * np.tan(SLICE), 1.0])
        if not sphere:
            across[1] = 0.0
        directions.append(across / np.linalg.norm(across))
    corner = 2 * CORNERS[:, 0] + CORNERS[:, 1]
    nodes = 4 * (np.arange(count)[:, None] + CORNERS[:, 2]) + corner
    points = (radii[:, None, None] * np.array(directions)).reshape(-1, 3)
    if not sphere:
        points[:, 1] += np.tile([0.0, 1.0, 0.0, 1.0], count + 1) * 2 * inner * np.tan(SLICE)
    rows = np.arange(12 * (count + 1))
    motion = sp.csr_matrix(
        (np.tile(np.ravel(directions), count + 1), (rows, rows // 12)),
        shape=(rows.size, count + 1),
    )
    bricks = elements(nodes, np.arange(count), points[nodes])
    return SmallBody(bricks, motion, np.empty(0, dtype=np.int64))


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


def circular_punch(
    elements: int, *, poisson_ratio: float = 0.3, steps: int = 6, domain: float = 5.0
) -> Curve:
    """Mean pressure over Y under a smooth circular punch.  `exact` is Shield's 2.845 for the
    Tresca solid of the same Y, which bounds von Mises from below; 2/sqrt(3) of it from above."""
    grid = np.linspace(0, domain, round(domain * elements) + 1)
    body = slice_body(grid, -grid, axisymmetric=True)
    return punch(body, grid, elements, poisson_ratio, steps, 2.845,
                  math.sin(SLICE) * math.cos(SLICE))  # fmt: skip
