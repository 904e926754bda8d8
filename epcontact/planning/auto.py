"""Cases of size "auto": made cheaper by a plan as far as their gates allow."""

from __future__ import annotations

from epcontact.errors import EpcontactError
from epcontact.harness.case_files.case import Case, CaseText, load_case
from epcontact.harness.gates.gate import Gate
from epcontact.harness.methods.registry import METHODS
from epcontact.planning.pilots import PARTS
from epcontact.planning.plan import methods_on_grids, plan, planned_case

_CORRECTED = tuple(f"area.{part}.corrected" for part in PARTS)


def load_auto(text: CaseText) -> tuple[Case, str]:
    """Load a case at its full or only size and make it cheaper by `auto_case`.

    The sentence is empty if the case is skipped.
    """
    sizes = [size for size in text.sizes if size != "large"]
    given = load_case(text, (sizes or ["large"])[-1])
    return (given, "") if given.skip else auto_case(given)


def auto_case(
    case: Case, tolerance: float | None = None, *, threads: int | None = None
) -> tuple[Case, str]:
    """Make a case cheaper if its gates allow.

    Grids are chosen by the errors of corrected areas.  So a case stays as it is if a gate reads
    anything else that depends on the grid (fields, distributions, raw areas, gaps), or if it has
    finite elements beside boundary elements.

    Args:
        case: the case.
        tolerance: on the area, relative; None: a third of the narrowest band of the case's gates
            on corrected areas.
        threads: number of threads of the pilots; None: all cores.

    Returns:
        The case, never dearer than the given one, and a sentence that says what was done.
    """
    unchanged = case.changed(size="auto")
    blocking = [g.name for g in case.gates if not _plannable(g)]
    bands = [g.high - g.low for g in case.gates if g.quantity.endswith(".corrected")]
    if blocking or not bands or len(methods_on_grids(case)) > 1:
        reason = f"its gate on {blocking[0]} asks for its grid" if blocking else "unchanged"
        return unchanged, f"{case.id}: {reason}"
    wanted = min(bands) / 2 / 3 if tolerance is None else tolerance
    parts = sorted({g.quantity.split(".")[1] for g in case.gates if g.quantity in _CORRECTED})
    try:
        chosen = plan(case, min(wanted, 0.5), parts=parts, threads=threads, capped=True)
    except EpcontactError as error:
        return unchanged, f"{case.id}: unchanged, because {error}"
    if not chosen.on_grid or not chosen.meets or chosen.work > chosen.given_work:
        return unchanged, f"{case.id}: unchanged; {chosen.reasons[-1]}"
    return planned_case(case, chosen), f"{case.id}: {'; '.join(chosen.reasons)}"


def _plannable(gate: Gate) -> bool:
    """True if a gate depends on the grid only through corrected areas, or not at all."""
    free = ("residual.", "iterations.", "quantity.measured_")
    return (
        not METHODS[gate.of].has_fields
        or gate.quantity in _CORRECTED
        or (gate.quantity.startswith(free) and not gate.quantity.endswith("carried"))
    )
