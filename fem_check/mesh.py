"""The periodic block: its nodes and layers, and the depth, grading and memory that a
scene needs.

Node (k nx + i) ny + j is at x = i hx, y = j hy and level k, level 0 being the rough top
and level nz the base.  A line becomes a block with one node along y, joined to itself:
no field can vary along y, which is plane strain.

Depth.  The block replaces a half-space if its base does not affect the longest wave.
For a wave exp(i q x), the compliance of a bonded layer of depth d differs from the
half-space's 2/(E* q) by a share that falls as exp(-2 q d) (Carbone and Mangialardi
2008).

Grading.  Waves decay over 1/q, so layers may thicken with depth.  The first is as thick
as the grid spacing, and each further one is thicker than the one above it by a ratio of
at most `GROWTH`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene, NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.results import FloatArray
from epcontact.scene import Scene
from fem_check.element import CORNERS, Elements, elements
from fem_check.options import FemOptions

#: Ratio of neighbouring layers.  Compared with equal layers as thin as the first, no
#: compliance changes by more than 0.7 % (tests/test_fem_elements.py).
GROWTH = 1.2


@dataclass(frozen=True)
class PeriodicBlock:
    """A periodic block; lengths in m.

    shape: (nx, ny) nodes of a level; ny = 1 is plane strain.  spacing: (hx, hy).  layers: (nz,)
    thicknesses from the top.  sliding: whether the base slides without friction; it is bonded
    otherwise.  moved: (nx, ny) heights to which the top nodes are moved, or None for a flat top.
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
            # The shift dies out linearly, so that no layer is squeezed more than
            # another.
            out[..., 2] += (1 + self.levels / self.depth)[:, None, None] * self.moved
        return out


def connectivity(block: PeriodicBlock) -> NDArray[np.int32]:
    """(elements, 8) node numbers, elements ordered [layer, x, y]."""
    nx, ny = block.shape
    k, i, j = np.meshgrid(
        np.arange(len(block.layers)),
        np.arange(nx),
        np.arange(ny),
        indexing="ij",
        sparse=True,
    )
    nodes = np.empty((len(block.layers), nx, ny, 8), dtype=np.int32)
    for a, (cx, cy, cz) in enumerate(CORNERS):
        nodes[..., a] = ((k + 1 - cz) * nx + (i + cx) % nx) * ny + (j + cy) % ny
    return nodes.reshape(-1, 8)


def flat_elements(block: PeriodicBlock) -> Elements:
    """The elements of the flat block: one shape a layer."""
    sides = np.stack(np.broadcast_arrays(*block.spacing, block.layers), axis=-1)
    shape_of = np.repeat(np.arange(len(block.layers)), math.prod(block.shape))
    return elements(connectivity(block), shape_of, CORNERS * sides[:, None])._replace(
        sides=sides
    )


def moved_elements(block: PeriodicBlock) -> Elements:
    """The elements of a block with a moved top, each of its own shape.  Raises
    InvalidScene.
    """
    nodes = connectivity(block)
    corners = block.positions().reshape(-1, 3)[nodes]
    cell = np.indices((len(block.layers), *block.shape)).reshape(3, -1)[1:]
    for axis, count in enumerate(
        block.shape
    ):  # unwrap the elements that reach over the edge
        reach = (cell[axis] + 1 == count)[:, None] & (CORNERS[:, axis] == 1)
        corners[..., axis] += reach * count * block.spacing[axis]
    try:
        return elements(nodes, np.arange(len(nodes)), corners)
    except ValueError as error:
        advice = "give a finer grid, a deeper block or geometry='gap'"
        raise InvalidScene(f"{error}; {advice}") from None


def half_space_depth(
    longest: float, poisson_ratio: float, tolerance: float = 1e-3
) -> float:
    """The smallest depth at which the `longest` wave differs from a half-space by
    `tolerance`.
    """
    nu = poisson_ratio

    def distance(t: float) -> float:
        c = (3 - 4 * nu) * math.cosh(2 * t) + 2 * t * t + 5 - 12 * nu + 8 * nu * nu
        return abs(((3 - 4 * nu) * math.sinh(2 * t) - 2 * t) / c - 1)

    # t = q d; beyond t = 1 the distance only falls.
    t = _bisected(lambda t: distance(t) > tolerance, 1.0, 20.0, 25)
    return t * longest / (2 * math.pi)


def _bisected(
    below: Callable[[float], bool], low: float, high: float, times: int
) -> float:
    """The upper end of the interval after `times` bisections by the condition
    `below`.
    """
    for _ in range(times):
        middle = (low + high) / 2
        low, high = (middle, high) if below(middle) else (low, middle)
    return high


def graded_layers(depth: float, first: float, count: int | None = None) -> FloatArray:
    """Thicknesses of a geometric series of layers from about `first` on; by default the
    fewest.
    """
    if count is None:
        count = math.ceil(math.log1p((GROWTH - 1) * depth / first) / math.log(GROWTH))
        count = max(2, count)
    layers = first * _ratio(depth / first, count) ** np.arange(count)
    return np.asarray(layers * (depth / layers.sum()))


def _ratio(total: float, count: int) -> float:
    """The ratio r >= 1 with 1 + r + ... + r^(count - 1) = total."""
    if count >= total:
        return 1.0
    most = math.pow(total, 1 / max(1, count - 1))  # as r^(count - 1) is below the total
    return _bisected(lambda r: sum(r**k for k in range(count)) < total, 1.0, most, 100)


def block_for(scene: Scene, options: FemOptions) -> PeriodicBlock:
    """The block for a scene.  Raises InvalidScene if the depth is not that of the
    scene's layer.
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
        layers=graded_layers(
            depth, options.first_layer or min(hx, hy, depth / 2), options.layers
        ),
        sliding=body.kind == "sliding_layer",
        moved=heights - heights.mean() if options.geometry == "moved" else None,
    )


def bytes_needed(
    scene: Scene,
    options: FemOptions,
    block: PeriodicBlock,
    rms_slope: float | None = None,
) -> float:
    """An estimate of the memory of a solve, in bytes; `rms_slope` replaces that of the
    surface.

    It counts the arrays that are alive in a linear solve.  A node keeps its element's
    connectivity, shape and place in the history (44 bytes), half of the factor (15
    numbers a wave) and six displacement fields (24 each); ten more end a few levels
    below the flow.  A layer keeps its stiffness (9 matrices).  An element that flows
    keeps its history and correction (970), and its nodes, up to 1.6 times as many, the
    rows of the tangent (2250).  Without flow seven fields are alive.  In the moved
    geometry an element keeps its own gradients (2900); there and under a punch all
    fields reach the base, and no rows are made.  The certificate takes 7000 bytes, or
    10000 with flow, for each element of a layer, after most of the fields have been
    given back.
    """
    surface, levels = math.prod(block.shape), len(block.layers) + 1
    moved, whole = block.moved is not None, options.geometry != "gap"
    flows = options.law == "j2"
    kept = levels * (44 + 15 * 8 / 2 + (2900 if moved else 0))
    solve = kept + levels * 7 * 24
    if flows:
        material = scene.material
        stiff = material.young_modulus / (1 - material.poisson_ratio**2)
        slope = scene.surface.rms_slope if rms_slope is None else rms_slope
        limit = material.yield_stress
        flow = flowing_shares(block, max(scene.load.path), limit, stiff * slope / limit)
        history, upper = 970 * float(flow.sum()), min(levels, int((flow > 0).sum()) + 3)
        rows = 0.0 if whole else 2250 * float(np.minimum(1.0, 1.6 * flow).sum())
        fields = 24 * (6 * levels + 10 * (levels if whole else upper))
        solve = (
            kept
            + fields
            + history
            + rows
            + 9 * 24 * 24 * 8 * len(block.layers) / surface
        )
        kept += history
    certificate = kept + levels * 6 * 24 + (10000 if flows else 7000)
    return surface * (max(solve, certificate) if options.certified else solve)


def flowing_shares(
    block: PeriodicBlock, mean_pressure: float, yield_stress: float, severity: float
) -> FloatArray:
    """(layers,) the share of each layer's elements that is expected to flow
    (test_fem_solve.py). At the surface it is .6 times mean_pressure/yield_stress at a
    `severity` E* xi/sigma_Y of 5, and 1.2 times at 50.  It falls to none at a depth
    that grows with the load and with the spacing.
    """
    load = mean_pressure / yield_stress
    at_top = min(1.0, 0.6 * min(max(severity / 5, 1.0), 10.0) ** 0.3 * load)
    longest = max(n * h for n, h in zip(block.shape, block.spacing, strict=True))
    middles = -(block.levels[1:] + block.levels[:-1]) / 2
    reach = (0.12 + 0.25 * load) * longest + 1.5 * max(block.spacing)
    shares: FloatArray = np.clip(at_top * (1 - (middles / reach) ** 1.5), 0.0, 1.0)
    return shares


def require_memory(scene: Scene, options: FemOptions, block: PeriodicBlock) -> None:
    """Raise NotEnoughMemory, before any array is made, if the block will not fit."""
    needed, free = bytes_needed(scene, options, block), available_memory()
    if needed > free:
        nx, ny = block.shape
        raise NotEnoughMemory(
            f"the block of {nx} x {ny} x {len(block.layers)} elements needs about "
            f"{needed / 2**30:.1f} GiB, but {free / 2**30:.1f} GiB are free; give fewer grid "
            "points or layers"
        )
