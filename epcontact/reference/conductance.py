"""The conductance of a rough joint: laws of textbooks and a fitted formula.

P = mean pressure, H = hardness, E* = effective modulus, sigma = rms height, xi = rms
slope, k_s = 2 k_1 k_2/(k_1 + k_2), of both bodies together; m = xi/sqrt(pi) is the mean
absolute slope of a profile of Gaussian isotropic heights.  Every law gives y = sigma
h/(k_s m) as a function of the load P/H and the hardness H/(E* xi).

- Plastic contact: y = 1.25 (P/H)^.95.  Cooper, Mikic and Yovanovich, Int. J. Heat Mass
  Transfer 12, 279 (1969), as quoted in the Mechanical Engineers' Handbook, vol. 4,
  Cooling Electronic Equipment, eq. (8a).
- Elastic contact: y = 1.55 (sqrt(2) P/(E* m))^.94.  Mikic, Int. J. Heat Mass Transfer
  17, 205 (1974), in the form that other programs use; the paper was not at hand.
- Elastic contact: y = P/(gamma E* m), because the stiffness is P/(gamma sigma).
  Persson, Phys. Rev. Lett. 99, 125502 (2007), with gamma = .48 by Akarapu, Sharp and
  Robbins, Phys. Rev. Lett. 106, 204301 (2011), which was not at hand.
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

#: The constants of `fitted` and its relative error at 95 %, fitted by `python -m
#: laboratory.conductance`.
FACTOR = 0.853
ELASTIC = 2.76
CLUSTER = 40.1
ERROR = 0.1
#: The ranges in which the error holds at every place of the table: P/H, H/(E* xi), and
#: the longest wavelength over the shortest.
LOADS = (1e-3, 0.25)
HARDNESSES = (0.03, 1.0)
BREADTHS = (2.0, 12.0)
#: The error holds up to this contact area, as a fraction of the nominal area.
FULL = 0.25
#: gamma of Persson's law.
_GAMMA = 0.48
#: xi over the mean absolute slope m of a profile, for Gaussian isotropic heights.
PROFILE = math.sqrt(math.pi)

Values = FloatArray | float
Law = Callable[[Values, Values], Values]


def _cooper_mikic_yovanovich(load: Values, hardness: Values) -> Values:
    """Return the dimensionless conductance of plastic contact, y = 1.25 (P/H)^.95.

    y = sigma h/(k_s m): rms height times conductance over conductivity and mean slope.

    Args:
        load: P/H, mean pressure over hardness, a number or an array.
        hardness: H/(E* xi); it has no influence.
    """
    return 1.25 * load**0.95 + 0 * hardness


def _mikic(load: Values, hardness: Values) -> Values:
    """Return the dimensionless conductance of elastic contact by Mikic.

    It is y = 1.55 (sqrt(2) P/(E* m))^.94 with y = sigma h/(k_s m): rms height times
    conductance over conductivity and mean slope m.

    Args:
        load: P/H, mean pressure over hardness, a number or an array.
        hardness: H/(E* xi), with the effective modulus E* and the rms slope xi.
    """
    return 1.55 * (2**0.5 * PROFILE * load * hardness) ** 0.94


def _persson(load: Values, hardness: Values) -> Values:
    """Return the dimensionless conductance of elastic contact by Persson.

    It is y = P/(gamma E* m) with y = sigma h/(k_s m): rms height times conductance over
    conductivity and mean slope m.

    Args:
        load: P/H, mean pressure over hardness, a number or an array.
        hardness: H/(E* xi), with the effective modulus E* and the rms slope xi.
    """
    return PROFILE * load * hardness / _GAMMA


#: y as a function of load and hardness, by the names of the laws.
LAWS: dict[str, Law] = {
    "Cooper-Mikic-Yovanovich": _cooper_mikic_yovanovich,
    "Mikic, elastic": _mikic,
    "Persson, elastic": _persson,
}


def contact_area(load: Values, hardness: Values) -> Values:
    """Return an approximate contact area as a fraction of the nominal area.

    It is P/H where all of the contact flows, and 2 P/(E* xi) where nothing flows.

    Args:
        load: P/H, mean pressure over hardness, a number or an array.
        hardness: H/(E* xi), with the effective modulus E* and the rms slope xi.
    """
    return load * np.hypot(1, 2 * hardness)


def fitted(load: Values, hardness: Values, breadth: Values) -> Values:
    """Return the dimensionless conductance y of elastic and of flowing joints.

    y = sigma h/(k_s m): rms height times conductance over conductivity and mean slope.
    Spots of contact conduct as a power of the load.  The spots of a broad spectrum lie
    in clusters, which adds a resistance in proportion to the breadth.  The factor (1 -
    A)^1.5, with the contact area A, accounts for the neighbourhood of crowded spots.

    Args:
        load: P/H, mean pressure over hardness, a number or an array.
        hardness: H/(E* xi), with the effective modulus E* and the rms slope xi.
        breadth: Wavelength of the roll-off over the shortest in the slope.
    """
    spots = load * np.hypot(1 / (1 + breadth / CLUSTER), ELASTIC * hardness)
    return FACTOR * spots ** (7 / 8) / (1 - contact_area(load, hardness)) ** 1.5


@dataclass(frozen=True)
class JointConductance:
    """The conductance of a joint by the fitted formula.

    Attributes:
        value: Conductance per nominal area in W/(m^2 K), or in S/m^2 for electrical
            conductivities.
        interval: 95 % interval of the mean of large joints, in the same unit.  Errors
            of the given roughness, hardness and modulus are not part of it.
        laws: Conductance by each of LAWS, in the same unit.
        load: P/H.
        hardness: H/(E* xi); joints with small numbers flow, with large ones are
            elastic.
    """

    value: float
    interval: tuple[float, float]
    laws: Mapping[str, float]
    load: float
    hardness: float

    def __str__(self) -> str:
        """Return two lines of text on the conductance of this joint.

        They hold the value with its interval, then the loads and the textbooks' laws.
        """
        low, high = self.interval
        textbooks = ", ".join(f"{name} {h:.3g}" for name, h in self.laws.items())
        return (
            f"conductance {self.value:.3g}, 95 % interval {low:.3g} to {high:.3g} "
            "W/(m² K)\n"
            f"at P/H = {self.load:.3g} and H/(E*ξ) = {self.hardness:.3g}, of Gaussian, "
            f"isotropic roughness; textbooks: {textbooks}"
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

    The heights and slopes of two rough bodies add as the root of the sum of squares.

    Args:
        conductivities: k_1 and k_2 in W/(m K), or electrical ones in S/m.
        rms_height: sigma in m.
        rms_slope: xi, the rms of the gradient, which is sqrt(pi) times the mean
            absolute slope of a profile.
        hardness: H of the softer body in Pa, of indents as small as the spots.
        effective_modulus: E* of both bodies in Pa, 1/E* = (1 - nu_1^2)/E_1 + (1 -
            nu_2^2)/E_2.
        mean_pressure: P in Pa, the force over the nominal area.
        breadth: Wavelength of the roll-off over the shortest in the slope; None: any of
            BREADTHS, for which the interval is wider.

    Raises:
        InvalidScene: A value is not a positive number, or lies where the formula was
            not judged.

    Example:
        >>> joint = joint_conductance(
        ...     conductivities=(16, 200), rms_height=1e-6, rms_slope=0.15,
        ...     hardness=3e9, effective_modulus=60e9, mean_pressure=10e6, breadth=8,
        ... )
        >>> round(joint.value, -2), [round(end, -2) for end in joint.interval]
        (17700.0, [16100.0, 19500.0])
    """
    if isinstance(conductivities, Mapping | str) or np.shape(conductivities) != (2,):
        raise InvalidScene(
            f"conductivities is {conductivities!r}, but must be those of two bodies"
        )
    k1, k2 = (positive("conductivities", k, "W/(m K)") for k in conductivities)
    sigma = positive("rms_height", rms_height, "m")
    xi = positive("rms_slope", rms_slope, "m/m")
    H = positive("hardness", hardness, "Pa")
    P = positive("mean_pressure", mean_pressure, "Pa")
    E = positive("effective_modulus", effective_modulus, "Pa")
    if breadth is None:
        narrowest, broadest = BREADTHS
    else:
        narrowest = broadest = positive("breadth", breadth, "–")
    load = P / H
    ratio = H / (E * xi)
    _refuse_outside(load, ratio, narrowest, broadest)
    unit = harmonic_mean(k1, k2) * xi / (PROFILE * sigma)
    highest = unit * float(fitted(load, ratio, narrowest))
    lowest = unit * float(fitted(load, ratio, broadest))
    return JointConductance(
        value=math.sqrt(lowest * highest),
        interval=(lowest / (1 + ERROR), highest * (1 + ERROR)),
        laws={name: unit * float(law(load, ratio)) for name, law in LAWS.items()},
        load=load,
        hardness=ratio,
    )


def harmonic_mean(k1: float, k2: float) -> float:
    """Return k_s = 2 k_1 k_2/(k_1 + k_2) of two half-spaces in series.

    Each half-space has half of the resistance of a spot.  The unit is that of the
    conductivities k1 and k2, W/(m K) or S/m.
    """
    return 2 * k1 * k2 / (k1 + k2)


def _refuse_outside(load: float, hardness: float, *breadths: float) -> None:
    """Raise InvalidScene outside of the ranges in which the fitted formula was judged.

    Args:
        load: P/H, mean pressure over hardness.
        hardness: H/(E* xi), with the effective modulus E* and the rms slope xi.
        breadths: Wavelengths of the roll-off over the shortest in the slope.
    """
    area = float(contact_area(load, hardness))
    places = [("P/H", load, LOADS), ("H/(E* xi)", hardness, HARDNESSES)]
    places += [("the breadth", breadth, BREADTHS) for breadth in breadths]
    places += [("the contact area", area, (0.0, FULL))]
    for name, value, (low, high) in places:
        if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
            raise InvalidScene(
                f"{name} is {value:.3g}, but the formula of the conductance was "
                f"tested only from {low:g} to {high:g}; solve a case with a gate on "
                "`quantity.conductance`"
            )


# --- for gates

COOPER_MIKIC_YOVANOVICH = ClosedForm(
    "cooper_mikic_yovanovich",
    "Cooper, Mikic and Yovanovich, Int. J. Heat Mass Transfer 12 (1969) 279: a law, "
    "not exact",
    exact=False,
)
MIKIC = ClosedForm(
    "mikic",
    "Mikic, Int. J. Heat Mass Transfer 17 (1974) 205: a law, not exact",
    exact=False,
)


@COOPER_MIKIC_YOVANOVICH.gives("quantity.conductance")
def _plastic_conductance(scene: Scene) -> float:
    """Return the conductance by Cooper, Mikic and Yovanovich's law, in 1/m.

    It is the conductance per nominal area times the sum of the bodies' resistivities.
    Raises InvalidCase unless the scene is a rough half-space with a finite hardness.
    """
    return _conductance(scene, COOPER_MIKIC_YOVANOVICH, _cooper_mikic_yovanovich)


@MIKIC.gives("quantity.conductance")
def _elastic_conductance(scene: Scene) -> float:
    """Return the conductance by Mikic's law of elastic contact, in 1/m.

    It is the conductance per nominal area times the sum of the bodies' resistivities.
    Raises InvalidCase unless the scene is a rough half-space with a finite hardness.
    """
    return _conductance(scene, MIKIC, _mikic)


def _conductance(scene: Scene, form: ClosedForm, law: Law) -> float:
    """Return the conductance 2 h/k_s of a scene by a law, in 1/m.

    It is the conductance per nominal area times the sum of the bodies' resistivities.

    Args:
        scene: The scene; its last load is used.
        form: The closed form that an error names.
        law: Function from P/H and H/(E* xi) to the dimensionless conductance.

    Raises:
        InvalidCase: The scene is no rough half-space with a finite hardness.
    """
    surface = scene.surface
    H = scene.material.hardness
    xi = slope_of(scene)
    is_half_space = scene.body.kind == "half_space"
    is_rough = surface.heights.ndim == 2 and xi > 0
    form.require(
        is_half_space and is_rough and math.isfinite(H),
        "a rough half-space with a hardness",
    )
    y = law(scene.load.final / H, H / (modulus_of(scene.material) * xi))
    return 2 * float(y) * xi / (PROFILE * surface.rms_height)
