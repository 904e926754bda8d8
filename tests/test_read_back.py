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


def edited(path: Path, change: Callable[[Any], None]) -> None:
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def refused(folder: Path, verdict: Any, words: str) -> None:
    with pytest.raises(OutputError, match=words):
        require_faithful(folder, verdict)
    assert not (folder / "verdict.json").exists()
    assert not (folder / "junit.xml").exists()


def test_an_honest_run_is_faithful(folder: Path) -> None:
    verdict = verdict_of(folder)
    assert {gate["status"] for gate in verdict["cases"][0]["gates"]} == {"holds", "falls short"}
    require_faithful(folder, verdict)
    assert (folder / "verdict.json").exists()


def _set(data: Any, *place: Any) -> None:
    *path, value = place
    for key in path[:-1]:
        data = data[key]
    data[path[-1]] = value


GATE = ("cases", 0, "gates")
VERDICTS: dict[str, tuple[tuple[Any, ...], str]] = {
    "a shortfall called good": ((*GATE, 1, "status", "holds"), "beside its figures"),
    "a good gate called short": ((*GATE, 0, "status", "falls short"), "beside its figures"),
    "a case better than its gates": (("cases", 0, "status", "holds"), "over its gates"),
    "the exit code": (("exit_code", 0), "exit code 0"),
    "passed": (("passed", True), "the verdict says"),
    "a value": ((*GATE, 1, "value", "mean", 0.05), "has a value of 0.05"),
    "a difference": ((*GATE, 2, "difference", "mean", 0.0), "has a difference of 0.0"),
    "an interval": ((*GATE, 2, "difference", "half_width_95", 0.0), "95 % interval of 0.0"),
    "the number of surfaces": (("cases", 0, "methods", "bem", "surfaces", 2), "has 3 members"),
}


@pytest.mark.parametrize("name", VERDICTS)
def test_a_verdict_that_its_answers_contradict_is_withdrawn(folder: Path, name: str) -> None:
    place, words = VERDICTS[name]
    edited(folder / "verdict.json", lambda data: _set(data, *place))
    refused(folder, verdict_of(folder), words)


def test_a_verdict_changed_on_its_way_to_the_disk_is_withdrawn(folder: Path) -> None:
    honest = verdict_of(folder)
    edited(folder / "verdict.json", lambda data: _set(data, *GATE, 0, "because", "of something"))
    refused(folder, honest, r"verdict\.json does not hold the verdict")


def _swap_areas(data: Any) -> None:
    data["areas"]["raw"], data["areas"]["corrected"] = (
        data["areas"]["corrected"],
        data["areas"]["raw"],
    )


def _best_residual(data: Any) -> None:
    for name in data["residuals"]:
        data["residuals"][name] = min(member["residuals"][name] for member in data["members"]) / 2


def _turn(data: Any) -> None:
    data["members"] = data["members"][::-1]


def _lose(data: Any) -> None:
    del data["members"][0]["steps"]


ANSWERS: dict[str, tuple[Callable[[Any], None], str]] = {
    "raw and corrected exchanged": (_swap_areas, "mean raw total area"),
    "the best residual": (_best_residual, "residual force that is not the largest"),
    "members in another order": (_turn, "calls the surface of seed 7 seed3"),
    "a member without load steps": (_lose, "a part is missing"),
}  # fmt: skip


@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_that_its_members_contradict_withdraws_the_verdict(
    folder: Path, name: str
) -> None:
    change, words = ANSWERS[name]
    edited(folder / "small" / "fast" / "bem.json", change)
    refused(folder, verdict_of(folder), words)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<failure", "<skipped", "junit.xml shows"),
        ('name="small"', 'name="large"', "no suite small"),
        ("<testsuites", "<", "a part is missing"),
    ],
)  # fmt: skip
def test_a_junit_that_shows_something_else_withdraws_the_verdict(
    folder: Path, old: str, new: str, words: str
) -> None:
    path = folder / "junit.xml"
    text = path.read_text()
    assert old in text
    path.write_text(
        text.replace(old, new).replace("</failure", "</skipped" if "skip" in new else "</failure")
    )
    refused(folder, verdict_of(folder), words)
