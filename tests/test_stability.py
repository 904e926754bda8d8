"""The stability map: the project's own methods fail nowhere, and the failures of others
show.
"""

import json
from functools import partial

import numpy as np
import pandas as pd
import pytest

from epcontact import bem
from epcontact.cli.charts import _summary
from epcontact.errors import InvalidCase, NotConverged
from epcontact.studies.stability import EXAMINED, MAPS, SIZES, chart, stability, write


@pytest.fixture(scope="module")
def coarse():
    """Return the table of all stability maps at the coarse size."""
    return stability()


def test_own_solvers_fail_nowhere_and_others_say_why(coarse):
    """The project's own methods converge at every point of the maps, with a residual of
    at most EXAMINED, and every failure of others has a reason of one line.
    """
    of_project = coarse[
        coarse["method"].isin(["newton", "package"]) | (coarse["map"] == "fem")
    ]
    assert len(of_project) == 16 + 4 + 20 + 18
    assert of_project["converged"].all()
    assert of_project["residual"].max() <= EXAMINED
    # Transform pairs of the finest grid's size; 84 was the most measured at any point.
    assert coarse[coarse["method"] == "newton"]["effort"].max() < 200
    reasons = coarse[~coarse["converged"]]["reason"]
    assert all(len(reason) > 10 and "\n" not in reason for reason in reasons)


def test_neither_sum_of_the_theory_serves_everywhere(coarse):
    """The sum over eigenfunctions fails at the smallest diffusion and holds at the
    largest, and the sum over images the other way round.
    """
    # Eigenfunctions lose small plastic areas to cancellation, images what is left of
    # the elastic.
    _, diffusions = SIZES["coarse"]["theory"]
    narrow, wide = min(diffusions), max(diffusions)
    for method, fails, holds in (
        ("eigenfunctions", narrow, wide),
        ("images", wide, narrow),
    ):
        of_method = coarse[(coarse["map"] == "theory") & (coarse["method"] == method)]
        converged = of_method.groupby("y")["converged"].all()
        assert (converged[fails], converged[holds]) == (False, True)


@pytest.mark.long
def test_newton_fails_nowhere_on_the_full_map():
    """Newton's method converges at all points of the full maps of capped and elastic
    bodies.
    """
    found = stability(["capped", "elastic"], "full", methods=["newton"])
    assert len(found) == 13 * 13 + 13
    assert found["converged"].all()


def failing(error):
    """Return a solver that raises an error."""

    def solve(*_, **__):
        """Raise the error."""
        raise error

    return solve


@pytest.mark.parametrize(
    ("solve", "residual", "reason"),
    [
        (partial(bem.solve, area_tolerance=0.3), None, "claims to have converged"),
        (failing(ZeroDivisionError("of floats")), None, "ZeroDivisionError: of floats"),
        (
            failing(NotConverged("stalled", {"gap": 1e-2, "force": 1e-9})),
            1e-2,
            "stalled",
        ),
    ],
)
def test_a_solver_that_fails_or_only_claims_to_converge_is_found_out(
    solve, residual, reason, monkeypatch
):
    """A failed solve and one that stops too early are failures on the map, with their
    residual and a reason that begins with `reason`.
    """
    monkeypatch.setattr(bem, "solve", lambda scene, **_: solve(scene))
    found = stability(["elastic"], methods=["newton"])
    failures = found[~found["converged"]]
    assert len(failures)
    assert failures["reason"].str.startswith(reason).all()
    assert residual is None or (failures["residual"] == residual).all()


def test_files_hold_every_point(coarse, tmp_path):
    """The stability study writes every point and the count of failures to
    stability.json, and one picture a map.
    """
    write(coarse, "coarse", tmp_path)
    assert {path.stem for path in tmp_path.glob("*.png")} == {
        f"stability-{name}" for name in MAPS
    }
    content = json.loads((tmp_path / "stability.json").read_text())
    failed, capped = ~coarse["converged"], coarse["map"] == "capped"
    assert [*content["points"][0]] == [*coarse]
    assert (len(content["points"]), content["failures"]) == (len(coarse), failed.sum())
    caption = (tmp_path / "stability-capped.txt").read_text()
    assert f"{failed[capped].sum()} of {capped.sum()} failed" in caption


@pytest.mark.parametrize("name", MAPS)
def test_a_map_holds_the_effort_of_each_point(coarse, name):
    """The chart of a map has the effort of each point that converged and NaN for
    others, with one panel for each method.
    """
    points = coarse[coarse["map"] == name]
    drawn = chart(points, "coarse")
    keys = ["method", "x", "y"]
    expected = points[keys].assign(effort=points["effort"].where(points["converged"]))
    found = pd.DataFrame([row[:4] for row in drawn.rows], columns=expected.columns)
    pd.testing.assert_frame_equal(
        found.sort_values(keys, ignore_index=True),
        expected.sort_values(keys, ignore_index=True),
        check_dtype=False,
    )
    titles = [axes.get_title() for axes in drawn.figure.axes if axes.images]
    assert titles == [*dict.fromkeys(points["method"])]


def test_the_summary_counts_points_and_failures_and_has_the_largest_effort():
    """The table in the terminal has points, failures and the largest effort of each
    method.
    """
    points = pd.DataFrame(
        {
            "map": ["capped", "capped", "capped", "fem"],
            "method": ["newton", "newton", "newton", "fem"],
            "converged": [True, False, True, True],
            "effort": [5.0, np.nan, 30.0, 11.5],
        }
    )
    columns = [[str(c) for c in column.cells] for column in _summary(points).columns]
    assert columns == [
        ["capped", "fem"],
        ["newton", "fem"],
        ["3", "1"],
        ["1", "0"],
        ["30", "11.5"],
    ]


def test_unknown_map_or_size():
    """An unknown map or size raises InvalidCase that quotes it."""
    for maps, size, word in (
        (["caped"], "coarse", "'caped'"),
        (["capped"], "huge", "'huge'"),
    ):
        with pytest.raises(InvalidCase, match=word):
            stability(maps, size)
