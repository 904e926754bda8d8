"""The pictures of a report are drawn once, and again if anything they show changes."""

import json
import shutil

import conftest
import numpy as np
import pytest
from PIL import Image

from epcontact.harness.verdict import verify
from epcontact.output.charts.figures import Pictures
from epcontact.pictures import drawn
from epcontact.pictures.drawn import draw_saved_cases, draw_solved_cases


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """Return the output folder and the verdict of SMALL_CASE, solved with fields."""
    folder = tmp_path_factory.mktemp("solved")
    (folder / "small.toml").write_text(conftest.SMALL_CASE)
    verdict = verify(folder / "small.toml", jobs=1, output=folder, fields="first")
    return folder, verdict


@pytest.fixture(scope="module")
def results(solved):
    """Return the folder of the results of the case, with pictures drawn from files."""
    folder = solved[0] / "small" / "fast"
    files = [folder / "bem.json", folder / "persson.json"]
    pictures = draw_saved_cases({"small": files}, no_progress)["small"]
    assert {"contact-bem", "residuals"} < {*pictures.names}
    assert not [*folder.glob("*.svg")]
    return folder


@pytest.fixture
def files(results, tmp_path):
    """Return the JSON files of the methods of the case, in a copy of its folder."""
    folder = shutil.copytree(results, tmp_path / "fast")
    return [folder / "bem.json", folder / "persson.json"]


@pytest.fixture
def draws(files, monkeypatch):
    """Return a list to which each drawing of a case adds the case's id.

    In the place of all charts, one is drawn from files, and a second one of a case.
    """
    folder = files[0].parent
    ids = []

    def picture_of_files(case_id, _):
        """Record the drawing, and return the name of the picture."""
        ids.append(case_id)
        (folder / "residuals.txt").write_text("A caption.")
        return Pictures(["residuals"])

    def pictures_of_case(case, *_):
        """Record the drawing, and return the names of both pictures."""
        picture_of_files(case.id, None)
        shutil.copy(folder / "residuals.png", folder / "power-spectrum.png")
        (folder / "power-spectrum.txt").write_text("A caption.")
        return Pictures(["residuals", "power-spectrum"])

    monkeypatch.setattr(drawn, "draw_saved", picture_of_files)
    monkeypatch.setattr(drawn, "draw_case", pictures_of_case)
    return ids


def no_progress(done, total, words):
    """Do nothing with the numbers of drawn and of all cases, and the words."""


def test_pictures_are_drawn_once(files, draws):
    """A second report draws nothing, and lists the same pictures."""
    pictures = draw_saved_cases({"small": files}, no_progress)["small"]
    assert draws == []
    listed = json.loads((files[0].parent / "pictures.json").read_text())["names"]
    assert pictures.names == listed
    assert {"contact-bem", "residuals"} < {*listed}


@pytest.mark.parametrize(
    "name", ["bem.json", "bem-seed3.vti", "residuals.webp", "residuals.txt"]
)
def test_pictures_are_drawn_again_if_a_file_changes(files, draws, name):
    """A changed result, a changed field and a picture that is gone are drawn again.

    `name` is the file that changes; files of pictures are deleted.
    """
    file = files[0].parent / name
    if file.suffix in (".webp", ".txt"):
        file.unlink()
    else:
        file.write_bytes(file.read_bytes() + b"\n")
    draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small"]
    assert (files[0].parent / "residuals.webp").is_file()


def test_changed_code_draws_again(files, draws, monkeypatch):
    """Pictures that other code drew are drawn again."""
    monkeypatch.setattr(drawn, "_code_digest", lambda: b"other")
    draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small"]


def test_charts_of_the_case_are_added_to_those_of_results(solved, files, draws):
    """After a report from files, one of a verification draws the charts of the case.

    A third report, from files, draws nothing and shows them, too.
    """
    (judged,) = solved[1].cases
    cases = {"small": (judged.case, judged.results)}
    of_case = {"small": files}
    pictures = draw_solved_cases(of_case, no_progress, cases)
    assert draws == ["small"]
    assert "power-spectrum" in pictures["small"].names
    again = draw_saved_cases(of_case, no_progress)
    assert draws == ["small"]
    assert "power-spectrum" in again["small"].names


def test_a_record_cannot_name_a_file_outside(files, draws):
    """A record whose names are paths is not used."""
    record = files[0].parent / "pictures.json"
    record.write_text(record.read_text().replace('"residuals"', '"../residuals"'))
    pictures = draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small"]
    assert "residuals" in pictures["small"].names


def test_the_picture_of_a_page_is_small_and_has_the_colours_of_the_chart(results):
    """The copy for a page has half of the pixels along each side and few colours, and
    differs little from the picture.
    """
    for name in ("residuals", "contact-bem"):
        chart = Image.open(results / f"{name}.png").convert("RGB")
        small = Image.open(results / f"{name}.webp").convert("RGB")
        assert small.size == tuple(pixels // 2 for pixels in chart.size)
        assert len(small.getcolors()) <= 20
        difference = np.asarray(small, float) - np.asarray(chart.reduce(2), float)
        assert np.abs(difference).mean() < 4
        # No colour of a scale is drawn in another one.
        assert np.mean(np.abs(difference).max(axis=2) > 64) < 1e-3


def test_many_cases_are_drawn_in_processes(files, monkeypatch):
    """Two processes draw six cases of the theory, which has no fields, and a bad result
    is an error of one sentence.
    """
    monkeypatch.setattr(drawn, "available_cores", lambda: 2)
    folder = files[0].parent
    (folder / "pictures.json").unlink()
    copies = [shutil.copytree(folder, folder.parent / str(n)) for n in range(6)]
    by_case = {copy.name: [copy / "persson.json"] for copy in copies}
    seen = []
    pictures = draw_saved_cases(by_case, lambda *update: seen.append(update))
    assert {*pictures} == {*by_case}
    assert [done for done, _, _ in seen] == [*range(7)]
    files[0].write_text("{}")
    with pytest.raises(drawn.OutputError, match="holds no results of this version"):
        draw_saved_cases({"small": files}, no_progress)
