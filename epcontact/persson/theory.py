"""The theory of one rough body: diffusion, areas and pressures at any load and
magnification.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.materials.moduli import effective_modulus
from epcontact.persson.elastoplastic import areas, pressure_cumulative, pressure_density
from epcontact.persson.local import CONSTANTS, RESOLUTION, LocalState, breadths, march
from epcontact.persson.reduction import (
    EnergyReduction,
    Rule,
    full_contact_diffusion,
    reduced_diffusion,
)
from epcontact.persson.roughness import Roughness, SpectrumKind, roughness_of
from epcontact.results import FloatArray
from epcontact.scene import Scene, array, check_loading, require_kind, whole

#: An elastic distribution is tabulated to the mean pressure + 12 sqrt(G): exp(-12^2 /
#: 4) = 2e-16.
_TAIL = 12.0


class Curve:
    """Arrays of one shape (n,), each annotated by the name of its column with the
    unit.
    """

    def columns(self) -> dict[str, FloatArray]:
        """The columns by name and unit, for a table in CSV or JSON."""
        hints = get_type_hints(type(self), include_extras=True)
        names = {
            name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()
        }
        return {
            column: getattr(self, name)
            for name, columns in names.items()
            for column in columns
        }


@dataclass(frozen=True)
class MagnificationCurve(Curve):
    """Areas (shares of the nominal area) against the magnification zeta = q / q_0."""

    magnification: Annotated[FloatArray, "magnification"]
    wavenumber: Annotated[FloatArray, "wavenumber_rad_per_m"]
    diffusion: Annotated[FloatArray, "diffusion_Pa2"]
    elastic: Annotated[FloatArray, "elastic_area"]
    plastic: Annotated[FloatArray, "plastic_area"]
    total: Annotated[FloatArray, "total_area"]


@dataclass(frozen=True)
class PressureCurve(Curve):
    """The share of the nominal area in elastic contact at (0, pressure], and at the
    hardness.
    """

    pressure: Annotated[FloatArray, "pressure_Pa"]
    density: Annotated[FloatArray, "density_per_Pa"]
    cumulative: Annotated[FloatArray, "cumulative_area"]
    plastic: float


def pressure_curve(
    diffusion: float,
    mean_pressure: float,
    hardness: float = math.inf,
    points: int = 1025,
) -> PressureCurve:
    """The distribution at equally spaced pressures, from 0 to the hardness.

    An elastic distribution is tabulated up to where it has vanished.  Without roughness
    (no diffusion) all of the area is at the mean pressure, and the density is infinite
    there.

    Args:
        diffusion: G in Pa^2.
        mean_pressure, hardness: In Pa; an elastic body's hardness is infinite.
        points: Number of pressures that are tabulated.

    Raises:
        InvalidScene: A pressure or the diffusion is out of range.

    Example:
        >>> curve = pressure_curve(4187.5, 12.5, 150.0)  # GPa
        >>> print(f"{curve.cumulative[-1]:.4f} {curve.plastic:.4f}")
        0.0525 0.0572
    """
    plastic = float(areas(diffusion, mean_pressure, hardness).plastic)
    if diffusion == 0:
        pressure = np.array([0.0, mean_pressure, mean_pressure])
        density, cumulative = np.array([0.0, 0.0, np.inf]), np.array([0.0, 0.0, 1.0])
        return PressureCurve(pressure, density, cumulative, plastic)
    faded = mean_pressure + _TAIL * math.sqrt(diffusion)
    last = hardness if math.isfinite(hardness) else faded
    pressure = np.linspace(0.0, last, whole("points", points, 2))
    walk = (pressure, diffusion, mean_pressure, hardness)
    return PressureCurve(
        pressure, pressure_density(*walk), pressure_cumulative(*walk), plastic
    )


@dataclass(frozen=True)
class Theory:
    """Persson's theory of one rough body on a half-space.

    Attributes:
        roughness: Slope variance by wave number. effective_modulus, hardness: E* and
        sigma_P in Pa; an elastic body's hardness is infinite.
        reduction: The reduction S of elastic energy in the diffusion.

    Example:
        >>> from epcontact import Load, Material, Scene, SelfAffineSpectrum
        >>> from epcontact.surfaces import SelfAffine
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, 1.0)
        >>> surface = SelfAffine(spectrum, (6.2832e-5, 6.2832e-5), (64, 64), seed=7).build()
        >>> scene = Scene(surface, Material(250e9, 0.0, hardness=150e9), Load(12.5e9))
        >>> theory = Theory.of_scene(scene, energy_reduction=0.536)
        >>> theory.magnification_curve(12.5e9, [1, 4, 16]).total.round(4)
        array([1.    , 0.1979, 0.1097])
    """

    roughness: Roughness
    effective_modulus: float
    reduction: EnergyReduction
    hardness: float = math.inf

    @classmethod
    def of_scene(
        cls,
        scene: Scene,
        *,
        energy_reduction: float,
        spectrum: SpectrumKind = "analytic",
        reduction: Rule = "constant",
    ) -> Theory:
        """The theory of a scene's body; the load is an argument of the methods.

        Args:
            scene: An isotropic surface on a half-space under non-decreasing loads.
            energy_reduction: gamma, between 0 (excluded) and 1.
            spectrum: "analytic" for the spectrum that the surface was drawn from,
                "surface" for the surface's own.
            reduction: The rule by which gamma enters, see `persson.reduction`.

        Raises:
            InvalidScene: The scene is a line, a layer or an unloading path, or has no
                analytic spectrum; or gamma is out of range.
        """
        require_kind("scene", scene, Scene)
        if scene.body.kind != "half_space":
            raise InvalidScene(
                f"the body is a {scene.body.kind}, but the theory here is that of the half-space"
            )
        check_loading(scene.material, scene.load)
        return cls(
            roughness_of(scene.surface, spectrum),
            effective_modulus(scene.material),
            EnergyReduction(energy_reduction, reduction),
            scene.material.hardness,
        )

    def diffusion(
        self, mean_pressure: float, magnification: ArrayLike | None = None
    ) -> FloatArray:
        """G in Pa^2 at magnifications of any shape (at least 1); by default of all
        roughness.  With the rule "local", which has no G, it is the diffusion of full
        contact.
        """
        variance: ArrayLike = self.roughness.rms_slope**2
        if magnification is not None:
            zeta = array("magnification", magnification)
            bad = ~((zeta >= 1) & np.isfinite(zeta))
            if bad.any():
                raise InvalidScene(
                    f"magnifications must be finite numbers of at least 1, not {zeta[bad].flat[0]}"
                )
            variance = self.roughness.slope_variance_up_to(zeta * self.roughness.lowest)
        tau = full_contact_diffusion(self.effective_modulus, variance)
        if self.reduction.rule == "local":
            areas(0.0, mean_pressure, self.hardness)  # checks the pressure
            return tau
        return reduced_diffusion(self.reduction, tau, mean_pressure, self.hardness)

    def magnification_curve(
        self, mean_pressure: float, magnifications: ArrayLike | None = None
    ) -> MagnificationCurve:
        """Areas against magnifications (n,) of at least 1, at a mean pressure in Pa.

        By default they are 1000 in a geometric sequence, up to the highest of the
        roughness.
        """
        if magnifications is None:
            magnifications = np.geomspace(
                1.0, self.roughness.highest / self.roughness.lowest, 1000
            )
        zeta = np.atleast_1d(array("magnifications", magnifications))
        if zeta.ndim != 1:
            raise InvalidScene("magnifications must be a list of numbers, not a table")
        G, q = self.diffusion(mean_pressure, zeta), zeta * self.roughness.lowest
        if self.reduction.rule == "local":
            # Linear interpolation between so many steps is right to 1e-4.
            state = self.local_state(
                mean_pressure, resolution=(RESOLUTION[0], 4 * RESOLUTION[1])
            )
            found = state.at(G)
        else:
            found = areas(G, mean_pressure, self.hardness)
        return MagnificationCurve(zeta, q, G, found.elastic, found.plastic, found.total)

    def pressure_curve(
        self, mean_pressure: float, magnification: float | None = None
    ) -> PressureCurve:
        """The distribution of the pressure at a magnification, by default of all
        roughness.
        """
        G = float(self.diffusion(mean_pressure, magnification))
        if self.reduction.rule != "local" or G == 0:
            return pressure_curve(G, mean_pressure, self.hardness)
        state = self.local_state(mean_pressure, G)
        plastic = float(state.plastic[-1])
        return PressureCurve(state.pressure, state.density, state.cumulative, plastic)

    def local_state(
        self,
        mean_pressure: float,
        end: float = math.inf,
        resolution: tuple[int, int] = RESOLUTION,
    ) -> LocalState:
        """The stress by the rule "local" up to a diffusion of full contact (default:
        the last).
        """
        if self.roughness.rms_slope == 0:
            raise InvalidScene("the surface is flat, but the rule 'local' needs slopes")
        variance, breadth = breadths(self.roughness)
        tau = full_contact_diffusion(self.effective_modulus, variance)
        last = int(np.searchsorted(tau, end)) + 1
        path = np.minimum(tau, end)[:last], breadth[:last]
        constants = (self.reduction.gamma, *CONSTANTS[1:])
        return march(*path, mean_pressure, self.hardness, constants, resolution)
