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
    """Return a table with a row for each gate, for each value of a method that is only
    a reference, and for each count of work.

    Args:
        path: a verdict.json, the folder that holds it, or a table of `save_values`.

    Raises:
        OutputError: if it is no verdict.
        InvalidCase: if it is no such table.
    """
    if path.suffix != ".csv":
        file = path / "verdict.json" if path.is_dir() else path
        verdict = Verdict.read(file, alone=True)
        rows = [row for case in verdict.cases for row in _rows(case)]
        return pd.DataFrame(rows, columns=_COLUMNS)
    texts = dict.fromkeys((*KEYS, "scene", "status"), str)
    try:
        values = pd.read_csv(path, dtype=texts)
        repeated = [
            *_CASE,
            "scene",
        ]  # they are empty where they are as in the row above
        values[repeated] = values[repeated].ffill()
        return values[_COLUMNS].fillna({"scene": "", "status": ""})
    except (OSError, ValueError, KeyError):
        raise InvalidCase(
            f"{path}: is no table that `epcontact compare --keep` wrote"
        ) from None


def _rows(case: CaseVerdict) -> Iterator[dict[str, Any]]:
    """Yield the rows of a case."""
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
    """Write a table of `read_values`, without seconds.

    What the file already has of other cases and sizes stays.  Raises OutputError.
    """
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
    """Compare two tables of `read_values`.

    Raises InvalidCase if they have no case of one size in common.
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
    """Return the digest of the scenes of each case and size."""
    return values.groupby(_CASE)["scene"].first()


def _scenes_in_common(old: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return the digests of the scenes, old and new, of each case that both have."""
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
    """Return the cases that a table has and another one has not, of sizes that were
    run.
    """
    alone = _scenes(values).index.difference(_scenes(others).index)
    sizes = {*new["size"]}
    return [f"{case} {size}" for case, size in alone if size in sizes]


def _names(rows: pd.DataFrame) -> list[str]:
    return [
        f"{case} {size}: {name}"
        for case, size, name in rows[KEYS].itertuples(index=False)
    ]


def _moves(values: pd.DataFrame) -> pd.DataFrame:
    """Return the values that changed, each once, with the allowed change as `error` and
    `moved`, the change in units of it.
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
