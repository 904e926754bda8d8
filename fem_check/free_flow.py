"""The limit load of a body that a flat presses: the force at which it flows freely.

A perfectly plastic body whose contact no longer grows, such as that of a flat punch,
carries at most its limit load.  Under a larger load it has no equilibrium, and Newton's
method wanders.  Under a prescribed approach it has one at every approach, and the force
only tends to the limit load.  `require_equilibrium` therefore presses the flat on in
doublings of the indentation.  It stops as soon as the force reaches the load, or as
soon as the force grows so little that no indentation would bring the load.
"""

from __future__ import annotations

from epcontact.errors import NotConverged
from epcontact.results import APART
from fem_check import plasticity
from fem_check.newton import solve_increment
from fem_check.plasticity import History
from fem_check.problem import Control, Problem, State

#: Times that the indentation is doubled at most.
MAX_DOUBLINGS = 8
#: Largest relative growth of the force in the last doubling at which the body flows
#: freely.  The force of a contact that grows is at least proportional to the
#: indentation: it grows by 1.  That of a punch grew by 0.0008 in the second doubling.
LARGEST_GROWTH = 0.01
#: Doublings, at the growth of the last one, that must leave the force below the load.
DOUBLINGS_LEFT = 8
#: Tolerance on the residuals.  The force needs no more digits than its growth.
TOLERANCE = 1e-5


class FlowsFreely(NotConverged):
    """The body has no equilibrium under the load: it flows freely.

    Attributes:
        limit: mean pressure over the nominal area at which it flows freely, in Pa.
    """

    def __init__(self, limit: float, fraction: float) -> None:
        """Create the error.

        Args:
            limit: mean pressure over the nominal area at which the body flows, in Pa.
            fraction: contact area over nominal area while it flows.
        """
        super().__init__(
            f"the body cannot carry this load: it flows freely from {limit:.3g} Pa on "
            f"({limit / fraction:.3g} Pa in the {100 * fraction:.3g} % of the surface "
            "in contact); give mean pressures below it or a material that hardens"
        )
        self.limit = limit


def require_equilibrium(
    problem: Problem, state: State, history: History, load: float
) -> None:
    """Raise FlowsFreely if the body flows freely below a load.

    It returns if the body carries the load, and if neither can be shown.

    Args:
        problem: of a J2 body.
        state: a state at a smaller load, with at least one node in contact.
        history: plastic strains of the elements at this state.
        load: total force, in N.

    Raises:
        FlowsFreely: in the last doubling of the indentation the force grew by at most
            `LARGEST_GROWTH` (1 %), and `DOUBLINGS_LEFT` (8) more would not reach the
            load.
    """
    first_touch = float(problem.heights.max())
    indentation = state.approach + first_touch
    force = float(state.forces.sum())
    if indentation <= 0:  # piled-up material touches above the first touch
        return
    for _ in range(MAX_DOUBLINGS):
        indentation *= 2
        control = Control(approach=indentation - first_touch, scale=force)
        try:
            solved = solve_increment(problem, state, history, control, TOLERANCE)
        except NotConverged:
            return
        state = solved.state
        growth = float(state.forces.sum()) - force
        force += growth
        if force >= load:
            return
        if growth <= LARGEST_GROWTH * force and DOUBLINGS_LEFT * growth < load - force:
            fraction = float((state.states != APART).mean())
            raise FlowsFreely(force / problem.area, fraction)
        u = problem.physical_displacement(state.displacement).reshape(-1, 3)
        history = plasticity.commit(
            u, problem.bricks, problem.law, history, solved.flowing
        )
