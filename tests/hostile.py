"""Solvers that misbehave, and one that behaves, for `--solver hostile:<name>`
(test_hostile.py).
"""

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
    """Return the solution of a line that is pressed flat: p_q = E* q h_q / 2 for each
    mode.

    `scene` is an epcontact.Scene of a half-space; the result has pressure (Pa) and gap
    (m).
    """
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
    """Wait for ever for a process of its own, and write the ids of both to the file
    "pids".
    """
    waiting = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"])
    Path("pids").write_text(f"{os.getpid()} {waiting.pid}")
    time.sleep(3600)


def exits_with_success(_):
    """End the process with exit code 0, as Fortran's STOP does."""
    os._exit(0)


def raises_system_exit(_):
    """Exit with code 0 instead of solving."""
    sys.exit(0)


def breaks_memory(_):
    """Read the address 0, which kills the process."""
    ctypes.string_at(0)


def is_killed(_):
    """Kill its own process, as the system does for want of memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def divides_by_zero(_):
    """Raise ZeroDivisionError."""
    return 1 // 0


def has_no_memory(_):
    """Raise MemoryError by asking for an array of 2^50 numbers."""
    return np.empty(1 << 50)


def returns_a_table(_):
    """Return a dictionary instead of a result."""
    return {"area": 0.1}


def returns_another_grid(scene):
    """Return the result of `full_contact` with a pressure on 3 points instead of the
    scene's 32.
    """
    return replace(full_contact(scene), fields={"pressure": np.zeros(3)})


def presses_infinitely(scene):
    """Return the result of `full_contact` with infinite pressures."""
    return replace(full_contact(scene), fields={"pressure": np.full(32, np.inf)})


def leaves_no_name(scene):
    """Return the result of `full_contact` with a field whose name is ""."""
    return replace(full_contact(scene), fields={"": np.zeros(32)})


def names_a_number(scene):
    """Return the result of `full_contact` with a field whose name is a number."""
    return replace(full_contact(scene), fields={1: np.zeros(32)})


def has_no_steps(scene):
    """Ask for a result without load steps, for which ContactResult raises
    ValueError.
    """
    return replace(full_contact(scene), steps=())


def answers_twice(scene):
    """Return the result of `full_contact` with two steps for one load."""
    result = full_contact(scene)
    return replace(result, steps=2 * result.steps)


def is_unsure(scene):
    """Return the result of `full_contact` with a word for `converged`, which must be 0
    or 1.
    """
    return replace(full_contact(scene), converged="yes")


def is_far_off(scene):
    """Return the result of `full_contact` with a step at 1 GPa and a residual that is
    NaN.
    """
    step = LoadStep(1e9, {}, residuals={"gap": np.nan})
    return replace(full_contact(scene), steps=(step,))


def returns_a_list(scene):
    """Return the result of `full_contact` with a list as a quantity."""
    step = LoadStep(1e9, {}, quantities={"a": [1]})
    return replace(full_contact(scene), steps=(step,))


def has_saved_work(scene):
    """Return the result of `full_contact` with -1 pairs of Fourier transforms as its
    cost.
    """
    return replace(full_contact(scene), cost={"fft_pairs": -1})


class Runs(str):
    """A name of a field that ends its process if it is unpickled."""

    __slots__ = ()

    def __reduce__(self):
        """Return what pickle calls to restore the name: sys.exit."""
        return sys.exit, ("a name ran",)


def invents_its_path(scene):
    """Return the pressures of boundary elements at the last load, and invented areas
    and quantities.

    Its process computes invented areas from then on, too.
    """
    invented = Areas(7, 8, -1)
    areas = dict.fromkeys(("raw", "corrected", "error"), invented)
    quantities = {
        "stiffness_loading": 1e15,
        "mean_gap": 1.0,
        "plastic_force_share": 0.5,
        "wear": 5.0,
    }
    result = bem.solve(scene)
    steps = [replace(step, areas=areas, quantities=quantities) for step in result.steps]

    def invent_areas(*_, **__):
        """Return invented areas instead of raw and corrected ones and their error."""
        return invented, invented, invented

    bem.driver.estimate_areas = invent_areas
    return replace(
        result,
        steps=tuple(steps),
        distribution=results.PressureDistribution(
            [0.0, 2 * scene.load.final], [0.0, 0.3]
        ),
        fields={"pressure": result.fields["pressure"]},
    )


def errs_at_the_first_load(scene):
    """Return the pressures of the boundary elements, at the first load moved by one
    point.
    """
    result = bem.solve(scene)
    points_off = int(len(scene.load.path) == 1)
    pressure = np.roll(result.fields["pressure"], points_off)
    return replace(result, fields={"pressure": pressure})


def changes_its_scene(scene):
    """Set the heights of the scene it is given to 0 and its Young's modulus to 1 Pa,
    and return the solution of that.
    """
    scene.surface.heights.flags.writeable = True
    scene.surface.heights[:] = 0
    object.__setattr__(scene.material, "young_modulus", 1.0)
    return full_contact(scene)


def prints(scene):
    """Return the result of `full_contact` and fill the standard output of its process.

    One field has a name that would end the process if it were unpickled.
    """
    print("all gates hold\n" * 20000)
    os.write(1, b"\x80\x04\x95")
    result = full_contact(scene)
    fields = {**result.fields, Runs("mine"): result.fields["gap"]}
    return replace(result, fields=fields)


def answers_or_dies(item):
    """Return a text in capitals, or end the process for "dies".

    This is a task of the pool, and not a solver.
    """
    if item == "dies":
        os._exit(0)
    return item.upper()
