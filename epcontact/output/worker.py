"""The worker that draws three-dimensional pictures: run as a module by `epcontact.output.view`.

It reads one task from its standard input and draws it.  It ends with 0, or prints one marked
sentence and ends with another code.  Crashes and other output of VTK stay in this process.
"""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from PIL import Image

from epcontact.errors import OutputError
from epcontact.output.drawing import (
    block_scale,
    draw_block,
    draw_comparison,
    draw_surface,
    read_block,
    surface_scale,
)
from epcontact.output.view import MARK, REFUSED, WINDOWS
from epcontact.output.vtk import read_fields

Frame = NDArray[np.uint8]

#: The functions that read, scale and draw a file, by its ending.
KINDS: dict[str, tuple[Callable[..., Any], ...]] = {
    ".vti": (read_fields, surface_scale, draw_surface),
    ".vtu": (read_block, block_scale, draw_block),
}


def draw(
    sources: Sequence[str],
    target: str | None,
    size: Sequence[int],
    *,
    factor: float | None = None,
    frames_per_second: float = 3.0,
    names: Sequence[str] = (),
) -> None:
    """Draw files to a picture, a film or a window.

    Args:
        sources: .vti or .vtu files, one for each frame; or two .vti files to compare.
        target: A .png, .gif or .mp4, or None for a window.
        size: Width and height in pixels.
        factor: Stretches the heights or the displacements; None chooses one.
        frames_per_second: The speed of a film.
        names: The names of the two compared methods.
    """
    frames = []
    if names:
        plotter = _window(target, size, columns=3)
        draw_comparison(plotter, [read_fields(source) for source in sources], names)
        frames.append(_finished(plotter, target))
    else:
        read_file, scale, paint = KINDS[Path(sources[0]).suffix]
        # A single file is read once; a film reads each file again, to save memory.
        read = functools.lru_cache(maxsize=1)(read_file)
        scales = [scale(read(source)) for source in sources]
        chosen = factor or min(each for each, _ in scales)
        limits = tuple(np.max([each for _, each in scales], axis=0).tolist())
        for source in sources:
            plotter = _window(target, size, columns=2)
            paint(plotter, read(source), chosen, limits)
            frames.append(_finished(plotter, target))
    if target is None:
        return
    if any(np.ptp(frame) == 0 for frame in frames):
        raise RuntimeError("VTK draws, but the picture is blank")
    write = {".png": _write_png, ".gif": _write_gif, ".mp4": _write_mp4}
    write[Path(target).suffix.lower()](target, frames, frames_per_second)


def _window(target: str | None, size: Sequence[int], columns: int) -> Any:
    """Make a white window with a number of panels, off the screen if there is a target."""
    plotter = pv.Plotter(
        off_screen=target is not None, window_size=list(size), shape=(1, columns), border=False
    )
    plotter.set_background("white", all_renderers=True)
    return plotter


def _finished(plotter: Any, target: str | None) -> Frame:
    """Return the picture; without a target, show the window until the user closes it."""
    if target is None:
        if plotter.render_window.GetClassName() in WINDOWS:
            raise OutputError(
                "no window can be opened on this display; ask for a screenshot instead"
            )
        plotter.link_views()
        plotter.show(title="epcontact")
        return np.zeros((0, 0, 3), dtype=np.uint8)
    image = np.asarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    return image


def _write_png(path: str, frames: Sequence[Frame], _: float) -> None:
    Image.fromarray(frames[0]).save(path)


def _write_gif(path: str, frames: Sequence[Frame], frames_per_second: float) -> None:
    """Write a GIF with one palette for all frames.

    pyvista's `open_gif` gives each frame its own palette, so that unchanged parts of the picture
    differ by up to 79 of 255 between the frames of a block's film, and it flickers.
    """
    strip = Image.fromarray(np.concatenate([frame[::4, ::4] for frame in frames]))
    palette = strip.quantize(256, dither=Image.Dither.NONE)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    duration = round(1000 / frames_per_second)
    images[0].save(path, save_all=True, append_images=images[1:], duration=duration, loop=0)


def _write_mp4(path: str, frames: Sequence[Frame], frames_per_second: float) -> None:
    try:
        import imageio.v2
        import imageio_ffmpeg  # noqa: F401 - the plugin for .mp4
    except ImportError:  # both come with the extra `films`
        raise OutputError(
            "an MP4 needs the packages imageio and imageio-ffmpeg; without them, name the film .gif"
        ) from None
    even = [frame[: len(frame) // 2 * 2, : frame.shape[1] // 2 * 2] for frame in frames]
    imageio.v2.mimwrite(path, even, fps=frames_per_second, macro_block_size=2)


def main() -> int:
    """Draw the task on standard input."""
    try:
        draw(**json.load(sys.stdin))
    except (OutputError, MemoryError) as error:
        print(MARK + (str(error) or "there is not enough memory to draw this"))
        return REFUSED
    except Exception as error:  # another way of drawing may work
        print(f"{MARK}the drawing process failed: {type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
