"""The registry of methods: every way to answer a scene, by the name that cases and
gates use.

`METHODS` is the only list of the methods.  An entry holds a function that answers a
scene and what the rest of the package needs to know about it.  Entries come from three
sources:

    the package's own   persson, bem and fem, below
    other codes         contact_mechanics and tamaas, with the extra `peers`;
                        CalculiX, a program
    the user's          entry points of the group `epcontact.methods`, and `--solver`
"""

from __future__ import annotations

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
from epcontact.bem.memory import bytes_per_point
from epcontact.errors import InvalidCase, nearest
from epcontact.harness.methods import foreign
from epcontact.harness.methods.load_by_load import OnLoad, solve_load_by_load
from epcontact.machine import compile_seconds
from epcontact.materials.moduli import effective_modulus
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.surfaces import Recipe, SelfAffine
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
            scene: the scene.
            options: the keys of the method's table in a case file; for `Method`s with
                `load_files` also `progress`, a function that is called with the
                fraction that is done and a sentence, and for "bodies" `output`, a
                folder; with a `source` also `limit`, the seconds after which the
                process of the solver is ended.
            threads: the number of threads; None: all cores.
            on_load: called after each load whose fields the method knows, with the
                result up to this load.  `cost["seconds"]` does not count its time.
        """
        ...


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
    reduction: Literal["constant", "persson", "wang_muser", "xu", "local"] = Field(
        default="constant", description="how gamma turns into S(q) as the contact fills"
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
        if "steps" in self.model_fields_set and self.law != "j2":
            raise ValueError(f"steps has no effect on law {self.law!r}; leave it out")
        return self


# --- the memory of a solve
# ----------------------------------------------------------------------

_PROCESS = 2**28  # bytes of a process with its libraries
_SMALL, _MOST = (
    2**14,
    2**15,
)  # below so many points a solve takes at most so many bytes a point


def bytes_of_task(
    estimate: MemoryEstimate,
    recipe: Recipe,
    scene: tuple[Material, Body, Load],
    options: Mapping[str, Any],
) -> float:
    """Return the bytes of a process that solves a scene; a rough bound for small grids.
    How many solves a machine makes side by side, and which solves a worker of a cluster
    is not asked to do, follows from it before a surface is made.
    """
    points = math.prod(recipe.shape)
    needed = _MOST * points if points < _SMALL else estimate(recipe, *scene, options)
    return _PROCESS + needed


def _surface_bytes(recipe: Recipe, *_: Any) -> float:
    """Estimate the bytes of a method that needs little more than the heights and their
    modes.
    """
    return 32.0 * math.prod(recipe.shape)


def _grid_bytes(
    recipe: Recipe, material: Material, _: Body, load: Load, *__: Any
) -> float:
    """Estimate the bytes of the boundary elements, heights included."""
    stiffness = effective_modulus(material) * _slope(recipe)
    pressure = load.final or max(load.path)
    return (8 + bytes_per_point(pressure, material.hardness, stiffness)) * math.prod(
        recipe.shape
    )


def _block_bytes(
    recipe: Recipe,
    material: Material,
    body: Body,
    load: Load,
    options: Mapping[str, Any],
) -> float:
    """Estimate the bytes of the finite elements."""
    from fem_check.mesh import block_for, bytes_needed  # loads solvers

    flat = Scene(Surface(np.zeros(recipe.shape), recipe.periods), material, load, body)
    given = FemOptions(**options)
    return bytes_needed(flat, given, block_for(flat, given), _slope(recipe))


def _slope(recipe: Recipe) -> float:
    return recipe.spectrum.rms_slope if isinstance(recipe, SelfAffine) else 0.0


# --- methods
# -------------------------------------------------------------------------------------


def _nothing() -> None:
    """Load nothing; unlike a lambda, this can be sent to a worker."""


@dataclass(frozen=True)
class Method:
    """One way to answer a scene.

    Attributes:
        name: its name in cases, files and commands.
        meaning: its description in one line.
        solve: see `Solve`.
        table: name of the case file's table that holds its options; empty: it has none.
        has_fields: whether the result has fields on the grid of the surface.
        has_model_measures: whether gates can ask how the J2 flow of the method differs
            from a cap.
        load_files: of a method that follows a path of loads, unloading included: who
            writes the files of each load.  "fields": the harness; "bodies": the method
            itself, into the folder of its option `output`; "": it follows no path.
        memory: estimates the bytes of a solve, beside the process and its libraries.
        load: loads the modules and the compiled kernels of a solve, by a solve that
            takes no time.
        requires: a module of the extra `peers` that the method needs.
        program: a program on the PATH that the method needs.
        source: `module:function` or command of a solver from outside the package.
    """

    name: str
    meaning: str
    solve: Solve
    table: str = ""
    has_fields: bool = True
    has_model_measures: bool = False
    load_files: Literal["", "fields", "bodies"] = ""
    memory: MemoryEstimate = _surface_bytes
    load: Callable[[], None] = _nothing
    requires: str = ""
    program: str = ""
    source: str = ""

    @property
    def plannable(self) -> bool:
        """Whether it is one of the package's own methods on grids, whose grid a plan
        can choose.
        """
        return bool(self.load_files)

    @property
    def follows_unloading(self) -> bool:
        """Whether the mean pressures of a path may fall."""
        return bool(self.load_files)

    @property
    def knows_one_load(self) -> bool:
        """Whether it has the fields of one load alone, so that it is asked for each
        load of a path (see `load_by_load`).
        """
        return bool(self.source or self.requires)

    @property
    def foreign(self) -> bool:
        """True if its code is not the package's: no kept result is used, as it may have
        changed.
        """
        return bool(self.source or self.requires or self.program)

    @property
    def missing(self) -> str:
        """The sentence that says why the method cannot run here; empty if it can."""
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


class _Timed:
    """Calls `on_load` and counts the seconds that it takes."""

    def __init__(self, on_load: OnLoad) -> None:
        self.on_load = on_load
        self.seconds = 0.0

    def __call__(self, result: ContactResult) -> None:
        started = time.perf_counter()
        self.on_load(result)
        self.seconds += time.perf_counter() - started


def _persson(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    from epcontact import persson

    return persson.solve(scene, **options)


def _bem(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    if on_load is None:
        return bem.solve(scene, threads=threads, **options)
    timed = _Timed(on_load)
    result = bem.solve(scene, threads=threads, on_step=timed, **options)
    seconds = result.cost["seconds"] - timed.seconds
    return replace(result, cost={**result.cost, "seconds": seconds})


def _fem(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    started = time.perf_counter()
    compiled = compile_seconds()
    path = solve_path(scene, threads=threads, **options)
    result = contact_result(path)
    # Its own time ends before its last kernel may be compiled.
    seconds = time.perf_counter() - started - (compile_seconds() - compiled)
    if on_load is not None:
        for count in range(1, len(path.points) + 1):
            on_load(contact_result(replace(path, points=path.points[:count])))
    return replace(result, cost={**result.cost, "seconds": seconds})


def _peer(
    name: str,
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    solve = pkgutil.resolve_name(f"epcontact.peers.{name}")
    return solve_load_by_load(lambda scene, _: solve(scene), scene, on_load)


def _calculix(
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    from epcontact.peers import calculix

    result = calculix.solve(scene, options)
    if on_load is not None:  # its fields are those of the last load
        on_load(result)
    return result


def _foreign(
    name: str,
    source: str,
    scene: Scene,
    options: Mapping[str, Any],
    threads: int | None,
    on_load: OnLoad | None = None,
) -> ContactResult:
    end = time.monotonic() + options.get("limit", math.inf)

    def solve_last(scene: Scene, lowered: FloatArray | None) -> ContactResult:
        return foreign.solve(name, source, scene, end - time.monotonic(), lowered)

    return solve_load_by_load(solve_last, scene, on_load)


def _warm_up(solve: Solve, points: int, **options: Any) -> None:
    """Solve a scene with points apart, in elastic and in plastic contact."""
    x = 2 * np.pi * np.arange(points) / points
    heights = np.add.outer(np.cos(x), np.cos(3 * x))
    heights += np.random.default_rng(1).normal(0.0, 0.1, heights.shape)
    material = Material(1.0, 0.3, hardness=0.02, yield_stress=0.007)
    solve(Scene(Surface(1e-3 * heights, (1.0, 1.0)), material, Load(1e-3)), options, 1)


def _of_user(name: str, source: str) -> Method:
    """Return the method of a user's function or command, which its first solve
    loads.
    """
    return Method(
        name, f"the solver {source}", partial(_foreign, name, source), source=source
    )


_OWN = (
    Method(
        "persson",
        "Persson's multiscale theory with a pressure cap",
        _persson,
        "theory",
        has_fields=False,
    ),
    Method(
        "bem",
        "FFT boundary elements with a pressure cap",
        _bem,
        "bem",
        load_files="fields",
        memory=_grid_bytes,
        load=partial(_warm_up, _bem, 128),
    ),
    Method(
        "fem",
        "finite elements, elastic, with a pressure cap or with J2 flow",
        _fem,
        "fem",
        has_model_measures=True,
        load_files="bodies",
        memory=_block_bytes,
        load=partial(_warm_up, _fem, 8, layers=2),
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
    memory=_block_bytes,
    program="ccx",
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
    """Return what `--solver` names: a method, [NAME=]MODULE:FUNCTION or
    [NAME=]COMMAND.
    """
    if text in METHODS:
        return METHODS[text]
    named = re.match(r"([^\s:{=]*)=", text)
    source = text[named.end() :] if named else text
    command = foreign.is_command(source)
    name = named[1] if named else "command" if command else source.rpartition(":")[2]
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
