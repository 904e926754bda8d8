"""A deliberate fault: what is wrong, its patches, and what must see it."""

import contextlib
import functools
import io
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from breaking.rewrite import StaleFault
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.harness.gates import FALLS_SHORT
from epcontact.harness.verdict.verification import verify

Patch = Callable[[pytest.MonkeyPatch], None]
TESTS = Path(__file__).parents[1]
#: Plugins of pytest that a single test under a fault does not need.  The one for
#: unraisable exceptions collects the garbage of the whole suite for each test, which
#: takes longer than most tests do.
UNUSED_PLUGINS = ("cacheprovider", "xdist", "unraisableexception")


@dataclass(frozen=True)
class Fault:
    """One fault, and the gate that must turn red, or the test that must fail.

    Attributes:
        what: The mistake in words.
        path: The dotted path of what is wrong, or a template.
        place: Which part of it is wrong (see `breaking.table`).
        patches: What makes it wrong, applied in this order.
        test: The test that must fail; "" if a gate sees the fault.
        case, quantity: The case and the quantity of the gate.
        against, norm, of: Fields of the gate, if the quantity has several gates.
        surfaces: Number of the case's surfaces that are solved; None: all.  One surface
            has no interval, but a band that holds eight surfaces also holds any one
            within 2.5 standard deviations.
        status: Of the gate.
    """

    what: str
    path: str
    place: str
    patches: tuple[Patch, ...]
    test: str = ""
    case: str = ""
    quantity: str = ""
    against: str = ""
    norm: str = ""
    of: str = ""
    surfaces: int | None = None
    status: str = FALLS_SHORT

    @property
    def room(self):
        """Return the package in which the mistake is made."""
        if self.path.endswith(".jinja"):
            return "output"
        package, room, *_ = self.path.split(".")
        return room if package == "epcontact" else package

    @property
    def seen_by(self):
        """Name what shows the fault: a bare "verify", "cases" (pytest cases) or a
        "test".
        """
        if self.test:
            return "test"
        if honest_case(self.case).head.verify:
            return "verify"
        return "cases"

    def apply(self, monkeypatch):
        """Put the fault in place.

        Raises `StaleFault` if the code no longer has the place.
        """
        for patch in self.patches:
            patch(monkeypatch)


@functools.cache
def honest_case(name):
    """Return the case with an id, without any fault; the id may be that of its file as
    well.

    Raises StopIteration if no case has the id.
    """
    return load_case(next(case for case in find_named(name) if case.id == name))


def gates_of(fault):
    """Return the gates of the case that can show the fault.

    Raises `StaleFault` if there is none.
    """
    try:
        gates = honest_case(fault.case).gates
    except StopIteration:
        raise StaleFault(f"there is no case {fault.case}") from None
    fitting = tuple(
        gate
        for gate in gates
        if gate.quantity == fault.quantity
        and fault.against in ("", str(gate.against))
        and fault.norm in ("", gate.norm)
        and fault.of in ("", gate.of)
    )
    if not fitting:
        raise StaleFault(f"{fault.case} has no such gate of {fault.quantity}")
    return fitting


def status_under(fault, output):
    """Return the status of the fault's gate, the first if there are several: "holds",
    "falls short" or "error".

    Only this gate is judged, with the methods that it needs; results go to the folder
    `output`. With the fault in place this is what `epcontact verify` finds.
    """
    case = honest_case(fault.case)
    gate = gates_of(fault)[0]
    methods = tuple(name for name in case.methods if name in (gate.of, gate.against))
    recipes = case.recipes[: fault.surfaces]
    case = case.changed(gates=(gate,), methods=methods, recipes=recipes)
    verdict = verify(case, jobs=1, output=output, fresh=True)
    return verdict.cases[0].gates[0].status


def fails_under(fault, folder):
    """Return whether the fault's test fails while the fault is in place.

    The test's module is imported anew, so that it holds the patched functions. `folder`
    is for the temporary files of the test.
    """
    name = Path(fault.test.partition("::")[0]).stem
    module = sys.modules.pop(name, None)
    options = ["-q", "-x", "-m", "", "--assert=plain"]
    for plugin in UNUSED_PLUGINS:
        options += ["-p", f"no:{plugin}"]
    test = str(TESTS.parent / fault.test)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            code = pytest.main([*options, f"--basetemp={folder}", test])
    finally:
        sys.modules.pop(name, None)
        if module is not None:
            sys.modules[name] = module
    assert code in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED), code
    return code == pytest.ExitCode.TESTS_FAILED
