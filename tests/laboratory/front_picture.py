"""Draw the fronts of a small contact on its grid: `.readme/fronts.png` of the guide."""

import sys
from functools import partial

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from epcontact.bem.areas.hidden import STIFFNESS
from laboratory.areas import Member, roughness

SCENE = Member(
    (64, 64), (1.0, 1.0), 0.1, 0.6, 16, partial(roughness, low=0.8, high=0.8), 4
)
FINER, CENTRE, HALF = 16, (0.39, 0.65), 0.1


def field(factor):
    """Return positions and values (x, v) in the window of the picture, on a grid
    `factor` times as fine.

    v is (p - c g) / hardness, with pressure p and gap g times a stiffness c: positive
    in contact, and 1 or more where plastic.
    """
    p, g, hardness, (dx, _), _ = SCENE.solved(factor)
    v = np.where(
        (p > 0) & (p < hardness), p, np.where(p > 0, hardness, 0.0) - STIFFNESS / dx * g
    )
    at = [np.arange(round((c - HALF) / dx), round((c + HALF) / dx) + 1) for c in CENTRE]
    return [index * dx for index in at], (v / hardness)[np.ix_(*at)]


def main(path):
    """Draw the boundaries of contact on a grid and on a finer one, and save the picture
    to `path`.
    """
    figure = Figure(figsize=(6.4, 6.0), layout="constrained")
    axes = figure.add_subplot(xlabel="x (periods)", ylabel="y (periods)")
    (x, y), v = field(1)
    state = (v > 0).astype(int) + (v >= 1)
    colours = ListedColormap(["#eeeeee", "#f2d16b", "#555555"])
    axes.pcolormesh(x, y, state.T, cmap=colours, edgecolors="white", linewidth=0.5)
    (fine_x, fine_y), fine = field(FINER)
    for level, colour in ((0.0, "tab:blue"), (1.0, "tab:red")):
        axes.contour(x, y, v.T, [level], colors=colour, linestyles="dashed")
        axes.contour(fine_x, fine_y, fine.T, [level], colors=colour)
    axes.plot([], [], "k--", label="on this grid, not yet corrected")
    axes.plot([], [], "k-", label=f"on a grid {FINER} times as fine")
    axes.legend(loc="lower left")
    axes.set_aspect("equal")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
