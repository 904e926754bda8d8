"""Contacts without a rim: full contact of half-space and layers, and the flat surface.

The compliance of an elastic layer on a rigid base is computed mode by mode from the
plane-strain boundary-value problem, so that it can check the closed form that the
boundary elements use.  With depth z downward, Airy's function phi = f(z) cos(q x) and
    f = (A + B q z) e^(-q z) + (C + D q (d - z)) e^(-q (d - z))
gives sigma_zz = -q^2 f cos, sigma_xz = q f' sin, sigma_xx = f'' cos, and with
k = nu/(1 - nu), s = 1/E* = (1 - nu^2)/E, m = 2 (1 + nu)/E the displacements
    u_x = (s/q) [f'' + k q^2 f] sin,    u_z = {(s/q^2) [f''' + k q^2 f'] - m f'} cos.
The load sigma_zz = -p cos at z = 0 without shear is f = p/q^2, f' = 0; the base is
bonded, u_x = u_z = 0, or slides without friction, f' = u_z = 0.  Both exponentials
decay into the layer, so that the 4 x 4 system stays well conditioned however deep the
layer is.  The same compliance serves a two-dimensional surface with q = |q| (rotate x
into the wave vector).

Symbols: q = wavenumber (rad/m), d = depth (m), E = young_modulus (Pa), nu =
poisson_ratio, M = oedometric modulus (Pa), Y = yield_stress (Pa).
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from epcontact.materials.moduli import effective_modulus, oedometric_modulus
from epcontact.reference.form import ClosedForm
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Material, Scene

FULL_CONTACT = ClosedForm(
    "full_contact", "Johnson, Contact Mechanics (1985), section 13.2: p_q = h_q / C(q)"
)
#: Beyond this q d a layer equals the half-space in float64, because
#: 4 (q d)^2 e^(-2 q d) < 1e-13.
_DEEP = 20.0

# --- formulas


def surface_compliance(
    wavenumber: FloatArray,
    depth: float,
    young_modulus: float,
    poisson_ratio: float,
    *,
    bonded: bool = True,
) -> FloatArray:
    """Return the surface displacement per pressure of an elastic layer, in m/Pa.

    It is u_q/p_q of each wave number q.

    The relative error is 1e-16/(q d)^3.

    Args:
        wavenumber: q > 0 in rad/m, of any shape.
        depth: d in m.
        young_modulus: E in Pa.
        poisson_ratio: nu, below 0.5.
        bonded: Whether the base is bonded; else it slides without friction.

    Returns:
        Of the shape of the wave numbers.
    """
    q = np.atleast_1d(np.asarray(wavenumber, dtype=np.float64))
    x = (q * depth).ravel()
    at_top = _basis(np.zeros_like(x), x)
    at_base = _basis(x, x)
    k = poisson_ratio / (1 - poisson_ratio)
    shear = 2 / (1 - poisson_ratio)  # m / s

    # u_z without cos and u_x without sin, in units of s q p / q^2
    normal_at_top = at_top[3] + (k - shear) * at_top[1]
    normal_at_base = at_base[3] + (k - shear) * at_base[1]
    tangential_at_base = at_base[2] + k * at_base[0] if bonded else at_base[1]
    rows = [at_top[0], at_top[1], tangential_at_base, normal_at_base]
    system = np.stack(rows, axis=-2)
    load = np.zeros((x.size, 4, 1))
    load[:, 0] = 1
    coefficients = np.linalg.solve(system, load)[..., 0]
    displacement = np.sum(normal_at_top * coefficients, axis=-1)
    s = (1 - poisson_ratio**2) / young_modulus
    compliance = s * displacement / q.ravel()
    return np.asarray(compliance.reshape(np.shape(wavenumber)))


def _basis(x: FloatArray, depth: FloatArray) -> FloatArray:
    """Return the derivatives of the four functions of f at q z = x.

    Args:
        x: q z at n wave numbers, (n,).
        depth: q d at these wave numbers, (n,).

    Returns:
        Derivatives of orders 0 to 3 in units of q, (order, n, function).
    """
    y = depth - x
    down = np.exp(-x)
    up = np.exp(-y)
    derivatives = []
    for n in range(4):
        sign = (-1) ** n
        derivatives.append((sign * down, sign * (x - n) * down, up, (y - n) * up))
    return np.moveaxis(np.array(derivatives), 1, 2)


def lame_compliance(depth: float, young_modulus: float, poisson_ratio: float) -> float:
    """Return d/M in m/Pa, the compliance of mode q = 0 in uniaxial strain (Lame).

    M = E (1 - nu)/((1 + nu)(1 - 2 nu)).

    Args:
        depth: d in m.
        young_modulus: E in Pa.
        poisson_ratio: nu.
    """
    nu = poisson_ratio
    return depth * (1 + nu) * (1 - 2 * nu) / (young_modulus * (1 - nu))


def uniaxial_yield_pressure(material: Material) -> float:
    """Return the pressure in Pa at which a layer in uniaxial strain yields.

    It is Y (1 - nu)/(1 - 2 nu) by von Mises and by Tresca.

    Args:
        material: With the yield stress Y in Pa and Poisson's ratio nu below 0.5.
    """
    nu = material.poisson_ratio
    return material.yield_stress * (1 - nu) / (1 - 2 * nu)


# --- full contact


def compliance(scene: Scene) -> FloatArray:
    """Return the compliance of a scene's surface for each Fourier mode, in m/Pa.

    The modes are those of numpy.fft.rfftn on the scene's grid.  The mean of a
    half-space has the compliance 0.
    """
    surface = scene.surface
    body = scene.body
    material = scene.material
    *others, (n, d) = zip(surface.shape, surface.spacing, strict=True)
    waves = [*(np.fft.fftfreq(m, s) for m, s in others), np.fft.rfftfreq(n, d)]
    lengths = 2 * np.pi * np.sqrt(sum(wave**2 for wave in np.ix_(*waves)))
    modulus = effective_modulus(material)
    if body.kind == "half_space":
        lengths.flat[0] = math.inf  # the mean, which no pressure moves
        lengths *= modulus
        return np.asarray(np.divide(2, lengths, out=lengths))
    # Waves of the same length are solved once.
    q, index = np.unique(lengths, return_inverse=True)
    values = np.zeros(q.shape)
    values[1:] = 2 / (modulus * q[1:])
    shallow = np.flatnonzero((q > 0) & (q * body.depth < _DEEP))
    E = material.young_modulus
    nu = material.poisson_ratio
    bonded = body.kind == "bonded_layer"
    values[shallow] = surface_compliance(q[shallow], body.depth, E, nu, bonded=bonded)
    values[0] = lame_compliance(body.depth, E, nu)
    return np.asarray(values[index].reshape(lengths.shape))


@FULL_CONTACT.gives("field.pressure")
def _full_pressure(scene: Scene) -> FloatArray:
    """Return the pressure of full contact in Pa at each grid point of the scene.

    Each mode of the pressure is the mode of the heights over its compliance.

    Raises:
        InvalidCase: The load leaves a gap, or the body flows.
    """
    C = compliance(scene)
    C.flat[0] = math.inf
    heights = scene.surface.heights
    modes = np.fft.rfftn(heights) / C
    fluctuation = np.fft.irfftn(modes, heights.shape, axes=range(heights.ndim))
    pressure = scene.load.final + fluctuation
    is_admissible = pressure.min() >= 0 and pressure.max() <= scene.material.hardness
    FULL_CONTACT.require(
        bool(is_admissible), "a load that closes every gap without yielding"
    )
    return np.asarray(pressure)


@FULL_CONTACT.gives("area.total", "area.elastic")
def _full_area(scene: Scene) -> float:
    """Return 1, the contact area of full contact as a fraction.

    Raises InvalidCase if the scene's load leaves a gap, or its body flows.
    """
    _full_pressure(scene)
    return 1.0


@FULL_CONTACT.gives("area.plastic", "quantity.mean_gap")
def _nothing(scene: Scene) -> float:
    """Return 0, the plastic area and the gap of full contact.

    Raises InvalidCase if the scene's load leaves a gap, or its body flows.
    """
    return 1 - _full_area(scene)


@FULL_CONTACT.gives("quantity.elastic_energy")
def _full_energy(scene: Scene) -> float:
    """Return the elastic energy of full contact, in J per m^2 of nominal area.

    It is half of the mean of pressure times displacement, which is that of the heights
    and of the mean load.

    Args:
        scene: The surface, the material, the body and the load; the last load is used.

    Raises:
        InvalidCase: The load leaves a gap, or the body flows.
    """
    pressure = _full_pressure(scene)
    heights = scene.surface.heights
    work_of_mean = scene.load.final**2 * compliance(scene).flat[0]
    work = np.mean(pressure * (heights - heights.mean()))
    return float(work + work_of_mean) / 2


@FULL_CONTACT.gives("distribution")
def _full_distribution(scene: Scene) -> PressureDistribution:
    """Return the distribution of the pressures of all grid points in full contact.

    Raises InvalidCase if the scene's load leaves a gap, or its body flows.
    """
    pressure = np.sort(_full_pressure(scene), axis=None)
    cumulative = np.arange(pressure.size + 1) / pressure.size
    return PressureDistribution(np.concatenate([[0], pressure]), cumulative)


# --- a flat surface


class _Flat(ClosedForm):
    """A level layer under uniform pressure.

    The uniform pressure is given for any scene, so that a gate can measure the distance
    of a field from it.  Values are given for level layers only.
    """

    def scalar(self, quantity: str, scene: Scene) -> float:
        """Return the exact value of a quantity of a level layer, in its SI unit.

        Args:
            quantity: Its name, such as "quantity.approach".
            scene: The scene.

        Raises:
            InvalidCase: The surface is rough, the body is a half-space, or the form
                does not give the quantity.
        """
        rough_pressure = effective_modulus(scene.material) * scene.surface.rms_slope
        is_level = rough_pressure <= 1e-5 * max(scene.load.path)
        is_layer = math.isfinite(scene.body.depth)
        self.require(is_level and is_layer, "a layer without roughness")
        return super().scalar(quantity, scene)


FLAT = _Flat("flat", "a level layer under uniform pressure, in uniaxial strain (Lame)")


@FLAT.gives("area.plastic", "quantity.plastic_volume")
def _has_flowed(scene: Scene) -> float:
    """Return 1.0 if a level layer has yielded along the load path, else 0.0.

    `scene` holds the material and the mean pressures of the path.
    """
    return float(max(scene.load.path) > uniaxial_yield_pressure(scene.material))


@FLAT.gives("area.total")
def _flat_area(scene: Scene) -> float:
    """Return 1, the contact area of a level layer; `scene` is not used."""
    del scene
    return 1.0


@FLAT.gives("area.elastic")
def _flat_elastic_area(scene: Scene) -> float:
    """Return the elastic area of a level layer: 1, or 0 if the layer has yielded.

    The area is a fraction; `scene` holds the material and the mean pressures of the
    path.
    """
    return 1 - _has_flowed(scene)


@FLAT.gives("quantity.plastic_depth")
def _plastic_depth(scene: Scene) -> float:
    """Return the depth of a level layer's plastic zone in m: all of the layer, or 0.

    `scene` holds the material, the depth of the layer and the mean pressures of the
    path.
    """
    return _has_flowed(scene) * scene.body.depth


@FLAT.gives("quantity.mean_contact_pressure", "quantity.largest_pressure")
def _flat_pressure(scene: Scene) -> float:
    """Return the uniform pressure of a level layer at the last load, in Pa."""
    return scene.load.final


@FLAT.gives("field.pressure")
def _flat_pressure_field(scene: Scene) -> FloatArray:
    """Return the uniform pressure in Pa at each grid point, at the last load."""
    return np.full(scene.surface.shape, scene.load.final)


@FLAT.gives("distribution")
def _flat_distribution(scene: Scene) -> PressureDistribution:
    """Return the distribution of the uniform pressure at the last load, a step."""
    p0 = scene.load.final
    pressure = np.array([0, p0 * (1 - 1e-12), p0])
    return PressureDistribution(pressure, np.array([0.0, 0.0, 1.0]))


def _bulk_modulus(material: Material) -> float:
    """Return the bulk modulus K = E/(3 (1 - 2 nu)) of a material, in Pa."""
    return material.young_modulus / (3 * (1 - 2 * material.poisson_ratio))


def _largest_flow(scene: Scene) -> tuple[float, float]:
    """Return the plastic strain and the stress of a level layer at its largest load.

    At the pressure p, with the strain e and the plastic strain a, the difference q of
    the principal stresses is q = 2 mu e - 3 mu a, and p = K e + 2/3 q.  While the layer
    flows, q is the yield stress at a.

    Args:
        scene: The material and the mean pressures of the path.

    Returns:
        a: the equivalent plastic strain.
        q: the difference of the principal stresses, in Pa.
    """
    material = scene.material
    peak = max(scene.load.path)
    mu = material.young_modulus / (2 * (1 + material.poisson_ratio))
    if peak <= uniaxial_yield_pressure(material):
        return 0.0, 2 * mu * peak / oedometric_modulus(material)
    K = _bulk_modulus(material)
    curve = material.yield_curve
    # Without hardening, a is 2/3 of the strain since yield, which is below peak/K.
    growth = peak / K
    a = np.append(curve.strains, curve.strains[-1] + growth)
    q = np.append(curve.stresses, curve.stresses[-1] + curve.last_slope * growth)
    pressure = K * (q + 3 * mu * a) / (2 * mu) + 2 / 3 * q
    at_peak = [float(np.interp(peak, pressure, values)) for values in (a, q)]
    return at_peak[0], at_peak[1]


@FLAT.gives("quantity.approach")
def _compression(scene: Scene) -> float:
    """Return the approach of a level layer in uniaxial strain, in m.

    At the largest pressure p the strain is (p - 2/3 q)/K, see `_largest_flow`.
    Unloading with the oedometric modulus M is elastic while the pressure falls by less
    than twice the yield pressure.

    Args:
        scene: The material, the depth of the layer, the mean pressures of the path, and
            the heights, whose largest value is where the approach begins.

    Raises:
        InvalidCase: The load path is not one loading and elastic unloading.
    """
    material = scene.material
    path = scene.load.path
    yield_pressure = uniaxial_yield_pressure(material)
    peak = max(path)
    fall = peak - path[-1]
    loading = path[: path.index(peak) + 1]
    grows = all(a <= b for a, b in itertools.pairwise(loading))
    FLAT.require(
        grows and fall < 2 * yield_pressure, "one loading and elastic unloading"
    )
    q = _largest_flow(scene)[1]
    strain = (peak - 2 / 3 * q) / _bulk_modulus(material)
    strain -= fall / oedometric_modulus(material)
    heights = scene.surface.heights
    return strain * scene.body.depth + float(heights.max() - heights.mean())


@FLAT.gives("quantity.largest_plastic_strain")
def _plastic_strain(scene: Scene) -> float:
    """Return the equivalent plastic strain of a level layer after its largest load.

    Without hardening it is two thirds, the deviatoric part, of the strain since yield.
    `scene` holds the material and the mean pressures of the path.
    """
    return _largest_flow(scene)[0]


@FLAT.gives("quantity.plastic_work")
def _plastic_work(scene: Scene) -> float:
    """Return the plastic work of a level layer, in J per m^2 of nominal area.

    It is the integral of the yield stress over the plastic strain, times the depth.
    `scene` holds the material, the depth of the layer and the mean pressures of the
    path.
    """
    strain, stress = _largest_flow(scene)
    if strain == 0:
        return 0.0  # the yield stress may be infinite
    curve = scene.material.yield_curve
    below = np.array(curve.strains) < strain
    a = np.append(np.array(curve.strains)[below], strain)
    q = np.append(np.array(curve.stresses)[below], stress)
    return float(np.trapezoid(q, a)) * scene.body.depth


@FLAT.gives("quantity.elastic_energy")
def _elastic_energy(scene: Scene) -> float:
    """Return the elastic energy of a layer in uniaxial strain, in J per m^2.

    It is (p^2/(2 K) + q^2/(6 mu)) d, with the mean stress p, the difference q of the
    principal stresses, the bulk modulus K, the shear modulus mu and the depth d.  Flow
    keeps q at the yield stress, see `_largest_flow`.

    Args:
        scene: The material, the depth of the layer and the mean pressures of the path,
            after the last of which the energy is stored.
    """
    material = scene.material
    M = oedometric_modulus(material)
    K = _bulk_modulus(material)
    mu = material.young_modulus / (2 * (1 + material.poisson_ratio))
    peak = max(scene.load.path)
    recovered_strain = (peak - scene.load.path[-1]) / M
    q = _largest_flow(scene)[1]
    p = peak - 2 / 3 * q - K * recovered_strain
    q -= 2 * mu * recovered_strain
    return (p**2 / (2 * K) + q**2 / (6 * mu)) * scene.body.depth
