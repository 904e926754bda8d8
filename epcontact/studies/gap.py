"""The mean gap against the mean pressure: its elastic and its plastic part, beside theory and FE.

The gap g is that between the flat and the elastically deformed surface; it is negative where the
flat is below that surface because the surface has flowed:

    open gap              <max(g, 0)>   the gap that is left open between the surfaces
    plastic displacement  <max(-g, 0)>  the distance by which flow has lowered the surface
    separation            <g> = open gap - plastic displacement, the distance of the flat from
                          the mean plane of the elastically deformed surface

all means over the nominal area.  As the pressure p rises, its work on the separation is stored or
spent on flow, -p d<g> = dU_el + sigma_P d<max(-g, 0)>, so that the share of the work that is
plastic is sigma_P w/(U_el + sigma_P w) with the plastic displacement w.  The theory's mean
separation is the open gap, that of the surface as the flow has left it (`persson.separation`).

Finite elements solve one small scene by the same laws on the same grid, and by J2 flow.  With J2
the displacement of the surface includes the plastic part, so the gap is nowhere negative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

import fem_check
from epcontact import bem, persson
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import CYCLE
from epcontact.results import ContactResult
from epcontact.scene import Load, Scene
from epcontact.studies.paper_scene import GAMMA, HARDNESS, LAWS, MODULUS, rough_scene
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval

#: Mean pressures over E*; the hardness is 0.6 E*, and the paper's mean pressure 0.05 E*.
LOADS = tuple(0.00625 * 2.0**k for k in range(7))
#: Points of the theory's curve for each of LOADS.
STEPS = 4
#: LOADS without the last one, at which the J2 body is in full contact.
BLOCK_LOADS = LOADS[:-1]
#: Hardness over yield stress, as in the paper.
CONSTRAINT = 3.0
OPEN, SEPARATION, PLASTIC = "open gap", "separation", "plastic displacement"
#: The quantities of a load step that are lengths.
QUANTITIES = {
    OPEN: "mean_gap",
    SEPARATION: "mean_separation",
    PLASTIC: "mean_plastic_displacement",
}
_COLOURS = {"capped": CYCLE[0], "elastic": CYCLE[1], "j2": CYCLE[2]}


def boundary_element_gaps(
    points: int, bandwidth: int, seeds: Sequence[int], progress: Progress
) -> pd.DataFrame:
    """Solve surfaces along LOADS, capped and elastic.

    Returns:
        One row for each law, surface and load: law, seed, pressure_over_modulus, the lengths of
        QUANTITIES over the rms height, and plastic_share, that of the load's work.
    """
    tables = []
    for law, hardness in LAWS.items():
        for seed in seeds:
            progress(f"gap: {law}, seed {seed}")
            scene = _loaded(rough_scene(points, seed, bandwidth, hardness), LOADS)
            result = bem.solve(scene, area_tolerance=1e-5)
            lengths = {name: gaps(result, scene, name) for name in QUANTITIES}
            spent = HARDNESS * np.array(_along(result, QUANTITIES[PLASTIC]))
            share = spent / (np.array(_along(result, "elastic_energy")) + spent)
            columns = {"pressure_over_modulus": LOADS} | lengths | {"plastic_share": share}
            tables.append(pd.DataFrame({"law": law, "seed": seed} | columns))
    return pd.concat(tables, ignore_index=True)


def theory_gaps(points: int, bandwidth: int, seed: int, loads: Sequence[float]) -> pd.DataFrame:
    """The theory's open gap for the spectrum of a surface: law, pressure_over_modulus and
    OPEN over the rms height."""
    tables = []
    for law, hardness in LAWS.items():
        scene = _loaded(rough_scene(points, seed, bandwidth, hardness), loads)
        result = persson.solve(scene, energy_reduction=GAMMA, spectrum="surface")
        columns = {"pressure_over_modulus": loads, OPEN: gaps(result, scene, OPEN)}
        tables.append(pd.DataFrame({"law": law} | columns))
    return pd.concat(tables, ignore_index=True)


def block_gaps(
    points: Sequence[int], bandwidth: int, seed: int, progress: Progress
) -> pd.DataFrame:
    """Solve one surface along BLOCK_LOADS by boundary and finite elements, on several grids.

    Returns:
        One row for each method ("bem", "fem"), law, grid and load: method, law,
        points_per_wavelength, pressure_over_modulus and OPEN over the rms height.
    """
    tables = []
    for n in points:
        key = {"points_per_wavelength": n, "pressure_over_modulus": BLOCK_LOADS}
        for law in (*LAWS, "j2"):
            progress(f"gap: finite elements, {n} points per wavelength, {law}")
            scene = _loaded(rough_scene(n, seed, bandwidth, LAWS.get(law, HARDNESS)), BLOCK_LOADS)
            if law == "j2":
                flowing = replace(scene.material, yield_stress=HARDNESS / CONSTRAINT)
                scene = replace(scene, material=flowing)
            else:
                open_gap = {OPEN: gaps(bem.solve(scene), scene, OPEN)}
                tables.append(pd.DataFrame({"method": "bem", "law": law} | key | open_gap))
            result = fem_check.solve(scene, law=law, certified=False)
            open_gap = {OPEN: gaps(result, scene, OPEN)}
            tables.append(pd.DataFrame({"method": "fem", "law": law} | key | open_gap))
    return pd.concat(tables, ignore_index=True)


def block_deviations(blocks: pd.DataFrame) -> pd.DataFrame:
    """Return finite over boundary elements on the same grid, minus 1; J2 over the capped law.

    Returns:
        One row for each law, grid and load: law, points_per_wavelength, pressure_over_modulus and
        deviation_percent.
    """
    measured, reference = (blocks[blocks["method"] == method] for method in ("fem", "bem"))
    measured = measured.assign(reference_law=measured["law"].replace("j2", "capped"))
    both = measured.merge(
        reference.rename(columns={"law": "reference_law"}),
        on=["reference_law", "points_per_wavelength", "pressure_over_modulus"],
        suffixes=("", "_bem"),
    )
    return both.assign(deviation_percent=100 * (both[OPEN] / both[f"{OPEN}_bem"] - 1))


def gaps(result: ContactResult, scene: Scene, name: str) -> list[float]:
    """Return one of QUANTITIES at each load step, over the rms height."""
    return [length / scene.surface.rms_height for length in _along(result, QUANTITIES[name])]


def _along(result: ContactResult, quantity: str) -> list[float]:
    return [step.quantities[quantity] for step in result.steps]


def _loaded(scene: Scene, loads: Sequence[float]) -> Scene:
    return replace(scene, load=Load(tuple(MODULUS * load for load in loads)))


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart open gaps, their parts and the theory's deviation, and those of finite elements."""
    points, bandwidth, seeds, grids = (
        (4, 64, range(7, 11), (3, 6)) if size == "fast" else (8, 128, range(7, 15), (4, 8))
    )
    measured = boundary_element_gaps(points, bandwidth, seeds, progress)
    fine = boundary_element_gaps(2 * points, bandwidth, seeds[:1], progress)
    loads = np.geomspace(LOADS[0], LOADS[-1], STEPS * (len(LOADS) - 1) + 1).tolist()
    theory = theory_gaps(points, bandwidth, seeds[-1], loads)
    surfaces = f"{len(seeds)} surfaces, 1/{bandwidth} of the longest wave being the shortest"
    return (
        *draw_gaps(measured, theory, fine, surfaces),
        *draw_blocks(block_gaps(grids, 8, 7, progress)),
    )


_PLOT = Plot(
    ("pressure_over_modulus", r"mean pressure over $E^*$ (–)"),
    (OPEN, "open mean gap over rms height (–)"),
    series=("method", "law"),
    colour="law",
    colours=_COLOURS,
    log="xy",
    ticks=LOADS,
)
_MATERIAL = (
    f"with the paper's roughness, E* xi = E*, hardness {HARDNESS / MODULUS:g} E* or none; the "
    "paper's load is 0.05 E*"
)
_DEVIATION = "{law} {deviation_percent:+.1f} % at {pressure_over_modulus:g}"


def theory_deviations(measured: pd.DataFrame, theory: pd.DataFrame) -> pd.DataFrame:
    """Return the theory's open gap over that of boundary elements, minus 1.

    Args:
        measured: the table of `boundary_element_gaps`.
        theory: the table of `theory_gaps`, with more than the loads of `measured`.

    Returns:
        One row for each law and load: law, pressure_over_modulus, deviation_percent with its
        interval.
    """
    place = theory.groupby("law").cumcount()
    exact = theory.assign(load=place // STEPS)[place % STEPS == 0]
    both = measured.assign(load=measured.groupby(["law", "seed"]).cumcount())
    both = both.merge(exact[["law", "load", OPEN]], on=["law", "load"], suffixes=("", "_theory"))
    both["deviation_percent"] = 100 * (both[f"{OPEN}_theory"] / both[OPEN] - 1)
    return mean_with_interval(both, "deviation_percent", ["law", "pressure_over_modulus"])


def draw_gaps(
    measured: pd.DataFrame, theory: pd.DataFrame, fine: pd.DataFrame, surfaces: str
) -> tuple[Chart, Chart, Chart]:
    """Draw the open gap by theory and boundary elements, its parts and the deviation.

    Args:
        measured: the table of `boundary_element_gaps`.
        theory: the table of `theory_gaps`.
        fine: as `measured`, its first surface on a grid twice as fine.
        surfaces: the number of surfaces and their spectrum, in words.
    """
    by = ["law", "pressure_over_modulus"]
    both = pd.concat(
        [
            theory.assign(method="persson", style="curve"),
            mean_with_interval(measured, OPEN, by).assign(method="bem", style="marks"),
        ]
    )
    lengths = measured[measured["law"] == "capped"].melt(
        "pressure_over_modulus", list(QUANTITIES), "part", "length_over_rms_height"
    )
    parts = mean_with_interval(lengths, "length_over_rms_height", ["part", "pressure_over_modulus"])
    deviations = theory_deviations(measured, theory)
    change = fine.merge(
        measured, on=["law", "seed", "pressure_over_modulus"], suffixes=("_fine", "")
    )
    change = 100 * (change[f"{OPEN}_fine"] / change[OPEN] - 1).abs().max()
    shares = measured[measured["law"] == "capped"].groupby("pressure_over_modulus")["plastic_share"]
    shares = 100 * shares.mean().reset_index()
    of_scene = f"of {surfaces}, {_MATERIAL}"
    return (
        draw_table(
            both.sort_values("law", kind="stable"),
            _PLOT,
            f"Mean open gap against mean pressure {of_scene}. Boundary elements: mean of max(g, 0) "
            f"with its 95 % interval; theory: its mean separation with gamma = {GAMMA} and the "
            "spectrum of the same surfaces. On a grid twice as fine the open gap of the first "
            f"surface changes by at most {change:.2g} %.",
        ),
        draw_table(
            parts,
            replace(
                _PLOT,
                y=("length_over_rms_height", "mean gap over rms height (–)"),
                series=("part",),
                colour="",
                log="x",
            ),
            f"Parts of the mean gap of the capped body by boundary elements, {of_scene}. The gap g "
            "is that to the elastically deformed surface, negative where it has flowed: open gap = "
            "mean of max(g, 0), plastic displacement = mean of max(-g, 0), separation = mean of g "
            "= open gap - plastic displacement, exactly. The work of the load is the elastic "
            "energy plus hardness times plastic displacement; of it the plastic part is, by load "
            f"over E*: {listed(shares, '{plastic_share:.2g} % at {pressure_over_modulus:g}')}.",
        ),
        draw_table(
            deviations,
            replace(
                _PLOT,
                y=("deviation_percent", "theory over boundary elements, less 1 (%)"),
                series=("law",),
                log="x",
                level=0.0,
            ),
            "Deviation of the theory's open gap from that of boundary elements, mean with its 95 % "
            f"interval, {of_scene}. {listed(deviations, _DEVIATION)}.",
        ),
    )


def draw_blocks(blocks: pd.DataFrame) -> tuple[Chart, Chart]:
    """Draw open gaps of boundary and finite elements from `block_gaps`, and their deviation."""
    finest = blocks["points_per_wavelength"].max()
    shown = blocks[blocks["points_per_wavelength"] == finest]
    shown = shown.assign(style=np.where(shown["method"] == "bem", "curve", "points"))
    deviations = block_deviations(blocks)
    deviations["grid"] = deviations["points_per_wavelength"].map("{} points".format)
    coarse_j2 = (deviations["law"] == "j2") & (deviations["points_per_wavelength"] < finest)
    plot = replace(_PLOT, ticks=BLOCK_LOADS)
    of_scene = (
        f"of one surface, 1/8 of the longest wave being the shortest, {_MATERIAL}; yield stress "
        f"hardness/{CONSTRAINT:g}"
    )
    return (
        draw_table(
            shown,
            plot,
            f"Mean open gap against mean pressure by boundary and finite elements {of_scene}, "
            f"{finest} grid points a shortest wave for both. Finite elements, of small strain on a "
            "flat block so deep that it matches the half-space within 1e-3, have the same law; "
            "with J2 the body itself flows, no pressure is capped, and the gap is that to the "
            "surface as the flow has left it.",
        ),
        draw_table(
            deviations[~coarse_j2].sort_values("law", kind="stable"),
            replace(
                plot,
                y=("deviation_percent", "finite over boundary elements, less 1 (%)"),
                series=("law", "grid"),
                log="x",
                level=0.0,
            ),
            "Deviation of the open gap of finite elements from that of boundary elements on the "
            f"same grid {of_scene}, by grid points a shortest wave; of J2, from the capped law: a "
            f"difference of models, not an error. With {finest} points: "
            f"{listed(deviations[deviations['points_per_wavelength'] == finest], _DEVIATION)}.",
        ),
    )
