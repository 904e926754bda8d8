"""Sinusoidal waviness against a rigid flat: formulas and closed forms.

One wave along x, h(x) = h (1 + cos(2 pi x/lambda)) up to a constant: Westergaard
(1939), in the form of Johnson, International Journal of Solids and Structures 32 (1995)
423.  Exact. The product of two waves, h (1 + cos cos): the asymptotes of Johnson,
Greenwood and Higginson, International Journal of Mechanical Sciences 27 (1985) 383;
between them no closed form is known.

Symbols: h = amplitude (m; half the distance from valley to crest of the line), lambda =
wavelength (m), E* = effective_modulus (Pa), p* = pressure of complete contact (Pa), s =
mean pressure / p*, psi = pi x/lambda with x measured from a crest, a = half-width of a
contact.  The formulas hold for 0 <= s <= 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.reference.form import ClosedForm
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

# --- formulas of one wave


def line_complete_pressure(
    amplitude: float, wavelength: float, effective_modulus: float
) -> float:
    """Return p* = pi E* h / lambda in Pa, the mean pressure that leaves no gap.

    Args:
        amplitude: h in m.
        wavelength: lambda in m.
        effective_modulus: E* in Pa.
    """
    return math.pi * effective_modulus * amplitude / wavelength


def line_contact_fraction(load: float) -> float:
    """Return 2 a/lambda = (2/pi) arcsin(sqrt(s)), the contact area of a sinusoid.

    It is a fraction of the nominal area; a is the half-width of a contact.

    Args:
        load: s, the mean pressure over the pressure p* of complete contact, from 0 to
            1.
    """
    return 2 / math.pi * math.asin(math.sqrt(load))


def line_pressure(position: FloatArray, load: float) -> FloatArray:
    """Return the pressure under a sinusoid over the pressure p* of complete contact.

    It is p/p* = 2 cos(psi) sqrt(s - sin^2 psi) with psi = pi x/lambda in contact, and 0
    elsewhere.

    Args:
        position: x/lambda from a crest, of any shape.
        load: s, the mean pressure over p*, from 0 to 1.
    """
    angle = np.pi * (np.asarray(position) - np.rint(position))
    depth = np.maximum(load - np.sin(angle) ** 2, 0)
    return np.asarray(2 * np.cos(angle) * np.sqrt(depth))


def line_gap(position: FloatArray, load: float) -> FloatArray:
    """Return the gap of a sinusoid over its amplitude, which is 0 in contact:

        g/h = 2 [S sqrt(S^2 - s) - s arccosh(S/sqrt(s))],   S = |sin(pi x/lambda)|

    Its slope continues the pressure analytically.

    Args:
        position: x/lambda from a crest, of any shape.
        load: s, the mean pressure over the pressure p* of complete contact, from 0 to
            1.
    """
    sine = np.abs(np.sin(np.pi * (np.asarray(position) - np.rint(position))))
    if load == 0:
        return np.asarray(2 * sine**2)
    ratio = np.maximum(sine / math.sqrt(load), 1)
    return np.asarray(2 * load * (ratio * np.sqrt(ratio**2 - 1) - np.arccosh(ratio)))


def line_mean_gap(load: float) -> float:
    """Return the mean gap of a sinusoid over its amplitude, 1 - s + s ln s.

    Args:
        load: s, the mean pressure over the pressure p* of complete contact, from 0 to
            1.
    """
    return 1 - load + load * _log(load)


def line_energy(load: float) -> float:
    """Return the elastic energy of a sinusoid per nominal area over h p*.

    It is s^2 (1/4 - ln(s)/2), the work of the load s, with the amplitude h.

    Args:
        load: s, the mean pressure over the pressure p* of complete contact, from 0 to
            1.
    """
    return load**2 / 4 - load**2 * _log(load) / 2


def _log(load: float) -> float:
    """Return ln s, or 0 at s = 0, where every product with a power of s vanishes.

    `load` is s, the mean pressure over the pressure of complete contact.
    """
    return math.log(load) if load else 0.0


# --- formulas of the product of two waves


def surface_complete_pressure(
    amplitude: float, wavelength: float, effective_modulus: float
) -> float:
    """Return the mean pressure that leaves no gap in a product of two waves, in Pa.

    It is p* = sqrt(2) pi E* h / lambda for the heights h (1 + cos(2 pi x/lambda) cos(2
    pi y/lambda)).

    Args:
        amplitude: h in m.
        wavelength: lambda in m.
        effective_modulus: E* in Pa.
    """
    return math.sqrt(2) * math.pi * effective_modulus * amplitude / wavelength


def surface_contact_fraction_light(load: float) -> float:
    """Return the contact area of a product of two waves in the limit s -> 0.

    It is the fraction pi (3 s/(8 pi))^(2/3), that of Hertz on two crests per period.

    Args:
        load: s, the mean pressure over the pressure p* of complete contact.
    """
    return math.pi * float((3 * load / (8 * math.pi)) ** (2 / 3))


def surface_contact_fraction_heavy(load: float) -> float:
    """Return the contact area of a product of two waves in the limit s -> 1.

    It is the fraction 1 - (3/(2 pi)) (1 - s).  The two gaps per period are penny-shaped
    cracks without stress intensity, with the radius b of b^2 = 3 (1 - s) lambda^2/(4
    pi^2).

    Args:
        load: s, the mean pressure over the pressure p* of complete contact.
    """
    return 1 - 3 / (2 * math.pi) * (1 - load)


# --- the closed forms

_JGH = "Johnson, Greenwood and Higginson, Int. J. Mech. Sci. 27 (1985) 383"
WESTERGAARD = ClosedForm(
    "westergaard", "Westergaard 1939; Johnson, Int. J. Solids Struct. 32 (1995) 423"
)
WAVINESS_LIGHT = ClosedForm("waviness_light", f"{_JGH}: Hertz on every crest, s -> 0")
WAVINESS_HEAVY = ClosedForm("waviness_heavy", f"{_JGH}: penny-shaped gaps, s -> 1")
#: Pressures at which Westergaard's distribution is tabulated.
_TABULATED = 4097


@dataclass(frozen=True)
class _Wave:
    """One wave along x, as measured on the heights of a scene.

    Attributes:
        load: s = mean pressure / p*.
        amplitude: h in m.
        complete: p* in Pa.
        position: x/lambda from a crest for each row of the grid, (nx,).
    """

    load: float
    amplitude: float
    complete: float
    position: FloatArray

    @classmethod
    def of(cls, scene: Scene) -> _Wave:
        """Return the wave that is measured on the heights of a scene.

        Raises:
            InvalidCase: The scene is no elastic half-space, or the heights are no
                sinusoid along x.
        """
        E = WESTERGAARD.elastic_half_space(scene)
        heights = scene.surface.heights
        profile = heights if heights.ndim == 1 else heights[:, 0]
        modes = np.fft.rfft(profile) * 2 / profile.size
        k = int(np.argmax(np.abs(modes[1:]))) + 1
        amplitude = abs(modes[k])
        phase = np.angle(modes[k])
        x = np.arange(profile.size) / profile.size * k + phase / (2 * np.pi)
        wave = profile.mean() + amplitude * np.cos(2 * np.pi * x)
        misfit = np.abs((heights.T - wave).T).max()
        WESTERGAARD.require(bool(misfit < 1e-9 * amplitude), "one sinusoid along x")
        complete = line_complete_pressure(amplitude, scene.surface.periods[0] / k, E)
        return cls(scene.load.final / complete, amplitude, complete, x)

    @classmethod
    def in_partial_contact(cls, scene: Scene) -> _Wave:
        """Return the wave that is measured on the heights of a partial contact.

        Raises:
            InvalidCase: The scene is no elastic half-space, the heights are no sinusoid
                along x, or the load closes every gap.
        """
        wave = cls.of(scene)
        WESTERGAARD.require(wave.load < 1, "partial contact")
        return wave


@WESTERGAARD.gives("area.total")
def _wave_fraction(scene: Scene) -> float:
    """Return the contact area of a sinusoid as a fraction of the nominal area.

    Raises InvalidCase if the scene is no sinusoid on an elastic half-space.
    """
    return line_contact_fraction(min(1.0, _Wave.of(scene).load))


@WESTERGAARD.gives("quantity.mean_gap")
def _wave_mean_gap(scene: Scene) -> float:
    """Return the mean gap of a sinusoid in m, which is 0 once the contact is complete.

    Raises InvalidCase if the scene is no sinusoid on an elastic half-space.
    """
    wave = _Wave.of(scene)
    if wave.load >= 1:
        return 0.0
    return wave.amplitude * line_mean_gap(wave.load)


@WESTERGAARD.gives("quantity.elastic_energy")
def _wave_energy(scene: Scene) -> float:
    """Return the elastic energy of a sinusoid in J per m^2 of nominal area.

    Raises InvalidCase if the scene is no sinusoid, or if the load closes every gap.
    """
    wave = _Wave.in_partial_contact(scene)
    return wave.amplitude * wave.complete * line_energy(wave.load)


@WESTERGAARD.gives("quantity.largest_pressure")
def _wave_peak(scene: Scene) -> float:
    """Return the pressure on the crest of a sinusoid in Pa.

    Raises InvalidCase if the scene is no sinusoid, or if the load closes every gap.
    """
    wave = _Wave.in_partial_contact(scene)
    return 2 * wave.complete * math.sqrt(wave.load)


@WESTERGAARD.gives("field.pressure")
def _wave_pressure(scene: Scene) -> FloatArray:
    """Return the pressure of a sinusoid in Pa at each grid point of the scene.

    Raises InvalidCase if the scene is no sinusoid, or if the load closes every gap.
    """
    wave = _Wave.in_partial_contact(scene)
    profile = wave.complete * line_pressure(wave.position, wave.load)
    return np.broadcast_to(profile, scene.surface.shape[::-1]).T


@WESTERGAARD.gives("field.gap")
def _wave_gap(scene: Scene) -> FloatArray:
    """Return the gap of a sinusoid in m at each grid point, at the last load.

    Raises InvalidCase if the scene is no sinusoid, or if the load closes every gap.
    """
    wave = _Wave.in_partial_contact(scene)
    profile = wave.amplitude * line_gap(wave.position, wave.load)
    return np.broadcast_to(profile, scene.surface.shape[::-1]).T


@WESTERGAARD.gives("distribution")
def _wave_distribution(scene: Scene) -> PressureDistribution:
    """Return the distribution of a sinusoid's pressure, tabulated in equal steps.

    The pressure falls from crest to rim, so that the area below sigma lies between the
    place of sigma and the rim.  This place solves (p/p*)^2 = 4 (1 - y)(s - y), y =
    sin^2 psi with psi = pi x/lambda, and the root is taken without cancellation.

    Raises:
        InvalidCase: The scene is no sinusoid, or the load closes every gap.
    """
    wave = _Wave.in_partial_contact(scene)
    load = wave.load
    sigma = np.linspace(0, 2 * math.sqrt(load), _TABULATED)
    root = np.sqrt((1 - load) ** 2 + sigma**2)
    y = (load - sigma**2 / 4) * 2 / (1 + load + root)
    y[-1] = 0.0  # exactly 0 at the crest: the square root below would magnify rounding
    rim = math.asin(math.sqrt(load))
    cumulative = 2 / np.pi * (rim - np.arcsin(np.sqrt(np.clip(y, 0, load))))
    return PressureDistribution(wave.complete * sigma, cumulative)


def _product_load(scene: Scene, form: ClosedForm) -> float:
    """Return the load s = mean pressure / p* of a product of two waves.

    p* is the mean pressure that leaves no gap.

    Args:
        scene: With the heights h (1 + cos cos) on a square period.
        form: The closed form that an error names.

    Raises:
        InvalidCase: The scene is no elastic half-space with such heights.
    """
    E = form.elastic_half_space(scene)
    surface = scene.surface
    words = "the product of two waves on a square period"
    form.require(surface.heights.ndim == 2 and len(set(surface.periods)) == 1, words)
    modes = np.abs(np.fft.rfft2(surface.heights)) / surface.heights.size
    k = np.unravel_index(int(np.argmax(modes)), modes.shape)
    amplitude = 4 * float(modes[k])
    # The four modes (+-k, +-k) hold all of the variance.
    other_variance = abs(float(np.var(surface.heights)) - amplitude**2 / 4)
    waves_along_x = min(
        int(k[0]), modes.shape[0] - int(k[0])
    )  # of k or its mirror image
    is_one_product = other_variance < 1e-9 * amplitude**2
    form.require(is_one_product and waves_along_x == k[1], words)
    wavelength = surface.periods[0] / waves_along_x
    return scene.load.final / surface_complete_pressure(amplitude, wavelength, E)


@WAVINESS_LIGHT.gives("area.total")
def _light_fraction(scene: Scene) -> float:
    """Return the contact area of two waves' product at a light load, as a fraction.

    Raises InvalidCase if the scene is no product of two waves, or if its load is above
    1 % of that of complete contact.
    """
    load = _product_load(scene, WAVINESS_LIGHT)
    WAVINESS_LIGHT.require(load <= 1e-2, "a load of at most p*/100")
    return surface_contact_fraction_light(load)


@WAVINESS_HEAVY.gives("area.total")
def _heavy_fraction(scene: Scene) -> float:
    """Return the contact area of two waves' product near full contact, as a fraction.

    Raises InvalidCase if the scene is no product of two waves, or if its load is
    outside of 90 to 100 % of that of complete contact.
    """
    load = _product_load(scene, WAVINESS_HEAVY)
    WAVINESS_HEAVY.require(0.9 <= load < 1, "a load between 0.9 p* and p*")
    return surface_contact_fraction_heavy(load)
