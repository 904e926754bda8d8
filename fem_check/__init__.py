"""fem_check: a finite-element half-block that answers epcontact's scenes independently.

It imports from epcontact the scene, the results and the errors alone: no kernel, no spectrum,
no area correction, not even a formula for a modulus.

`solve` answers a scene; `surface_compliance` is what the block's surface answers to a pressure
wave, so that a comparison can give the very same body to the boundary elements.
"""

from __future__ import annotations

from typing import Any

__all__ = ["solve", "solve_path", "surface_compliance"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: `import fem_check` stays cheap."""
    if name not in __all__:
        raise AttributeError(f"module 'fem_check' has no attribute {name!r}")
    from fem_check import driver

    return getattr(driver, name)
