"""The stability map: the project's own methods fail nowhere, and the failures of others show."""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from epcontact import bem
from epcontact.errors import InvalidCase, NotConverged
from epcontact.studies.stability import EXAMINED, MAPS, SIZES, stability, write


@pytest.fixture(scope="module")
def coarse() -> pd.DataFrame:
    return stability()


def of(table: pd.DataFrame, name: str, method: str) -> pd.DataFrame:
    return table[(table["map"] == name) & (table["method"] == method)]


def test_own_solvers_fail_nowhere_and_others_say_why(coarse) -> None:
    newton = [of(coarse, "capped", "newton"), of(coarse, "elastic", "newton")]
    own = pd.concat([*newton, of(coarse, "theory", "package"), coarse[coarse["map"] == "fem"]])
    assert len(own) == 16 + 4 + 20 + 18
    assert own["converged"].all()
    assert own["residual"].max() <= EXAMINED
    # Transform pairs of the finest grid's size; 84 was the most measured at any point.
    assert pd.concat(newton)["effort"].max() < 200
    failures = coarse[~coarse["converged"]]
    assert len(failures)
    assert all(len(reason) > 10 and "\n" not in reason for reason in failures["reason"])


def test_neither_sum_of_the_theory_serves_everywhere(coarse) -> None:
    # Eigenfunctions lose small plastic areas to cancellation, images what is left of the elastic.
    _, diffusions = SIZES["coarse"]["theory"]
    narrow, wide = min(diffusions), max(diffusions)
    for method, fails, holds in (("eigenfunctions", narrow, wide), ("images", wide, narrow)):
        converged = of(coarse, "theory", method).groupby("y")["converged"].all()
        assert (converged[fails], converged[holds]) == (False, True)


def test_every_point_of_the_grid_is_there_once(coarse) -> None:
    assert {*of(coarse, "capped", "newton")[["x", "y"]].itertuples(index=False, name=None)} == {
        *product(*SIZES["coarse"]["capped"])
    }
    assert set(coarse[coarse["map"] == "elastic"]["y"]) == {math.inf}


@pytest.mark.long
def test_newton_fails_nowhere_on_the_full_map() -> None:
    found = stability(["capped", "elastic"], "full", methods=["newton"])
    assert len(found) == 13 * 13 + 13
    assert found["converged"].all()


def lying(honest: Any) -> Any:
    return lambda scene, **_: honest(scene, threads=1, area_tolerance=0.3)


def raising(error: Exception) -> Any:
    def solve(*_: Any, **__: Any) -> Any:
        raise error

    return lambda _: solve


@pytest.mark.parametrize(
    ("solver", "residual", "reason"),
    [
        (lying, None, "claims to have converged"),
        (raising(ZeroDivisionError("float division")), None, "ZeroDivisionError: float division"),
        (raising(NotConverged("stalled", {"gap": 1e-2, "force": 1e-9})), 1e-2, "stalled"),
    ],
    ids=("lying", "broken", "stalled"),
)
def test_a_solver_that_fails_or_only_claims_to_converge_is_found_out(
    solver: Any, residual: float | None, reason: str, monkeypatch
) -> None:
    monkeypatch.setattr(bem, "solve", solver(bem.solve))
    found = stability(["elastic"], methods=["newton"])
    told = found[~found["converged"]]
    assert len(told)
    assert told["reason"].str.startswith(reason).all()
    assert residual is None or (told["residual"] == residual).all()


def test_files_hold_every_point(coarse, tmp_path: Path) -> None:
    paths = write(coarse, "coarse", tmp_path / "maps")
    names = {path.name for path in paths if path.suffix == ".png"}
    assert names == {f"stability-{name}.png" for name in MAPS}
    content = json.loads((tmp_path / "maps" / "stability.json").read_text())
    failed = ~coarse["converged"]
    assert [*content["points"][0]] == [*coarse]
    assert (len(content["points"]), content["failures"]) == (len(coarse), failed.sum())
    rows = pd.read_csv(tmp_path / "maps" / "stability-capped.csv")
    capped = coarse["map"] == "capped"
    assert len(rows) == capped.sum()
    assert rows.iloc[:, 3].isna().sum() == failed[capped].sum()
    caption = (tmp_path / "maps" / "stability-capped.txt").read_text()
    assert f"{failed[capped].sum()} of {len(rows)} failed" in caption


def test_unknown_map_or_size() -> None:
    for maps, size, word in ((["caped"], "coarse", "'caped'"), (["capped"], "huge", "'huge'")):
        with pytest.raises(InvalidCase, match=word):
            stability(maps, size)
