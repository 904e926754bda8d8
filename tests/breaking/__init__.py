"""The table of deliberate faults: every one must turn a gate red or make a test fail.

`python -m breaking`, in the folder of the tests, prints it.
"""

from __future__ import annotations

from breaking import boundary, elements, judging, references, surfaces, theory
from breaking.fault import Fault, fails_under, gate_under, honest_case

__all__ = ["FAULTS", "Fault", "fails_under", "gate_under", "honest_case"]

ROOMS = (surfaces, theory, boundary, elements, references, judging)
FAULTS: dict[str, Fault] = {fault.what: fault for room in ROOMS for fault in room.FAULTS}
