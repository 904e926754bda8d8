"""The parts of a solve: work in blocks, convolutions, cheap operators, filters, long
indices.
"""

import numpy as np
import pytest

from epcontact.bem import transforms as tr
from epcontact.bem.inner import split
from epcontact.bem.inner.cells import CELL, number_cells
from epcontact.bem.kernel import quarter_compliance
from epcontact.bem.newton import collect
from epcontact.bem.workers import Workers
from epcontact.scene import Body, Material

STEEL = Material(200e9, 0.3)
ONE = Workers(1)
RNG = np.random.default_rng


def symbol_of(shape, body=None, periods=None):
    periods = periods or (shape[0] * 1e-6 if shape[0] > 1 else 1.0, shape[1] * 1e-6)
    return tr.Symbol.from_quarter(
        quarter_compliance(shape, periods, body or Body(), STEEL), shape
    )


def points_of(contact, convolution):
    index, ny = np.flatnonzero(contact).astype(np.int32), contact.shape[1]
    ends = [
        np.searchsorted(index, (r.start * ny, r.stop * ny)) for r in convolution.rows
    ]
    return tr.Points(index, [slice(*map(int, pair)) for pair in ends])


def scattered(shape, share, seed):
    """Contacts of about four points, at random, that cover about `share` of the
    grid.
    """
    modes = np.fft.rfft2(RNG(seed).standard_normal(shape))
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    field = np.fft.irfft2(modes * np.exp(-((q * 4) ** 2)), s=shape)
    return field >= np.quantile(field, 1 - share)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_of_blocks_are_in_order_and_their_errors_are_raised(threads):
    with Workers(threads) as workers:
        assert workers.each(divmod, list(range(40)), 7) == [
            divmod(k, 7) for k in range(40)
        ]
        with pytest.raises(ZeroDivisionError):
            workers.each(divmod, 7, [3, 2, 0, 1])
        assert workers.total(divmod, [7, 8], 3) == (4, 3)


@pytest.mark.parametrize("shape", [(64, 66), (7, 9), (1, 40), (12, 5), (800, 1000)])
def test_convolution_is_the_circular_one(shape):
    field, out = RNG(0).standard_normal(shape), np.empty(shape)
    symbol = symbol_of(shape, Body("sliding_layer", 2e-5), (1e-4, 2e-4))
    convolution = tr.Convolution(symbol, 2e9, ONE)
    convolution.apply(field, out)
    modes = np.fft.rfft2(field) * symbol.values[symbol.rows] * 2e9
    modes[0, 0] = 0
    want = np.fft.irfft2(modes, s=shape)
    assert np.abs(out - want).max() < 1e-13 * np.abs(want).max()
    everywhere = points_of(np.ones(shape), convolution)
    back, single = np.empty(out.size), np.empty(out.size)
    convolution.apply_on(everywhere, out.reshape(-1), back, back, inverse=True)
    assert np.abs(back.reshape(shape) - (field - field.mean())).max() < 1e-11
    assert convolution.pairs == 2
    cheap = convolution.in_single_precision()
    cheap.apply_on(everywhere, field.reshape(-1), single, single)
    assert np.abs(single.reshape(shape) - want).max() < 1e-5 * np.abs(want).max()


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 5e-6)])
@pytest.mark.parametrize(
    ("shape", "share"), [((128, 64), 1.0), ((96, 130), 0.2), ((960, 600), 0.1)]
)
def test_split_operator_is_near_the_exact_one(shape, share, body):
    """White noise is the hardest: alias of the half grid.  One outer step gains what is
    left. Threads and what was in the memory before do not matter.
    """
    found = []
    for threads in (1, 3):
        with Workers(threads) as workers:
            exact = tr.Convolution(symbol_of(shape, body), 3e9, workers)
            cheap, points = (
                split.SplitOperator(exact),
                points_of(scattered(shape, share, 2), exact),
            )
            values, other = RNG(1).standard_normal((2, points.index.size))
            want, got = np.empty_like(values), np.empty_like(values)
            exact.apply_on(points, values, want, other)
            memory = np.full(shape, np.nan)
            cheap.masked = split.MaskedGrid(points, memory, workers)
            sums = cheap.apply_on(points, values, got, other)
        size = 1e-6 * abs(got).sum()
        assert sums == pytest.approx((got.sum(), got @ other), rel=1e-6, abs=size)
        assert np.linalg.norm(got - want) < 0.06 * np.linalg.norm(want)
        found.append(got)
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("shape", [(9, 7), (256, 320)])
def test_modes_are_filtered_to_the_same_bits_by_any_number_of_threads(shape):
    field, modes = (
        RNG(4).standard_normal(shape),
        RNG(5).random((shape[0], shape[1] // 2 + 1)),
    )
    modes = modes + modes[-np.arange(shape[0])]
    with Workers(2) as two:
        found = tr.filtered(field, modes, two)
    np.testing.assert_array_equal(found, tr.filtered(field, modes, ONE))
    assert (
        np.abs(found - np.fft.irfft2(np.fft.rfft2(field) * modes, s=shape)).max()
        < 1e-13
    )


def test_points_beyond_2_to_31_are_counted_right():
    """The passes that turn flat indices into rows, columns and cells, on the last rows
    of a grid of 65536 x 65536 points of which only these rows exist.
    """
    side, rows = 65536, 2
    first, p = (side - rows) * side, RNG(6).random(rows * side)
    here = np.flatnonzero(p > 0.999)
    index = np.empty(here.size, dtype=np.int64)
    pressure, out = np.empty((2, here.size))
    collect(p, 0 * p, p, (p > 0.999).astype(np.uint8), first, 0.0, index, pressure, out)
    np.testing.assert_array_equal(index, first + here)
    block = np.empty((rows, side))
    tr.scatter(block, first, index, pressure)
    assert tr.gather_dot(block, first, index, out, out)[0] == pytest.approx(
        p[here].sum()
    )
    np.testing.assert_array_equal(out, p[here])
    n, columns = side // CELL, np.arange(side, dtype=np.int32) // CELL
    cells, sums = np.empty(here.size, dtype=np.int32), np.empty((1, n))
    number_cells(cells, sums, index, columns, side, (n, n), (n - 1) * n)
    np.testing.assert_array_equal(cells, here % side // CELL)
    row = np.zeros((1, split.LEFT + side + split.RIGHT), dtype=np.float32)
    masked = np.lib.stride_tricks.as_strided(row, (side, row.size), (0, row.itemsize))
    split.put_single(masked, index, out)  # every row is the same memory
    for column in set(here % side):
        assert row[0, split.LEFT + column] in np.float32(p[here[here % side == column]])
