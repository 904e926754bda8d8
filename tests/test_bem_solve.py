"""The capped contact problem by boundary elements: exact properties, few transforms."""

import itertools
import math
import re
import tracemalloc

import numpy as np
import psutil
import pytest

from epcontact import bem
from epcontact.bem import driver, solve_pressure
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.bem.memory import bytes_per_point
from epcontact.errors import InvalidScene, NotConverged, NotEnoughMemory
from epcontact.harness.quantities.registry import measure_all
from epcontact.machine import forget_peak, peak_memory
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.studies.baselines import BASELINES
from epcontact.surfaces import SelfAffine

# Solves must end on steep and on stepped surfaces, too.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

E = 250e9
PERIOD = 2 * math.pi / 2.5e4
HARDNESS = 0.6 * E
LOAD = 0.05 * E
CAPS = pytest.mark.parametrize("hardness", [HARDNESS, math.inf])


def rough(shape=(64, 64), seed=7, points=4.0, slope=1.0):
    """Return self-affine heights in m, on a period of PERIOD along each axis.

    `points` are those in the shortest wavelength, and `slope` is the rms slope.
    """
    high = 2.5e4 * max(shape) / points
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, high, slope)
    return SelfAffine(spectrum, (PERIOD,) * len(shape), shape, seed).build().heights


def noise(shape):
    """Return white noise as heights in m, with an rms value of PERIOD/1000."""
    return np.random.default_rng(1).standard_normal(shape) * PERIOD / 1000


def scene(heights, load=LOAD, hardness=HARDNESS, body=None, periods=None, nu=0.0):
    """Return a scene with the modulus E; `load` and `hardness` are in Pa, `periods` in
    m.
    """
    surface = Surface(heights, periods or (PERIOD,) * heights.ndim)
    return Scene(surface, Material(E, nu, hardness), Load(load), body or Body())


def solve(heights, *args, tolerance=1e-9, threads=1, start=None, **options):
    """Return the `ContactResult` of heights (m); `args` and `options` are those of
    `scene`.
    """
    given = scene(heights, *args, **options)
    return bem.solve(given, tolerance=tolerance, threads=threads, start=start)


#: Largest values of quantities that are 0 for an exact solution: the conditions of the
#: minimum (Karush-Kuhn-Tucker), and fields that follow from the pressures.
LARGEST = {
    "quantity.measured_bounds": 0.0,
    "quantity.measured_force": 1e-10,
    "quantity.measured_gap": 1e-8,
    "quantity.measured_fields": 1e-8,
}


def require_kkt(given, result):
    """Require the conditions of the minimum, computed from the fields of a result.

    `given` is the scene. Pressures lie between 0 and the hardness and have the mean of
    the load; gaps fit the pressures and states, to 1e-8 of the rms height.
    """
    for name, value in measure_all(LARGEST, given, result).items():
        assert abs(value) <= LARGEST[name], name


def require_same(result, other, tolerance=1e-6 * E):
    """Require equal pressures in two results, to a `tolerance` in Pa."""
    difference = result.fields["pressure"] - other.fields["pressure"]
    assert np.abs(difference).max() < tolerance


@pytest.mark.parametrize("fraction", [0.08, 0.5, 0.97])
@pytest.mark.parametrize("shape", [(64, 64), (65, 48), (200,)])
def test_particle_hole_symmetry(shape, fraction):
    """(h, p0) -> (-h, hardness - p0) maps p to hardness - p and g to -g."""
    heights = rough(shape)
    result = solve(heights, fraction * HARDNESS)
    mirrored = solve(-heights, (1 - fraction) * HARDNESS)
    # A gap error of 1e-9 h_rms is worth a pressure of about E* pi/(2 dx) 1e-9 h_rms.
    total = result.fields["pressure"] + mirrored.fields["pressure"]
    assert np.abs(total - HARDNESS).max() < 1e-6 * E
    gaps = result.fields["gap"] + mirrored.fields["gap"]
    assert np.abs(gaps).max() < 1e-8 * np.std(heights)


def rolled(field):
    """Return the field shifted by 5 and -9 points around its periodic edges."""
    return np.roll(field, (5, -9), (0, 1))


@pytest.mark.parametrize("move", [rolled, np.rot90, np.flipud, np.transpose])
def test_what_moves_the_surface_moves_the_pressure(move):
    """A surface that is shifted, turned or mirrored has the pressures moved alike.

    `move` maps an (n, n) field to the moved field.
    """
    heights = rough()
    moved = solve(np.ascontiguousarray(move(heights))).fields["pressure"]
    expected = move(solve(heights).fields["pressure"])
    assert np.abs(moved - expected).max() < 1e-6 * E


def test_a_datum_does_not_matter():
    # A datum of 0.25 m costs the heights themselves 3e-17 m of 2e-6 m.
    """Heights with a mean of 0.25 m have the pressures of heights with mean 0."""
    require_same(solve(rough() + 0.25), solve(rough()), 1e-5 * E)


@pytest.mark.parametrize(
    ("length", "slope", "stress"), [(1e3, 1.0, 1e-6), (1.0, 1e-3, 1e-3)]
)
def test_pressures_scale_with_the_modulus_times_the_slope(length, slope, stress):
    """Pressures over E xi do not change with the factors of length, slope
    and stress.
    """
    heights = rough()
    surface = Surface(heights * length * slope, (PERIOD * length,) * 2)
    material = Material(E * stress / slope, 0.0, HARDNESS * stress)
    scaled = bem.solve(Scene(surface, material, Load(LOAD * stress)), tolerance=1e-9)
    difference = scaled.fields["pressure"] / stress - solve(heights).fields["pressure"]
    assert np.abs(difference).max() < 1e-6 * E


def test_a_cap_that_is_not_reached_changes_nothing():
    """A hardness of ten times the largest elastic pressure gives the
    elastic pressures.
    """
    heights = rough()
    elastic = solve(heights, hardness=math.inf)
    high = 10 * elastic.fields["pressure"].max()
    require_same(elastic, solve(heights, hardness=high))


def test_any_start_leads_to_the_same_pressure():
    """Zero, random and spiked starting pressures lead to the pressures of the usual
    start.
    """
    heights = rough()
    rng = np.random.default_rng(3)
    expected = solve(heights)
    spikes = np.where(rng.random(heights.shape) > 0.9, 1e9 * E, -1.0)
    for start in (np.zeros_like(heights), rng.random(heights.shape) * E, spikes):
        require_same(solve(heights, start=start), expected)


def test_same_call_same_bits_whatever_the_threads():
    """Repeated solves, on one and two threads, have equal bits of pressures and
    residuals.

    The grid is large enough for the transforms' library to use threads of its own.
    """
    heights = rough((600, 1000))
    first = solve(heights)
    for other in (solve(heights), solve(heights, threads=2)):
        pressure = other.fields["pressure"]
        np.testing.assert_array_equal(first.fields["pressure"], pressure)
        assert first.final.residuals == other.final.residuals


@CAPS
@pytest.mark.parametrize("shape", [(48, 40), (90,)])
@pytest.mark.parametrize("method", BASELINES)
def test_classic_methods_find_the_same_minimum(method, hardness, shape):
    """Each classic `method` finds Newton's pressures and areas, or raises
    `NotConverged`.

    The error names the tolerance and the steps, and holds a residual for each step.
    """
    problem = scene(rough(shape, 5, points=max(shape) / 10), hardness=hardness)
    newton = bem.solve(problem, threads=1, tolerance=1e-9)
    solver = BASELINES[method]
    other = bem.solve(problem, threads=1, tolerance=1e-7, method=solver)
    assert other.provenance.options["method"] == method
    assert max(other.final.residuals.values()) <= 1e-7
    # A gap error of 1e-7 h_rms is worth E* pi/(2 dx) 1e-7 h_rms = 3e-7 E* of pressure
    # at most.
    require_same(other, newton)
    assert other.final.areas["raw"] == newton.final.areas["raw"]
    message = f"{method} did not reach 1e-08 in 4 steps"
    with pytest.raises(NotConverged, match=message) as caught:
        bem.solve(problem, threads=1, method=solver, max_steps=4)
    assert len(caught.value.history) == 5


@CAPS
@pytest.mark.parametrize("points", [4, 16])
def test_area_tolerance_ends_sooner_with_the_same_areas(points, hardness):
    """With an area tolerance the solve takes fewer FFT pairs, and areas are within it.

    `points` are those in the shortest wavelength.
    """
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
    """Solve heights (m), require few FFT pairs and the conditions of `require_kkt`, and
    return the result.

    `load` and `hardness` are in Pa; `periods` (m) give square cells on a longest period
    of PERIOD if they are None.
    """
    longest = max(heights.shape)
    periods = periods or tuple(PERIOD * n / longest for n in heights.shape)
    given = scene(heights, load, hardness, body, periods, nu)
    result = bem.solve(given, threads=1)
    assert max(result.final.residuals.values()) <= 1e-8
    require_kkt(given, result)
    # The worst of some two thousand scenes took 360 pairs, a line of white noise.
    assert result.cost["equivalent_fft_pairs"] < 1000
    return result


@pytest.mark.parametrize(
    ("heights", "load", "hardness", "periods", "pairs", "equivalent"),
    [
        # 7 to 9 pairs and 16 to 25 equivalent ones were measured.
        pytest.param(rough((512, 512)), 0.05, 0.6, None, 11, 28, id="4 points"),
        pytest.param(
            rough((256, 256), points=16), 0.05, 0.6, None, 11, 28, id="16 points"
        ),
        pytest.param(rough((243, 243)), 0.05, 0.6, None, 12, 40, id="odd"),
        # 99.9 % of the points are elastic.
        pytest.param(rough((256, 256)), 1.5, math.inf, None, 15, 40, id="full"),
        pytest.param(rough((20011,)), 0.05, 0.6, None, 45, math.inf, id="line"),
        # 60 to 90 equivalent pairs: a direction of fewer than 64 points has cells, too.
        pytest.param(
            rough((1024, 1024))[:32], 0.05, 0.6, None, math.inf, 130, id="thin"
        ),
        pytest.param(
            rough((256, 256), 5, 16),
            *(0.01, 0.6, (10 * PERIOD, PERIOD), 20, 1000),
            id="rows far apart",
        ),
        pytest.param(noise((256, 256)), 0.5, math.inf, None, 15, 1000, id="noise"),
    ],
)
def test_few_transforms_whatever_the_roughness_the_grid_and_the_load(
    heights, load, hardness, periods, pairs, equivalent
):
    """A solve takes at most the given numbers of FFT pairs and of equivalent pairs.

    `load` and `hardness` are in units of E; `pairs` counts transforms of the complete
    grid, and `equivalent` all transforms by their cost.
    """
    result = require_solved(heights, load * E, hardness * E, periods=periods)
    assert result.cost["fft_pairs"] <= pairs
    assert result.cost["equivalent_fft_pairs"] <= equivalent


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", PERIOD / 25600)])
@pytest.mark.parametrize("hardness", [1e-3, 1e-6])
def test_almost_rigid_bodies_take_no_more_steps_than_others(body, hardness):
    """Bodies with a hardness of 1e-3 or 1e-6 of E take at most 20 Newton steps.

    Almost all points have the pressure 0 or the hardness, and change places through a
    few elastic ones.
    """
    heights = rough((256, 256), 3, 2.2)
    for fraction in (0.01, 0.3, 0.7):
        load = fraction * hardness * E
        result = require_solved(heights, load, hardness * E, body, 0.3)
        assert result.final.iterations["newton"] <= 20  # 10 measured


def surfaces(shape):
    """Return heights in m of ten kinds of surfaces on a grid of a shape, by their
    names.
    """
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
    """Return the rms slope of heights on periods that are PERIOD at the longest."""
    squares = sum(
        np.square(np.roll(heights, -1, axis) - heights) for axis in range(heights.ndim)
    )
    rise = math.sqrt(np.mean(squares))
    return max(rise * max(heights.shape) / PERIOD, 1e-3)


GRIDS = [(48, 48), (65, 63), (64, 16), (7, 100), (2, 2), (3, 2), (2, 64)]
LINES = [(101,), (2,), (512,)]


@pytest.mark.parametrize("shape", GRIDS + LINES)
def test_every_kind_of_surface_and_grid(shape):
    """Each kind of surface on each grid converges at light and heavy loads, capped or
    not.

    `shape` may be as small as two points. Loads and hardnesses are multiples of E times
    the rms slope.
    """
    for heights in surfaces(shape).values():
        scale = rms_slope(heights) * E
        for load in (1e-3, 0.1, 2.0):
            require_solved(heights, load * scale)
        for hardness in (3e-3, 0.3, 5.0):
            for fraction in (1e-2, 0.5, 0.99):
                cap = hardness * scale
                require_solved(heights, fraction * cap, cap)


def test_energy_steps_are_reported_where_newton_fails():
    """A note counts the Newton steps that were cut short since they would raise the
    energy.

    A line of white noise near the middle of its load range makes plain steps overshoot.
    """
    heights = noise((512,))
    hardness = 0.3 * rms_slope(heights) * E
    result = require_solved(heights, 0.5 * hardness, hardness)
    (note,) = (note for note in result.notes if "raised the energy" in note)
    cut = int(note.split()[0])
    newton = result.final.iterations["newton"]
    gradient = result.final.iterations["gradient"]
    assert 0 < cut < newton
    assert note == (
        f"{cut} of {newton} Newton steps would have raised the energy and were cut "
        f"short; {gradient} projected gradient steps followed them."
    )


def wavenumbers():
    """Return the wave numbers of the modes of 64 x 64 points, 1 for the mean."""
    q = rfft_wavenumbers((64, 64), (2 * math.pi,) * 2)
    q[0, 0] = 1.0
    return q


@pytest.mark.parametrize("hardness", [math.inf, 0.6])
@pytest.mark.parametrize("power", [1.5, 0.5, 0.0, -1.0])
def test_any_gradual_compliance_converges(power, hardness):
    """A compliance q^-power converges in 40 FFT pairs, also with a hardness (units of
    E*).
    """
    heights = rough(seed=3) / PERIOD
    solution = solve_pressure(heights, wavenumbers() ** -power, 0.05, hardness)
    assert solution.counts["fft_pairs"] <= 40


@pytest.mark.parametrize(
    "compliance", [wavenumbers() ** -4.0, np.exp(-5 * wavenumbers())]
)
def test_a_steep_compliance_is_refused(compliance):
    """A compliance that falls too fast from mode to mode raises `InvalidScene`."""
    message = r"falls by a factor of .* along the first axis"
    with pytest.raises(InvalidScene, match=message):
        solve_pressure(rough(seed=3) / PERIOD, compliance, 0.05)


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
    """Unknown methods and arrays of wrong shape or sign raise `InvalidScene`.

    `options` are arguments of `bem.solve`, and `message` is a part of the message.
    """
    with pytest.raises(InvalidScene, match=message):
        bem.solve(scene(rough()), **options)


def test_plain_arrays_are_checked():
    """`solve_pressure` refuses infinite heights and a load beyond the hardness."""
    compliance = np.ones((8, 5))
    with pytest.raises(InvalidScene, match="finite"):
        solve_pressure(np.full((8, 8), np.inf), compliance, 1.0)
    with pytest.raises(InvalidScene, match="between 0 and the hardness"):
        solve_pressure(np.zeros((8, 8)), compliance, 2.0, 1.0)


def test_too_few_steps_raise_with_the_residuals():
    """`NotConverged` holds the last residuals."""
    with pytest.raises(NotConverged, match="did not reach") as caught:
        bem.solve(scene(rough()), max_steps=1, threads=1)
    assert caught.value.residuals["gap_elastic"] > 1e-8


def test_too_little_memory_is_noticed_before_a_solve(monkeypatch):
    """With 2^27 bytes free, a scene that needs 0.2 GiB raises `NotEnoughMemory`."""
    monkeypatch.setattr("epcontact.bem.memory.available_memory", lambda: 2**27)
    message = r"2048 x 1024 needs about 0.2 GiB .* 0.1 GiB are"
    with pytest.raises(NotEnoughMemory, match=message):
        bem.solve(scene(np.zeros((2048, 1024)), periods=(2.0, 1.0)))


@pytest.mark.parametrize(
    ("load", "hardness"), [(0.08, 0.1), (0.3, 3.0), (0.6, math.inf)]
)
def test_a_solve_takes_the_memory_that_was_estimated(load, hardness):
    """The traced peak of memory is within 12 % of `bytes_per_point`.

    `load` and `hardness` are in units of E.
    """
    given = scene(rough((320, 320)), load * E, hardness * E)
    bem.solve(given, threads=1)  # kernels need memory to load
    tracemalloc.start()
    bem.solve(given, threads=1)
    peak = tracemalloc.get_traced_memory()[1] / 320**2
    tracemalloc.stop()
    stiffness = E * given.surface.rms_slope
    estimate = bytes_per_point(load * E, hardness * E, stiffness)
    assert peak == pytest.approx(estimate, rel=0.12)


def test_the_peak_of_the_memory_is_that_of_the_process(monkeypatch):
    """`peak_memory` is the resident memory in bytes, with and without Linux's /proc."""
    forget_peak()
    held = np.ones(2**24)
    used = psutil.Process().memory_info().rss
    assert peak_memory() == pytest.approx(used, rel=0.01), held.size
    # Other systems than Linux have no such file.
    monkeypatch.setattr("pathlib.Path.read_text", lambda *_, **__: "")
    assert peak_memory() == pytest.approx(used, rel=0.01), held.size


def test_a_solve_reports_its_progress():
    """Each report holds load, grid and residual, and the fraction that follows from
    them.

    The fraction counts a grid's points and the decades of its residual; two loads have
    half of the progress each.
    """
    reports = []
    heights = rough((160, 96))
    given = scene(heights, (LOAD, LOAD / 2))
    bem.solve(given, threads=1, progress=lambda *report: reports.append(report))
    words = r"bem: mean pressure (\S+) Pa, (\d+) x (\d+) points, residual (\S+)"
    grids = set()
    for fraction, sentence in reports:
        load, nx, ny, residual = map(float, re.fullmatch(words, sentence).groups())
        converged = min(max(math.log(residual) / math.log(1e-8), 0.0), 1.0)
        # A grid's work is that of its points, and coarser grids have a quarter of it.
        of_load = nx * ny / heights.size * (0.25 + 0.75 * converged)
        done = 0.0 if load == LOAD else 0.5
        assert fraction == pytest.approx(done + of_load / 2, abs=0.005)
        grids.add((nx, ny))
    assert grids == {(40, 48), (80, 48), (160, 96)}


def test_a_solve_records_its_options_and_its_cost(monkeypatch):
    """A result holds its steps so far, options, seconds without compilation, and
    history.
    """
    partial = []
    heights = rough((160, 96))
    given = scene(heights, (LOAD, LOAD / 2))
    q = rfft_wavenumbers(heights.shape, given.surface.periods)
    compliance = surface_compliance(q, given.body, given.material)
    compiled = itertools.chain((0.0,), itertools.repeat(1e6))
    monkeypatch.setattr(driver, "compile_seconds", compiled.__next__)
    result = bem.solve(given, threads=1, compliance=compliance, on_step=partial.append)
    assert [one.steps for one in partial] == [result.steps[:1], result.steps]
    assert result.provenance.options["compliance"] == "given"
    # The seconds of compilation are taken off.
    assert result.cost["seconds"] == pytest.approx(-1e6, rel=1e-3)
    last = result.final
    assert last.iterations["levels"] == 3
    assert len(result.history) == last.iterations["newton"] + 1
    largest = max(last.residuals.values())
    assert result.history[-1] == pytest.approx(largest, rel=1e-6)
