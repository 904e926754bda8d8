"""Self-affine surfaces by random phases.

`SelfAffine` is the recipe of one surface, `SelfAffineEnsemble` the table of a case file
for several surfaces of one spectrum.  The height is the band-limited real field

    h(x) = sum_q B(q) exp(i (q.x + phi_q)),   phi_-q = -phi_q,

over all modes of the period with q_0 <= |q| <= q_1; on a line B(q) = sqrt(pi C1(q) /
L).

phi_q depends only on the seed and the two integers of the mode: a counter-based
generator mixes their 64 bits.  A finer grid therefore samples the same surface, and a
wider band only adds roughness to it (up to the factor that keeps the rms slope).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import ducc0
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StrictFloat, StrictInt

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import (
    SelfAffineSpectrum,
    as_tuple,
    integer,
    positive,
    require_kind,
    set_frozen,
)
from epcontact.surfaces.recipe import (
    Fields,
    Generated,
    Periods,
    Shape,
    entry,
    sequence,
)
from epcontact.surfaces.spectrum import BAND_TOLERANCE, amplitude_shape

#: Number of modes handled at once, which limits temporary arrays to a few MiB.
_BLOCK = 2**16


def grid_shape(
    spectrum: SelfAffineSpectrum,
    periods: tuple[float, ...],
    points_per_shortest_wavelength: float,
) -> tuple[int, ...]:
    """Return the shape of the grid that resolves a spectrum by a number of points.

    Args:
        spectrum: the spectrum; its `wavenumber_high` q_1 (rad/m) has the shortest
            wavelength, 2 pi / q_1.
        periods: (Lx, Ly), or (L,) for a line, in m.
        points_per_shortest_wavelength: more than 2; 4 or 8 are usual.

    Returns:
        (nx, ny), or (nx,) for a line.

    Raises:
        InvalidScene: if a number is not positive, or a period has less than two points.

    Example:
        >>> spectrum = SelfAffineSpectrum(0.8, 1.0, 4.0, 64.0, rms_slope=1.0)
        >>> grid_shape(spectrum, (2 * math.pi, 2 * math.pi), 4)
        (256, 256)
    """
    require_kind("spectrum", spectrum, SelfAffineSpectrum)
    lengths = [positive("periods", p, "m") for p in as_tuple(periods)]
    name = "points_per_shortest_wavelength"
    points = positive(name, points_per_shortest_wavelength, "points")
    shape = tuple(
        round(points * p * spectrum.wavenumber_high / (2 * math.pi)) for p in lengths
    )
    for period, count in zip(lengths, shape, strict=True):
        if count < 2:
            raise InvalidScene(
                f"{points:g} points per shortest wavelength are {count} on a period of "
                f"{period:g} m, but at least 2 are needed; check the periods"
            )
    return shape


@dataclass(frozen=True)
class SelfAffine(Generated):
    """Self-affine roughness by random phases, with the exact rms slope on the grid.

    The grid needs more than two points per shortest wavelength; at two, the phase of a
    mode is lost.

    Example:
        >>> spectrum = SelfAffineSpectrum(0.8, 1.0, 4.0, 8.0, rms_slope=0.5)
        >>> surface = SelfAffine(spectrum, (2 * math.pi,) * 2, (32, 32), seed=7).build()
        >>> surface.shape, abs(float(surface.heights.mean())) < 1e-15
        ((32, 32), True)
    """

    formula = "self_affine/1"
    spectrum: Annotated[SelfAffineSpectrum, entry("", "the analytic power spectrum")]
    periods: Periods
    shape: Shape
    seed: Annotated[int, entry("", "a whole number; each gives another surface", ge=0)]

    def __post_init__(self) -> None:
        """Check the fields of this recipe.

        Raises InvalidScene if a value is out of its range, if a period is shorter than
        the longest wave of the spectrum, or if the grid does not resolve the shortest.
        """
        require_kind("spectrum", self.spectrum, SelfAffineSpectrum)
        super().__post_init__()
        q0 = self.spectrum.wavenumber_low
        q1 = self.spectrum.wavenumber_high
        for period, points in zip(self.periods, self.shape, strict=True):
            if 2 * math.pi / period > q0 * (1 + BAND_TOLERANCE):
                raise InvalidScene(
                    f"a period of {period:g} m holds no wave longer than itself, but "
                    f"wavenumber_low = {q0:g} rad/m needs at least "
                    f"{2 * math.pi / q0:g} m"
                )
            needed = 2 * _highest_index(q1, period) + 1
            if points < needed:
                raise InvalidScene(
                    f"{points} grid points on a period of {period:g} m do not resolve "
                    f"wavenumber_high = {q1:g} rad/m, which needs at least {needed}"
                )

    def _heights(self) -> FloatArray:
        """Return the heights of this recipe in m, of the shape of its grid."""
        if len(self.shape) == 1:
            return _line_heights(self)
        return grid_heights(self)

    def _about(self) -> dict[str, Any]:
        """Return spectrum, seed and shortest wavelength (m) of this recipe by name."""
        shortest = 2 * math.pi / self.spectrum.wavenumber_high
        return {
            "spectrum": self.spectrum,
            "seed": self.seed,
            "shortest_wavelength": shortest,
        }


@dataclass(frozen=True, kw_only=True)
class SelfAffineEnsemble(Fields):
    """Several surfaces of one self-affine spectrum, which differ in their seeds.

    This is the table [surface] of kind self_affine.  Either `shape` or
    `points_per_shortest_wavelength` gives the grid.  A single period is used for both
    directions of a surface; a line must give its shape.

    Example:
        >>> ensemble = SelfAffineEnsemble(
        ...     periods=(2 * math.pi,), shape=(32, 32), hurst=0.8, rms_slope=0.5,
        ...     wavenumber_low=1.0, wavenumber_roll_off=4.0, wavenumber_high=8.0,
        ...     seeds=(1, 2, 3))
        >>> [recipe.seed for recipe in ensemble.recipes()]
        [1, 2, 3]
    """

    periods: Periods
    hurst: Annotated[StrictFloat, entry("", "Hurst exponent, 0 to 1", ge=0, le=1)]
    wavenumber_low: Annotated[StrictFloat, entry("rad/m", "no roughness below", gt=0)]
    wavenumber_roll_off: Annotated[
        StrictFloat, entry("rad/m", "flat spectrum below, power law above", gt=0)
    ]
    wavenumber_high: Annotated[StrictFloat, entry("rad/m", "no roughness above", gt=0)]
    rms_slope: Annotated[StrictFloat, entry("m/m", "exact on the grid", gt=0)]
    points_per_shortest_wavelength: Annotated[
        StrictInt | None,
        entry("", "grid points per 2 pi / wavenumber_high; or give shape", ge=3),
    ] = None
    shape: Shape | None = None
    seeds: Annotated[
        tuple[Annotated[StrictInt, Field(ge=0)], ...],
        sequence(int),
        entry("", "one random surface each; gates read their mean", min_length=1),
    ]
    kind: Literal["self_affine"] = "self_affine"

    def __post_init__(self) -> None:
        """Check how this ensemble gives its grid, and its seeds.

        Raises InvalidScene if both or neither of `shape` and
        `points_per_shortest_wavelength` are given, or if a seed is no whole number from
        0 on.
        """
        if (self.shape is None) == (self.points_per_shortest_wavelength is None):
            raise InvalidScene("give either points_per_shortest_wavelength or shape")
        seeds = tuple(integer("seeds", n, 0) for n in as_tuple(self.seeds))
        set_frozen(self, periods=as_tuple(self.periods), seeds=seeds)
        if len(set(self.seeds)) != len(self.seeds):
            raise InvalidScene("seeds repeat a surface; give each seed once")
        self.recipes()  # raises if the spectrum or the grid is wrong

    def recipes(self) -> tuple[SelfAffine, ...]:
        """Return the recipes of this ensemble: one for each seed.

        Raises InvalidScene if the grid does not resolve the spectrum.
        """
        spectrum = SelfAffineSpectrum(
            self.hurst,
            self.wavenumber_low,
            self.wavenumber_roll_off,
            self.wavenumber_high,
            self.rms_slope,
        )
        periods = self.periods
        shape = self.shape
        if shape is None:
            if len(periods) == 1:
                periods = periods * 2
            points: Any = self.points_per_shortest_wavelength
            shape = grid_shape(spectrum, periods, points)
        return tuple(SelfAffine(spectrum, periods, shape, seed) for seed in self.seeds)


# --- heights --------------------------------------------------------------------------


def _highest_index(wavenumber: float, period: float) -> int:
    """Return the largest integer k whose wave number 2 pi k / period is in the band.

    Args:
        wavenumber: the upper limit of the band in rad/m; a wave number that exceeds it
            by less than one part in a million counts as inside.
        period: the length of the period in m.
    """
    return math.floor(wavenumber * period / (2 * math.pi) * (1 + BAND_TOLERANCE))


def _phases(seed: int, kx: NDArray[np.int64], ky: NDArray[np.int64]) -> FloatArray:
    """Return random phases of Fourier modes, uniform in [0, 2 pi) rad.

    The phase of a mode depends only on the seed and the mode.

    Args:
        seed: a whole number, at least 0.
        kx, ky: the integers of each mode along x and y, between -2^31 and 2^31.  Their
            shapes are broadcast to that of the result.
    """
    key = np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]
    low_bits = ky.astype(np.uint64) & np.uint64(0xFFFFFFFF)
    word = (kx.astype(np.uint64) << np.uint64(32)) | low_bits
    word = _mix(_mix(word) ^ key)
    # The upper 53 bits are all that a float can hold.
    return (word >> np.uint64(11)).astype(np.float64) * (2 * math.pi * 2.0**-53)


def _mix(word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return pseudo-random 64-bit integers, one for each given integer.

    The function is the last step of the generator SplitMix64 (Steele, Lea and Flood
    2014).  It is one-to-one.
    """
    word = word + np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1)):
        word ^= word >> np.uint64(shift)
        word *= np.uint64(factor)
    return word


def _line_heights(recipe: SelfAffine) -> FloatArray:
    """Return the heights (nx,) of a self-affine line in m.

    Their rms slope is exactly that of the recipe's spectrum.
    """
    (n,) = recipe.shape
    (period,) = recipe.periods
    spectrum = recipe.spectrum
    k = np.arange(1, _highest_index(spectrum.wavenumber_high, period) + 1)
    q = 2 * math.pi / period * k
    amplitude = amplitude_shape(spectrum, q, dimension=1)
    scale = spectrum.rms_slope / math.sqrt(2 * np.sum((q * amplitude) ** 2))
    phases = _phases(recipe.seed, k, np.zeros_like(k))
    modes = np.zeros(n // 2 + 1, np.complex128)
    modes[1 : k.size + 1] = scale * amplitude * np.exp(1j * phases)
    return np.asarray(ducc0.fft.c2r(modes, lastsize=n, forward=False))


def grid_heights(recipe: SelfAffine) -> FloatArray:
    """Return the heights (nx, ny) of a self-affine surface in m.

    Their rms slope is exactly that of the recipe's spectrum.
    """
    nx, ny = recipe.shape
    modes = np.zeros((nx, ny // 2 + 1), np.complex128)
    slope_variance = _fill_modes(recipe, modes)
    # Only columns with nonzero modes need the transform along x, which is done in
    # place.
    columns = _highest_index(recipe.spectrum.wavenumber_high, recipe.periods[1]) + 1
    filled = modes[:, :columns]
    filled *= recipe.spectrum.rms_slope / math.sqrt(slope_variance)
    ducc0.fft.c2c(filled, axes=(0,), forward=False, out=filled)
    # An array that the FFT library allocates itself would be copied later.
    heights = np.empty((nx, ny))
    ducc0.fft.c2r(modes, (1,), ny, forward=False, out=heights)
    return heights


def _fill_modes(recipe: SelfAffine, modes: NDArray[np.complex128]) -> float:
    """Write the modes of equation (7) of the paper into an array of zeros.

    The amplitudes are equation (8) of the paper: B(q) = (2 pi / sqrt(Lx Ly))
    sqrt(C(q)), C = C_0 f.  This function writes sqrt(f) exp(i phi) into the half plane
    ky >= 0 and returns the sum of q^2 f over all modes of the plane, in 1/m^2.  The
    caller sets the common factor from this sum, so that the rms slope of the *grid*,
    sqrt(sum q^2 B^2), is exact.

    Args:
        recipe: the recipe of a surface (nx, ny); its spectrum, periods and seed count.
        modes: zeros of shape (nx, ny // 2 + 1), as of a real transform of (nx, ny)
            heights; changed in place.
    """
    spectrum = recipe.spectrum
    qx, qy = (2 * math.pi / period for period in recipe.periods)
    kx_max, ky_max = (
        _highest_index(spectrum.wavenumber_high, period) for period in recipe.periods
    )
    ky = np.arange(ky_max + 1)[None, :]
    multiplicity = np.where(ky == 0, 1.0, 2.0)  # a mode of ky > 0 stands for -ky, too
    slope_variance = 0.0
    rows = max(1, _BLOCK // (ky_max + 1))
    for first in range(-kx_max, kx_max + 1, rows):
        kx = np.arange(first, min(first + rows, kx_max + 1))[:, None]
        q = np.hypot(qx * kx, qy * ky)
        amplitude = amplitude_shape(spectrum, q, dimension=2)
        slope_variance += float(np.sum(multiplicity * (q * amplitude) ** 2))
        # In the first column, the mode with kx > 0 sets the phase of its opposite mode.
        opposite = (ky == 0) & (kx < 0)
        phase = _phases(recipe.seed, np.where(opposite, -kx, kx), ky)
        phase = np.where(opposite, -phase, phase)
        modes[kx[:, 0] % modes.shape[0], : ky_max + 1] = amplitude * np.exp(1j * phase)
    return slope_variance
