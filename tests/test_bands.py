"""No band of the package's gates grows, and no gate goes, unseen: `bands.csv` keeps them all.

`python tests/test_bands.py` writes the file anew; a commit that widens a band says why.
"""

import csv
from collections import defaultdict
from pathlib import Path

from click.testing import CliRunner

from epcontact.cli.main import cli
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.harness.verdict.verification import verify

FILE = Path(__file__).with_name("bands.csv")
CASES = Path(__file__).parents[1] / "cases"

Bands = dict[tuple[str, str, str], tuple[float, float]]  # of gates by case, size and name


def kept():
    with FILE.open(encoding="utf-8", newline="") as file:
        return {
            (case, size, row["gate"]): (float(row["low"]), float(row["high"]))
            for row in csv.DictReader(file)
            for case, *sizes in map(str.split, row["cases"].split(", "))
            for size in sizes
        }


def present():
    return {
        (text.id, size, gate.name): (gate.low, gate.high)
        for path in sorted(CASES.glob("*.toml"))
        for text in find_named(path)
        for size in text.sizes
        for gate in load_case(text, size).gates
    }


def write(bands):
    places: dict[tuple[str, float, float], dict[str, str]] = defaultdict(lambda: defaultdict(str))
    for (case, size, gate), band in bands.items():
        places[gate, *band][case] += f" {size}"
    with FILE.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("gate", "low", "high", "cases"))
        for band, sizes in places.items():
            table.writerow((*band, ", ".join(case + where for case, where in sizes.items())))


def test_no_band_of_the_cases_grew_and_none_is_gone():
    before, after, none = kept(), present(), (-float("inf"), float("inf"))
    assert len(before) > 1000
    bands = {gate: (band, after.get(gate, none)) for gate, band in before.items()}
    assert not [g for g, (old, new) in bands.items() if new[0] < old[0] or new[1] > old[1]]


def test_the_command_lists_bands_with_their_margins(tmp_path):
    verify("bearing-area", output=tmp_path, jobs=1)
    command = ["gates", "bearing-area", "--output", str(tmp_path)]
    listed = CliRunner().invoke(cli, command).output.splitlines()
    fast, full = [line for line in listed if "area.total.raw of bem against" in line]
    assert "-0.0002 … 0.0002" in fast
    assert " – " not in fast
    assert " – " in full  # which was not verified
    (tmp_path / "verdict.json").write_text("{}")
    assert "is no verdict" in str(CliRunner().invoke(cli, command).exception)


if __name__ == "__main__":
    write(present())
