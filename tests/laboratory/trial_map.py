"""The map of a user's trial: turned steel with tilt, holes and spikes, and what its
spikes change.

`python -m laboratory.trial_map` prints areas and hardness with and without spikes, in a
minute of one core.
"""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd

from epcontact import Load, Material, Scene, SelfAffineSpectrum, bem
from epcontact.materials.hardness_map import effective_hardness
from epcontact.surfaces import HeightsFromArray, SelfAffine
from epcontact.surfaces.power_spectrum import surface_moments

PIXEL = 0.8  # µm
STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3}
YIELD = 1.0e9
PRESSURE = 4.0e8  # Pa


def trial_map(spikes: int = 25, seed: int = 34, *, holes: bool = True) -> np.ndarray:
    """Return invented heights (400, 300) in µm, as an instrument measures them with 0.8
    µm between points.

    The surface has tool marks 37.2 µm apart, roughness and tilt; `spikes` points are
    outliers, and twelve rectangles are NaN if `holes`.
    """
    rng = np.random.default_rng(seed)
    wave = 2 * np.pi / (512 * PIXEL)
    spectrum = SelfAffineSpectrum(0.8, wave, 12 * wave, 128 * wave, 0.05)
    rough = (
        SelfAffine(spectrum, (512 * PIXEL,) * 2, (512, 512), seed)
        .build()
        .heights[:400, :300]
    )
    x, y = np.meshgrid(np.arange(400) * PIXEL, np.arange(300) * PIXEL, indexing="ij")
    mark = (x + 0.02 * y) / 37.2
    heights = rough + 3.0 * (mark % 1 - 0.5) ** 2 + 0.01 * x - 0.006 * y
    for i, j in rng.integers(0, (390, 290), (12, 2)) if holes else ():
        heights[i : i + rng.integers(1, 9), j : j + rng.integers(1, 9)] = np.nan
    places = rng.choice(np.flatnonzero(np.isfinite(heights)), spikes, replace=False)
    heights.flat[places] += rng.choice([-1, 1], spikes) * rng.uniform(1.2, 3.0, spikes)
    return heights


def row(spikes: int, outliers: str) -> dict[str, object]:
    """Return the effective hardness and the areas of the trial map at 400 MPa as a row
    of the table.

    `outliers` is "keep" or "remove", the treatment of the spikes.
    """
    periods = (400 * PIXEL * 1e-6, 300 * PIXEL * 1e-6)
    steps = {"missing": "harmonic", "form": 1, "outliers": outliers}
    surface = HeightsFromArray(
        1e-6 * trial_map(spikes), periods, "mirrored", **steps
    ).build()
    slope = surface_moments(surface).rms_slope
    cap = effective_hardness(
        yield_stress=YIELD, rms_slope=slope, mean_pressure=PRESSURE, **STEEL
    ).value
    scene = Scene(surface, Material(**STEEL, hardness=cap), Load(PRESSURE))
    last = bem.solve(scene, threads=1).final
    area, claimed = (last.areas[kind].total for kind in ("corrected", "error"))
    return {
        "spikes": spikes,
        "outliers": outliers,
        "rms slope": slope,
        "hardness / GPa": cap / 1e9,
        "area": area,
        "claimed": claimed,
        "mean gap / µm": 1e6 * last.quantities["mean_gap"],
    }


def main():
    """Print the table of hardness and areas with 0, 1 and 25 spikes, kept and
    removed.
    """
    warnings.simplefilter("ignore")
    cases = [
        (0, "keep"),
        (0, "remove"),
        (1, "keep"),
        (1, "remove"),
        (25, "keep"),
        (25, "remove"),
    ]
    print(pd.DataFrame([row(*case) for case in cases]).to_string(index=False))


if __name__ == "__main__":
    main()
