"""The stability map: the project's own methods fail nowhere, and the failures of others show."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace

import pytest

from epcontact import bem
from epcontact.errors import InvalidCase, NotConverged
from epcontact.studies import stability
from epcontact.studies.stability import EXAMINED, GRIDS, stability_map, write


@pytest.fixture(scope="module")
def coarse():
    return stability_map()


def test_own_solvers_fail_nowhere(coarse) -> None:
    own = [*coarse.of("theory", "package"), *coarse.of("fem")]
    own += [p for name in ("capped", "elastic") for p in coarse.of(name, "newton")]
    assert len(own) == 20 + 18 + 16 + 4
    assert [p for p in own if not p.converged] == []
    assert max(p.residual for p in own) <= EXAMINED


def test_failures_are_kept_with_their_reason(coarse) -> None:
    assert coarse.failures
    for point in coarse.failures:
        assert len(point.reason) > 10
        assert "\n" not in point.reason


def test_neither_sum_of_the_theory_serves_everywhere(coarse) -> None:
    # Eigenfunctions lose small plastic areas to cancellation, images what is left of the elastic.
    narrow, wide = min(GRIDS["coarse"].diffusions), max(GRIDS["coarse"].diffusions)
    for method, fails, holds in (("eigenfunctions", narrow, wide), ("images", wide, narrow)):
        points = coarse.of("theory", method)
        assert any(not p.converged for p in points if p.y == fails)
        assert all(p.converged for p in points if p.y == holds)


def test_every_point_of_the_grid_is_there_once(coarse) -> None:
    grid = GRIDS["coarse"]
    points = coarse.of("capped", "newton")
    assert {(p.x, p.y) for p in points} == {
        (x, y) for x in grid.load_shares for y in grid.hardnesses
    }
    assert {p.y for p in coarse.of("elastic")} == {math.inf}


def test_effort_of_newton_is_bounded(coarse) -> None:
    # Transform pairs of the finest grid's size; 84 was the most measured at any point.
    newton = [*coarse.of("capped", "newton"), *coarse.of("elastic", "newton")]
    assert max(p.effort for p in newton) < 200


def test_full_axes_reach_what_is_promised() -> None:
    full = GRIDS["full"]
    assert (min(full.load_shares), max(full.load_shares)) == (0.001, 0.99)
    assert (min(full.hardnesses), max(full.hardnesses)) == (0.001, 100.0)
    assert (min(full.poisson_ratios), max(full.poisson_ratios)) == (0.0, 0.499)


@pytest.mark.long
def test_newton_fails_nowhere_on_the_full_map() -> None:
    found = stability_map(["capped", "elastic"], "full", methods=["newton"])
    assert len(found.points) == 13 * 13 + 13
    assert found.failures == ()


def test_a_solver_that_only_claims_to_converge_is_found_out(monkeypatch) -> None:
    honest = bem.solve

    def lying(scene, **options):
        return honest(scene, threads=1, area_tolerance=0.3)

    monkeypatch.setattr(bem, "solve", lying)
    found = stability_map(["elastic"], methods=["newton"])
    assert any("claims to have converged" in p.reason for p in found.failures)


def test_division_by_zero_is_a_failure_not_a_crash(monkeypatch) -> None:
    def broken(scene, **options):
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(bem, "solve", broken)
    found = stability_map(["elastic"], methods=["newton"])
    assert {p.reason for p in found.points} == {"ZeroDivisionError: float division by zero"}


def test_residual_of_a_failure_is_told(monkeypatch) -> None:
    def stalled(scene, **options):
        raise NotConverged("stalled", {"gap": 1e-2, "force": 1e-9})

    monkeypatch.setattr(bem, "solve", stalled)
    (first, *_) = stability_map(["elastic"], methods=["newton"]).points
    assert (first.converged, first.residual, first.reason) == (False, 1e-2, "stalled")


def test_files_hold_every_point(coarse, tmp_path) -> None:
    paths = write(coarse, tmp_path / "maps")
    assert {p.name for p in paths if p.suffix == ".png"} == {
        f"stability-{name}.png" for name in stability.MAPS
    }
    content = json.loads((tmp_path / "maps" / "stability.json").read_text())
    assert len(content["points"]) == len(coarse.points)
    assert content["failures"] == len(coarse.failures)
    with (tmp_path / "maps" / "stability-capped.csv").open() as file:
        rows = list(csv.reader(file))
    assert len(rows) == 1 + len(coarse.of("capped"))
    failed = sum(not p.converged for p in coarse.of("capped"))
    caption = (tmp_path / "maps" / "stability-capped.txt").read_text()
    assert f"{failed} of {len(rows) - 1} failed" in caption


def test_progress_tells_every_point(monkeypatch) -> None:
    tiny = replace(GRIDS["coarse"], load_shares=(0.1,), diffusions=(0.1,))
    monkeypatch.setitem(GRIDS, "coarse", tiny)
    told: list[str] = []
    stability_map(["theory"], progress=told.append)
    assert len(told) == 3
    assert all("0.1" in line for line in told)


@pytest.mark.parametrize(
    ("maps", "size", "word"), [(["caped"], "coarse", "'caped'"), (["capped"], "huge", "'huge'")]
)
def test_unknown_map_or_size(maps, size, word) -> None:
    with pytest.raises(InvalidCase, match=word):
        stability_map(maps, size)
