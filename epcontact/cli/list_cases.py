"""The command `list`.  It reads texts only, so that no schema or solver is loaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click

from epcontact.cli.terminal import open_console, print_rows
from epcontact.errors import InvalidCase
from epcontact.harness.case_files.text import (
    SIZES,
    CaseText,
    at_size,
    case_files,
    case_name,
    read_cases,
)


@click.command()
@click.option(
    "--all", "all_cases", is_flag=True, help="Each case of a family, one line each."
)
def list(all_cases: bool) -> None:
    """List the families of cases, one line each.

    A family is a file that holds several cases, or one.
    """
    families: Any = ((case_name(path), read_cases(path)) for path in case_files())
    first = "family"
    if all_cases:
        first = "case"
        families = ((case.id, (case,)) for _, cases in families for case in cases)
    headings = (first, "cases", "sizes", "methods", "requirement")
    rows = (_row(name, cases) for name, cases in families)
    print_rows(open_console(), headings, rows, named=False)


def _row(name: str, cases: Sequence[CaseText]) -> tuple[str, ...]:
    """Return the cells of a family of cases in the list.

    Args:
        name: Name of the family or of the case.
        cases: Its cases, one or more.

    Returns:
        The name, the number of cases and how many of them a bare verify runs, the
        sizes, the methods, and the requirement of the first case.

    Raises:
        InvalidCase: A case lacks a requirement or methods.
    """
    heads = [_head(case) for case in cases]
    sizes = [size for size in SIZES if any(size in case.sizes for case in cases)]
    methods = dict.fromkeys(method for head in heads for method in head["methods"])
    requirement, *others = dict.fromkeys(str(head["requirement"]) for head in heads)
    if others:
        requirement += f" (the first of {len(others) + 1})"
    counts = []
    if len(cases) > 1:
        counts.append(f"{len(cases)} cases")
    verified = sum(map(_is_verified, cases, heads))
    if verified == 0:
        counts.append("not in a bare verify")
    elif verified < len(cases):
        counts.append(f"{verified} of {len(cases)} in a bare verify")
    return name, ", ".join(counts), " ".join(sizes), " ".join(methods), requirement


def _is_verified(case: CaseText, head: Mapping[str, Any]) -> bool:
    """Return whether `epcontact verify` without arguments runs the case.

    It runs cases with a size "fast", without a table [sweep] and without `verify =
    false` in the table [case], which is `head`.
    """
    is_sweep = "sweep" in case.tables
    return "fast" in case.sizes and not is_sweep and bool(head.get("verify", True))


def _head(case: CaseText) -> Mapping[str, Any]:
    """Return the table [case] of a case; raise InvalidCase if it lacks a key."""
    try:
        head: Mapping[str, Any] = at_size(case.tables, case.sizes[0])["case"]
        _ = (*head["methods"], head["requirement"])
    except (KeyError, TypeError):
        raise InvalidCase(
            f"{case.where}: needs a table [case] with a requirement and methods"
        ) from None
    return head
