"""The periodic block: its nodes and layers, and the depth and grading that a scene needs.

Nodes are numbered level by level from the top: node (k nx + i) ny + j is at x = i hx,
y = j hy and level k, level 0 being the rough top and level nz the base.  A line becomes a block
with one node along y, joined to itself: no field can vary along y, which is plane strain.

Depth.  The block replaces a half-space if its base does not affect the longest wave.  The
compliance of a bonded layer of depth d differs from the half-space's 2/(E* q), for a wave
exp(i q x), by a share that falls as exp(-2 q d) (Carbone and Mangialardi 2008).
`half_space_depth` returns the smallest depth at which the share is `tolerance` for the longest
wave, q = 2 pi / max(period).

Grading.  Waves decay over 1/q, so layers may thicken with depth as long as they resolve the waves
that are left there.  The first is as thick as the grid spacing, and each further one is thicker
than the one above it by a ratio of at most `GROWTH`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Scene
from fem_check.element import CORNERS, Elements, elements
from fem_check.options import FemOptions

#: Ratio of neighbouring layers.  Compared with equal layers as thin as the first, no compliance
#: changes by more than 0.7 % (tests/test_fem_elements.py); on a rough J2 scene of 64 x 64 nodes,
#: going from 1.08 to 1.2 changed the pressure quantiles by 0.2 % and no node's contact.
GROWTH = 1.2


@dataclass(frozen=True)
class PeriodicBlock:
    """A periodic block.

    shape: (nx, ny) nodes of a level; ny = 1 is plane strain.
    spacing: (hx, hy) in m.
    layers: (nz,) thicknesses from the top, in m.
    sliding: whether the base slides without friction; it is bonded otherwise.
    moved: (nx, ny) heights to which the top nodes are moved, in m, or None for a flat top.
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    layers: FloatArray
    sliding: bool = False
    moved: FloatArray | None = None

    @property
    def depth(self) -> float:
        """Distance from the reference top to the base, in m."""
        return float(np.sum(self.layers))

    @property
    def node_area(self) -> float:
        """Nominal area of a top node, in m^2; a line has the width hy."""
        return self.spacing[0] * self.spacing[1]

    @property
    def levels(self) -> FloatArray:
        """(nz + 1,) heights of the levels: 0 on top, -depth at the base."""
        return -np.concatenate([[0.0], np.cumsum(self.layers)])

    @property
    def field_shape(self) -> tuple[int, int, int, int]:
        """Shape of a displacement field: (nz + 1, nx, ny, 3)."""
        return (len(self.layers) + 1, *self.shape, 3)

    def positions(self) -> FloatArray:
        """(nz + 1, nx, ny, 3) reference positions of the nodes, in m."""
        nx, ny = self.shape
        out = np.empty(self.field_shape)
        out[..., 0] = (np.arange(nx) * self.spacing[0])[:, None]
        out[..., 1] = np.arange(ny) * self.spacing[1]
        out[..., 2] = self.levels[:, None, None]
        if self.moved is not None:
            # The shift dies out linearly, so that no layer is squeezed more than another.
            out[..., 2] += (1 + self.levels / self.depth)[:, None, None] * self.moved
        return out


def connectivity(block: PeriodicBlock) -> NDArray[np.int32]:
    """(elements, 8) node numbers, elements ordered [layer, x, y]."""
    nx, ny = block.shape
    k, i, j = np.meshgrid(
        np.arange(len(block.layers)), np.arange(nx), np.arange(ny), indexing="ij", sparse=True
    )
    nodes = np.empty((len(block.layers), nx, ny, 8), dtype=np.int32)
    for a, (cx, cy, cz) in enumerate(CORNERS):
        nodes[..., a] = ((k + 1 - cz) * nx + (i + cx) % nx) * ny + (j + cy) % ny
    return nodes.reshape(-1, 8)


def flat_elements(block: PeriodicBlock) -> Elements:
    """The elements of the flat block: one shape a layer."""
    hx, hy = block.spacing
    per_layer = block.shape[0] * block.shape[1]
    sizes = np.stack(np.broadcast_arrays(hx, hy, block.layers), axis=-1)
    corners = CORNERS[None] * sizes[:, None, :]
    shape_of = np.repeat(np.arange(len(block.layers)), per_layer)
    return elements(connectivity(block), shape_of, corners)._replace(sides=sizes.copy())


def moved_elements(block: PeriodicBlock) -> Elements:
    """The elements of a block whose top nodes are moved: every one has its own shape.

    Raises InvalidScene if an element is turned inside out.
    """
    nodes = connectivity(block)
    corners = block.positions().reshape(-1, 3)[nodes]
    nx, ny = block.shape
    lengths = (nx * block.spacing[0], ny * block.spacing[1])
    cell = np.indices((len(block.layers), nx, ny)).reshape(3, -1)
    for axis in (0, 1):  # unwrap the elements that reach over the edge
        reach = (cell[axis + 1] + 1 == block.shape[axis])[:, None] & (CORNERS[:, axis] == 1)
        corners[..., axis] += reach * lengths[axis]
    try:
        return elements(nodes, np.arange(len(nodes)), corners)
    except ValueError as error:
        raise InvalidScene(
            f"{error}; give a finer grid, a deeper block or geometry='gap'"
        ) from None


def half_space_depth(longest: float, poisson_ratio: float, tolerance: float = 1e-3) -> float:
    """The smallest depth at which a bonded layer can replace a half-space.

    The compliances of the `longest` wave then differ by the share `tolerance`.
    """
    nu = poisson_ratio

    def distance(t: float) -> float:
        c = (3 - 4 * nu) * math.cosh(2 * t) + 2 * t * t + 5 - 12 * nu + 8 * nu * nu
        return abs(((3 - 4 * nu) * math.sinh(2 * t) - 2 * t) / c - 1)

    low, high = 1.0, 20.0  # t = q d; beyond t = 1 the distance only falls
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if distance(middle) > tolerance else (low, middle)
    return high * longest / (2 * math.pi)


def graded_layers(
    depth: float, first: float, count: int | None = None, growth: float = GROWTH
) -> FloatArray:
    """Thicknesses of layers that fill a depth in a geometric series from about `first` on.

    By default they are the fewest with a ratio of at most `growth` between neighbours.
    """
    if count is None:
        exact = math.log1p((growth - 1) * depth / first) / math.log(growth)
        count = max(2, math.ceil(exact))
    ratio = _ratio(depth / first, count)
    layers = first * ratio ** np.arange(count)
    return np.asarray(layers * (depth / layers.sum()))


def _ratio(total: float, count: int) -> float:
    """The ratio r >= 1 with 1 + r + ... + r^(count - 1) = total, by bisection."""
    if count >= total:
        return 1.0
    low, high = 1.0, math.pow(total, 1 / max(1, count - 1))  # as r^(count - 1) is below the total
    for _ in range(100):
        middle = (low + high) / 2
        reached = sum(middle**k for k in range(count))
        low, high = (middle, high) if reached < total else (low, middle)
    return (low + high) / 2


def block_for(scene: Scene, options: FemOptions) -> PeriodicBlock:
    """The block for a scene; see the module's docstring for its depth and grading.

    Raises InvalidScene if the depth is not that of the scene's layer.
    """
    surface, body, depth = scene.surface, scene.body, options.depth
    if body.kind != "half_space":
        if depth is not None and depth != body.depth:
            raise InvalidScene(
                f"depth is {depth:g} m, but the scene's {body.kind} is {body.depth:g} m deep"
            )
        depth = body.depth
    elif depth is None:
        depth = half_space_depth(max(surface.periods), scene.material.poisson_ratio)
    line = surface.heights.ndim == 1
    hx, hy = surface.spacing * 2 if line else surface.spacing
    heights = surface.heights[:, None] if line else surface.heights
    return PeriodicBlock(
        shape=(heights.shape[0], heights.shape[1]),
        spacing=(hx, hy),
        layers=graded_layers(depth, options.first_layer or min(hx, hy, depth / 2), options.layers),
        sliding=body.kind == "sliding_layer",
        moved=heights - heights.mean() if options.geometry == "moved" else None,
    )
