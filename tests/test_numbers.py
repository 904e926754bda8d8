"""Every input that is a number: numpy's are as good as Python's, and anything else is
refused.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from epcontact import (
    Body,
    Load,
    Material,
    Scene,
    SelfAffineSpectrum,
    Surface,
    bem,
    persson,
    verify,
)
from epcontact.errors import EpcontactError, InvalidScene
from epcontact.materials.hardness_map import effective_hardness
from epcontact.surfaces import (
    HeightsFromArray,
    HeightsFromFile,
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
GRID = {"periods": (1.0,), "shape": (16,), "hurst": 0.8, "rms_slope": 0.1, **BAND}
SPECTRUM = SelfAffineSpectrum(0.8, **BAND, rms_slope=0.1)
METAL = partial(
    effective_hardness, young_modulus=210e9, yield_stress=1e9, mean_pressure=2.5e8
)
FEM = partial(fem_solve, SCENE, law="elastic")
MAP = partial(HeightsFromArray, np.array([0.0, 1.0, 0.0, -1.0]))
#: Functions, and good values of their numbers, of which each is replaced in turn.
NUMBERS: list[tuple[Callable[..., Any], dict[str, Any]]] = [
    (SelfAffineSpectrum, {"hurst": 0.5, **BAND, "rms_slope": 0.5}),
    (
        partial(Surface, WAVE),
        {"periods": (1.0,), "shortest_wavelength": 1.0, "seed": 3},
    ),
    (
        Material,
        {
            "young_modulus": 2.0,
            "poisson_ratio": 0.25,
            "hardness": 2.0,
            "yield_stress": 2.0,
            "hardening_modulus": 0.5,
        },
    ),
    (partial(Body, "bonded_layer"), {"depth": 2.0}),
    (Load, {"mean_pressure": (1.0, 2.0)}),
    (partial(Sinusoid, shape=(8,)), {"periods": (1.0,), "amplitude": 0.5, "waves": 2}),
    (partial(Sphere, (1.0,), (8,)), {"radius": 0.5, "centre": (0.5,)}),
    (MAP, {"periods": (1.0,), "longest_wavelength": 0.5}),
    (partial(SelfAffine, SPECTRUM, (1.0,)), {"shape": (16,), "seed": 3}),
    (partial(SelfAffineEnsemble, **GRID), {"seeds": (3,)}),
    (
        bem.Options,
        {"tolerance": 0.5, "area_tolerance": 0.5, "threads": 2, "max_steps": 2},
    ),
    (partial(filtered, SURFACE), {"wavenumber_high": 64.0, "wavenumber_low": 0.5}),
    (partial(FEM, layers=3), {"tolerance": 2**-20, "depth": 0.5}),
    (partial(FEM, layers=3), {"first_layer": 0.125, "approach": 2**-10}),
    (FEM, {"layers": 3, "steps": 1, "threads": 1}),
    (METAL, {"poisson_ratio": 0.25, "rms_slope": 0.25}),
]
#: None is no number, but it is "not given" for these.
OPTIONAL = {
    "shortest_wavelength",
    "longest_wavelength",
    "area_tolerance",
    "max_steps",
    "approach",
    "depth",
    "first_layer",
    "layers",
    "steps",
    "threads",
    "seed",
}


def words(made):
    """Return the repr of an object, which tells the types of its numbers.

    Of a result it holds steps, scene and options, but not times and memory.
    """
    if hasattr(made, "provenance"):
        return repr((made.steps, made.provenance.scene, made.provenance.options))
    return repr(made)


@pytest.mark.parametrize(
    ("make", "values", "name"),
    [(make, values, name) for make, values in NUMBERS for name in values],
)
def test_a_number_is_of_any_kind_or_refused_by_name(make, values, name):
    """An argument takes any kind of number that Python and numpy have, with the same
    result.

    Anything else raises InvalidScene with the name of the argument.

    `make` is a function or class, `values` are valid arguments, and `name` is the one
    that is replaced.
    """
    *others, good = values[name] if isinstance(values[name], tuple) else [values[name]]
    whole = isinstance(good, int)

    def made(number):
        """Build the object with another value of the argument; of several the last is
        replaced.
        """
        several = isinstance(values[name], tuple)
        return make(**values | {name: (*others, number) if several else number})

    real_kinds = (np.float16, np.float32, np.longdouble, np.array)
    for kind in (np.int64, np.uint8, np.array, float) if whole else real_kinds:
        assert words(made(kind(good))) == words(made(good))
    wrong = [True, np.True_, "1.0", b"1", 1j, [[good]], [None], math.nan, -math.inf]
    if name not in OPTIONAL:
        wrong.append(None)
    if whole:
        wrong.append(good + 0.5)
    message = rf"{name} is .*, but must be "
    for given in wrong:
        with pytest.raises(InvalidScene, match=message) as caught:
            made(given)
        assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            partial(Scene, SURFACE, SCENE.load, SCENE.material),
            "material is .*must be a Material",
        ),
        (
            partial(bem.solve, SCENE, start="none"),
            "start is 'none', but must be an array of real",
        ),
        (partial(bem.solve, SURFACE), r"scene is <Surface.*, but must be a Scene"),
        (
            partial(persson.solve, "x", energy_reduction=0.5),
            "scene is 'x', but must be a Scene",
        ),
        (
            partial(persson.analytic_roughness, SPECTRUM, 0),
            "bands is 0, but must be a whole",
        ),
        (
            partial(persson.pressure_curve, 1.0, 0.1, 1.0, 1),
            "points is 1, but must be a whole",
        ),
        (
            partial(Body, "half_space", "deep"),
            "depth is 'deep', .* a half_space takes no depth",
        ),
        (
            partial(Body, "bonded_layer", depth=10**400),
            "depth is 1000*, but must be a positive",
        ),
        (partial(HeightsFromFile, 3), "path is 3, but must be the path of a file"),
        (
            partial(Material, 1e200, 0.3),
            r"young_modulus is 1e\+200 Pa, .* between 1e-40 and",
        ),
        (
            partial(Surface, np.ones((4, 4)), (1.0,)),
            "periods has 1 lengths for heights of 2",
        ),
        (
            partial(SelfAffineSpectrum, 0.8, 2, 1, 4, 0.1),
            "wavenumber_high is needed, got 2, 1, 4",
        ),
        (partial(fem_solve, 3), "scene is 3, but must be a Scene"),
        (
            partial(Sphere, (1.0, 1.0), (8, 8), 0),
            "radius is 0, but must be a positive number in m$",
        ),
        (partial(verify, 3), "cases has 3, but must be names, paths or loaded cases"),
        (
            partial(verify, "bearing-area", jobs=0),
            "jobs is 0, but must be a whole number of at",
        ),
        (
            partial(verify, "bearing-area", fields="some"),
            "fields is 'some', .* one of none, first",
        ),
        (
            partial(verify, "bearing-area", precision="half"),
            "precision is 'half', .* of single, d",
        ),
    ],
)
def test_other_arguments(call, sentence, tmp_path, monkeypatch):
    """A `call` with an argument of a wrong type or range raises an error with
    `sentence`, and writes no file.
    """
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EpcontactError, match=sentence):
        call()
    assert not any(tmp_path.iterdir())
