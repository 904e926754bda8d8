"""Films from frames: GIF by Pillow, which matplotlib brings; MP4 where a writer is installed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError


def write_film(path: Path, frames: Sequence[NDArray[np.uint8]], frames_per_second: float) -> None:
    """Write frames (height, width, 3) of one size to a .gif (which repeats) or .mp4 file.

    Raises OutputError if the writer of .mp4 is not installed.
    """
    if path.suffix.lower() == ".mp4":
        _write_mp4(path, frames, frames_per_second)
    else:
        _write_gif(path, frames, frames_per_second)


def _write_gif(path: Path, frames: Sequence[NDArray[np.uint8]], frames_per_second: float) -> None:
    from PIL import Image

    # One palette, of all frames together: colours keep their meaning and do not flicker.
    strip = Image.fromarray(np.concatenate([frame[::4, ::4] for frame in frames]))
    palette = strip.quantize(256, dither=Image.Dither.NONE)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    images[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=round(1000 / frames_per_second),
        loop=0,
    )


def _write_mp4(path: Path, frames: Sequence[NDArray[np.uint8]], frames_per_second: float) -> None:
    try:
        imageio: Any = __import__("imageio.v2", fromlist=["get_writer"])
        __import__("imageio_ffmpeg")
    except ImportError:
        raise OutputError(
            "an MP4 needs the packages imageio and imageio-ffmpeg; without them, name the film .gif"
        ) from None
    even = [frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2] for frame in frames]
    with imageio.get_writer(path, fps=frames_per_second, macro_block_size=2) as writer:
        for frame in even:
            writer.append_data(frame)
