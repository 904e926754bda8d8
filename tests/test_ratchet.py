"""The ratchet on bands: what grows or goes needs a reason."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from epcontact.cli.main import cli
from epcontact.errors import InvalidCase
from epcontact.harness.gates.gate import Gate, judge, judge_distance, unjudged
from epcontact.harness.verdict.ratchet import (
    KEPT,
    Banded,
    Change,
    Kept,
    KeptBand,
    banded_gates,
    margin,
    problems,
    read_kept,
    updated,
    write_kept,
)

GATE = Banded("case", "fast", "gate", -0.1, 0.2, "a reason")
CASES = Path(__file__).parent.parent / "cases"


def kept(low: float, high: float, *changed: Change) -> Kept:
    gates = {"case": {"fast": {"gate": KeptBand(band=(low, high), margin=3.0)}}}
    return Kept(gates=gates, changed=list(changed))


def change(*band: float, gate: str = "gate") -> Change:
    return Change(case="case", size="fast", gate=gate, band=band or None, because="why")


def test_no_band_of_the_cases_grew_and_none_is_gone() -> None:
    found = read_kept(CASES / KEPT)
    assert len(found.gates) > 30
    assert problems(found, banded_gates()) == []


@pytest.mark.parametrize(
    ("old", "gates", "word"),
    [
        (kept(-0.1, 0.2), [GATE], ""),
        (kept(-0.3, 0.3), [GATE], ""),
        (kept(-0.05, 0.2), [GATE], "wider than the kept one, [-0.05, 0.2]"),
        (kept(-0.1, 0.15), [GATE], "wider"),
        (kept(-0.1, 0.15, change(-0.1, 0.2)), [GATE], ""),
        (kept(-0.1, 0.15, change(-0.1, 0.17)), [GATE], "wider"),
        (kept(-0.1, 0.15, change(-0.1, 0.2, gate="other")), [GATE], "wider"),
        (kept(-0.1, 0.2), [], "is gone"),
        (kept(-0.1, 0.2, change()), [], ""),
        (kept(-0.1, 0.2, change(-0.1, 0.3)), [], "is gone"),
        (kept(-0.1, 0.2), [replace(GATE, size="full")], "is gone"),
    ],
)
def test_a_band_grows_or_goes_only_with_a_reason(old, gates, word) -> None:
    found = problems(old, gates)
    assert (word in found[0]) if word else found == []


def test_what_is_kept_is_read_back(tmp_path) -> None:
    found = updated(kept(-0.3, 0.3, change(-1, 1)), [GATE], {GATE.key: math.inf})
    write_kept(tmp_path / "gates.toml", found)
    assert read_kept(tmp_path / "gates.toml") == found
    assert found.gates["case"]["fast"]["gate"] == KeptBand(band=(-0.1, 0.2), margin=math.inf)
    assert updated(kept(-0.3, 0.3), [GATE], {}).gates["case"]["fast"]["gate"].margin == 3.0
    with pytest.raises(InvalidCase, match="wider"):
        updated(kept(-0.01, 0.3), [GATE], {})
    (tmp_path / "gates.toml").write_text("[gates]\nx = 1\n")
    with pytest.raises(InvalidCase, match="is no file of kept bands"):
        read_kept(tmp_path / "gates.toml")


def test_margin_is_the_band_over_difference_and_interval() -> None:
    gate = Gate("area.total.raw", "bem", "persson", "absolute", -0.1, 0.3, "-")
    assert margin(judge(gate, [1.2], [1.0], paired=False)) == pytest.approx(0.2 / 0.1)
    assert margin(judge(gate, [1.1], [1.0], paired=False)) > 1e10
    spread = judge(gate, [1.0, 1.2], [1.0], paired=False)
    assert margin(spread) == pytest.approx(0.2 / spread.difference.half_width)
    assert margin(judge_distance(replace(gate, norm="l2"), [0.1])) == pytest.approx(3.0)
    assert margin(unjudged(gate, "no")) is None


def test_the_command_lists_and_checks(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(CASES.parent)
    listed = CliRunner().invoke(cli, ["gates", "punch-disc", "--output", str(tmp_path)])
    assert "area.total.raw of bem against flat_punch" in listed.output
    assert "0.004" in listed.output
    checked = CliRunner().invoke(cli, ["gates", "--check", "--output", str(tmp_path)])
    assert (checked.exit_code, "gates checked" in checked.output) == (0, True)
    refused = CliRunner().invoke(cli, ["gates", "--check", "punch-disc"])
    assert refused.exit_code == 2
