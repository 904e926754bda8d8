"""The benchmark: its files, the table of codes, and fields from outside."""

import importlib.util
import shutil

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from laboratory import benchmark as laboratory

from epcontact.errors import InvalidCase
from epcontact.studies.benchmark import compare_codes, folder, summarise

NODE = ["scene", "load", "i", "j"]


@pytest.fixture(scope="module")
def pressures():
    """Return the stored pressures of all codes."""
    return pd.read_csv(folder() / "pressures.csv")


def write_fields(pressures, file, code="bem-3"):
    """Write the stored pressures of a code as a file from outside."""
    fields = pressures[[*NODE, code]].rename(columns={code: "pressure"})
    fields.dropna().to_csv(file, index=False)
    return file


def test_heights_are_those_of_the_laboratory():
    """The files hold the surfaces that the laboratory makes, to the digits written."""
    for name, surface in laboratory.surfaces().items():
        table = pd.read_csv(folder() / f"{name}.csv")
        heights = table["height [m]"].to_numpy().reshape(surface.shape)
        expected = surface.heights - surface.heights.mean()
        assert np.abs(heights - expected).max() < 1e-7 * expected.std()


@pytest.mark.parametrize("name", laboratory.cases())
@pytest.mark.parametrize(
    "code",
    [
        pytest.param("fem", marks=pytest.mark.slow),
        "bem-effective",
        "bem-3",
        "theory-effective",
    ],
)
def test_stored_results_are_those_of_the_solvers(name, code, pressures):
    """Areas, gaps and pressures in the files are those of a solve, to their digits.

    The theory has no results of a layer, of falling loads, and of a sphere.
    """
    stored = pd.read_csv(folder() / "results.csv").query("scene == @name")
    stored = stored[stored["code"] == code].drop(columns=["scene", "code", "seconds"])
    if stored.empty:
        assert code == "theory-effective"
        assert name in ("layer", "unloading", "sphere")
        return
    found = laboratory.solve(laboratory.cases()[name], *laboratory.CODES[code])
    for result, (_, stored_row) in zip(found, stored.iterrows(), strict=True):
        row = stored_row.dropna()
        values = {"load": row["load"], "mean_pressure": result.final.mean_pressure}
        values |= laboratory.row_of(result.final, result.method)
        for column, value in row.items():
            assert values[column] == pytest.approx(value, rel=1e-4, abs=1e-9), column
        if "pressure" in result.fields:
            at_load = (pressures["scene"] == name) & (pressures["load"] == row["load"])
            kept = pressures[at_load][code].to_numpy()
            scale = 1e-4 * kept.max()
            assert np.abs(result.fields["pressure"].ravel() - kept).max() < scale


def test_fast_and_plain_elements_have_the_same_pressures():
    """On all scenes the stored pressures of both are equal to the digits written."""
    table = compare_codes().query("code == 'fem'")
    assert len(table) == 15
    assert (table["field"] < 1e-4).all()
    assert (table["area_difference"] == 0).all()


def test_fields_from_outside_have_the_row_of_their_code(tmp_path, pressures):
    """The pressures of a code in a file give the areas and distances of that code.

    The mean gap is empty without a column of gaps, and the mean of the positive ones
    with it.  A file may lack scenes.
    """
    table = compare_codes([write_fields(pressures, tmp_path / "mine.csv")])
    names = ["scene", "load", "area", "largest_pressure", "field", "distribution"]
    mine, own = (table[table["code"] == code][names] for code in ("mine", "bem-3"))
    pd.testing.assert_frame_equal(
        mine.reset_index(drop=True), own.reset_index(drop=True), rtol=1e-4
    )
    assert table[table["code"] == "mine"]["mean_gap"].isna().all()
    fields = pd.read_csv(tmp_path / "mine.csv").query("scene == 'layer'")
    fields.assign(gap=np.where(fields["pressure"] > 0, -1e-9, 2e-6)).to_csv(
        tmp_path / "part.csv", index=False
    )
    part = compare_codes([tmp_path / "part.csv"]).query("code == 'part'")
    assert set(part["scene"]) == {"layer"}
    np.testing.assert_allclose(part["mean_gap"], 2e-6 * (1 - part["area"]))


def test_the_summary_has_medians_and_largest_differences(tmp_path, pressures):
    """A code whose pressures are larger by a fraction has this distance in the L2 norm,
    and this fraction of the mean over the mean contact pressure in the distribution.
    """
    larger = pressures.assign(plain=1.008 * pressures["plain"])
    file = write_fields(larger.query("scene == 'mild'"), tmp_path / "more.csv", "plain")
    table = compare_codes([file])
    row = summarise(table).loc["more"]
    assert row["loads"] == 2
    assert row["field"] == pytest.approx(0.008, rel=1e-3)
    assert row["field_largest"] == pytest.approx(0.008, rel=1e-3)
    areas = table.query("code == 'more'")["area"]
    assert row["distribution"] == pytest.approx(0.008 * areas.median(), rel=1e-3)
    assert row["distribution_largest"] == pytest.approx(0.008 * areas.max(), rel=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda fields: fields[:-1], "must have each node"),
        (lambda fields: pd.concat([fields, fields[:1]]), "must have each node"),
        (lambda fields: fields.assign(i=fields["i"] + 1), "count from 0"),
        (lambda fields: fields.assign(scene="moon"), "must be of these: mild 1"),
        (lambda fields: fields[:0], "no rows"),
        (lambda fields: fields.assign(pressure=np.inf), "no finite number"),
        (lambda fields: fields.assign(pressure=-fields["pressure"]), "negative"),
        (lambda fields: fields.assign(pressure=fields["pressure"] / 1e6), "in Pa"),
        (
            lambda fields: fields.assign(gap=[1.0, *fields["i"][1:] * np.nan]),
            "gap must",
        ),
        (lambda fields: fields.assign(pressure="high"), "needs the columns"),
        (lambda fields: fields.drop(columns="load"), "needs the columns"),
    ],
)
def test_incomplete_fields_are_refused(tmp_path, pressures, change, message):
    """A file with a wrong number, node or column is an error that says what is needed.

    `change` makes the mistake in a correct table.
    """
    file = write_fields(pressures, tmp_path / "mine.csv")
    change(pd.read_csv(file)).to_csv(file, index=False)
    with pytest.raises(InvalidCase, match=message):
        compare_codes([file])


def test_the_command_prints_the_table_and_copies_the_files(tmp_path, pressures):
    """`benchmark FILE --csv --copy` prints a row for each code, and writes both."""
    write_fields(pressures, tmp_path / "mine.csv")
    table = tmp_path / "table.csv"
    copy = tmp_path / "files"
    done = invoke("benchmark", tmp_path / "mine.csv", "--csv", table, "--copy", copy)
    assert done.returncode == 0, done.stderr
    _, *rows, note = done.stdout.splitlines()
    assert "nothing was solved" in note
    codes = [row.split()[0] for row in rows]
    assert codes == [*laboratory.CODES, "mine"]
    assert set(pd.read_csv(table)["code"]) == set(codes)
    assert (copy / "scenes.csv").is_file()
    done = invoke("benchmark", "--copy", copy)
    assert done.returncode == 2
    assert "exists" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("code", "scene"), [("tamaas", "mild"), ("calculix", "layer")])
def test_other_codes_have_their_stored_areas(code, scene):
    """tamaas and CalculiX, where they are installed, have the stored areas again."""
    if code == "calculix" and not shutil.which("ccx"):
        pytest.skip("there is no program ccx")
    if code == "tamaas" and importlib.util.find_spec("tamaas") is None:
        pytest.skip("tamaas is not installed")
    stored = pd.read_csv(folder() / "results.csv")
    stored = stored[(stored["scene"] == scene) & (stored["code"] == code)]
    found = laboratory.solve(laboratory.cases()[scene], *laboratory.CODES[code])
    areas = [result.final.areas["raw"].total for result in found]
    np.testing.assert_allclose(areas, stored["area"], rtol=0.02)


@pytest.mark.parametrize("name", ["plain", "theory-3"])
def test_the_name_of_another_code_is_refused(tmp_path, pressures, name):
    """A file that is named like a code of the benchmark, with fields or without."""
    file = write_fields(pressures, tmp_path / f"{name}.csv")
    with pytest.raises(InvalidCase, match="another name"):
        compare_codes([file])


def test_two_files_of_one_name_are_refused(tmp_path, pressures):
    """Two codes cannot have the same name, although their files are in two folders."""
    (tmp_path / "other").mkdir()
    files = [tmp_path / "mine.csv", tmp_path / "other" / "mine.csv"]
    for file in files:
        write_fields(pressures, file)
    with pytest.raises(InvalidCase, match="another name"):
        compare_codes(files)
