"""An adapter: a solver of a scene's last load becomes a method for a load path.

Solvers from outside the package return the pressure field of a single load.  For a
path, the adapter calls them for each load in turn, with a scene that ends there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from epcontact.errors import NotConverged
from epcontact.results import ContactResult, FloatArray, LoadStep
from epcontact.scene import Load, Scene

#: Returns the result at the last load of a scene.  The second argument is how far the
#: earlier loads have lowered the surface by flow, in m on the grid; None: by nothing,
#: or unknown.
SolveLast = Callable[[Scene, FloatArray | None], ContactResult]
#: Called after each load with the result so far; its fields are those of this load.
OnLoad = Callable[[ContactResult], None]


def solve_load_by_load(
    solve_last: SolveLast, scene: Scene, on_load: OnLoad | None = None
) -> ContactResult:
    """Return the result for the load path of a scene, with the costs of all its solves.

    Args:
        solve_last: is called for each load, with a scene whose path ends there.
        scene: the scene with its complete path.
        on_load: see `OnLoad`.

    Raises:
        NotConverged: if the solver reports that it has not converged.
    """
    path = scene.load.path
    steps: tuple[LoadStep, ...] = ()
    costs = []
    plastic_displacement = None
    for count in range(1, len(path) + 1):
        ends_here = replace(scene, load=Load(path[:count]))
        result = solve_last(ends_here, plastic_displacement)
        if not result.converged:
            raise NotConverged("the result says that it has not converged")
        steps = (*steps, result.final)
        result = replace(result, steps=steps)
        costs.append(result.cost)
        if on_load is not None:
            on_load(result)
        plastic_displacement = result.fields.get("plastic_displacement")
        if result.provenance.options.get("law") == "j2":
            plastic_displacement = None  # the surface does not show what flows inside
    return replace(result, cost=total_cost(costs))


def total_cost(costs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the cost of several solves after each other, by the name of the cost.

    Each cost is summed, but of the unknowns and of the peak memory (bytes) the largest
    value counts.  The names are those of the first solve; a cost that another solve
    lacks counts as 0 there.
    """
    total = {}
    for name in costs[0]:
        values = [cost.get(name, 0.0) for cost in costs]
        largest = name in ("unknowns", "peak_memory_bytes")
        total[name] = max(values) if largest else sum(values)
    return total
