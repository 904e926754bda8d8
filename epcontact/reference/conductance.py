"""What a rough joint conducts: the laws of textbooks, and a formula fitted to boundary
elements.

P = mean pressure, H = hardness, E* = effective modulus, sigma = rms height, xi = rms
slope, k_s = 2 k_1 k_2/(k_1 + k_2), of both bodies together; m = xi/sqrt(pi) is the mean
absolute slope of a profile of Gaussian isotropic heights.  Every law gives y = sigma
h/(k_s m) as a function of the load P/H and the hardness H/(E* xi).

Cooper, Mikic and Yovanovich, Int. J. Heat Mass Transfer 12, 279 (1969), for flow, as the Mechanical
Engineers' Handbook, vol. 4, Cooling Electronic Equipment, eq. (8a) has it: y = 1.25 (P/H)^.95.
Mikic, Int. J. Heat Mass Transfer 17, 205 (1974), elastic: y = 1.55 (sqrt(2) P/(E* m))^.94.  The
paper was not at hand; the form is that of other programs.
Persson, Phys. Rev. Lett. 99, 125502 (2007), elastic: the stiffness is P/(gamma sigma), so that
y = P/(gamma E* m).  gamma = .48 by Akarapu, Sharp and Robbins, Phys. Rev. Lett. 106, 204301 (2011),
which was not at hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.materials.moduli import effective_modulus as modulus_of
from epcontact.reference.form import ClosedForm
from epcontact.reference.roughness import rms_slope as slope_of
from epcontact.results import FloatArray
from epcontact.scene import Scene, positive

# The constants of `fitted` and its relative error at 95 %, by `python -m
# laboratory.conductance`.
FACTOR, ELASTIC, CLUSTER, ERROR = 0.853, 2.76, 40.1, 0.1
#: Where the error holds at every place of the table: P/H, H/(E* xi), the longest over
#: the shortest wave, and the contact area.
LOADS, HARDNESSES, BREADTHS, FULL = (1e-3, 0.25), (0.03, 1.0), (2.0, 12.0), 0.25
_GAMMA = 0.48
#: xi over the mean absolute slope m of a profile, for Gaussian isotropic heights.
PROFILE = math.sqrt(math.pi)

Values = FloatArray | float
Law = Callable[[Values, Values], Values]


#: y of the load and the hardness, by the names of the laws.
LAWS: dict[str, Law] = {
    "Cooper-Mikic-Yovanovich": lambda load, hardness: 1.25 * load**0.95 + 0 * hardness,
    "Mikic, elastic": lambda load, hardness: (
        1.55 * (2**0.5 * PROFILE * load * hardness) ** 0.94
    ),
    "Persson, elastic": lambda load, hardness: PROFILE * load * hardness / _GAMMA,
}


def contact_area(load: Values, hardness: Values) -> Values:
    """About the share in contact: P/H where all flows, 2 P/(E* xi) where nothing
    does.
    """
    return load * np.hypot(1, 2 * hardness)


def fitted(load: Values, hardness: Values, breadth: Values) -> Values:
    """y of elastic and of flowing joints.

    Spots conduct as a power of the load, and of a broad spectrum they lie in clusters,
    which adds a resistance in proportion to the breadth.  (1 - A)^1.5 is what is left
    between crowded spots.
    """
    spots = load * np.hypot(1 / (1 + breadth / CLUSTER), ELASTIC * hardness)
    return FACTOR * spots ** (7 / 8) / (1 - contact_area(load, hardness)) ** 1.5


@dataclass(frozen=True)
class JointConductance:
    """The conductance of a joint by the fitted formula.

    Attributes:
        value: per nominal area, in W/(m^2 K), or in S/m^2 of electrical conductivities.
        interval: in which the mean of large joints lies at 95 %, in the same unit;
            errors of the roughness, hardness and modulus that were given come on top.
        laws: what each of LAWS says, in the same unit.
        load: P/H.
        hardness: H/(E* xi); small numbers flow, large ones are elastic.
    """

    value: float
    interval: tuple[float, float]
    laws: Mapping[str, float]
    load: float
    hardness: float

    def __str__(self) -> str:
        low, high = self.interval
        textbooks = ", ".join(f"{name} {h:.3g}" for name, h in self.laws.items())
        return (
            f"conductance {self.value:.3g}, 95 % interval {low:.3g} to {high:.3g} W/(m² K)\n"
            f"at P/H = {self.load:.3g} and H/(E*ξ) = {self.hardness:.3g}, of Gaussian, isotropic "
            f"roughness; textbooks: {textbooks}"
        )


def joint_conductance(
    *,
    conductivities: Sequence[float],
    rms_height: float,
    rms_slope: float,
    hardness: float,
    effective_modulus: float,
    mean_pressure: float,
    breadth: float | None = None,
) -> JointConductance:
    """Return the conductance of a large rough joint in vacuum per nominal area.

    Of two rough bodies, heights and slopes are the root of the sum of their squares.

    Args:
        conductivities: k_1 and k_2 in W/(m K), or electrical ones in S/m.
        rms_height: sigma in m.
        rms_slope: xi of the gradient, sqrt(pi) times the mean absolute slope of a
            profile.
        hardness: H of the softer body in Pa, of indents as small as the spots.
        effective_modulus: E* of both bodies in Pa, 1/E* = (1 - nu_1^2)/E_1 + (1 -
            nu_2^2)/E_2.
        mean_pressure: P in Pa, the force over the nominal area.
        breadth: wavelength of the roll-off over the shortest in the slope; None: any of
            BREADTHS, for which the interval is wider.

    Raises:
        InvalidScene: if a value is no positive number, or is where the formula was not
            judged.

    Example:
        >>> found = joint_conductance(conductivities=(16, 200), rms_height=1e-6, rms_slope=0.15,
        ...     hardness=3e9, effective_modulus=60e9, mean_pressure=10e6, breadth=8)
        >>> round(found.value, -2), [round(end, -2) for end in found.interval]
        (17700.0, [16100.0, 19500.0])
    """
    if isinstance(conductivities, Mapping | str) or np.shape(conductivities) != (2,):
        raise InvalidScene(
            f"conductivities is {conductivities!r}, but must be those of two bodies"
        )
    k1, k2 = (positive("conductivities", k, "W/(m K)") for k in conductivities)
    sigma, xi = (
        positive("rms_height", rms_height, "m"),
        positive("rms_slope", rms_slope, "m/m"),
    )
    H, P = (
        positive("hardness", hardness, "Pa"),
        positive("mean_pressure", mean_pressure, "Pa"),
    )
    load, ratio = (
        P / H,
        H / (positive("effective_modulus", effective_modulus, "Pa") * xi),
    )
    ends = BREADTHS if breadth is None else (positive("breadth", breadth, "–"),) * 2
    _judged(load, ratio, *ends)
    unit = harmonic_mean(k1, k2) * xi / (PROFILE * sigma)
    most, least = (unit * float(fitted(load, ratio, end)) for end in ends)
    interval = (least / (1 + ERROR), most * (1 + ERROR))
    laws = {name: unit * float(law(load, ratio)) for name, law in LAWS.items()}
    return JointConductance(math.sqrt(least * most), interval, laws, load, ratio)


def harmonic_mean(one: float, other: float) -> float:
    """k_s of two half-spaces in series, each of which has a half of the resistance of a
    spot.
    """
    return 2 * one * other / (one + other)


def _judged(load: float, hardness: float, *breadths: float) -> None:
    """Raise InvalidScene where the formula was not judged."""
    places = [("P/H", load, LOADS), ("H/(E* xi)", hardness, HARDNESSES)]
    places += [("the breadth", breadth, BREADTHS) for breadth in breadths]
    places += [("the contact area", float(contact_area(load, hardness)), (0.0, FULL))]
    for name, value, (low, high) in places:
        if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
            raise InvalidScene(
                f"{name} is {value:.3g}, but the formula of the conductance was judged from "
                f"{low:g} to {high:g}; solve a case with a gate on quantity.conductance"
            )


# --- for gates
# -----------------------------------------------------------------------------------

COOPER_MIKIC_YOVANOVICH = ClosedForm(
    "cooper_mikic_yovanovich",
    "Cooper, Mikic and Yovanovich, Int. J. Heat Mass Transfer 12 (1969) 279: a law, not exact",
    exact=False,
)
_MIKIC = "Mikic, Int. J. Heat Mass Transfer 17 (1974) 205: a law, not exact"
MIKIC = ClosedForm("mikic", _MIKIC, exact=False)


def _by_law(form: ClosedForm, name: str) -> None:
    @form.gives("quantity.conductance")
    def _answer(scene: Scene) -> float:
        """Conductance per nominal area times the sum of the resistivities, 2 h/k_s, in
        1/m.
        """
        H, surface, xi = scene.material.hardness, scene.surface, slope_of(scene)
        rough = scene.body.kind == "half_space" and surface.heights.ndim == 2 and xi > 0
        form.needs(rough and math.isfinite(H), "a rough half-space with a hardness")
        y = LAWS[name](scene.load.final / H, H / (modulus_of(scene.material) * xi))
        return 2 * float(y) * xi / (PROFILE * surface.rms_height)


_by_law(COOPER_MIKIC_YOVANOVICH, "Cooper-Mikic-Yovanovich")
_by_law(MIKIC, "Mikic, elastic")
