"""What moved between two verdicts: values in units of the errors that they claim,
bands, work.

A value that claims no error has to stay within `UNCLAIMED` of itself, or a hundredth of
a band that is absolute.  One that must be 0 is an error itself, and its band is all
that it claims.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact.errors import InvalidCase
from epcontact.files import atomic_write
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict

#: The figures of the release; `epcontact compare NEW --keep FILE` writes such a table.
KEPT = Path(__file__).with_name("kept.csv")
UNCLAIMED = 1e-4
#: What moves by less, in units of its claim, stays where it is.
STILL = 0.01
#: A count of work has grown if it is so many times what it was.
SLOWER = 1.05
_CASE, ROW = ["case", "size"], ["case", "size", "name"]
_COLUMNS = [*ROW, "scene", "value", "reference", "error", "low", "high", "status"]
_IDENTITY = "against 0 (absolute)"
FELL = "held, and does not hold now"


@dataclass(frozen=True)
class Comparison:
    """What moved: `moved` has case, size, name, value_old, value_new, error, and moved
    in units of it; `slower` the counts that grew, with their ratio; `told` the names of
    others by what is said of them; `time` the median ratio of seconds, and `compared`
    the number of values.
    """

    moved: pd.DataFrame
    slower: pd.DataFrame
    told: Mapping[str, list[str]]
    time: float
    compared: int

    @property
    def beyond(self) -> int:
        """The number of values that moved by more than they claim."""
        return int((self.moved["moved"] > 1).sum())

    @property
    def exit_code(self) -> int:
        """1 if a value moved beyond its claim, or a gate that held does not."""
        return int(self.beyond > 0 or bool(self.told[FELL]))


def read_figures(path: Path) -> pd.DataFrame:
    """Read a verdict.json, the folder that holds it, or a kept table: a row for each
    gate, each answer of a method that is only a reference, and each count of work.
    """
    if path.suffix != ".csv":
        file = path / "verdict.json" if path.is_dir() else path
        rows = [
            row for case in Verdict.read(file, alone=True).cases for row in _rows(case)
        ]
        return pd.DataFrame(rows, columns=_COLUMNS)
    try:
        found = pd.read_csv(path, dtype=dict.fromkeys((*ROW, "scene", "status"), str))
        found[["case", "size", "scene"]] = found[["case", "size", "scene"]].ffill()
        return found[_COLUMNS].fillna({"scene": "", "status": ""})
    except (OSError, ValueError, KeyError):
        raise InvalidCase(
            f"{path}: is no table that `epcontact compare --keep` wrote"
        ) from None


def _rows(case: CaseVerdict) -> list[dict[str, Any]]:
    about = {"case": case.id, "size": case.size, "scene": case.scene[:8], "status": ""}
    found: dict[str, dict[str, Any]] = {}
    for gate in case.gates:
        status = {} if gate.holds else {"status": gate.status}
        found[gate.name] = {"low": gate.low, "high": gate.high} | status
        for side, name in ((gate.value, gate.name), (gate.reference, "")):
            if side is not None and (name or gate.against in case.methods):
                row = found.setdefault(name or f"{gate.quantity} of {gate.against}", {})
                row |= {"value": side.mean, "error": side.claimed_error}
        if gate.reference is not None:
            found[gate.name]["reference"] = gate.reference.mean
    for method, entry in case.methods.items():
        for count, value in entry.counts.items():
            found[f"cost.{count} of {method}"] = {"value": value}
        if entry.seconds:
            found[f"cost.seconds of {method}"] = {"value": sum(entry.seconds.values())}
    return [about | {"name": name} | row for name, row in found.items()]


def keep(figures: pd.DataFrame, path: Path) -> None:
    """Write a table of figures without times; what it has of other cases and sizes
    stays.
    """
    if path.is_file():
        before, cases = read_figures(path), pd.MultiIndex.from_frame(figures[_CASE])
        others = ~pd.MultiIndex.from_frame(before[_CASE]).isin(cases)
        figures = pd.concat([before[others], figures])
    figures = figures[~figures["name"].str.startswith("cost.seconds")]
    same = (figures[_CASE] == figures[_CASE].shift()).all(axis=1)  # as the row above
    shown = figures.assign(
        error=figures["error"].map("{:.2g}".format, na_action="ignore")
    )
    shown.loc[same, [*_CASE, "scene"]] = None
    with atomic_write(path) as file:
        shown.to_csv(file, index=False, float_format="%.9g")


def compare(old: pd.DataFrame, new: pd.DataFrame) -> Comparison:
    """Compare two tables of figures.  Raises InvalidCase if they have no case in
    common.
    """
    scenes = [table.groupby(_CASE)["scene"].first() for table in (old, new)]
    pairs = pd.concat(scenes, axis=1, join="inner", keys=["old", "new"])
    if pairs.empty:
        sizes = [
            ", ".join(sorted({*one.index.get_level_values("size")})) for one in scenes
        ]
        said = f"OLD has {len(scenes[0])} of size {sizes[0]}, NEW {len(scenes[1])} of {sizes[1]}"
        raise InvalidCase(f"the verdicts have no case of one size in common: {said}")
    changed = pairs.index[(pairs != "").all(axis=1) & (pairs["old"] != pairs["new"])]
    both = old.merge(
        new, on=ROW, how="outer", suffixes=("_old", "_new"), indicator="where"
    )
    both = both[
        pd.MultiIndex.from_frame(both[_CASE]).isin(pairs.index.difference(changed))
    ]
    work = both["name"].str.startswith("cost.")
    values, counts = (both[(both["where"] == "both") & kind] for kind in (~work, work))
    counts = counts.assign(ratio=counts["value_new"] / counts["value_old"])
    timed = counts["name"].str.startswith("cost.seconds")
    wider = (values["low_new"] < values["low_old"]) | (
        values["high_new"] > values["high_old"]
    )
    told = {
        FELL: _named(
            values[(values["status_old"] == "") & (values["status_new"] != "")]
        ),
        "of another scene, not compared": [" ".join(each) for each in changed],
        "of untold scenes": [*map(" ".join, pairs.index[(pairs == "").any(axis=1)])],
        "in a wider band": _named(values[wider]),
    }
    for side, mine, other in (("NEW", *scenes[::-1]), ("OLD", *scenes)):
        alone = mine.index.difference(other.index)  # of OLD at the sizes that were run
        told[f"cases of {side} alone"] = [
            f"{c} {s}" for c, s in alone if s in {*new["size"]}
        ]
        one = both["where"] == ("right_only" if side == "NEW" else "left_only")
        told[f"figures of {side} alone"] = _named(both[~work & one])
    slower = counts[~timed & (counts["ratio"] > SLOWER)].sort_values(
        "ratio", ascending=False
    )
    return Comparison(
        _moves(values), slower, told, counts["ratio"][timed].median(), len(values)
    )


def _named(rows: pd.DataFrame) -> list[str]:
    return [
        f"{case} {size}: {name}"
        for case, size, name in rows[ROW].itertuples(index=False)
    ]


def _moves(values: pd.DataFrame) -> pd.DataFrame:
    """Return values that moved, each once, with their unit as `error` and `moved`, in
    units.
    """
    old, new = values["value_old"].to_numpy(float), values["value_new"].to_numpy(float)
    claim = np.fmax(
        values["error_old"].to_numpy(float), values["error_new"].to_numpy(float)
    )
    band = (values["high_old"] - values["low_old"]).to_numpy(float) / 2
    relative = values["name"].str.endswith("(relative)").to_numpy() | np.isnan(band)
    unclaimed = np.fmax(
        UNCLAIMED * np.fmax(abs(old), abs(new)), np.where(relative, 0, band / 100)
    )
    unit = np.where(claim > 0, claim, unclaimed)
    unit = np.where(values["name"].str.endswith(_IDENTITY), band, unit)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.where(
            (old == new) | (np.isnan(old) & np.isnan(new)), 0.0, (new - old) / unit
        )
    found = values.assign(
        error=unit, moved=np.where(np.isnan(moved), np.inf, abs(moved))
    )
    # A value that several gates judge is told once.
    found["figure"] = found["name"].str.split(" against ").str[0]
    found = found[found["moved"] > STILL].sort_values(
        "moved", ascending=False, kind="stable"
    )
    return found.drop_duplicates([*_CASE, "figure"])
