"""The theory's curves: areas against magnification, and pressure distribution at one of them.

Both are frozen columns of numbers, `columns()` of which a CSV or JSON writer can take as they
stand, units in the names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas, pressure_cumulative, pressure_density
from epcontact.persson.reduction import EnergyReduction, reduced_diffusion
from epcontact.persson.roughness import Roughness
from epcontact.results import FloatArray

#: Of an elastic distribution, sqrt(G) beyond the mean pressure: exp(-12^2 / 4) = 2e-16 is left.
_TAIL = 12.0


@dataclass(frozen=True)
class MagnificationCurve:
    """Areas (shares of the nominal area) against magnification; arrays of one shape (n,).

    magnification: zeta = q / q_0; wavenumber: q in rad/m; diffusion: G in Pa^2.
    """

    magnification: FloatArray
    wavenumber: FloatArray
    diffusion: FloatArray
    elastic: FloatArray
    plastic: FloatArray
    total: FloatArray

    def columns(self) -> dict[str, FloatArray]:
        """The columns by name and unit."""
        return {
            "magnification": self.magnification,
            "wavenumber_rad_per_m": self.wavenumber,
            "diffusion_Pa2": self.diffusion,
            "elastic_area": self.elastic,
            "plastic_area": self.plastic,
            "total_area": self.total,
        }


@dataclass(frozen=True)
class PressureCurve:
    """The distribution of the contact pressure; arrays of one shape (n,).

    pressure: Pa; density: P(sigma) in 1/Pa; cumulative: share of the nominal area in elastic
    contact at pressures in (0, pressure].  plastic: share of the nominal area at the hardness.
    """

    pressure: FloatArray
    density: FloatArray
    cumulative: FloatArray
    plastic: float

    def columns(self) -> dict[str, FloatArray]:
        """The columns by name and unit."""
        return {
            "pressure_Pa": self.pressure,
            "density_per_Pa": self.density,
            "cumulative_area": self.cumulative,
        }


def magnification_curve(
    roughness: Roughness,
    effective_modulus: float,
    reduction: EnergyReduction,
    mean_pressure: float,
    hardness: float = math.inf,
    magnifications: ArrayLike | None = None,
) -> MagnificationCurve:
    """Equations (2), (4) and (5) at magnifications (n,), by default 1000 of equal ratio.

    The default goes from 1 to the highest wave number of the roughness.  Pressures and modulus
    in Pa.  Raises InvalidScene for a magnification below 1 or pressures out of range.
    """
    if magnifications is None:
        zeta = np.geomspace(1.0, roughness.highest / roughness.lowest, 1000)
    else:
        zeta = np.atleast_1d(np.asarray(magnifications, dtype=np.float64))
        if zeta.ndim != 1 or not (zeta >= 1).all() or not np.isfinite(zeta).all():
            raise InvalidScene("magnifications must be a list of finite numbers of at least 1")
    q = zeta * roughness.lowest
    tau = effective_modulus**2 / 8 * roughness.slope_variance_up_to(q)
    G = reduced_diffusion(reduction, tau, mean_pressure, hardness)
    found = areas(G, mean_pressure, hardness)
    return MagnificationCurve(zeta, q, G, found.elastic, found.plastic, found.total)


def pressure_curve(
    diffusion: float, mean_pressure: float, hardness: float = math.inf, points: int = 1025
) -> PressureCurve:
    """Equation (3), or (1) where the hardness is infinite, at equally spaced pressures.

    They reach from 0 to the hardness, or to where the elastic distribution has ended.  Without
    roughness (diffusion = 0) all of the area is at the mean pressure, and the density infinite.
    Raises InvalidScene for pressures or a diffusion out of range.
    """
    if diffusion == 0:
        areas(diffusion, mean_pressure, hardness)
        pressure = np.array([0.0, mean_pressure, mean_pressure])
        return PressureCurve(pressure, np.array([0.0, 0.0, np.inf]), np.array([0.0, 0.0, 1.0]), 0.0)
    last = hardness
    if math.isinf(hardness):
        last = mean_pressure + _TAIL * math.sqrt(diffusion)
    pressure = np.linspace(0.0, last, points)
    return PressureCurve(
        pressure=pressure,
        density=pressure_density(pressure, diffusion, mean_pressure, hardness),
        cumulative=pressure_cumulative(pressure, diffusion, mean_pressure, hardness),
        plastic=float(areas(diffusion, mean_pressure, hardness).plastic),
    )
