"""What a result rests on: the sources that made it, and the numerical libraries that they import.

A kept result is used again only while these are the same.  The sources are those of the method and
of everything that it imports, read from the import statements, so that a change of a chart or a
report leaves results valid and a change of the solver does not.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

#: The folder that holds the packages `epcontact` and `fem_check`.
HOME = Path(__file__).parents[3]

#: The libraries that affect numbers, by the name that import statements use.
_LIBRARIES = {
    "numpy": ("numpy",),
    "scipy": ("scipy",),
    "ducc0": ("ducc0",),
    "numba": ("numba",),
    "skfem": ("scikit-fem", "scipy"),
}
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]*(\([^)]*\)|[^\n#]*)|import[ \t]+([^\n#]+))",
    re.MULTILINE,
)


@dataclass(frozen=True)
class Foundation:
    """The sources and libraries behind a result.

    Attributes:
        modules: names of the project's modules, sorted.
        digest: SHA-256 of their files.
        libraries: distributions of the numerical libraries that they import, sorted.
    """

    modules: tuple[str, ...]
    digest: str
    libraries: tuple[str, ...]


@functools.cache
def foundation(
    roots: tuple[str, ...],
    alone: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    home: Path = HOME,
) -> Foundation:
    """Return what some modules rest on."""
    waiting, files = list(roots), {name: _file(name, home) for name in alone}
    libraries: set[str] = set()
    seen = set(without) | set(alone)
    while waiting:
        name = waiting.pop()
        file = None if name in seen else _file(name, home)
        seen.add(name)
        if file is None:
            continue
        files[name] = file
        for found in imported(file.read_text(encoding="utf-8")):
            libraries |= set(_LIBRARIES.get(found.partition(".")[0], ()))
            waiting += [found, *_packages(found)]
    digest = hashlib.sha256()
    for name, file in sorted(files.items()):
        if file is not None:
            digest.update(name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return Foundation(tuple(sorted(files)), digest.hexdigest(), tuple(sorted(libraries)))


def imported(text: str) -> Iterator[str]:
    """Yield the names that the import statements of a source may mean, modules or not."""
    for source, names, plain in _IMPORT.findall(text):
        parts = [p.split(" as ")[0].strip() for p in (names or plain).strip("() \t").split(",")]
        words = [word for part in parts if (word := part.strip("() \t\n"))]
        if source:
            yield source
            yield from (f"{source}.{word}" for word in words)
        else:
            yield from words


def _packages(name: str) -> list[str]:
    """Return the packages that importing a module runs, but for the face of `epcontact`."""
    parts = name.split(".")
    above = [".".join(parts[:n]) for n in range(1, len(parts))]
    return [package for package in above if package != "epcontact"]


def _file(name: str, home: Path) -> Path | None:
    if name.partition(".")[0] not in ("epcontact", "fem_check") or name == "epcontact":
        return None
    path = home.joinpath(*name.split("."))
    files = (path.with_name(f"{path.name}.py"), path / "__init__.py")
    return next((file for file in files if file.is_file()), None)
