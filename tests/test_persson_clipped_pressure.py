"""Gap, plastic displacement and energy by a clipped random pressure."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ndtri
from scipy.stats import norm

from epcontact.errors import InvalidScene
from epcontact.persson import (
    EnergyReduction,
    Theory,
    analytic_roughness,
    roughness_of,
)
from epcontact.persson.clipped_pressure import _KNOTS, _Field, displacements
from epcontact.scene import SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

SPECTRUM = SelfAffineSpectrum(0.8, 1.0, 4.0, 32.0, 1.0)
ROUGH = analytic_roughness(SPECTRUM)
RMS_HEIGHT = math.sqrt(ROUGH.height_variance.sum())


def moved(p0, hardness=math.inf, roughness=ROUGH, **options):
    """Return the displacements of a body with E* = 1 and the rms slope 1.

    `p0` and `hardness` are over E*; `options` are those of `displacements`.
    """
    theory = Theory(roughness, 1.0, EnergyReduction(0.536), hardness)
    return displacements(theory, p0, **options)


def test_full_contact_has_the_energy_of_the_whole_roughness_and_no_gap():
    """Under a large load the energy is E*/4 times m_1, without gap or flow."""
    found = moved(5.0, 20.0)
    assert found.elastic_energy == pytest.approx(ROUGH.first_moment.sum() / 4, rel=1e-3)
    assert abs(found.mean_gap) < 1e-9 * RMS_HEIGHT
    assert abs(found.plastic_displacement) < 1e-9 * RMS_HEIGHT


@pytest.mark.parametrize("load", [0.05, 0.3, 0.8])
def test_a_rigid_plastic_body_has_the_gap_over_a_level_of_the_heights(load):
    """A body much softer than E* xi is cut at a level of its Gaussian heights.

    `load` is p0 over the hardness.  The gap is the mean of the level less the height
    where the height is below it.
    """
    found = moved(load * 1e-3, 1e-3)
    n = ndtri(1 - load)
    exact = RMS_HEIGHT * (n * norm.cdf(n) + norm.pdf(n))
    assert found.mean_gap == pytest.approx(exact, rel=4e-3)


@pytest.mark.parametrize("load", [0.01, 0.2])
def test_gap_and_flow_change_places_in_the_mirror_image(load):
    """At the load hardness - p0 the plastic displacement is the gap at p0."""
    found = moved(load, 0.6)
    mirrored = moved(0.6 - load, 0.6)
    assert mirrored.plastic_displacement == pytest.approx(found.mean_gap, rel=1e-9)
    assert mirrored.mean_gap == pytest.approx(found.plastic_displacement, rel=1e-9)
    assert mirrored.elastic_energy == pytest.approx(found.elastic_energy, rel=1e-9)


@pytest.mark.parametrize(("load", "hardness"), [(0.05, 0.6), (0.05, 0.2), (0.4, 1.2)])
def test_gap_and_flow_are_the_derivatives_of_one_potential(load, hardness):
    """Phi = -U - p0 gap - p1 flow has the derivatives -gap by p0 and -flow by p1.

    p1 is the distance of p0 from the hardness, and load and hardness are over E*.
    """

    def potential(p0, p1):
        """Return Phi at a load and a distance from the hardness, both over E*."""
        at = moved(p0, p0 + p1)
        return -at.elastic_energy - p0 * at.mean_gap - p1 * at.plastic_displacement

    found = moved(load, hardness)
    p1 = hardness - load
    step = 0.02 * load
    by_load = potential(load + step, p1) - potential(load - step, p1)
    by_distance = potential(load, p1 + step) - potential(load, p1 - step)
    assert -by_load / (2 * step) == pytest.approx(found.mean_gap, rel=2e-3)
    flow = pytest.approx(found.plastic_displacement, rel=2e-3, abs=1e-4 * RMS_HEIGHT)
    assert -by_distance / (2 * step) == flow


@pytest.mark.parametrize("hardness", [0.3, math.inf])
def test_the_potential_of_a_trial_pressure_is_that_of_a_drawn_field(hardness):
    """Energy and potential agree with those of a field drawn on a grid.

    The field y_q = a(q) h_q of a rough surface is clipped to the mean pressure .05 E*,
    and its energy is summed over its Fourier modes.  `hardness` is over E*.
    """
    lowest = 5.0
    spectrum = SelfAffineSpectrum(0.8, lowest, 10.0, 40.0, 1.0)
    size = 256
    periods = (2 * math.pi,) * 2
    x = np.linspace(0.5, -0.2, _KNOTS)
    energies = []
    works = []
    for seed in range(4):
        surface = SelfAffine(spectrum, periods, (size, size), seed).build()
        wavenumber = np.fft.fftfreq(size, 1 / size)
        q = np.hypot(wavenumber[:, None], wavenumber)
        q[0, 0] = 1.0
        position = np.log(q / lowest) / math.log(40 / lowest) * (_KNOTS - 1)
        factor = np.exp(np.interp(position, np.arange(_KNOTS), x))
        modes = np.fft.fft2(surface.heights)
        y = np.fft.ifft2(q / 2 * factor * modes).real
        low, high = -10.0, 10.0
        for _ in range(60):
            m = (low + high) / 2
            pressure = np.clip(y + m, 0, hardness)
            if pressure.mean() < 0.05:
                low = m
            else:
                high = m
        of_pressure = np.fft.fft2(pressure) / size**2
        of_pressure[0, 0] = 0.0
        energies.append(np.sum(abs(of_pressure) ** 2 / q))
        works.append(np.mean(pressure * surface.heights))
    field = _Field(analytic_roughness(spectrum), saved_energy=0.0)
    found = field.evaluate(x, 0.05, hardness)
    # The field's lengths are in units of the longest wave.
    energy = np.mean(energies) * lowest
    assert found.energy == pytest.approx(energy, rel=0.02)
    potential = energy - np.mean(works) * lowest
    assert found.potential == pytest.approx(potential, rel=0.02)


def test_the_trial_pressures_bound_the_potential_from_above():
    """Without saved energy the gap of a lightly loaded body is smaller."""
    bound = moved(0.02, saved_energy=0.0)
    found = moved(0.02)
    assert 1.02 < found.mean_gap / bound.mean_gap < 1.06


def test_the_rings_of_a_surface_give_what_its_spectrum_gives():
    """A surface with many waves in a period has the gap of its analytic spectrum."""
    spectrum = SelfAffineSpectrum(0.8, 1.0, 8.0, 32.0, 1.0)
    surface = SelfAffine(spectrum, (2 * math.pi,) * 2, (128, 128), 1).build()
    analytic = moved(0.05, 0.6, analytic_roughness(spectrum))
    rings = moved(0.05, 0.6, roughness_of(surface, "surface"))
    assert_allclose(rings, analytic, rtol=0.02)


def test_a_flat_surface_has_nothing_and_a_load_beyond_the_hardness_is_refused():
    """A flat surface has neither gap nor energy."""
    flat = roughness_of(Surface(np.zeros((8, 8)), (1.0, 1.0)), "surface")
    assert moved(0.05, 0.6, flat) == (0.0, 0.0, 0.0)
    with pytest.raises(InvalidScene, match="between 0 and the hardness"):
        moved(0.7, 0.6)
