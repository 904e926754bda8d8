"""The theory of one rough body: diffusion, areas and pressures.

`Theory` holds the body; load and magnification are arguments of its methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.materials.moduli import effective_modulus
from epcontact.persson.elastoplastic import (
    ContactAreas,
    areas,
    pressure_cumulative,
    pressure_density,
)
from epcontact.persson.near_bounds import (
    CONSTANTS,
    RESOLUTION,
    StressState,
    integrate,
    nayak_along,
    relative_wavenumbers,
    with_strips,
)
from epcontact.persson.reduction import (
    EnergyReduction,
    Rule,
    full_contact_diffusion,
    reduced_diffusion,
)
from epcontact.persson.roughness import Roughness, SpectrumKind, roughness_of
from epcontact.results import FloatArray
from epcontact.scene import (
    Scene,
    array,
    check_loading,
    integer,
    positive,
    require_kind,
)

#: An elastic distribution is tabulated up to the mean pressure + 12 sqrt(G), where it
#: has fallen by exp(-12^2 / 4) = 2e-16.
_TAIL = 12.0


class Curve:
    """Arrays of one shape (n,), each annotated with the name and unit of its column."""

    def columns(self) -> dict[str, FloatArray]:
        """Return the curve's columns (n,) by name and unit, for a table in CSV or JSON.

        A column is a field whose annotation contains such a name, for example
        "pressure_Pa".
        """
        hints = get_type_hints(type(self), include_extras=True)
        found = {}
        for name, hint in hints.items():
            for column in getattr(hint, "__metadata__", ()):
                found[column] = getattr(self, name)
        return found


@dataclass(frozen=True)
class MagnificationCurve(Curve):
    """Areas, as fractions of the nominal area, against the magnification q / q_0."""

    magnification: Annotated[FloatArray, "magnification"]
    wavenumber: Annotated[FloatArray, "wavenumber_rad_per_m"]
    diffusion: Annotated[FloatArray, "diffusion_Pa2"]
    elastic: Annotated[FloatArray, "elastic_area"]
    plastic: Annotated[FloatArray, "plastic_area"]
    total: Annotated[FloatArray, "total_area"]


@dataclass(frozen=True)
class PressureCurve(Curve):
    """The distribution of the contact pressure.

    Attributes:
        pressure: Pressures in Pa, ascending from 0.
        density: Fraction of the nominal area per Pa at each pressure.
        cumulative: Fraction of the nominal area in elastic contact at (0, pressure].
        plastic: Fraction of the nominal area at the hardness.
    """

    pressure: Annotated[FloatArray, "pressure_Pa"]
    density: Annotated[FloatArray, "density_per_Pa"]
    cumulative: Annotated[FloatArray, "cumulative_area"]
    plastic: float

    @classmethod
    def of_state(cls, state: StressState) -> PressureCurve:
        """Return the distribution of the pressure at the end of a diffusion.

        Args:
            state: The stress by the rule "near_bounds".
        """
        plastic = float(state.plastic[-1])
        return cls(state.pressure, state.density, state.cumulative, plastic)


def pressure_curve(
    diffusion: float,
    mean_pressure: float,
    hardness: float = math.inf,
    points: int = 1025,
) -> PressureCurve:
    """Return the distribution at equally spaced pressures, from 0 to the hardness.

    An elastic distribution is tabulated up to where it has vanished.  Without roughness
    (no diffusion) all of the area is at the mean pressure, and the density is infinite
    there.

    Args:
        diffusion: G in Pa^2.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.
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
        density = np.array([0.0, 0.0, np.inf])
        cumulative = np.array([0.0, 0.0, 1.0])
        return PressureCurve(pressure, density, cumulative, plastic)
    if math.isfinite(hardness):
        last = hardness
    else:
        last = mean_pressure + _TAIL * math.sqrt(diffusion)
    pressure = np.linspace(0.0, last, integer("points", points, 2))
    density = pressure_density(pressure, diffusion, mean_pressure, hardness)
    cumulative = pressure_cumulative(pressure, diffusion, mean_pressure, hardness)
    return PressureCurve(pressure, density, cumulative, plastic)


@dataclass(frozen=True)
class Theory:
    """Persson's theory of one rough body on a half-space.

    Attributes:
        roughness: Slope variance by wave number.
        effective_modulus: E* in Pa.
        reduction: The reduction S of elastic energy in the diffusion.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Example:
        >>> from epcontact import Load, Material, Scene, SelfAffineSpectrum
        >>> from epcontact.surfaces import SelfAffine
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, 1.0)
        >>> periods = (6.2832e-5, 6.2832e-5)
        >>> surface = SelfAffine(spectrum, periods, (64, 64), seed=7).build()
        >>> scene = Scene(surface, Material(250e9, 0.0, hardness=150e9), Load(12.5e9))
        >>> theory = Theory.of_scene(scene, energy_reduction=0.536)
        >>> theory.magnification_curve(12.5e9, [1, 4, 16]).total.round(4)
        array([1.    , 0.1979, 0.1097])
    """

    roughness: Roughness
    effective_modulus: float
    reduction: EnergyReduction
    hardness: float = math.inf

    def __post_init__(self) -> None:
        """Raise InvalidScene if a modulus or hardness is not a positive number."""
        positive("effective_modulus", self.effective_modulus, "Pa")
        positive("hardness", self.hardness, "Pa", finite=False)

    @classmethod
    def of_scene(
        cls,
        scene: Scene,
        *,
        energy_reduction: float,
        spectrum: SpectrumKind = "analytic",
        reduction: Rule = "constant",
    ) -> Theory:
        """Return the theory of a scene's body; the load is an argument of the methods.

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
                f"the body is a {scene.body.kind}, but Persson's theory is that of a "
                "half-space"
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
        """Return G in Pa^2; with the rule "near_bounds", tau, that of full contact.

        Args:
            mean_pressure: p_0 in Pa.
            magnification: Finite numbers of at least 1, of any shape; None: all of the
                roughness.

        Raises:
            InvalidScene: A magnification or the pressure is out of range.
        """
        variance: ArrayLike = self.roughness.rms_slope**2
        if magnification is not None:
            zeta = array("magnification", magnification)
            wrong = ~((zeta >= 1) & np.isfinite(zeta))
            if wrong.any():
                raise InvalidScene(
                    "magnifications must be finite numbers of at least 1, not "
                    f"{zeta[wrong].flat[0]}"
                )
            variance = self.roughness.slope_variance_up_to(zeta * self.roughness.lowest)
        tau = full_contact_diffusion(self.effective_modulus, variance)
        if self.reduction.rule == "near_bounds":
            return tau
        return reduced_diffusion(self.reduction, tau, mean_pressure, self.hardness)

    def contact_areas(self, mean_pressure: float) -> ContactAreas:
        """Return the areas with all of the roughness, as fractions.

        Args:
            mean_pressure: p_0 in Pa.

        Raises:
            InvalidScene: The pressure is out of range, or the surface is flat with the
                rule "near_bounds".
        """
        if self.reduction.rule == "near_bounds":
            return self.stress_state(mean_pressure).areas
        return areas(self.diffusion(mean_pressure), mean_pressure, self.hardness)

    def magnification_curve(
        self, mean_pressure: float, magnifications: ArrayLike | None = None
    ) -> MagnificationCurve:
        """Return the areas against the magnification.

        Args:
            mean_pressure: p_0 in Pa.
            magnifications: Numbers of at least 1, (n,); None: 1000 in a geometric
                sequence, up to the highest of the roughness.

        Raises:
            InvalidScene: A magnification or the pressure is out of range.
        """
        if magnifications is None:
            magnifications = np.geomspace(
                1.0, self.roughness.highest / self.roughness.lowest, 1000
            )
        zeta = np.atleast_1d(array("magnifications", magnifications))
        if zeta.ndim != 1:
            raise InvalidScene("magnifications must be a list of numbers, not a table")
        G = self.diffusion(mean_pressure, zeta)
        if self.reduction.rule == "near_bounds":
            # Linear interpolation between four times the usual steps errs by 1e-4.
            nodes, steps = RESOLUTION
            state = self.stress_state(mean_pressure, resolution=(nodes, 4 * steps))
            found = state.areas_at(G)
        else:
            found = areas(G, mean_pressure, self.hardness)
        return MagnificationCurve(
            magnification=zeta,
            wavenumber=zeta * self.roughness.lowest,
            diffusion=G,
            elastic=found.elastic,
            plastic=found.plastic,
            total=found.total,
        )

    def pressure_curve(
        self, mean_pressure: float, magnification: float | None = None
    ) -> PressureCurve:
        """Return the distribution of the pressure.

        Args:
            mean_pressure: p_0 in Pa.
            magnification: A number of at least 1; None: all of the roughness.

        Raises:
            InvalidScene: The magnification or the pressure is out of range.
        """
        G = float(self.diffusion(mean_pressure, magnification))
        if self.reduction.rule != "near_bounds" or G == 0:
            return pressure_curve(G, mean_pressure, self.hardness)
        return PressureCurve.of_state(self.stress_state(mean_pressure, G))

    def stress_state(
        self,
        mean_pressure: float,
        end: float = math.inf,
        resolution: tuple[int, int] = RESOLUTION,
    ) -> StressState:
        """Return the stress by the rule "near_bounds".

        Args:
            mean_pressure: p_0 in Pa.
            end: Diffusion of full contact in Pa^2 at which the integration ends;
                infinite: that of all of the roughness.
            resolution: Nodes and steps, see `persson.near_bounds.RESOLUTION`.

        Raises:
            InvalidScene: The surface is flat, or the pressure is out of range.
        """
        positive("mean_pressure", mean_pressure, "Pa")
        areas(0.0, mean_pressure, self.hardness)  # checks that it is below the hardness
        if self.roughness.rms_slope == 0:
            raise InvalidScene(
                "the surface is flat, but the rule 'near_bounds' needs slopes"
            )
        variance, breadth = relative_wavenumbers(self.roughness)
        tau = full_contact_diffusion(self.effective_modulus, variance)
        last = int(np.searchsorted(tau, end)) + 1
        _, reach, close = CONSTANTS
        state = integrate(
            np.minimum(tau, end)[:last],
            breadth[:last],
            mean_pressure,
            self.hardness,
            constants=(self.reduction.gamma, reach, close),
            resolution=resolution,
        )
        if math.isinf(self.hardness):
            return state
        at = np.log(state.diffusion)
        nayak = np.interp(at, np.log(tau), nayak_along(self.roughness))
        return with_strips(state, nayak, mean_pressure, self.hardness)
