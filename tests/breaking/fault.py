"""A deliberate fault: what is wrong, the patch that makes it so, and what must see
it.
"""

from __future__ import annotations

import contextlib
import functools
import io
import pkgutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from breaking.rewrite import StaleFault
from epcontact.errors import OutputError
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.harness.gates import FALLS_SHORT
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.verdict.verification import verify

Patch = Callable[[pytest.MonkeyPatch], None]
TESTS = Path(__file__).parents[1]


@dataclass(frozen=True)
class Fault:
    """One fault, and the gate that must turn red, or the test that must fail."""

    what: str  # the mistake in words
    room: str  # the package in which it is made
    patch: Patch
    case: str = ""
    quantity: str = ""
    against: str | float | None = (
        None  # None: the only gate on the quantity, or all of them
    )
    norm: str = ""  # where the gates on the quantity have several
    of: str = ""  # where they are of several methods
    test: str = ""  # that must fail instead, if no gate sees the fault
    #: So many of the case's surfaces are solved; None: all.  One surface has no
    #: interval, but a band that holds eight of them also holds any one within 2.5
    #: standard deviations.
    surfaces: int | None = None
    status: str = FALLS_SHORT  # of the gate, or REFUSED if verify withdraws the verdict
    path: str = ""  # of the function, if the fault is a row of the table
    place: str = ""  # the pattern of the row

    @property
    def seen_by(self):
        """Name what shows the fault: a bare "verify", "cases" (pytest cases) or a
        "test".
        """
        if self.test:
            return "test"
        return "verify" if honest_case(self.case).head.verify else "cases"


@functools.cache
def honest_case(name):
    """The case of an id, which may be that of its file as well."""
    return load_case(next(case for case in find_named(name) if case.id == name))


#: The status under a fault that contradicts what was written (see `harness.read_back`).
REFUSED = "refused"


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
        and fault.against in (None, gate.against)
        and fault.norm in ("", gate.norm)
        and fault.of in ("", gate.of)
    )
    if not fitting:
        against = f" against {fault.against}" if fault.against else ""
        raise StaleFault(f"{fault.case} has no gate {fault.quantity}{against}")
    return fitting


def status_under(fault, output):
    """Judge the fault's gate alone, with the methods that it needs; the first if there
    are several.

    With the fault's patch in place this is what `epcontact verify` finds under the
    fault.
    """
    case = honest_case(fault.case)
    gates = gates_of(fault)
    needed = {gates[0].of, gates[0].against}
    methods = tuple(name for name in case.methods if name in needed)
    case = case.changed(
        gates=gates[:1], methods=methods, recipes=case.recipes[: fault.surfaces]
    )
    try:
        return verify(case, jobs=1, output=output, fresh=True).cases[0].gates[0].status
    except OutputError:
        return REFUSED


# --- patches
# -------------------------------------------------------------------------------------


def changed(path, change):
    """Patch `module.attribute`, or `module.Class.attribute`, by `change(original)`."""
    owner_path, _, attribute = path.rpartition(".")

    def patch(monkeypatch):
        try:
            owner = pkgutil.resolve_name(owner_path)
            original = getattr(owner, attribute)
        except (ImportError, AttributeError):
            raise StaleFault(f"{path} does not exist") from None
        monkeypatch.setattr(owner, attribute, change(original))

    return patch


def at(path, value):
    """Patch `module.attribute` with a value."""
    return changed(path, lambda original: value)


def scaled(path, factor):
    """The result of a function multiplied by a factor."""
    return on_result(path, lambda result: result * factor)


def on_result(path, wrong):
    """What a function returns, passed through `wrong`."""
    return changed(
        path, lambda f: functools.wraps(f)(lambda *a, **k: wrong(f(*a, **k)))
    )


def given(path, wrong):
    """A function called with the arguments (a tuple) that `wrong` makes of its own."""
    return changed(
        path, lambda f: functools.wraps(f)(lambda *a, **k: f(*wrong(*a), **k))
    )


def both(*patches):
    """Several patches at once."""

    def patch(monkeypatch):
        for each in patches:
            each(monkeypatch)

    return patch


def solver(wrong):
    """A solver in the place of the boundary elements."""

    def patch(monkeypatch):
        answer = replace(
            METHODS["bem"], solve=lambda scene, options, threads: wrong(scene)
        )
        monkeypatch.setitem(METHODS, "bem", answer)

    return patch


def quantity(path, name, change):
    """A quantity of a solver's last step, changed."""

    def wrong(result):
        last = result.final
        values = dict(last.quantities) | {name: change(last.quantities[name])}
        return replace(
            result, steps=(*result.steps[:-1], replace(last, quantities=values))
        )

    return on_result(path, wrong)


# --- faults that a test sees
# ---------------------------------------------------------------------


def fails_under(fault, folder):
    """True if the fault's test fails while the patch is in place.

    The test's module is imported anew, so that its own names are those of the patched
    package.
    """
    name = Path(fault.test.partition("::")[0]).stem
    kept = sys.modules.pop(name, None)
    arguments = ["-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", ""]
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            code = pytest.main(
                [*arguments, f"--basetemp={folder}", str(TESTS.parent / fault.test)]
            )
    finally:
        sys.modules.pop(name, None)
        if kept is not None:
            sys.modules[name] = kept
    assert code in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED), code
    return code == pytest.ExitCode.TESTS_FAILED
