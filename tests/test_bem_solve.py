"""The capped contact problem by boundary elements: exact properties, few transforms,
all scenes.
"""

import itertools
import math
import re
import tracemalloc

import numpy as np
import psutil
import pytest

from epcontact import bem
from epcontact.bem import driver, solve_pressure
from epcontact.bem.baselines import BASELINES
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.bem.memory import bytes_per_point
from epcontact.errors import InvalidScene, NotConverged, NotEnoughMemory
from epcontact.machine import forget_peak, peak_memory
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

# Solves must end on steep and on stepped surfaces, too.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

E = 250e9
PERIOD = 2 * math.pi / 2.5e4
HARDNESS = 0.6 * E
LOAD = 0.05 * E
CAPS = pytest.mark.parametrize("hardness", [HARDNESS, math.inf])


def rough(shape=(64, 64), seed=7, points=4.0, slope=1.0):
    high = 2.5e4 * max(shape) / points
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, high, slope)
    return SelfAffine(spectrum, (PERIOD,) * len(shape), shape, seed).build().heights


def scene(heights, load=LOAD, hardness=HARDNESS, body=None, periods=None, nu=0.0):
    surface = Surface(heights, periods or (PERIOD,) * heights.ndim)
    return Scene(surface, Material(E, nu, hardness), Load(load), body or Body())


def solve(*args, tolerance=1e-9, threads=1, start=None, **options):
    return bem.solve(
        scene(*args, **options), tolerance=tolerance, threads=threads, start=start
    )


def require_kkt(result, hardness):
    """The conditions of the minimum, from the fields alone."""
    h, p, g, state = (
        result.fields[name] for name in ("heights", "pressure", "gap", "state")
    )
    assert p.min() >= 0
    assert p.max() <= hardness
    scale = 1e-8 * max(np.std(h), result.final.mean_pressure / E * PERIOD)
    assert np.abs(g[state == ELASTIC]).max(initial=0) <= scale
    assert g[state == APART].min(initial=0) >= -scale
    assert g[state == PLASTIC].max(initial=0) <= scale
    assert (p[state == APART] == 0).all()
    assert (p[state == PLASTIC] == hardness).all()
    assert ((p > 0) & (p < hardness) == (state == ELASTIC)).all()
    assert p.mean() == pytest.approx(result.final.mean_pressure, rel=1e-10)


def require_same(result, other, tolerance=1e-6 * E):
    assert (
        np.abs(result.fields["pressure"] - other.fields["pressure"]).max() < tolerance
    )


@pytest.mark.parametrize("share", [0.08, 0.5, 0.97])
@pytest.mark.parametrize("shape", [(64, 64), (65, 48), (200,)])
def test_particle_hole_symmetry(shape, share):
    """(h, p0) -> (-h, hardness - p0) maps p to hardness - p and g to -g."""
    heights = rough(shape)
    this, that = (
        solve(heights, share * HARDNESS),
        solve(-heights, (1 - share) * HARDNESS),
    )
    require_kkt(this, HARDNESS)
    # A gap error of 1e-9 h_rms is worth a pressure of about E* pi/(2 dx) 1e-9 h_rms.
    assert (
        np.abs(this.fields["pressure"] + that.fields["pressure"] - HARDNESS).max()
        < 1e-6 * E
    )
    assert np.abs(this.fields["gap"] + that.fields["gap"]).max() < 1e-8 * np.std(
        heights
    )


def test_what_moves_the_surface_moves_the_pressure_and_no_more():
    heights = rough()
    reference = solve(heights)
    for move in (
        lambda a: np.roll(a, (5, -9), (0, 1)),
        np.rot90,
        np.flipud,
        np.transpose,
    ):
        moved = solve(np.ascontiguousarray(move(heights))).fields["pressure"]
        assert np.abs(moved - move(reference.fields["pressure"])).max() < 1e-6 * E
    # A datum of 0.25 m costs the heights themselves 3e-17 m of 2e-6 m.
    require_same(solve(heights + 0.25), reference, 1e-5 * E)
    # Areas depend on p0/(E* xi) and hardness/(E* xi) alone; pressures scale with E* xi.
    for length, slope, stress in ((1e3, 1.0, 1e-6), (1.0, 1e-3, 1e-3)):
        surface = Surface(heights * length * slope, (PERIOD * length,) * 2)
        material = Material(E * stress / slope, 0.0, HARDNESS * stress)
        scaled = bem.solve(
            Scene(surface, material, Load(LOAD * stress)), tolerance=1e-9
        )
        difference = scaled.fields["pressure"] / stress - reference.fields["pressure"]
        assert np.abs(difference).max() < 1e-6 * E


def test_a_cap_that_is_not_reached_and_any_start_change_nothing():
    heights = rough()
    elastic = solve(heights, hardness=math.inf)
    require_same(
        elastic, solve(heights, hardness=10 * elastic.fields["pressure"].max())
    )
    reference, rng = solve(heights), np.random.default_rng(3)
    spikes = np.where(rng.random(heights.shape) > 0.9, 1e9 * E, -1.0)
    for start in (np.zeros_like(heights), rng.random(heights.shape) * E, spikes):
        require_same(solve(heights, start=start), reference)


def test_same_call_same_bits_whatever_the_threads():
    """The grid is large enough for the transforms' library to use threads of its
    own.
    """
    heights = rough((600, 1000))
    first, again, parallel = solve(heights), solve(heights), solve(heights, threads=2)
    for other in (again, parallel):
        np.testing.assert_array_equal(
            first.fields["pressure"], other.fields["pressure"]
        )
        assert first.final.residuals == other.final.residuals


@CAPS
@pytest.mark.parametrize("shape", [(48, 40), (90,)])
@pytest.mark.parametrize("method", BASELINES)
def test_classic_methods_find_the_same_minimum(method, hardness, shape):
    problem = scene(rough(shape, 5, points=max(shape) / 10), hardness=hardness)
    newton = bem.solve(problem, threads=1, tolerance=1e-9)
    other = bem.solve(problem, threads=1, tolerance=1e-7, method=method)
    assert other.provenance.options["method"] == method
    assert max(other.final.residuals.values()) <= 1e-7
    # A gap error of 1e-7 h_rms is worth E* pi/(2 dx) 1e-7 h_rms = 3e-7 E* of pressure
    # at most.
    require_same(other, newton)
    assert other.final.areas["raw"] == newton.final.areas["raw"]
    with pytest.raises(
        NotConverged, match=f"{method} did not reach 1e-08 in 4 steps"
    ) as caught:
        bem.solve(problem, threads=1, method=method, max_steps=4)
    assert len(caught.value.history) == 5


@CAPS
@pytest.mark.parametrize("points", [4, 16])
def test_area_tolerance_ends_sooner_with_the_same_areas(points, hardness):
    surface = scene(rough((256, 256), points=points), hardness=hardness)
    full = bem.solve(surface, threads=1)
    for tolerance in (1e-2, 1e-3, 1e-4):
        early = bem.solve(surface, threads=1, area_tolerance=tolerance)
        assert early.cost["equivalent_fft_pairs"] < full.cost["equivalent_fft_pairs"]
        chosen = {"method": "newton", "tolerance": 1e-8, "area_tolerance": tolerance}
        assert early.provenance.options == chosen
        exact = pytest.approx(vars(full.final.areas["raw"]), rel=tolerance)
        assert vars(early.final.areas["raw"]) == exact


def require_solved(heights, load, hardness=math.inf, body=None, nu=0.0, periods=None):
    """The residuals again, from the fields, with the largest count that the map has
    shown.
    """
    periods = periods or tuple(PERIOD * n / max(heights.shape) for n in heights.shape)
    result = bem.solve(scene(heights, load, hardness, body, periods, nu), threads=1)
    assert max(result.final.residuals.values()) <= 1e-8
    require_kkt(result, hardness)
    # The worst of some two thousand scenes took 360 pairs, a line of white noise.
    assert result.cost["equivalent_fft_pairs"] < 1000
    return result


def noise(shape):
    return np.random.default_rng(1).standard_normal(shape) * PERIOD / 1000


#: Heights, load, hardness, periods, most pairs and equivalent pairs; the numbers
#: measured.
AWKWARD = {
    "four points a wave": (
        rough((512, 512)),
        0.05,
        0.6,
        None,
        11,
        28,
    ),  # 7 to 9, 16 to 25
    "many points a wave": (rough((256, 256), points=16), 0.05, 0.6, None, 11, 28),
    "odd": (rough((243, 243)), 0.05, 0.6, None, 12, 40),  # 9
    "full": (
        rough((256, 256)),
        1.5,
        math.inf,
        None,
        15,
        40,
    ),  # 8, 99.9 % of the points elastic
    "line": (rough((20011,)), 0.05, 0.6, None, 45, math.inf),
    # They took 415 where a direction of fewer than 64 points had no cells; 60 to 90
    # since.
    "thin": (rough((1024, 1024))[:32], 0.05, 0.6, None, math.inf, 130),
    "rows far apart": (
        rough((256, 256), 5, 16),
        0.01,
        0.6,
        (10 * PERIOD, PERIOD),
        20,
        1000,
    ),
    "noise": (noise((256, 256)), 0.5, math.inf, None, 15, 1000),  # 10
}


@pytest.mark.parametrize("name", AWKWARD)
def test_few_transforms_whatever_the_roughness_the_grid_and_the_load(name):
    heights, load, hardness, periods, pairs, equivalent = AWKWARD[name]
    result = require_solved(heights, load * E, hardness * E, periods=periods)
    assert result.cost["fft_pairs"] <= pairs
    assert result.cost["equivalent_fft_pairs"] <= equivalent


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", PERIOD / 25600)])
@pytest.mark.parametrize("hardness", [1e-3, 1e-6])
def test_almost_rigid_bodies_take_no_more_steps_than_others(body, hardness):
    """Almost all points lie on a bound: they once traded places through two elastic
    ones, a hundred steps long, the more the finer the grid.
    """
    for share in (0.01, 0.3, 0.7):
        heights = rough((256, 256), 3, 2.2)
        result = require_solved(heights, share * hardness * E, hardness * E, body, 0.3)
        assert result.final.iterations["newton"] <= 20  # 10 measured


def surfaces(shape):
    axes = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    square = sum((x - 0.5) ** 2 for x in axes)
    unit = PERIOD / 100
    return {
        "flat": np.ones(shape),
        "mode": unit * np.cos(2 * np.pi * axes[0]),
        "modes": unit * sum(np.cos(2 * np.pi * x) for x in axes),
        "sphere": -square * PERIOD / 10,
        "cone": -np.sqrt(square) * PERIOD / 10,
        "noise": noise(shape),
        "ties": np.floor(np.random.default_rng(1).random(shape) * 3) * unit / 10,
        "plateau": np.where(square < 0.05, unit / 10, 0.0),
        "pit": np.where(square < 0.05, -unit / 10, 0.0),
        "spike": np.where(square == square.min(), unit, 0.0),
    }


def rms_slope(heights):
    steps = [np.roll(heights, -1, axis) - heights for axis in range(heights.ndim)]
    return max(
        math.sqrt(np.mean(np.square(steps).sum(axis=0))) * max(heights.shape) / PERIOD,
        1e-3,
    )


SHAPES = (
    (48, 48),
    (65, 63),
    (64, 16),
    (7, 100),
    (2, 2),
    (3, 2),
    (2, 64),
    (101,),
    (2,),
    (512,),
)


@pytest.mark.parametrize("shape", SHAPES)
def test_every_kind_of_surface_and_grid(shape):
    for heights in surfaces(shape).values():
        scale = rms_slope(heights) * E
        for load in (1e-3, 0.1, 2.0):
            require_solved(heights, load * scale)
        for hardness, share in itertools.product((3e-3, 0.3, 5.0), (1e-2, 0.5, 0.99)):
            require_solved(heights, share * hardness * scale, hardness * scale)


def test_energy_steps_are_reported_where_newton_fails():
    """A line of white noise near the middle of its load range makes plain steps
    overshoot.
    """
    hardness = 0.3 * rms_slope(noise((512,))) * E
    found = require_solved(noise((512,)), 0.5 * hardness, hardness)
    (note,) = (note for note in found.notes if "raised the energy" in note)
    cut, *counted = map(int, re.findall(r"\d+", note))
    assert counted == [found.final.iterations[name] for name in ("newton", "gradient")]
    assert 0 < cut < counted[0]
    assert note == (
        f"{cut} of {counted[0]} Newton steps would have raised the energy and were cut "
        f"short; {counted[1]} projected gradient steps followed them."
    )


@pytest.mark.parametrize("power", [1.5, 0.5, 0.0, -1.0])
def test_any_gradual_compliance_converges(power):
    q = np.hypot(np.fft.fftfreq(64, 1 / 64)[:, None], np.fft.rfftfreq(64, 1 / 64))
    q[0, 0] = 1.0
    for hardness in (math.inf, 0.6):
        solution = solve_pressure(rough(seed=3) / PERIOD, q**-power, 0.05, hardness)
        assert solution.counts["fft_pairs"] <= 40
    for steep in (q**-4.0, np.exp(-5 * q)):
        with pytest.raises(
            InvalidScene, match=r"falls by a factor of .* along the first axis"
        ):
            solve_pressure(rough(seed=3) / PERIOD, steep, 0.05)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "method is 'magic'"),
        ({"start": np.zeros((3, 3))}, "start has shape"),
        ({"compliance": np.ones((64, 64))}, "compliance has shape"),
        ({"compliance": -np.ones((64, 33))}, "positive"),
        ({"compliance": np.cumsum(np.ones((64, 33)), axis=0)}, "mirror image"),
        (
            {"plastic_displacement": np.full((64, 64), -1e-9)},
            "plastic_displacement has shape",
        ),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(InvalidScene, match=message):
        bem.solve(scene(rough()), **options)


def test_plain_arrays_steps_and_memory_are_checked(monkeypatch):
    with pytest.raises(InvalidScene, match="finite"):
        solve_pressure(np.full((8, 8), np.inf), np.ones((8, 5)), 1.0)
    with pytest.raises(InvalidScene, match="between 0 and the hardness"):
        solve_pressure(np.zeros((8, 8)), np.ones((8, 5)), 2.0, 1.0)
    with pytest.raises(NotConverged, match="did not reach") as caught:
        bem.solve(scene(rough()), max_steps=1, threads=1)
    assert caught.value.residuals["gap_elastic"] > 1e-8
    monkeypatch.setattr("epcontact.bem.memory.available_memory", lambda: 2**27)
    with pytest.raises(
        NotEnoughMemory, match=r"2048 x 1024 needs about 0.2 GiB .* 0.1 GiB are"
    ):
        bem.solve(scene(np.zeros((2048, 1024)), periods=(2.0, 1.0)))


@pytest.mark.parametrize(
    ("load", "hardness"), [(0.08, 0.1), (0.3, 3.0), (0.6, math.inf)]
)
def test_a_solve_takes_the_memory_that_was_estimated(load, hardness, monkeypatch):
    given = scene(rough((320, 320)), load * E, hardness * E)
    bem.solve(given, threads=1)  # kernels need memory to load
    tracemalloc.start()
    bem.solve(given, threads=1)
    peak = tracemalloc.get_traced_memory()[1] / 320**2
    tracemalloc.stop()
    forget_peak()
    held = np.ones(2**24)
    assert peak_memory() == pytest.approx(
        psutil.Process().memory_info().rss, rel=0.01
    ), held.size
    monkeypatch.setattr(
        "pathlib.Path.read_text", lambda *_, **__: ""
    )  # as on other systems
    assert peak_memory() == pytest.approx(
        psutil.Process().memory_info().rss, rel=0.01
    ), held.size
    estimate = bytes_per_point(load * E, hardness * E, E * given.surface.rms_slope)
    assert peak == pytest.approx(estimate, rel=0.12)


def test_a_solve_tells_its_progress_its_options_and_its_cost(monkeypatch):
    told, made, heights = [], [], rough((160, 96))
    given = scene(heights, (LOAD, LOAD / 2))
    q = rfft_wavenumbers(heights.shape, given.surface.periods)
    symbol = surface_compliance(q, given.body, given.material)
    monkeypatch.setattr(driver, "compile_seconds", iter((0.0, 1e6)).__next__)
    result = bem.solve(
        given,
        threads=1,
        compliance=symbol,
        on_step=made.append,
        progress=lambda *one: told.append(one),
    )
    words = r"bem: mean pressure (\S+) Pa, (\d+) x (\d+) points, residual (\S+)"
    for (
        share,
        sentence,
    ) in told:  # a grid's own share is that of its points, a quarter of it before
        load, *numbers = map(float, re.fullmatch(words, sentence).groups())
        settled = min(max(math.log(numbers[2]) / math.log(1e-8), 0.0), 1.0)
        part = numbers[0] * numbers[1] / heights.size * (0.25 + 0.75 * settled)
        assert share == pytest.approx((load != LOAD) / 2 + part / 2, abs=0.005)
    assert {sentence.split(", ")[1] for _, sentence in told} == {
        "40 x 48 points",
        "80 x 48 points",
        "160 x 96 points",
    }
    assert [each.steps for each in made] == [result.steps[:1], result.steps]
    assert result.provenance.options["compliance"] == "given"
    assert result.cost["seconds"] == pytest.approx(
        -1e6, rel=1e-3
    )  # less those of compilation
    last = result.final
    assert (last.iterations["levels"], len(result.history)) == (
        3,
        last.iterations["newton"] + 1,
    )
    assert result.history[-1] == pytest.approx(max(last.residuals.values()), rel=1e-6)
