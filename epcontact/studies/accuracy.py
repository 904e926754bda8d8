"""The ledger of accuracy: bias, scatter and cost of each quantity between methods.

It reads folders of `epcontact sweep` and `epcontact verify`.  Without a folder it is
the ledger of the package: `accuracy.csv`, from the sweeps of `cases/accuracy.toml`, the
values of the release, the map of the theory's error, and the table of conductances.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact.errors import InvalidCase
from epcontact.files import atomic_write, require_replaceable
from epcontact.harness import sweep
from epcontact.harness.gates import distance
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import scalar_quantities
from epcontact.harness.verdict.compare import RELEASE_VALUES as RELEASE
from epcontact.harness.verdict.compare import read_values
from epcontact.output.charts.plot import Axis, Plot
from epcontact.persson.validity import theory_map
from epcontact.studies import conductance
from epcontact.studies.frame import Charts, Say, study

#: The table of the package's sweeps.
PACKAGE_TABLE = Path(__file__).with_name("accuracy.csv")
#: The quantities of the ledger by the names of gates, with their symbols.
QUANTITIES = {
    "area.total.corrected": "A",
    "area.elastic.corrected": "A_el",
    "area.plastic.corrected": "A_pl",
    "area.total.raw": "A raw",
    "quantity.mean_gap": "mean gap",
    "quantity.stiffness_loading": "stiffness loading",
    "quantity.stiffness_unloading": "stiffness unloading",
    "quantity.conductance": "conductance",
    "quantity.effective_hardness": "c_eff",
    "distribution": "P(σ) distance",
}
_DISTANCE = QUANTITIES["distribution"]
#: The abbreviation of each method, such as "BEM" for "bem".
_METHODS = {name: method.abbreviation or name for name, method in METHODS.items()}
#: Differences of areas are over the reference, or over this fraction of the nominal
#: area if the reference is smaller.
SMALLEST_AREA = 1e-3
#: The dimensionless groups on which the result of a scene depends: columns of the
#: tables, with the names that a terminal shows.  "waves" is the ratio of the longest to
#: the shortest wavelength.
PLACE = {
    "load": "p0/(E* ξ)",
    "hardness": "hardness/(E* ξ)",
    "hurst": "H",
    "waves": "waves",
}
_COLUMNS = [
    "quantity",
    "pair",
    "points",
    "value",
    "reference",
    "surfaces",
    *PLACE,
    "time",
    "fft_pairs",
]


def read_rows(folders: Sequence[str | Path] = ()) -> pd.DataFrame:
    """Return a row for each quantity, pair of methods and scene.

    A row has `value` and `reference`, means over the surfaces in the unit of the
    quantity, and the dimensionless groups `PLACE`.  `time` is that of a solve over that
    of boundary elements on 4 points per shortest wave of the same surface.

    Args:
        folders: Output folders of `epcontact sweep` and `epcontact verify`; none: the
            ledger of the package.

    Raises:
        InvalidCase: A folder has neither a sweep nor a verdict, or no quantity has two
            values for one scene.
        OutputError: A file cannot be read.
    """
    if folders:
        swept = []
        tables = []
        for folder in map(Path, folders):
            if (folder / "sweep.json").is_file():
                swept.append(folder)
            else:
                tables.append(verdict_rows(read_values(folder)))
        tables.insert(0, sweep_rows(swept))
    else:
        tables = [
            pd.read_csv(PACKAGE_TABLE),
            verdict_rows(read_values(RELEASE)),
            _theory_rows(),
            _law_rows(),
        ]
    filled = [table for table in tables if len(table)]
    if not filled:
        raise InvalidCase("no quantity has two answers to the same scene there")
    return pd.concat(filled, ignore_index=True)[_COLUMNS]


def write_table(rows: pd.DataFrame, path: Path) -> None:
    """Write the rows of a table to a CSV file, with six digits of each number.

    `path` is the file; one with other columns is not replaced.  Raises OutputError if
    it cannot be written.
    """
    require_replaceable(path, ",".join(rows.columns))
    with atomic_write(path) as file:
        rows.to_csv(file, index=False, float_format="%.6g")


def _theory_rows() -> pd.DataFrame:
    """Return rows, as `read_rows`, of the theory against boundary elements.

    They are computed from the package's map of the theory's error.
    """
    table = theory_map()
    capped = np.isfinite(table["hardness"])
    place = {
        "load": table["load"] * np.where(capped, table["hardness"], 1.0),
        "hardness": table["hardness"],
        "hurst": table["hurst"],
        "waves": table["wavelength_ratio"],
        "surfaces": table["surfaces"],
    }
    tables = []
    symbols = {
        "total": "A",
        "elastic": "A_el",
        "plastic": "A_pl",
        "mean_gap": "mean gap",
    }
    for name, symbol in symbols.items():
        values = {
            "quantity": symbol,
            "value": table[name] * (1 + table[f"{name}_theory"]),
            "reference": table[name],
        }
        tables.append(pd.DataFrame(values | place))
    distances = {
        "quantity": _DISTANCE,
        "value": table["wasserstein"],
        "reference": 0.0,
    }
    tables.append(pd.DataFrame(distances | place))
    rows = pd.concat(tables).dropna(subset="value")
    return rows.assign(pair="theory – BEM", points=4).reindex(columns=_COLUMNS)


def _law_rows() -> pd.DataFrame:
    """Return rows, as `read_rows`, of laws of conductance against boundary elements.

    They are computed from the package's table of conductances.
    """
    table = conductance.ratios(conductance.table_of_package())
    rows = table.assign(
        quantity="conductance",
        pair=table["law"].map("law {} – BEM".format),
        value=table[conductance.RATIO] * table["y"],
        reference=table["y"],
        load=table["load"] * table["hardness"],
        waves=8 * table["breadth"],
        surfaces=16,
    )
    return rows.dropna(subset="value").reindex(columns=_COLUMNS)


def verdict_rows(figures: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a verdict, one for each gate on a quantity of the ledger.

    Gates whose reference is 0 are left out, because their value is an error itself.

    Args:
        figures: The values of a verdict, from `compare.read_values`.

    Returns:
        Rows as those of `read_rows`.
    """
    rows = []
    for row in figures.dropna(subset="low").to_dict("records"):
        gate = re.fullmatch(
            r"(\S+) of (\S+) against (\S+) \((?!supremum)\w+\)", row["name"]
        )
        if not gate or gate[1] not in QUANTITIES:
            continue
        is_distance = gate[1] == "distribution"
        if row["reference"] == 0 and not is_distance:
            continue  # the value is an error itself
        method = _METHODS.get(gate[2], gate[2])
        reference = _METHODS.get(gate[3], gate[3])
        if re.fullmatch(r"[-+.\de]+", reference):
            reference = "stated figure"
        elif gate[3] not in METHODS:
            reference = "closed form"
        if (method, reference) == ("BEM", "theory"):
            method, reference = reference, method
            if not is_distance:
                row |= {"value": row["reference"], "reference": row["value"]}
        pair = f"{method} – {reference}"
        rows.append(row | {"quantity": QUANTITIES[gate[1]], "pair": pair})
    return pd.DataFrame(rows, columns=_COLUMNS)


def sweep_rows(folders: Sequence[Path]) -> pd.DataFrame:
    """Return the rows, as `read_rows`, of several sweeps together.

    The results of a scene on its finest grid, and those of other methods, are the
    references of the scene's other results.

    Args:
        folders: Output folders of `epcontact sweep`.

    Raises:
        OutputError: A file cannot be read.
    """
    members = []
    for folder in folders:
        for task, result in sweep.members(folder):
            if result is not None:
                members.append(_member(task["method"], task["seed"], result))
    if not members:
        return pd.DataFrame(columns=_COLUMNS)
    solved = pd.DataFrame(members)
    place = [*PLACE, "scene"]
    surface = [*place, "seed"]
    grid = [*surface, "points"]
    by_method = {
        name: solved[solved["method"] == name]
        for name in ("persson", "bem", "fem", "calculix")
    }
    numerical = solved[solved["method"] != "persson"]
    theory = by_method["persson"].drop_duplicates(place).drop(columns="seed")
    bem = by_method["bem"].sort_values("points")
    finest = bem.drop_duplicates(surface, keep="last")
    coarsest = bem[bem["points"] >= 4].drop_duplicates(surface)
    unit = coarsest[[*surface, "seconds"]]
    others = numerical[numerical["method"] != "bem"]
    tables = [
        _pairs(theory, finest, place, "BEM", unit),
        _pairs(others, bem, grid, "BEM, same grid", unit),
        _pairs(
            by_method["fem"], by_method["calculix"], grid, "CalculiX, same grid", unit
        ),
        _pairs(numerical, finest, surface, _CONTINUUM, unit),
    ]
    return pd.concat(tables, ignore_index=True)


#: The name of the reference that is the corrected result on the finest grid.
_CONTINUUM = "continuum"


def _member(
    method: str,
    seed: Any,
    result: Any,
) -> dict[str, Any]:
    """Return a row with the quantities, the dimensionless groups and cost of a result.

    Args:
        method: Name of the method.
        seed: Seed of the surface; None if it has none.
        result: The result, as read from the files of a sweep.

    Returns:
        Values of `QUANTITIES` by name, the columns of `PLACE`, and: method, seed,
        points (per shortest wave), scene (a text that is the same for all surfaces and
        grids), seconds, fft_pairs, distribution (of the pressure) and cap (the hardness
        in Pa).
    """
    about = {name: part["value"] for name, part in result.provenance.about.items()}
    surface = str(about.get("surface"))
    points = about.get("resolution", 0.0)
    hurst = re.search(r"Hurst exponent ([\d.]+)", surface)
    load = float(about.get("load_group", math.nan))
    hardness = float(about.get("hardness_group", math.inf))
    other = [about.get(name) for name in ("poisson_ratio", "yield_stress", "body")]
    row = {
        name: value
        for name, value in scalar_quantities(result).items()
        if name in QUANTITIES
    }
    return row | {
        "method": method,
        "seed": seed,
        "points": points,
        "load": float(f"{load:.4g}"),
        "hardness": float(f"{hardness:.4g}"),
        "hurst": float(hurst[1]) if hurst else math.nan,
        "waves": round(about["points"][0] / points) if points else math.nan,
        "scene": re.sub(r", seed \d+", "", surface) + str(other),
        "seconds": result.cost.get("seconds"),
        "fft_pairs": result.cost.get("equivalent_fft_pairs"),
        "distribution": result.distribution,
        "cap": float(about.get("hardness", math.inf)),
    }


def _pairs(
    results: pd.DataFrame,
    references: pd.DataFrame,
    on: list[str],
    name: str,
    unit: pd.DataFrame,
) -> pd.DataFrame:
    """Return rows of results against their references, as means over the surfaces.

    Args:
        results: Rows of `_member`.
        references: Rows of `_member` that the results are compared with.
        on: Columns in which a result and its reference agree.
        name: Name of the reference in the column `pair`.
        unit: Seconds of boundary elements on 4 points a wave, for each surface.
    """
    both = results.merge(references, on=on, suffixes=("", "_ref"))
    if name == _CONTINUUM:  # the finest grid is no reference for itself
        itself = (both["method"] == "bem") & (both["points"] == both["points_ref"])
        both = both[~itself & (both["points_ref"] > both["points"])]
    shared = [column for column in unit if column in both and column != "seconds"]
    both = both.merge(unit.rename(columns={"seconds": "unit"}), on=shared, how="left")
    rows = []
    for quantity, symbol in QUANTITIES.items():
        pairs = _values_and_references(both, quantity, name)
        if pairs is None:
            continue
        values = pairs[["value", "reference"]]
        # Where both are 0 there is no such area.
        pairs = pairs[values.abs().sum(axis=1, min_count=2) > 0]
        by = [*PLACE, "scene", "method", "points"]
        groups = pairs.groupby(by, dropna=False)
        means = groups[["value", "reference", "fft_pairs"]].mean()
        # The least times are those that other processes disturb least.
        means["time"] = groups["seconds"].min() / groups["unit"].min()
        means = means.assign(surfaces=groups.size(), quantity=symbol)
        rows.append(means.reset_index())
    found = pd.concat(rows) if rows else pd.DataFrame({"method": []})
    pair = found["method"].map(lambda m: f"{_METHODS.get(m, m)} – {name}")
    return found.assign(pair=pair).reindex(columns=_COLUMNS)


def _values_and_references(
    both: pd.DataFrame, quantity: str, name: str
) -> pd.DataFrame | None:
    """Return merged rows with added columns `value` and `reference` of a quantity.

    Args:
        both: Rows of `_member`, each joined with its reference, whose columns end in
            "_ref".
        quantity: A key of `QUANTITIES`.
        name: Name of the reference.  If it is "continuum", the reference of a raw area
            is the corrected area.

    Returns:
        The rows; None if they do not have the quantity, or if a raw area would be
        compared with boundary elements in general.
    """
    if quantity == "distribution":
        distances = []
        columns = (both["distribution"], both["distribution_ref"], both["cap"])
        for distribution, reference, cap in zip(*columns, strict=True):
            value = math.nan
            if distribution and reference:
                value = distance("wasserstein", distribution, reference, cap)
            distances.append(value)
        return both.assign(value=distances, reference=0.0)
    is_raw = quantity.endswith("raw")
    if is_raw and name == "BEM":
        return None
    reference_column = f"{quantity}_ref"
    if is_raw and name == _CONTINUUM:
        reference_column = reference_column.replace("raw", "corrected")
    if quantity not in both or reference_column not in both:
        return None
    return both.assign(value=both[quantity], reference=both[reference_column])


def differences(rows: pd.DataFrame) -> pd.Series:
    """Return the relative difference (value - reference)/reference of each row.

    The difference of an area is divided by `SMALLEST_AREA` if the reference is smaller.
    That of a distance between distributions is its value.

    Args:
        rows: The rows of `read_rows`.
    """
    is_area = rows["quantity"].str.startswith("A")
    floor = np.where(is_area, SMALLEST_AREA, 0.0)
    scale = np.maximum(rows["reference"].abs(), floor)
    scale = scale.where(rows["quantity"] != _DISTANCE, 1.0)
    return (rows["value"] - rows["reference"]) / scale


def ledger(rows: pd.DataFrame) -> pd.DataFrame:
    """Return bias and scatter of each quantity and pair, and the medians of the cost.

    The bias is the median of the differences, the scatter half the width of their
    central 68 %.  Pairs with a grid have a row for each number of points per wave.

    Args:
        rows: The rows of `read_rows`.
    """
    order = pd.Categorical(rows["quantity"], QUANTITIES.values())
    table = rows.assign(difference=differences(rows), quantity=order)
    on_grid = table["pair"].str.contains("continuum|same grid")
    table["points"] = table["points"].where(on_grid)
    groups = table.groupby(["quantity", "pair", "points"], dropna=False, observed=True)
    found = []
    for (quantity, pair, points), group in groups:
        low, bias, high = np.quantile(group["difference"].dropna(), [0.16, 0.5, 0.84])
        row = {
            "quantity": quantity,
            "pair": pair,
            "points": points,
            "bias": bias,
            "scatter": (high - low) / 2,
            "scenes": len(group),
        }
        for name in PLACE:
            row[f"{name}_min"] = group[name].min()
            row[f"{name}_max"] = group[name].max()
        for name in ("time", "fft_pairs"):
            row[name] = group[name].dropna().median()
        found.append(row)
    return pd.DataFrame(found)


@study("accuracy")
def accuracy(
    say: Say, folders: Sequence[str] = (), known: pd.DataFrame | None = None
) -> Charts:
    """Error of the contact area against time, and each area over its reference.

    The errors are root mean squares over scenes, against boundary elements on the
    finest grid; the theory's has the scatter of surfaces.  Times are over those of
    boundary elements on 4 points per shortest wave of the same surface.
    """
    del say
    rows = read_rows(folders) if known is None else known
    table = _errors_by_cost(rows)
    y = Axis("error", "relative error of the contact area (–)")
    time = Axis(
        "time", "time of a solve, over boundary elements on 4 points a wave (–)"
    )
    drawn = table[table["time"] > 0].reset_index()
    plot = Plot(
        time,
        y,
        ("method", "kind"),
        mark="kind",
        log="xy",
        front=True,
    )
    if len(drawn):
        yield plot, drawn, "How accurate is a contact area for its time?"

    shown = rows[(rows["quantity"] == "A") & ~(rows["points"] > 4)]
    shown = shown.assign(ratio=shown["value"] / shown["reference"])
    equal = pd.DataFrame({"reference": shown["reference"].agg(["min", "max"])})
    equal = equal.assign(ratio=1.0, ratio_low=0.95, ratio_high=1.05)
    equal = equal.assign(pair="equal, and within 5 %", style="curve")
    x = Axis("reference", "area by the reference (–)")
    y = Axis("ratio", "area predicted over it (–)")
    plot = Plot(
        x,
        y,
        ("pair",),
        style="open",
        log="x",
    )
    yield plot, pd.concat([equal, shown]), "Which areas are near their references?"


def _errors_by_cost(rows: pd.DataFrame) -> pd.DataFrame:
    """Return error and time of the contact area by method, kind and points.

    `rows` are those of `read_rows`.  The index of the result is method, kind (corrected
    or raw) and points per shortest wave; its columns are `error` (root mean square over
    scenes, relative) and `time` (median, over that of boundary elements on 4 points per
    shortest wave).
    """
    rows = rows.assign(error=differences(rows).abs())
    judged = rows["pair"].str.contains("continuum|theory – BEM")
    is_area = rows["quantity"].isin(["A", "A raw"])
    areas = rows[judged & rows["time"].notna() & is_area].copy()
    method = areas["pair"].str.split(" – ").str[0]
    areas["method"] = method.replace({words: name for name, words in _METHODS.items()})
    kind = areas["quantity"].map({"A": "corrected", "A raw": "raw"})
    areas["kind"] = kind.where(areas["method"] != "persson", "")
    groups = areas.groupby(["method", "kind", "points"], sort=False)
    table = groups[["time"]].median()
    table["error"] = groups["error"].agg(lambda e: float(np.sqrt((e**2).mean())))
    return table
