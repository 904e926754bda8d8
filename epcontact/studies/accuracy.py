"""The ledger of accuracy: bias and scatter of each quantity between two answers, and
their cost.

It reads folders of `epcontact sweep` and `epcontact verify`.  Without one it is the
package's own: `accuracy.csv`, by the sweeps of `cases/accuracy.toml`, the figures of
the release, the map of the theory's error, and the table of what joints conduct.
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
from epcontact.files import atomic_write
from epcontact.harness import sweep
from epcontact.harness.gates import distance
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import scalar_quantities
from epcontact.harness.verdict.compare import KEPT as RELEASE
from epcontact.harness.verdict.compare import read_figures
from epcontact.output.charts.plot import Plot
from epcontact.persson.validity import theory_map
from epcontact.studies import conductance
from epcontact.studies.frame import Charts, Say, study

KEPT = Path(__file__).with_name("accuracy.csv")
#: What the ledger tells, by the names of gates.
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
_METHODS = {"persson": "theory", "bem": "BEM", "fem": "FE", "calculix": "CalculiX"}
#: Differences of areas are over the reference, or over this nominal share if it is
#: more.
SMALLEST_AREA = 1e-3
#: What two scenes share if they are one by similarity, with the names of the terminal.
PLACE = {
    "load": "p0/(E* ξ)",
    "hardness": "hardness/(E* ξ)",
    "hurst": "H",
    "waves": "waves",
}
_COLUMNS = ["quantity", "pair", "points", "value", "reference", "surfaces", *PLACE]
_COLUMNS += ["time", "fft_pairs"]


def read_rows(folders: Sequence[str | Path] = ()) -> pd.DataFrame:
    """Return a row for each quantity, pair of answers and scene: both values, means
    over surfaces.

    `time` is that of a solve over the boundary elements' on 4 points a wave of the same
    surface. Raises InvalidCase or OutputError if a folder has neither a sweep nor a
    verdict.
    """
    found = [
        pd.read_csv(KEPT),
        verdict_rows(read_figures(RELEASE)),
        _theory_rows(),
        _law_rows(),
    ]
    if folders:
        swept = [Path(one) for one in folders if (Path(one) / "sweep.json").is_file()]
        judged = [Path(one) for one in folders if Path(one) not in swept]
        found = [
            sweep_rows(swept),
            *(verdict_rows(read_figures(one)) for one in judged),
        ]
    if not any(map(len, found)):
        raise InvalidCase("no quantity has two answers to the same scene there")
    return pd.concat([each for each in found if len(each)], ignore_index=True)[_COLUMNS]


def keep(rows: pd.DataFrame, path: Path) -> None:
    """Write rows as the table of a package."""
    with atomic_write(path) as file:
        rows.to_csv(file, index=False, float_format="%.6g")


def _theory_rows() -> pd.DataFrame:
    known, found = theory_map(), []
    capped = np.isfinite(known["hardness"])
    place = {"load": known["load"] * np.where(capped, known["hardness"], 1.0)}
    place |= {"hardness": known["hardness"], "hurst": known["hurst"]}
    place |= {"waves": known["wavelength_ratio"], "surfaces": known["surfaces"]}
    labels = {
        "total": "A",
        "elastic": "A_el",
        "plastic": "A_pl",
        "mean_gap": "mean gap",
    }
    for name, label in labels.items():
        value = {
            "value": known[name] * (1 + known[f"{name}_theory"]),
            "reference": known[name],
        }
        found.append(pd.DataFrame({"quantity": label} | value | place))
    distances = {
        "quantity": "P(σ) distance",
        "value": known["wasserstein"],
        "reference": 0.0,
    }
    rows = pd.concat([*found, pd.DataFrame(distances | place)]).dropna(subset="value")
    return rows.assign(pair="theory – BEM", points=4).reindex(columns=_COLUMNS)


def _law_rows() -> pd.DataFrame:
    table = conductance.ratios(conductance.kept())
    table = table.assign(
        value=table[conductance.RATIO] * table["y"], reference=table["y"]
    )
    table["pair"] = table["law"].map("law {} – BEM".format)
    table = table.assign(
        quantity="conductance", waves=8 * table["breadth"], surfaces=16
    )
    table["load"] *= table["hardness"]
    return table.dropna(subset="value").reindex(columns=_COLUMNS)


def verdict_rows(figures: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of figures, see `compare.read_figures`: one for each
    gate.
    """
    found = []
    for row in figures.dropna(subset="low").to_dict("records"):
        told = re.fullmatch(
            r"(\S+) of (\S+) against (\S+) \((?!supremum)\w+\)", row["name"]
        )
        if not told or told[1] not in QUANTITIES:
            continue
        if (
            row["reference"] == 0 and told[1] != "distribution"
        ):  # the value is an error itself
            continue
        of, other = (_METHODS.get(name, name) for name in told.groups()[1:])
        if re.fullmatch(r"[-+.\de]+", other):
            other = "stated figure"
        elif told[3] not in METHODS:
            other = "closed form"
        if (of, other) == ("BEM", "theory"):
            of, other = other, of
            if told[1] != "distribution":
                row |= {"value": row["reference"], "reference": row["value"]}
        found.append(row | {"quantity": QUANTITIES[told[1]], "pair": f"{of} – {other}"})
    return pd.DataFrame(found, columns=_COLUMNS)


def sweep_rows(folders: Sequence[Path]) -> pd.DataFrame:
    """Return the rows of sweeps together: what one of them solves on a finer grid, or
    by another method, is a reference for the others.
    """
    solved = pd.DataFrame(
        [
            _member(task["method"], task["seed"], result)
            for folder in folders
            for task, result in sweep.members(folder)
            if result is not None
        ]
    )
    if solved.empty:
        return pd.DataFrame(columns=_COLUMNS)
    place = [*PLACE, "scene"]
    surfaces = [*place, "seed"]
    theory, numeric = (
        solved[(solved["method"] == "persson") == is_it] for is_it in (True, False)
    )
    of = {
        name: numeric[numeric["method"] == name] for name in ("bem", "fem", "calculix")
    }
    bem = of["bem"].sort_values("points")
    limit = bem.drop_duplicates(surfaces, keep="last")
    unit = bem[bem["points"] >= 4].drop_duplicates(surfaces)[[*surfaces, "seconds"]]
    solved = (
        (theory.drop_duplicates(place).drop(columns="seed"), limit, place, "BEM"),
        (
            numeric[numeric["method"] != "bem"],
            bem,
            [*surfaces, "points"],
            "BEM, same grid",
        ),
        (of["fem"], of["calculix"], [*surfaces, "points"], "CalculiX, same grid"),
        (numeric, limit, surfaces, "continuum"),
    )
    return pd.concat([_pairs(*each, unit) for each in solved], ignore_index=True)


def _member(method: str, seed: Any, result: Any) -> dict[str, Any]:
    about = {name: part["value"] for name, part in result.provenance.about.items()}
    surface = str(about.get("surface"))
    hurst, points = (
        re.search(r"Hurst exponent ([\d.]+)", surface),
        about.get("resolution", 0.0),
    )
    known, other = scalar_quantities(result), ("poisson_ratio", "yield_stress", "body")
    return {name: v for name, v in known.items() if name in QUANTITIES} | {
        "method": method,
        "seed": seed,
        "points": points,
        "load": float(f"{about.get('load_group', math.nan):.4g}"),
        "hardness": float(f"{float(about.get('hardness_group', math.inf)):.4g}"),
        "hurst": float(hurst[1]) if hurst else math.nan,
        "waves": round(about["points"][0] / points) if points else math.nan,
        "scene": re.sub(r", seed \d+", "", surface)
        + str([about.get(name) for name in other]),
        "seconds": result.cost.get("seconds"),
        "fft_pairs": result.cost.get("equivalent_fft_pairs"),
        "distribution": result.distribution,
        "cap": float(about.get("hardness", math.inf)),
    }


def _pairs(
    of: pd.DataFrame,
    against: pd.DataFrame,
    on: list[str],
    name: str,
    unit: pd.DataFrame,
) -> pd.DataFrame:
    """Return rows of the means over surfaces of what `of` and `against` say of the same
    `on`.
    """
    both, rows = of.merge(against, on=on, suffixes=("", "_ref")), []
    if name == "continuum":  # the finest grid is no reference for itself
        itself = (both["method"] == "bem") & (both["points"] == both["points_ref"])
        both = both[~itself & (both["points_ref"] > both["points"])]
    shared = [each for each in unit if each in both and each != "seconds"]
    both = both.merge(unit.rename(columns={"seconds": "unit"}), on=shared, how="left")
    for quantity, label in QUANTITIES.items():
        other = f"{quantity}_ref"
        if quantity.endswith(
            "raw"
        ):  # counts near the limit, too, which is the corrected area
            other = other.replace("raw", "corrected") if name == "continuum" else other
        if quantity == "distribution":
            pairs = zip(
                both["distribution"], both["distribution_ref"], both["cap"], strict=True
            )
            value = [
                distance("wasserstein", *p) if p[0] and p[1] else math.nan
                for p in pairs
            ]
            one = both.assign(value=value, reference=0.0)
        elif {quantity, other} <= {*both} and not (
            quantity.endswith("raw") and name == "BEM"
        ):
            one = both.assign(value=both[quantity], reference=both[other])
        else:
            continue
        one = one[
            one[["value", "reference"]].abs().sum(axis=1, min_count=2) > 0
        ]  # both 0: no area
        groups = one.groupby([*PLACE, "scene", "method", "points"], dropna=False)
        found = groups[["value", "reference", "fft_pairs"]].mean()
        found["time"] = (
            groups["seconds"].min() / groups["unit"].min()
        )  # the least disturbed ones
        rows.append(found.assign(surfaces=groups.size(), quantity=label).reset_index())
    found = pd.concat(rows) if rows else pd.DataFrame({"method": []})
    pair = found["method"].map(
        lambda method: f"{_METHODS.get(method, method)} – {name}"
    )
    return found.assign(pair=pair).reindex(columns=_COLUMNS)


def differences(rows: pd.DataFrame) -> pd.Series:
    """Return the difference of each row: relative to its reference, see
    `SMALLEST_AREA`; a distance is one by itself.
    """
    floor = np.where(rows["quantity"].str.startswith("A"), SMALLEST_AREA, 0.0)
    scale = np.maximum(rows["reference"].abs(), floor)
    scale = scale.where(rows["quantity"] != "P(σ) distance", 1.0)
    return (rows["value"] - rows["reference"]) / scale


def ledger(rows: pd.DataFrame) -> pd.DataFrame:
    """Return bias and scatter of each quantity and pair, of each grid alone where it is
    known.

    The bias is the median of the differences, the scatter half the width of their
    central 68 %.
    """
    order = pd.Categorical(rows["quantity"], QUANTITIES.values())
    table = rows.assign(difference=differences(rows), quantity=order)
    table["points"] = table["points"].where(
        table["pair"].str.contains("continuum|same grid")
    )
    groups = table.groupby(["quantity", "pair", "points"], dropna=False, observed=True)
    found = []
    for (quantity, pair, points), mine in groups:
        low, bias, high = np.quantile(mine["difference"].dropna(), [0.16, 0.5, 0.84])
        row = {"quantity": quantity, "pair": pair, "points": points, "bias": bias}
        row |= {"scatter": (high - low) / 2, "scenes": len(mine)}
        row |= {
            f"{name}_{end}": mine[name].agg(end)
            for name in PLACE
            for end in ("min", "max")
        }
        found.append(
            row | {name: mine[name].median() for name in ("time", "fft_pairs")}
        )
    return pd.DataFrame(found)


@study("accuracy")
def accuracy(
    say: Say, folders: Sequence[str] = (), known: pd.DataFrame | None = None
) -> Charts:
    """Error of the contact area against time and FFT pairs, and each answer against its
    reference.

    The errors are root mean squares over scenes, against boundary elements on the
    finest grid; the theory's has the scatter of surfaces.  Times are over those of
    boundary elements on 4 points per shortest wave of the same surface, FFT pairs are
    in those of that grid.
    """
    rows = read_rows(folders) if known is None else known
    work = rows["fft_pairs"] * (rows["points"] / 4) ** 2
    rows = rows.assign(error=differences(rows).abs(), work=work)
    against = rows["pair"].str.contains("continuum|theory – BEM") & rows["time"].notna()
    areas = rows[against & rows["quantity"].isin(["A", "A raw"])].copy()
    method = areas["pair"].str.split(" – ").str[0]
    areas["method"] = method.replace({shown: name for name, shown in _METHODS.items()})
    kind = areas["quantity"].map({"A": "corrected", "A raw": "raw"})
    areas["kind"] = kind.where(areas["method"] != "persson", "")
    groups = areas.groupby(["method", "kind", "points"], sort=False)
    table, y = (
        groups[["time", "work"]].median(),
        ("error", "relative error of the contact area (–)"),
    )
    table["error"] = groups["error"].agg(lambda e: float(np.sqrt((e**2).mean())))
    y = ("error", "relative error of the contact area (–)")
    for x, title in (
        (
            ("time", "time of a solve, over boundary elements on 4 points a wave (–)"),
            "time",
        ),
        (("work", "FFT pairs of a grid of 4 points a wave (–)"), "FFT pairs"),
    ):
        drawn = table[table[x[0]] > 0].reset_index()
        plot = Plot(x, y, ("method", "kind"), mark="kind", log="xy", front=True)
        if len(drawn):
            yield plot, drawn, f"Accuracy against {title}"
    shown = rows[(rows["quantity"] == "A") & ~(rows["points"] > 4)]
    shown = shown.assign(ratio=shown["value"] / shown["reference"])
    ends = shown["reference"].agg(["min", "max"])
    line = pd.DataFrame(
        {"reference": ends, "ratio": 1.0, "ratio_low": 0.95, "ratio_high": 1.05}
    )
    line = line.assign(pair="equal, and within 5 %", style="curve")
    x, y = (
        ("reference", "area by the reference (–)"),
        ("ratio", "area predicted over it (–)"),
    )
    plot = Plot(x, y, ("pair",), style="open", log="x")
    yield plot, pd.concat([line, shown]), "Areas predicted over their references"
