"""The elastic closed forms against each other: inverses, integrals, limits, energies, kernels."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from epcontact.reference import bumps, layers, posts, waves

RADIUS, MODULUS = 2.5e-3, 70e9


def integral(function, *bounds, **options):
    return quad(
        lambda x: float(function(x)), *bounds, epsabs=1e-13, epsrel=1e-11, limit=200, **options
    )[0]


def periodic_displacement(pressure, points, period):
    """Displacement at a line's points under p, mean free: kernel -(2/(pi E*)) ln|2 sin(pi x/L)|.

    A spectral sum over cell-averaged samples; the pressure's kinks limit it to about 1e-5.
    """
    n = len(pressure)
    q = 2 * np.pi * np.fft.rfftfreq(n, period / n)
    symbol = np.zeros_like(q)
    symbol[1:] = 2 / (MODULUS * q[1:])
    u = np.fft.irfft(symbol * np.fft.rfft(pressure), n)
    return np.interp(points, np.arange(n) * period / n, u)


class TestSphere:
    def test_radius_and_force_are_inverse(self):
        a = bumps.sphere_contact_radius(12.0, RADIUS, MODULUS)
        assert bumps.sphere_force(a, RADIUS, MODULUS) == pytest.approx(12.0, rel=1e-14)

    def test_lattice_sums(self):
        mpmath = pytest.importorskip("mpmath")
        for power, value in ((1.5, bumps.LATTICE_SUM_3), (2.5, bumps.LATTICE_SUM_5)):
            exact = 4 * mpmath.zeta(power) * mpmath.dirichlet(power, [0, 1, 0, -1])
            assert value == pytest.approx(float(exact), rel=1e-14)
        madelung = -4 * mpmath.zeta(0.5) * mpmath.dirichlet(0.5, [0, 1, 0, -1])
        assert pytest.approx(float(madelung), rel=1e-14) == bumps.MADELUNG

    @pytest.mark.parametrize("ratio", [0.05, 0.1, 0.2])
    def test_images_act_as_extra_curvature(self, ratio):
        period = 1e-3
        force = bumps.sphere_force(ratio * period, RADIUS, MODULUS)
        a = bumps.sphere_contact_radius_periodic(force, RADIUS, MODULUS, period)
        leading = (1 + 1.91699406 * ratio**3) ** (-1 / 3)
        # What the leading order leaves out grows as (a/L)^5; its coefficient is below 3.
        assert a / (ratio * period) == pytest.approx(leading, abs=3 * ratio**5)
        assert a < ratio * period

    def test_without_images_it_is_hertz(self):
        a = bumps.sphere_contact_radius_periodic(5.0, RADIUS, MODULUS, math.inf)
        assert a == pytest.approx(bumps.sphere_contact_radius(5.0, RADIUS, MODULUS), rel=1e-12)

    def test_mean_free_displacement_shifts_the_approach(self):
        """The mean-free displacement of the lattice at the load less the load's own."""
        period, force, n = 1.0, 1.0, 400
        q = np.hypot(*np.meshgrid(*2 * [2 * np.pi * np.arange(-n, n + 1)], indexing="ij"))
        width = 0.02  # a Gaussian load: its own displacement at the middle is closed
        q[n, n] = np.inf
        lattice = np.sum(2 / (MODULUS * q) * np.exp(-((q * width) ** 2) / 2))
        alone = 2 / MODULUS / (2 * math.pi) * math.sqrt(math.pi / 2) / width
        # Curvature of the image field over the load: S_3 w^2/2 of the unit F/(pi E* L).
        curvature = bumps.LATTICE_SUM_3 * width**2 / 2 / (math.pi * MODULUS)
        shift = -bumps.MADELUNG * force / (math.pi * MODULUS * period)
        assert lattice - alone - curvature == pytest.approx(shift, rel=1e-6)


class TestCylinder:
    def test_half_width_and_force_are_inverse(self):
        b = bumps.cylinder_half_width_periodic(3e4, RADIUS, MODULUS, 1e-3)
        assert bumps.cylinder_force_periodic(b, RADIUS, MODULUS, 1e-3) == pytest.approx(
            3e4, rel=1e-13
        )

    @pytest.mark.parametrize("ratio", [0.1, 0.3, 0.45])
    def test_periodic_pressure_carries_the_force(self, ratio):
        period = 1e-3
        a = ratio * period
        force = 2 * integral(
            lambda x: bumps.cylinder_pressure_periodic(x, a, RADIUS, MODULUS, period), 0, a
        )
        expected = bumps.cylinder_force_periodic(a, RADIUS, MODULUS, period)
        assert force == pytest.approx(expected, rel=1e-8)

    def test_periodic_pressure_flattens_the_parabola(self):
        """In the contact, g = x^2/(2 R) + u is constant: the periodic form is exact."""
        period, n = 1e-3, 1 << 15
        x = np.arange(n) * period / n
        near = np.minimum(x, period - x)
        a = 0.35 * period
        p = bumps.cylinder_pressure_periodic(near, a, RADIUS, MODULUS, period)
        inside = np.linspace(0, 0.98 * a, 50)
        gap = inside**2 / (2 * RADIUS) + periodic_displacement(p, inside, period)
        assert np.ptp(gap) < 1e-5 * a**2 / RADIUS

    def test_first_order_of_the_images(self):
        period = 1e-3
        deviations = []
        for ratio in (0.01, 0.02):
            a = ratio * period
            free = math.pi * MODULUS * a**2 / (4 * RADIUS)  # Hertz
            ratio_of_forces = bumps.cylinder_force_periodic(a, RADIUS, MODULUS, period) / free
            leading = 1 + math.pi**2 / 6 * ratio**2
            deviations.append(ratio_of_forces - leading)
        assert deviations[1] / deviations[0] == pytest.approx(16, rel=0.02)

    def test_one_cylinder_is_the_limit_of_a_long_period(self):
        """p = E* a/(2 R) sqrt(1 - x^2/a^2) and P' = pi E* a^2/(4 R) by Hertz."""
        a, x = 1e-4, np.linspace(0, 1e-4, 7)
        periodic = bumps.cylinder_pressure_periodic(x, a, RADIUS, MODULUS, 1.0)
        single = MODULUS * a / (2 * RADIUS) * np.sqrt(1 - (x / a) ** 2)
        np.testing.assert_allclose(periodic, single, rtol=1e-7)
        force = math.pi * MODULUS * a**2 / (4 * RADIUS)
        assert bumps.cylinder_force_periodic(a, RADIUS, MODULUS, 1.0) == pytest.approx(
            force, rel=1e-7
        )


class TestWaviness:
    @pytest.mark.parametrize("load", [0.0, 0.01, 0.3, 0.9, 1.0])
    def test_fraction_and_load_are_inverse(self, load):
        fraction = waves.line_contact_fraction(load)
        assert math.sin(math.pi * fraction / 2) ** 2 == pytest.approx(load, abs=1e-15)

    @pytest.mark.parametrize("load", [0.05, 0.5, 0.95])
    def test_means_of_pressure_and_gap(self, load):
        rim = waves.line_contact_fraction(load) / 2
        mean = 2 * integral(lambda x: waves.line_pressure(x, load), 0, rim)
        assert mean == pytest.approx(load, rel=1e-7)
        gap = 2 * integral(lambda x: waves.line_gap(x, load), rim, 0.5)
        assert gap == pytest.approx(waves.line_mean_gap(load), rel=1e-8)

    def test_limits(self):
        x = np.linspace(-1, 1, 41)
        np.testing.assert_allclose(waves.line_gap(x, 0.0), 1 - np.cos(2 * np.pi * x), atol=1e-15)
        np.testing.assert_allclose(
            waves.line_pressure(x, 1.0), 1 + np.cos(2 * np.pi * x), atol=1e-14
        )
        assert waves.line_mean_gap(0.0) == 1
        assert waves.line_mean_gap(1.0) == 0
        assert waves.line_energy(1.0) == 0.25

    def test_pressure_and_gap_solve_the_contact_problem(self):
        """The mean-free elastic displacement, less the waviness, is the gap less its mean."""
        n, load, wavelength, amplitude = 16384, 0.4, 1e-3, 2e-6
        x = (np.arange(n) + 0.5) / n
        complete = waves.line_complete_pressure(amplitude, wavelength, MODULUS)
        p = complete * waves.line_pressure(x, load)
        u = periodic_displacement(p, np.arange(n) * wavelength / n, wavelength)
        gap = u - amplitude * np.cos(2 * np.pi * x)
        expected = amplitude * waves.line_gap(x, load)
        np.testing.assert_allclose(
            gap - gap.mean(), expected - expected.mean(), atol=1e-5 * amplitude
        )

    def test_energy_is_the_work_of_the_mean_pressure(self):
        load, step = 0.37, 1e-5
        slope = (waves.line_energy(load + step) - waves.line_energy(load - step)) / 2 / step
        closing = (waves.line_mean_gap(load - step) - waves.line_mean_gap(load + step)) / (2 * step)
        assert slope == pytest.approx(load * closing, rel=1e-8)

    def test_light_line_is_hertz(self):
        amplitude, wavelength, load = 1e-6, 1e-3, 1e-6
        complete = waves.line_complete_pressure(amplitude, wavelength, MODULUS)
        radius = 1 / (amplitude * (2 * math.pi / wavelength) ** 2)
        a = math.sqrt(4 * load * complete * wavelength * radius / (math.pi * MODULUS))
        assert waves.line_contact_fraction(load) == pytest.approx(2 * a / wavelength, rel=1e-6)

    def test_light_surface_is_hertz(self):
        amplitude, wavelength, load = 1e-6, 1e-3, 1e-4
        complete = waves.surface_complete_pressure(amplitude, wavelength, MODULUS)
        radius = 1 / (amplitude * (2 * math.pi / wavelength) ** 2)
        force = load * complete * wavelength**2 / 2
        a = bumps.sphere_contact_radius(force, radius, MODULUS)
        expected = 2 * math.pi * a**2 / wavelength**2
        assert waves.surface_contact_fraction_light(load) == pytest.approx(expected, rel=1e-12)

    def test_heavy_surface_has_penny_shaped_gaps(self):
        """The load on a hole of radius b has no stress intensity at its rim."""
        load = 0.99
        hole = math.sqrt((1 - waves.surface_contact_fraction_heavy(load)) / (2 * math.pi))
        missing = integral(
            lambda r: r * ((1 - load) - 2 * math.pi**2 * r**2) / math.sqrt(hole**2 - r**2),
            0,
            hole,
        )
        assert missing == pytest.approx(0, abs=1e-9 * hole)


class TestPost:
    def test_pressure_carries_the_force(self):
        period, a = 4.0, 1.0

        def substituted(t):  # sin(pi x/L) = sin(pi a/L) sin(t) takes the singularity out
            sine = math.sin(math.pi * a / period) * math.sin(t)
            x = period / math.pi * math.asin(sine)
            slope = math.sin(math.pi * a / period) * math.cos(t) * period / math.pi
            pressure = posts.strip_pressure_periodic(np.array(x), 5.0, a, period)
            return pressure * slope / math.sqrt(1 - sine**2)

        # The part left out at the rim is 5/pi 2e-6.
        assert 2 * integral(substituted, 0, math.pi / 2 - 1e-6) == pytest.approx(5.0, rel=3e-6)

    def test_rim_and_outside(self):
        pressure = posts.strip_pressure_periodic(np.array([0.0, 1.0, 1.5]), 1.0, 1.0, 4.0)
        assert 0 < pressure[0] < pressure[1]
        assert pressure[2] == 0

    def test_the_cylinder_is_built_from_punches(self):
        """dP'/da times the punch of half-width a is the growth of the cylinder's pressure."""
        period, a, step, x = 1e-3, 2e-4, 1e-9, np.linspace(0, 1.5e-4, 5)

        def force(b):
            return bumps.cylinder_force_periodic(b, RADIUS, MODULUS, period)

        def pressure(b):
            return bumps.cylinder_pressure_periodic(x, b, RADIUS, MODULUS, period)

        growth = (pressure(a + step) - pressure(a - step)) / (2 * step)
        rate = (force(a + step) - force(a - step)) / (2 * step)
        np.testing.assert_allclose(
            growth, posts.strip_pressure_periodic(x, rate, a, period), rtol=1e-6
        )


class TestLayer:
    @pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
    def test_agrees_with_the_published_closed_forms(self, nu):
        """Carbone and Mangialardi (2008), equation A.30; the sliding form by cosh and sinh."""
        depth, young = 1e-3, 200e9
        q = np.array([[0.3, 1.0], [3.0, 12.0]]) / depth
        x = q * depth
        half_space = 2 * (1 - nu**2) / (young * q)
        bonded = ((3 - 4 * nu) * np.sinh(2 * x) - 2 * x) / (
            (3 - 4 * nu) * np.cosh(2 * x) + 2 * x**2 + 5 - 12 * nu + 8 * nu**2
        )
        sliding = (np.cosh(2 * x) - 1) / (np.sinh(2 * x) + 2 * x)
        for is_bonded, factor in ((True, bonded), (False, sliding)):
            solved = layers.surface_compliance(q, depth, young, nu, bonded=is_bonded)
            assert solved.shape == q.shape
            np.testing.assert_allclose(solved, half_space * factor, rtol=1e-11)

    def test_limits(self):
        depth, young, nu = 1e-3, 200e9, 0.3
        thick = np.array([50.0, 700.0]) / depth
        half_space = 2 * (1 - nu**2) / (young * thick)
        thin = np.array([1e-2]) / depth
        for bonded in (True, False):
            solved = layers.surface_compliance(thick, depth, young, nu, bonded=bonded)
            np.testing.assert_allclose(solved, half_space, rtol=1e-13)
        lame = layers.lame_compliance(depth, young, nu)
        bonded_thin = layers.surface_compliance(thin, depth, young, nu)[0]
        assert bonded_thin == pytest.approx(lame, rel=1e-3)  # the next term is of order (q d)^2
        sliding_thin = layers.surface_compliance(thin, depth, young, nu, bonded=False)[0]
        # A thin sliding layer is in plane stress along its modes: d/E*, not d/M.
        assert sliding_thin == pytest.approx(depth * (1 - nu**2) / young, rel=1e-3)

    def test_uniaxial_yield_is_where_mises_says(self):
        nu, pressure = 0.3, layers.uniaxial_yield_pressure(1.0, 0.3)
        lateral = nu / (1 - nu) * pressure
        assert pressure - lateral == pytest.approx(1.0, rel=1e-14)
