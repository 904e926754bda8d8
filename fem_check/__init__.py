"""fem_check: elastic and J2 finite elements that check the boundary elements.

`solve` solves a scene, `solve_plain` solves a small one in plain scikit-fem,
`solve_path` returns the finite-element states, and `mesh_of` their mesh for other
codes.  With the block's `surface_compliance` boundary elements can solve exactly the
same body.

What is shared, and what is not.  fem_check imports only scene, results, errors,
machine, files and notebook (a progress bar) from epcontact: no kernel, spectrum, area
correction or formula for a modulus.  Green's function and law are therefore
independent of the boundary elements.  The algorithms are so only in part:

- Elastic and capped elements use the same family of algorithms as the boundary
  elements.  Fourier transforms along the top (ducc0) give the compliance of the block,
  active sets find the contact, and numba compiles the loops.
- J2 flow is solved in the volume, by Newton's method with radial return in loops of
  numba.  The transforms precondition its linear solves, with the contact set held.
- `plain` shares no code with these.  Its mesh, forms and assembly are scikit-fem's, its
  linear solver is scipy's, and it has no Fourier transform; its contact is an active
  set, too.  Cases compare it with the
  fast elements state by state, and its functions certify every state of these.  Both
  have the choice of the nodes and the estimate of corrected areas in common.
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
