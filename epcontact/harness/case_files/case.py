"""Case files become scenes and gates; all mistakes of a file are told, each in one sentence.

Mistakes that pydantic finds in a table hide those between the tables, which it could not read.

A case is read at every size it offers, so that a mistake in its full size shows when the fast
one is run.  No surface is made here: a case has recipes, and they give the digest of each scene.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from epcontact.errors import EpcontactError, InvalidCase, InvalidScene, nearest
from epcontact.harness.case_files.axes import SweepTable
from epcontact.harness.case_files.case_gates import gate_mistakes, gates_of, not_judged
from epcontact.harness.case_files.schema import CaseFile, mistakes
from epcontact.harness.case_files.text import (
    SIZES,
    CaseText,
    at_size,
    case_files,
    case_name,
    package_files,
    read_cases,
)
from epcontact.harness.gates.gate import Gate
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.materials.hardness_map import effective_hardness
from epcontact.scene import (
    Body,
    Load,
    Material,
    Scene,
    check_load,
    check_loading,
    scene_digest,
)
from epcontact.surfaces import (
    HeightsFromFile,
    Recipe,
    SelfAffineEnsemble,
    SurfaceAbsent,
    recipes_of,
    require_room,
)
from epcontact.surfaces.power_spectrum import surface_moments

__all__ = [
    "SIZES",
    "Case",
    "CaseText",
    "case_at",
    "case_sizes",
    "find_case",
    "find_cases",
    "find_named",
    "load_case",
    "load_cases",
    "sweep_of",
]


_FIGURES = re.compile(r"\d+")


@dataclass(frozen=True)
class Case:
    """One case at one size: a scene for each surface, method options and gates.

    `hardness_source` says where a hardness comes from that the file calls effective.
    """

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
    not_judged: tuple[str, ...] = ()
    sweep: SweepTable | None = None
    hardness_source: str = ""

    @property
    def hardness_in_words(self) -> str:
        """The effective hardness with its interval, or "" where the file gives a number."""
        return self.hardness_source.partition("; ")[0]

    def digest(self, recipe: Recipe) -> str:
        """Return the digest of the scene on a surface, without making the surface."""
        return scene_digest(
            recipe.fingerprint, recipe.shape, recipe.periods, self.material, self.body, self.load
        )

    def folder(self, output: Path) -> Path:
        """Return the folder of its results: one for each size, `<output>/<case>/<size>`."""
        return output / self.id / self.size

    def scene(self, recipe: Recipe) -> Scene:
        """Make the surface and the scene on it.  Raises InvalidScene, NotEnoughMemory."""
        require_room(recipe.shape)
        return Scene(recipe.build(), self.material, self.load, self.body)


def find_cases() -> list[CaseText]:
    """Return the cases in ./cases or, if there are none, those that came with the package.

    Raises:
        InvalidCase: if one of the files is not a case file.

    Example:
        >>> "hertz-sphere" in [case.id for case in find_cases()]
        True
    """
    return [case for file in case_files() for case in read_cases(file)]


def find_named(name: str | Path) -> tuple[CaseText, ...]:
    """Return the cases that a name refers to: one case by its id, or all cases of a file.

    Args:
        name: the id of a case, the name of a file in the folder ./cases or among the cases of
            the package, or a path.

    Raises:
        InvalidCase: if no case or file has that name.
    """
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
    """Return the one case that a name refers to; see `find_named`.  Raises InvalidCase."""
    cases = find_named(name)
    # A file may hold a family of which one case has the name of the file.
    cases = tuple(case for case in cases if case.id == str(name)) or cases
    if len(cases) > 1:
        ids = ", ".join(case.id for case in cases)
        raise InvalidCase(f"{name} holds {len(cases)} cases; name one of them: {ids}")
    return cases[0]


def load_case(case: CaseText | Path | str, size: str = "fast") -> Case:
    """Read a case at one size and check it at all of them.

    Args:
        case: a case from `find_case` or `find_cases`, or a name or path for `find_case`.
        size: "fast", "full" or "large", if the case has it.

    Raises:
        InvalidCase: with one sentence for each mistake, which names the file, the key and the
            remedy.

    Example:
        >>> case = load_case("westergaard-light")
        >>> case.methods, [recipe.shape for recipe in case.recipes]
        (('bem',), [(4096,)])
    """
    text = case if isinstance(case, CaseText) else find_case(case)
    if size not in text.sizes:
        raise InvalidCase(f"{text.where}: has no size {size!r}; it has {', '.join(text.sizes)}")
    cases: dict[str, Case] = {}
    told: list[str] = []
    for each in text.sizes:
        try:
            cases[each] = _build(text, each)
        except InvalidCase as error:
            # A value by size may have one mistake with other figures at each of them.
            known = {_FIGURES.sub("", sentence) for sentence in told}
            told += [s for s in error.args if _FIGURES.sub("", s) not in known]
    if told:
        raise InvalidCase(*told)
    return cases[size]


def load_cases(texts: Iterable[CaseText | Case], size: str = "fast") -> list[Case]:
    """Read several cases; one that is loaded already is taken as it is.

    Raises:
        InvalidCase: with a sentence for each mistake of all files; one that several variants share
            is told of the first.
    """
    cases: list[Case] = []
    told: dict[tuple[Path, str], str] = {}
    for text in texts:
        if isinstance(text, Case):
            cases.append(text)
            continue
        try:
            cases.append(load_case(text, size))
        except InvalidCase as error:
            for sentence in error.args:
                told.setdefault((text.path, sentence.removeprefix(text.where)), sentence)
    if told:
        raise InvalidCase(*told.values())
    return cases


def case_sizes(case: CaseText | Path | str) -> tuple[str, ...]:
    """Return the sizes that a case offers.  Raises InvalidCase."""
    return (case if isinstance(case, CaseText) else find_case(case)).sizes


def sweep_of(text: CaseText, size: str) -> SweepTable:
    """Return the table [sweep] of a case at a size.  Raises InvalidCase if it has none."""
    case = load_case(text, size)
    if case.sweep is None:
        raise InvalidCase(
            f"{text.where}: has no table [sweep], such as load.mean_pressure = [1e8, 2e8]"
        )
    return case.sweep


def case_at(text: CaseText, point: Mapping[str, Any], size: str) -> Case:
    """Return the case at a point of its sweep, which no gate judges.

    Args:
        text: the case.
        point: values by their keys, such as "material.hardness".
        size: a size of the case.

    Raises:
        InvalidCase: if the case cannot have these values; the message names them.
    """
    tables = {k: v for k, v in text.tables.items() if k not in ("gate", "omit", "sweep")}
    for key, value in point.items():
        section, _, name = key.partition(".")
        tables[section] = {**tables.get(section, {}), name: value}
    try:
        case = _build(replace(text, tables=tables), size, judged=False)
    except InvalidCase as error:
        values = ", ".join(f"{key} = {value!r:.40}" for key, value in point.items())
        at = f"(at the point {values} of its sweep)"
        raise InvalidCase(*(f"{sentence} {at}" for sentence in error.args)) from None
    unread = {m.table for m in METHODS.values()} - {METHODS[name].table for name in case.methods}
    for key in point:
        if key.partition(".")[0] in unread:
            raise InvalidCase(f"{text.where}: [sweep] no method of the case reads {key}")
    return case


def _build(text: CaseText, size: str, *, judged: bool = True) -> Case:
    where = text.where
    try:
        context = {"folder": text.path.parent}
        table = CaseFile.model_validate(at_size(text.tables, size), context=context)
    except ValidationError as error:
        raise InvalidCase(*(f"{where}: {sentence}" for sentence in mistakes(error))) from None
    except EpcontactError as error:  # a grid too large for memory; pydantic wraps only ValueErrors
        raise InvalidCase(f"{where}: [surface] {error}") from None
    absent = isinstance(table.surface, SurfaceAbsent)
    told = [*_id_mistakes(text, table), *_option_mistakes(table)]
    if not absent and (table.sweep is None or not judged):  # a sweep may give what its case lacks
        told += _strength_mistakes(table)
    if judged:
        told += gate_mistakes(table, size, text.sizes)
    material, hardness_source, load = None, "", table.load.load()
    try:
        section = "surface"
        slope = _slope(table)
        section = "material"
        material, hardness_source = _material(table, slope)
        section = "load"
        check_load(material, load)
        if not all(METHODS[name].follows_unloading for name in table.case.methods):
            check_loading(material, load)
    except EpcontactError as error:
        told.append(f"[{section}] {error}")
    if told or material is None:
        raise InvalidCase(*(f"{where}: {sentence}" for sentence in told))
    skip = f"skipped: {table.surface}" if absent else _not_installed(table.case.methods)
    return Case(
        id=table.case.id,
        size=size,
        requirement=table.case.requirement,
        source=table.case.source,
        methods=tuple(table.case.methods),
        time_limit=table.case.time_limit,
        verify=table.case.verify,
        recipes=() if skip else recipes_of(table.surface),
        material=material,
        body=table.body.body(),
        load=load,
        options=_options(table),
        gates=gates_of(table, size) if judged else (),
        not_judged=not_judged(table, size) if judged else (),
        path=text.path,
        skip=skip,
        sweep=table.sweep,
        hardness_source=hardness_source,
    )


def _slope(table: CaseFile) -> float:
    """The rms slope that an effective hardness depends on: of a map, once it has been treated.

    It is 0 where nothing depends on it.
    """
    surface = table.surface
    if table.material.hardness != "effective" or isinstance(surface, SurfaceAbsent):
        return 0.0
    if isinstance(surface, HeightsFromFile):
        require_room(surface.shape)
        return surface_moments(surface.build()).rms_slope
    return surface.rms_slope if isinstance(surface, SelfAffineEnsemble) else 0.0


def _material(table: CaseFile, slope: float) -> tuple[Material, str]:
    """Make the material; an effective hardness is that of the map at the largest mean pressure.

    The sentence says where an effective hardness comes from.
    """
    given, source = table.material.model_dump(), ""
    if given["hardness"] == "effective":
        surface, pressures = table.surface, table.load.mean_pressure
        if isinstance(surface, SurfaceAbsent):  # the case is skipped, and nothing asks for its cap
            return Material(**given | {"hardness": math.inf}), ""
        rough = isinstance(surface, SelfAffineEnsemble | HeightsFromFile)
        if not rough or len(recipes_of(surface)[0].shape) == 1:
            raise InvalidScene(
                "hardness is 'effective', which is known for rough surfaces only, those of kind "
                "self_affine and the maps of kind file; give it in Pa"
            )
        if given["yield_stress"] == math.inf:
            raise InvalidScene(
                "hardness is 'effective', but yield_stress, from which it follows, is missing"
            )
        if table.body.depth < min(surface.periods):
            raise InvalidScene(
                f"hardness is 'effective', which is known for deep bodies, but [body] depth is "
                f"{table.body.depth:g} m and the period {min(surface.periods):g} m; give it in Pa"
            )
        found = effective_hardness(
            yield_stress=given["yield_stress"],
            young_modulus=given["young_modulus"],
            poisson_ratio=given["poisson_ratio"],
            rms_slope=slope,
            mean_pressure=max(pressures) if isinstance(pressures, list) else pressures,
        )
        given["hardness"] = found.value
        source = f"{found}; {found.rests_on}".replace("\n", " ")
    return Material(**given), source


def _id_mistakes(text: CaseText, table: CaseFile) -> Iterator[str]:
    if table.case.id != text.id:
        yield f"case.id is {table.case.id!r}, but must be the file's name, {text.id!r}"


def _strength_mistakes(table: CaseFile) -> Iterator[str]:
    """Yield a sentence for a law without the stress at which it flows.

    A metal whose yield stress alone is given would be elastic to all methods but J2 flow, and no
    figure of the answer would show it.
    """
    given, methods = table.material, table.case.methods
    law = table.fem.law if "fem" in methods else ""
    needed = {"j2": "yield_stress", "capped": "hardness"}.get(law, "")
    if needed and getattr(given, needed) == math.inf:
        yield f"fem.law is {law!r}, but [material] {needed} is missing; give it, or another law"
    elastic = [name for name in methods if not METHODS[name].has_model_measures]
    if elastic and given.yield_stress < math.inf and "hardness" not in given.model_fields_set:
        yield (
            f"[material] has a yield_stress and no hardness, at which {elastic[0]} flows; give "
            "hardness in Pa, as 'effective' (the cap that stands for J2 flow), or as inf for an "
            "elastic body"
        )


def _not_installed(methods: Sequence[str]) -> str:
    missing = [METHODS[name].missing for name in methods if METHODS[name].missing]
    return f"skipped: {missing[0]}" if missing else ""


def _options(table: CaseFile) -> dict[str, dict[str, Any]]:
    given = {name: _given(table, METHODS[name]) for name in table.case.methods}
    return {name: options.model_dump(exclude_none=True) for name, options in given.items()}


def _given(table: CaseFile, method: Method) -> Any:
    """Return the table of a method's options; None if a method that needs one has none."""
    return getattr(table, method.table) if method.table else method.options()


def _option_mistakes(table: CaseFile) -> Iterator[str]:
    for name in table.case.methods:
        method = METHODS[name]
        given = _given(table, method)
        if given is None:
            needed = [key for key, f in method.options.model_fields.items() if f.is_required()]
            yield (
                f"case.methods asks for {name}, which needs a table [{method.table}] with "
                + " and ".join(needed)
            )
        kind = getattr(table.surface, "kind", "self_affine")  # an absent file has none
        if getattr(given, "spectrum", "") == "analytic" and kind != "self_affine":
            yield (
                f"{method.table}.spectrum is 'analytic', but a surface of kind {kind} is not drawn "
                "from one; write spectrum = 'surface', which takes that of the heights"
            )
