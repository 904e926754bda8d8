"""The table of deliberate faults: every one must turn a gate red or make a test fail.

`python -m breaking`, in the folder of the tests, prints it.
"""

from breaking import (
    after,
    boundary,
    elements,
    judging,
    references,
    surfaces,
    table,
    theory,
)
from breaking.fault import Fault, fails_under, honest_case, status_under

__all__ = ["FAULTS", "Fault", "fails_under", "honest_case", "status_under"]

ROOMS = (surfaces, theory, boundary, after, elements, references, judging, table)
FAULTS: dict[str, Fault] = {
    fault.what: fault for room in ROOMS for fault in room.FAULTS
}
