"""Whole texts, as commands print them, of answers without a symmetry.

Words stand here once more, and every number is computed from the made-up figures.
"""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from as_read import (
    lasting,
    lines_of_chart,
    lines_of_data,
    lines_of_file,
    lines_of_page,
    same_as_read,
)
from command_line import invoke
from conftest import ROUGH
from test_shown import tree_of, verdict

from epcontact import planning
from epcontact.cli import cases, ledger, plans, studies
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.sweep import Swept, digest
from epcontact.harness.verdict.compare import compare as compared
from epcontact.harness.verdict.judgement import Verdict, tightest
from epcontact.harness.verdict.overview import overview
from epcontact.output.charts.figures import Chart
from epcontact.results import ContactResult

#: Scenes as changes of the small case: two oblong metals that conduct heat, a map with
#: a hole and a spike, and a J2 block.
GATE = '= "fem"\nagainst = "bem"'
PATH = ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8]")
SCENES: dict[str, tuple[tuple[str, str], ...]] = {
    "metals": (
        ("[3, 5, 7]", "[3, 5]"),
        ("period = 1.0e-3", "period = [1.0e-3, 1.25e-3]"),
        PATH,
        (
            "hardness = 6.0e9",
            'hardness = "effective"\nyield_stress = 2.0e9\n'
            "thermal_conductivities = [16.0, 50.0]",
        ),
    ),
    "map": (
        (
            ROUGH,
            'kind = "file"\npath = "map.csv"\nunit = 1e-6\nperiod = [4.8e-4, 5.4e-4]\n'
            'missing = "harmonic"\noutliers = "remove"\nform = 1',
        ),
        ("= 0.536", '= 0.536\nspectrum = "surface"'),
        PATH,
    ),
    "block": (
        ("[3, 5, 7]", "[3]"),
        ("period = 1.0e-3", "period = [1.0e-3, 1.25e-3]\nshape = [12, 15]"),
        ("points_per_shortest_wavelength = { fast = 4, full = 8 }\n", ""),
        ("5.0265", "2.0"),
        ("hardness = 6.0e9", "hardness = 6.0e9\nyield_stress = 2.0e9"),
        ('"persson", "bem"', '"fem", "bem"'),
        ('= "bem"\nagainst = "persson"', GATE),
        ("[theory]\nenergy_reduction = 0.536", '[fem]\nlaw = "j2"\nlayers = 4'),
    ),
}
GATES = """
[[gate]]
quantity = "distribution"
norm = "wasserstein"
of = "bem"
against = "persson"
tolerance = 0.7
because = "two small surfaces are uncertain"

[[gate]]
quantity = "quantity.conductance"
of = "bem"
against = 5.0e4
source = "made up"
between = [-0.9, 0.2]
because = "it is a number"
"""


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_told_as_it_was_read(name, write_case, tmp_path, monkeypatch):
    """By every command that takes a case, on the page, in charts and in files."""
    x, y = np.meshgrid(np.arange(24), np.arange(18))
    heights = np.sin(0.9 * x + 0.5 * y) + 0.7 * np.cos(0.31 * x - 0.8 * y) + 0.03 * x
    heights[3, 4], heights[7:9, 10], heights[12, 2] = np.nan, np.nan, 40
    np.savetxt(tmp_path / "map.csv", heights, delimiter=";")
    case = write_case(*SCENES[name], name=name, more=GATES * (name == "metals"))
    save, charts, out, lines = Chart.save, {}, ("--jobs", 1, "--output", tmp_path), []
    monkeypatch.setattr(
        Chart, "save", lambda c, at: (charts.update({at.name: c}), save(c, at))[1]
    )
    threads = ("--check", "--executor", "concurrent.futures:ThreadPoolExecutor")
    more = [
        ("plan", case, "--tolerance", "20%"),
        ("plan", case, "--tolerance", "9%", *threads),
    ]
    if name == "block":
        more = [("crosscheck", case), ("export", case, tmp_path / "block.inp")]
    stale = tmp_path / name / "fast" / "contact-old.png"
    stale.parent.mkdir(parents=True)
    stale.touch()  # of an earlier run
    for words in (
        ("run", case, *out, "--charts"),
        ("verify", case, *out),
        ("verify", case, *out, "--gates", "--report"),
        ("gates", case, *out[2:]),
        ("cite", case),
        *more,
    ):
        done = invoke(*words)
        assert done.returncode == (words[0] == "verify" and name == "metals"), done
        lines += [f"{words[0]}: {line}" for line in done.stdout.splitlines()]
    assert not stale.exists()
    page = lines_of_page(tree_of(tmp_path / "report.html"))
    lines += (line for line in page if "| none |" not in line)
    lines += (
        line for at, chart in charts.items() for line in lines_of_chart(at, chart)
    )
    for file in sorted((tmp_path / name / "fast").glob("*.[vj][ts][io]*")):
        lines += lines_of_file(file)
        if file.suffix == ".json" and file.stem in METHODS:
            for member in json.loads(file.read_text("utf-8"))["members"]:
                result = ContactResult.from_json(member)
                lines += [repr(result), *result._repr_html_().splitlines()]
    lines = (str(line).replace(str(tmp_path), "HOME") for line in lines)
    same_as_read(lasting(lines), f"{name}.txt", tmp_path)


def test_what_is_told_without_a_scene_is_as_it_was_read(tmp_path):
    metal = (
        "--yield-stress",
        1e9,
        "--young-modulus",
        7e10,
        "--poisson-ratio",
        0.2,
        "--mean-pressure",
        2e8,
        "--rms-slope",
    )
    joint = (
        "--conductivities",
        16,
        50,
        "--rms-height",
        3e-6,
        "--rms-slope",
        0.2,
        "--mean-pressure",
        3e7,
        "--hardness",
        3e9,
        "--effective-modulus",
    )
    lines = []
    for words in (
        ("list",),
        ("list", "--all"),
        ("keys",),
        ("chart",),
        ("hardness", *metal, 0.3),
        ("hardness", *metal, 0.1, "--breadth", 9),
        ("joint", *joint, 2e11),
        ("joint", *joint, 2e10, "--breadth", 9),
        ("cite", "calculix-5"),
        ("cite", "layer-bonded"),
    ):
        lines += invoke(*words).stdout.splitlines()
    same_as_read(lasting(lines), "commands.txt", tmp_path)


def test_verify_tells_counts_gates_and_what_to_do_next(capsys, tmp_path):
    """Of three cases that hold, two that fall short, one error and one that is
    skipped.
    """
    made = verdict().cases
    more = [
        made[k].model_copy(update={"id": f"case-{k}-{at}"})
        for at, k in enumerate((0, 0, 1))
    ]
    left = {
        "id": "case-s",
        "status": "skipped",
        "gates": [],
        "skipped_because": "no map is here",
    }
    more.append(made[0].model_copy(update=left | {"methods": {}}))
    found = []
    for case, number in zip([*made, *more], (0, 2, 0, 1, 0, 0, 2), strict=True):
        found.append(
            case.model_copy(update={"not_judged": ["a gate", "another"][:number]})
        )
        about = {
            "recipes": (),
            "lists_loads": False,
            "told_hardness": "hard" * (case is made[1]),
        }
        found[-1]._case = SimpleNamespace(**about)
    assert tightest(found[2].gates).status == "error"
    whole, one = (Verdict.on(some, "fast") for some in (found, found[3:4]))
    for each in (
        (whole, False, False),
        (whole, True, False),
        (whole, True, True),
        (one, True, True),
    ):
        cases._show(each[0], Path("my results"), *each[1:])
    lines = capsys.readouterr().out.splitlines()
    same_as_read(
        [*lines, *lines_of_data(overview(whole)["families"], "page")],
        "verify.txt",
        tmp_path,
    )


def test_compare_tells_each_move_and_each_count(capsys, tmp_path):
    old = pd.DataFrame(
        {
            "case": ["a", "a", "a", "a", "b", "b", "b", "b"],
            "size": "fast",
            "name": [
                "x of m against 1 (relative)",
                "y of m against 0 (absolute)",
                "cost.fft_pairs of m",
                "cost.seconds of m",
                "z of m",
                "w of m against n (relative)",
                "gone of m",
                "v of m",
            ],
            "scene": "",
            "value": [1.0, 0.0, 8.0, 2.0, 5.0, 3.0, 1.0, 7.0],
            "reference": np.nan,
            "error": [0.1, 0.5, np.nan, np.nan, np.nan, 0.2, np.nan, 0.1],
            "low": [-1, -0.25, np.nan, np.nan, np.nan, -0.1, np.nan, np.nan],
            "high": [1, 0.75, np.nan, np.nan, np.nan, 0.3, np.nan, np.nan],
            "status": "",
        }
    )
    new = old[old["name"] != "gone of m"].copy()
    new["value"] = [1.25, 0.125, 12.0, 5.0, 5.001, 3.05, 7.0]
    last = new["name"].str.startswith("w")
    new.loc[last, ["status", "error", "high"]] = ["falls short", 0.4, 0.5]
    new.loc[[0, 1], ["low", "high"]] = [
        [-0.5, 0.5],
        [-0.5, 0.75],
    ]  # narrower, and wider below
    other = pd.DataFrame(
        {"case": "c", "size": "full", "name": "x of m", "scene": ["one"]}
    )
    old = pd.concat([old, other.assign(value=1.0)])
    added = [new.tail(1).assign(name=f"{name} of m") for name in "efghiju"]
    new = pd.concat(
        [new, other.assign(scene="two", value=9.0), *added, other.assign(case="d")]
    )
    found = compared(old, new)
    assert found.moved.set_index("figure")["moved"].to_dict() == pytest.approx(
        {"x of m": 2.5, "y of m": 0.25, "z of m": 0.001 / 5.001e-4, "w of m": 0.125},
        rel=1e-9,
    )
    assert [*found.moved["figure"]] == ["x of m", "z of m", "y of m", "w of m"]
    assert (found.beyond, found.exit_code, found.compared, found.time) == (
        2,
        1,
        6 - 1,
        2.5,
    )
    ledger._show(found)
    lines = [" ".join(capsys.readouterr().out.split())]
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
    bare = {"points": np.nan, "scenes": 1, "time": np.nan, "fft_pairs": 0.0}
    lines += (" | ".join(ledger._row(row | other)) for other in ({}, bare))
    same_as_read(lines, "compare.txt", tmp_path)


def test_plans_maps_and_sweeps_tell_costs_tasks_notes_and_failures(
    monkeypatch, write_case, tmp_path
):
    chosen = planning.Plan(
        "other",
        0.02,
        ("total",),
        "bem",
        "corrected",
        {},
        0.003,
        0.004,
        1.25e6,
        9.875e7,
        5e3,
        (),
        (),
        [SimpleNamespace(shape=(24, 36))],
    )
    monkeypatch.setattr(planning, "plan", lambda *_, **__: chosen)
    lines = invoke("plan", write_case()).stdout.splitlines()
    table = pd.DataFrame(
        {
            "map": ["capped"] * 4 + ["fem"] * 2,
            "method": ["n", "n", "n", "k", "f", "f"],
            "converged": [True, False, True, True, True, True],
            "effort": [5, np.nan, 30, 7, 2, 11.5],
        }
    )
    lines += (" | ".join(column.cells) for column in studies._summary(table).columns)
    table = pd.DataFrame(
        {"load": [0, 1, 0, 1, 0], "solved": [True, True, True, True, False]}
    )
    entry = lambda x, e: {"mean": x, "error": e, "parts": {"grid": e}}  # noqa: E731
    rows = [
        {
            "branch": b,
            "mean_pressure": entry(p, 0.0),
            "total_area": entry(a, 0.01),
            "mean_gap": entry(u, 2e-8),
        }
        for b, p, a, u in (
            ("loading", 2e3, 0.125, 3e-6),
            ("unloading", 1e3, 0.0625, 4e-6),
        )
    ]
    loads = {f"hardness {n}, bem": (rows[: 1 + n % 2], f"{n}") for n in range(43)}
    failures = {"one": "stalled", "two": "no memory", "three": "stalled"}
    swept = Swept(
        Path("x"),
        table,
        failures,
        1,
        loads,
        [],
        {"a note": 2},
        {Path("x.vti"): "point 7"},
    )
    monkeypatch.setattr(plans, "run_sweep", lambda *_, **__: swept)
    done = invoke("sweep", "mine")
    assert done.returncode == 2
    lines += [*done.stdout.splitlines(), *done.stderr.splitlines()]
    lines = [line.replace(digest(table)[:12], "DIGEST") for line in lines]
    same_as_read(lines, "sweep.txt", tmp_path)
