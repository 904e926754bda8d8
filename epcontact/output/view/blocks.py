"""The finite-element block of a .vtu: cut open, deformed, coloured by stress and strain.

Field names are matched by their words, as finite-element programs differ: a vector
`displacement` (or `u`) at the points, a scalar with `mises` in its name (Pa), and one with both
`plastic` and `strain` in it, at points or cells.  The coordinates are taken to be those of the
deformed body, as `fem_check` writes them: a factor of 1 shows them as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.errors import OutputError
from epcontact.output.charts.style import STRESS_MAP, unit_for
from epcontact.output.view.staging import bar, frame_view, round_factor

#: Of the block's width, the largest displacement that is shown when no factor is given.
SHOWN = 0.04
#: Faces up to which the edges of the elements are drawn; finer ones would blacken the picture.
EDGES = 20_000

Limits = tuple[float, float]


@dataclass(frozen=True)
class Block:
    """A mesh (pyvista UnstructuredGrid) and the names of its fields, empty where it has none.

    limits: largest von Mises stress (Pa) and plastic strain.
    """

    mesh: Any
    displacement: str
    stress: str
    strain: str
    limits: Limits


def read_block(source: Path | str) -> Block:
    """Read a .vtu.  Raises OutputError if it cannot be read or holds nothing to show."""
    import pyvista as pv

    if not Path(source).is_file():
        raise OutputError(f"cannot read {source}: there is no such file")
    mesh: Any = pv.read(str(source))
    if not mesh.n_cells:
        raise OutputError(f"cannot show {source}: it is damaged or holds no cells")
    names = [*mesh.point_data.keys(), *mesh.cell_data.keys()]
    vectors = [n for n in mesh.point_data.keys() if mesh.point_data[n].shape[1:] == (3,)]  # noqa: SIM118
    displacement = next((n for n in vectors if n.lower() in ("displacement", "u")), "")
    stress = next((n for n in names if "mises" in n.lower()), "")
    strain = next((n for n in names if "plastic" in n.lower() and "strain" in n.lower()), "")
    if not stress and not strain:
        raise OutputError(
            f"cannot show {source}: it holds neither von Mises stress nor plastic strain"
        )
    limits = [float(np.max(_data(mesh, n)[n], initial=0.0)) if n else 0.0 for n in (stress, strain)]
    return Block(mesh, displacement, stress, strain, (limits[0], limits[1]))


def joint_limits(limits: Sequence[Limits]) -> Limits:
    """The largest of each, for one scale of colours over several blocks."""
    return max(low for low, _ in limits), max(high for _, high in limits)


def shape_factor(blocks: Sequence[Block]) -> float:
    """A round factor of the displacement that shows the deformed shape."""
    largest, width = 0.0, 0.0
    for block in blocks:
        x0, x1, y0, y1, *_ = block.mesh.bounds
        width = max(width, x1 - x0, y1 - y0)
        if block.displacement:
            u = np.asarray(block.mesh.point_data[block.displacement])
            largest = max(largest, float(np.abs(u).max()))
    return round_factor(SHOWN * width / largest) if largest > 0 else 1.0


def draw_block(plotter: Any, block: Block, factor: float, limits: Limits) -> None:
    """Both halves of the plotter: von Mises stress on the left, plastic strain on the right."""
    mesh = _opened(block.mesh)
    if block.displacement:
        mesh = mesh.warp_by_vector(block.displacement, factor=factor - 1.0)
    sides = np.ptp(np.reshape(block.mesh.bounds, (3, 2)), axis=1)
    scale, unit = unit_for(float(sides.max()), "m")
    mesh.points = np.asarray(mesh.points, dtype=np.float64) / scale
    opened = mesh.extract_surface(nonlinear_subdivision=1)
    x0, x1, y0, y1, z0, z1 = mesh.bounds
    size = " × ".join(f"{side / scale:.4g}" for side in sides)
    stress_scale, stress_unit = unit_for(limits[0], "Pa")
    panels = (
        (block.stress, stress_scale, limits[0], f"von Mises stress ({stress_unit})", STRESS_MAP),
        (block.strain, 1.0, limits[1], "equivalent plastic strain (-)", "cividis"),
    )
    shape = f"displacements × {factor:.3g}" if block.displacement else "undeformed"
    for column, (name, divisor, top, title, colours) in enumerate(panels):
        plotter.subplot(0, column)
        _panel(plotter, opened, name, (divisor, top), title, colours)
        if column == 0:
            plotter.add_text(f"{size} {unit}, {shape}", font_size=11, color="black")
        frame_view(plotter, (x0, x1, y0, y1, z0, z1), (-0.9, -1.3, 1.1), 1.0)


def _data(mesh: Any, name: str) -> Any:
    """Where the field is; at the points, if it is at both."""
    return mesh.point_data if name in mesh.point_data else mesh.cell_data


def _opened(mesh: Any) -> Any:
    """Without its front quarter, so that two inner faces show; whole elements, so that the mesh
    shows as it is."""
    x0, x1, y0, y1, *_ = mesh.bounds
    centres = np.asarray(mesh.cell_centers().points)
    # Elements on the cut stay, whatever the rounding of their centres.
    x, y = (x0 + x1) / 2 - 1e-6 * (x1 - x0), (y0 + y1) / 2 - 1e-6 * (y1 - y0)
    return mesh.extract_cells(np.flatnonzero((centres[:, 0] >= x) | (centres[:, 1] >= y)))


def _panel(
    plotter: Any, mesh: Any, name: str, scale: tuple[float, float], title: str, colours: str
) -> None:
    if not name:
        plotter.add_mesh(mesh, color="#d9d9d9")
        plotter.add_text(f"no {title.partition(' (')[0]} in the file", font_size=11, color="black")
        return
    divisor, top = scale
    shown = mesh.copy(deep=False)
    data = _data(shown, name)
    data["shown"] = np.asarray(data[name]) / divisor
    plotter.add_mesh(
        shown,
        scalars="shown",
        clim=(0.0, top / divisor or 1.0),
        cmap=colours,
        scalar_bar_args=bar(title),
        show_edges=shown.n_cells <= EDGES,
        edge_color="#404040",
        edge_opacity=0.35,
        ambient=0.5,
        diffuse=0.55,
        specular=0.0,
    )
