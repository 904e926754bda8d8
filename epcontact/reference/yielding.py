"""First yield below the surface of an elastic half-space.

Below a surface with a known pressure, the stresses are elastic until von Mises' stress
reaches the yield stress sigma_Y somewhere.  A pressure wave p cos(q x) gives, with
t = q z at the depth z, the stresses (tension positive)

    s_xx = -p (1 - t) e^-t cos(q x)    s_yy = -2 nu p e^-t cos(q x)
    s_zz = -p (1 + t) e^-t cos(q x)    s_zx =  p t e^-t sin(q x)

(Johnson, Contact Mechanics (1985), section 13.2).  Waves of all directions are added.
The mean pressure compresses a periodic body in uniaxial strain.

Under Hertz's pressure of a sphere with nu = 0.3 the largest stress is on the axis, .481
contact radii deep, and it yields at a largest pressure of 1.613 sigma_Y (Johnson,
section 6.1).  There the axes of the grid have no shear stress.  Below waves whose
crests do not coincide they have, up to pure shear: the shear stresses of a scene decide
which terms of a yield condition it can test.
"""

from __future__ import annotations

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.reference.bumps import HERTZ
from epcontact.reference.form import ClosedForm
from epcontact.reference.layers import FULL_CONTACT
from epcontact.results import FloatArray
from epcontact.scene import Scene

FIRST_YIELD = ClosedForm(
    "first_yield",
    "Johnson, Contact Mechanics (1985), sections 6.1 and 13.2: von Mises' stress below "
    "the elastic pressure",
)
#: Depths at which the stress is evaluated, over the shorter period: closer than 0.3 %
#: of the period, and as deep as the longest wave yields first, 1/q = 0.16 periods.
_DEPTHS = np.linspace(0, 0.25, 101)


def mises_stress(
    pressure: FloatArray, periods: tuple[float, ...], poisson_ratio: float, depth: float
) -> FloatArray:
    """Return von Mises' stress in Pa at one depth below a periodic pressure.

    Args:
        pressure: (nx, ny) in Pa at the grid points; ny = 1 is a line.
        periods: along x and y in m, of a line along x.
        poisson_ratio: nu of the elastic half-space.
        depth: z below the surface in m.

    Returns:
        (nx, ny) stresses below the grid points.
    """
    nx, ny = pressure.shape
    kx = 2 * np.pi * np.fft.fftfreq(nx, periods[0] / nx)[:, None]
    ky = 2 * np.pi * np.fft.fftfreq(ny, periods[-1] / ny)
    q = np.hypot(kx, ky)
    x, y = np.stack([kx + 0 * q, ky + 0 * q]) / np.where(q > 0, q, np.inf)
    t = q * depth
    lateral = 2 * poisson_ratio
    waves = [
        (1 - t) * x**2 + lateral * y**2,
        (1 - t) * y**2 + lateral * x**2,
        1 + t,
        (1 - t - lateral) * x * y,
        1j * t * y,
        1j * t * x,
    ]
    modes = np.stack(waves) * np.exp(-t) * np.fft.fft2(pressure)
    stress = -np.fft.ifft2(modes).real
    stress[:2] -= poisson_ratio / (1 - poisson_ratio) * pressure.mean()
    differences = stress[:3] - np.roll(stress[:3], 1, axis=0)
    squared = (differences**2).sum(axis=0) / 2 + 3 * (stress[3:] ** 2).sum(axis=0)
    return np.asarray(np.sqrt(squared))


@FIRST_YIELD.gives("quantity.plastic_depth")
def _yield_depth(scene: Scene) -> float:
    """Return the largest depth in m at which the elastic stress exceeds the yield
    stress; 0 if it does nowhere.

    Shortly beyond first yield the plastic zone is that of the elastic stresses, because
    flow has not yet redistributed them.

    Args:
        scene: The surface, material, body and load; the last load is used.

    Raises:
        InvalidCase: Neither full contact nor Hertz gives the elastic pressure.
    """
    FIRST_YIELD.require(scene.body.kind == "half_space", "a half-space")
    try:
        pressure = FULL_CONTACT.field("pressure", scene)
    except InvalidCase:
        pressure = HERTZ.field("pressure", scene)
    pressure = pressure.reshape(len(pressure), -1)
    periods = scene.surface.periods
    material = scene.material
    deepest = 0.0
    for depth in min(periods) * _DEPTHS:
        stress = mises_stress(pressure, periods, material.poisson_ratio, depth)
        if stress.max() > material.yield_stress:
            deepest = float(depth)
    return deepest
