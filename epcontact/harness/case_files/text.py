"""The text of case files: TOML with variants and with values by size, before its keys
are checked.

A file holds one case of its own name, or a family: each table [[variant]] is a partial
case file that is laid over the rest.  Its keys replace those of the same table; a gate
of it completes the file's gate on the same quantity or, if there is none, is added.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, nearest

#: The sizes that a case may have, from the smallest solve to the largest.
SIZES = ("fast", "full", "large")
#: Bytes of the largest case file; a case is a page of text.
LARGEST_FILE = 1 << 20
#: Digits of the longest number, and parts of the longest key: to read them takes the
#: square of their number.
LONGEST = 300


@dataclass(frozen=True)
class CaseText:
    """One case as its file states it, its variant laid over the rest.

    Attributes:
        path: the file.
        id: the id of the variant, or the name of the file.
        tables: the tables of the case, with values by size.
        where: the file, and the variant if there is one, for messages.
    """

    path: Path
    id: str
    tables: Mapping[str, Any]
    where: str

    @property
    def sizes(self) -> tuple[str, ...]:
        """The sizes for which every value is given; only "fast" if no value is given by
        size.
        """
        tables = list(_size_tables(self.tables))
        if not tables:
            return ("fast",)
        return tuple(size for size in SIZES if all(size in table for table in tables))


# --- finding cases


def case_name(path: Path) -> str:
    """Return the id of the one case in a file: its name without .toml or .case.toml."""
    return path.name.removesuffix(".toml").removesuffix(".case")


def case_files() -> list[Path]:
    """Return the case files in ./cases or, if there are none, those of the package."""
    return sorted(Path("cases").glob("*.toml")) or package_files()


def package_files() -> list[Path]:
    """Return the case files that came with the package."""
    package = Path(str(files("epcontact")))
    # A wheel has the cases inside the package, an editable install beside it.
    inside = sorted((package / "_cases").glob("*.toml"))
    return inside or sorted((package.parent / "cases").glob("*.toml"))


def find_cases() -> list[CaseText]:
    """Return the cases in ./cases or, if there are none, those of the package."""
    return [case for file in case_files() for case in read_cases(file)]


def find_named(name: str | Path) -> tuple[CaseText, ...]:
    """Return the case of an id, or all cases of a file.

    Args:
        name: the id of a case; or a file in ./cases or of the package, without its
            ending; or the path of a file.

    Raises:
        InvalidCase: if there is no such case, or if its file cannot be read.
    """
    path = Path(name)
    known: dict[str, tuple[CaseText, ...]] = {}
    if path.suffix != ".toml":
        # A folder of the user's own cases does not hide those of the package.
        for folder in (case_files(), package_files()):
            found = _find_in(folder, str(name), known)
            if found:
                return found
    if path.is_file():
        return read_cases(path)
    if path.suffix == ".toml" or path.exists():
        raise InvalidCase(
            f"{name}: no such case file; `epcontact list` shows the cases"
        )
    remedy = nearest(str(name), known)
    file = path.with_name(f"{path.name}.toml")
    if file.is_file():
        remedy = f"; did you mean the file {file}?"
    raise InvalidCase(f"no case is called {str(name)!r}{remedy}")


def _find_in(
    folder: Sequence[Path], name: str, known: dict[str, tuple[CaseText, ...]]
) -> tuple[CaseText, ...]:
    """Return the cases of a file of that name, or the one of that id; () if neither is
    there.

    Args:
        folder: the case files of a folder.
        name: the name of a file without its ending, or the id of a case.
        known: the function adds to it the cases that it has read, by their names.

    Raises:
        InvalidCase: if the file of that name has mistakes; others are ignored.
    """
    for file in folder:
        if case_name(file) == name:
            return read_cases(file)
        known.setdefault(case_name(file), ())
        with contextlib.suppress(InvalidCase):  # mistakes there are not those of `name`
            for case in read_cases(file):
                known[case.id] = (case,)
    return known.get(name, ())


def find_case(name: str | Path) -> CaseText:
    """Return the one case that a name refers to, see `find_named`.

    Raises InvalidCase also if the name is that of a file with several cases.
    """
    cases = find_named(name)
    # A file may hold a family of which one case has the name of the file.
    named_like_file = [case for case in cases if case.id == str(name)]
    if named_like_file:
        return named_like_file[0]
    if len(cases) > 1:
        ids = ", ".join(case.id for case in cases)
        raise InvalidCase(f"{name} holds {len(cases)} cases; name one of them: {ids}")
    return cases[0]


# --- reading a file


def read_cases(path: Path) -> tuple[CaseText, ...]:
    """Return the cases of a file: one case, or one for each table [[variant]].

    Their keys are not checked.  Raises InvalidCase if the file cannot be read, is no
    TOML, or if a variant has no id of its own.
    """
    tables = _read(path)
    variants = tables.pop("variant", None)
    if variants is None:
        return (_with_size(CaseText(path, case_name(path), tables, str(path))),)
    if not (variants and isinstance(variants, list)):
        raise InvalidCase(
            f"{path}: variant is {variants!r:.60}, but must be tables [[variant]]"
        )
    family: dict[str, CaseText] = {}
    for number, variant in enumerate(variants, start=1):
        name = _id_of(variant)
        if not isinstance(name, str) or name in family:
            raise InvalidCase(
                f"{path}: variant {number} has the case.id {name!r}, but needs one of "
                "its own"
            )
        where = f"{path}: variant {name}"
        laid = _laid_over(where, tables, variant)
        family[name] = _with_size(CaseText(path, name, laid, where))
    return tuple(family.values())


def _id_of(variant: Any) -> Any:
    """Return the value of the key case.id in a variant, of any type; None without."""
    head = variant.get("case") if isinstance(variant, dict) else None
    return head.get("id") if isinstance(head, dict) else None


def _with_size(case: CaseText) -> CaseText:
    """Return the case unchanged.  Raises InvalidCase if it has no size, because its
    values by size have no size in common.
    """
    if not case.sizes:
        raise InvalidCase(
            f"{case.where}: the values given by size have no size in common"
        )
    return case


def _read(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises InvalidCase if it cannot be read, is no regular file, is larger than 1 MiB,
    or is not TOML in UTF-8.
    """
    try:
        if path.stat() and not path.is_file():
            raise InvalidCase(f"{path}: is no regular file")
        if path.stat().st_size > LARGEST_FILE:
            raise InvalidCase(
                _map_sentence(path)
                or f"{path}: is larger than a case file can be (1 MiB)"
            )
        text = path.read_bytes().decode("utf-8-sig")
        _require_short(text)
        return tomllib.loads(text)
    except OSError as error:
        raise InvalidCase(f"{path}: cannot be read: {error.strerror}") from None
    # tomllib raises RecursionError if there are too many brackets.
    except (ValueError, RecursionError) as error:
        if isinstance(error, InvalidCase):
            raise
        raise InvalidCase(
            _map_sentence(path) or f"{path}: is not TOML in UTF-8: {error}"
        ) from None


def _map_sentence(path: Path) -> str:
    """Return the sentence for a file that is no case file but may be a map of heights.

    It is empty for a file whose name ends with .toml.
    """
    if path.suffix.lower() == ".toml":
        return ""
    return (
        f"{path}: is no case file (.toml); if it is a map of heights, `epcontact new "
        f"{shlex.quote(str(path))}` writes a case for it"
    )


def _require_short(text: str) -> None:
    """Raise ValueError if a number in a TOML text has 300 digits, or a key as many
    parts: such a text would take minutes to read.
    """
    dots = max(re.sub(r"\d\.\d", "", line).count(".") for line in text.split("\n"))
    if dots > LONGEST or re.search(rf"[\da-fA-F_]{{{LONGEST}}}", text):
        raise ValueError(f"a number has {LONGEST} digits, or a key as many parts")


# --- values by size, and variants


def at_size(value: Any, size: str) -> Any:
    """Return a copy of a value in which each table of sizes is replaced by its entry.

    A table of sizes is such as {"fast": 64, "full": 256}.

    Args:
        value: a value of a TOML file: a number, a text, a list or a table.
        size: "fast", "full" or "large".

    Raises:
        KeyError: if a table of sizes has no entry for this size.
    """
    if _is_size_table(value):
        return value[size]
    if isinstance(value, Mapping):
        return {key: at_size(item, size) for key, item in value.items()}
    if isinstance(value, list):
        return [at_size(item, size) for item in value]
    return value


def _is_size_table(value: Any) -> bool:
    """Return whether a value of a TOML file is a table whose keys are all sizes."""
    return isinstance(value, Mapping) and bool(value) and set(value) <= set(SIZES)


def _size_tables(value: Any) -> Iterator[Mapping[str, Any]]:
    """Yield every table of sizes in a value of a TOML file, however deep inside."""
    if _is_size_table(value):
        yield value
    elif isinstance(value, Mapping | list):
        items = value.values() if isinstance(value, Mapping) else value
        for item in items:
            yield from _size_tables(item)


def _laid_over(
    where: str, tables: Mapping[str, Any], variant: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the tables of a file with those of a variant laid over them.

    The variant's keys replace those of the same table; see `_with_gate` for gates.

    Args:
        where: the file and the variant, for messages.
        tables: the tables of the file, by their names.
        variant: those of the variant.

    Raises:
        InvalidCase: see `_with_gate`.
    """
    laid = dict(tables)
    for name, table in variant.items():
        below = tables.get(name)
        if name == "gate" and isinstance(below, list) and isinstance(table, list):
            for gate in table:
                laid[name] = _with_gate(where, laid[name], gate)
        elif isinstance(below, dict) and isinstance(table, dict):
            laid[name] = below | table
        else:
            laid[name] = table
    return laid


def _with_gate(where: str, gates: Sequence[Any], gate: Any) -> list[Any]:
    """Return a list of gates together with a gate of a variant.

    The keys of the variant's gate replace those of the gate on the same quantity.  If
    there is no such gate, the variant's gate is appended.

    Args:
        where: the file and the variant, for messages.
        gates: the tables [[gate]] of the file.
        gate: a table [[gate]] of the variant.

    Raises:
        InvalidCase: if several gates are on that quantity.
    """
    quantity = gate.get("quantity") if isinstance(gate, dict) else None
    same = [g for g in gates if isinstance(g, dict) and g.get("quantity") == quantity]
    if quantity is None or not same:
        return [*gates, gate]
    if len(same) > 1:
        raise InvalidCase(
            f"{where}: its gate on {quantity!r} could complete any of {len(same)}"
        )
    index = gates.index(same[0])
    return [*gates[:index], same[0] | gate, *gates[index + 1 :]]
