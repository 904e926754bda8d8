"""The parts of a solve: work in blocks, convolutions, cheap operators, long indices."""

import numpy as np
import pytest

from epcontact.bem.inner import split
from epcontact.bem.inner.cells import CELL, number_cells
from epcontact.bem.kernel import quarter_compliance
from epcontact.bem.newton import collect
from epcontact.bem.transforms import (
    Convolution,
    Points,
    Symbol,
    filtered,
    gather_dot,
    scatter,
)
from epcontact.bem.workers import Workers
from epcontact.scene import Body, Material

STEEL = Material(200e9, 0.3)


def normal(shape, seed):
    """Return an array of a shape of standard normal random numbers, drawn
    with a seed.
    """
    return np.random.default_rng(seed).standard_normal(shape)


def symbol_of(shape, body, periods=None):
    """Return the `Symbol` of a steel body: its compliance for each mode of a grid.

    `periods` are in m; the spacing is a micrometre if they are not given.
    """
    if periods is None:
        periods = (shape[0] * 1e-6, shape[1] * 1e-6)
    return Symbol.from_quarter(quarter_compliance(shape, periods, body, STEEL), shape)


def points_of(contact, convolution):
    """Return the `Points` where a mask (nx, ny) is True, split as the rows of a
    convolution.
    """
    index = np.flatnonzero(contact).astype(np.int32)
    ny = contact.shape[1]
    parts = []
    for rows in convolution.rows:
        start, stop = np.searchsorted(index, (rows.start * ny, rows.stop * ny))
        parts.append(slice(int(start), int(stop)))
    return Points(index, parts)


def scattered(shape, fraction, seed):
    """Return a mask of contacts of about four points that cover a `fraction` of the
    grid.
    """
    modes = np.fft.rfft2(normal(shape, seed))
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    field = np.fft.irfft2(modes * np.exp(-((q * 4) ** 2)), s=shape)
    return field >= np.quantile(field, 1 - fraction)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_of_blocks_are_in_order_and_their_errors_are_raised(threads):
    """`Workers` return results in the order of their arguments, sum them, and raise
    errors.
    """
    with Workers(threads) as workers:
        expected = [divmod(k, 7) for k in range(40)]
        assert workers.each(divmod, list(range(40)), 7) == expected
        with pytest.raises(ZeroDivisionError):
            workers.each(divmod, 7, [3, 2, 0, 1])
        assert workers.total(divmod, [7, 8], 3) == (4, 3)


@pytest.mark.parametrize("shape", [(64, 66), (7, 9), (1, 40), (12, 5), (800, 1000)])
def test_convolution_is_the_circular_one(shape):
    """The convolution is numpy's circular one to 1e-13, its inverse undoes it to 1e-11,
    and single precision gives 1e-5 of the largest value.

    A product with the inverse counts as one more FFT pair.
    """
    field = normal(shape, 0)
    found = np.empty(shape)
    symbol = symbol_of(shape, Body("sliding_layer", 2e-5), (1e-4, 2e-4))
    convolution = Convolution(symbol, 2e9, Workers(1))
    convolution.apply(field, found)
    modes = np.fft.rfft2(field) * symbol.values[symbol.rows] * 2e9
    modes[0, 0] = 0
    expected = np.fft.irfft2(modes, s=shape)
    largest = np.abs(expected).max()
    assert np.abs(found - expected).max() < 1e-13 * largest
    everywhere = points_of(np.ones(shape), convolution)
    back = np.empty(found.size)
    convolution.apply_on(everywhere, found.reshape(-1), back, back, inverse=True)
    assert np.abs(back.reshape(shape) - (field - field.mean())).max() < 1e-11
    assert convolution.pairs == 2
    single = np.empty(found.size)
    cheap = convolution.in_single_precision()
    cheap.apply_on(everywhere, field.reshape(-1), single, single)
    assert np.abs(single.reshape(shape) - expected).max() < 1e-5 * largest


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 5e-6)])
@pytest.mark.parametrize(
    ("shape", "fraction"), [((128, 64), 1.0), ((96, 130), 0.2), ((960, 600), 0.1)]
)
def test_split_operator_is_near_the_exact_one(shape, fraction, body):
    """The cheap operator is within 6 % of the exact one on white noise, and exact in
    its sums.

    White noise is the hardest, for the alias of the half grid. `fraction` is that of
    points in contact. Threads and old content of the memory do not matter.
    """
    contact = scattered(shape, fraction, 2)
    results = []
    for threads in (1, 3):
        with Workers(threads) as workers:
            exact = Convolution(symbol_of(shape, body), 3e9, workers)
            points = points_of(contact, exact)
            values, other = normal((2, points.index.size), 1)
            expected = np.empty_like(values)
            exact.apply_on(points, values, expected, other)
            cheap = split.SplitOperator(exact)
            cheap.masked = split.MaskedGrid(points, np.full(shape, np.nan), workers)
            found = np.empty_like(values)
            sums = cheap.apply_on(points, values, found, other)
        small = 1e-6 * abs(found).sum()
        exact_sums = (found.sum(), found @ other)
        assert sums == pytest.approx(exact_sums, rel=1e-6, abs=small)
        difference = np.linalg.norm(found - expected)
        assert difference < 0.06 * np.linalg.norm(expected)
        results.append(found)
    np.testing.assert_array_equal(*results)


@pytest.mark.parametrize("shape", [(9, 7), (256, 320)])
def test_modes_are_filtered_to_the_same_bits_by_any_number_of_threads(shape):
    """Filtering by symmetric factors of the modes gives numpy's result, on
    any threads.
    """
    field = normal(shape, 4)
    modes = np.random.default_rng(5).random((shape[0], shape[1] // 2 + 1))
    modes = modes + modes[-np.arange(shape[0])]
    with Workers(2) as two:
        found = filtered(field, modes, two)
    np.testing.assert_array_equal(found, filtered(field, modes, Workers(1)))
    expected = np.fft.irfft2(np.fft.rfft2(field) * modes, s=shape)
    assert np.abs(found - expected).max() < 1e-13


@pytest.fixture(scope="module")
def last_rows():
    """Return (first index, pressures, listed places) of the last two rows of a grid.

    The grid has 65536 x 65536 points, of which only these rows exist.
    """
    side = 65536
    p = np.random.default_rng(6).random(2 * side)
    return (side - 2) * side, p, np.flatnonzero(p > 0.999)


def test_points_beyond_2_to_31_are_listed_scattered_and_gathered(last_rows):
    """Listing, scattering and gathering use 64-bit indices on a grid of
    65536 x 65536.
    """
    first, p, listed = last_rows
    index = np.empty(listed.size, dtype=np.int64)
    pressure, out = np.empty((2, listed.size))
    state = (p > 0.999).astype(np.uint8)
    collect(p, 0 * p, p, state, first, 0.0, index, pressure, out)
    np.testing.assert_array_equal(index, first + listed)
    block = np.empty((2, 65536))
    scatter(block, first, index, pressure)
    total, _ = gather_dot(block, first, index, out, out)
    np.testing.assert_array_equal(out, p[listed])
    assert total == pytest.approx(p[listed].sum())


def test_cells_of_points_beyond_2_to_31(last_rows):
    """The number of the cell of a point uses 64-bit indices on a grid of
    65536 x 65536.
    """
    first, _, listed = last_rows
    side = 65536
    n = side // CELL
    columns = np.arange(side, dtype=np.int32) // CELL
    cells = np.empty(listed.size, dtype=np.int32)
    sums = np.empty((1, n))
    number_cells(cells, sums, first + listed, columns, side, (n, n), (n - 1) * n)
    np.testing.assert_array_equal(cells, listed % side // CELL)


def test_a_masked_grid_of_points_beyond_2_to_31(last_rows):
    """Values are put into the masked grid with 64-bit indices on 65536 x
    65536 points.
    """
    first, p, listed = last_rows
    side = 65536
    row = np.zeros((1, split.LEFT + side + split.RIGHT), dtype=np.float32)
    # Every row is the same memory.
    masked = np.lib.stride_tricks.as_strided(row, (side, row.size), (0, row.itemsize))
    split.put_single(masked, first + listed, p[listed])
    columns = listed % side
    for column in set(columns):
        possible = np.float32(p[listed[columns == column]])
        assert row[0, split.LEFT + column] in possible
