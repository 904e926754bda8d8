"""What the theory's exact answers cost: terms of its two series, and cells of its numerical form.

With x = p0/sigma_P, c = 2 sqrt(G)/sigma_P and the smaller of x and 1 - x as s, the elastic area
has two exact series,

    eigenfunctions   (4/pi) sum_{n = 1, 3, ...} sin(n pi s) exp(-(n pi c / 2)^2) / n
    images           erf(s/c) + sum_{k = 1, 2, ...} (-1)^k [erfc((k - s)/c) - erfc((k + s)/c)].

The reference is `persson.areas`, which takes the shorter one and is right to 1e-10 of the area,
mostly to rounding.  Where the hardness depends on the magnification finite volumes solve the
same diffusion; with a constant hardness the closed form judges them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import erf, erfc

from epcontact.output.charts.curves import observed_order
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves, with_orders
from epcontact.persson import full_contact_diffusion
from epcontact.results import FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart


#: p0/sigma_P of the paper.
LOAD_SHARE = scenes.MEAN_PRESSURE / scenes.HARDNESS
#: G/sigma_P^2 of the paper's scene, S = gamma.
PAPER_DIFFUSION = scenes.GAMMA * float(
    full_contact_diffusion(scenes.MODULUS / scenes.HARDNESS, 1.0)
)
MOST_TERMS = 40
TARGET = 1e-12


def eigenfunction_sums(relative_diffusion: float, load_share: float, terms: int) -> FloatArray:
    """(terms,): the elastic area by the first 1, 2, ... eigenfunctions.

    relative_diffusion: G/sigma_P^2; load_share: p0/sigma_P.
    """
    n = 2 * np.arange(terms) + 1
    s = min(load_share, 1 - load_share)
    decay = np.exp(-(n**2) * math.pi**2 * relative_diffusion)
    return np.cumsum(4 / (math.pi * n) * np.sin(n * math.pi * s) * decay)


def image_sums(relative_diffusion: float, load_share: float, terms: int) -> FloatArray:
    """(terms,): the elastic area by the first 1, 2, ... pairs of images."""
    s, c = min(load_share, 1 - load_share), 2 * math.sqrt(relative_diffusion)
    k = np.arange(1, terms)
    pairs = (-1.0) ** k * (erfc((k - s) / c) - erfc((k + s) / c))
    return np.cumsum(np.concatenate([[erf(s / c)], pairs]))


def series_errors(
    relative_diffusion: float, load_share: float = LOAD_SHARE, terms: int = MOST_TERMS
) -> dict[str, FloatArray]:
    """Relative error of the elastic area by the first 1, 2, ... terms of each series."""
    exact = _exact(relative_diffusion, load_share)
    sums = {"eigenfunctions": eigenfunction_sums, "images": image_sums}
    return {
        name: np.abs(summed(relative_diffusion, load_share, terms) / exact - 1)
        for name, summed in sums.items()
    }


def terms_needed(
    relative_diffusion: float, load_share: float = LOAD_SHARE, target: float = TARGET
) -> dict[str, int]:
    """The terms after which each series stays within `target`; MOST_TERMS + 1 if none does."""
    needed = {}
    for name, error in series_errors(relative_diffusion, load_share).items():
        late = np.flatnonzero(~(error <= target))
        needed[name] = int(late[-1]) + 2 if late.size else 1
    return needed


def finite_volume_errors(cells: list[int]) -> FloatArray:
    """(n,): relative error of the plastic area by finite volumes of the paper's scene.

    As many steps of the magnification are taken as there are cells.
    """
    from epcontact import persson
    from epcontact.scene import SelfAffineSpectrum

    low = scenes.LOWEST
    roughness = persson.analytic_roughness(SelfAffineSpectrum(0.8, low, 4 * low, 256 * low, 1.0))
    body = persson.Theory(roughness, scenes.MODULUS, persson.EnergyReduction(scenes.GAMMA))
    exact = float(persson.areas(PAPER_DIFFUSION, LOAD_SHARE, 1.0).plastic)
    errors = []
    for n in cells:
        found = persson.hardness_curve(
            body,
            scenes.MEAN_PRESSURE,
            lambda zeta: np.full_like(zeta, scenes.HARDNESS),
            [256.0],
            resolution=(n, n),
        )
        errors.append(abs(float(found.areas.plastic[-1]) / exact - 1))
    return np.array(errors)


def _exact(relative_diffusion: float, load_share: float) -> float:
    from epcontact.persson import areas

    return float(areas(relative_diffusion, load_share, 1.0).elastic)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Error against terms, terms needed against G, finite volumes against cells."""
    progress("theory: series")
    cells = [64, 128, 256, 512] + ([1024, 2048] if size == "full" else [])
    first, second = _draw_terms(), _draw_needed()
    progress("theory: finite volumes")
    errors = finite_volume_errors(cells)
    series = [Series("finite volumes", cells, errors)]
    third = curves(
        series,
        x="cells of the pressure, and steps of the magnification (–)",
        y="relative error of the plastic area (–)",
        columns=("cells", "relative_error"),
        caption="Error of the plastic area by finite volumes, which solve the theory where the "
        "hardness depends on the magnification, here with the constant hardness of the paper's "
        "scene, against the closed form, which is right to 1e-10: "
        f"{errors[0]:.1e} with {cells[0]} cells, {errors[-1]:.1e} with {cells[-1]}, of order "
        f"{observed_order(1 / np.array(cells), errors):.2f}.",
        log="xy",
        labels=with_orders(series, ["finite volumes"], sign=-1),
        ticks=cells,
    )
    return first, second, third


def _draw_terms() -> Chart:
    from epcontact.output.charts.style import CYCLE

    colours, series = {}, []
    told = " or ".join(f"{n} {name}" for name, n in terms_needed(PAPER_DIFFUSION).items())
    count = np.arange(1, 13)
    for colour, G in zip(CYCLE, (0.01, PAPER_DIFFUSION, 1.0), strict=False):
        for name, error in series_errors(G, terms=12).items():
            label = rf"{name}, $G/\sigma_\mathrm{{P}}^2$ = {G:.3g}"
            colours[label] = colour
            series.append(Series(label, count, np.maximum(error, np.finfo(float).eps / 4)))
    return curves(
        series,
        x="terms (–)",
        y="relative error of the elastic area (–)",
        columns=("terms", "relative_error"),
        caption="Error of the theory's elastic area against the number of terms, at p0/sigma_P = "
        f"1/12 and three G/sigma_P^2, of which {PAPER_DIFFUSION:.3g} is that of the paper's "
        "scene: images are short at small G, eigenfunctions at large G. Errors below a quarter "
        "of float64's spacing, 5.6e-17, are drawn there. Reference: the shorter of both, right "
        f"to 1e-10 of the area or better. To {TARGET:g} the paper's scene needs {told}.",
        log="y",
        colours=colours,
        ticks=[1, 2, 4, 6, 8, 10, 12],
    )


def _draw_needed() -> Chart:
    from epcontact.persson.series import SWITCH

    G = np.geomspace(1e-3, 10, 81)
    needed = [terms_needed(float(g)) for g in G]
    series = []
    for name in needed[0]:
        found = np.array([one[name] for one in needed], dtype=np.float64)
        found[found > MOST_TERMS] = np.nan
        series.append(Series(name, G, found, line=True))
    return curves(
        series,
        x=r"$G / \sigma_\mathrm{P}^2$ (–)",
        y=f"terms to a relative error of {TARGET:g} (–)",
        columns=("relative_diffusion", "terms"),
        caption=f"Terms that each series of the elastic area needs to be right to {TARGET:g} of "
        f"itself and stay so, at p0/sigma_P = 1/12. Where one needs more than {MOST_TERMS} or "
        "its terms cancel, it is not drawn. The package changes from images to eigenfunctions "
        f"at G/sigma_P^2 = {SWITCH**2 / 4:.3g} (dotted line).",
        log="x",
        upright={"change": SWITCH**2 / 4},
        limits={"ylim": (0, 20), "yticks": range(0, 21, 5)},
    )
