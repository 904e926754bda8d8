"""The solver is never lost: loads, hardnesses, surfaces, grids and bodies from end to end."""

import itertools
import math

import numpy as np
import pytest

from epcontact import bem
from epcontact.errors import InvalidScene
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

# Solves must end on steep and on stepped surfaces, too.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

E = 250e9
PERIOD = 2 * math.pi / 2.5e4
HARDNESSES = (1e-3, 1e-2, 0.1, 0.6, 3.0, 30.0)
SHARES = (1e-4, 0.01, 0.1, 0.5, 0.9, 0.99)
ELASTIC_LOADS = (1e-6, 1e-3, 0.05, 0.3, 1.0, 3.0, 1e3, 1e8)


def require_solved(heights, load, hardness, body=None, nu=0.0):
    """The residuals again, from the fields, with the largest count that the map has shown."""
    heights = np.asarray(heights)
    shape = heights.shape
    periods = tuple(PERIOD * n / max(shape) for n in shape)
    surface = Surface(heights, periods)
    material = Material(E, nu, hardness)
    result = bem.solve(Scene(surface, material, Load(load), body or Body()), threads=1)
    assert max(result.final.residuals.values()) <= 1e-8
    p, g, state = (result.fields[name] for name in ("pressure", "gap", "state"))
    assert p.mean() == pytest.approx(load, rel=1e-10)
    assert ((p > 0) & (p < hardness) == (state == 1)).all()
    assert g[state == 0].min(initial=0) >= -1e-8 * max(np.std(heights), load / E * PERIOD)
    # The worst of some two thousand scenes took 360 pairs, a line of white noise.
    assert result.cost["equivalent_fft_pairs"] < 1000
    return result


def rough(shape, points, seed=3):
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 2.5e4 * max(shape) / points, 1.0)
    return SelfAffine(spectrum, (PERIOD,) * len(shape), shape, seed).build().heights


@pytest.mark.parametrize("points", [2.2, 4, 16])
@pytest.mark.parametrize("shape", [(64, 64), (256,)])
def test_map_of_loads_and_hardnesses(shape, points):
    heights = rough(shape, points)
    for hardness, share in itertools.product(HARDNESSES, SHARES):
        require_solved(heights, share * hardness * E, hardness * E)
    for load in ELASTIC_LOADS:
        require_solved(heights, load * E, math.inf)


@pytest.mark.long
@pytest.mark.parametrize("points", [2.2, 4, 16])
def test_map_on_a_finer_grid(points):
    heights = rough((128, 128), points, seed=11)
    for hardness, share in itertools.product(HARDNESSES, SHARES):
        require_solved(heights, share * hardness * E, hardness * E)


def surfaces(shape):
    axes = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    square = sum((x - 0.5) ** 2 for x in axes)
    rng = np.random.default_rng(1)
    unit = PERIOD / 100
    return {
        "flat": np.ones(shape),
        "mode": unit * np.cos(2 * np.pi * axes[0]),
        "modes": unit * sum(np.cos(2 * np.pi * x) for x in axes),
        "sphere": -square * PERIOD / 10,
        "cone": -np.sqrt(square) * PERIOD / 10,
        "noise": rng.standard_normal(shape) * unit / 10,
        "ties": np.floor(rng.random(shape) * 3) * unit / 10,
        "plateau": np.where(square < 0.05, unit / 10, 0.0),
        "pit": np.where(square < 0.05, -unit / 10, 0.0),
        "spike": np.where(square == square.min(), unit, 0.0),
    }


def rms_slope(heights):
    spacing = PERIOD / max(heights.shape)
    steps = [(np.roll(heights, -1, k) - heights) / spacing for k in range(heights.ndim)]
    return max(math.sqrt(sum(float(np.mean(s**2)) for s in steps)), 1e-3)


@pytest.mark.parametrize(
    "shape", [(48, 48), (65, 63), (64, 16), (7, 100), (2, 2), (3, 2), (2, 64), (101,), (2,), (512,)]
)
def test_every_kind_of_surface_and_grid(shape):
    for heights in surfaces(shape).values():
        scale = rms_slope(heights) * E
        for load in (1e-3, 0.1, 2.0):
            require_solved(heights, load * scale, math.inf)
        for hardness, share in itertools.product((3e-3, 0.3, 5.0), (1e-2, 0.5, 0.99)):
            require_solved(heights, share * hardness * scale, hardness * scale)


@pytest.mark.parametrize(
    ("shape", "hardness", "load", "most"),
    [
        ((243, 243), 0.6, 0.05, 12),  # 9 measured
        ((251, 180), math.inf, 0.05, 12),  # 9
        ((256, 256), math.inf, 1.5, 15),  # 8, 99.9 % of the points elastic
        ((20011,), 0.6, 0.05, 45),
    ],
)
def test_awkward_sizes_and_full_contact_take_as_few_transforms(shape, hardness, load, most):
    result = require_solved(rough(shape, 4, seed=7), load * E, hardness * E)
    assert result.cost["fft_pairs"] <= most


@pytest.mark.parametrize("load", [0.1, 0.5, 1.5])
def test_white_noise_takes_few_transforms(load):
    heights = surfaces((256, 256))["noise"]
    result = require_solved(heights, load * rms_slope(heights) * E, math.inf)
    assert result.cost["fft_pairs"] <= 15  # 11, 10 and 10 measured


@pytest.mark.parametrize("ratio", [10, 1 / 30])
def test_oblong_spacings_take_few_transforms(ratio):
    """Rows that are 10 times as far apart as the points along them, and 30 times as near."""
    isotropic = rough((256, 256), 16, seed=5)
    surface = Surface(isotropic, (PERIOD * max(1, ratio), PERIOD * max(1, 1 / ratio)))
    result = bem.solve(Scene(surface, Material(E, 0.0, 0.6 * E), Load(0.01 * E)), threads=1)
    assert result.cost["fft_pairs"] <= 20


@pytest.mark.parametrize("power", [1.5, 0.5, 0.0, -1.0])
def test_any_gradual_compliance_converges(power):
    shape = (64, 64)
    q = np.hypot(np.fft.fftfreq(64, 1 / 64)[:, None], np.fft.rfftfreq(64, 1 / 64))
    q[0, 0] = 1.0
    for hardness in (math.inf, 0.6):
        solution = bem.solve_pressure(rough(shape, 4) / PERIOD, q**-power, 0.05, hardness)
        assert solution.counts["fft_pairs"] <= 40


@pytest.mark.parametrize("steep", [lambda q: q**-4.0, lambda q: np.exp(-5 * q)])
def test_a_compliance_that_falls_too_fast_is_refused(steep):
    q = np.hypot(np.fft.fftfreq(64, 1 / 64)[:, None], np.fft.rfftfreq(64, 1 / 64))
    q[0, 0] = 1.0
    with pytest.raises(InvalidScene, match=r"falls by a factor of .* along the first axis"):
        bem.solve_pressure(rough((64, 64), 4) / PERIOD, steep(q), 0.05)


@pytest.mark.parametrize("nu", [-0.9, 0.0, 0.3, 0.499])
@pytest.mark.parametrize(
    "body",
    [
        Body("bonded_layer", PERIOD / 5000),
        Body("bonded_layer", PERIOD / 50),
        Body("sliding_layer", PERIOD / 50),
        Body("sliding_layer", 5 * PERIOD),
    ],
)
def test_every_body(body, nu):
    heights = rough((64, 64), 4)
    for hardness, load in ((math.inf, 0.05), (0.6, 0.05), (0.6, 0.5), (math.inf, 3.0)):
        require_solved(heights, load * E, hardness * E, body, nu)


def test_energy_steps_are_reported_where_newton_fails():
    """A line of white noise near the middle of its load range makes plain steps overshoot."""
    heights = surfaces((512,))["noise"]
    hardness = 0.3 * rms_slope(heights) * E
    result = require_solved(heights, 0.5 * hardness, hardness)
    assert any("would have raised the energy" in note for note in result.notes)


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", PERIOD / 25600)])
@pytest.mark.parametrize("hardness", [1e-3, 1e-6])
def test_almost_rigid_bodies_take_no_more_steps_than_others(body, hardness):
    """Almost all points lie on a bound: they once traded places through two elastic ones, a
    hundred steps long, the more the finer the grid."""
    heights = rough((256, 256), 2.2)
    for share in (0.01, 0.3, 0.7):
        result = require_solved(heights, share * hardness * E, hardness * E, body, 0.3)
        assert result.final.iterations["newton"] <= 20  # 10 measured
