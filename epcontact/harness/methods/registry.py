"""The registry of methods: every way to answer a scene, by the name that cases and
gates use.

`METHODS` is the only list of the methods.  An entry holds a function that answers a
scene and what the rest of the package needs to know about it.  Entries come from three
sources:

    the package's own   persson, bem and fem, below
    other codes         contact_mechanics and tamaas, with the extra `peers`; CalculiX, a program
    the user's          entry points of the group `epcontact.methods`, and `--solver`
"""

from __future__ import annotations

import importlib.util
import math
import re
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import entry_points
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from epcontact import bem
from epcontact.bem.memory import bytes_per_point
from epcontact.errors import InvalidCase, nearest
from epcontact.harness.methods import foreign
from epcontact.machine import compile_seconds
from epcontact.materials.moduli import effective_modulus
from epcontact.results import ContactResult
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.surfaces import Recipe, SelfAffine
from fem_check.driver import solve_path
from fem_check.options import FemOptions, Geometry, LawName
from fem_check.result import contact_result

Solve = Callable[[Scene, Mapping[str, Any], int | None], ContactResult]
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
        name, meaning: its name in cases, files and commands, and its description in one
        line. solve: maps (scene, options, threads) to a ContactResult; threads None:
        all cores. table: name of the case file's table that holds the options; empty if
        there are none. has_fields: the result has fields on the grid of the surface.
        has_model_measures: gates can ask how the J2 flow of the method differs from a
        cap. steps: of a method that follows a path of loads, unloading included, and
        takes `progress`,
            called with a share that is done and a sentence, and `on_step`, a function
            that is called with a result of each load: "output" if it writes bodies into
            a folder itself.
        memory: estimates the bytes of a solve, beside the process and its libraries.
        load: loads the modules and the compiled kernels of a solve, by a solve that
            takes no time.
        requires: a module of the extra `peers` that the method needs.
        program: on the PATH that the method needs.
        source: `module:function` or command of a solver from outside the package.
    """

    name: str
    meaning: str
    solve: Solve
    table: str = ""
    has_fields: bool = True
    has_model_measures: bool = False
    steps: Literal["", "on_step", "output"] = ""
    memory: MemoryEstimate = _surface_bytes
    load: Callable[[], None] = _nothing
    requires: str = ""
    program: str = ""
    source: str = ""

    @property
    def plannable(self) -> bool:
        """True for the package's own methods on grids, whose grid a plan can choose."""
        return bool(self.steps)

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
        return f"{self.requires} is not installed; pip install 'epcontact[peers]' brings it"


# Solvers are loaded when they are called: their compiled kernels take a second to load,
# and most commands solve nothing.


def _persson(scene: Scene, options: Mapping[str, Any], _: int | None) -> ContactResult:
    from epcontact import persson

    return persson.solve(scene, **options)


def _bem(
    scene: Scene, options: Mapping[str, Any], threads: int | None
) -> ContactResult:
    return bem.solve(scene, threads=threads, **options)


def _fem(
    scene: Scene, options: Mapping[str, Any], threads: int | None
) -> ContactResult:
    started, compiled = time.perf_counter(), compile_seconds()
    own = {name: value for name, value in options.items() if name != "on_step"}
    path = solve_path(scene, threads=threads, **own)
    for last in range(len(path.points) if "on_step" in options else 0):
        options["on_step"](
            contact_result(replace(path, points=path.points[: last + 1]))
        )
    result = contact_result(path)
    # Its own time ends before its last kernel may be compiled.
    seconds = time.perf_counter() - started - (compile_seconds() - compiled)
    return replace(result, cost=dict(result.cost) | {"seconds": seconds})


def _peer(name: str, scene: Scene, *_: Any) -> ContactResult:
    from epcontact.harness.methods import peers

    answer: ContactResult = getattr(peers, name)(scene)
    return answer


def _calculix(scene: Scene, options: Mapping[str, Any], _: int | None) -> ContactResult:
    from epcontact.harness.methods import calculix

    return calculix.solve(scene, options)


def _foreign(
    name: str, source: str, scene: Scene, options: Any, *_: Any
) -> ContactResult:
    return foreign.solve(name, source, scene, **options)


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
        steps="on_step",
        memory=_grid_bytes,
        load=partial(_warm_up, _bem, 128),
    ),
    Method(
        "fem",
        "finite elements, elastic, with a pressure cap or with J2 flow",
        _fem,
        "fem",
        has_model_measures=True,
        steps="output",
        memory=_block_bytes,
        load=partial(_warm_up, _fem, 8, layers=2),
    ),
)
_PEERS = tuple(
    Method(
        name,
        f"the public solver {package}, {how}",
        partial(_peer, name),
        has_model_measures=name == "tamaas_j2",
        requires=package,
    )
    for name, package, how in (
        ("contact_mechanics", "ContactMechanics", "with a pressure cap"),
        ("tamaas", "tamaas", "with a pressure cap"),
        ("tamaas_j2", "tamaas", "with J2 flow by volume integrals"),
    )
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
            f"--solver is {text!r}, but must be [NAME=]MODULE:FUNCTION, a command with {{scene}} "
            f"and {{result}}, or the name of a method{nearest(text, METHODS)}"
        )
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise InvalidCase(
            f"--solver {text}: {name!r} is no name for a method; use letters"
        )
    if name in METHODS:
        raise InvalidCase(
            f"--solver {text}: there is a method {name!r} already; give another name, as in "
            f"mine={source}"
        )
    foreign.require_solver(source)
    return _of_user(name, source)
