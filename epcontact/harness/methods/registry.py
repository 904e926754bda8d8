"""The registry of methods: every way to answer a scene, by the name that cases and gates use.

`METHODS` is the only list of the methods.  An entry holds a function that answers a scene and
what the rest of the package needs to know about it.  Entries come from three sources:

    the package's own   persson, bem and fem, below
    other codes         contact_mechanics and tamaas, with the extra `peers`
    the user's          entry points of the group `epcontact.methods`, and `--solver`
"""

from __future__ import annotations

import importlib.util
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import entry_points
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase, nearest
from epcontact.harness.methods import foreign, memory
from epcontact.machine import compile_seconds, provide_kernel_cache
from epcontact.results import ContactResult
from epcontact.scene import Load, Material, Scene, Surface

Solve = Callable[[Scene, Mapping[str, Any], int | None], ContactResult]


class Table(BaseModel):
    """A table of a case file: unknown keys and wrong types are errors."""

    # `defer_build`: a process that only solves checks no table, so that it needs no validators.
    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=True, defer_build=True
    )


class TheoryTable(Table):
    """[theory]: the parameters of Persson's theory that the scene does not hold."""

    energy_reduction: float = Field(gt=0, le=1, description="gamma, elastic energy reduction")
    reduction: Literal["constant", "persson", "wang_muser", "xu"] = Field(
        default="constant", description="how gamma turns into S(q) as the contact fills"
    )
    spectrum: Literal["analytic", "surface"] = Field(
        default="analytic", description="the spectrum drawn from, or each surface's own"
    )


class BemTable(Table):
    """[bem]: the options of the boundary elements."""

    tolerance: float = Field(default=1e-8, gt=0, description="on the KKT residuals, dimensionless")


EITHER_WAY = "give either steps or step_tolerance: equal increments, or chosen ones"


class FemTable(Table):
    """[fem]: the options of the finite elements."""

    law: Literal["elastic", "capped", "j2"] = Field(default="j2", description="material law")
    geometry: Literal["gap", "moved"] = Field(
        default="gap", description="roughness as gap over a flat block, or as moved top nodes"
    )
    depth: float | None = Field(default=None, gt=0, description="m; else chosen from the scene")
    layers: int | None = Field(default=None, ge=2, description="elements over the depth")
    tolerance: float | None = Field(
        default=None, gt=0, lt=1, description="on the residuals, dimensionless; else 1e-8"
    )
    steps: int | None = Field(
        default=None, ge=1, description="equal load increments to the largest pressure; else chosen"
    )
    step_tolerance: float = Field(
        default=0.03,
        gt=0,
        lt=1,
        description="of the increments of a J2 path: share of the force that shorter ones may move",
    )

    @model_validator(mode="after")
    def _one_way_to_choose_increments(self) -> FemTable:
        given = self.model_fields_set & {"steps", "step_tolerance"}
        if len(given) == 2:
            raise ValueError(EITHER_WAY)
        if "step_tolerance" in given and self.law != "j2":
            raise ValueError(f"step_tolerance is for law 'j2', but law is {self.law!r}")
        if "steps" in given and self.law == "elastic":
            raise ValueError(
                "steps has no effect on law 'elastic', which has no history; leave it out"
            )
        return self


def _never(options: Mapping[str, Any]) -> bool:
    del options
    return False


def _analytic(options: Mapping[str, Any]) -> bool:
    return bool(options["spectrum"] == "analytic")


def _nothing() -> None:
    """For a method that has nothing to load.  Unlike a lambda, this can be sent to a worker."""


@dataclass(frozen=True)
class Method:
    """One way to answer a scene.

    Attributes:
        name: its name in cases, gates, files of results and on the command line.
        meaning: its description in one line.
        solve: maps (scene, options, threads) to a ContactResult; threads None: all cores.
        table: name of the case file's table that holds the options; empty if there are none.
        options: schema of that table.  If one of its keys has no default, a case that names the
            method must give the table.
        has_fields: the result has fields on the grid of the surface.
        follows_unloading: the method can follow a path on which a capped law unloads.
        has_model_measures: gates can ask how the J2 flow of the method differs from a cap.
        steps: the keyword of its solve by which every load is written: `on_step`, a function that
            is called with a result of that load, or `output`, a folder for the deformed body;
            empty if it has none.
        tells_progress: its solve takes `progress`, called with a share that is done and a sentence.
        pilot: options of a quick solve, which only has to show the areas.
        one_answer: maps the options to True if one answer serves all surfaces of a case.
        memory: estimates the bytes of a solve, see `memory`.
        load: loads the modules and the compiled kernels of a solve, by a solve that takes no time.
        source: `module:function` or command of a solver from outside the package.  It runs in a
            process of its own.  The harness does not see changes of its code, so it never reuses
            a kept result of such a method.
        requires: a module of the extra `peers` that the method needs.
        modules: the modules that answer the scene; a kept result is used again only while they
            and all that they import are the same, see `foundation`.
    """

    name: str
    meaning: str
    solve: Solve
    table: str = ""
    options: type[Table] = Table
    has_fields: bool = True
    follows_unloading: bool = False
    has_model_measures: bool = False
    steps: Literal["", "on_step", "output"] = ""
    tells_progress: bool = False
    pilot: Mapping[str, Any] = field(default_factory=dict, hash=False)
    one_answer: Callable[[Mapping[str, Any]], bool] = _never
    memory: memory.Estimate = memory.of_surface
    load: Callable[[], None] = _nothing
    source: str = ""
    requires: str = ""
    modules: tuple[str, ...] = ()

    @property
    def plannable(self) -> bool:
        """True if a grid makes the method exact and its areas come with errors of their own."""
        return self.has_fields and not self.source

    @property
    def missing(self) -> str:
        """The sentence that says why the method cannot run here; empty if it can."""
        if not self.requires or importlib.util.find_spec(self.requires):
            return ""
        return f"{self.requires} is not installed; pip install 'epcontact[peers]' brings it"


# Solvers are loaded when they are called: their compiled kernels take a second to load, and most
# commands solve nothing.


def _persson(scene: Scene, options: Mapping[str, Any], threads: int | None) -> ContactResult:
    from epcontact import persson

    del threads  # closed forms
    return persson.solve(scene, **options)


def _bem(scene: Scene, options: Mapping[str, Any], threads: int | None) -> ContactResult:
    return bem.solve(scene, threads=threads, **options)


def _fem(scene: Scene, options: Mapping[str, Any], threads: int | None) -> ContactResult:
    provide_kernel_cache()  # fem_check must not import it
    started, compiled = time.perf_counter(), compile_seconds()
    result = fem_check.solve(scene, threads=threads, **options)
    # Its own time ends before its last kernel may be compiled.
    seconds = time.perf_counter() - started - (compile_seconds() - compiled)
    return replace(result, cost=dict(result.cost) | {"seconds": seconds})


def _load_bem() -> None:
    _bem(_small_scene(128), {}, 1)


def _load_fem() -> None:
    _fem(_small_scene(8), {"layers": 2}, 1)


def _small_scene(points: int) -> Scene:
    """Return a scene with points apart, in elastic and in plastic contact."""
    x = 2 * np.pi * np.arange(points) / points
    heights = np.add.outer(np.cos(x), np.cos(3 * x))
    heights += np.random.default_rng(1).normal(0.0, 0.1, heights.shape)
    material = Material(1.0, 0.3, hardness=0.02, yield_stress=0.007)
    return Scene(Surface(1e-3 * heights, (1.0, 1.0)), material, Load(1e-3))


def method_of(name: str, source: str, requires: str = "") -> Method:
    """Make a method that runs a user's function or command in a process of its own.

    Args:
        name: name of the method in cases and files of results.
        source: `package.module:function`, which maps a Scene to a ContactResult, or a command, see
            `exchange`.  It is loaded by the first solve, so that a broken solver spoils no other
            method.
        requires: see `Method`.

    Returns:
        The method; its `solve` raises what `foreign.solve` does.
    """
    meaning = f"the solver {source}"
    solve = partial(_foreign, name, source)
    return Method(name, meaning, solve, source=source, requires=requires)


def _foreign(
    name: str, source: str, scene: Scene, options: Mapping[str, Any], threads: int | None
) -> ContactResult:
    del options, threads
    return foreign.solve(name, source, scene)


def solver_named(text: str) -> Method:
    """Return the method that `--solver` names.

    Args:
        text: the name of a registered method, `[NAME=]MODULE:FUNCTION`, or a command with the
            placeholders {scene} and {result}, `[NAME=]COMMAND`.  Without a NAME the method is
            called like the function, or "command".

    Raises:
        InvalidCase: if the text is none of them, its name belongs to another method, or there is
            no such function or program.

    Example:
        >>> solver_named("mine=epcontact.bem:solve").name
        'mine'
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
        raise InvalidCase(f"--solver {text}: {name!r} is no name for a method; use letters")
    if name in METHODS:
        raise InvalidCase(
            f"--solver {text}: there is a method {name!r} already; give another name, as in "
            f"mine={source}"
        )
    foreign.require_solver(source)
    return method_of(name, source)


def _registry() -> dict[str, Method]:
    peers = "epcontact.harness.methods.peers"  # by its name, because it loads solvers
    own = [
        Method(
            "persson",
            "Persson's multiscale theory with a pressure cap",
            _persson,
            "theory",
            TheoryTable,
            has_fields=False,
            one_answer=_analytic,
            modules=("epcontact.persson",),
        ),
        Method(
            "bem",
            "FFT boundary elements with a pressure cap",
            _bem,
            "bem",
            BemTable,
            follows_unloading=True,
            steps="on_step",
            tells_progress=True,
            pilot={"area_tolerance": 1e-4},
            memory=memory.of_grid,
            load=_load_bem,
            modules=("epcontact.bem",),
        ),
        Method(
            "fem",
            "finite elements, elastic, with a pressure cap or with J2 flow",
            _fem,
            "fem",
            FemTable,
            follows_unloading=True,
            has_model_measures=True,
            steps="output",
            tells_progress=True,
            memory=memory.of_block,
            load=_load_fem,
            modules=("fem_check",),
        ),
        method_of("contact_mechanics", f"{peers}:contact_mechanics", "ContactMechanics"),
        method_of("tamaas", f"{peers}:tamaas", "tamaas"),
        replace(
            method_of("tamaas_j2", f"{peers}:tamaas_j2", "tamaas"),
            has_model_measures=True,
        ),
    ]
    plugins = [method_of(e.name, e.value) for e in entry_points(group="epcontact.methods")]
    return {method.name: method for method in (*plugins, *own)}


#: Every method by its name.
METHODS: dict[str, Method] = _registry()

#: The method that `--solver` replaces in the gates.
REPLACED = "bem"
