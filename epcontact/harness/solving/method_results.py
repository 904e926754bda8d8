"""The results of one method for one case: an object, its JSON, and rows of loads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import estimate, standard_deviation
from epcontact.results import COLUMNS, ContactResult

#: Values of a table of loads that are given and not computed, and have no error.
_GIVEN = ("mean_pressure", "hardness")


@dataclass(frozen=True)
class MethodResults:
    """What a method found for the surfaces of a case.

    Attributes:
        results: the result for each surface that was solved.
        labels: the names of these surfaces, such as "seed3".
        errors: a sentence for each surface without a result.
        reused: the number of results that an earlier run had saved.
    """

    results: tuple[ContactResult, ...] = ()
    labels: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    reused: int = 0

    @property
    def equal_surfaces(self) -> tuple[str, str] | None:
        """The labels of two surfaces with the same result; None if all differ.

        An ensemble with a repeated surface would have a wrong scatter.  Two different
        surfaces may have the same areas and energies, but they differ at single points:
        results without a largest pressure are not compared.  Solutions of one surface,
        wherever it is on the grid, agree to the tolerance of their solver.
        """
        quantities = [result.final.quantities for result in self.results]
        for i, j in itertools.combinations(range(len(quantities)), 2):
            if _are_equal(quantities[i], quantities[j]):
                return self.labels[i], self.labels[j]
        return None

    def error_parts(self, quantity: str) -> dict[str, float]:
        """Return the errors of a quantity at the last load, by their source.

        They are means over the surfaces, see `mean_error_parts`, in the unit of the
        quantity.  The result is empty if the method states no error of it.

        Args:
            quantity: its name in gates, such as "area.total.corrected" or
                "quantity.mean_gap".
        """
        name = quantity.removeprefix("quantity.")
        if quantity.startswith("area.") and quantity.endswith(".corrected"):
            part = quantity.split(".")[1]
            name = f"{part}_area"
        elif name == quantity:
            return {}
        return mean_error_parts(
            [result.final.error_parts(name) for result in self.results]
        )


def mean_error_parts(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the errors of a mean over surfaces, by their source.

    The errors of different surfaces by one source have one cause, such as the grid, so
    that the mean over many surfaces has as large an error as one surface.

    Args:
        parts: for each surface the half-widths of 95 % intervals by source, see
            `LoadStep.error_parts`; a surface without a source has the error 0 by it.
    """
    sources = dict.fromkeys(itertools.chain(*parts))
    return {
        source: fmean(surface.get(source, 0.0) for surface in parts)
        for source in sources
    }


def _are_equal(first: Mapping[str, float], second: Mapping[str, float]) -> bool:
    """Return whether all quantities of two results agree to 1e-6 of their values.

    Results without a largest pressure, or with different quantities, do not.
    """
    if "largest_pressure" not in first or first.keys() != second.keys():
        return False
    return all(math.isclose(first[k], second[k], rel_tol=1e-6) for k in first)


def summary(case: Case, results: MethodResults) -> dict[str, Any]:
    """Return the content of `<method>.json` as plain data.

    It holds means of the areas over the surfaces with their scatter, the largest
    residuals, a table of loads, the cost of all solves, and each surface's result.

    Args:
        case: the case.
        results: the results of one of its methods, of one surface at least.
    """
    members = [result.to_json() for result in results.results]
    finals = [result.final for result in results.results]
    parts = ("total", "elastic", "plastic")
    ensemble: dict[str, dict[str, dict[str, float]]] = {}
    means: dict[str, dict[str, float]] = {}
    for kind in finals[0].areas:
        ensemble[kind] = {
            part: _statistics([getattr(final.areas[kind], part) for final in finals])
            for part in parts
        }
        means[kind] = {part: ensemble[kind][part]["mean"] for part in parts}
    return {
        "case": case.id,
        "method": results.results[0].method,
        "size": case.size,
        "converged": all(result.converged for result in results.results),
        "residuals": {
            name: max(final.residuals[name] for final in finals)
            for name in finals[0].residuals
        },
        "areas": means,
        "ensemble": {"surfaces": list(results.labels), "areas": ensemble},
        "mean_pressure": finals[0].mean_pressure,
        "loads": load_rows(results.results),
        "cost": _joint_cost([result.cost for result in results.results]),
        "provenance": members[0]["provenance"],
        "members": members,
    }


def _statistics(values: Sequence[float]) -> dict[str, float]:
    """Return mean, standard deviation and half the width of the 95 % interval of the
    mean of values, in their unit.
    """
    mean = estimate(values)
    return {
        "mean": mean.mean,
        "standard_deviation": standard_deviation(values),
        "half_width_95": mean.half_width,
    }


def _joint_cost(costs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the cost of solves on several surfaces: the sum of each cost, but of the
    peak memory the largest value.

    All costs have the same names, such as "seconds".
    """
    joint = {name: sum(cost[name] for cost in costs) for name in costs[0]}
    memory = "peak_memory_bytes"
    if memory in joint:
        joint[memory] = max(cost[memory] for cost in costs)
    return joint


def load_rows(
    results: Sequence[ContactResult], extra: Sequence[str] = ()
) -> list[dict[str, Any]]:
    """Return a row for each load of a path, with means over surfaces.

    Args:
        results: of one method, one for each surface.
        extra: names of quantities that the rows have beside `COLUMNS`.

    Returns:
        Rows with `branch` ("loading", "unloading" or "reloading") and, for each
        quantity that is defined at this load, a dictionary: its `mean` over the
        surfaces, its `error` (None if no error is known), and the `parts` of the error
        by their source.  The error is the root of the sum of their squares.  The part
        "scatter" is half the 95 % interval of the mean over the surfaces.
    """
    flows = results[0].provenance.options.get("law") == "j2"
    rows = []
    for index, branch in enumerate(results[0].branches):
        values = []
        for result in results:
            step = result.steps[index]
            row = {name: step.quantities.get(name, math.nan) for name in extra}
            row.update(step.row)
            if flows and branch != "loading":
                row = {n.replace("plastic", "flowed"): v for n, v in row.items()}
            values.append(row)
        rows.append({"branch": branch, **_mean_row(values, (*COLUMNS, *extra))})
    return rows


def _mean_row(
    values: Sequence[Mapping[str, float]], names: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Return mean, error and parts of the error of the quantities at one load.

    Args:
        values: for each surface, values by the name of the quantity; an error is
            "<name>_error_by_<source>".
        names: the names of the quantities.

    Returns:
        For each quantity that is defined, the dictionary that `load_rows` describes.
    """
    row = {}
    for name in names:
        mean = estimate([surface.get(name, math.nan) for surface in values])
        if math.isnan(mean.mean):
            continue
        parts = mean_error_parts([_parts_in_row(surface, name) for surface in values])
        if mean.half_width:
            parts["scatter"] = mean.half_width
        # A value without any known error is not exact: its error is None.
        error = math.hypot(*parts.values()) if parts or name in _GIVEN else None
        row[name] = {"mean": mean.mean, "error": error, "parts": parts}
    return row


def _parts_in_row(row: Mapping[str, float], name: str) -> dict[str, float]:
    """Return the errors of a quantity by their source, from a row of `LoadStep.row`.

    name: of the quantity; its errors are the columns "<name>_error_by_<source>".
    """
    prefix = f"{name}_error_by_"
    return {
        column.removeprefix(prefix): error
        for column, error in row.items()
        if column.startswith(prefix)
    }
