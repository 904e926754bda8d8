"""Exact solutions: formulas, and the closed forms that gates use.

Each file holds one theme: `waves`, `bumps`, `posts`, `layers`, `roughness`,
`yielding`; `conductance` holds laws.  Its formulas work on plain numbers; its closed
forms apply them to a scene's own heights, material and load.  A closed form refuses a
scene that it does not describe.  It measures an amplitude or a radius on the heights,
so that it shares nothing with the recipe that made them.
"""

from __future__ import annotations

from epcontact.reference.bumps import HERTZ
from epcontact.reference.conductance import COOPER_MIKIC_YOVANOVICH, MIKIC
from epcontact.reference.form import ClosedForm
from epcontact.reference.layers import FLAT, FULL_CONTACT
from epcontact.reference.posts import CAPPED_STRIP, FLAT_PUNCH, PRANDTL
from epcontact.reference.roughness import BEARING_AREA, HEIGHTS, LIGHT_LOAD
from epcontact.reference.waves import WAVINESS_HEAVY, WAVINESS_LIGHT, WESTERGAARD
from epcontact.reference.yielding import FIRST_YIELD

__all__ = ["CLOSED_FORMS", "ClosedForm"]

_FORMS = (
    *(WESTERGAARD, WAVINESS_LIGHT, WAVINESS_HEAVY),
    *(HERTZ, FIRST_YIELD),
    *(FLAT_PUNCH, CAPPED_STRIP, PRANDTL),
    *(FULL_CONTACT, FLAT, BEARING_AREA, HEIGHTS, LIGHT_LOAD),
    *(COOPER_MIKIC_YOVANOVICH, MIKIC),
)
#: The closed forms by the names that gates use.
CLOSED_FORMS: dict[str, ClosedForm] = {form.name: form for form in _FORMS}
