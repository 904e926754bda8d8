"""The ratchet: bands of gates may narrow, but widen or go only with a reason.

`regression/gates.toml` beside the cases keeps every gate's band and its margin when it was kept.
`problems` compares it with the case files.  A band that grew, a gate that is gone and a default
gate that a case no longer holds are problems unless a table [[changed]] of the file says why:

    [[changed]]
    case = "hertz-sphere"
    size = "fast"
    gate = "area.total.corrected of bem against hertz (relative)"
    band = [-3e-3, 3e-3]                # left out if the gate is gone
    because = "The grid is half as fine."

The margin of a gate is half the width of its band over the distance of the difference from the
band's middle plus the half-width of its interval; of a distance, the band over both.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import CaseText, find_cases, load_case
from epcontact.harness.gates.gate import DISTRIBUTION_NORMS, GateVerdict
from epcontact.harness.verdict.record import Verdict
from epcontact.output.files import whole_file

#: The kept bands, relative to the folder of the cases.
KEPT = Path("regression") / "gates.toml"
#: A gate with a larger margin is kept as exact.
_EXACT = 1e3


@dataclass(frozen=True)
class Banded:
    """A gate of a case at a size: its name, its band, and the reason of the band."""

    case: str
    size: str
    gate: str
    low: float
    high: float
    because: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What identifies the gate."""
        return self.case, self.size, self.gate


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class KeptBand(_Table):
    """A band and, where the gate was judged, its margin."""

    band: tuple[float, float]
    margin: float | None = None


class Change(_Table):
    """A reason why a band is wider than the kept one or, without a band, why the gate is gone."""

    case: str
    size: str
    gate: str
    band: tuple[float, float] | None = None
    because: str = Field(min_length=1)


class Kept(_Table):
    """The kept bands by case, size and gate, and the reasons of changes."""

    gates: dict[str, dict[str, dict[str, KeptBand]]] = {}
    changed: list[Change] = []

    def band(self, key: tuple[str, str, str]) -> KeptBand | None:
        """Return the kept band of a gate, if there is one."""
        case, size, gate = key
        return self.gates.get(case, {}).get(size, {}).get(gate)


def banded_gates(cases: Iterable[CaseText] | None = None) -> list[Banded]:
    """Return the gates of cases at every size they offer; None: of all cases.

    Example:
        >>> from epcontact.harness.case_files.case import find_named
        >>> [gate.high for gate in banded_gates(find_named("punch-disc"))][:2]
        [1e-12, 0.004]
    """
    return [
        Banded(text.id, size, gate.name, gate.low, gate.high, gate.because)
        for text in (find_cases() if cases is None else cases)
        for size in text.sizes
        for gate in load_case(text, size).gates
    ]


def kept_file() -> Path:
    """Return the file of the kept bands, beside the cases.  Raises InvalidCase if there is none."""
    for text in find_cases()[:1]:
        return text.path.parent / KEPT
    raise InvalidCase("no cases found, neither in ./cases nor in the installed package")


def read_kept(path: Path) -> Kept:
    """Read the kept bands; none if there is no such file.  Raises InvalidCase."""
    if not path.exists():
        return Kept()
    try:
        return Kept.model_validate(tomllib.loads(path.read_text("utf-8")))
    except (tomllib.TOMLDecodeError, ValidationError) as error:
        text = " ".join(str(error).split())
        raise InvalidCase(f"{path}: is no file of kept bands: {text}") from None


def problems(kept: Kept, gates: Sequence[Banded]) -> list[str]:
    """Return a sentence for each band that grew, and each gate that is gone, without a reason."""
    now = {gate.key: gate for gate in gates}
    allowed = {(c.case, c.size, c.gate): c for c in kept.changed}
    found = []
    for case, sizes in kept.gates.items():
        for size, names in sizes.items():
            for name, old in names.items():
                key = case, size, name
                sentence = _problem(old, now.get(key), allowed.get(key))
                if sentence:
                    found.append(f"{case}, {size}: {name} {sentence}")
    return found


def _problem(old: KeptBand, gate: Banded | None, change: Change | None) -> str:
    remedy = f"; give the reason in a table [[changed]] of {KEPT.as_posix()}"
    if gate is None:
        gone = change is not None and change.band is None
        return "" if gone else f"is gone or has another reference{remedy}"
    low, high = (change.band if change is not None else None) or old.band
    if gate.low >= min(low, old.band[0]) and gate.high <= max(high, old.band[1]):
        return ""
    return (
        f"has the band [{gate.low:g}, {gate.high:g}], which is wider than the kept one, "
        f"[{old.band[0]:g}, {old.band[1]:g}]{remedy}"
    )


# --- margins --------------------------------------------------------------------------------------


def margin(gate: GateVerdict) -> float | None:
    """Return the margin of a judged gate; None if it was not judged, infinite if it is exact."""
    if gate.difference is None:
        return None
    one_sided = gate.norm in (*DISTRIBUTION_NORMS, "l2") and gate.low <= 0
    low = -gate.high if one_sided else gate.low
    middle, half = (low + gate.high) / 2, (gate.high - low) / 2
    used = abs(gate.difference.mean - middle) + gate.half_width
    return half / used if used > 0 else math.inf


def margins(verdict: Verdict) -> dict[tuple[str, str, str], float]:
    """Return the margins of a verdict's gates by case, size and gate."""
    found = {}
    for case in verdict.cases:
        for gate in case.gates:
            if (value := margin(gate)) is not None:
                found[case.id, case.size, gate.name] = value
    return found


# --- keeping --------------------------------------------------------------------------------------


def updated(
    kept: Kept, gates: Sequence[Banded], known: Mapping[tuple[str, str, str], float]
) -> Kept:
    """Return the bands of `gates` with known margins; a gate without one keeps its old margin.

    Raises:
        InvalidCase: if there are problems.
    """
    if wrong := problems(kept, gates):
        raise InvalidCase(wrong[0])
    tables: dict[str, dict[str, dict[str, KeptBand]]] = {}
    for gate in gates:
        old = kept.band(gate.key)
        value = known.get(gate.key, None if old is None else old.margin)
        # A margin of rounding would be another number on every machine.
        exact = value is not None and value > _EXACT
        rounded = value if value is None else math.inf if exact else float(f"{value:.2g}")
        band = KeptBand(band=(gate.low, gate.high), margin=rounded)
        tables.setdefault(gate.case, {}).setdefault(gate.size, {})[gate.gate] = band
    return Kept(gates=tables, changed=kept.changed)


def write_kept(path: Path, kept: Kept) -> None:
    """Write the kept bands, one gate a line.

    Raises:
        OutputError: if the file cannot be written.
    """
    lines = [
        "# The band of every gate, and its margin when it was kept: by `epcontact gates --keep`.",
        "# A band may grow, and a gate go, only with a table [[changed]] that says why.",
    ]
    for change in kept.changed:
        lines += ["", "[[changed]]"]
        lines += [f"{k} = {json.dumps(v)}" for k, v in change if v is not None]
    for case, sizes in kept.gates.items():
        for size, names in sizes.items():
            lines += ["", f"[gates.{json.dumps(case)}.{size}]"]
            lines += [f"{json.dumps(name)} = {_inline(band)}" for name, band in names.items()]
    with whole_file(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _inline(kept: KeptBand) -> str:
    low, high = (repr(float(end)) for end in kept.band)
    told = "" if kept.margin is None else f", margin = {kept.margin!r}"
    return f"{{ band = [{low}, {high}]{told} }}"
