"""Exact solutions: formulas, and the closed forms that gates use.

Each file holds one theme: `waves`, `bumps`, `posts`, `layers` and `roughness`.  Its formulas work
on plain numbers; its closed forms apply them to a scene's own heights, material and load.  A closed
form refuses a scene that it does not describe.  It measures an amplitude or a radius on the
heights, so that it shares nothing with the recipe that made them.
"""

from __future__ import annotations

from epcontact.reference import bumps, layers, posts, roughness, waves
from epcontact.reference.form import ClosedForm

__all__ = ["CLOSED_FORMS", "ClosedForm"]

#: The closed forms by the names that gates use.
CLOSED_FORMS: dict[str, ClosedForm] = {
    form.name: form for theme in (waves, bumps, posts, layers, roughness) for form in theme.FORMS
}
