"""The areas of the theory against a constant energy reduction gamma.

One load of one body, elastoplastic and elastic side by side.  Boundary elements decide which
reduction is right; no gamma makes both columns agree with them at the paper's load.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from epcontact.persson.elastoplastic import areas
from epcontact.persson.reduction import EnergyReduction
from epcontact.results import FloatArray


def gamma_columns(
    full_contact_diffusion: float,
    mean_pressure: float,
    hardness: float = math.inf,
    gammas: ArrayLike | None = None,
) -> dict[str, FloatArray]:
    """Areas against a constant gamma, (n,) each; by default 141 values from 0.3 to 1.

    Columns: gamma, elastic_area, plastic_area, total_area, and elastic_body_area of the body of
    infinite hardness.  Raises InvalidScene for a gamma outside (0, 1] or pressures out of range.
    """
    values = np.linspace(0.3, 1.0, 141) if gammas is None else np.asarray(gammas, dtype=np.float64)
    for extreme in (values.min(), values.max()):
        EnergyReduction(float(extreme))  # checks the range
    found = areas(values * full_contact_diffusion, mean_pressure, hardness)
    return {
        "gamma": values,
        "elastic_area": found.elastic,
        "plastic_area": found.plastic,
        "total_area": found.total,
        "elastic_body_area": areas(values * full_contact_diffusion, mean_pressure).total,
    }
