"""The preconditioner of the boundary elements: a stencil within cells and a problem of cells."""

import numpy as np
import pytest

from epcontact.bem import solve_pressure
from epcontact.bem.inner.cells import CELL, Cells, number_cells
from epcontact.bem.inner.cg import conjugate_gradients
from epcontact.bem.inner.preconditioner import CellPreconditioner, cell_body
from epcontact.bem.inner.split import HALO_LEFT, HALO_RIGHT, MaskedGrid, put_single
from epcontact.bem.kernel import quarter_compliance
from epcontact.bem.newton import collect
from epcontact.bem.transforms import (
    Convolution,
    Points,
    Symbol,
    filtered,
    gather_dot,
    index_type,
    scatter,
)
from epcontact.bem.workers import Workers
from epcontact.scene import Body, Material

STEEL = Material(200e9, 0.3)
SPACING = 1e-6


def symbol_of(shape, body=None, spacings=(SPACING, SPACING)):
    periods = (shape[0] * spacings[0], shape[1] * spacings[1])
    if shape[0] == 1:
        periods = (1.0, periods[1])
    quarter = quarter_compliance(shape, periods, body or Body(), STEEL)
    return Symbol.from_quarter(quarter, shape)


def points_of(contact, convolution):
    index = np.flatnonzero(contact).astype(np.int32)
    ny = contact.shape[1]
    parts = []
    for rows in convolution.rows:
        ends = np.searchsorted(index, [rows.start * ny, rows.stop * ny])
        parts.append(slice(*map(int, ends)))
    return Points(index, parts)


def scattered(shape, share, seed, size=4):
    """Contacts of about `size` points, at random, that cover about `share` of the grid."""
    rng = np.random.default_rng(seed)
    modes = np.fft.rfft2(rng.standard_normal(shape))
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    field = np.fft.irfft2(modes * np.exp(-((q * size) ** 2)), s=shape)
    return field > np.quantile(field, 1 - share)


def made(contact, workers, body=None):
    convolution = Convolution(symbol_of(contact.shape, body), 1e9, workers)
    points = points_of(contact, convolution)
    found = cell_body(convolution.symbol)
    masked = MaskedGrid(points, np.empty(contact.shape), workers)
    return convolution, points, CellPreconditioner(found, Cells(convolution, points), masked)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("shape", [(128, 96), (65, 130), (1, 512)])
@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
def test_symmetric_and_positive(shape, share, threads):
    rng = np.random.default_rng(3)
    contact = scattered(shape, share, 5) if share < 1 else np.ones(shape, dtype=bool)
    with Workers(threads) as workers:
        _, points, cells = made(contact, workers)
        a, b = rng.standard_normal((2, points.index.size))
        pa, pb, scratch = np.empty_like(a), np.empty_like(a), np.empty_like(a)
        total, product = cells.apply(a, pa, scratch)
        cells.apply(b, pb, scratch)
    assert total == pytest.approx(pa.sum(), abs=1e-9 * np.abs(pa).sum())
    assert product == pytest.approx(pa @ a)
    assert product > 0
    # The cells' problem is solved to a hundredth, single precision is a millionth.
    assert abs(pa @ b - a @ pb) < 2e-2 * np.sqrt((pa @ a) * (pb @ b))


def iterations(contact, body, cells_wanted=True):
    """Of conjugate gradients to 1e-6 of a smooth right-hand side plus noise, exact operator."""
    rng = np.random.default_rng(1)
    with Workers(1) as workers:
        convolution, points, cells = made(contact, workers, body)
        r = rng.standard_normal(points.index.size)
        r += 10 * np.cos(2 * np.pi * points.index / contact.size)
        r -= r.mean()
        wanted, x = r.copy(), np.zeros_like(r)

        def plain(r, y, _):
            return convolution.apply_on(points, r, y, r, inverse=True)

        used = cells.apply if cells_wanted else plain
        count = conjugate_gradients(convolution, used, points, r, x, 1e-6, 0.0)
        got = np.empty_like(x)
        convolution.apply_on(points, x, got, x)
    assert x.mean() == pytest.approx(0, abs=1e-9 * np.abs(x).max())
    rest = got - got.mean() - wanted
    assert np.linalg.norm(rest) < 2e-6 * np.linalg.norm(wanted)
    return count


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 3e-5), Body("sliding_layer", 3e-4)])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.4, 0.9])
def test_few_iterations_whatever_the_contact(share, body):
    # 10 to 17 were measured over shares of 0.02 to 1 and contacts of 1 to 12 points.
    assert iterations(scattered((256, 256), share, 7), body) <= 20


def test_iterations_do_not_grow_with_the_grid_as_those_of_the_whole_inverse_do():
    small, large = (scattered((n, n), 0.4, 2, size=1) for n in (128, 512))
    few, many = iterations(small, None), iterations(large, None)
    assert many <= 1.15 * few
    # 19 and 33, against 17 and 16.
    whole = [iterations(contact, None, cells_wanted=False) for contact in (small, large)]
    assert whole[1] > 1.5 * whole[0]
    assert whole[1] > 1.5 * many


def test_lines():
    rng = np.random.default_rng(4)
    contact = np.repeat(rng.random(512) < 0.1, 8)[None, :]
    assert iterations(contact, None) <= 20


def test_none_where_it_would_not_serve():
    assert cell_body(symbol_of((30, 256))) is None
    assert cell_body(symbol_of((1, 30))) is None


def test_full_cells_have_the_displacement_of_the_whole():
    body = cell_body(symbol_of((128, 128)))
    # Denser contact is stiffer, and a full cell has next to nothing beyond the kernel of cells.
    assert np.all(np.diff(body.delta[1:]) <= 0)
    assert body.delta[CELL**2] < 0.1 * body.delta[CELL]


def test_full_contact_is_inverted_mode_by_mode():
    rng = np.random.default_rng(8)
    heights = rng.standard_normal((128, 128))
    modes = np.fft.rfft2(heights)
    symbol = symbol_of((128, 128))
    compliance = symbol.values[symbol.rows]
    exact = np.divide(modes, compliance, out=np.zeros_like(modes), where=compliance > 0)
    pressure = np.fft.irfft2(exact)
    load = -2 * pressure.min()
    found = solve_pressure(heights, compliance, load)
    assert found.counts["cg"] == 1
    assert np.abs(found.pressure - load - pressure).max() < 1e-12 * load


@pytest.mark.parametrize("shape", [(1, 300), (9, 7), (256, 320)])
def test_modes_are_filtered_to_the_same_bits_by_any_number_of_threads(shape):
    rng = np.random.default_rng(4)
    field = rng.standard_normal(shape)
    modes = rng.random((shape[0], shape[1] // 2 + 1))
    modes = modes + modes[-np.arange(shape[0])]
    with Workers(1) as one, Workers(2) as two:
        found = filtered(field, modes, one)
        np.testing.assert_array_equal(found, filtered(field, modes, two))
    wanted = np.fft.irfft2(np.fft.rfft2(field) * modes, s=shape)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13)


def test_points_beyond_2_to_31_are_counted_right():
    """The passes that turn flat indices into rows, columns and cells, on the last rows of a grid
    of 65536 x 65536 points of which only these rows exist."""
    side, rows = 65536, 2
    first = (side - rows) * side
    rng = np.random.default_rng(6)
    p = rng.random(rows * side)
    state = (p > 0.999).astype(np.uint8)
    here = np.flatnonzero(state)
    index = np.empty(here.size, dtype=index_type(side**2))
    pressure, residual = np.empty(here.size), np.empty(here.size)
    collect(p, np.zeros_like(p), p, state, first, 0.0, index, pressure, residual)
    np.testing.assert_array_equal(index, first + here)
    block, out = np.empty_like(p), np.empty(here.size)
    scatter(block, first, index, pressure)
    assert gather_dot(block, first, index, out, out)[0] == pytest.approx(p[here].sum())
    np.testing.assert_array_equal(out, p[here])
    side_cells = side // CELL
    cells, sums = np.empty(here.size, dtype=np.int32), np.empty((1, side_cells))
    last = (side_cells - 1) * side_cells
    columns = np.arange(side, dtype=np.int32) // CELL
    number_cells(cells, sums, index, columns, side, (side_cells, side_cells), last)
    np.testing.assert_array_equal(cells, here % side // CELL)
    row = np.zeros((1, HALO_LEFT + side + HALO_RIGHT), dtype=np.float32)
    masked = np.broadcast_to(row, (side, row.size))  # every row is the same memory
    put_single(np.lib.stride_tricks.as_strided(row, masked.shape, masked.strides), index, out)
    for column in set(here % side):
        assert row[0, HALO_LEFT + column] in np.float32(p[here[here % side == column]])
