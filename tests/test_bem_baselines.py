"""The classic methods find the same minimum, or say that they did not."""

import math

import numpy as np
import pytest

from epcontact import bem
from epcontact.bem.baselines import BASELINES
from epcontact.errors import NotConverged
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum
from epcontact.surfaces import SelfAffine

E = 250e9
PERIOD = 2 * math.pi / 2.5e4


def scene(hardness: float, shape: tuple[int, ...] = (48, 40)) -> Scene:
    spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 2.5e5, 1.0)
    surface = SelfAffine(spectrum, (PERIOD,) * len(shape), shape, 5).build()
    return Scene(surface, Material(E, 0.0, hardness), Load(0.05 * E))


@pytest.mark.parametrize("hardness", [math.inf, 0.6 * E])
@pytest.mark.parametrize("shape", [(48, 40), (90,)])
@pytest.mark.parametrize("method", BASELINES)
def test_same_minimum_as_newton(method, hardness, shape):
    problem = scene(hardness, shape)
    newton = bem.solve(problem, threads=1, tolerance=1e-9)
    other = bem.solve(problem, threads=1, tolerance=1e-7, method=method)
    assert other.provenance.options["method"] == method
    assert max(other.final.residuals.values()) <= 1e-7
    difference = np.abs(other.fields["pressure"] - newton.fields["pressure"])
    # A gap error of 1e-7 h_rms is worth E* pi/(2 dx) 1e-7 h_rms = 3e-7 E* of pressure at most.
    assert difference.max() < 1e-6 * E
    assert other.final.areas["raw"] == newton.final.areas["raw"]


@pytest.mark.parametrize("method", BASELINES)
def test_running_out_of_steps_is_said(method):
    with pytest.raises(NotConverged, match=f"{method} did not reach 1e-08 in 4 steps") as caught:
        bem.solve(scene(0.6 * E), threads=1, method=method, max_steps=4)
    assert len(caught.value.history) == 5
    assert max(caught.value.residuals.values()) > 1e-8
