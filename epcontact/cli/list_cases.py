"""The command `list`.  It reads texts only, so that no schema or solver is loaded."""

from __future__ import annotations

import builtins
from collections.abc import Mapping, Sequence
from typing import Any

from epcontact.cli.terminal import open_console, print_rows, print_sentence, text_of
from epcontact.errors import InvalidCase
from epcontact.harness.case_files.text import (
    SIZES,
    CaseText,
    at_size,
    case_files,
    case_name,
    read_cases,
)

#: The mark of families of which a bare verify runs no case.
_LEFT_OUT = "*"


def list(words: tuple[str, ...], all_cases: bool) -> None:
    """List the cases by their methods, or what they require.

    The arguments are those of `commands.list`.
    """
    families = [(case_name(path), read_cases(path)) for path in case_files()]
    if not (words or all_cases):
        _print_by_methods(families)
        return
    cases = [(case.id, (case,)) for _, family in families for case in family]
    chosen: Sequence[tuple[str, Sequence[CaseText]]] = cases
    if words and not all_cases:
        chosen = [*families, *(case for case in cases if case not in families)]
    rows = []
    for name, family in chosen:
        if all(word in name for word in words):
            rows.append(_row(name, family))
    if not rows:
        raise InvalidCase(
            f"no case has {' '.join(words)!r} in its name; `epcontact list` shows all"
        )
    headings = ("name", "cases", "sizes", "methods", "requirement")
    print_rows(open_console(), headings, rows, named=False)


def _print_by_methods(families: Sequence[tuple[str, Sequence[CaseText]]]) -> None:
    """Print the names of families of cases in a paragraph for each set of methods.

    Args:
        families: The name of each family and its cases.
    """
    console = open_console()
    groups: dict[str, builtins.list[str]] = {}
    for name, cases in families:
        heads = [_head(case) for case in cases]
        methods = dict.fromkeys(method for head in heads for method in head["methods"])
        number = f" ({len(cases)})" if len(cases) > 1 else ""
        is_run = any(map(_is_verified, cases, heads))
        mark = "" if is_run else _LEFT_OUT
        groups.setdefault(", ".join(methods), []).append(f"{name}{number}{mark}")
    for methods_of_group, names in groups.items():
        console.print(text_of(methods_of_group, "bold"))
        print_sentence(console, f"  {', '.join(names)}")
    count = sum(len(cases) for _, cases in families)
    print_sentence(
        console,
        f"cases: {count}, in {len(families)} files, by their methods; a number in "
        f"parentheses counts the cases of a file; {_LEFT_OUT} not in a bare `epcontact "
        "verify`",
    )
    print_sentence(
        console,
        "`epcontact list WORD` shows what the cases with this word in their names "
        "require, `epcontact list --all` what each requires",
    )


def _row(name: str, cases: Sequence[CaseText]) -> tuple[str, ...]:
    """Return the cells of a family of cases in the list.

    Args:
        name: Name of the family or of the case.
        cases: Its cases, one or more.

    Returns:
        The name, the number of cases and how many of them a bare verify runs, the
        sizes, the methods, and the requirements.

    Raises:
        InvalidCase: A case lacks a requirement or methods.
    """
    heads = [_head(case) for case in cases]
    sizes = [size for size in SIZES if any(size in case.sizes for case in cases)]
    methods = dict.fromkeys(method for head in heads for method in head["methods"])
    requirements = dict.fromkeys(str(head["requirement"]) for head in heads)
    requirement = " ".join(requirements)
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
