"""Quantities: every figure that a gate can read of an answer.

registry          QUANTITIES, each with its unit and meaning, and how they are read
answered          an answered scene, of which quantities are measured
measurements      quantities of the surface, the fields and the interface
identities        what must agree within one answer
model_difference  J2 flow against a pressure cap, and the effective hardness
"""

# Their functions are in the registry once they are imported.
from epcontact.harness.quantities import identities, measurements, model_difference

__all__ = ["identities", "measurements", "model_difference"]
