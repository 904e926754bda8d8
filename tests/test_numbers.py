"""Every input that is a number: numpy's are as good as Python's, and anything else is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from epcontact import Body, Load, Material, Scene, SelfAffineSpectrum, Surface, bem, persson, verify
from epcontact.errors import EpcontactError, InvalidScene
from epcontact.materials.hardness_map import effective_hardness
from epcontact.surfaces import (
    FlatPunch,
    HeightsFromArray,
    HeightsFromFile,
    Paraboloid,
    SelfAffine,
    SelfAffineEnsemble,
    Sinusoid,
    Sphere,
    filtered,
)
from fem_check import solve as fem_solve

WAVE = np.cos(2 * np.pi * np.arange(16) / 16) / 100
SURFACE = Surface(WAVE, (1.0,))
SCENE = Scene(SURFACE, Material(1.0, 0.0, hardness=1.0, yield_stress=1.0), Load(0.01))
BAND = {"wavenumber_low": 8.0, "wavenumber_roll_off": 16.0, "wavenumber_high": 32.0}
SPECTRUM = SelfAffineSpectrum(0.8, **BAND, rms_slope=0.1)
MAP = np.array([0.0, 1.0, 0.0, -1.0])
METAL = {"young_modulus": 210e9, "yield_stress": 1e9, "mean_pressure": 2.5e8}
FEM = partial(fem_solve, SCENE, law="elastic")
ROUGH = partial(SelfAffineEnsemble, periods=(1.0,), shape=(16,), hurst=0.8, rms_slope=0.1, **BAND)
#: Functions, and good values of their numbers, of which each is replaced in turn.
REAL: list[tuple[Callable[..., Any], dict[str, Any]]] = [
    (SelfAffineSpectrum, {"hurst": 0.5, **BAND, "rms_slope": 0.5}),
    (partial(Surface, WAVE), {"periods": (1.0,), "shortest_wavelength": 1.0}),
    (Material, {"young_modulus": 2.0, "poisson_ratio": 0.25, "hardness": 2.0, "yield_stress": 2.0}),
    (partial(Body, "bonded_layer"), {"depth": 2.0}),
    (Load, {"mean_pressure": (1.0, 2.0)}),
    (partial(Sinusoid, shape=(8,)), {"periods": (1.0,), "amplitude": 0.5}),
    (partial(Paraboloid, (1.0,), (8,)), {"radius": 0.5}),
    (partial(Sphere, (1.0,), (8,)), {"radius": 0.5, "centre": (0.5,)}),
    (partial(FlatPunch, (1.0,), (8,)), {"radius": 0.25, "depth": 0.5}),
    (partial(HeightsFromArray, MAP), {"periods": (1.0,), "taper": 0.25}),
    (partial(HeightsFromArray, MAP, (1.0,)), {"longest_wavelength": 0.5}),
    (partial(HeightsFromArray, MAP, (1.0,)), {"shortest_wavelength": 0.5}),
    (bem.Options, {"tolerance": 0.5, "area_tolerance": 0.5}),
    (partial(filtered, SURFACE), {"wavenumber_high": 64.0, "wavenumber_low": 0.5}),
    (partial(FEM, layers=3), {"tolerance": 2**-20, "hardening": 0.5, "depth": 0.5}),
    (partial(FEM, layers=3), {"step_tolerance": 0.5}),
    (partial(FEM, layers=3), {"first_layer": 0.125, "approach": 2**-10}),
    (partial(effective_hardness, **METAL), {"poisson_ratio": 0.25, "rms_slope": 0.25}),
]
WHOLE: list[tuple[Callable[..., Any], dict[str, Any]]] = [
    (partial(Surface, WAVE, (1.0,)), {"seed": 3}),
    (partial(SelfAffine, SPECTRUM, (1.0,)), {"shape": (16,), "seed": 3}),
    (ROUGH, {"seeds": (3,)}),
    (partial(Sinusoid, (1.0,), (8,), 0.5), {"waves": 2}),
    (bem.Options, {"threads": 2, "max_steps": 2}),
    (FEM, {"layers": 3, "steps": 1, "threads": 1}),
]
#: None is no number, but it is "not given" for these.
OPTIONAL = {
    *("shortest_wavelength", "longest_wavelength", "area_tolerance", "max_steps", "approach"),
    *("depth", "first_layer", "layers", "steps", "threads", "seed"),
}


def replaced(make: Callable[..., Any], values: dict[str, Any], name: str, value: Any) -> Any:
    """Make something of another number: of several the last is replaced."""
    good = values[name]
    return make(**values | {name: (*good[:-1], value) if isinstance(good, tuple) else value})


def each(made: list[tuple[Callable[..., Any], dict[str, Any]]]) -> list[Any]:
    """The name of each number, what makes something of another one in its place, and its value."""
    return [
        (name, partial(replaced, make, values, name), good[-1] if isinstance(good, tuple) else good)
        for make, values in made
        for name, good in values.items()
    ]


@pytest.mark.parametrize(("name", "make", "good"), [*each(REAL), *each(WHOLE)])
def test_what_is_no_number_is_refused_by_name(name: str, make: Any, good: float) -> None:
    wrong = [True, np.True_, "1.0", b"1", 1j, [[good]], [None], math.nan, -math.inf]
    for given in wrong if name in OPTIONAL else [*wrong, None]:
        with pytest.raises(InvalidScene, match=rf"{name} is .*, but must be ") as caught:
            make(given)
        assert len(str(caught.value)) < 200


@pytest.mark.parametrize(("name", "make", "good"), each(REAL))
def test_reals_of_numpy_are_those_of_python(name: str, make: Any, good: float) -> None:
    expected = words(make(good))
    for kind in (np.float32, np.float64, np.float16, np.longdouble, np.array):
        assert words(make(kind(good))) == expected
    if good == int(good):
        assert words(make(np.int64(good))) == words(make(int(good))) == expected


@pytest.mark.parametrize(("name", "make", "good"), each(WHOLE))
def test_whole_numbers_of_numpy_are_those_of_python(name: str, make: Any, good: int) -> None:
    expected = words(make(good))
    for kind in (np.int64, np.uint8, np.array, float):
        assert words(make(kind(good))) == expected
    with pytest.raises(InvalidScene, match=f"{name} is {good + 0.5}, but must be a whole number"):
        make(good + 0.5)


def words(made: Any) -> str:
    """Return what was made, with the types of its numbers, and without times and memory."""
    if hasattr(made, "provenance"):
        return repr((made.steps, made.provenance.scene, made.provenance.options))
    return repr(made)


def test_large_seeds_keep_their_digits() -> None:
    assert SelfAffine(SPECTRUM, (1.0,), (16,), 2**63 + 1).seed == 2**63 + 1


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: Scene(SURFACE, SCENE.load, SCENE.material), "material is .*must be a Material"),
        (lambda: SelfAffine("analytic", (1.0,), (16,), 1), "'analytic', but must be a SelfAffine"),
        (lambda: bem.solve(SCENE, start="none"), "start is 'none', but must be an array of numb"),
        (lambda: bem.solve(SURFACE), r"scene is Surface\(.*, but must be a Scene"),
        (lambda: fem_solve(None), "scene is None, but must be a Scene"),
        (lambda: persson.solve("x", energy_reduction=0.5), "scene is 'x', but must be a Scene"),
        (lambda: filtered(WAVE, 1.0), "surface is array.*, but must be a Surface"),
        (lambda: persson.analytic_roughness("x"), "spectrum is 'x', but must be a SelfAffine"),
        (lambda: persson.analytic_roughness(SPECTRUM, 0), "bands is 0, but must be a whole"),
        (lambda: persson.pressure_curve(1.0, 0.1, 1.0, 1), "points is 1, but must be a whole"),
        (lambda: persson.gamma_columns("a", 0.1), "full_contact_diffusion is 'a', but must be an"),
        (lambda: persson.EnergyReduction(True), "energy_reduction is True, but must be "),
        (lambda: persson.gamma_columns(1.0, 0.1, 1.0, [[0.5]]), "energy_reduction is array"),
        (lambda: persson.areas([1.0, 2.0], [0.1, 0.2, 0.3]), r"diffusion \(2,\) and .* do not fit"),
        (lambda: Body("half_space", "deep"), "depth is 'deep', .* a half_space takes no depth"),
        (lambda: HeightsFromFile(3), "path is 3, but must be the path of a file"),
        (lambda: HeightsFromFile("x", unit=True), "unit is True, but must be a positive number"),
    ],
)
def test_other_arguments(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(InvalidScene, match=sentence):
        call()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"cases": 3}, "cases has 3, but must be names, paths or loaded cases"),
        ({"cases": ["bearing-area", None]}, "cases has None, but"),
        ({"jobs": 0}, "jobs is 0, but must be a whole number of at least 1"),
        ({"fields": "some"}, "fields is 'some', but must be one of none, first, all, steps"),
        ({"precision": "half"}, "precision is 'half', but must be one of single, double"),
    ],
)
def test_options_of_the_main_job(given: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    with pytest.raises(EpcontactError, match=sentence):
        verify(**{"cases": "bearing-area", "output": tmp_path} | given)
    assert not any(tmp_path.iterdir())
