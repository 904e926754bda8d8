"""What changed between two verdicts: values in units of their error estimates, bands,
work.

A value without an error estimate may change by `CHANGE_WITHOUT_ERROR` of itself, or by
a hundredth of a band that is absolute.  If the reference is 0, the gate's band is the
allowed change.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact.errors import InvalidCase
from epcontact.files import atomic_write
from epcontact.harness.gates import GateVerdict
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict

#: The values of this release; `epcontact compare NEW --keep FILE` writes such a table.
RELEASE_VALUES = Path(__file__).with_name("release_values.csv")
#: Relative change that is allowed to a value without an error estimate.
CHANGE_WITHOUT_ERROR = 1e-4
#: Changes below this fraction of the error estimate are ignored.
SMALLEST_CHANGE = 0.01
#: A count of work has grown if it is so many times what it was.
MORE_WORK = 1.05

_CASE = ["case", "size"]
#: The columns that name a value.
KEYS = ["case", "size", "name"]
_COLUMNS = [*KEYS, "scene", "value", "reference", "error", "low", "high", "status"]
#: The end of the names of gates that compare with 0.
_IDENTITY = "against 0 (absolute)"
#: The note on gates that held before.
NO_LONGER_HOLDS = "held, and does not hold now"


@dataclass(frozen=True)
class Comparison:
    """What changed between two verdicts.

    Attributes:
        moved: the values that changed, the largest change first, with the columns case,
            size, name, value_old, value_new, error (the allowed change) and moved (the
            change in units of it).
        slower: the counts of work that grew, with their ratio.
        notes: the names of other values and cases, by what is said of them.
        time: the median ratio of seconds; NaN if there are none.
        compared: the number of values that were compared.
    """

    moved: pd.DataFrame
    slower: pd.DataFrame
    notes: Mapping[str, list[str]]
    time: float
    compared: int

    @property
    def beyond(self) -> int:
        """The number of values that changed by more than their error estimates."""
        return int((self.moved["moved"] > 1).sum())

    @property
    def exit_code(self) -> int:
        """1 if a value changed by more than its error estimate, or if a gate that held
        does not; else 0.
        """
        return int(self.beyond > 0 or bool(self.notes[NO_LONGER_HOLDS]))


# --- tables of values


def read_values(path: Path) -> pd.DataFrame:
    """Read the values of a verification run as a table.

    The table has a row for each gate, for each value of a method that is only a
    reference, and for each count of work.

    Args:
        path: a verdict.json, the folder that contains it, or a table (.csv) that
            `save_values` wrote.

    Returns:
        The columns case, size, name (of the gate or count), scene (the beginning of the
        digest of the scenes), value and reference (means in the unit of the quantity),
        error (the error estimate of the value), low and high (the band), and status
        ("" if the gate holds).

    Raises:
        OutputError: if there is no such verdict.json, or if it was changed.
        InvalidCase: if a .csv file is no such table.
    """
    if path.suffix != ".csv":
        file = path / "verdict.json" if path.is_dir() else path
        verdict = Verdict.read(file, alone=True)
        rows = [row for case in verdict.cases for row in _rows(case)]
        return pd.DataFrame(rows, columns=_COLUMNS)
    texts = dict.fromkeys((*KEYS, "scene", "status"), str)
    try:
        values = pd.read_csv(path, dtype=texts)
        # These columns are empty where they repeat the row above.
        repeated = [*_CASE, "scene"]
        values[repeated] = values[repeated].ffill()
        numbers = ["value", "reference", "error", "low", "high"]
        values[numbers] = values[numbers].apply(pd.to_numeric)
        return values[_COLUMNS].fillna({"scene": "", "status": ""})
    except (OSError, ValueError, KeyError):
        raise InvalidCase(
            f"{path}: is no table that `epcontact compare --keep` wrote"
        ) from None


def _rows(case: CaseVerdict) -> Iterator[dict[str, Any]]:
    """Yield the rows of `read_values` for one case, as dictionaries by column.

    They are in the order of the gates; counts of work and seconds follow.
    """
    rows: dict[str, dict[str, Any]] = {}
    for gate in case.gates:
        rows[gate.name] = _gate_row(gate)
        if gate.reference is not None and gate.against in case.methods:
            row = rows.setdefault(f"{gate.quantity} of {gate.against}", {})
            row["value"] = gate.reference.mean
            row["error"] = gate.reference.claimed_error
    for method, entry in case.methods.items():
        for count, value in entry.counts.items():
            rows[f"cost.{count} of {method}"] = {"value": value}
        if entry.seconds:
            seconds = sum(entry.seconds.values())
            rows[f"cost.seconds of {method}"] = {"value": seconds}
    about = {"case": case.id, "size": case.size, "scene": case.scene[:8], "status": ""}
    for name, row in rows.items():
        yield about | {"name": name} | row


def _gate_row(gate: GateVerdict) -> dict[str, Any]:
    """Return the columns of a gate: its band, and what is known of value, error,
    reference and, unless it holds, status.
    """
    row: dict[str, Any] = {"low": gate.low, "high": gate.high}
    if not gate.holds:
        row["status"] = gate.status
    if gate.value is not None:
        row["value"] = gate.value.mean
        row["error"] = gate.value.claimed_error
    if gate.reference is not None:
        row["reference"] = gate.reference.mean
    return row


def save_values(values: pd.DataFrame, path: Path) -> None:
    """Write a table of values to a .csv file, without the seconds of solves.

    Rows of other cases and sizes that the file has already are not changed.

    Args:
        values: a table of `read_values`.
        path: the file.

    Raises:
        OutputError: if the file cannot be written.
        InvalidCase: if it exists and is no such table, or does not end with .csv.
    """
    if path.suffix != ".csv":
        raise InvalidCase(f"{path}: a table of values is saved as .csv")
    if path.is_file():
        before = read_values(path)
        cases = pd.MultiIndex.from_frame(values[_CASE])
        others = ~pd.MultiIndex.from_frame(before[_CASE]).isin(cases)
        values = pd.concat([before[others], values])
    values = values[~values["name"].str.startswith("cost.seconds")]
    errors = values["error"].map("{:.2g}".format, na_action="ignore")
    table = values.assign(error=errors)
    as_above = (values[_CASE] == values[_CASE].shift()).all(axis=1)
    table.loc[as_above, [*_CASE, "scene"]] = None
    with atomic_write(path) as file:
        table.to_csv(file, index=False, float_format="%.9g")


# --- comparison


def compare(old: pd.DataFrame, new: pd.DataFrame) -> Comparison:
    """Return what changed between two verification runs.

    Values are compared only for cases that both runs solved on the same scenes.

    Args:
        old: the values of the earlier run, a table of `read_values`.
        new: those of the later run.

    Raises:
        InvalidCase: if no case was run at the same size in both.
    """
    scenes = _scenes_in_common(old, new)
    known = (scenes != "").all(axis=1)
    changed = scenes.index[known & (scenes["old"] != scenes["new"])]
    compared = scenes.index.difference(changed)
    both = old.merge(
        new, on=KEYS, how="outer", suffixes=("_old", "_new"), indicator="where"
    )
    both = both[pd.MultiIndex.from_frame(both[_CASE]).isin(compared)]
    is_work = both["name"].str.startswith("cost.")
    in_both = both["where"] == "both"
    values = both[in_both & ~is_work]
    counts = both[in_both & is_work]
    counts = counts.assign(ratio=counts["value_new"] / counts["value_old"])
    is_time = counts["name"].str.startswith("cost.seconds")
    grown = counts[~is_time & (counts["ratio"] > MORE_WORK)]
    held = (values["status_old"] == "") & (values["status_new"] != "")
    wider = values["low_new"] < values["low_old"]
    wider |= values["high_new"] > values["high_old"]
    notes = {
        NO_LONGER_HOLDS: _names(values[held]),
        "of another scene, not compared": [" ".join(each) for each in changed],
        "of untold scenes": [" ".join(each) for each in scenes.index[~known]],
        "in a wider band": _names(values[wider]),
        "cases of NEW alone": _cases_alone(new, old, new),
        "figures of NEW alone": _names(
            both[~is_work & (both["where"] == "right_only")]
        ),
        "cases of OLD alone": _cases_alone(old, new, new),
        "figures of OLD alone": _names(both[~is_work & (both["where"] == "left_only")]),
    }
    return Comparison(
        moved=_moves(values),
        slower=grown.sort_values("ratio", ascending=False),
        notes=notes,
        time=counts["ratio"][is_time].median(),
        compared=len(values),
    )


def _scenes(values: pd.DataFrame) -> pd.Series[str]:
    """Return the digest of the scenes of each case, with case and size as the index.

    `values` is a table of `read_values`.
    """
    return values.groupby(_CASE)["scene"].first()


def _scenes_in_common(old: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return the digests of the scenes of each case that two tables have in common.

    Args:
        old, new: tables of `read_values`.

    Returns:
        A table with the columns old and new, and case and size as its index.

    Raises:
        InvalidCase: if there is no such case.
    """
    scenes = [_scenes(old), _scenes(new)]
    common = pd.concat(scenes, axis=1, join="inner", keys=["old", "new"])
    if common.empty:
        sizes = [
            ", ".join(sorted({*of_table.index.get_level_values("size")}))
            for of_table in scenes
        ]
        raise InvalidCase(
            "the verdicts have no case of one size in common: "
            f"OLD has {len(scenes[0])} of size {sizes[0]}, "
            f"NEW {len(scenes[1])} of {sizes[1]}"
        )
    return common


def _cases_alone(
    values: pd.DataFrame, others: pd.DataFrame, new: pd.DataFrame
) -> list[str]:
    """Return the cases that only one of two tables has, as "case size".

    Args:
        values: the table whose cases are listed.
        others: the table that must not have them.
        new: the later run; cases of sizes that it did not run are not listed.
    """
    alone = _scenes(values).index.difference(_scenes(others).index)
    sizes = {*new["size"]}
    return [f"{case} {size}" for case, size in alone if size in sizes]


def _names(rows: pd.DataFrame) -> list[str]:
    """Return the name of each row of a table of values, as "case size: name"."""
    return [
        f"{case} {size}: {name}"
        for case, size, name in rows[KEYS].itertuples(index=False)
    ]


def _moves(values: pd.DataFrame) -> pd.DataFrame:
    """Return the values that changed, the largest change first, each value once.

    The allowed change of a value is the larger of its two error estimates; the module
    says what it is without an error estimate.  Changes below `SMALLEST_CHANGE` of the
    allowed change are left out.

    Args:
        values: rows that two runs have in common, with the columns of both runs ending
            in _old and _new.

    Returns:
        The rows, with the columns `error` (the allowed change, in the unit of the
        value) and `moved` (the change over the allowed change).
    """
    old = values["value_old"].to_numpy(float)
    new = values["value_new"].to_numpy(float)
    errors = (values[name].to_numpy(float) for name in ("error_old", "error_new"))
    error = np.fmax(*errors)
    band = (values["high_old"] - values["low_old"]).to_numpy(float) / 2
    relative = values["name"].str.endswith("(relative)").to_numpy() | np.isnan(band)
    without_error = np.fmax(
        CHANGE_WITHOUT_ERROR * np.fmax(abs(old), abs(new)),
        np.where(relative, 0, band / 100),
    )
    allowed = np.where(error > 0, error, without_error)
    allowed = np.where(values["name"].str.endswith(_IDENTITY), band, allowed)
    same = (old == new) | (np.isnan(old) & np.isnan(new))
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.where(same, 0.0, abs(new - old) / allowed)
    moved = np.where(np.isnan(moved), np.inf, moved)
    # Several gates may judge one value, which is listed once.
    quantity = values["name"].str.split(" against ").str[0]
    table = values.assign(error=allowed, moved=moved, quantity=quantity)
    table = table[table["moved"] > SMALLEST_CHANGE]
    table = table.sort_values("moved", ascending=False, kind="stable")
    return table.drop_duplicates([*_CASE, "quantity"])
