"""The benchmark: the fields of another code beside the stored results of six scenes.

The folder `cases/benchmark` has the files, and `.docs/benchmark.md` describes them.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from epcontact.errors import InvalidCase, sentence_of
from epcontact.files import output_error, read_bytes
from epcontact.harness.case_files.text import package_files
from epcontact.harness.gates import l2_distance

#: The code with which the others are compared.
REFERENCE = "plain"
#: Columns that name a load of a scene (from 1), and a node of its grid (from 0).
_LOAD = ["scene", "load"]
_NODE = [*_LOAD, "i", "j"]
#: Results of a code at a load that are compared with those of the reference.
QUANTITIES = ("area", "area_limit", "mean_gap")
#: Distances of its pressures from those of the reference, see `_distances`.
DISTANCES = ("field", "distribution")
#: Largest relative error of the mean pressure of another code at a load.
LARGEST_LOAD_ERROR = 0.01
#: The columns of the summary on a terminal: the name of the value in `compare_codes`,
#: and the form of its median and of its largest absolute value.
COLUMNS = {
    "raw area": ("area_difference", "{:+.1%} ({:.1%})"),
    "area": ("area_limit_difference", "{:+.1%} ({:.1%})"),
    "mean gap": ("mean_gap_difference", "{:+.1%} ({:.1%})"),
    "pressures, L2": ("field", "{:.2g} ({:.2g})"),
    "P(σ) distance": ("distribution", "{:.2g} ({:.2g})"),
    "time": ("time", "{:.3g} ({:.3g})"),
}


def folder() -> Path:
    """Return the folder with the files of the benchmark."""
    return package_files()[0].parent / "benchmark"


def compare_codes(files: Sequence[Path] = ()) -> pd.DataFrame:
    """Return the results of all codes at each load of the scenes.

    The columns are those of results.csv and: `time`, processor time over that of
    boundary elements at three yield stresses; for each of QUANTITIES, with
    `_difference` behind it, its relative difference from that of the reference; and
    DISTANCES.  Values that a code does not have are NaN.

    Args:
        files: Fields of other codes, each a CSV file with the name of its code and the
            columns scene, load, i, j, pressure (Pa) and, if it is known, gap (m).  A
            file may lack scenes and loads.

    Raises:
        InvalidCase: A file has the name of another code, no such columns, unknown
            nodes, not all nodes of a load, or pressures of another load.
        OutputError: A file cannot be read.
    """
    results = [pd.read_csv(folder() / "results.csv")]
    pressures = pd.read_csv(folder() / "pressures.csv", index_col=_NODE)
    for file in files:
        if file.stem in {*results[0]["code"], *pressures}:
            raise InvalidCase(
                f"{file}: there are results of a code {file.stem!r} already; give the "
                "file another name"
            )
        fields = _read_fields(file, pressures[REFERENCE])
        pressures[file.stem] = fields["pressure"]
        results.append(_results_of_fields(fields).assign(code=file.stem))
    table = pd.concat(results, ignore_index=True)
    distances = pressures.groupby(level=_LOAD, sort=False).apply(_distances)
    table = table.join(distances, on=[*_LOAD, "code"])
    unit = table[table["code"] == "bem-3"].set_index(_LOAD)["seconds"]
    exact = table[table["code"] == REFERENCE].set_index(_LOAD)
    at_load = pd.MultiIndex.from_frame(table[_LOAD])
    table["time"] = table["seconds"] / unit.reindex(at_load).to_numpy()
    for name in QUANTITIES:
        reference = exact[name].reindex(at_load).to_numpy()
        table[f"{name}_difference"] = table[name] / reference - 1
    return table


def summarise(table: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each code with the medians of its differences over all loads.

    `table` is that of `compare_codes`.  The columns are `loads`, the number of loads
    that the code has solved; its differences, distances and time; and, with `_largest`
    behind the name, the largest absolute value.
    """
    names = [name for name, _ in COLUMNS.values()]
    groups = table.groupby("code", sort=False)
    medians = groups[names].median()
    largest = table[names].abs().groupby(table["code"], sort=False).max()
    return medians.join(largest.add_suffix("_largest")).assign(loads=groups.size())


def copy_files(destination: Path) -> None:
    """Copy the folder of the benchmark; raise OutputError if `destination` exists."""
    try:
        shutil.copytree(folder(), destination)
    except OSError as error:
        raise output_error("write", destination, error) from None


def _read_fields(file: Path, exact: pd.Series) -> pd.DataFrame:
    """Return the fields of a code, with a row for each of its nodes.

    Args:
        file: See `compare_codes`.
        exact: Pressures of the reference at all nodes of the scenes, in Pa.
    """
    content = io.BytesIO(read_bytes(file))
    try:
        fields = pd.read_csv(content).set_index(_NODE)
        values = fields[["pressure"]].assign(gap=fields.get("gap", np.nan))
        values = values.astype(float)
    except (KeyError, ValueError) as error:
        raise InvalidCase(
            f"{file}: needs the columns {', '.join(_NODE)}, pressure and, if it is "
            f"known, gap, with numbers between commas ({sentence_of(error)})"
        ) from error
    loads = values.index.droplevel(["i", "j"]).unique()
    of_load = exact.index.droplevel(["i", "j"])
    unknown = loads.difference(of_load)
    if values.empty or len(unknown):
        raise InvalidCase(
            f"{file}: has {list(unknown) or 'no rows'}, but its scenes and loads must "
            f"be of these: {', '.join(f'{scene} {n}' for scene, n in of_load.unique())}"
        )
    exact = exact[of_load.isin(loads)]
    wrong = values.index.symmetric_difference(exact.index)
    if len(wrong) or values.index.has_duplicates:
        raise InvalidCase(
            f"{file}: must have each node of its scenes and loads once, as "
            "pressures.csv; i and j count from 0, loads from 1 "
            f"(first that is missing or unknown: {[*wrong, 'none'][0]})"
        )
    pressure = values["pressure"]
    if not pressure.between(0, np.inf, inclusive="left").all():
        raise InvalidCase(f"{file}: a pressure is negative or no finite number")
    means, expected = (
        column.groupby(level=_LOAD).mean() for column in (pressure, exact)
    )
    ratio = means / expected
    if ((ratio - 1).abs() > LARGEST_LOAD_ERROR).any():
        worst = (ratio - 1).abs().idxmax()
        raise InvalidCase(
            f"{file}: the mean pressure of {worst} is {means[worst]:.4g}, but the load "
            f"is {expected[worst]:.4g} Pa; give pressures in Pa"
        )
    gaps = np.isfinite(values["gap"]).groupby(level=_LOAD).mean()
    if not gaps.isin([0, 1]).all() or np.isinf(values["gap"]).any():
        raise InvalidCase(
            f"{file}: gap must be a finite number at all nodes of a load, or at none"
        )
    return values


def _results_of_fields(fields: pd.DataFrame) -> pd.DataFrame:
    """Return area, mean gap and largest pressure of a code at each of its loads."""
    values = pd.DataFrame(
        {
            "area": fields["pressure"] > 0,
            "mean_gap": fields["gap"].clip(lower=0),
            "mean_pressure": fields["pressure"],
        }
    )
    groups = values.groupby(level=_LOAD, sort=False)
    largest = fields["pressure"].groupby(level=_LOAD, sort=False).max()
    return groups.mean().assign(largest_pressure=largest).reset_index()


def _distances(pressures: pd.DataFrame) -> pd.DataFrame:
    """Return the distances of the pressures of all codes at a load, by code.

    "field" is the L2 norm of the difference from the reference over that of the
    reference.  "distribution" is the Wasserstein distance of the distributions over the
    mean contact pressure of the reference.
    """
    exact = pressures[REFERENCE].to_numpy()
    rows = {}
    for code, column in pressures.dropna(axis="columns").items():
        found = column.to_numpy()
        moved = np.abs(np.sort(found) - np.sort(exact)).mean()
        rows[code] = (l2_distance(found, exact), moved / exact[exact > 0].mean())
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(DISTANCES))
    return table.rename_axis("code")
