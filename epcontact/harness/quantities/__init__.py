"""Quantities: every figure that a gate can read of an answer."""

# Their functions are in the registry once they are imported.
from epcontact.harness.quantities import (  # noqa: F401
    filled,
    identities,
    measurements,
    model_difference,
)
