"""What a verification wrote is read back: a file that says something else withdraws the verdict."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import conftest
import pytest

from epcontact.errors import OutputError
from epcontact.harness.verdict.read_back import require_faithful
from epcontact.harness.verdict.verification import verify

GATES = """
[[gate]]
quantity = "area.plastic.raw"
of = "bem"
against = 0.05
norm = "absolute"
tolerance = 1e-9
source = "made up"
because = "it shall fall short"

[[gate]]
quantity = "quantity.mean_gap"
of = "persson"
against = "bem"
tolerance = 9.0
because = "only a smoke test"
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of three surfaces, a paired gate, and gates that hold and fall short."""
    folder = tmp_path_factory.mktemp("written")
    gamma = "energy_reduction = 0.536"
    own = conftest.SMALL_CASE.replace(gamma, f'{gamma}\nspectrum = "surface"')
    (folder / "small.toml").write_text(own + GATES)
    verify(folder / "small.toml", jobs=1, output=folder)
    return folder


GATE, DIFFERENCE = "cases 0 gates", "cases 0 gates 2 difference"
VERDICT, BEM = "verdict.json", "small/fast/bem.json"


@pytest.mark.parametrize(
    ("file", "place", "value", "words"),
    [
        (VERDICT, f"{GATE} 1 status", "holds", "beside its figures"),
        (VERDICT, f"{GATE} 0 status", "falls short", "beside its figures"),
        (VERDICT, "cases 0 status", "holds", "over its gates"),
        (VERDICT, "exit_code", 0, "exit code 0"),
        (VERDICT, "passed", True, "the verdict says"),
        (VERDICT, f"{GATE} 1 value mean", 0.05, "a value of 0.05"),
        (VERDICT, f"{DIFFERENCE} mean", 0.0, "difference of 0.0"),
        (VERDICT, f"{DIFFERENCE} half_width_95", 0.0, "95 % interval of 0.0"),
        (VERDICT, "cases 0 methods bem surfaces", 2, "has not 2 members"),
        (BEM, "members 0 steps", [{}], "a part is missing"),
    ],
)
def test_what_contradicts_another_file_is_withdrawn(
    written: Path, tmp_path: Path, file: str, place: str, value: Any, words: str
) -> None:
    folder = Path(shutil.copytree(written, tmp_path / "out"))
    require_faithful(folder)
    part = data = json.loads((folder / file).read_text())
    *path, last = (int(key) if key.isdecimal() else key for key in place.split())
    for key in path:
        part = part[key]
    part[last] = value
    (folder / file).write_text(json.dumps(data))
    with pytest.raises(OutputError, match=words):
        require_faithful(folder)
    assert not (folder / "verdict.json").exists()
    assert not (folder / "junit.xml").exists()
