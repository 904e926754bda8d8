"""epcontact: J2 finite elements beside boundary elements on one rough contact.

`fem_check` presses a half-block of elastic, perfectly plastic (J2) elements with a
rough top on a rigid flat, and `epcontact.bem` solves the same scene with a largest
pressure, the hardness.  Their areas and pressures are compared, and Persson's theory
(`epcontact.persson`), closed forms and codes of others stand beside them.

Conventions of every module
---------------------------
axes          arrays are [x, y], row index first; lines are [x]; z points up, out of
              the body
body          the rough elastoplastic body is below, with heights h measured upward;
              the rigid flat comes from above
pressure      compression positive; 0 <= p <= hardness where the pressure is capped
displacement  u of the surface, downward positive, of zero mean on the half-space
gap           g = z - (h - u), with z the height of the rigid flat: g >= 0 where
              p = 0, g = 0 in elastic contact, g <= 0 where the pressure is capped;
              -g is the plastic displacement
compliance    u_q = C(q) p_q of each mode; C(0) of a half-space is undefined, set to
              0 and never reported; of a layer of depth d it is d / M, with
              M = E (1 - nu) / ((1 + nu)(1 - 2 nu))
Fourier       numpy.fft's sign, forward unscaled
surfaces      C(q) is the two-dimensional power spectral density in m^4, with
              h_rms^2 = 2 pi int q C dq and xi^2 = 2 pi int q^3 C dq (xi: rms slope)
lines         C1(q) is the one-dimensional density in m^3 over positive q, with
              h_rms^2 = int C1 dq and xi^2 = int q^2 C1 dq
wave numbers  rad/m; q_0 = 2 pi / L of a period L
moduli        E* = E / (1 - nu^2), the counterface being rigid
strength      hardness (sigma_P, caps the contact pressure) and yield_stress
              (sigma_Y, J2) are two inputs; a case gives both and says where their
              ratio comes from
tolerances    dimensionless: a gap is divided by h_rms (by p0 dx / E* for a flat
              surface), a pressure by the mean pressure, a force by the nominal force
areas         fractions of the nominal area, raw (fraction of grid points) and
              corrected (in the limit of a vanishing grid spacing)
units         SI
similarity    for one shape of the spectrum, small-slope contact with a pressure cap
              depends only on p0/(E*ξ) and hardness/(E*ξ)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from epcontact.errors import (
        EpcontactError,
        InvalidCase,
        InvalidScene,
        NotConverged,
        NotEnoughMemory,
        OutputError,
        SurfaceWarning,
    )
    from epcontact.harness.verdict import Verdict, verify
    from epcontact.materials.hardness_map import MappedHardness, effective_hardness
    from epcontact.pictures.charts import plot
    from epcontact.reference.conductance import joint_conductance
    from epcontact.results import (
        Areas,
        ContactResult,
        LoadStep,
        PressureDistribution,
        Provenance,
    )
    from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface

__all__ = [
    "Areas",
    "Body",
    "ContactResult",
    "EpcontactError",
    "InvalidCase",
    "InvalidScene",
    "Load",
    "LoadStep",
    "MappedHardness",
    "Material",
    "NotConverged",
    "NotEnoughMemory",
    "OutputError",
    "PressureDistribution",
    "Provenance",
    "Scene",
    "SelfAffineSpectrum",
    "Surface",
    "SurfaceWarning",
    "Verdict",
    "effective_hardness",
    "joint_conductance",
    "plot",
    "verify",
]

#: The modules that define these names.  Two more modules import the solvers, and are
#: therefore searched last.
_HOMES = (
    "scene",
    "results",
    "errors",
    "materials.hardness_map",
    "reference.conductance",
)


def __getattr__(name: str) -> Any:
    """Import and return a public name when it is first used.

    `import epcontact` itself is therefore fast.  Raises AttributeError for any name
    that is not public.
    """
    if name in __all__:
        for home in (*_HOMES, "harness.verdict", "pictures.charts"):
            module = importlib.import_module(f"epcontact.{home}")
            if hasattr(module, name):
                return getattr(module, name)
    raise AttributeError(f"module 'epcontact' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
