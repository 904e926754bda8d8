"""Case files: TOML to scenes and gates, every mistake told in one sentence.

A case is read once for each size it offers, so that a mistake in its full size shows when the
fast one is run.  No surface is made here: a case knows its recipes and with them the digest of
each scene.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from epcontact.errors import EpcontactError, InvalidCase, nearest
from epcontact.harness.case_gates import gates_of
from epcontact.harness.gates import Gate
from epcontact.harness.methods import METHODS
from epcontact.harness.schema import CaseFile, mistake
from epcontact.scene import (
    Body,
    Load,
    Material,
    Scene,
    check_load,
    check_loading,
    scene_digest,
)
from epcontact.surfaces import Recipe, SurfaceAbsent, recipes_of, require_room

SIZES = ("fast", "full", "large")
LARGEST_FILE = 1 << 20  # bytes; a case is a page of text, anything larger is another file


@dataclass(frozen=True)
class Case:
    """One case at one size: scenes (one a surface), method options and gates."""

    id: str
    size: str
    requirement: str
    source: str
    methods: tuple[str, ...]
    time_limit: float
    verify: bool
    recipes: tuple[Recipe, ...]
    material: Material
    body: Body
    load: Load
    options: Mapping[str, Mapping[str, Any]]
    gates: tuple[Gate, ...]
    path: Path
    skip: str = ""

    def digest(self, recipe: Recipe) -> str:
        """Digest of the scene on that surface, without making the surface."""
        return scene_digest(
            recipe.fingerprint, recipe.shape, recipe.periods, self.material, self.body, self.load
        )

    def scene(self, recipe: Recipe) -> Scene:
        """Make the surface and the scene on it.  Raises InvalidScene, NotEnoughMemory."""
        require_room(recipe.shape)
        return Scene(recipe.build(), self.material, self.load, self.body)


def find_cases() -> list[Path]:
    """The case files in ./cases or, where there are none, those that came with the package."""
    package = Path(str(files("epcontact")))
    # An editable install has the cases beside the package, a wheel inside it.
    for folder in (Path("cases"), package / "_cases", package.parent / "cases"):
        if found := sorted(folder.glob("*.toml")):
            return found
    return []


def find_case(name: str) -> Path:
    """The file of a case given by path or by id.  Raises InvalidCase if there is none."""
    path = Path(name)
    # A folder of results is called as its case is.
    if path.suffix == ".toml" or (path.exists() and name not in {p.stem for p in find_cases()}):
        if not path.is_file():
            raise InvalidCase(f"{name}: no such case file; `epcontact list` shows the cases")
        return path
    known = {p.stem: p for p in find_cases()}
    if name not in known:
        raise InvalidCase(f"no case is called {name!r}{nearest(name, known)}")
    return known[name]


def load_case(path: Path, size: str = "fast") -> Case:
    """Read a case file at one size, checking it at all of them.

    Raises InvalidCase with one sentence that names the file, the key and the remedy.
    """
    data = _read(path)
    sizes = offered_sizes(data)
    if size not in sizes:
        raise InvalidCase(f"{path}: has no size {size!r}; it has {', '.join(sizes)}")
    cases = {each: _build(path, each, at_size(data, each)) for each in sizes}
    if cases[size].id != path.stem:
        raise InvalidCase(
            f"{path}: case.id is {cases[size].id!r}, but must be the file's name, {path.stem!r}"
        )
    return cases[size]


def offered_sizes(data: Mapping[str, Any]) -> tuple[str, ...]:
    """The sizes a case offers: those that every value given by size has; fast, if none is."""
    tables = list(_size_tables(data))
    return tuple(s for s in SIZES if all(s in t for t in tables)) if tables else ("fast",)


def case_sizes(path: Path) -> tuple[str, ...]:
    """The sizes the case in `path` offers.  Raises InvalidCase."""
    return offered_sizes(_read(path))


def at_size(value: Any, size: str) -> Any:
    """`value` with every table of sizes replaced by its entry for `size`."""
    if _is_size_table(value):
        return value[size]
    if isinstance(value, Mapping):
        return {key: at_size(item, size) for key, item in value.items()}
    if isinstance(value, list):
        return [at_size(item, size) for item in value]
    return value


def _is_size_table(value: Any) -> bool:
    return isinstance(value, Mapping) and bool(value) and set(value) <= set(SIZES)


def _size_tables(value: Any) -> Any:
    if _is_size_table(value):
        yield value
    elif isinstance(value, Mapping | list):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _size_tables(item)


def _read(path: Path) -> dict[str, Any]:
    try:
        if not path.is_file():
            path.stat()  # says why, where it is nothing at all
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


def _build(path: Path, size: str, data: Mapping[str, Any]) -> Case:
    try:
        table = CaseFile.model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        raise InvalidCase(f"{path}: {mistake(error)}") from None
    try:
        section = "material"
        material = Material(**table.material.model_dump())
        section = "body"
        body = Body(**table.body.model_dump())
        section = "load"
        given = table.load.mean_pressure
        load = Load(tuple(given) if isinstance(given, list) else given)
        check_load(material, load)
        if not all(METHODS[name].follows_unloading for name in table.case.methods):
            check_loading(material, load)
    except EpcontactError as error:
        raise InvalidCase(f"{path}: [{section}] {error}") from None
    absent = isinstance(table.surface, SurfaceAbsent)
    skip = f"skipped: {table.surface}" if absent else _not_installed(table.case.methods)
    return Case(
        id=table.case.id,
        size=size,
        requirement=table.case.requirement,
        source=table.case.source,
        methods=tuple(dict.fromkeys(table.case.methods)),
        time_limit=table.case.time_limit,
        verify=table.case.verify,
        recipes=() if skip else recipes_of(table.surface),
        material=material,
        body=body,
        load=load,
        options=_options(path, table),
        gates=gates_of(path, table, size),
        path=path,
        skip=skip,
    )


def _not_installed(methods: Sequence[str]) -> str:
    missing = [METHODS[name].missing for name in methods if METHODS[name].missing]
    return f"skipped: {missing[0]}" if missing else ""


def _options(path: Path, table: CaseFile) -> dict[str, dict[str, Any]]:
    options: dict[str, dict[str, Any]] = {}
    for name in table.case.methods:
        method = METHODS[name]
        given = getattr(table, method.table) if method.table else method.options()
        if given is None:
            needed = [key for key, f in method.options.model_fields.items() if f.is_required()]
            raise InvalidCase(
                f"{path}: case.methods asks for {name}, which needs a table [{method.table}] with "
                + " and ".join(needed)
            )
        options[name] = given.model_dump(exclude_none=True)
    return options
