"""What every three-dimensional picture shares: window, camera, colour bar, round factors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from epcontact.errors import OutputError

#: Windows that VTK falls back to where the display does not answer; they show nothing.
OFF_SCREEN_ONLY = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")


def new_plotter(task: dict[str, Any], shape: tuple[int, int]) -> Any:
    """A white window of `shape` panels; off the screen where the task names a picture."""
    import pyvista as pv

    off_screen = task["picture"] is not None
    plotter = pv.Plotter(off_screen=off_screen, window_size=task["size"], shape=shape, border=False)
    plotter.set_background("white", all_renderers=True)
    return plotter


def finish(plotter: Any, task: dict[str, Any]) -> None:
    """Write the task's picture, or show the window until it is closed."""
    if task["picture"] is None:
        if plotter.render_window.GetClassName() in OFF_SCREEN_ONLY:
            raise OutputError(
                "no window can be opened on this display; ask for a screenshot instead"
            )
        plotter.link_views()
        plotter.show(title="epcontact")
    else:
        plotter.screenshot(task["picture"])
        plotter.close()


def frame_view(plotter: Any, bounds: Any, towards: Sequence[float], zoom: float) -> None:
    """Look at the middle of `bounds` from the direction `towards`, with room for a bar below."""
    low, high = np.asarray(bounds[0::2]), np.asarray(bounds[1::2])
    middle = (low + high) / 2
    plotter.camera_position = [tuple(middle + np.asarray(towards)), tuple(middle), (0, 0, 1)]
    plotter.reset_camera(bounds=bounds)
    plotter.camera.zoom(zoom)
    plotter.camera.SetWindowCenter(0.0, -0.1)


def bar(title: str, *, wide: bool = False) -> dict[str, Any]:
    """Settings of a colour bar below the picture."""
    return {
        "title": title + "\n",
        "color": "black",
        "n_labels": 4,
        "fmt": "%.3g",
        "title_font_size": 18,
        "label_font_size": 15,
        "width": 0.7 if wide else 0.5,
        "height": 0.07,
        "position_x": 0.15 if wide else 0.25,
        "position_y": 0.02,
    }


def round_factor(value: float) -> float:
    """`value` rounded down to 1, 2 or 5 times a power of ten; 1 between 0.7 and 2."""
    if not np.isfinite(value) or value <= 0 or 0.7 <= value < 2:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-12)))
