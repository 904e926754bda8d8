"""What a verification wrote is read back: a file that says something else withdraws the verdict."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
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
    own = conftest.SMALL_CASE.replace(
        "energy_reduction = 0.536", 'energy_reduction = 0.536\nspectrum = "surface"'
    )
    (folder / "small.toml").write_text(own + GATES)
    verify(folder / "small.toml", jobs=1, output=folder)
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "out"))


def verdict_of(folder: Path) -> Any:
    return json.loads((folder / "verdict.json").read_text())


def placed(*place: Any) -> Callable[[Any], None]:
    """Give what stands at a place another value, the last one."""

    def change(data: Any) -> None:
        *path, last, value = place
        for key in path:
            data = data[key]
        data[last] = value

    return change


CASE = ("cases", 0)
WIDTH = (*CASE, "gates", 2, "difference", "half_width_95")
VERDICT, BEM = "verdict.json", "small/fast/bem.json"


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        (VERDICT, placed(*CASE, "gates", 1, "status", "holds"), "beside its figures"),
        (VERDICT, placed(*CASE, "gates", 0, "status", "falls short"), "beside its figures"),
        (VERDICT, placed(*CASE, "status", "holds"), "over its gates"),
        (VERDICT, placed("exit_code", 0), "exit code 0"),
        (VERDICT, placed("passed", True), "the verdict says"),
        (VERDICT, placed(*CASE, "gates", 1, "value", "mean", 0.05), "a value of 0.05"),
        (VERDICT, placed(*CASE, "gates", 2, "difference", "mean", 0.0), "difference of 0.0"),
        (VERDICT, placed(*WIDTH, 0.0), "95 % interval of 0.0"),
        (VERDICT, placed(*CASE, "gates", 0, "grid_error", 1e-9), "grid error that is not claimed"),
        (VERDICT, placed(*CASE, "methods", "bem", "surfaces", 2), "has 3 members"),
        (BEM, placed("areas", "raw", "total", 0.1), "mean raw total area"),
        (BEM, placed("residuals", "force", 0.0), "residual force that is not the largest"),
        (BEM, lambda data: data["members"].reverse(), "calls the surface of seed 7 seed3"),
        (BEM, lambda data: data["members"][0].pop("steps"), "a part is missing"),
    ],
)
def test_what_the_answers_contradict_is_withdrawn(
    folder: Path, file: str, change: Callable[[Any], None], words: str
) -> None:
    require_faithful(folder, verdict_of(folder))
    data = json.loads((folder / file).read_text())
    change(data)
    (folder / file).write_text(json.dumps(data))
    with pytest.raises(OutputError, match=words):
        require_faithful(folder, verdict_of(folder))
    assert not (folder / "verdict.json").exists()
    assert not (folder / "junit.xml").exists()


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("verdict.json", "only a smoke test", "of something", r"verdict\.json does not hold"),
        ("junit.xml", "failure", "skipped", "junit.xml shows"),
        ("junit.xml", 'name="small"', 'name="large"', "junit.xml has no suite"),
        ("junit.xml", "<testsuites", "<", "a part is missing"),
    ],
)
def test_a_file_changed_on_its_way_to_the_disk_is_withdrawn(
    folder: Path, file: str, old: str, new: str, words: str
) -> None:
    honest, text = verdict_of(folder), (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    with pytest.raises(OutputError, match=words):
        require_faithful(folder, honest)
    assert not (folder / "verdict.json").exists()
