"""The ledger of accuracy: bias and scatter of known rows, a user's own sweep, and the
package's.
"""

import numpy as np
import pandas as pd
import pytest
from command_line import invoke

from epcontact.cli.compare_and_accuracy import _ledger_row as row_of_table
from epcontact.harness import sweep
from epcontact.persson.validity import theory_map
from epcontact.studies import STUDIES, conductance
from epcontact.studies.accuracy import SMALLEST_AREA, differences, ledger, read_rows


def test_bias_is_the_median_and_scatter_half_of_the_central_68_percent():
    rows = pd.DataFrame({"value": np.linspace(0.9, 1.2, 301) * 0.2, "reference": 0.2})
    tiny = pd.DataFrame({"value": [2e-5], "reference": [1e-5]})
    names = ["load", "hardness", "hurst", "waves", "time", "fft_pairs"]
    about = {"quantity": "A_el", "points": np.nan} | dict.fromkeys(names, np.nan)
    both = pd.concat([rows.assign(pair="FE – BEM"), tiny.assign(pair="theory – BEM")])
    first, second = ledger(both.assign(**about)).to_dict("records")
    assert (first["bias"], first["scatter"], first["scenes"]) == pytest.approx(
        (0.05, 0.102, 301)
    )
    assert second["bias"] == pytest.approx(1e-5 / SMALLEST_AREA)  # and no 100 %


def test_a_row_of_the_ledger_has_units_and_the_span_of_its_scenes():
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
    # One scene has no scatter, and boundary elements of any grid no points a wave.
    row |= {"points": np.nan, "scenes": 1, "time": np.nan, "fft_pairs": 0.0}
    shown = ("A_pl", "FE – BEM", "-3.1 %", "–", "1", "", "", span)
    assert row_of_table(row) == shown


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Return the folders of two sweeps of the package, solved once."""
    home, names = (
        tmp_path_factory.mktemp("sweeps"),
        ("accuracy-grids", "accuracy-elements"),
    )
    return [sweep.run_sweep(name, output=home, jobs=1).folder for name in names]


def test_a_user_s_sweeps_give_the_user_s_ledger(folders, tmp_path):
    rows = read_rows(folders)
    areas = rows[rows["quantity"] == "A"].set_index(["pair", "points"])["value"]
    solved = pd.concat(map(sweep.table, folders))
    solved["n"] = solved["surface.points_per_shortest_wavelength"]
    own = solved.groupby(["method", "n"])["area.total.corrected"].first()
    exact = rows[rows["pair"] == "BEM – continuum"].set_index("quantity")["reference"][
        "A"
    ]
    assert set(exact) == {own["bem", 16]}
    assert areas["FE – BEM, same grid", 3] == own["fem", 3]
    assert areas["FE – continuum", 4] == own["fem", 4]
    assert areas["theory – BEM"].tolist() == [own["persson", 3]]
    assert ("BEM – continuum", 16) not in areas
    found = ledger(rows).set_index(["quantity", "pair", "points"])
    assert found.loc[("A raw", "BEM – continuum", 4), "bias"].item() > 0.03
    times = solved.groupby(["method", "n"])["cost.seconds"].first()
    shown = found.loc[("A", "FE – continuum", 4), "time"].item()
    assert shown == pytest.approx(times["fem", 4] / times["bem", 4])
    file = tmp_path / "ledger.csv"
    done = invoke("accuracy", *folders, "--csv", file, "--charts", tmp_path / "charts")
    assert (done.returncode, "theory – BEM" in done.stdout) == (0, True)
    written = pd.read_csv(file)
    pd.testing.assert_frame_equal(written, ledger(rows), check_dtype=False)
    assert len([*tmp_path.glob("charts/*.png")]) == 3


def test_elements_are_held_against_calculix_on_every_grid(folders, monkeypatch):
    """Here they stand in its place themselves."""
    known = [*sweep.members(folders[1])]
    posing = [(t | {"method": "calculix"}, r) for t, r in known if t["method"] == "fem"]
    monkeypatch.setattr(sweep, "members", lambda _: known + posing)
    rows = read_rows(folders[1:]).set_index(["quantity", "points"]).groupby("pair")
    own, other = (
        rows.get_group(f"FE – {name}, same grid") for name in ("CalculiX", "BEM")
    )
    assert own["value"].equals(own["reference"])
    assert own["value"]["A"].equals(other["value"]["A"])


def test_the_ledger_of_the_package_rests_on_its_tables():
    rows, known = read_rows(), theory_map()
    mine = rows[(rows["quantity"] == "A") & (rows["pair"] == "theory – BEM")].set_index(
        "reference"
    )
    for place in (0, 400, 785):
        error = mine["value"][known["total"][place]] / known["total"][place] - 1
        assert np.isclose(error, known["total_theory"][place], rtol=1e-9).any()
    assert {"law epcontact – BEM", "BEM – closed form", "FE – CalculiX"} <= set(
        rows["pair"]
    )
    laws = rows[rows["pair"] == "law epcontact – BEM"][
        ["load", "hardness", "reference"]
    ]
    kept = conductance.table_of_package().assign(
        load=lambda t: t["load"] * t["hardness"]
    )
    own = kept.rename(columns={"y": "reference"})[[*laws]].round(12)
    assert len(laws.round(12).merge(own.drop_duplicates())) == len(laws) > 50
    for method in (
        "BEM",
        "FE",
    ):  # counts are of first order, and corrections leave a quarter
        own = rows[rows["pair"] == f"{method} – continuum"].assign(
            error=lambda t: differences(t) ** 2
        )
        errors = own.groupby(["quantity", "points"])["error"].mean() ** 0.5
        raw = errors["A raw"]
        assert 0.7 < -np.polyfit(np.log(raw.index), np.log(raw), 1)[0] < 1.4
        assert (errors["A"] < 0.25 * raw).all()


def test_charts_of_the_ledger_have_median_times_and_rms_errors():
    """Of made-up rows, no two alike, with three scenes of each answer."""
    limit = "BEM – continuum"
    # Pair, points a wave, quantity, and the name of its series.
    answers = [
        (limit, 4, "A", "bem, corrected"),
        (limit, 8, "A", "bem, corrected"),
        ("FE – continuum", 6, "A", "fem, corrected"),
        (limit, 8, "A raw", "bem, raw"),
        ("theory – BEM", 4, "A", "persson"),
        ("FE – BEM", 4, "A", ""),
        (limit, 4, "A_pl", ""),
    ]
    scene = np.arange(3)
    tables = []
    times = []
    works = []
    for number, (pair, points, quantity, series) in enumerate(answers, 1):
        exact = 0.11 + 0.013 * number * scene
        error = 0.01 * number - 0.07 * scene**2
        time = 1.7**number + np.array([0.0, 3.0, 1.0])
        pairs = 0.0 * scene
        if not pair.startswith("F"):
            pairs = 31.0 + number * scene
        rows = {"reference": exact, "value": exact * (1 + error), "time": time}
        table = pd.DataFrame(rows | {"fft_pairs": pairs})
        tables.append(table.assign(pair=pair, points=points, quantity=quantity))
        rms = np.sqrt(np.mean(error**2))
        if series:
            times.append((series, np.median(time), rms))
        if series and not pair.startswith("F"):
            # Transforms of finer grids cost as their numbers of points.
            works.append((series, np.median(pairs) * (points / 4) ** 2, rms))
    time_chart, work_chart, ratio_chart = STUDIES["accuracy"].run(
        known=pd.concat(tables)
    )
    for chart, expected in ((time_chart, times), (work_chart, works)):
        found = pd.DataFrame([row[:3] for row in chart.rows])
        assert [*found[0]] == [name for name, *_ in expected]
        numbers = [row[1:] for row in expected]
        assert found[[1, 2]].to_numpy() == pytest.approx(np.array(numbers), rel=1e-9)
    ratios = pd.DataFrame([row[:3] for row in ratio_chart.rows]).set_index(0)
    first = ratios.loc[limit].to_numpy()
    assert first[:, 0] == pytest.approx(tables[0]["reference"])
    assert first[:, 1] == pytest.approx(tables[0]["value"] / tables[0]["reference"])


def test_a_folder_without_two_answers_is_one_sentence(tmp_path):
    done = invoke("accuracy", tmp_path)
    assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, "")
