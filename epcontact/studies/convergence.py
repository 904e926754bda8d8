"""Convergence studies: sequences of grids, observed order, limit, and how far it can be trusted.

With values f_1, f_2, f_3 on spacings h_1 < h_2 < h_3 and f = f_0 + a h^p the order solves

    (f_3 - f_2)/(f_2 - f_1) = (h_3^p - h_2^p)/(h_2^p - h_1^p),

Richardson's limit is f_0 = f_1 - (f_2 - f_1) h_1^p/(h_2^p - h_1^p), and Roache's grid convergence
index is a safety factor times |f_1 - f_0|: 1.25 where three grids or more show an order near the
formal one, 3 with the formal order where they do not (Roache, Verification and Validation in
Computational Science and Engineering, 1998, chapter 5).

Contact rarely converges smoothly: which grid point is the last to touch is chance, and sequences
need not be monotone.  Such a sequence is called what it is; its uncertainty is three times the
spread of its three finest values.  Averages over shifts of the grid take out the chance; the order
of their errors against a known answer is `fitted_order`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from epcontact.errors import InvalidCase
from epcontact.harness.gates import Estimate, read_quantity
from epcontact.results import ContactResult
from epcontact.scene import Scene

Kind = Literal["monotone", "oscillating", "diverging", "constant", "two grids"]

SAFETY, CAUTION = 1.25, 3.0
#: An observed order within these multiples of the formal one is believed.
_SANE = (0.5, 1.5)
#: Changes below this share of the value are rounding, not convergence.
_ROUNDING = 1e-13


@dataclass(frozen=True)
class Study:
    """A quantity on a sequence of grids, the finest first.

    orders: observed on each three neighbouring grids, NaN where they show none.
    kind: what the three finest values do.
    limit: Richardson's, at the order that is believed; the finest value where there is none.
    uncertainty: absolute, of the limit; the grid convergence index times the value.
    order: that the limit was taken with, NaN without one; safety: the factor in the uncertainty.
    """

    spacings: tuple[float, ...]
    values: tuple[float, ...]
    orders: tuple[float, ...]
    kind: Kind
    limit: float
    uncertainty: float
    order: float
    safety: float

    @property
    def estimate(self) -> Estimate:
        """What a gate compares: the limit with its uncertainty."""
        return Estimate(self.limit, self.uncertainty, math.nan, self.values)

    @property
    def index(self) -> float:
        """The grid convergence index: the uncertainty over the finest value."""
        return self.uncertainty / abs(self.values[0]) if self.values[0] else math.inf


def observed_order(values: Sequence[float], spacings: Sequence[float]) -> float:
    """The order p of three values on three spacings, finest first; NaN where there is none.

    There is none if the changes differ in sign, or do not shrink on refinement.
    """
    (f1, f2, f3), (h1, h2, h3) = values, spacings
    if _flat(f1, f2) or (f3 - f2) / (f2 - f1) <= 0:
        return math.nan
    wanted = math.log((f3 - f2) / (f2 - f1))

    def excess(p: float) -> float:
        # (b^p - a^p)/(a^p - 1) with a = h2/h1, b = h3/h1; the limit p -> 0 is ln(b/a)/ln a.
        a, b = math.log(h2 / h1), math.log(h3 / h1)
        if abs(p) < 1e-12:
            return math.log((b - a) / a) - wanted
        return math.log(math.expm1(p * (b - a)) / math.expm1(p * a)) + p * a - wanted

    if excess(0.0) >= 0:
        return math.nan
    return float(brentq(excess, 0.0, 60.0)) if excess(60.0) > 0 else math.nan


def richardson(fine: float, coarse: float, ratio: float, order: float) -> float:
    """f_0 = f_1 + (f_1 - f_2)/(r^p - 1) of two values whose spacings have the ratio r > 1."""
    return fine + (fine - coarse) / math.expm1(order * math.log(ratio))


def study(values: Sequence[float], spacings: Sequence[float], formal_order: float) -> Study:
    """Judge a sequence of two grids or more; they may come in any sequence of spacings.

    Raises InvalidCase for fewer, for spacings that repeat, or for numbers that are not finite.
    """
    _require_sequence(values, spacings, formal_order)
    pairs = sorted(zip(spacings, values, strict=True))
    h, f = tuple(float(p[0]) for p in pairs), tuple(float(p[1]) for p in pairs)
    orders = tuple(observed_order(f[i : i + 3], h[i : i + 3]) for i in range(len(f) - 2))
    kind = _kind(f, orders)
    if kind in ("oscillating", "diverging"):
        spread = max(f[:3]) - min(f[:3])
        return Study(h, f, orders, kind, f[0], CAUTION * spread, math.nan, CAUTION)
    if kind == "constant":
        return Study(h, f, orders, kind, f[0], _ROUNDING * abs(f[0]), math.nan, CAUTION)
    low, high = (factor * formal_order for factor in _SANE)
    sane = kind == "monotone" and low <= orders[0] <= high
    order, safety = (orders[0], SAFETY) if sane else (formal_order, CAUTION)
    limit = richardson(f[0], f[1], h[1] / h[0], order)
    return Study(h, f, orders, kind, limit, safety * abs(f[0] - limit), order, safety)


def _require_sequence(
    values: Sequence[float], spacings: Sequence[float], formal_order: float
) -> None:
    if len(values) != len(spacings) or len(values) < 2:
        raise InvalidCase(
            f"{len(values)} values on {len(spacings)} spacings are no sequence of grids; give two "
            "grids or more with a value each"
        )
    if len(set(spacings)) != len(spacings) or not all(0 < h < math.inf for h in spacings):
        raise InvalidCase("the spacings of a sequence must be positive and differ from each other")
    if not all(map(math.isfinite, values)):
        raise InvalidCase("a value of the sequence is not a finite number")
    if not 0 < formal_order < math.inf:
        raise InvalidCase(f"formal_order is {formal_order!r}, but must be a positive number")


def _kind(f: tuple[float, ...], orders: tuple[float, ...]) -> Kind:
    if len(f) == 2:
        return "constant" if _flat(f[0], f[1]) else "two grids"
    if _flat(f[0], f[1]):
        return "constant" if _flat(f[1], f[2]) else "oscillating"
    if (f[2] - f[1]) * (f[1] - f[0]) < 0:
        return "oscillating"
    return "monotone" if math.isfinite(orders[0]) else "diverging"


def _flat(fine: float, coarse: float) -> bool:
    return abs(coarse - fine) <= _ROUNDING * max(abs(fine), abs(coarse))


@dataclass(frozen=True)
class Fit:
    """Slope of ln(error) over ln(spacing) with its standard error, and the prefactor."""

    order: float
    standard_error: float
    factor: float


def fitted_order(spacings: ArrayLike, errors: ArrayLike) -> Fit:
    """Least squares of ln(error) = ln(factor) + order ln(spacing), against a known limit.

    spacings, errors: (n,) or (n, m) errors of m shifts each, whose root mean square counts.
    Raises InvalidCase for fewer than two spacings or an error that is not positive.
    """
    h, e = np.asarray(spacings, dtype=float), np.asarray(errors, dtype=float)
    if e.ndim == 2:
        e = np.sqrt(np.mean(e**2, axis=1))
    if h.ndim != 1 or h.shape != e.shape or h.size < 2 or not (np.all(e > 0) and np.all(h > 0)):
        raise InvalidCase("an order needs two spacings or more, with a positive error each")
    x, y = np.log(h), np.log(e)
    (slope, level), scatter = np.polyfit(x, y, 1), math.nan
    if h.size > 2:
        rest = y - slope * x - level
        scatter = math.sqrt(float(rest @ rest) / (h.size - 2) / float(np.sum((x - x.mean()) ** 2)))
    return Fit(float(slope), scatter, float(np.exp(level)))


# --- driver --------------------------------------------------------------------------------------


def refined(recipe: Any, points: int) -> Any:
    """A surface recipe on another grid: `points` along its first direction, the others in
    proportion.

    Raises InvalidScene if the recipe cannot have that grid, InvalidCase if it has no shape of
    its own (heights from a file).
    """
    try:
        shape = tuple(max(2, round(points * n / recipe.shape[0])) for n in recipe.shape)
        return replace(recipe, shape=shape)
    except TypeError:
        raise InvalidCase(
            "heights from a file have the grid they have; give a generated surface"
        ) from None


def refine(
    scene_of: Callable[[int], Scene],
    solver: Callable[[Scene], ContactResult],
    quantity: str,
    sizes: Sequence[int],
    formal_order: float,
) -> Study:
    """Solve `scene_of(points)` on each size and judge the sequence of a quantity.

    quantity: as gates name it, such as area.total.corrected; spacings are 1/points.
    Raises InvalidCase, and what the solver raises.
    """
    values = [read_quantity(solver(scene_of(points)), quantity) for points in sizes]
    return study(values, [1 / points for points in sizes], formal_order)


def table(found: Study) -> str:
    """The sequence as text, a line a grid, the finest first, and what it amounts to."""
    lines = ["    spacing          value       order"]
    orders = [*found.orders, math.nan, math.nan]
    for h, f, p in zip(found.spacings, found.values, orders, strict=False):
        order = f"{p:8.2f}" if math.isfinite(p) else "       –"
        lines.append(f"{h:11.4e}  {f:13.8g}  {order}")
    how = f"order {found.order:.2f}, " if math.isfinite(found.order) else ""
    lines.append(
        f"{found.kind}: {found.limit:.8g} ± {found.uncertainty:.2g} ({how}safety {found.safety:g}, "
        f"grid convergence index {found.index:.2g})"
    )
    return "\n".join(lines)
