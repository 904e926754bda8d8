"""The capped contact problem on plain arrays, its options and its solution.

Minimise 1/2 <p, S p> - <p, h> over 0 <= p <= hardness with mean(p) = p0 on a periodic
grid or line.  S is diagonal in Fourier space, and the minimiser is unique.  hardness =
inf is the elastic problem (Kalker's variational principle; the cap is that of Tian and
Bhushan, 1996).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.transforms import Symbol
from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import array, fraction, integer, set_frozen

#: The largest factor by which a user's compliance may fall from a wave to the wave of
#: half its length: 1/q^1.5 takes 10 to 25 pairs of transforms on the finest grid, 1/q^2
#: takes 1100.
STEEPEST = 3.0

#: A method that solves in the place of Newton's: a function of a `level.Level`, a
#: feasible pressure (nx, ny) in units of the mean pressure, which it may overwrite, and
#: the `Options`, that returns a `level.Iterate`.
Method = Callable[[Any, FloatArray, "Options"], Any]
# Gap residuals are divided by the rms height, if this is more than so many times p0 dx
# / E*.
_RESOLVED_HEIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class GridProblem:
    """One contact problem on a periodic grid.

    Attributes:
        heights: (nx, ny) in m; a line is (1, n).
        symbol: surface compliance of each mode, in m/Pa.
        mean_pressure: in Pa, above 0.
        hardness: in Pa, above the mean pressure; infinite for an elastic body.
    """

    heights: FloatArray
    symbol: Symbol
    mean_pressure: float
    hardness: float = math.inf

    @property
    def cap(self) -> float:
        """The hardness in units of the mean pressure."""
        return self.hardness / self.mean_pressure

    def gap_scale(self) -> float:
        """Return the length in m by which gap residuals are divided.

        It is the rms height, unless this is below a millionth of p0 dx / E*; then it is
        p0 dx / E*.  A pressure resolves its fluctuation about p0 to eps p0 only, so
        gaps below eps p0 dx / E* are rounding.
        """
        per_spacing = self.mean_pressure * self.symbol.shortest() * math.pi / 2
        rms_height = float(np.std(self.heights))
        if rms_height > _RESOLVED_HEIGHT * per_spacing:
            return rms_height
        return per_spacing


@dataclass(frozen=True)
class Options:
    """The options of a solve.

    Attributes:
        tolerance: on the Karush-Kuhn-Tucker residuals, dimensionless.
        area_tolerance: stop as soon as no area changes by more than this fraction;
            None: stop only when the residuals meet `tolerance`.
        threads: number of threads.
        method: solves in the place of Newton's method, from a uniform pressure and
            without coarser grids; None: Newton's method.
        max_steps: most steps of the method; None: the method's own limit.
        progress: called now and then with the grid's shape and the residual on it.

    Raises:
        InvalidScene: an option is out of its range.
    """

    tolerance: float = 1e-8
    area_tolerance: float | None = None
    threads: int = 1
    method: Method | None = None
    max_steps: int | None = None
    progress: Callable[[tuple[int, ...], float], None] | None = field(
        default=None, compare=False
    )

    def __post_init__(self) -> None:
        """Check the options; raise InvalidScene if one is out of its range."""
        set_frozen(self, tolerance=fraction("tolerance", self.tolerance))
        if self.area_tolerance is not None:
            set_frozen(
                self, area_tolerance=fraction("area_tolerance", self.area_tolerance)
            )
        set_frozen(self, threads=integer("threads", self.threads, 1))
        if self.max_steps is not None:
            set_frozen(self, max_steps=integer("max_steps", self.max_steps, 1))
        if not (self.method is None or callable(self.method)):
            raise InvalidScene(
                f"method is {self.method!r}, but must be a function that solves on a "
                "level, or None"
            )

    @property
    def method_name(self) -> str:
        """The name of the method for messages and results."""
        return getattr(self.method, "__name__", "newton")


@dataclass(frozen=True)
class PressureSolution:
    """The solution at one mean pressure, on the grid of the heights.

    Attributes:
        pressure: in Pa.
        displacement: downward, in m, without its mean.
        offset: height z of the flat in m; the gap is displacement + offset - heights.
        residuals: see `level.kkt_residuals`.
        counts: newton, cg and gradient are numbers of steps, and fft_pairs are pairs of
            transforms, on the finest grid; equivalent_fft_pairs are those of all grids
            in pairs of the finest one; levels is the number of grids.
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
        """Return the gap in m over heights (m) of the grid's shape.

        The result is the only new array.
        """
        gap = np.subtract(self.offset, heights)
        gap += self.displacement.reshape(heights.shape)
        return np.asarray(gap)


def symbol_from_compliance(
    compliance: NDArray[np.floating], shape: tuple[int, ...]
) -> Symbol:
    """Check a user's compliance and return it as a symbol; a line becomes (1, n).

    compliance: m/Pa for each mode of `numpy.fft.rfftn`; shape: of the heights.  Raises
    InvalidScene if it has another shape, is not finite and positive in every mode but
    the mean, is not symmetric, or falls too fast with the wave number.
    """
    values = np.atleast_2d(array("compliance", compliance).copy())
    nx, ny = (1, *shape)[-2:]
    expected = (nx, ny // 2 + 1)
    if values.shape != expected:
        raise InvalidScene(
            f"compliance has shape {np.shape(compliance)}, but one value per mode of "
            f"the real transform of {shape} heights is needed: {expected}"
        )
    good = np.isfinite(values) & (values > 0)
    good[0, 0] = np.isfinite(values[0, 0]) and values[0, 0] >= 0
    if not good.all():
        raise InvalidScene(
            "compliance must be finite and positive in every mode but the mean"
        )
    own_mirror_images = [0] if ny % 2 else [0, ny // 2]
    columns = values[:, own_mirror_images]
    mirrored = columns[-np.arange(nx)]
    if not np.allclose(columns, mirrored, rtol=1e-12, atol=0):
        raise InvalidScene("compliance differs between a mode and its mirror image")
    _require_gradual(values, (nx, ny))
    return Symbol(values, np.arange(nx, dtype=np.int32), (nx, ny))


def _require_gradual(values: FloatArray, shape: tuple[int, int]) -> None:
    """Raise InvalidScene if a compliance falls too fast with the wave number.

    From a wave to the wave of half its length it may fall by the factor STEEPEST.

    values: (nx, ny // 2 + 1) in m/Pa for each mode; shape: (nx, ny) points.

    The pressures of short waves would be out of all proportion, and a solve would not
    end.
    """
    nx, ny = shape
    _require_gradual_along(values[1 : nx // 2 + 1, 0], "first axis")
    _require_gradual_along(values[0, 1 : ny // 2 + 1], "second axis")
    diagonal = np.arange(1, min(nx, ny) // 2 + 1)
    _require_gradual_along(values[diagonal, diagonal], "diagonal")


def _require_gradual_along(compliance: FloatArray, direction: str) -> None:
    """Raise InvalidScene if a compliance falls by more than STEEPEST from a mode.

    compliance: (modes,) in m/Pa of the modes 1, 2, ... along one direction, of which
    mode 2 n has half the wavelength of mode n; direction: its name for the message.
    """
    count = compliance.size // 2
    if not count:
        return
    fall = compliance[:count] / compliance[1::2]
    worst = int(np.argmax(fall))
    if fall[worst] > STEEPEST:
        raise InvalidScene(
            f"compliance falls by a factor of {fall[worst]:.3g} from mode {worst + 1} "
            f"to mode {2 * worst + 2} along the {direction}, but the solver needs one "
            f"that falls by at most {STEEPEST:g} from a wave to the one of half its "
            "length (a half-space's falls by 2)"
        )


def start_pressure(given: NDArray[np.floating], shape: tuple[int, ...]) -> FloatArray:
    """Return a user's start pressure in Pa, with -inf where it is exactly 0.

    A point without pressure stays apart: rounding of the load would otherwise bring it
    into contact.

    given: the pressure of the user; shape: that of the heights, which the pressure must
    have.  Raises InvalidScene if the pressure is not finite or has another shape.
    """
    start = checked_field("start", given, shape, "finite pressures", -math.inf)
    return np.where(start == 0, -math.inf, start)


def checked_field(
    name: str,
    given: NDArray[np.floating],
    shape: tuple[int, ...],
    expected: str,
    least: float,
) -> FloatArray:
    """Return a user's field as a new array of 64-bit floats.

    name, expected: of the field and of its values, for the message; given: the field;
    shape: that it must have; least: smallest value that is allowed.

    Raises InvalidScene if the field has another shape, is not finite, or is somewhere
    below `least`.
    """
    values = array(name, given).copy()
    valid = values.shape == shape and np.isfinite(values).all()
    if not (valid and values.min() >= least):
        raise InvalidScene(
            f"{name} has shape {np.shape(given)}, but {expected} in an array of shape "
            f"{shape} are needed"
        )
    return values
