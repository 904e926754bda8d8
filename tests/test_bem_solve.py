"""Closed forms and exact properties of the capped contact problem, solved by boundary elements."""

import math

import numpy as np
import pytest

from epcontact import bem
from epcontact.bem import Options, solve_pressure
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.errors import InvalidScene, NotConverged, NotEnoughMemory
from epcontact.reference import bumps, waves
from epcontact.results import APART, ELASTIC, PLASTIC, ContactResult
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

E = 250e9
PERIOD = 2 * math.pi / 2.5e4
HARDNESS = 0.6 * E
LOAD = 0.05 * E


def rough(shape=(64, 64), seed=7, points=4, slope=1.0) -> np.ndarray:
    high = 2.5e4 * max(shape) / points
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, high, slope)
    return SelfAffine(spectrum, (PERIOD,) * len(shape), shape, seed).build().heights


def scene(heights, load=LOAD, hardness=HARDNESS, body=None, periods=None, nu=0.0) -> Scene:
    heights = np.asarray(heights)
    surface = Surface(heights, periods or (PERIOD,) * heights.ndim)
    return Scene(surface, Material(E, nu, hardness), Load(load), body or Body())


def solve(*args, tolerance=1e-9, threads=1, start=None, **options) -> ContactResult:
    return bem.solve(scene(*args, **options), tolerance=tolerance, threads=threads, start=start)


def require_kkt(result: ContactResult, hardness: float, tolerance: float = 1e-8) -> None:
    """The conditions of the minimum, from the fields alone."""
    p, g, state = (result.fields[name] for name in ("pressure", "gap", "state"))
    assert p.min() >= 0
    assert p.max() <= hardness
    scale = tolerance * np.std(result.fields["heights"])
    assert np.abs(g[state == ELASTIC]).max(initial=0) <= scale
    assert g[state == APART].min(initial=0) >= -scale
    assert g[state == PLASTIC].max(initial=0) <= scale
    assert (p[state == APART] == 0).all()
    assert (p[state == PLASTIC] == hardness).all()
    assert p.mean() == pytest.approx(result.final.mean_pressure, rel=1e-12)


# Closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [0.02, 0.3, 0.9])
def test_westergaard_line(load):
    """Contact within a point, the pressure to first order in the grid spacing."""
    errors = []
    for n in (128, 512, 2048):
        x = np.arange(n) / n
        heights = 1e-6 * np.cos(2 * np.pi * x)
        complete = waves.line_complete_pressure(1e-6, PERIOD, E)
        result = solve(heights, load * complete, math.inf)
        exact = waves.line_contact_fraction(load)
        assert abs(result.final.areas["raw"].total - exact) <= 2 / n
        error = result.fields["pressure"] / complete - waves.line_pressure(x, load)
        errors.append(np.abs(error).mean() / load)
        gap = result.final.quantities["mean_gap"] / 1e-6
        assert gap == pytest.approx(waves.line_mean_gap(load), abs=4 / n)
    order = np.log(errors[0] / errors[-1]) / np.log(16)
    # The rim lies a fixed fraction of the spacing off, so the mean error is of order 1; the
    # phase of the grid at the rim scatters it.
    assert order > 0.9
    assert errors[-1] < 2e-3


def test_hertz_on_a_periodic_grid():
    n, radius = 256, 1e-3
    x = (np.arange(n) / n - 0.5) * PERIOD
    heights = -(x[:, None] ** 2 + x**2) / (2 * radius)
    contact = 0.1 * PERIOD
    force = bumps.sphere_force(contact, radius, E)
    result = solve(heights, force / PERIOD**2, math.inf)
    exact = bumps.sphere_contact_radius_periodic(force, radius, E, PERIOD)
    # 26 points across the radius: counting points errs by about a tenth of one point of radius.
    area = result.final.areas["raw"].total * PERIOD**2
    assert area == pytest.approx(math.pi * exact**2, rel=0.02)
    peak = 1.5 * force / (math.pi * exact**2)
    # The images only add curvature, to first order: what is left is of the order (a/L)^5.
    assert result.fields["pressure"].max() == pytest.approx(peak, rel=5e-3)


@pytest.mark.parametrize("shape", [(64, 64), (33, 48), (101,)])
@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 1e-5), Body("sliding_layer", 1e-5)])
def test_full_contact_is_linear(shape, body):
    heights = rough(shape, points=8, slope=0.01)
    result = solve(heights, E, math.inf, body)
    modes = np.fft.rfftn(heights)
    compliance = surface_compliance(
        rfft_wavenumbers(shape, (PERIOD,) * len(shape)), body, Material(E, 0.0)
    )
    compliance.flat[0] = 1
    modes /= compliance
    modes.flat[0] = E * heights.size
    exact = np.fft.irfftn(modes, s=shape, axes=range(len(shape)))
    assert result.final.areas["raw"].total == 1
    assert np.abs(result.fields["pressure"] - exact).max() < 1e-9 * E


def test_soft_body_is_the_bearing_area():
    """With hardness << E* xi the highest points are plastic and the others apart."""
    heights = rough()
    result = solve(heights, 1e-6 * E * 0.3, 1e-6 * E)
    highest = heights > np.sort(heights.reshape(-1))[round(0.7 * heights.size)]
    plastic = result.fields["state"] == PLASTIC
    # Where the load fills no whole number of points, some share one; deformation of order
    # hardness/(E* xi) = 1e-6 may swap neighbours in height.
    assert np.count_nonzero(plastic != highest) <= 4
    assert result.final.areas["raw"].plastic == pytest.approx(0.3, abs=2 / heights.size)


def test_flat_surface_shares_the_load():
    for body in (Body(), Body("bonded_layer", 1e-5)):
        result = solve(np.full((16, 20), 0.3), body=body)
        np.testing.assert_allclose(result.fields["pressure"], LOAD, rtol=1e-14)
        assert result.final.areas["raw"].elastic == 1


def test_layer_is_compressed_uniformly():
    body, nu = Body("bonded_layer", 1e-5), 0.3
    result = solve(np.zeros((8, 8)), body=body, nu=nu)
    modulus = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    np.testing.assert_allclose(result.fields["displacement"], LOAD * 1e-5 / modulus, rtol=1e-12)
    energy = result.final.quantities["elastic_energy"]
    assert energy == pytest.approx(LOAD**2 * 1e-5 / modulus / 2, rel=1e-12)


# Exact properties ------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.08, 0.5, 0.97])
@pytest.mark.parametrize("shape", [(64, 64), (65, 48), (200,)])
def test_particle_hole_symmetry(shape, share):
    """(h, p0) -> (-h, hardness - p0) maps p to hardness - p and g to -g."""
    heights = rough(shape)
    this = solve(heights, share * HARDNESS)
    that = solve(-heights, (1 - share) * HARDNESS)
    require_kkt(this, HARDNESS)
    # A gap error of 1e-9 h_rms is worth a pressure of about E* pi/(2 dx) 1e-9 h_rms.
    assert np.abs(this.fields["pressure"] + that.fields["pressure"] - HARDNESS).max() < 1e-6 * E
    assert np.abs(this.fields["gap"] + that.fields["gap"]).max() < 1e-8 * np.std(heights)
    assert this.final.areas["raw"].plastic == pytest.approx(
        1 - that.final.areas["raw"].total, abs=1e-12
    )


@pytest.mark.parametrize(
    "move",
    [
        lambda a: np.roll(a, (5, -9), (0, 1)),
        np.rot90,
        lambda a: a[::-1],
        lambda a: a.T,
    ],
)
def test_moving_the_surface_moves_the_pressure(move):
    heights = rough()
    reference = solve(heights).fields["pressure"]
    moved = solve(np.ascontiguousarray(move(heights))).fields["pressure"]
    assert np.abs(moved - move(reference)).max() < 1e-6 * E


def test_datum_of_the_heights_is_free():
    heights = rough()
    reference, lifted = solve(heights), solve(heights + 0.25)
    # 0.25 m costs the heights themselves 3e-17 m of 2e-6 m.
    difference = lifted.fields["pressure"] - reference.fields["pressure"]
    assert np.abs(difference).max() < 1e-5 * E


@pytest.mark.parametrize(("length", "slope", "stress"), [(1e3, 1.0, 1e-6), (1.0, 1e-3, 1e-3)])
def test_similarity(length, slope, stress):
    """Areas depend on p0/(E* xi) and hardness/(E* xi) alone; pressures scale with E* xi."""
    heights = rough()
    reference = solve(heights)
    modulus = E * stress / slope
    surface = Surface(heights * length * slope, (PERIOD * length,) * 2)
    material = Material(modulus, 0.0, HARDNESS * stress)
    scaled = bem.solve(Scene(surface, material, Load(LOAD * stress)), tolerance=1e-9, threads=1)
    difference = scaled.fields["pressure"] / stress - reference.fields["pressure"]
    assert np.abs(difference).max() < 1e-6 * E


def test_unreachable_hardness_is_no_hardness():
    heights = rough()
    elastic = solve(heights, hardness=math.inf)
    capped = solve(heights, hardness=10 * elastic.fields["pressure"].max())
    assert np.abs(elastic.fields["pressure"] - capped.fields["pressure"]).max() < 1e-6 * E
    assert capped.final.areas["raw"].plastic == 0


@pytest.mark.parametrize("shape", [(128, 128), (600, 1000)])
def test_same_call_same_bits_whatever_the_threads(shape):
    """The second is large enough for the transforms' library to use threads of its own."""
    heights = rough(shape)
    first, again, parallel = solve(heights), solve(heights), solve(heights, threads=2)
    for other in (again, parallel):
        np.testing.assert_array_equal(first.fields["pressure"], other.fields["pressure"])
        assert first.final.residuals == other.final.residuals


def test_any_start_leads_to_the_same_pressure():
    heights = rough()
    reference = solve(heights).fields["pressure"]
    rng = np.random.default_rng(3)
    spikes = np.where(rng.random(heights.shape) > 0.9, 1e9 * E, -1.0)
    for start in (np.zeros_like(heights), rng.random(heights.shape) * E, spikes):
        before = start.copy()
        found = solve(heights, start=start).fields["pressure"]
        assert np.abs(found - reference).max() < 1e-6 * E
        np.testing.assert_array_equal(start, before)


def test_load_path_is_a_sequence_of_independent_solves():
    heights = rough()
    path = (0.2 * LOAD, 0.9 * LOAD, LOAD)
    together = bem.solve(scene(heights, path), tolerance=1e-9, threads=1)
    assert [step.mean_pressure for step in together.steps] == list(path)
    alone = [solve(heights, load) for load in path]
    for step, single in zip(together.steps, alone, strict=True):
        assert step.areas["raw"] == single.final.areas["raw"]
    difference = together.fields["pressure"] - alone[-1].fields["pressure"]
    assert np.abs(difference).max() < 1e-6 * E
    areas = [step.areas["raw"].total for step in together.steps]
    assert areas == sorted(areas)


def test_given_compliance_takes_the_place_of_the_body():
    heights = rough((48, 64))
    layer = Body("bonded_layer", 2e-5)
    q = rfft_wavenumbers(heights.shape, (PERIOD, PERIOD))
    compliance = surface_compliance(q, layer, Material(E, 0.0))
    given = bem.solve(scene(heights), compliance=compliance, tolerance=1e-9, threads=1)
    own = solve(heights, body=layer)
    half_space = solve(heights)
    assert np.abs(given.fields["pressure"] - own.fields["pressure"]).max() < 1e-6 * E
    assert np.abs(own.fields["pressure"] - half_space.fields["pressure"]).max() > 0.01 * E


def test_plain_arrays_and_scene_agree():
    heights = rough()
    q = rfft_wavenumbers(heights.shape, (PERIOD, PERIOD))
    compliance = surface_compliance(q, Body(), Material(E, 0.0))
    copy = heights.copy()
    options = bem.Options(tolerance=1e-9)
    plain = bem.solve_pressure(heights, compliance, LOAD, HARDNESS, options=options)
    result = solve(heights)
    np.testing.assert_array_equal(heights, copy)
    assert np.abs(plain.pressure - result.fields["pressure"]).max() < 1e-6 * E
    u = np.fft.irfft2(np.fft.rfft2(plain.pressure) * compliance, s=heights.shape)
    assert np.abs(u - plain.displacement).max() < 1e-12 * np.abs(u).max()


# Results ---------------------------------------------------------------------------------------


def test_result_holds_together():
    heights = rough()
    result = solve(heights)
    p, g, u = (result.fields[name] for name in ("pressure", "gap", "displacement"))
    raw = result.final.areas["raw"]
    assert raw.total == np.mean(p > 0)
    assert raw.plastic == np.mean(p == HARDNESS)
    quantities = result.final.quantities
    assert quantities["mean_separation"] == pytest.approx(g.mean(), rel=1e-12)
    assert quantities["mean_gap"] - quantities["mean_plastic_displacement"] == pytest.approx(
        g.mean(), rel=1e-7
    )
    assert quantities["elastic_energy"] == pytest.approx((p * u).mean() / 2, rel=1e-12)
    distribution = result.distribution
    assert distribution is not None
    assert distribution.cumulative[-1] == pytest.approx(raw.elastic, abs=1e-15)
    assert distribution.plastic == raw.plastic
    # The ends are resolved: intervals there are small beside those of one width.
    assert np.diff(distribution.pressure)[[0, -1]].max() < 1e-2 * HARDNESS / 1024
    middle = distribution.pressure[512]
    between = np.mean((p > 0) & (p <= middle))
    assert distribution.cumulative[512] == pytest.approx(between, abs=1e-15)
    assert np.ptp(g + heights - u) < 1e-12 * np.ptp(heights)
    assert ContactResult.from_json(result.to_json()).final.areas["raw"] == raw


def test_energy_is_the_work_of_the_load():
    """Elastic: dU = p0 d(-separation), by the trapezoidal rule along a path."""
    heights = rough((48, 48), points=8)
    loads = np.geomspace(0.01, 0.4, 81) * E
    path = bem.solve(scene(heights, tuple(loads), math.inf), threads=1)
    energy = np.array([step.quantities["elastic_energy"] for step in path.steps])
    separation = np.array([step.quantities["mean_separation"] for step in path.steps])
    work = -np.sum((loads[1:] + loads[:-1]) / 2 * np.diff(separation))
    # The rule's error falls with the square of the step, ln(40)/80: about 2e-4 of the work.
    assert energy[-1] - energy[0] == pytest.approx(work, rel=1e-3)


@pytest.mark.parametrize("hardness", [HARDNESS, math.inf])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("points", [4, 16])
def test_area_tolerance_ends_sooner_with_the_same_areas(points, tolerance, hardness):
    surface = scene(rough((256, 256), points=points), hardness=hardness)
    full = bem.solve(surface, threads=1)
    early = bem.solve(surface, threads=1, area_tolerance=tolerance)
    assert early.cost["equivalent_fft_pairs"] < full.cost["equivalent_fft_pairs"]
    for part in ("total", "elastic", "plastic"):
        exact = getattr(full.final.areas["raw"], part)
        assert getattr(early.final.areas["raw"], part) == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize("hardness", [HARDNESS, math.inf])
def test_finest_grid_sees_few_transforms(hardness):
    """Counts, not seconds; 7 to 9 and 16 to 25 were measured."""
    for points in (4, 8, 16):
        surface = scene(rough((256, 256), points=points), hardness=hardness)
        result = bem.solve(surface, threads=1)
        assert result.cost["fft_pairs"] <= 11
        assert result.cost["equivalent_fft_pairs"] <= 28


@pytest.mark.parametrize("hardness", [HARDNESS, math.inf])
def test_work_does_not_grow_with_roughness(hardness):
    """16 times as many wavelengths in the square, at the same points each: the same work."""
    counts = []
    for n in (128, 512):
        result = bem.solve(scene(rough((n, n)), hardness=hardness), threads=1)
        assert not result.notes
        counts.append(result.cost["fft_pairs"])
    assert counts[1] <= counts[0] + 1


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_long_thin_grids_are_no_dearer():
    """They took 415 where a direction of fewer than 64 points had no cells; 60 to 90 since."""
    heights = rough((1024, 1024))[:32]
    surface = Surface(heights, (PERIOD / 32, PERIOD))
    result = bem.solve(Scene(surface, Material(E, 0.0, HARDNESS), Load(LOAD)), threads=1)
    require_kkt(result, HARDNESS)
    assert result.cost["equivalent_fft_pairs"] <= 130


@pytest.mark.parametrize("length", [1e-20, 1e-33])
def test_lengths_below_those_of_atoms(length):
    """Stiffnesses a point beyond single precision, in which the cheap operators work."""
    surface = Surface(length * rough((64, 64)) / PERIOD, (length, length))
    result = bem.solve(Scene(surface, Material(E, 0.0, HARDNESS), Load(1e-4 * LOAD)), threads=1)
    require_kkt(result, HARDNESS)


def test_light_bodies_are_no_dearer():
    """Two thirds of the points in contact: none of the cheap operator, and still few steps."""
    material = Material(30e9, 0.0, math.inf)
    surface = Surface(rough((256, 256)), (PERIOD, PERIOD))
    result = bem.solve(Scene(surface, material, Load(LOAD)), threads=1)
    assert 0.5 < result.final.areas["raw"].total < 0.8
    assert result.cost["equivalent_fft_pairs"] <= 50


# Refusals --------------------------------------------------------------------------------------


def test_unconverged_raises_with_its_residuals():
    with pytest.raises(NotConverged, match="did not reach") as caught:
        bem.solve(scene(rough()), max_steps=1, threads=1)
    assert caught.value.residuals["gap_elastic"] > 1e-8
    assert len(caught.value.history) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0}, "tolerance"),
        ({"area_tolerance": 2}, "area_tolerance"),
        ({"threads": 0}, "threads"),
        ({"method": "magic"}, "method is 'magic'"),
        ({"max_steps": 0}, "max_steps"),
        ({"start": np.zeros((3, 3))}, "start has shape"),
        ({"start": np.full((64, 64), np.nan)}, "start has shape"),
        ({"compliance": np.ones((64, 64))}, "compliance has shape"),
        ({"compliance": -np.ones((64, 33))}, "positive"),
        ({"compliance": np.cumsum(np.ones((64, 33)), axis=0)}, "mirror image"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(InvalidScene, match=message):
        bem.solve(scene(rough()), **options)


def test_memory_is_estimated_before_it_is_taken(monkeypatch):
    monkeypatch.setattr("epcontact.bem.memory.available_memory", lambda: 1000)
    with pytest.raises(NotEnoughMemory, match="64 x 64 needs about"):
        bem.solve(scene(rough()))


def test_plain_arrays_are_checked():
    ones = np.ones((8, 5))
    with pytest.raises(InvalidScene, match="finite"):
        bem.solve_pressure(np.full((8, 8), np.inf), ones, 1.0)
    with pytest.raises(InvalidScene, match="between 0 and the hardness"):
        bem.solve_pressure(np.zeros((8, 8)), ones, 2.0, 1.0)


def test_without_elastic_points_the_offset_lies_midway_whatever_the_rounding():
    # Twenty of forty points carry all of the load at the cap; the order of the sums must not
    # leave one of them, or of the others, a rounding error between its bounds.
    q = 2 * np.pi * np.arange(21) / 40
    q[0] = np.inf
    found = 0
    for phase in (np.arange(60) + 0.5) / 60:
        heights = np.cos(2 * np.pi * (np.arange(40) + phase) / 40)
        p = solve_pressure(heights, 2 / q, 0.007, 0.014, options=Options(tolerance=1e-7))
        gap = p.displacement + p.offset - heights
        between = np.minimum(p.pressure, 0.014 - p.pressure)
        if between.max() < 1e-9:
            found += 1
            assert between.max() == 0
            assert gap[p.pressure <= 0].min() == pytest.approx(-gap[p.pressure > 0].max())
    assert found > 40
