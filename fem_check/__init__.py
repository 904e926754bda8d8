"""fem_check: a finite-element half-block that answers epcontact's scenes independently.

It imports from epcontact the scene, the results and the errors alone: no kernel, no spectrum,
no area correction, not even a formula for a modulus.

`solve` answers a scene, and `solve_path` does so with the finite-element states; the
`surface_compliance` of the block lets a comparison give the very same body to the boundary
elements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fem_check.driver import solve, solve_path, surface_compliance

__all__ = ["solve", "solve_path", "surface_compliance"]


def __getattr__(name: str) -> Any:
    """Import a public name at its first use: `import fem_check` stays cheap."""
    if name not in __all__:
        raise AttributeError(f"module 'fem_check' has no attribute {name!r}")
    from fem_check import driver  # defines the compiled loops, which takes a second

    return getattr(driver, name)
