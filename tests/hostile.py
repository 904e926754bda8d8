"""Solvers that misbehave, and one that behaves, for `--solver hostile:<name>`
(test_hostile.py).
"""

# ruff: noqa: E731

import ctypes
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from epcontact import bem, results
from epcontact.results import Areas, ContactResult, LoadStep, Provenance


def full_contact(scene):
    """A half-space pressed flat: p_q = E* q h_q / 2 of each mode of a line."""
    heights, (period,) = scene.surface.heights, scene.surface.periods
    q = 2 * np.pi / period * np.arange(heights.size // 2 + 1)
    modulus = scene.material.young_modulus / (1 - scene.material.poisson_ratio**2)
    modes = modulus / 2 * q * np.fft.rfft(heights)
    pressure = scene.load.final + np.fft.irfft(modes, heights.size)
    step = LoadStep(scene.load.final, {})
    fields = {"pressure": pressure, "gap": np.zeros_like(heights)}
    return ContactResult(
        "full_contact", (step,), Provenance(scene.digest), fields=fields
    )


def hangs(_):
    """Waits for ever for a process of its own, and leaves the ids of both."""
    waiting = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"])
    Path("pids").write_text(f"{os.getpid()} {waiting.pid}")
    time.sleep(3600)


exits_with_success = lambda _: os._exit(0)  # as Fortran's STOP does
raises_system_exit = lambda _: sys.exit(0)
breaks_memory = lambda _: ctypes.string_at(0)
is_killed = lambda _: os.kill(os.getpid(), signal.SIGKILL)  # as for want of memory
divides_by_zero = lambda _: 1 // 0
has_no_memory = lambda _: np.empty(1 << 50)
returns_a_table = lambda _: {"area": 0.1}
returns_another_grid = lambda s: replace(
    full_contact(s), fields={"pressure": np.zeros(3)}
)
has_no_steps = lambda scene: replace(full_contact(scene), steps=())
leaves_no_name = lambda s: replace(full_contact(s), fields={"": np.zeros(32)})
answers_twice = lambda s: replace(full_contact(s), steps=2 * full_contact(s).steps)
names_a_number = lambda s: replace(full_contact(s), fields={1: np.zeros(32)})
is_unsure = lambda s: replace(full_contact(s), converged="yes")
is_far_off = lambda s: replace(
    full_contact(s), steps=(LoadStep(1e9, {}, {"gap": np.nan}),)
)
presses_infinitely = lambda s: replace(
    full_contact(s), fields={"pressure": np.full(32, np.inf)}
)
returns_a_list = lambda s: replace(
    full_contact(s), steps=(LoadStep(1e9, {}, {}, {}, {"a": [1]}),)
)
has_saved_work = lambda s: replace(full_contact(s), cost={"fft_pairs": -1})
Runs = type("Runs", (str,), {"__reduce__": lambda _: (sys.exit, ("a name ran",))})


def invents_its_path(scene):
    """Pressures of the boundary elements at a last load; whatever its process computes
    of them from then on is as invented as the figures beside them.
    """
    own, areas = (
        bem.solve(scene),
        dict.fromkeys(("raw", "corrected", "error"), Areas(7, 8, -1)),
    )
    figures = {
        "stiffness_loading": 1e15,
        "mean_gap": 1.0,
        "plastic_force_share": 0.5,
        "wear": 5.0,
    }
    steps = tuple(replace(step, areas=areas, quantities=figures) for step in own.steps)
    other = results.PressureDistribution([0.0, 2 * scene.load.final], [0.0, 0.3])
    alone = {"pressure": own.fields["pressure"]}
    bem.driver.estimate_areas = lambda *_, **__: (*areas.values(),)
    return replace(own, steps=steps, distribution=other, fields=alone)


def errs_at_the_first_load(scene):
    """Pressures of the boundary elements, at the first load those of its neighbour
    points.
    """
    found, turn = bem.solve(scene), len(scene.load.path) == 1
    return replace(found, fields={"pressure": np.roll(found.fields["pressure"], turn)})


def changes_its_scene(scene):
    """Answers a scene without roughness that it makes of the one it was given."""
    scene.surface.heights.flags.writeable = True
    scene.surface.heights[:] = 0
    object.__setattr__(scene.material, "young_modulus", 1.0)
    return full_contact(scene)


def prints(scene):
    """Fills its standard output, which is not the verdict's; a name would run if
    unpickled.
    """
    print("all gates hold\n" * 20000)
    os.write(1, b"\x80\x04\x95")
    return replace(
        f := full_contact(scene), fields={**f.fields, Runs("mine"): f.fields["gap"]}
    )


def answers_or_dies(item):
    """A task of the pool, and not a solver."""
    return os._exit(0) if item == "dies" else item.upper()
