"""The text of case files: TOML with variants and with values by size, before its keys are checked.

A file holds one case, which has the name of the file (without .toml or .case.toml), or a family of
cases.  In a family each table [[variant]] is a partial case file that is laid over the rest of the
file: its keys replace those of the same table.  A gate of a variant completes the file's gate on
the same quantity or, if there is none, is added.  So a family states once what its cases share.
"""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, nearest

SIZES = ("fast", "full", "large")
LARGEST_FILE = 1 << 20  # bytes; a case is a page of text, so a larger file is not one


@dataclass(frozen=True)
class CaseText:
    """One case as its file states it, its variant laid over the rest and its sizes unresolved."""

    path: Path
    id: str  # of the variant, or the file's name
    tables: Mapping[str, Any]
    is_variant: bool = False

    @property
    def where(self) -> str:
        """The file, and the variant if there is one, for messages."""
        return f"{self.path}: variant {self.id}" if self.is_variant else str(self.path)

    @property
    def sizes(self) -> tuple[str, ...]:
        """The sizes for which every value is given; only "fast" if no value is given by size."""
        tables = list(_size_tables(self.tables))
        return tuple(s for s in SIZES if all(s in t for t in tables)) if tables else ("fast",)


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
    """Return the cases in ./cases or, if there are none, those that came with the package."""
    return [case for file in case_files() for case in read_cases(file)]


def find_named(name: str | Path) -> tuple[CaseText, ...]:
    """Return the case of an id, or all cases of a file in ./cases, of the package or at a path."""
    path, text = Path(name), str(name)
    known: dict[str, tuple[CaseText, ...]] = {}
    # A folder of the user's own cases does not hide those of the package.
    for folder in (case_files(), package_files()) if path.suffix != ".toml" else ():
        for file in folder:
            if case_name(file) == text:
                return read_cases(file)
            known.setdefault(case_name(file), ())
            with contextlib.suppress(InvalidCase):  # other mistakes in that file do not matter here
                known |= {case.id: (case,) for case in read_cases(file)}
        if text in known:
            return known[text]
    if path.is_file():
        return read_cases(path)
    if path.suffix == ".toml" or path.exists():
        raise InvalidCase(f"{name}: no such case file; `epcontact list` shows the cases")
    file = path.with_name(f"{path.name}.toml")
    meant = f"; did you mean the file {file}?" if file.is_file() else nearest(text, known)
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
    if misspelt := tuple(_misspelt_sizes("", tables)):
        raise InvalidCase(*(f"{path}: {sentence}" for sentence in misspelt))
    variants = tables.pop("variant", None)
    if variants is None:
        return (_offered(CaseText(path, case_name(path), tables)),)
    if not (isinstance(variants, list) and variants and all(isinstance(v, dict) for v in variants)):
        raise InvalidCase(f"{path}: variant is {variants!r:.60}, but must be tables [[variant]]")
    family: dict[str, CaseText] = {}
    for number, variant in enumerate(variants, start=1):
        head = variant.get("case")
        name = head.get("id") if isinstance(head, dict) else None
        if not isinstance(name, str) or name in family:
            raise InvalidCase(
                f"{path}: variant {number} has the case.id {name!r}, but each variant needs a "
                "text of its own"
            )
        laid = _laid_over(f"{path}: variant {name}", tables, variant)
        family[name] = _offered(CaseText(path, name, laid, is_variant=True))
    return tuple(family.values())


def _offered(case: CaseText) -> CaseText:
    """Return a case that has at least one size."""
    if not case.sizes:
        raise InvalidCase(
            f"{case.where}: the values that are given by size have no size in common; give all of "
            f"them for one of {', '.join(SIZES)}"
        )
    return case


def at_size(value: Any, size: str) -> Any:
    """Return `value` with every table of sizes replaced by its entry for `size`."""
    if _is_size_table(value):
        return value[size]
    if isinstance(value, Mapping):
        return {key: at_size(item, size) for key, item in value.items()}
    if isinstance(value, list):
        return [at_size(item, size) for item in value]
    return value


def _is_size_table(value: Any) -> bool:
    return isinstance(value, Mapping) and bool(value) and set(value) <= set(SIZES)


def _items(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield what a table or a list holds, each with its key or its number from 1."""
    if isinstance(value, Mapping):
        yield from value.items()
    elif isinstance(value, list):
        yield from enumerate(value, start=1)


def _size_tables(value: Any) -> Iterator[Mapping[str, Any]]:
    if _is_size_table(value):
        yield value
        return
    for _, item in _items(value):
        yield from _size_tables(item)


def _misspelt_sizes(where: str, value: Any) -> Iterator[str]:
    """Yield a sentence for each table in which only some keys are sizes."""
    wrong = [key for key in value if key not in SIZES] if isinstance(value, Mapping) else []
    if wrong and len(wrong) < len(value):
        yield f"{where} has {wrong[0]!r}, which is no size{nearest(wrong[0], SIZES)}"
    for key, item in _items(value):
        yield from _misspelt_sizes(
            f"{where} {key}" if isinstance(key, int) else f"{where}.{key}".lstrip("."), item
        )


def _laid_over(where: str, tables: Mapping[str, Any], variant: Mapping[str, Any]) -> dict[str, Any]:
    laid = dict(tables)
    for name, table in variant.items():
        below = tables.get(name)
        if name == "gate" and isinstance(below, list) and isinstance(table, list):
            laid[name] = below
            for gate in table:
                laid[name] = _gates_with(where, laid[name], gate)
        elif isinstance(below, dict) and isinstance(table, dict):
            laid[name] = below | table
        else:
            laid[name] = table
    return laid


def _gates_with(where: str, gates: Sequence[Any], more: Any) -> list[Any]:
    """Return gates, one of which is completed by another on its quantity, or that one added."""
    quantity = more.get("quantity") if isinstance(more, dict) else None
    same = [g for g in gates if isinstance(g, dict) and g.get("quantity") == quantity]
    if quantity is None or not same:
        return [*gates, more]
    if len(same) > 1:
        raise InvalidCase(
            f"{where}: {len(same)} gates of the file have the quantity {quantity!r}, so it is "
            "not clear which of them the variant completes"
        )
    return [g | more if g is same[0] else g for g in gates]


def _read(path: Path) -> dict[str, Any]:
    try:
        if not path.is_file():
            path.stat()  # raises, with the reason, if there is no such file
            raise InvalidCase(f"{path}: is no regular file")
        if path.stat().st_size > LARGEST_FILE:
            raise InvalidCase(f"{path}: is larger than a case file can be (1 MiB)")
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InvalidCase(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InvalidCase(f"{path}: is not UTF-8 text, as TOML must be") from None
    except tomllib.TOMLDecodeError as error:
        raise InvalidCase(f"{path}: is not TOML: {error}") from None
    except RecursionError:
        raise InvalidCase(f"{path}: is nested too deeply for a case file") from None
