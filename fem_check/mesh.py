"""The periodic block: nodes, layers, and the depth and memory that a scene needs.

Node (k nx + i) ny + j is at x = i hx, y = j hy and level k.  Level 0 is the rough top,
level nz is the base.  A line becomes a block with one node along y, which is its own
neighbour: no field can vary along y, which is plane strain.

Depth.  The block replaces a half-space if its base does not affect the longest wave.
For a wave exp(i q x), the compliance of a bonded layer of depth d differs from the
half-space's 2/(E* q) by a fraction that falls as exp(-2 q d) (Carbone and Mangialardi
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
from fem_check.element import CORNERS, Elements, elements_of
from fem_check.options import FemOptions

#: Largest ratio of the thicknesses of neighbouring layers.  Compared with equal layers
#: as thin as the first, no compliance changes by more than 0.7 %
#: (tests/test_fem_elements.py).
GROWTH = 1.2

#: Number of elements that the certificate checks at once, but at least a row of them.
CERTIFIED_AT_ONCE = 4096


@dataclass(frozen=True)
class PeriodicBlock:
    """A periodic block of bricks in layers.

    Attributes:
        shape: (nx, ny) numbers of nodes of a level; ny = 1 is plane strain.
        spacing: (hx, hy) distances between nodes, in m.
        layers: (nz,) thicknesses from the top, in m.
        sliding: whether the base slides without friction; it is bonded otherwise.
        moved: (nx, ny) heights in m to which the top nodes are moved; None: the top is
            flat.
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    layers: FloatArray
    sliding: bool = False
    moved: FloatArray | None = None

    @property
    def depth(self) -> float:
        """Distance from the block's flat top to its base, in m."""
        return float(np.sum(self.layers))

    @property
    def node_area(self) -> float:
        """Nominal area of a top node of the block, in m^2.

        A line, with one node along y, has the width hy.
        """
        return self.spacing[0] * self.spacing[1]

    @property
    def levels(self) -> FloatArray:
        """(nz + 1,) heights of the levels in m: 0 at the top, -depth at the base."""
        return -np.concatenate([[0.0], np.cumsum(self.layers)])

    @property
    def field_shape(self) -> tuple[int, int, int, int]:
        """Shape of a displacement field of the block: (nz + 1, nx, ny, 3)."""
        return (len(self.layers) + 1, *self.shape, 3)

    def positions(self) -> FloatArray:
        """Return the undeformed positions of the block's nodes, in m.

        They are (nz + 1, nx, ny, 3): level from the top, node along x and y, and x, y,
        z.
        """
        nx, ny = self.shape
        positions = np.empty(self.field_shape)
        positions[..., 0] = (np.arange(nx) * self.spacing[0])[:, None]
        positions[..., 1] = np.arange(ny) * self.spacing[1]
        positions[..., 2] = self.levels[:, None, None]
        if self.moved is not None:
            # The shift decreases linearly with depth: all layers are squeezed alike.
            fraction = 1 + self.levels / self.depth
            positions[..., 2] += fraction[:, None, None] * self.moved
        return positions


def connectivity(block: PeriodicBlock) -> NDArray[np.int32]:
    """Return (nz nx ny, 8) node numbers of the block's elements.

    Elements are ordered [layer, x, y]; the corners of an element have the order of
    CORNERS. The last elements along x and y join the first nodes.
    """
    nx, ny = block.shape
    nz = len(block.layers)
    k, i, j = np.ogrid[:nz, :nx, :ny]
    nodes = np.empty((nz, nx, ny, 8), dtype=np.int32)
    for a, (x, y, z) in enumerate(CORNERS):
        nodes[..., a] = ((k + 1 - z) * nx + (i + x) % nx) * ny + (j + y) % ny
    return nodes.reshape(-1, 8)


def flat_elements(block: PeriodicBlock) -> Elements:
    """Return the elements of the block with a flat top: one shape per layer."""
    sides = np.stack(np.broadcast_arrays(*block.spacing, block.layers), axis=-1)
    shape_of = np.repeat(np.arange(len(block.layers)), math.prod(block.shape))
    bricks = elements_of(connectivity(block), shape_of, CORNERS * sides[:, None])
    return bricks._replace(sides=sides)


def moved_elements(block: PeriodicBlock) -> Elements:
    """Return the elements of a block with a moved top, each with its own shape.

    Args:
        block: the block, with heights to which the top nodes are moved.

    Raises:
        InvalidScene: the top is so rough that an element is turned inside out.
    """
    nodes = connectivity(block)
    corners = block.positions().reshape(-1, 3)[nodes]
    cell = np.indices((len(block.layers), *block.shape)).reshape(3, -1)[1:]
    for axis, count in enumerate(block.shape):
        # The last elements along an axis reach over the edge to the first nodes.
        last = (cell[axis] + 1 == count)[:, None]
        beyond_edge = last & (CORNERS[:, axis] == 1)
        corners[..., axis] += beyond_edge * count * block.spacing[axis]
    try:
        return elements_of(nodes, np.arange(len(nodes)), corners)
    except ValueError as error:
        assert block.moved is not None
        valley = -float(block.moved.min())
        raise InvalidScene(
            f"{error}: the deepest valley is {valley:.3g} m below the mean height, and "
            f"the block is {block.depth:.3g} m deep; give a depth of more than "
            f"{valley:.3g} m, several times as deep for a good mesh, or geometry='gap'"
        ) from None


def half_space_depth(
    longest: float, poisson_ratio: float, tolerance: float = 1e-3
) -> float:
    """Return the smallest depth at which a bonded block replaces a half-space, in m.

    Args:
        longest: longest wavelength of the surface, in m.
        poisson_ratio: of the solid.
        tolerance: allowed relative difference of the longest wave's compliance from
            that of the half-space.
    """
    nu = poisson_ratio

    def difference(t: float) -> float:
        """Return the relative difference of the compliances at t = q d."""
        c = (3 - 4 * nu) * math.cosh(2 * t) + 2 * t * t + 5 - 12 * nu + 8 * nu * nu
        return abs(((3 - 4 * nu) * math.sinh(2 * t) - 2 * t) / c - 1)

    # Beyond t = 1 the difference only falls.
    t = _bisect(lambda t: difference(t) > tolerance, 1.0, 20.0, 25)
    return t * longest / (2 * math.pi)


def _bisect(
    is_below: Callable[[float], bool], low: float, high: float, times: int
) -> float:
    """Return the upper end of an interval after `times` bisections.

    Args:
        is_below: returns whether a value is below the point that is sought.
        low: lower end of the interval, at or below the point.
        high: upper end of the interval.
        times: number of bisections.
    """
    for _ in range(times):
        middle = (low + high) / 2
        if is_below(middle):
            low = middle
        else:
            high = middle
    return high


def graded_layers(depth: float, first: float, count: int | None = None) -> FloatArray:
    """Return thicknesses of layers that form a geometric series, in m, from the top.

    Args:
        depth: their sum, in m.
        first: thickness of the first layer, in m, which is met approximately.
        count: number of layers; None: the fewest, at least two, whose ratio is at most
            `GROWTH` (1.2).
    """
    if count is None:
        fewest = math.log1p((GROWTH - 1) * depth / first) / math.log(GROWTH)
        count = max(2, math.ceil(fewest))
    layers = first * _ratio(depth / first, count) ** np.arange(count)
    return np.asarray(layers * (depth / layers.sum()))


def _ratio(total: float, count: int) -> float:
    """Return the ratio r >= 1 with 1 + r + ... + r^(count - 1) = total.

    Args:
        total: of the series, dimensionless.
        count: number of its terms; if it is at least the total, the ratio is 1.
    """
    if count >= total:
        return 1.0
    # The last term r^(count - 1) is below the total, which bounds r.
    bound = math.pow(total, 1 / max(1, count - 1))
    return _bisect(lambda r: sum(r**k for k in range(count)) < total, 1.0, bound, 100)


def block_for(scene: Scene, options: FemOptions) -> PeriodicBlock:
    """Return the periodic block of elements for a scene.

    A half-space is replaced by a block that is deep enough.  A layer has its own depth.
    A line gets one node along y, with the spacing of x.

    Args:
        scene: the surface, the material and the body.
        options: depth, number of layers, thickness of the first layer, and geometry.

    Raises:
        InvalidScene: the depth of the options is not that of the scene's layer.
    """
    surface = scene.surface
    body = scene.body
    depth = options.depth
    if body.kind != "half_space":
        if depth is not None and depth != body.depth:
            raise InvalidScene(
                f"depth is {depth:g} m, but the scene's {body.kind} is "
                f"{body.depth:g} m deep"
            )
        depth = body.depth
    elif depth is None:
        depth = half_space_depth(max(surface.periods), scene.material.poisson_ratio)
    heights = surface.heights
    spacing = surface.spacing
    if heights.ndim == 1:
        heights = heights[:, None]
        spacing = spacing * 2  # a tuple: (h, h)
    nx, ny = heights.shape
    hx, hy = spacing
    first = options.first_layer or min(hx, hy, depth / 2)
    moved = None
    if options.geometry == "moved":
        moved = heights - heights.mean()
    return PeriodicBlock(
        shape=(nx, ny),
        spacing=(hx, hy),
        layers=graded_layers(depth, first, options.layers),
        sliding=body.kind == "sliding_layer",
        moved=moved,
    )


def bytes_needed(
    scene: Scene,
    options: FemOptions,
    block: PeriodicBlock,
    rms_slope: float | None = None,
) -> float:
    """Estimate the memory of a solve, in bytes.

    The estimate counts the arrays that are alive in a linear solve.  A node keeps its
    element's connectivity, shape and position in the history (44 bytes), half of the
    factor (15 numbers per wave) and six displacement fields (24 each); ten more fields
    end a few levels below the flow.  A layer keeps its stiffness (9 matrices).  An
    element that flows keeps two histories and a correction (1420), and its nodes, up to
    1.6 times as many, keep the rows of the tangent (2250).  Without flow seven fields
    are alive.  In the moved geometry an element keeps its own gradients (2900); there
    and under a punch all fields reach the base, and no rows are assembled.  The
    certificate takes 53 kB for each element that it checks at once, after most of the
    fields have been freed.

    Args:
        scene: the scene.
        options: of the solve.
        block: the block for the scene.
        rms_slope: that is assumed; None: that of the surface.
    """
    nodes = math.prod(block.shape)
    levels = len(block.layers) + 1
    flat = options.geometry == "gap"
    plastic = options.law == "j2"
    # Bytes per node of the surface.
    permanent = levels * (44 + 15 * 8 / 2)
    if block.moved is not None:
        permanent += levels * 2900
    solve = permanent + levels * 7 * 24
    if plastic:
        flow = _expected_flow(scene, block, rms_slope)
        history = 1420 * float(flow.sum())
        flow_levels = levels
        rows = 0.0
        if flat:
            flow_levels = min(levels, int((flow > 0).sum()) + 3)
            rows = 2250 * float(np.minimum(1.0, 1.6 * flow).sum())
        fields = 24 * (6 * levels + 10 * flow_levels)
        stiffness = 9 * 24 * 24 * 8 * len(block.layers) / nodes
        solve = permanent + fields + history + rows + stiffness
        permanent += history
    if not options.certified:
        return nodes * solve
    at_once = min(nodes, CERTIFIED_AT_ONCE + block.shape[1])
    checked = nodes * (permanent + levels * 6 * 24) + 53_000 * at_once
    return max(nodes * solve, checked)


def _expected_flow(
    scene: Scene, block: PeriodicBlock, rms_slope: float | None
) -> FloatArray:
    """Return the (nz,) fractions of the layers' elements that flow at the largest load.

    They are an estimate, between 0 and 1.

    Args:
        scene: with a finite yield stress, and with its load path.
        block: the block for the scene, with nz layers.
        rms_slope: rms slope of the surface that is assumed; None: that of the surface.
    """
    material = scene.material
    yield_stress = material.yield_stress
    modulus = material.young_modulus / (1 - material.poisson_ratio**2)
    if rms_slope is None:
        rms_slope = scene.surface.rms_slope
    severity = modulus * rms_slope / yield_stress
    return flowing_fractions(block, max(scene.load.path), yield_stress, severity)


def flowing_fractions(
    block: PeriodicBlock, mean_pressure: float, yield_stress: float, severity: float
) -> FloatArray:
    """Estimate the fraction of each layer's elements that flow.

    The severity is the ratio of the elastic pressure scale E* xi to the yield stress.
    At the surface the fraction is 0.6 times mean_pressure/yield_stress at a severity of
    5, and 1.2 times at 50.  It falls to zero at a depth that grows with the load and
    with the spacing.  tests/test_fem_solve.py compares it with solves.

    Args:
        block: the block, with nz layers.
        mean_pressure: largest mean pressure of the path, in Pa.
        yield_stress: in uniaxial tension, in Pa.
        severity: E* xi/sigma_Y with the effective modulus E* and the rms slope xi.

    Returns:
        (nz,) fractions from 0 to 1, from the top layer down.
    """
    load = mean_pressure / yield_stress
    steepness = min(max(severity / 5, 1.0), 10.0)
    at_top = min(1.0, 0.6 * steepness**0.3 * load)
    period = max(n * h for n, h in zip(block.shape, block.spacing, strict=True))
    middles = -(block.levels[1:] + block.levels[:-1]) / 2
    reach = (0.12 + 0.25 * load) * period + 1.5 * max(block.spacing)
    fractions: FloatArray = np.clip(at_top * (1 - (middles / reach) ** 1.5), 0.0, 1.0)
    return fractions


def require_memory(scene: Scene, options: FemOptions, block: PeriodicBlock) -> None:
    """Check, before any array is allocated, that a solve fits into the free memory.

    Args:
        scene: the surface, the material and the load path.
        options: of the solve.
        block: the block for the scene.

    Raises:
        NotEnoughMemory: the estimated memory of the solve is more than the free memory.
    """
    needed = bytes_needed(scene, options, block)
    free = available_memory()
    if needed > free:
        nx, ny = block.shape
        raise NotEnoughMemory(
            f"the block of {nx} x {ny} x {len(block.layers)} elements needs about "
            f"{needed / 2**30:.1f} GiB, but {free / 2**30:.1f} GiB are free; give "
            "fewer grid points or layers"
        )
