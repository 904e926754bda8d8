"""The laboratory of the rule "near_bounds": it fits gamma, rho and c of
`epcontact.persson.near_bounds`.

Boundary elements give the corrected areas of 30 places of the plane (p0 and hardness
over E* xi), on spectra with and without roll-off; on 4 points a wave, up to a hardness
of .3 E* xi, where the elastic area needs it, on 8.  One half of the spectra and seeds
is fitted.  The other half has other Hurst exponents, bandwidths and seeds; its errors
were printed for the first time when the form and the constants stood in the package.
The misfit of an area is that of its logarithm over the aim (2 % for A, 5 % for A_el and
A_pl) and its own error together, with outliers damped (soft L1).  The own error is the
standard error over the seeds and the error estimate of the grid.  Areas below a
thousandth are a few grid points, and left out.

`python -m laboratory.near_bounds [SAVED.jsonl]` prints the fit and the errors of the
rule and of the paper's, on both halves and on the map of `persson.validity`, whose
plane is wider, where the own error is below 5 % and everywhere.  It solves 4800 scenes
in some fifteen minutes of one core, but none that the file holds.
"""

import functools
import json
import math
import sys
from importlib.resources import files
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from epcontact import bem, persson
from epcontact.persson.clipped_pressure import SAVED_ENERGY, displacements
from epcontact.persson.near_bounds import (
    CONSTANTS,
    RESOLUTION,
    STRIPS,
    StressState,
    integrate,
    nayak_along,
    relative_wavenumbers,
    with_strips,
)
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum
from epcontact.studies.paper_scene import GAMMA, LOWEST, MODULUS
from epcontact.surfaces import SelfAffine

HALVES = {
    "fitted": {"hurst": (0.3, 0.8), "bandwidth": (32, 128), "seed": range(1, 9)},
    "judged": {"hurst": (0.4, 0.65, 0.9), "bandwidth": (48, 96), "seed": range(21, 29)},
}
ROLL_OFFS = (1, 4)
LOADS = (0.005, 0.02, 0.05, 0.1, 0.2, 0.4)
HARDNESSES = (0.1, 0.16, 0.3, 0.6, 1.2, math.inf)
PLACES = [(p, h) for h, p in product(HARDNESSES, LOADS) if p < 0.85 * h]
AIMS = {"total": 0.02, "elastic": 0.05, "plastic": 0.05}
LEAST = 1e-3
#: Up to this hardness over E* xi there are 8 grid points a wave, beyond it 4.
SOFT = 0.3
#: An area whose own relative error is larger cannot judge the aims.
LARGEST_OWN_ERROR = 0.05
SPECTRUM = ["half", "hurst", "bandwidth", "roll_off"]


def spectrum_of(hurst, bandwidth, roll_off):
    """Return the spectrum of rms slope 1; bandwidth and roll-off are multiples of the
    lowest wavenumber.
    """
    return SelfAffineSpectrum(hurst, LOWEST, roll_off * LOWEST, bandwidth * LOWEST, 1.0)


def solved(hurst, bandwidth, roll_off, seed):
    """Yield a row for each load and hardness of PLACES: the corrected areas by boundary
    elements, their estimated errors, and the mean gap and plastic displacement over the
    rms height.

    The arguments are those of `spectrum_of` and the seed of the surface; areas are
    fractions of the nominal area.
    """
    spectrum = spectrum_of(hurst, bandwidth, roll_off)
    periods = (2 * math.pi / LOWEST,) * 2
    surfaces = {}
    for points_per_wave in (4, 8):
        shape = (points_per_wave * bandwidth,) * 2
        surfaces[points_per_wave] = SelfAffine(spectrum, periods, shape, seed).build()
    for p0, hardness in PLACES:
        surface = surfaces[8 if hardness <= SOFT else 4]
        body = Material(MODULUS, 0.0, hardness * MODULUS)
        scene = Scene(surface, body, Load(p0 * MODULUS))
        step = bem.solve(scene, area_tolerance=1e-4).final
        row = {"p0": p0, "hardness": hardness}
        for part in AIMS:
            row[part] = getattr(step.areas["corrected"], part)
            row[f"{part}_error"] = getattr(step.areas["error"], part)
        row["gap"] = step.quantities["mean_gap"] / surface.rms_height
        flow = step.quantities["mean_plastic_displacement"]
        row["plastic_displacement"] = flow / surface.rms_height
        yield row


def measured(kept):
    """Return mean areas over the seeds of every place and spectrum, with the error of
    each mean.

    `kept` is a file of solved rows, one JSON object a line, to which new rows are
    appended, or None.
    """
    lines = kept.read_text().splitlines() if kept and kept.exists() else []
    rows = [json.loads(line) for line in lines]
    keys = (*SPECTRUM, "seed")
    there = {tuple(row[key] for key in keys) for row in rows}
    for half, axes in HALVES.items():
        for hurst, bandwidth, seed, roll_off in product(*axes.values(), ROLL_OFFS):
            place = (hurst, bandwidth, roll_off, seed)
            if (half, *place) in there:
                continue
            name = dict(zip(keys, (half, *place), strict=True))
            new = [name | row for row in solved(*place)]
            rows += new
            if kept:
                with kept.open("a") as file:
                    file.writelines(json.dumps(row) + "\n" for row in new)
    groups = pd.DataFrame(rows).groupby([*SPECTRUM, "p0", "hardness"])
    mean = groups.mean(numeric_only=True)
    for part in AIMS:
        scatter = groups[part].std() / np.sqrt(groups.size())
        mean[f"{part}_error"] = np.hypot(scatter, mean[f"{part}_error"])
    for name in mean.columns.intersection(["gap", "plastic_displacement"]):
        mean[f"{name}_error"] = groups[name].std() / np.sqrt(groups.size())
    return mean.reset_index()


def areas_of_rule(table, constants, resolution, strips=STRIPS):
    """Return the areas by the theory with the rule "near_bounds", (rows, 3).

    The columns are in the order of AIMS.  `constants` are gamma, rho and c, and
    `strips` are C, m and h_0 of the strips of soft bodies, or None for the diffusion
    equation alone; loads and hardnesses of the table are over E* times rms slope.
    """
    paths = {}
    for spectrum in set(table[SPECTRUM[1:]].itertuples(index=False, name=None)):
        roughness = persson.analytic_roughness(spectrum_of(*spectrum))
        variance, breadth = relative_wavenumbers(roughness)
        paths[spectrum] = variance / 8, breadth, nayak_along(roughness)
    found = []
    for row in table.itertuples():
        tau, breadth, nayak = paths[row.hurst, row.bandwidth, row.roll_off]
        state = integrate(
            tau, breadth, row.p0, row.hardness, tuple(constants), resolution
        )
        if strips is not None and math.isfinite(row.hardness):
            along = np.interp(np.log(state.diffusion), np.log(tau), nayak)
            state = with_strips(state, along, row.p0, row.hardness, strips)
        end = state.areas
        found.append((end.total, end.elastic, end.plastic))
    return np.array(found)


def usable(table):
    """Return a mask (rows, 3) of the areas above LEAST, without the parts of elastic
    bodies, which equal the total area or 0.
    """
    large = table[[*AIMS]].to_numpy() > LEAST
    large[np.isinf(table["hardness"]), 1:] = False
    return large


def own_errors(table):
    """Return the relative errors of the measured areas, (rows, 3); 1 for areas of 0."""
    area = table[[*AIMS]].to_numpy()
    error = table[[f"{part}_error" for part in AIMS]].to_numpy()
    return np.divide(error, area, out=np.ones_like(area), where=area > 0)


def fit(table, start=CONSTANTS):
    """Return the constants gamma, rho and c that fit the areas of a table.

    Standard errors of the constants come second.
    """
    area = table[[*AIMS]].to_numpy()
    scale = np.hypot(np.array([*AIMS.values()]), own_errors(table))
    used = usable(table)

    def misfit(constants):
        """Return ln(area of the rule / measured area) over its allowed error, (n,), for
        the constants gamma, rho and c.
        """
        found = areas_of_rule(table, constants, (50, 8), strips=None)
        return np.log(found[used] / area[used]) / scale[used]

    bounds = ([0.01, 0.1, 0.01], [1.0, 20.0, 5.0])
    found = least_squares(
        misfit, start, "2-point", bounds, loss="soft_l1", diff_step=0.01
    )
    variance = 2 * found.cost / (used.sum() - len(start))
    covariance = variance * np.linalg.inv(found.jac.T @ found.jac)
    return found.x, np.sqrt(np.diag(covariance))


def over_the_map():
    """Return the package's map of the theory's error in the columns of `measured`, and
    the areas (rows, 3) by the rule of the paper.
    """
    table = pd.read_csv(files("epcontact.persson") / "theory_map.csv", comment="#")
    table["p0"] = table["load"] * table["hardness"].replace(math.inf, 1.0)
    table = table.rename(columns={"wavelength_ratio": "bandwidth"})
    for part in AIMS:
        own = np.hypot(table[f"{part}_scatter"], table[f"{part}_grid"])
        table[f"{part}_error"] = table[part] * own
    off = table[[f"{part}_theory" for part in AIMS]].to_numpy()
    return table, table[[*AIMS]].to_numpy() * (1 + off)


def report(name, found, table, largest_own_error=math.inf):
    """Print rms, median, 95 % and largest error of each area in %, and the percentage
    of errors below its aim.

    `found` are the areas (rows, 3) to compare with those of the table.  Areas with a
    larger own error than `largest_own_error` are left out.
    """
    area = table[[*AIMS]].to_numpy()
    own = own_errors(table)
    used = usable(table) & (own <= largest_own_error)
    for i, (part, aim) in enumerate(AIMS.items()):
        counted = used[:, i]
        off = 100 * (found[counted, i] / area[counted, i] - 1)
        middle, wide = np.quantile(abs(off), [0.5, 0.95])
        of_area = 100 * math.sqrt(np.mean(own[counted, i] ** 2))
        print(
            f"{name:24} {part:8} n {off.size:4} rms {math.sqrt(np.mean(off**2)):5.1f} "
            f"mean {off.mean():+5.1f} median {middle:4.1f} 95 % {wide:5.1f} "
            f"largest {abs(off).max():4.0f} own {of_area:4.1f} "
            f"within the aim {100 * np.mean(abs(off) < 100 * aim):3.0f} %"
        )


def report_all(name, table, paper):
    """Print the errors of the rule and of the paper's, where areas can judge and all.

    `paper` are the areas (rows, 3) by the rule of the paper.
    """
    rule = areas_of_rule(table, CONSTANTS, RESOLUTION)
    for limit in (LARGEST_OWN_ERROR, math.inf):
        print(f"{name}, own error up to {limit}")
        report("near_bounds", rule, table, limit)
        report(f"constant, {GAMMA}", paper, table, limit)


#: Up to this hardness over E* xi the strips of soft bodies are fitted.
STRIPS_UP_TO = 0.6


def fit_strips(table):
    """Return C, m and h_0 of the strips of soft bodies that fit the elastic areas of a
    table, and print their errors with and without strips by hardness and roll-off.

    Places whose own error is at most twice that of the places that judge the aims
    count.
    """
    i = [*AIMS].index("elastic")
    own = own_errors(table)[:, i]
    counted = (table["hardness"] < 1.01 * STRIPS_UP_TO) & usable(table)[:, i]
    counted &= own < 2 * LARGEST_OWN_ERROR
    table = table[counted]
    own = own[counted]
    without = areas_of_rule(table, CONSTANTS, RESOLUTION, None)
    area = table["elastic"].to_numpy()

    def errors(strips):
        """Return ln(elastic area with strips / measured area), (n,)."""
        return np.log(areas_with(without, table, strips) / area)

    def misfit(strips):
        """Return the errors over their allowed errors, (n,)."""
        return errors(strips) / np.hypot(AIMS["elastic"], own)

    found = least_squares(misfit, STRIPS, loss="soft_l1")
    before = np.log(without[:, i] / area)
    after = errors(STRIPS)
    for place, rows in (
        table.reset_index().groupby(["hardness", "roll_off"]).indices.items()
    ):
        rms = [100 * math.sqrt(np.mean(off[rows] ** 2)) for off in (before, after, own)]
        print(
            f"A_el at hardness {place[0]:.2f}, roll-off {place[1]:g}, n {rows.size}: "
            f"rms {rms[0]:.1f} % without strips, {rms[1]:.1f} % with, "
            f"own {rms[2]:.1f} %"
        )
    return found.x


def areas_with(without, table, strips):
    """Return the elastic areas of a table's bodies with strips, (rows,).

    `without` are the areas (rows, 3) by the diffusion equation alone, and `strips` are
    C, m and h_0.
    """
    found = []
    for row, (_, elastic, plastic) in zip(table.itertuples(), without, strict=True):
        spectrum = spectrum_of(row.hurst, row.bandwidth, row.roll_off)
        nayak = nayak_along(persson.analytic_roughness(spectrum))[-1:]
        one = StressState(
            diffusion=np.array([1 / 8]),
            elastic=np.array([elastic]),
            plastic=np.array([plastic]),
            separated=np.array([1 - elastic - plastic]),
            pressure=np.array([0.0, row.hardness]),
            density=np.zeros(2),
        )
        found.append(with_strips(one, nayak, row.p0, row.hardness, strips).elastic[0])
    return np.array(found)


#: The smallest mean gap or plastic displacement over the rms height that counts, and
#: the aim for the relative error of both.
SMALLEST_GAP = 0.03
GAP_AIM = 0.05


@functools.cache
def own_roughness(hurst, bandwidth, roll_off):
    """Return the roughness of a surface's own Fourier modes, and its rms height in m.

    All seeds have the same, since their modes differ in phase alone.  The mean gap
    depends on the longest waves, of which a period holds a few.  The arguments are
    those of `spectrum_of`.
    """
    spectrum = spectrum_of(hurst, bandwidth, roll_off)
    periods = (2 * math.pi / LOWEST,) * 2
    surface = SelfAffine(spectrum, periods, (4 * bandwidth,) * 2, 1).build()
    return persson.roughness_of(surface, "surface"), surface.rms_height


def gaps_of_theory(table, saved_energy=SAVED_ENERGY):
    """Return the mean gap and the plastic displacement over the rms height by
    `persson.clipped_pressure`, (rows, 2).

    `saved_energy` is its constant; loads and hardnesses of the table are over E* times
    rms slope.
    """
    found = []
    for row in table.itertuples():
        rough, height = own_roughness(row.hurst, row.bandwidth, row.roll_off)
        reduction = persson.EnergyReduction(GAMMA)
        theory = persson.Theory(rough, MODULUS, reduction, row.hardness * MODULUS)
        at_load = displacements(theory, row.p0 * MODULUS, saved_energy)
        found.append((at_load.mean_gap, at_load.plastic_displacement))
        found[-1] = np.array(found[-1]) / height
    return np.array(found)


def fit_saved_energy(table):
    """Return the constant of `persson.clipped_pressure` that fits the mean gaps of a
    table, and its standard error.

    The misfit of a gap is its relative error over the aim and its own error together,
    with outliers damped.
    """
    table = table[table["gap"] > SMALLEST_GAP]
    gap = table["gap"].to_numpy()
    scale = np.hypot(GAP_AIM, table["gap_error"] / gap).to_numpy()

    def misfit(saved_energy):
        """Return the errors of the gaps over their allowed errors, (n,)."""
        return (gaps_of_theory(table, float(saved_energy[0]))[:, 0] / gap - 1) / scale

    found = least_squares(
        misfit, [SAVED_ENERGY], "2-point", (0, 0.9), loss="soft_l1", diff_step=0.05
    )
    variance = 2 * found.cost / (gap.size - 1) / np.sum(found.jac**2)
    return float(found.x[0]), math.sqrt(variance)


def report_gaps(table):
    """Print the errors of mean gap and plastic displacement in %, by half, roll-off and
    kind of body; of all places, and of those whose own error is at most 5 %.
    """
    by_theory = gaps_of_theory(table)
    for k, name in enumerate(("gap", "plastic_displacement")):
        if name not in table or table[name].isna().all():
            continue
        value = table[name].to_numpy()
        own = np.divide(
            table[f"{name}_error"], value, out=np.ones_like(value), where=value > 0
        )
        off = np.divide(
            by_theory[:, k], value, where=value > 0, out=np.ones_like(value)
        )
        off = 100 * (off - 1)
        for half, roll_off, capped in product(HALVES, ROLL_OFFS, (True, False)):
            rows = (table["half"] == half) & (table["roll_off"] == roll_off)
            rows &= (np.isfinite(table["hardness"]) == capped) & (value > SMALLEST_GAP)
            for limit in (LARGEST_OWN_ERROR, math.inf):
                chosen = (rows & (own <= limit)).to_numpy()
                if not chosen.any():
                    continue
                rms = math.sqrt(np.mean(off[chosen] ** 2))
                of_own = 100 * math.sqrt(np.mean(own[chosen] ** 2))
                body = "capped" if capped else "elastic"
                print(
                    f"{name} {half} {body} roll-off {roll_off} own error <= {limit}: "
                    f"n {chosen.sum()} rms {rms:.1f} mean {off[chosen].mean():+.1f} "
                    f"median {np.median(abs(off[chosen])):.1f} "
                    f"95 % {np.quantile(abs(off[chosen]), 0.95):.1f} own {of_own:.1f}"
                )


def main():
    """Fit the constants to the half "fitted", and print the errors of both halves and
    of the map.
    """
    table = measured(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    constants, errors = fit(table[table["half"] == "fitted"])
    print("gamma, rho, c", constants.round(4), "+-", errors.round(4), "used", CONSTANTS)
    for half in HALVES:
        rows = table[table["half"] == half]
        paper = persson.areas(GAMMA / 8, rows["p0"], rows["hardness"])
        report_all(half, rows, np.column_stack([getattr(paper, p) for p in AIMS]))
    report_all("map", *over_the_map())
    halves = table[table["half"] == "fitted"]
    soft = pd.concat([over_the_map()[0], halves], ignore_index=True)
    print("C, m and h_0 of strips", fit_strips(soft).round(3), "used", STRIPS)
    saved_energy, error = fit_saved_energy(table[table["half"] == "fitted"])
    print(f"saved energy {saved_energy:.3f} +- {error:.3f}, used {SAVED_ENERGY}")
    report_gaps(table)


if __name__ == "__main__":
    main()
