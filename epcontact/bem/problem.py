"""The capped contact problem on plain arrays, the options of its solution, and the
solution.

Minimise 1/2 <p, S p> - <p, h> over 0 <= p <= hardness with mean(p) = p0 on a periodic
grid or line; S is diagonal in Fourier space.  The minimiser is unique.  hardness = inf
is the elastic problem (Kalker's variational principle; the cap after Tian and Bhushan,
1996).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.transforms import Symbol
from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import array, settle, share, whole

#: The largest factor by which a user's compliance may fall from a wave to the one of
#: half its length: 1/q^1.5 takes 10 to 25 pairs of transforms on the finest grid, 1/q^2
#: takes 1100.
STEEPEST = 3.0

Method = Literal["newton", "relaxation", "polonsky_keer", "projected_gradient"]
#: The solver's own method, and the baselines it is measured against.
METHODS: tuple[str, ...] = get_args(Method)


@dataclass(frozen=True, eq=False)
class GridProblem:
    """One contact problem on a periodic grid."""

    heights: FloatArray  # (nx, ny) in m; a line is (1, n)
    symbol: Symbol  # surface compliance of each mode, in m/Pa
    mean_pressure: float  # in Pa, above 0
    hardness: float = (
        math.inf
    )  # in Pa, above the mean pressure; infinite for an elastic body

    @property
    def cap(self) -> float:
        """The hardness in units of the mean pressure."""
        return self.hardness / self.mean_pressure

    def gap_scale(self) -> float:
        """The length in m by which gap residuals are divided: the rms height, as a
        rule.

        If it is below a millionth of p0 dx / E*, it is p0 dx / E* instead: p resolves
        its fluctuation about p0 to eps p0 only, so gaps below eps p0 dx / E* are
        rounding.
        """
        floor = self.mean_pressure * self.symbol.shortest() * math.pi / 2
        rms = float(np.std(self.heights))
        return rms if rms > 1e-6 * floor else floor


@dataclass(frozen=True)
class Options:
    """The options of a solve.

    Attributes:
        tolerance: on the Karush-Kuhn-Tucker residuals, dimensionless.
        area_tolerance: stop as soon as the areas are settled to this relative change;
            None: stop only when the residuals meet `tolerance`.
        threads: number of threads.
        method: "newton", or the name of a baseline.
        max_steps: most steps of the method; None: the method's own limit.
        progress: called now and then with the grid's shape and the residual on it.

    Raises:
        InvalidScene: an option is out of its range.
    """

    tolerance: float = 1e-8
    area_tolerance: float | None = None
    threads: int = 1
    method: str = "newton"
    max_steps: int | None = None
    progress: Callable[[tuple[int, ...], float], None] | None = field(
        default=None, compare=False
    )

    def __post_init__(self) -> None:
        settle(self, tolerance=share("tolerance", self.tolerance))
        if self.area_tolerance is not None:
            settle(self, area_tolerance=share("area_tolerance", self.area_tolerance))
        settle(self, threads=whole("threads", self.threads, 1))
        if self.max_steps is not None:
            settle(self, max_steps=whole("max_steps", self.max_steps, 1))
        if self.method not in METHODS:
            methods = ", ".join(METHODS)
            raise InvalidScene(
                f"method is {self.method!r}, but must be one of {methods}"
            )


@dataclass(frozen=True)
class PressureSolution:
    """The answer at one mean pressure, on the grid of the heights.

    Attributes:
        pressure: in Pa.
        displacement: downward, in m, without its mean.
        offset: height z of the flat in m; the gap is displacement + offset - heights.
        residuals: see `level.kkt_residuals`.
        counts: newton, cg and gradient steps and fft_pairs on the finest grid;
            equivalent_fft_pairs of all grids, by their points; levels, the number of
            grids.
        history: the largest residual after each step.
        notes: sentences about fallbacks that were taken.
    """

    pressure: FloatArray
    displacement: FloatArray
    offset: float
    residuals: Mapping[str, float]
    counts: Mapping[str, float]
    history: tuple[float, ...]
    notes: tuple[str, ...] = ()

    def gap(self, heights: FloatArray) -> FloatArray:
        """The gap in m over heights of the grid's shape; no other array is made."""
        gap = np.subtract(self.offset, heights)
        gap += self.displacement.reshape(heights.shape)
        return np.asarray(gap)


def checked_symbol(compliance: NDArray[np.floating], shape: tuple[int, ...]) -> Symbol:
    """A user's compliance per mode of `numpy.fft.rfftn` as a Symbol; a line becomes (1,
    n).
    """
    values = np.atleast_2d(array("compliance", compliance).copy())
    grid = (1, shape[0]) if len(shape) == 1 else (shape[0], shape[1])
    expected = (grid[0], grid[1] // 2 + 1)
    if values.shape != expected:
        raise InvalidScene(
            f"compliance has shape {np.shape(compliance)}, but one value per mode of the real "
            f"transform of {shape} heights is needed: {expected}"
        )
    good = np.isfinite(values) & (values > 0)
    good[0, 0] = np.isfinite(values[0, 0]) and values[0, 0] >= 0
    if not good.all():
        raise InvalidScene(
            "compliance must be finite and positive in every mode but the mean"
        )
    edges = [0] if grid[1] % 2 else [0, grid[1] // 2]
    mirrored = values[:, edges][-np.arange(grid[0])]
    if not np.allclose(values[:, edges], mirrored, rtol=1e-12, atol=0):
        raise InvalidScene("compliance differs between a mode and its mirror image")
    _require_gradual(values, grid)
    return Symbol(values, np.arange(grid[0], dtype=np.int32), grid)


def _require_gradual(values: FloatArray, grid: tuple[int, int]) -> None:
    """Refuse a compliance that falls too fast from a wave to the one of half its
    length: the pressures of short waves would be out of all proportion, and a solve
    would not end.
    """
    nx, ny = grid
    for name, (a, b) in {
        "first axis": (1, 0),
        "second axis": (0, 1),
        "diagonal": (1, 1),
    }.items():
        k = np.arange(1, min(n // 2 for n, used in ((nx, a), (ny, b)) if used) + 1)
        along = values[a * k, b * k]
        fall = along[: k.size // 2] / along[1::2]
        worst = int(np.argmax(fall)) if fall.size else 0
        if fall.size and fall[worst] > STEEPEST:
            raise InvalidScene(
                f"compliance falls by a factor of {fall[worst]:.3g} from mode {worst + 1} to mode "
                f"{2 * worst + 2} along the {name}, but the solver needs one that falls by at "
                f"most {STEEPEST:g} from a wave to the one of half its length (a half-space's "
                "falls by 2)"
            )


def checked_start(given: NDArray[np.floating], shape: tuple[int, ...]) -> FloatArray:
    """A user's start pressure as a float64 array, -inf where it is exactly 0.  A point
    without pressure stays apart: rounding of the load would else bring it into contact.
    """
    start = checked_field("start", given, shape, "finite pressures", -math.inf)
    return np.where(start == 0, -math.inf, start)


def checked_field(
    name: str,
    given: NDArray[np.floating],
    shape: tuple[int, ...],
    right: str,
    least: float,
) -> FloatArray:
    """A user's field as a float64 array, refused unless finite and nowhere below
    `least`.
    """
    values = array(name, given).copy()
    if values.shape != shape or not (
        np.isfinite(values).all() and values.min() >= least
    ):
        raise InvalidScene(
            f"{name} has shape {np.shape(given)}, but {right} in an array of shape {shape} are "
            "needed"
        )
    return values
