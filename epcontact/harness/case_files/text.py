"""The text of case files: TOML with variants and with values by size, before its keys
are checked.

A file holds one case of its own name, or a family: each table [[variant]] is a partial
case file that is laid over the rest.  Its keys replace those of the same table; a gate
of it completes the file's gate on the same quantity or, if there is none, is added.
"""

from __future__ import annotations

import contextlib
import functools
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, nearest

SIZES = ("fast", "full", "large")
LARGEST_FILE = 1 << 20  # bytes; a case is a page of text
LONGEST = 300  # digits of a number; parts of a key, which take the square of their number to read


@dataclass(frozen=True)
class CaseText:
    """One case as its file states it, its variant laid over the rest and its sizes
    unresolved.
    """

    path: Path
    id: str  # of the variant, or the file's name
    tables: Mapping[str, Any]
    where: str  # the file, and the variant if there is one, for messages

    @property
    def sizes(self) -> tuple[str, ...]:
        """The sizes for which every value is given; only "fast" if no value is given by
        size.
        """
        tables = list(_size_tables(self.tables))
        return (
            tuple(s for s in SIZES if all(s in t for t in tables))
            if tables
            else ("fast",)
        )


def case_name(path: Path) -> str:
    """Return the id of the one case in a file: its name without .toml or .case.toml."""
    return path.name.removesuffix(".toml").removesuffix(".case")


def case_files() -> list[Path]:
    """Return the case files in ./cases or, if there are none, those of the package."""
    return sorted(Path("cases").glob("*.toml")) or package_files()


def package_files() -> list[Path]:
    """Return the case files that came with the package."""
    package = Path(str(files("epcontact")))
    # An editable install has the cases beside the package, a wheel inside it.
    inside, beside = package / "_cases", package.parent / "cases"
    return sorted(inside.glob("*.toml")) or sorted(beside.glob("*.toml"))


def find_cases() -> list[CaseText]:
    """Return the cases in ./cases or, if there are none, those that came with the
    package.
    """
    return [case for file in case_files() for case in read_cases(file)]


def find_named(name: str | Path) -> tuple[CaseText, ...]:
    """Return the case of an id, or all cases of a file in ./cases, of the package or at
    a path.
    """
    path, text = Path(name), str(name)
    known: dict[str, tuple[CaseText, ...]] = {}
    # A folder of the user's own cases does not hide those of the package.
    for folder in (case_files(), package_files()) if path.suffix != ".toml" else ():
        for file in folder:
            if case_name(file) == text:
                return read_cases(file)
            known.setdefault(case_name(file), ())
            with contextlib.suppress(
                InvalidCase
            ):  # mistakes in that file do not matter here
                known |= {case.id: (case,) for case in read_cases(file)}
        if text in known:
            return known[text]
    if path.is_file():
        return read_cases(path)
    if path.suffix == ".toml" or path.exists():
        raise InvalidCase(
            f"{name}: no such case file; `epcontact list` shows the cases"
        )
    file = path.with_name(f"{path.name}.toml")
    meant = (
        f"; did you mean the file {file}?" if file.is_file() else nearest(text, known)
    )
    raise InvalidCase(f"no case is called {text!r}{meant}")


def find_case(name: str | Path) -> CaseText:
    """Return the one case that a name refers to."""
    cases = find_named(name)
    # A file may hold a family of which one case has the name of the file.
    cases = tuple(case for case in cases if case.id == str(name)) or cases
    if len(cases) > 1:
        ids = ", ".join(case.id for case in cases)
        raise InvalidCase(f"{name} holds {len(cases)} cases; name one of them: {ids}")
    return cases[0]


def read_cases(path: Path) -> tuple[CaseText, ...]:
    """Read the case, or the family of cases, in a file."""
    tables = _read(path)
    variants = tables.pop("variant", None)
    if variants is None:
        return (_offered(CaseText(path, case_name(path), tables, str(path))),)
    if not (variants and isinstance(variants, list)):
        raise InvalidCase(
            f"{path}: variant is {variants!r:.60}, but must be tables [[variant]]"
        )
    family: dict[str, CaseText] = {}
    for number, variant in enumerate(variants, start=1):
        head = variant.get("case") if isinstance(variant, dict) else None
        name = head.get("id") if isinstance(head, dict) else None
        if not isinstance(name, str) or name in family:
            raise InvalidCase(
                f"{path}: variant {number} has the case.id {name!r}, but needs one of its own"
            )
        where = f"{path}: variant {name}"
        family[name] = _offered(
            CaseText(path, name, _laid_over(where, tables, variant), where)
        )
    return tuple(family.values())


def _offered(case: CaseText) -> CaseText:
    if not case.sizes:
        raise InvalidCase(
            f"{case.where}: the values given by size have no size in common"
        )
    return case


def at_size(value: Any, size: str) -> Any:
    """Return `value` with every table of sizes replaced by its entry for `size`."""
    if _is_size_table(value):
        return value[size]
    if isinstance(value, Mapping):
        return {key: at_size(item, size) for key, item in value.items()}
    return [at_size(item, size) for item in value] if isinstance(value, list) else value


def _is_size_table(value: Any) -> bool:
    return isinstance(value, Mapping) and bool(value) and set(value) <= set(SIZES)


def _size_tables(value: Any) -> Iterator[Mapping[str, Any]]:
    if _is_size_table(value):
        yield value
    elif isinstance(value, Mapping | list):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _size_tables(item)


def _laid_over(
    where: str, tables: Mapping[str, Any], variant: Mapping[str, Any]
) -> dict[str, Any]:
    """Return tables with the keys of a variant in the place of their own."""
    laid = dict(tables)
    for name, table in variant.items():
        below = tables.get(name)
        if name == "gate" and isinstance(below, list) and isinstance(table, list):
            laid[name] = functools.reduce(
                functools.partial(_completed, where), table, below
            )
        else:
            both = isinstance(below, dict) and isinstance(table, dict)
            laid[name] = below | table if both else table
    return laid


def _completed(where: str, gates: Sequence[Any], more: Any) -> list[Any]:
    """Return gates, one of which is completed by another on its quantity, or that one
    added.
    """
    quantity = more.get("quantity") if isinstance(more, dict) else None
    same = [g for g in gates if isinstance(g, dict) and g.get("quantity") == quantity]
    if quantity is None or not same:
        return [*gates, more]
    if len(same) > 1:
        raise InvalidCase(
            f"{where}: its gate on {quantity!r} could complete any of {len(same)}"
        )
    return [g | more if g is same[0] else g for g in gates]


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.stat() and not path.is_file():
            raise InvalidCase(f"{path}: is no regular file")
        if path.stat().st_size > LARGEST_FILE:
            raise InvalidCase(f"{path}: is larger than a case file can be (1 MiB)")
        text = path.read_bytes().decode("utf-8-sig")
        dots = max(re.sub(r"\d\.\d", "", line).count(".") for line in text.split("\n"))
        if dots > LONGEST or re.search(rf"[\da-fA-F_]{{{LONGEST}}}", text):
            raise ValueError(f"a number has {LONGEST} digits, or a key as many parts")
        return tomllib.loads(text)
    except OSError as error:
        raise InvalidCase(f"{path}: cannot be read: {error.strerror}") from None
    except (
        ValueError,
        RecursionError,
    ) as error:  # of TOML, of UTF-8, and of too many brackets
        raise InvalidCase(f"{path}: is not TOML in UTF-8: {error}") from None
