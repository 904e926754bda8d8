"""A rigid flat on an elastoplastic sphere: onset of yield and the mean pressure's rise.

The sphere is the paraboloid -r^2/(2 R) on a periodic block; neighbours at distance L act as extra
curvature, 1/R_eff = (1/R)(1 + 1.917 (a/L)^3), which these functions account for in what they ask
of the elastic solution, and which is below 1 % for a <= L/6.  The sphere stands off the grid's
nodes, so that no symmetry flatters the count of nodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.scene import Load, Material, Scene, Surface
from fem_check import plasticity
from fem_check.driver import solve, solve_path
from fem_check.vtu import von_mises

#: Contact radius over sphere radius at the Hertzian load: small strains.
_SLENDER = 0.05


@dataclass(frozen=True)
class SphereAnswer:
    """severity: E* a/(sigma_Y R) of the computed a; mean_pressure: over sigma_Y; force (N) and
    area (m^2) with R = 1 m and E = 1 Pa; newton_steps and cg_iterations of the whole path."""

    severity: float
    mean_pressure: float
    force: float
    area: float
    yield_stress: float
    newton_steps: int
    cg_iterations: int


def sphere_scene(
    force: float,
    *,
    nodes: int,
    nodes_to_rim: float,
    poisson_ratio: float,
    yield_stress: float,
    offset: tuple[float, float] = (0.21, 0.37),
) -> Scene:
    """A sphere of R = 1 m and E = 1 Pa under `force` (N); a contact of radius 0.05 m would have
    `nodes_to_rim` nodes along its radius.  offset: of its top from a node, in spacings."""
    period = nodes * _SLENDER / nodes_to_rim
    x, y = (((np.arange(nodes) + o) / nodes - 0.5) * period for o in offset)
    heights = -(x[:, None] ** 2 + y[None, :] ** 2) / 2
    return Scene(
        Surface(heights, (period, period)),
        Material(1.0, poisson_ratio, yield_stress=yield_stress),
        Load(force / period**2),
    )


def sphere(
    severity: float, *, nodes: int = 64, nodes_to_rim: float = 10.0, poisson_ratio: float = 0.3
) -> SphereAnswer:
    """The J2 sphere whose contact, at about E* a/(sigma_Y R) = `severity`, is `nodes_to_rim`
    nodes in radius."""
    effective = 1 / (1 - poisson_ratio**2)
    yield_stress = effective * _SLENDER / severity
    # A guess of the load: Hertz below, Johnson's cavity model above, 2.8 Y at most.
    guess = 0.4 * severity if severity < 3.5 else 2 / 3 * (1 + math.log(severity / 3))
    force = min(2.8, guess) * yield_stress * math.pi * _SLENDER**2
    scene = sphere_scene(force, nodes=nodes, nodes_to_rim=nodes_to_rim,
                         poisson_ratio=poisson_ratio, yield_stress=yield_stress)  # fmt: skip
    result = solve(scene, law="j2", steps=4, certified=False)
    area = result.final.areas["corrected"].total * scene.surface.periods[0] ** 2
    return SphereAnswer(
        effective * math.sqrt(area / math.pi) / yield_stress,
        force / area / yield_stress,
        force,
        area,
        yield_stress,
        int(result.cost["newton_steps"]),
        int(result.cost["cg_iterations"]),
    )


def sphere_onset(
    *,
    nodes: int = 64,
    nodes_to_rim: float = 10.0,
    poisson_ratio: float = 0.3,
    layers: int | None = None,
) -> tuple[float, float]:
    """(p_m/sigma_Y, depth over a) where an elastic sphere first yields, p_m = F/(pi a^2) with
    Hertz's a.  The elastic stresses scale with the pressure, so one solve is enough.

    Stresses are read at the elements' centres, where trilinear bricks have them to second order;
    at their Gauss points, where J2 asks for them, they are first order only, and the largest of
    them is too large.  Between the layers the largest one is that of the parabola through three.

    The block's sides cannot move apart: a mean pressure p presses them with nu/(1 - nu) p, where
    that of isolated spheres does so with (1 + 2 nu)/2 p in the mean (the limit of a long wave of
    pressure on a half-space near its surface, shared by both directions).  The tension between
    the two comes on top of the Mises stress on the axis and is taken off: 2 % at L = 8 a.

    layers: of the block, chosen as for any scene where not given.
    """
    effective = 1 / (1 - poisson_ratio**2)
    force = 4 / 3 * effective * _SLENDER**3
    scene = sphere_scene(force, nodes=nodes, nodes_to_rim=nodes_to_rim,
                         poisson_ratio=poisson_ratio, yield_stress=math.inf)  # fmt: skip
    path = solve_path(scene, law="elastic", layers=layers)
    bricks, state = path.problem.bricks, path.points[-1].state
    stress = plasticity.stresses(
        state.displacement.reshape(-1, 3),
        bricks,
        path.problem.law,
        None,
    )
    centre = von_mises(np.moveaxis(stress, 1, 2).mean(axis=1))
    levels = path.problem.block.levels
    depth, largest = _peak(
        -(levels[1:] + levels[:-1]) / 2, centre.reshape(-1, nodes * nodes).max(axis=1)
    )
    # With the periodic images' curvature, a Hertz contact of this force has this radius.
    image = 1 + 1.917 * (_SLENDER / scene.surface.periods[0]) ** 3
    radius = _SLENDER * image ** (-1 / 3)
    nu = poisson_ratio
    tension = ((1 + 2 * nu) / 2 - nu / (1 - nu)) * scene.load.final
    return force / (math.pi * radius**2) / (largest - tension), depth / radius


def _peak(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Where the parabola through the largest of y and its neighbours has its top, and the top."""
    k = min(max(int(y.argmax()), 1), y.size - 2)
    curve = np.polynomial.Polynomial.fit(x[k - 1 : k + 2], y[k - 1 : k + 2], 2)
    top = float(curve.deriv().roots()[0].real)
    return top, float(curve(top))
