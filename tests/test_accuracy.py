"""The ledger of accuracy: bias and scatter of known rows, a user's own sweep, and the
package's.
"""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from command_line import invoke

from epcontact.cli import compare_and_accuracy
from epcontact.cli.compare_and_accuracy import _ledger_row as row_of_table
from epcontact.harness import sweep
from epcontact.persson.validity import theory_map
from epcontact.studies import STUDIES, conductance
from epcontact.studies.accuracy import (
    SMALLEST_AREA,
    differences,
    ledger,
    read_rows,
    verdict_rows,
)


def test_bias_is_the_median_and_scatter_half_of_the_central_68_percent():
    """The bias of a ledger row is the median relative error, and its scatter half of
    the 68 % interval.

    The errors are spread evenly from -10 % to 20 %. An area near 0 is divided by
    SMALLEST_AREA.
    """
    place = dict.fromkeys(["load", "hardness", "hurst", "waves"], np.nan)
    place |= {"quantity": "A_el", "points": np.nan, "time": np.nan, "fft_pairs": np.nan}
    values = 0.2 * np.linspace(0.9, 1.2, 301)
    rows = pd.DataFrame({"value": values, "reference": 0.2, "pair": "FE – BEM"})
    tiny = {"value": [2e-5], "reference": [1e-5], "pair": "theory – BEM"}
    both = pd.concat([rows, pd.DataFrame(tiny)]).assign(**place)
    first, second = ledger(both).to_dict("records")
    assert first["bias"] == pytest.approx(0.05)
    assert first["scatter"] == pytest.approx(0.102)
    assert first["scenes"] == 301
    assert second["bias"] == pytest.approx(1e-5 / SMALLEST_AREA)  # and no 100 %


def test_a_row_of_the_ledger_has_units_and_the_span_of_its_scenes():
    """A row shows percentages, times in s, and the range of each parameter of its
    scenes.
    """
    row = {
        "quantity": "A_pl",
        "pair": "FE – BEM",
        "points": 4.0,
        "bias": -0.0314,
        "scatter": 0.271,
        "scenes": 12,
        "time": 3.456,
        "fft_pairs": 123.4,
        "load_min": 0.01,
        "load_max": 0.05,
        "hardness_min": 0.6,
        "hardness_max": 0.6,
        "hurst_min": np.nan,
        "hurst_max": np.nan,
        "waves_min": 8.0,
        "waves_max": 64.0,
    }
    span = "p0/(E* ξ) 0.01 to 0.05, hardness/(E* ξ) 0.6, waves 8 to 64"
    pair = "FE, 4 points a wave – BEM"
    shown = ("A_pl", pair, "-3.1 %", "27 %", "12", "3.46", "123", span)
    assert row_of_table(row) == shown
    two = row_of_table(row | {"scenes": 2})
    assert two[3:5] == ("27 %", "2")
    # One scene has no scatter, and boundary elements of any grid no points a wave.
    row |= {"points": np.nan, "scenes": 1, "time": np.nan, "fft_pairs": 0.0}
    shown = ("A_pl", "FE – BEM", "-3.1 %", "–", "1", "", "", span)
    assert row_of_table(row) == shown


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Return the folders of two sweeps of the package, solved once."""
    home = tmp_path_factory.mktemp("sweeps")
    names = ("accuracy-grids", "accuracy-elements")
    return [sweep.run_sweep(name, output=home, jobs=1).folder for name in names]


def test_a_user_s_sweeps_give_the_user_s_ledger(folders, tmp_path):
    """The ledger of two solved sweeps has the errors, areas and times of their tables.

    The command `accuracy` writes the same ledger to a CSV file and draws two charts.
    """
    rows = read_rows(folders)
    solved = pd.concat(map(sweep.table, folders))
    solved["points"] = solved["surface.points_per_shortest_wavelength"]
    of_grids = solved.groupby(["method", "points"])
    solved_areas = of_grids["area.total.corrected"].first()
    areas = rows[rows["quantity"] == "A"].set_index(["pair", "points"])
    continuum = areas.loc["BEM – continuum"]
    assert {*continuum["reference"]} == {solved_areas["bem", 16]}
    assert 16 not in continuum.index
    values = areas["value"]
    assert values["FE – BEM, same grid", 3] == solved_areas["fem", 3]
    assert values["FE – continuum", 4] == solved_areas["fem", 4]
    assert values["theory – BEM"].tolist() == [solved_areas["persson", 3]]
    found = ledger(rows).set_index(["quantity", "pair", "points"])
    assert found.loc[("A raw", "BEM – continuum", 4), "bias"].item() > 0.03
    times = of_grids["cost.seconds"].first()
    time = found.loc[("A", "FE – continuum", 4), "time"].item()
    assert time == pytest.approx(times["fem", 4] / times["bem", 4])
    file = tmp_path / "ledger.csv"
    done = invoke("accuracy", *folders, "--csv", file, "--charts", tmp_path / "charts")
    assert done.returncode == 0
    assert "theory – BEM" in done.stdout
    pd.testing.assert_frame_equal(pd.read_csv(file), ledger(rows), check_dtype=False)
    assert len([*tmp_path.glob("charts/*.png")]) == 2


def test_elements_are_held_against_calculix_on_every_grid(folders, monkeypatch):
    """Results of CalculiX are compared with those of the finite elements on the same
    grid.

    The results of the elements stand for those of CalculiX, so that both agree to the
    last digit.
    """
    members = [*sweep.members(folders[1])]
    for task, result in members[:]:
        if task["method"] == "fem":
            members.append((task | {"method": "calculix"}, result))

    def with_calculix(folder):
        """Return the pairs (task, result) of a sweep, with those that CalculiX would
        add.
        """
        return members

    monkeypatch.setattr(sweep, "members", with_calculix)
    rows = read_rows(folders[1:]).set_index(["pair", "quantity", "points"])
    beside_calculix = rows.loc["FE – CalculiX, same grid"]
    beside_bem = rows.loc["FE – BEM, same grid"]
    assert beside_calculix["value"].equals(beside_calculix["reference"])
    assert beside_calculix["value"]["A"].equals(beside_bem["value"]["A"])


def test_a_time_is_the_least_and_the_finest_grid_is_no_reference_for_itself(
    folders, monkeypatch
):
    """The time of a row is the least over its surfaces, for it and for its unit.

    A second surface stands beside each, with the same values and ten times the time; it
    is counted as a surface.  Elements on the grid of the reference of the continuum are
    compared with boundary elements on this grid, and not with the continuum.
    """
    members = [each for folder in folders for each in sweep.members(folder)]

    def points_of(result):
        """Return the grid points per shortest wave of a result."""
        return result.provenance.about["resolution"]["value"]

    of_bem = [each for each in members if each[0]["method"] == "bem"]
    task, finest = max(of_bem, key=lambda each: points_of(each[1]))
    as_elements = [(task | {"method": "fem"}, finest)]
    timed = []
    for task, result in members:
        seconds = points_of(result) * {"fem": 7.0}.get(task["method"], 1.0)
        for seed, factor in ((task["seed"], 1.0), (99, 10.0)):
            cost = {**result.cost, "seconds": factor * seconds}
            timed.append((task | {"seed": seed}, replace(result, cost=cost)))
    found = {folders[0]: [*timed, *as_elements], folders[1]: []}
    monkeypatch.setattr(sweep, "members", found.__getitem__)
    after = read_rows(folders).set_index(["pair", "quantity", "points"]).sort_index()
    area = ("FE – continuum", "A", 4)
    assert after.loc[area, "time"] == pytest.approx(7.0)
    assert after.loc[area, "surfaces"] == 2
    assert 16 in after.loc["FE – BEM, same grid", "A"].index
    assert 16 not in after.loc["FE – continuum", "A"].index


def test_the_ledger_of_the_package_rests_on_its_tables():
    """The ledger of the package has the errors of its tables of the theory and of
    conductance.
    """
    rows = read_rows()
    places = theory_map()
    by_pair = rows.set_index("pair")
    assert {"BEM – closed form", "FE – CalculiX"} <= {*by_pair.index}
    of_theory = by_pair.loc["theory – BEM"]
    areas = of_theory[of_theory["quantity"] == "A"].set_index("reference")["value"]
    for number in (0, 400, 785):
        exact = places["total"][number]
        error = areas[exact] / exact - 1
        assert np.isclose(error, places["total_theory"][number], rtol=1e-9).any()
    of_law = by_pair.loc["law epcontact – BEM"]
    table = conductance.table_of_package()
    table["load"] *= table["hardness"]
    table = table.rename(columns={"y": "reference"})
    columns = ["load", "hardness", "reference"]
    in_package = table[columns].round(12).drop_duplicates()
    found = of_law[columns].round(12)
    assert len(found.merge(in_package)) == len(found) > 50


@pytest.mark.parametrize("method", ["BEM", "FE"])
def test_counts_are_of_first_order_and_corrections_leave_a_quarter(method):
    """Errors of counted areas fall with the first order, and corrected ones are below
    25 %.

    The errors are rms values over scenes, for each number of points in a wave.
    """
    rows = read_rows()
    rows = rows[rows["pair"] == f"{method} – continuum"]
    squares = differences(rows) ** 2
    errors = squares.groupby([rows["quantity"], rows["points"]]).mean() ** 0.5
    raw = errors["A raw"]
    order = -np.polyfit(np.log(raw.index), np.log(raw), 1)[0]
    assert 0.7 < order < 1.4
    assert (errors["A"] < 0.25 * raw).all()


def test_charts_of_the_ledger_have_median_times_and_rms_errors():
    """The charts hold the median time and the rms error of each method and resolution.

    The results are made up, no two alike, and each has three scenes.
    """
    columns = ("pair", "points", "quantity", "error", "time", "fft_pairs")
    answers = [
        ("BEM – continuum", 4, "A", 0.02, 1.1, 30),
        ("BEM – continuum", 8, "A", 0.003, 5.0, 20),
        ("FE – continuum", 6, "A", 0.05, 90.0, 0),
        ("BEM – continuum", 8, "A raw", 0.11, 4.0, 21),
        ("theory – BEM", 4, "A", 0.13, 0.01, 1),
        ("BEM – continuum", 4, "A_pl", 0.4, 1.1, 30),
    ]
    rows = pd.DataFrame(answers, columns=columns)
    scenes = pd.DataFrame(
        {"reference": [0.1, 0.2, 0.3], "sign": [1, -1, 1], "slower": [1, 1, 9]}
    )
    rows = rows.merge(scenes, how="cross")
    rows["value"] = rows["reference"] * (1 + rows["sign"] * rows["error"])
    rows["time"] *= rows["slower"]
    time_chart, ratio_chart = STUDIES["accuracy"].run(known=rows)
    assert [row[:3] for row in time_chart.rows] == [
        ("bem, corrected", 1.1, pytest.approx(0.02)),
        ("bem, corrected", 5.0, pytest.approx(0.003)),
        ("fem, corrected", 90.0, pytest.approx(0.05)),
        ("bem, raw", 4.0, pytest.approx(0.11)),
        ("persson", 0.01, pytest.approx(0.13)),
    ]
    of_theory = [row[1:3] for row in ratio_chart.rows if row[0] == "theory – BEM"]
    assert np.array(of_theory) == pytest.approx(
        np.array([(0.1, 1.13), (0.2, 0.87), (0.3, 1.13)])
    )


def test_a_folder_without_two_answers_is_one_sentence(tmp_path):
    """`accuracy` refuses a folder without results to compare: exit code 2
    and one line.
    """
    done = invoke("accuracy", tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1


def test_a_gate_of_elements_against_the_theory_is_a_row_of_the_theory():
    """A gate on boundary elements whose reference is the theory becomes a row of the
    theory: value and reference change places, and the finite elements keep theirs.
    """
    names = ("bem against persson", "fem against bem")
    figures = pd.DataFrame(
        {
            "name": [f"area.total.corrected of {name} (relative)" for name in names],
            "value": [0.11, 0.13],
            "reference": [0.1, 0.12],
            "low": [-0.5, -0.5],
        }
    )
    rows = verdict_rows(figures)
    found = rows[["pair", "value", "reference"]].to_dict("split")["data"]
    assert found == [["theory – BEM", 0.1, 0.11], ["FE – BEM", 0.13, 0.12]]


def test_a_distance_is_a_row_although_its_reference_is_0():
    """A gate on a distribution has the reference 0 and is a row; other gates against 0
    judge an error itself and are none.
    """
    gates = pd.DataFrame(
        {
            "name": [
                "distribution of fem against bem (wasserstein)",
                "area.total.corrected of fem against bem (absolute)",
                "area.total.corrected of fem against bem (relative)",
            ],
            "low": -0.1,
            "value": [0.03, 0.2, 0.2],
            "reference": [0.0, 0.0, 0.21],
        }
    )
    rows = verdict_rows(gates)
    found = [*zip(rows["quantity"], rows["pair"], rows["value"], strict=True)]
    assert found == [("P(σ) distance", "FE – BEM", 0.03), ("A", "FE – BEM", 0.2)]


def test_the_terminal_shows_two_grids_of_the_release_and_what_has_none(monkeypatch):
    """Of the release, rows on 4 and 8 points a wave are shown and those that hold for
    any grid; of a user's folders all are.
    """
    place = {"load": 0.1, "hardness": 0.6, "hurst": 0.8, "waves": 8.0}
    cost = {"time": 2.0, "fft_pairs": 30.0, "surfaces": 1}
    rows = pd.DataFrame(
        [
            {"pair": "BEM – continuum", "points": points, "value": 0.2 + points / 1e3}
            for points in (3.0, 4.0, 8.0, 16.0)
        ]
        + [{"pair": "theory – BEM", "points": 4.0, "value": 0.3}]
    ).assign(quantity="A", reference=0.2, **place, **cost)
    monkeypatch.setattr(compare_and_accuracy.ledgers, "read_rows", lambda folders: rows)
    shown = invoke("accuracy").stdout
    points = re.findall(r"BEM, (\d+) points a wave – continuum", shown)
    assert points == ["4", "8"]
    (line,) = [line for line in shown.splitlines() if "theory – BEM" in line]
    assert line.split()[:5] == ["A", "theory", "–", "BEM", "+50"]
    shown = invoke("accuracy", "mine").stdout
    points = re.findall(r"BEM, (\d+) points a wave – continuum", shown)
    assert points == ["3", "4", "8", "16"]
