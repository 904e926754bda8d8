"""fem_check: a finite-element half-block that solves epcontact's scenes independently.

It imports only scene, results, errors, machine and files from epcontact: no kernel,
spectrum, area correction or formula for a modulus.

`solve` solves a scene, `solve_path` returns the finite-element states, and `mesh_of`
their mesh for other codes.  With the block's `surface_compliance` boundary elements can
solve exactly the same body.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fem_check.driver import solve, solve_path, surface_compliance
    from fem_check.options import FemOptions
    from fem_check.plain_result import solve_plain
    from fem_check.vtu import mesh_of

__all__ = [
    "FemOptions",
    "mesh_of",
    "solve",
    "solve_path",
    "solve_plain",
    "surface_compliance",
]


def __getattr__(name: str) -> Any:
    """Import a public name of `fem_check` when it is used for the first time.

    Python calls this function for names that the module does not define, so that
    `import fem_check` is cheap.

    Args:
        name: of the attribute, one of those in `__all__`.

    Returns:
        The function or class of that name.

    Raises:
        AttributeError: `name` is not in `__all__`.
    """
    if name not in __all__:
        raise AttributeError(f"module 'fem_check' has no attribute {name!r}")
    from fem_check import driver  # defines the compiled functions, which takes a second

    return getattr(driver, name)
