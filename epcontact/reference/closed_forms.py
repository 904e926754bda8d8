"""Closed forms that gates can name, read off a scene's own heights, material and load.

Each form refuses a scene it does not describe; what it needs of the geometry (an amplitude, a
radius) it measures on the heights, so that it shares nothing with the recipe that made them.
"""

from __future__ import annotations

from epcontact.reference import bumps, linear, roughness, waves
from epcontact.reference.form import ClosedForm

__all__ = ["CLOSED_FORMS", "ClosedForm"]

CLOSED_FORMS: dict[str, ClosedForm] = {
    form.name: form for module in (waves, bumps, linear, roughness) for form in module.FORMS
}
