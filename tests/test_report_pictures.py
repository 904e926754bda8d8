"""The pictures of a report are drawn once, and again if anything they show changes."""

import shutil

import conftest
import numpy as np
import pytest
from PIL import Image

from epcontact.harness.verdict import verify
from epcontact.pictures import drawn
from epcontact.pictures.drawn import draw_saved_cases, draw_solved_cases


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """Return the output folder and the verdict of SMALL_CASE, solved with fields."""
    folder = tmp_path_factory.mktemp("solved")
    (folder / "small.toml").write_text(conftest.SMALL_CASE)
    verdict = verify(folder / "small.toml", jobs=1, output=folder, fields="first")
    return folder, verdict


@pytest.fixture
def files(solved, tmp_path):
    """Return the JSON files of the methods of the case, in a copy of its folder."""
    folder = shutil.copytree(solved[0] / "small" / "fast", tmp_path / "fast")
    return [folder / "bem.json", folder / "persson.json"]


@pytest.fixture
def draws(monkeypatch):
    """Return a list to which each drawing of a case adds the case's id."""
    ids = []
    draw = drawn._draw

    def noting(drawing):
        """Record the case of the drawing, and draw it."""
        ids.append(drawing.case_id)
        return draw(drawing)

    monkeypatch.setattr(drawn, "_draw", noting)
    return ids


def no_progress(done, total, words):
    """Do nothing with the numbers of drawn and of all cases, and the words."""


def test_pictures_are_drawn_once(files, draws):
    """A second report draws nothing, and lists the same pictures."""
    first = draw_saved_cases({"small": files}, no_progress)
    second = draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small"]
    assert {"contact-bem", "residuals"} < {*first["small"].names}
    assert [*second["small"].names] == [*first["small"].names]
    assert not [*files[0].parent.glob("*.svg")]


@pytest.mark.parametrize(
    "name", ["bem.json", "bem-seed3.vti", "residuals.webp", "residuals.txt"]
)
def test_pictures_are_drawn_again_if_a_file_changes(files, draws, name):
    """A changed result, a changed field and a picture that is gone are drawn again.

    `name` is the file that changes; files of pictures are deleted.
    """
    draw_saved_cases({"small": files}, no_progress)
    file = files[0].parent / name
    if file.suffix in (".webp", ".txt"):
        file.unlink()
    else:
        file.write_bytes(file.read_bytes() + b"\n")
    draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small", "small"]
    assert (files[0].parent / "residuals.webp").is_file()


def test_changed_code_draws_again(files, draws, monkeypatch):
    """Pictures that other code drew are drawn again."""
    draw_saved_cases({"small": files}, no_progress)
    monkeypatch.setattr(drawn, "_code_digest", lambda: b"other")
    draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small", "small"]


def test_charts_of_the_case_are_added_to_those_of_results(solved, files, draws):
    """After a report from files, one of a verification draws the charts of the case.

    A third report, from files, draws nothing and shows them, too.
    """
    (judged,) = solved[1].cases
    cases = {"small": (judged.case, judged.results)}
    shutil.copytree(files[0].parent, files[0].parents[1] / "small" / "fast")
    of_case = {"small": files}
    draw_saved_cases(of_case, no_progress)
    pictures = draw_solved_cases(of_case, no_progress, cases)
    assert draws == ["small", "small"]
    assert "power-spectrum" in pictures["small"].names
    again = draw_saved_cases(of_case, no_progress)
    assert draws == ["small", "small"]
    assert "power-spectrum" in again["small"].names


def test_a_record_cannot_name_a_file_outside(files, draws):
    """A record whose names are paths is not used."""
    draw_saved_cases({"small": files}, no_progress)
    record = files[0].parent / "pictures.json"
    record.write_text(record.read_text().replace('"residuals"', '"../residuals"'))
    pictures = draw_saved_cases({"small": files}, no_progress)
    assert draws == ["small", "small"]
    assert "residuals" in pictures["small"].names


def test_the_picture_of_a_page_is_small_and_has_the_colours_of_the_chart(files):
    """The copy for a page has half of the pixels along each side and few colours, and
    differs little from the picture.
    """
    draw_saved_cases({"small": files}, no_progress)
    folder = files[0].parent
    for name in ("residuals", "contact-bem"):
        chart = Image.open(folder / f"{name}.png").convert("RGB")
        small = Image.open(folder / f"{name}.webp").convert("RGB")
        assert small.size == tuple(pixels // 2 for pixels in chart.size)
        assert len(small.getcolors()) <= 20
        difference = np.asarray(small, float) - np.asarray(chart.reduce(2), float)
        assert np.abs(difference).mean() < 4
        # No colour of a scale is drawn in another one.
        assert np.mean(np.abs(difference).max(axis=2) > 64) < 1e-3


def test_many_cases_are_drawn_in_processes(files, monkeypatch):
    """Two processes draw six cases, and a bad result is an error of one sentence."""
    monkeypatch.setattr(drawn, "available_cores", lambda: 2)
    folder = files[0].parent
    copies = [shutil.copytree(folder, folder.parent / str(n)) for n in range(6)]
    by_case = {copy.name: [copy / "bem.json"] for copy in copies}
    seen = []
    pictures = draw_saved_cases(by_case, lambda *update: seen.append(update))
    assert {*pictures} == {*by_case}
    assert [done for done, _, _ in seen] == [*range(7)]
    for copy in copies:
        (copy / "bem.json").write_text("{}")
    with pytest.raises(drawn.OutputError, match="holds no results of this version"):
        draw_saved_cases(by_case, no_progress)
