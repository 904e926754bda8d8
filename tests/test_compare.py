"""What moved since another verdict is told, and no band of the package grew since its
release.
"""

import io
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from rich.console import Console

from epcontact.bem.areas import rim_correction
from epcontact.cli import compare_and_accuracy
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.harness.gates import Estimate
from epcontact.harness.verdict import compare as comparing
from epcontact.harness.verdict.compare import (
    CHANGE_WITHOUT_ERROR,
    RELEASE_VALUES,
    compare,
    read_values,
    save_values,
)
from epcontact.harness.verdict.verification import verify

CASES = Path(__file__).parents[1] / "cases"
SCENE = "westergaard-surface"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with verdicts of one case by three rim corrections.

    They are in "right" (as shipped), "near" (3 % off) and "off" (20 % off, by more than
    the error estimate of the area); the case's band is wide enough for all three.
    """
    folder = tmp_path_factory.mktemp("runs")
    for name, factor in {"right": 1.0, "near": 0.97, "off": 0.8}.items():
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(rim_correction, "OFFSETS", factor * rim_correction.OFFSETS)
            assert verify(SCENE, output=folder / name, jobs=1).passed
    return folder


def compared(*given):
    """Run `epcontact compare` on files.

    Returns the exit code, the output with single spaces, and stderr.
    """
    found = invoke("compare", *given)
    assert max(map(len, found.stdout.splitlines()), default=0) <= 200  # of a pipe
    return found.returncode, " ".join(found.stdout.split()), found.stderr


def test_a_value_that_moved_inside_its_band_is_told(runs, tmp_path):
    """`compare` reports changes in units of the error estimate, and exits with 1 beyond
    it.
    """
    code, said, _ = compared(runs / "right", runs / "right" / "verdict.json")
    assert code == 0
    assert "0 moved beyond their claim, 0 within it" in said
    code, said, _ = compared(
        runs / "right", runs / "near", "--csv", tmp_path / "moved.csv"
    )
    moved = pd.read_csv(tmp_path / "moved.csv").set_index("name")
    error, moves = moved.loc[
        "area.total.corrected of bem against westergaard (relative)"
    ].iloc[-2:]
    assert 0.1 < moves < 1
    assert error > 1.2 * CHANGE_WITHOUT_ERROR * 0.564  # it is the claim of the area
    assert code == 0
    assert "area.total.corrected of bem" in said
    code, said, _ = compared(runs / "right", runs / "off")
    assert code == 1
    assert "1 moved beyond their claim" in said


def test_a_kept_table_stands_for_its_verdict(runs, tmp_path):
    """The table that `compare --keep` writes gives the same comparison as
    its verdict.
    """
    kept = tmp_path / "kept.csv"
    for _ in range(2):
        assert invoke("compare", runs / "right", "--keep", kept).returncode == 0
    said = compared(runs / "right", runs / "right")[1]
    assert kept.stat().st_size < (runs / "right" / "verdict.json").stat().st_size / 3
    assert compared(kept, runs / "right") == (0, said.partition("; seconds")[0], "")
    assert compared(kept, runs / "off")[0] == 1


def changed_tables():
    """Return the values of two runs, made so that each kind of change occurs once."""
    columns = ("case", "name", "value", "error", "low", "high")
    old = pd.DataFrame(
        [
            ("a", "x of m against 1 (relative)", 1.0, 0.1, -1.0, 1.0),
            ("a", "y of m against 0 (absolute)", 0.0, 0.5, -0.25, 0.75),
            ("a", "cost.fft_pairs of m", 8.0, np.nan, np.nan, np.nan),
            ("a", "cost.seconds of m", 2.0, np.nan, np.nan, np.nan),
            ("b", "z of m", 5.0, np.nan, np.nan, np.nan),
            ("b", "w of m against n (relative)", 3.0, 0.2, -0.1, 0.3),
            ("b", "gone of m", 1.0, np.nan, np.nan, np.nan),
            ("b", "v of m", 7.0, 0.1, np.nan, np.nan),
        ],
        columns=columns,
    ).assign(size="fast", scene="", status="", reference=np.nan)
    new = old[old["name"] != "gone of m"].copy()
    new["value"] = [1.25, 0.125, 12.0, 5.0, 5.001, 3.05, 7.0]
    # The first band is narrower, the second wider below, and that of w wider above.
    new.loc[0, ["low", "high"]] = [-0.5, 0.5]
    new.loc[1, "low"] = -0.5
    new.loc[5, ["status", "error", "high"]] = ["falls short", 0.4, 0.5]
    another_scene = old.tail(1).assign(
        case="c", size="full", name="x of m", scene="one", value=1.0
    )
    old = pd.concat([old, another_scene])
    moved_scene = another_scene.assign(scene="two", value=9.0)
    added = [new.tail(1).assign(name=f"{name} of m") for name in "efghiju"]
    new = pd.concat([new, moved_scene, *added, moved_scene.assign(case="d")])
    return old, new


def test_each_change_is_counted_in_error_estimates():
    """Changes are sorted and divided by error estimates; two of them are too large."""
    comparison = compare(*changed_tables())
    moved = comparison.moved.set_index("quantity")["moved"]
    # z has no error estimate: the comparison takes 1e-4 of the value.
    expected = {
        "x of m": 0.25 / 0.1,
        "z of m": 0.001 / (1e-4 * 5.001),
        "y of m": 0.125 / 0.5,
        "w of m": 0.05 / 0.4,
    }
    assert [*moved.index] == [*expected]
    assert moved.to_dict() == pytest.approx(expected)
    assert comparison.beyond == 2
    assert comparison.compared == 5
    assert comparison.exit_code == 1
    assert comparison.time == pytest.approx(5.0 / 2.0)
    assert [*comparison.slower["name"]] == ["cost.fft_pairs of m"]
    assert comparison.notes[comparing.NO_LONGER_HOLDS] == [
        "b fast: w of m against n (relative)"
    ]
    assert comparison.notes["in a wider band"] == [
        "a fast: y of m against 0 (absolute)",
        "b fast: w of m against n (relative)",
    ]


def test_a_value_without_an_error_may_change_by_a_hundredth_of_its_band():
    """In an absolute gate a hundredth of the band's half-width counts, here 0.005."""
    columns = {
        "case": "a",
        "size": "fast",
        "name": "u of m against 0.2 (absolute)",
        "scene": "",
        "status": "",
        "error": np.nan,
        "low": -0.5,
        "high": 0.5,
        "reference": 0.2,
    }
    old, new = (pd.DataFrame([columns | {"value": v}]) for v in (0.2, 0.201))
    assert compare(old, new).moved["moved"].item() == pytest.approx(0.2)


def test_a_terminal_shows_old_and_new_of_each_change(monkeypatch):
    """Rows have the old value, the new one and the change in error estimates, which is
    red above 1; work has the ratio of new to old, and the last line counts.
    """
    comparison = compare(*changed_tables())
    shown = io.StringIO()
    console = Console(
        file=shown, width=160, force_terminal=True, color_system="standard"
    )
    monkeypatch.setattr(compare_and_accuracy, "open_console", lambda: console)
    compare_and_accuracy._print_comparison(comparison)
    text = shown.getvalue()
    is_red = {}
    for line in text.splitlines():
        words = re.sub(r"\x1b\[[\d;]*m", "", line).split()
        if "of" in words and words[:1] != ["values"]:
            is_red[words[0]] = "\x1b[1;31m" in line
    plain = " ".join(re.sub(r"\x1b\[[\d;]*m", "", text).split())
    assert "x of m 1 1.25 2.5" in plain
    assert "w of m 3 3.05 0.12" in plain
    assert is_red["x"]
    assert is_red["z"]
    assert not is_red["y"]
    assert not is_red["w"]
    assert "a fast: fft_pairs of m 8 12 1.50" in plain
    assert (
        "5 values compared: 2 moved beyond their claim, 2 within it; more work: 1; "
        "seconds: 2.50 times as many" in plain
    )


def test_a_value_barely_beyond_its_error_is_red(monkeypatch):
    """A change of 1.5 error estimates is beyond the error, not only one of 2."""
    old, new = changed_tables()
    new.loc[0, "value"] = 1.15
    shown = io.StringIO()
    console = Console(
        file=shown, width=160, force_terminal=True, color_system="standard"
    )
    monkeypatch.setattr(compare_and_accuracy, "open_console", lambda: console)
    compare_and_accuracy._print_comparison(compare(old, new))
    (line,) = [line for line in shown.getvalue().splitlines() if "x of m" in line]
    assert "\x1b[1;31m" in line.partition("1.15")[2]
    assert "1.5" in line.partition("1.15")[2]


def test_a_kept_table_has_no_seconds_and_the_error_of_each_reference(tmp_path):
    """Seconds of solves differ from run to run and are not kept.  A method that is the
    reference of a gate has a row with its own value and error estimate.
    """
    old, _ = changed_tables()
    save_values(old, tmp_path / "kept.csv")
    kept = read_values(tmp_path / "kept.csv")
    names = set(old["name"]) - {"cost.seconds of m"}
    assert set(kept["name"]) == names
    estimates = [
        Estimate(mean=mean, half_width_95=0.5, surfaces=2, claimed_error=claimed)
        for mean, claimed in ((2.0, 0.1), (3.0, 0.2))
    ]
    gate = SimpleNamespace(
        name="x of m against n (relative)",
        quantity="x",
        against="n",
        low=-1.0,
        high=1.0,
        holds=True,
        value=estimates[0],
        reference=estimates[1],
    )
    methods = {"n": SimpleNamespace(counts={}, seconds={})}
    case = SimpleNamespace(
        gates=[gate], methods=methods, id="a", size="fast", scene="0123456789"
    )
    first, second = comparing._rows(case)
    assert (first["value"], first["error"], first["reference"]) == (2.0, 0.1, 3.0)
    assert (second["name"], second["value"], second["error"]) == ("x of n", 3.0, 0.2)


def test_what_is_gone_is_told(runs, tmp_path):
    """A case that only the old run has is named, if it has the size of the new run."""
    figures = read_values(runs / "right")
    # Full cases say nothing of a run that is fast; a fast case that is gone is named.
    others = (("big", "full"), ("gone", "fast"))
    more = [figures.assign(case=case, size=size) for case, size in others]
    pd.concat([figures, *more]).to_csv(tmp_path / "old.csv")
    said = compared(tmp_path / "old.csv", runs / "right")[1]
    assert "cases of OLD alone: gone fast 9 values" in said


def test_what_cannot_be_compared_is_one_sentence(runs, tmp_path):
    """Edited, absent or foreign files give exit code 2 and one line that says why."""
    assert "3 are given" in compared(tmp_path, tmp_path, tmp_path)[2]
    (tmp_path / "verdict.json").write_text("{}")
    (tmp_path / "table.csv").write_text("a,b\n1,2\n")
    content = (runs / "right/verdict.json").read_text()
    figures = read_values(runs / "right")
    (tmp_path / "alone.json").write_text(content)  # as kept of an earlier run
    assert compared(tmp_path / "alone.json", runs / "right")[0] == 0
    (tmp_path / "edited.json").write_text(content.replace("holds", "skips"))
    figures.assign(size="full").to_csv(tmp_path / "full.csv")
    for other, words in {
        tmp_path: "was changed, moved or",
        tmp_path / "edited.json": "was changed, moved or",
        tmp_path / "absent": "cannot read",
        tmp_path / "table.csv": "is no table that",
        tmp_path / "full.csv": "OLD has 1 of size full, NEW 1 of fast",
    }.items():
        code, said, error = compared(other, runs / "right")
        assert code == 2
        assert said == ""
        assert words in error
        assert error.count("\n") == 1


def test_no_band_of_the_cases_grew_and_none_is_gone():
    """Each band of the release is still there, and none has become wider."""
    kept = (
        read_values(RELEASE_VALUES)
        .dropna(subset="low")
        .set_index(["case", "size", "name"])
    )
    assert len(kept) > 900
    present = {
        (text.id, size, gate.name): (gate.low, gate.high)
        for path in sorted(CASES.glob("*.toml"))
        for text in find_named(path)
        for size in text.sizes
        for gate in load_case(text, size).gates
    }
    none = (-float("inf"), float("inf"))
    bands = {name: present.get(name, none) for name in kept.index}
    before = zip(kept["low"], kept["high"], strict=True)
    assert [
        name
        for (name, new), old in zip(bands.items(), before, strict=True)
        if new[0] < old[0] or new[1] > old[1]
    ] == []


@pytest.mark.slow
def test_no_value_moved_since_the_release(tmp_path):
    """A complete `verify` has the values of the release within their error
    estimates.
    """
    verify(output=tmp_path)
    assert compared(tmp_path)[0] == 0


@pytest.mark.parametrize("column", ["value", "reference", "error", "low", "high"])
def test_a_word_in_a_column_of_numbers_is_one_sentence(tmp_path, column):
    """A table of --keep with a word in the place of a number is refused by its name."""
    table = pd.read_csv(RELEASE_VALUES).astype({column: object})
    table.loc[1, column] = "word"
    table.to_csv(tmp_path / "kept.csv", index=False)
    done = invoke("compare", tmp_path / "kept.csv", RELEASE_VALUES)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "kept.csv: is no table that `epcontact compare --keep` wrote" in done.stderr
