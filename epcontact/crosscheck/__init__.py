"""Why finite and boundary elements differ on a scene, part by part.

model_difference   J2 flow against a pressure cap on one body; gates read it as
                   quantity.model_*, quantity.effective_* and quantity.elements_*
second_solves      a rough top against the gap, and limit loads; gates read them as
                   quantity.moved_* and quantity.limit_pressure
report             all parts of the difference, surface by surface
"""

# The quantities of this package are registered in one order, whichever of its modules
# is imported first.
import epcontact.harness.quantities  # noqa: F401
