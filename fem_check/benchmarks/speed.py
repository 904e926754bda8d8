"""The load path whose cost is charted, and the unit of its time.

The unit is the time of a bare 2048 x 2048 real FFT pair on the same core: it makes the times of
different machines comparable.  All times are those of a processor and not of a clock on the wall,
so that other programs on the machine hardly disturb them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.scene import Load, Material, Scene, Surface
from fem_check.driver import STEP_TOLERANCE, problem_of
from fem_check.increments import Rule
from fem_check.path import follow_path, path_targets
from fem_check.workers import Workers, in_parts


def fft_pair_seconds(size: int = 2048, repeats: int = 3) -> float:
    """Seconds of a real FFT pair of size x size points on one core, the fastest of `repeats`."""
    field, best = np.random.default_rng(3).random((size, size)), np.inf
    for _ in range(repeats):
        begin = time.thread_time()
        spectrum = ducc0.fft.r2c(field, nthreads=1)
        ducc0.fft.c2r(spectrum, lastsize=size, forward=False, inorm=2, nthreads=1)
        best = min(best, time.thread_time() - begin)
    return best


class PathCost(NamedTuple):
    """Iterations, time and threads of a load path.

    newton, conjugate_gradients: the iterations of all its increments.  seconds: of one thread.
    two_threads: how many times as fast two threads would be that never wait for memory.
    """

    newton: int
    conjugate_gradients: int
    seconds: float
    two_threads: float


class _OneAfterTheOther(Workers):
    """Does the parts of two threads one after the other, and adds up the time of the shorter."""

    saved = 0.0

    def share(
        self, task: Callable[..., Any], ranges: NDArray[np.int64], *, weight: float = 1.0
    ) -> None:
        if len(ranges) == 1:  # the clock would take longer than many of these
            task(ranges)
            return
        spent = []
        for part in in_parts(ranges, 2, self.fewest / weight):
            begin = time.thread_time()
            task(part)
            spent.append(time.thread_time() - begin)
        self.saved += sum(spent) - max(spent)


def path_cost(scene: Scene, layers: int, steps: int = 4) -> PathCost:
    """The cost of a J2 load path in equal steps.

    Example:
        >>> 1 <= path_cost(speed_scene(8), 4).two_threads <= 2
        True
    """
    begin, workers = time.thread_time(), _OneAfterTheOther()
    problem = problem_of(scene, law="j2", layers=layers)
    factor = replace(problem.factor, workers=workers)
    problem = replace(problem, workers=workers, factor=factor)
    targets = path_targets(scene, problem, None)
    rule = Rule(max(targets), steps, STEP_TOLERANCE, None, 1e-8)
    counts = [point.counts for point, _ in follow_path(problem, targets, rule)]
    seconds = time.thread_time() - begin
    return PathCost(
        sum(c.newton for c in counts),
        sum(c.cg for c in counts),
        seconds,
        seconds / (seconds - workers.saved),
    )


def speed_scene(nodes: int, *, line: bool = False, load: float = 0.05, seed: int = 5) -> Scene:
    """A self-affine J2 scene with eight nodes to its shortest wave; 16 on a line.

    Args:
        nodes: along each side of the unit period.
        line: a line instead of a surface.
        load: mean pressure in units of E* xi, which is 1 at the rms slope of 0.05; the yield
            stress is 0.2, and nu = 0.3.
        seed: of the surface.

    Example:
        >>> speed_scene(16).surface.shape
        (16, 16)
    """
    highest = nodes // (16 if line else 8)
    frequency = np.abs(np.fft.fftfreq(nodes, 1 / nodes))
    q = frequency if line else np.hypot(frequency[:, None], frequency[None, :])
    inside = (q > 0) & (q <= highest)
    power = np.where(inside, np.where(inside, q, 1.0) ** (-1.3 if line else -1.8), 0.0)
    noise = np.random.default_rng(seed).standard_normal(q.shape)
    heights = np.fft.ifftn(power * np.fft.fftn(noise)).real
    spectrum = np.abs(np.fft.fftn(heights)) / heights.size
    slope = np.sqrt(np.sum((2 * np.pi * q * spectrum) ** 2))
    return Scene(
        Surface(heights * 0.05 / slope, (1.0,) * heights.ndim, seed=seed),
        Material((1 - 0.3**2) / 0.05, 0.3, yield_stress=0.2),
        Load(load),
    )
