"""The cost of the theory's exact answers: terms of its two series, and finite-volume cells.

With x = p0/sigma_P, c = 2 sqrt(G)/sigma_P and the smaller of x and 1 - x as s, the elastic area
of the capped body has two exact series,

    eigenfunctions   (4/pi) sum_{n = 1, 3, ...} sin(n pi s) exp(-(n pi c / 2)^2) / n
    images           erf(s/c) + sum_{k = 1, 2, ...} (-1)^k [erfc((k - s)/c) - erfc((k + s)/c)].

The reference is `persson.areas`, which uses the shorter one and is accurate to 1e-10 of the area,
mostly to rounding.  If the hardness depends on the magnification, finite volumes solve the same
diffusion; they are tested against the closed form at a constant hardness.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import erf, erfc

from epcontact import persson
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.persson.series import SWITCH
from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.paper_scene import GAMMA, HARDNESS, LOWEST, MEAN_PRESSURE, MODULUS
from epcontact.studies.tables import Progress, Size, listed

#: p0/sigma_P of the paper.
LOAD_SHARE = MEAN_PRESSURE / HARDNESS
#: G/sigma_P^2 of the paper's scene, S = gamma.
PAPER_DIFFUSION = GAMMA * float(persson.full_contact_diffusion(MODULUS / HARDNESS, 1.0))
MOST_TERMS = 40
TARGET = 1e-12


def eigenfunction_sums(relative_diffusion: float, load_share: float, terms: int) -> FloatArray:
    """Return the elastic area by the first 1, 2, ... eigenfunctions, of shape (terms,).

    Args:
        relative_diffusion: G/sigma_P^2.
        load_share: p0/sigma_P.
        terms: number of terms.

    Example:
        >>> eigenfunction_sums(1.0, 1 / 12, 3).round(9)
        array([1.7045e-05, 1.7045e-05, 1.7045e-05])
    """
    n = 2 * np.arange(terms) + 1
    s = min(load_share, 1 - load_share)
    decay = np.exp(-(n**2) * math.pi**2 * relative_diffusion)
    return np.cumsum(4 / (math.pi * n) * np.sin(n * math.pi * s) * decay)


def image_sums(relative_diffusion: float, load_share: float, terms: int) -> FloatArray:
    """Return the same for pairs of images; see `eigenfunction_sums` for the arguments."""
    s, c = min(load_share, 1 - load_share), 2 * math.sqrt(relative_diffusion)
    k = np.arange(1, terms)
    pairs = (-1.0) ** k * (erfc((k - s) / c) - erfc((k + s) / c))
    return np.cumsum(np.concatenate([[erf(s / c)], pairs]))


def series_errors(
    relative_diffusions: Sequence[float], load_share: float = LOAD_SHARE, terms: int = MOST_TERMS
) -> pd.DataFrame:
    """Relative error of the elastic area by the first 1, 2, ... terms of each series.

    Returns:
        One row for each diffusion, series and number of terms: relative_diffusion, series
        (eigenfunctions or images), terms, relative_error.
    """
    tables = []
    for G in relative_diffusions:
        exact = float(persson.areas(G, load_share, 1.0).elastic)
        for name, sums in (("eigenfunctions", eigenfunction_sums), ("images", image_sums)):
            error = np.abs(sums(G, load_share, terms) / exact - 1)
            columns = {"terms": np.arange(1, terms + 1), "relative_error": error}
            tables.append(pd.DataFrame({"relative_diffusion": G, "series": name} | columns))
    return pd.concat(tables, ignore_index=True)


def terms_needed(errors: pd.DataFrame, target: float = TARGET) -> pd.DataFrame:
    """Return the terms after which each series stays within the target; NaN if it never does.

    Args:
        errors: the table of `series_errors`.
        target: relative error.

    Returns:
        One row for each diffusion and series: relative_diffusion, series, terms.

    Example:
        >>> needed = terms_needed(series_errors([1e-3])).set_index("series")["terms"]
        >>> float(needed["images"])
        1.0
    """
    late = errors["terms"].where(~(errors["relative_error"] <= target), 0)
    groups = late.groupby([errors["relative_diffusion"], errors["series"]], sort=False)
    needed = groups.max() + 1.0
    return needed.where(needed <= errors["terms"].max()).reset_index()


def finite_volume_errors(cells: Sequence[int]) -> pd.DataFrame:
    """Relative error of the plastic area of the paper's scene by finite volumes.

    Args:
        cells: of the pressure; as many steps of the magnification are taken.

    Returns:
        One row for each number of cells: cells, relative_error.
    """
    spectrum = SelfAffineSpectrum(0.8, LOWEST, 4 * LOWEST, 256 * LOWEST, 1.0)
    roughness = persson.analytic_roughness(spectrum)
    body = persson.Theory(roughness, MODULUS, persson.EnergyReduction(GAMMA))
    exact = float(persson.areas(PAPER_DIFFUSION, LOAD_SHARE, 1.0).plastic)
    errors = []
    for n in cells:
        curve = persson.hardness_curve(
            body,
            MEAN_PRESSURE,
            lambda zeta: np.full_like(zeta, HARDNESS),
            [256.0],
            resolution=(n, n),
        )
        errors.append(abs(float(curve.areas.plastic[-1]) / exact - 1))
    return pd.DataFrame({"cells": cells, "relative_error": errors})


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart error against terms, terms needed against G, and finite volumes against cells."""
    progress("theory: series")
    first, second = _draw_terms(), _draw_needed()
    progress("theory: finite volumes")
    cells = [64, 128, 256, 512] + ([1024, 2048] if size == "full" else [])
    errors = finite_volume_errors(cells)
    third = draw_table(
        errors.assign(series="finite volumes"),
        Plot(
            ("cells", "cells of the pressure, and steps of the magnification (–)"),
            ("relative_error", "relative error of the plastic area (–)"),
            log="xy",
            ticks=cells,
            orders=["finite volumes"],
        ),
        "Error of the plastic area by finite volumes, which solve the theory where the hardness "
        "depends on the magnification, here with the constant hardness of the paper's scene, "
        "against the closed form, which is right to 1e-10: "
        f"{listed(errors.iloc[[0, -1]], '{relative_error:.1e} with {cells:.0f} cells')}.",
    )
    return first, second, third


def _draw_terms() -> Chart:
    errors = series_errors([0.01, PAPER_DIFFUSION, 1.0], terms=12)
    errors["relative_error"] = errors["relative_error"].clip(lower=np.finfo(float).eps / 4)
    label = r"$G/\sigma_\mathrm{{P}}^2$ = {:.3g}"
    errors["diffusion"] = errors["relative_diffusion"].map(label.format)
    needed = terms_needed(series_errors([PAPER_DIFFUSION]))
    return draw_table(
        errors,
        Plot(
            ("terms", "terms (–)"),
            ("relative_error", "relative error of the elastic area (–)"),
            series=("series", "diffusion"),
            colour="relative_diffusion",
            log="y",
            ticks=[1, 2, 4, 6, 8, 10, 12],
        ),
        "Error of the theory's elastic area against the number of terms, at p0/sigma_P = 1/12 and "
        f"three G/sigma_P^2, of which {PAPER_DIFFUSION:.3g} is that of the paper's scene: images "
        "are short at small G, eigenfunctions at large G. Errors below a quarter of float64's "
        "spacing, 5.6e-17, are drawn there. Reference: the shorter of both, right to 1e-10 of the "
        f"area or better. To {TARGET:g} the paper's scene needs "
        f"{listed(needed, '{terms:.0f} {series}')}.",
    )


def _draw_needed() -> Chart:
    needed = terms_needed(series_errors(np.geomspace(1e-3, 10, 81).tolist()))
    return draw_table(
        needed.assign(style="curve"),
        Plot(
            ("relative_diffusion", r"$G / \sigma_\mathrm{P}^2$ (–)"),
            ("terms", f"terms to a relative error of {TARGET:g} (–)"),
            log="x",
            upright={"change": SWITCH**2 / 4},
            limits={"ylim": (0, 20), "yticks": range(0, 21, 5)},
        ),
        f"Terms that each series of the elastic area needs to be right to {TARGET:g} of itself and "
        f"stay so, at p0/sigma_P = 1/12. Where one needs more than {MOST_TERMS} or its terms "
        "cancel, it is not drawn. The package changes from images to eigenfunctions at "
        f"G/sigma_P^2 = {SWITCH**2 / 4:.3g} (dotted line).",
    )
