"""Solvers that misbehave, and one that behaves, for `--solver hostile:<name>` (test_hostile.py)."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import ducc0
import numpy as np

from epcontact.errors import NotConverged
from epcontact.results import ELASTIC, Areas, ContactResult, LoadStep, Provenance
from epcontact.scene import Scene


def full_contact(scene: Scene) -> ContactResult:
    """A half-space pressed flat: p_q = E* q h_q / 2 of each mode of a line."""
    heights, (period,) = scene.surface.heights, scene.surface.periods
    q = 2 * np.pi / period * np.arange(heights.size // 2 + 1)
    modulus = scene.material.young_modulus / (1 - scene.material.poisson_ratio**2)
    modes = modulus / 2 * q * np.fft.rfft(heights)
    pressure = scene.load.final + np.fft.irfft(modes, heights.size)
    areas = Areas(1.0, 1.0, 0.0)
    step = LoadStep(scene.load.final, {"raw": areas, "corrected": areas})
    state = np.full(heights.shape, ELASTIC)
    fields = {"pressure": pressure, "gap": np.zeros_like(heights), "state": state}
    return ContactResult("full_contact", (step,), Provenance(scene.digest), fields=fields)


def exits_with_success(scene: Scene) -> ContactResult:
    """As Fortran's STOP does."""
    os._exit(0)


def exits_with_3(scene: Scene) -> ContactResult:
    os._exit(3)


def raises_system_exit(scene: Scene) -> ContactResult:
    sys.exit(0)


def breaks_memory(scene: Scene) -> ContactResult:
    ctypes.string_at(0)
    raise AssertionError


def is_killed(scene: Scene) -> ContactResult:
    """As the system does when no memory is left."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def has_no_memory(scene: Scene) -> ContactResult:
    np.empty(1 << 50)
    raise AssertionError


def hangs(scene: Scene) -> ContactResult:
    """Waits for ever for a process of its own, and leaves the ids of both."""
    waiting = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"])
    Path("pids").write_text(f"{os.getpid()} {waiting.pid}")
    time.sleep(3600)
    raise AssertionError


def stalls(scene: Scene) -> ContactResult:
    raise NotConverged("the residual stalled at 1e-2", {"gap": 1e-2}, (1.0, 1e-2))


def divides_by_zero(scene: Scene) -> ContactResult:
    raise ZeroDivisionError("an honest mistake \a")


def returns_a_table(scene: Scene) -> Any:
    return {"area": 0.1}


def returns_another_grid(scene: Scene) -> ContactResult:
    return replace(full_contact(scene), fields={"pressure": np.zeros(3)})


def returns_words(scene: Scene) -> ContactResult:
    """Areas that are no numbers."""
    result = full_contact(scene)
    areas = {kind: Areas("a", "b", "c") for kind in ("raw", "corrected")}  # type: ignore[arg-type]
    return replace(result, steps=(replace(result.final, areas=areas),))


def has_not_converged(scene: Scene) -> ContactResult:
    return replace(full_contact(scene), converged=False)


def has_no_steps(scene: Scene) -> ContactResult:
    return replace(full_contact(scene), steps=())


def changes_its_scene(scene: Scene) -> ContactResult:
    """Answers a scene without roughness that it makes of the one it was given."""
    heights = scene.surface.heights
    try:
        heights[:] = 0
    except ValueError:
        heights.flags.writeable = True
        heights[:] = 0
    object.__setattr__(scene.material, "young_modulus", 1.0)
    return full_contact(scene)


def prints(scene: Scene) -> ContactResult:
    """Fills its standard output, which is not the verdict's."""
    print("all gates hold\n" * 20000)
    os.write(1, b"\x80\x04\x95")
    return full_contact(scene)


def answers_or_dies(item: str) -> str:
    """A task of the pool, and not a solver."""
    if item == "dies":
        os._exit(0)
    return str(os.getppid()) if item == "parent" else item.upper()


def transforms() -> None:
    """What every solver does, for which ducc0 would start threads."""
    ducc0.fft.r2c(np.ones((8, 8)), nthreads=1)


def starts_a_thread() -> None:
    """What makes a process no template."""
    threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
