"""The cheap operator, the coarse grids and the projection that the solver is built from."""

import numpy as np
import pytest

from epcontact.bem.bounds import project
from epcontact.bem.cascade import coarsened_heights, interpolated
from epcontact.bem.inner.split import (
    HALO_LEFT,
    Interpolation,
    MaskedGrid,
    SplitOperator,
    half_shape,
)
from epcontact.bem.kernel import quarter_compliance
from epcontact.bem.transforms import Convolution, Points, Symbol
from epcontact.bem.workers import Workers
from epcontact.scene import Body, Material

STEEL = Material(200e9, 0.3)


def all_points(convolution: Convolution) -> Points:
    nx, ny = convolution.shape
    parts = [slice(rows.start * ny, rows.stop * ny) for rows in convolution.rows]
    return Points(np.arange(nx * ny, dtype=np.int32), parts)


@pytest.mark.parametrize(
    ("shape", "periods", "body"),
    [
        ((128, 128), (1e-4, 1e-4), Body()),
        ((64, 192), (0.5e-4, 1e-4), Body()),
        ((128, 128), (1e-4, 1e-4), Body("bonded_layer", 5e-6)),
        ((81, 127), (0.65e-4, 1e-4), Body()),
        ((64, 128), (2e-3, 1e-4), Body()),
        ((1, 1021), (1.0, 1e-4), Body()),
    ],
)
def test_split_operator_is_near_the_exact_one(shape, periods, body):
    """Even, odd and prime sizes, far-apart rows and lines."""
    rng = np.random.default_rng(1)
    symbol = Symbol.from_quarter(quarter_compliance(shape, periods, body, STEEL), shape)
    with Workers(1) as workers:
        exact = Convolution(symbol, 3e9, workers)
        cheap, points = SplitOperator(exact, half_shape(symbol)), all_points(exact)
        cheap.masked = MaskedGrid(points, rng.random(shape), workers)
        values = rng.standard_normal(points.index.size)
        values -= values.mean()
        want, got, other = np.empty_like(values), np.empty_like(values), rng.random(values.size)
        exact.apply_on(points, values, want, other)
        sums = cheap.apply_on(points, values, got, other)
    assert sums == pytest.approx((got.sum(), got @ other), rel=1e-6)
    # White noise is the hardest: alias of the half grid. One outer step gains what is left.
    assert np.linalg.norm(got - want) < 0.06 * np.linalg.norm(want)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_of_blocks_are_in_order_and_their_errors_are_raised(threads):
    with Workers(threads) as workers:
        assert workers.each(divmod, list(range(40)), 7) == [divmod(k, 7) for k in range(40)]
        with pytest.raises(ZeroDivisionError):
            workers.each(divmod, 7, [3, 2, 0, 1])
        assert workers.total(divmod, [7, 8], 3) == (4, 3)


def test_split_operator_forgets_the_last_points():
    shape = (64, 64)
    symbol = Symbol.from_quarter(quarter_compliance(shape, (1e-4, 1e-4), Body(), STEEL), shape)
    rng = np.random.default_rng(2)
    with Workers(2) as workers:
        exact = Convolution(symbol, 1e9, workers)
        used, fresh = (SplitOperator(exact, half_shape(symbol)) for _ in range(2))
        everywhere, memory = all_points(exact), np.empty(shape)
        v = rng.standard_normal(4096)
        used.masked = MaskedGrid(everywhere, memory, workers)
        used.apply_on(everywhere, v, np.empty(4096), v)
        few = Points(np.array([0, 63, 64, 4095], dtype=np.int32), [slice(0, 4)])
        w, a, b = np.array([1.0, -2.0, 0.5, 0.5]), np.empty(4), np.empty(4)
        used.masked = fresh.masked = MaskedGrid(few, memory, workers)
        used.apply_on(few, w, a, w)
        fresh.apply_on(few, w, b, w)
    np.testing.assert_array_equal(a, b)
    assert np.shares_memory(used.masked.array, memory)


@pytest.mark.parametrize(("columns", "room"), [(22, False), (23, True)])
def test_masked_grid_is_in_the_memory_of_a_field_that_has_room(columns, room):
    field, at = np.full((3, columns), np.nan), np.array([0, columns + 1, 3 * columns - 1])
    with Workers(1) as workers:
        masked = MaskedGrid(Points(at, [slice(0, 3)]), field, workers)
        masked.put(np.array([1.0, 2.0, 3.0]))
    assert np.shares_memory(masked.array, field) == room
    inner = masked.array[:, HALO_LEFT : HALO_LEFT + columns]
    assert np.flatnonzero(inner).tolist() == at.tolist()
    assert inner.sum() == 6


@pytest.mark.parametrize("shape", [(64, 66), (7, 9), (1, 40), (12, 5)])
def test_convolution_is_the_circular_one(shape):
    rng = np.random.default_rng(0)
    body = Body("sliding_layer", 2e-5)
    symbol = Symbol.from_quarter(quarter_compliance(shape, (1e-4, 2e-4), body, STEEL), shape)
    field, out = rng.standard_normal(shape), np.empty(shape)
    with Workers(1) as workers:
        convolution = Convolution(symbol, 2e9, workers)
        convolution.apply(field, out)
        modes = np.fft.rfft2(field) * symbol.values[symbol.rows] * 2e9
        modes[0, 0] = 0
        want = np.fft.irfft2(modes, s=shape)
        assert np.abs(out - want).max() < 1e-13 * np.abs(want).max()
        back = np.empty(out.size)
        convolution.apply_on(all_points(convolution), out.reshape(-1), back, back, inverse=True)
    assert np.abs(back.reshape(shape) - (field - field.mean())).max() < 1e-12
    assert convolution.pairs == 2


@pytest.mark.parametrize(
    ("shape", "periods", "half"),
    [
        ((64, 128), (1, 2), (32, 64)),
        ((1021, 243), (1021, 243), (512, 125)),
        ((128, 128), (30, 1), (128, 64)),
        ((1, 4096), (1, 1), (1, 2048)),
        ((48, 128), (48, 128), None),
    ],
)
def test_grids_that_can_be_split(shape, periods, half):
    symbol = Symbol.from_quarter(quarter_compliance(shape, periods, Body(), STEEL), shape)
    assert half_shape(symbol) == half


@pytest.mark.parametrize(("coarse", "fine"), [(32, 64), (54, 101), (128, 243), (9, 9)])
def test_restriction_is_the_transpose_of_interpolation(coarse, fine):
    made = Interpolation.between(coarse, fine)
    forth, back = np.zeros((fine, coarse)), np.zeros((coarse, fine))
    for k in range(4):
        np.add.at(forth, (range(fine), (made.first + k) % coarse), made.weights[:, k])
    for k in range(made.fine_weights.shape[1]):
        at = (range(coarse), (made.first_fine + k) % fine)
        np.add.at(back, at, made.fine_weights[:, k])
    np.testing.assert_array_equal(back, forth.T)


@pytest.mark.parametrize("shape", [(64, 48), (63, 48), (45, 77), (1, 64)])
def test_coarse_heights_keep_the_long_waves(shape):
    x, y = (np.arange(n)[:, None] / n if k == 0 else np.arange(n) / n for k, n in enumerate(shape))

    def wave(x, y):
        return 0.3 + np.cos(2 * np.pi * (2 * y)) + np.sin(2 * np.pi * (3 * x - 4 * y))

    coarse = tuple((n + 1) // 2 if n > 32 else n for n in shape)
    short = np.cos(2 * np.pi * (shape[1] // 2 - 1) * y)
    found = coarsened_heights(wave(x, y) + short, (coarse[0], coarse[1]), Workers(1))
    cx, cy = np.arange(coarse[0])[:, None] / coarse[0], np.arange(coarse[1]) / coarse[1]
    if shape[0] == 1:
        cx = cx * 0
    assert np.abs(found - wave(cx, cy)).max() < 1e-13


@pytest.mark.parametrize(("coarse", "fine"), [((32, 24), (64, 48)), ((23, 32), (45, 63))])
def test_interpolation_is_of_fourth_order(coarse, fine):
    errors = []
    for factor in (1, 2, 4):
        small, large = ((s[0] * factor, s[1] * factor) for s in (coarse, fine))

        def wave(shape):
            x, y = np.arange(shape[0])[:, None] / shape[0], np.arange(shape[1]) / shape[1]
            return np.sin(2 * np.pi * (x + 2 * y)) + np.cos(4 * np.pi * x)

        with Workers(1) as workers:
            found = interpolated(wave(small), large, workers)
        errors.append(np.abs(found - wave(large)).max())
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(4, abs=0.3)
    assert errors[2] < 1e-3


@pytest.mark.parametrize("cap", [np.inf, 1.5])
def test_projection_is_the_nearest_point(cap):
    rng = np.random.default_rng(4)
    w = rng.standard_normal(500) * 3
    p = project(w, cap, 500.0)
    assert p.sum() == pytest.approx(500, rel=1e-14)
    assert p.min() >= 0
    assert p.max() <= cap
    # The nearest point of a convex set: (w - p).(q - p) <= 0 for any other q of the set.
    for _ in range(20):
        q = project(rng.standard_normal(500), cap, 500.0)
        assert (w - p) @ (q - p) <= 1e-9
