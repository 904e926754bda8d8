"""The registry of methods: every way to solve a scene, by the name that cases and
gates use.

`METHODS` is the only list of the methods.  An entry holds a function that solves a
scene, and the properties of the method that the rest of the package uses.  Entries
come from three sources:

    the package's own   persson, bem, fem and plain, below
    other codes         contact_mechanics and tamaas, with the extra `peers`;
                        CalculiX, a program
    the user's          entry points of the group `epcontact.methods`, and `--solver`
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
import pkgutil
import re
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import entry_points
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from epcontact import bem
from epcontact.alternatives import without_alternatives
from epcontact.bem.memory import bytes_per_point
from epcontact.errors import InvalidCase, nearest
from epcontact.harness.methods import foreign
from epcontact.harness.methods.load_by_load import OnLoad, solve_load_by_load
from epcontact.machine import Stopwatch, compile_seconds
from epcontact.materials.moduli import effective_modulus
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.surfaces import Recipe, SelfAffine
from fem_check import plain_result
from fem_check.driver import solve_path
from fem_check.options import FemOptions, Geometry, LawName
from fem_check.result import contact_result


class Solve(Protocol):
    """A function that solves a scene."""

    def __call__(
        self,
        scene: Scene,
        options: Mapping[str, Any],
        threads: int | None,
        on_load: OnLoad | None = None,
    ) -> ContactResult:
        """Return the result at each load of the scene's path.

        Args:
            scene: surface, material, body and load path.
            options: the keys of the method's table in a case file.  A method with
                `load_files` also gets `progress`, a function that is called with the
                solved fraction of the path and a sentence.  With `load_files="bodies"`
                it also gets `output`, a folder.  A method with a `source` also gets
                `limit`, the seconds after which the process of the solver is ended.
            threads: the number of threads; None: all cores.
            on_load: called after each load at which the method has fields, with the
                result up to this load.  `cost["seconds"]` does not count its time.

        Raises:
            InvalidCase, InvalidScene: if the method cannot solve such a scene.
            NotConverged, NotEnoughMemory: if the solve fails.
        """
        ...


#: Returns the bytes that a solve needs beside its process and libraries, from the
#: recipe of the surface, the material, the body, the load and the method's options.
MemoryEstimate = Callable[[Recipe, Material, Body, Load, Mapping[str, Any]], float]


class Table(BaseModel):
    """A table of a case file: unknown keys and wrong types are errors."""

    # `defer_build`: a process that only solves checks no table, so that it needs no
    # validators.
    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=True, defer_build=True
    )


class TheoryTable(Table):
    """[theory]: the parameters of Persson's theory that the scene does not hold."""

    energy_reduction: float = Field(
        gt=0, le=1, description="gamma, elastic energy reduction"
    )
    reduction: Literal["constant", "persson", "wang_muser", "xu", "near_bounds"] = (
        Field(
            default="constant",
            description="how gamma turns into S(q) as the contact fills",
        )
    )
    spectrum: Literal["analytic", "surface"] = Field(
        default="analytic", description="the spectrum drawn from, or each surface's own"
    )


class BemTable(Table):
    """[bem]: the options of the boundary elements."""

    tolerance: float = Field(
        default=1e-8, gt=0, description="on the KKT residuals, dimensionless"
    )


_FEM: dict[str, Any] = {option.name: option for option in fields(FemOptions)}


class FemTable(Table):
    """[fem]: the options of the finite elements that a case may choose."""

    law: LawName = _FEM["law"]
    geometry: Geometry = _FEM["geometry"]
    depth: float | None = _FEM["depth"]
    layers: int | None = _FEM["layers"]
    tolerance: float = _FEM["tolerance"]
    steps: int = _FEM["steps"]

    @model_validator(mode="after")
    def _steps_of_j2_alone(self) -> FemTable:
        """Return the table [fem] itself; raise ValueError if it has `steps`, the number
        of load increments, for another law than J2 flow, which alone uses increments.
        """
        if "steps" in self.model_fields_set and self.law != "j2":
            raise ValueError(f"steps has no effect on law {self.law!r}; leave it out")
        return self


# --- the memory of a solve

#: Bytes of a process with its libraries, measured: 256 MiB.
_PROCESS_BYTES = 2**28
#: Below this number of points, a bound replaces the estimate of the memory.
_SMALL_GRID = 2**14
#: Largest number of bytes per point that any method needs on such a small grid.
_BYTES_PER_POINT_OF_SMALL_GRID = 2**15


def bytes_of_task(
    estimate: MemoryEstimate,
    recipe: Recipe,
    scene: tuple[Material, Body, Load],
    options: Mapping[str, Any],
) -> float:
    """Return the estimated bytes of a process that solves a scene.

    The harness decides by this estimate, before it makes a surface, how many solves a
    machine does at the same time, and which solves are too large for a worker of a
    cluster.  For a grid of less than 2^14 points the return value is a rough upper
    bound.

    Args:
        estimate: the `memory` of the method.
        recipe: describes the surface; its shape is the grid.
        scene: the material, the body and the load path.
        options: the options of the method, by their keys.
    """
    points = math.prod(recipe.shape)
    if points < _SMALL_GRID:
        return _PROCESS_BYTES + _BYTES_PER_POINT_OF_SMALL_GRID * points
    return _PROCESS_BYTES + estimate(recipe, *scene, options)


def _surface_bytes(recipe: Recipe, *_: Any) -> float:
    """Estimate the bytes of a method that needs little more than the heights and their
    Fourier modes: 32 bytes per grid point of the recipe, whatever the other arguments.
    """
    return 32.0 * math.prod(recipe.shape)


def _grid_bytes(
    recipe: Recipe, material: Material, _: Body, load: Load, *__: Any
) -> float:
    """Estimate the bytes of a solve by boundary elements, heights included.

    The estimate depends on the grid of the recipe, on the hardness and E* of the
    material, on the rms slope and on the last nonzero mean pressure.
    """
    stiffness = effective_modulus(material) * _rms_slope(recipe)
    pressure = load.final or max(load.path)
    bytes_of_heights = 8
    solver_bytes = bytes_per_point(pressure, material.hardness, stiffness)
    return (bytes_of_heights + solver_bytes) * math.prod(recipe.shape)


def _block_bytes(
    recipe: Recipe,
    material: Material,
    body: Body,
    load: Load,
    options: Mapping[str, Any],
) -> float:
    """Estimate the bytes of a solve by finite elements, on the mesh below the grid of
    the recipe that the options ask for.

    Raises what `FemOptions` and the mesh raise for options that do not fit the scene.
    """
    from fem_check.mesh import block_for, bytes_needed  # loads solvers

    flat = Scene(Surface(np.zeros(recipe.shape), recipe.periods), material, load, body)
    given = FemOptions(**options)
    return bytes_needed(flat, given, block_for(flat, given), _rms_slope(recipe))


def _rms_slope(recipe: Recipe) -> float:
    """Return the rms slope of a self-affine surface, dimensionless; 0.0 for any other
    surface, because only its heights would tell.
    """
    return recipe.spectrum.rms_slope if isinstance(recipe, SelfAffine) else 0.0


# --- methods


def _nothing() -> None:
    """Load nothing; unlike a lambda, this can be sent to a worker."""


@dataclass(frozen=True)
class Method:
    """One way to solve a scene.

    Attributes:
        name: its name in cases, files and commands.
        meaning: its description in one line.
        solve: see `Solve`.
        table: name of the case file's table that holds its options; empty: it has none.
        has_fields: whether the result has fields on the grid of the surface.
        has_model_measures: whether gates can ask how the J2 flow of the method differs
            from a pressure cap.
        follows_hardening: whether its J2 flow has the hardening of the material.
        load_files: says who writes the files of each load of a path.  "fields": the
            harness; "bodies": the method itself, into the folder of its option
            `output`; "": nobody.  `plannable` is true for every method with "fields"
            or "bodies".
        follows_unloading: whether the method can solve a path whose mean pressures
            fall.
        reports_progress: whether `solve` takes the option `progress` although the
            method writes no files of each load; it is called with the fraction of the
            path that is done and a text.
        memory: estimates the bytes of a solve, beside the process and its libraries.
        load: loads the modules and the compiled kernels of a solve, by a solve that
            takes no time.
        requires: a module of the extra `peers` that the method needs.
        program: a program on the PATH that the method needs.
        source: `module:function` or command of a solver from outside the package.
        title: its name in words in the tables of a report, such as "boundary
            elements"; empty: its `name`.
        abbreviation: its name in the tables of `epcontact accuracy`, such as "BEM";
            empty: its `name`.
    """

    name: str
    meaning: str
    solve: Solve
    table: str = ""
    has_fields: bool = True
    has_model_measures: bool = False
    follows_hardening: bool = False
    load_files: Literal["", "fields", "bodies"] = ""
    follows_unloading: bool = False
    reports_progress: bool = False
    memory: MemoryEstimate = _surface_bytes
    load: Callable[[], None] = _nothing
    requires: str = ""
    program: str = ""
    source: str = ""
    title: str = ""
    abbreviation: str = ""

    @property
    def full_name(self) -> str:
        """The method's name in words, such as "boundary elements" for "bem"."""
        return self.title or self.name

    @property
    def plannable(self) -> bool:
        """Whether `epcontact plan` can choose the grid of the method.

        This is so for the package's own methods on grids, and only these have
        `load_files`.
        """
        return bool(self.load_files)

    @property
    def knows_one_load(self) -> bool:
        """Whether the method's function solves a single load.

        The harness then calls it once for each load of a path (see `load_by_load`).
        """
        return bool(self.source or self.requires)

    @property
    def foreign(self) -> bool:
        """Whether the method's code is not part of the package."""
        return bool(self.source or self.requires or self.program)

    @property
    def code_digest(self) -> str | None:
        """What identifies the code of the method, beside the sources of the package.

        It is "" for the package's own methods, and the SHA-256 of the program that the
        method runs.  It is None if the code is not known: no saved result of such a
        method is used again, as its code may have changed.
        """
        if not self.foreign:
            return ""
        path = shutil.which(self.program) if self.program else None
        if path is None:
            return None
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    @property
    def missing(self) -> str:
        """The sentence that says why the method cannot run here; empty if it can.

        A method cannot run if its program is not on the PATH, or if the module that it
        requires is not installed.
        """
        if self.program and not shutil.which(self.program):
            return f"there is no program {self.program}; {_PROGRAMS[self.program]}"
        if not self.requires or importlib.util.find_spec(self.requires):
            return ""
        return (
            f"{self.requires} is not installed; "
            "pip install 'epcontact[peers]' brings it"
        )


# Solvers are loaded when they are called: their compiled kernels take a second to load,
# and most commands solve nothing.


def _persson(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by Persson's theory; see `Solve`.

    `options` are the keywords of `persson.solve`.  `threads` has no effect, and
    `on_load` is never called, because the theory has no fields.  Alternatives of the
    surface are left out: the harness solves them for all methods (`load_path`).
    """
    from epcontact import persson

    return persson.solve(without_alternatives(scene), **options)


def _bem(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by boundary elements; see `Solve`.

    `options` are the keywords of `bem.solve`.  The time of `on_load` is subtracted from
    the cost "seconds" of the result.  Alternatives of the surface are left out: the
    harness solves them for all methods (`load_path`).
    """
    scene = without_alternatives(scene)
    if on_load is None:
        return bem.solve(scene, threads=threads, **options)
    watch = Stopwatch()

    def without_time_of_calls(result: ContactResult) -> ContactResult:
        """Return a result whose "seconds" leave out those of the calls so far."""
        seconds = result.cost["seconds"] - watch.seconds
        return replace(result, cost={**result.cost, "seconds": seconds})

    def on_step(result: ContactResult) -> None:
        """Call `on_load` with the result up to a load."""
        with watch:
            on_load(without_time_of_calls(result))

    result = bem.solve(scene, threads=threads, on_step=on_step, **options)
    return without_time_of_calls(result)


def _fem(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by finite elements; see `Solve`.

    `options` are the keywords of `fem_check.driver.solve_path`.  `on_load` is called
    for each load after the complete path is solved.  The cost "seconds" leaves out the
    time of compiling kernels.
    """
    started = time.perf_counter()
    compiled = compile_seconds()
    path = solve_path(scene, threads=threads, **options)
    result = contact_result(path)
    # The time that the solve itself reports ends before its last kernel is compiled.
    seconds = time.perf_counter() - started - (compile_seconds() - compiled)
    if on_load is not None:
        for count in range(1, len(path.points) + 1):
            on_load(contact_result(replace(path, points=path.points[:count])))
    return replace(result, cost={**result.cost, "seconds": seconds})


def _plain(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by plain finite elements; see `Solve`.

    `options` are those of the finite elements (the table [fem]).  `threads` has no
    effect.
    """
    return plain_result.solve_plain(
        without_alternatives(scene), on_step=on_load, **options
    )


def _peer(
    function: str,
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by another public code, each load of its path alone; see `Solve`.

    Args:
        function: the adapter of the code, as `module.function` below
            `epcontact.peers`; it maps a scene to the result at its last load.
        scene: the scene.
        options: have no effect.
        threads: has no effect.
        on_load: called after each load.

    Raises:
        NotConverged: if the other code has not converged.
    """
    solve = pkgutil.resolve_name(f"epcontact.peers.{function}")
    return solve_load_by_load(lambda scene, _: solve(scene), scene, on_load)


def _calculix(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by the program CalculiX; see `Solve`.

    `options` are those of the finite elements (the table [fem]).  `threads` has no
    effect.  `on_load` is called for each load after the last one is solved.
    """
    from epcontact.peers import calculix

    return calculix.solve(scene, options, on_load=on_load)


def _foreign(
    name: str,
    source: str,
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    """Solve a scene by a user's solver in a process of its own; see `Solve`.

    Args:
        name: the method's name in results.
        source: `module:function` or a command, see `harness.methods.foreign`.
        scene: the scene; the solver is called once for each load of its path.
        options: may have `limit`, the seconds for all loads together.
        threads: has no effect.
        on_load: called after each load.

    Raises:
        InvalidCase: if the process dies or exceeds the limit, or the result is wrong.
        NotConverged: if the solver says so of its result.
    """
    end = time.monotonic() + options.get("limit", math.inf)

    def solve_last(scene: Scene, lowered: FloatArray | None) -> ContactResult:
        """Return the checked result at the last load of a scene.

        `lowered`: how far the earlier loads have lowered the surface by flow, in m on
        the grid; None: by nothing.
        """
        return foreign.solve(name, source, scene, end - time.monotonic(), lowered)

    return solve_load_by_load(solve_last, scene, on_load)


def _warm_up(solve: Solve, points: int, **options: Any) -> None:
    """Solve a small scene, so that all modules and compiled kernels are loaded.

    The scene has points out of contact, in elastic and in plastic contact.

    Args:
        solve: the method's function.
        points: grid points along x and along y.
        options: the options of the method.
    """
    x = 2 * np.pi * np.arange(points) / points
    heights = np.add.outer(np.cos(x), np.cos(3 * x))
    heights += np.random.default_rng(1).normal(0.0, 0.1, heights.shape)
    material = Material(1.0, 0.3, hardness=0.02, yield_stress=0.007)
    solve(Scene(Surface(1e-3 * heights, (1.0, 1.0)), material, Load(1e-3)), options, 1)


def _of_user(name: str, source: str) -> Method:
    """Return the `Method` for a user's solver; nothing is imported before it solves.

    Args:
        name: its name in cases and results.
        source: `module:function` or a command.
    """
    solve = partial(_foreign, name, source)
    return Method(name, f"the solver {source}", solve, source=source)


_OWN = (
    Method(
        "persson",
        "Persson's multiscale theory with a pressure cap",
        _persson,
        "theory",
        has_fields=False,
        reports_progress=True,
        title="theory",
        abbreviation="theory",
    ),
    Method(
        "bem",
        "FFT boundary elements with a pressure cap",
        _bem,
        "bem",
        load_files="fields",
        follows_unloading=True,
        memory=_grid_bytes,
        load=partial(_warm_up, _bem, 128),
        title="boundary elements",
        abbreviation="BEM",
    ),
    Method(
        "fem",
        "finite elements, elastic, with a pressure cap or with J2 flow",
        _fem,
        "fem",
        has_model_measures=True,
        follows_hardening=True,
        load_files="bodies",
        follows_unloading=True,
        memory=_block_bytes,
        load=partial(_warm_up, _fem, 8, layers=2),
        title="finite elements",
        abbreviation="FE",
    ),
    Method(
        "plain",
        "finite elements in plain scikit-fem, elastic or with J2 flow, on small scenes",
        _plain,
        "fem",
        has_model_measures=True,
        follows_hardening=True,
        follows_unloading=True,
        memory=_block_bytes,
        title="plain finite elements",
        abbreviation="plain FE",
    ),
)
_PEERS = (
    Method(
        "contact_mechanics",
        "the public solver ContactMechanics, with a pressure cap",
        partial(_peer, "public_codes.contact_mechanics"),
        requires="ContactMechanics",
    ),
    Method(
        "tamaas",
        "the public solver tamaas, with a pressure cap",
        partial(_peer, "public_codes.tamaas"),
        requires="tamaas",
    ),
    Method(
        "tamaas_j2",
        "the public solver tamaas, with J2 flow by volume integrals",
        partial(_peer, "tamaas_j2.tamaas_j2"),
        has_model_measures=True,
        requires="tamaas",
    ),
)
_CALCULIX = Method(
    "calculix",
    "the public code CalculiX, on the block of fem",
    _calculix,
    "fem",
    has_model_measures=True,
    follows_hardening=True,
    memory=_block_bytes,
    program="ccx",
    abbreviation="CalculiX",
)
_USERS = tuple(
    _of_user(e.name, e.value) for e in entry_points(group="epcontact.methods")
)

#: Every method by its name.
METHODS: dict[str, Method] = {
    method.name: method for method in (*_USERS, *_OWN, *_PEERS, _CALCULIX)
}

#: Where programs come from that methods need.
_PROGRAMS = {"ccx": "Debian's package calculix-ccx, or calculix.de, brings it"}

#: The method that `--solver` replaces in the gates.
REPLACED = "bem"


def solver_named(text: str) -> Method:
    """Return the method that the option `--solver` names.

    Args:
        text: the name of a registered method, `[NAME=]MODULE:FUNCTION`, or
            `[NAME=]COMMAND` with the placeholders `{scene}` and `{result}`.  Without
            NAME, the method is called by its FUNCTION, or "command".

    Raises:
        InvalidCase: if the text has none of these forms, if the name is no word or that
            of a registered method, or if the function or program does not exist.
    """
    if text in METHODS:
        return METHODS[text]
    prefix = re.match(r"([^\s:{=]*)=", text)
    source = text[prefix.end() :] if prefix else text
    command = foreign.is_command(source)
    if prefix:
        name = prefix[1]
    elif command:
        name = "command"
    else:
        name = source.rpartition(":")[2]
    if not command and ":" not in source:
        raise InvalidCase(
            f"--solver is {text!r}, but must be [NAME=]MODULE:FUNCTION, a command "
            f"with {{scene}} "
            f"and {{result}}, or the name of a method{nearest(text, METHODS)}"
        )
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise InvalidCase(
            f"--solver {text}: {name!r} is no name for a method; use letters"
        )
    if name in METHODS:
        raise InvalidCase(
            f"--solver {text}: there is a method {name!r} already; give another "
            "name, as in "
            f"mine={source}"
        )
    foreign.require_solver(source)
    return _of_user(name, source)
