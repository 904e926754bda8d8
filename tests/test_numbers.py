"""Every input that is a number: numpy's are as good as Python's, and anything else is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
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
SPECTRUM = SelfAffineSpectrum(0.8, 8.0, 16.0, 32.0, rms_slope=0.1)
BAND = {"wavenumber_low": 8.0, "wavenumber_roll_off": 16.0, "wavenumber_high": 32.0}
MAP = np.array([0.0, 1.0, 0.0, -1.0])
METAL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "yield_stress": 1e9}
METAL |= {"rms_slope": 0.1, "mean_pressure": 2.5e8}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("maps") / "map.npy"
    np.save(path, MAP)
    return str(path)


#: Functions of one number, by the name that a refusal must tell, and a good value.
REAL: list[tuple[str, Callable[[Any], Any], float]] = [
    ("hurst", lambda v: SelfAffineSpectrum(v, 1.0, 2.0, 4.0, 0.1), 0.5),
    ("wavenumber_low", lambda v: SelfAffineSpectrum(0.8, v, 2.0, 4.0, 0.1), 1.0),
    ("wavenumber_roll_off", lambda v: SelfAffineSpectrum(0.8, 1.0, v, 4.0, 0.1), 2.0),
    ("wavenumber_high", lambda v: SelfAffineSpectrum(0.8, 1.0, 2.0, v, 0.1), 4.0),
    ("rms_slope", lambda v: SelfAffineSpectrum(0.8, 1.0, 2.0, 4.0, v), 0.5),
    ("periods", lambda v: Surface(WAVE, (v,)), 1.0),
    ("shortest_wavelength", lambda v: Surface(WAVE, (1.0,), shortest_wavelength=v), 1.0),
    ("young_modulus", lambda v: Material(v, 0.0), 2.0),
    ("poisson_ratio", lambda v: Material(1.0, v), 0.25),
    ("hardness", lambda v: Material(1.0, 0.0, hardness=v), 2.0),
    ("yield_stress", lambda v: Material(1.0, 0.0, yield_stress=v), 2.0),
    ("depth", lambda v: Body("bonded_layer", v), 2.0),
    ("mean_pressure", Load, 2.0),
    ("mean_pressure", lambda v: Load((1.0, v)), 2.0),
    ("periods", lambda v: SelfAffine(SPECTRUM, (v,), (16,), 1), 1.0),
    ("amplitude", lambda v: Sinusoid((1.0,), (8,), v), 0.5),
    ("radius", lambda v: Paraboloid((1.0,), (8,), v), 0.5),
    ("radius", lambda v: Sphere((1.0,), (8,), v), 0.5),
    ("radius", lambda v: FlatPunch((1.0,), (8,), v, 1.0), 0.5),
    ("depth", lambda v: FlatPunch((1.0,), (8,), 0.25, v), 0.5),
    ("centre", lambda v: Sphere((1.0,), (8,), 0.5, (v,)), 0.5),
    ("periods", lambda v: HeightsFromArray(MAP, (v,)), 1.0),
    ("taper", lambda v: HeightsFromArray(MAP, (1.0,), taper=v), 0.25),
    ("longest_wavelength", lambda v: HeightsFromArray(MAP, (1.0,), longest_wavelength=v), 0.5),
    ("shortest_wavelength", lambda v: HeightsFromArray(MAP, (1.0,), shortest_wavelength=v), 0.5),
    ("tolerance", lambda v: bem.Options(tolerance=v), 0.5),
    ("area_tolerance", lambda v: bem.Options(area_tolerance=v), 0.5),
    ("energy_reduction", persson.EnergyReduction, 0.5),
    ("wavenumber_high", lambda v: filtered(SURFACE, v), 64.0),
    ("wavenumber_low", lambda v: filtered(SURFACE, 64.0, v), 0.5),
    ("tolerance", lambda v: fem_solve(SCENE, law="elastic", layers=3, tolerance=v), 2**-20),
    ("step_tolerance", lambda v: fem_solve(SCENE, law="elastic", layers=3, step_tolerance=v), 0.5),
    ("hardening", lambda v: fem_solve(SCENE, law="elastic", layers=3, hardening=v), 0.5),
    ("depth", lambda v: fem_solve(SCENE, law="elastic", layers=3, depth=v), 0.5),
    ("first_layer", lambda v: fem_solve(SCENE, law="elastic", layers=3, first_layer=v), 0.125),
    ("approach", lambda v: fem_solve(SCENE, law="elastic", layers=3, approach=v), 2**-10),
    ("poisson_ratio", lambda v: effective_hardness(**METAL | {"poisson_ratio": v}), 0.25),
    ("rms_slope", lambda v: effective_hardness(**METAL | {"rms_slope": v}), 0.25),
]
WHOLE: list[tuple[str, Callable[[Any], Any], int]] = [
    ("seed", lambda v: Surface(WAVE, (1.0,), seed=v), 3),
    ("seed", lambda v: SelfAffine(SPECTRUM, (1.0,), (16,), v), 3),
    ("shape", lambda v: SelfAffine(SPECTRUM, (1.0,), (v,), 1), 16),
    (
        "seeds",
        lambda v: SelfAffineEnsemble(
            periods=(1.0,), shape=(16,), hurst=0.8, rms_slope=0.1, seeds=(v,), **BAND
        ),
        3,
    ),
    ("waves", lambda v: Sinusoid((1.0,), (8,), 0.5, v), 2),
    ("threads", lambda v: bem.Options(threads=v), 2),
    ("max_steps", lambda v: bem.Options(max_steps=v), 2),
    ("layers", lambda v: fem_solve(SCENE, law="elastic", layers=v), 3),
    ("steps", lambda v: fem_solve(SCENE, law="elastic", layers=3, steps=v), 1),
    ("threads", lambda v: fem_solve(SCENE, law="elastic", layers=3, threads=v), 1),
]
#: None is no number, but it is "not given" for these.
OPTIONAL = {
    *("shortest_wavelength", "longest_wavelength", "area_tolerance", "max_steps", "approach"),
    *("depth", "first_layer", "layers", "steps", "threads", "seed"),
}


@pytest.mark.parametrize(("name", "make", "good"), [*REAL, *WHOLE])
def test_what_is_no_number_is_refused_by_name(
    name: str, make: Callable[[Any], Any], good: float
) -> None:
    wrong = [True, np.True_, "1.0", b"1", 1j, [[good]], [None], math.nan, -math.inf]
    for given in wrong if name in OPTIONAL else [*wrong, None]:
        with pytest.raises(InvalidScene, match=rf"{name} is .*, but must be ") as caught:
            make(given)
        assert len(str(caught.value)) < 200


@pytest.mark.parametrize(("name", "make", "good"), REAL)
def test_reals_of_numpy_are_those_of_python(
    name: str, make: Callable[[Any], Any], good: float
) -> None:
    expected = words(make(good))
    for kind in (np.float32, np.float64, np.float16, np.longdouble):
        assert words(make(kind(good))) == expected
    assert words(make(np.array(good))) == expected
    if good == int(good):
        assert words(make(np.int64(good))) == words(make(int(good))) == expected


@pytest.mark.parametrize(("name", "make", "good"), WHOLE)
def test_whole_numbers_of_numpy_are_those_of_python(
    name: str, make: Callable[[Any], Any], good: int
) -> None:
    expected = words(make(good))
    for kind in (np.int64, np.uint8, np.array, float):
        assert words(make(kind(good))) == expected
    with pytest.raises(InvalidScene, match=f"{name} is {good + 0.5}, but must be a whole number"):
        make(good + 0.5)


def words(made: Any) -> str:
    """What was made, with the types of its numbers, and without times and memory."""
    if hasattr(made, "provenance"):
        return repr((made.steps, made.provenance.scene, made.provenance.options))
    return repr(made)


def test_large_seeds_keep_their_digits() -> None:
    assert SelfAffine(SPECTRUM, (1.0,), (16,), 2**63 + 1).seed == 2**63 + 1


def test_maps_of_files_take_numbers_of_numpy(stored: str) -> None:
    plain = HeightsFromFile(stored, 1.0, unit=2.0)
    assert (
        HeightsFromFile(stored, np.array([1.0]), unit=np.float32(2)).fingerprint
        == plain.fingerprint
    )
    assert HeightsFromFile(stored, unit=1.0, pixel_size=np.float32(0.25)).periods == (1.0,)
    for name in ("unit", "pixel_size"):
        with pytest.raises(InvalidScene, match=f"{name} is True, but must be a positive number"):
            HeightsFromFile(stored, **{"unit": 1.0} | {name: True})


def test_parts_of_a_scene_in_the_place_of_others() -> None:
    with pytest.raises(InvalidScene, match=r"material is Load\(.*, but must be a Material"):
        Scene(SURFACE, SCENE.load, SCENE.material)  # type: ignore[arg-type]
    with pytest.raises(InvalidScene, match="spectrum is 'analytic', but must be a SelfAffine"):
        SelfAffine("analytic", (1.0,), (16,), 1)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["compliance", "start", "plastic_displacement"])
def test_fields_that_are_no_numbers(name: str) -> None:
    with pytest.raises(InvalidScene, match=f"{name} is 'none', but must be an array of numbers"):
        bem.solve(SCENE, **{name: "none"})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: bem.solve(SURFACE), r"scene is Surface\(.*, but must be a Scene"),
        (lambda: fem_solve(None), "scene is None, but must be a Scene"),
        (lambda: persson.solve("x", energy_reduction=0.5), "scene is 'x', but must be a Scene"),
        (lambda: filtered(WAVE, 1.0), "surface is array.*, but must be a Surface"),
        (lambda: persson.analytic_roughness("x"), "spectrum is 'x', but must be a SelfAffine"),
        (lambda: persson.analytic_roughness(SPECTRUM, 0), "bands is 0, but must be a whole"),
        (lambda: persson.pressure_curve(1.0, 0.1, 1.0, 1), "points is 1, but must be a whole"),
        (lambda: persson.gamma_columns("a", 0.1), "full_contact_diffusion is 'a', but must be an"),
        (lambda: persson.gamma_columns(1.0, 0.1, 1.0, [[0.5]]), "energy_reduction is array"),
        (lambda: persson.areas([1.0, 2.0], [0.1, 0.2, 0.3]), r"diffusion \(2,\) and .* do not fit"),
        (lambda: Body("half_space", "deep"), "depth is 'deep', .* a half_space takes no depth"),
        (lambda: HeightsFromFile(3), "path is 3, but must be the path of a file"),
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
        ({"jobs": "2"}, "jobs is '2', but"),
        ({"fields": "some"}, "fields is 'some', but must be one of none, first, all, steps"),
        ({"precision": "half"}, "precision is 'half', but must be one of single, double"),
    ],
)
def test_options_of_the_main_job(given: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    with pytest.raises(EpcontactError, match=sentence):
        verify(**{"cases": "bearing-area", "output": tmp_path} | given)
    assert not any(tmp_path.iterdir())
