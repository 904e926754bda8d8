"""Contacts without a rim: full contact of half-space and layers, and the flat surface.

The compliance of an elastic layer on a rigid base is computed mode by mode from the
plane strain boundary-value problem, so that it can check the closed form of another
module.  With depth z downward, Airy's function phi = f(z) cos(q x) and
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
# Beyond this q d a layer equals the half-space in float64: 4 (q d)^2 e^(-2 q d) <
# 1e-13.
_DEEP = 20.0

# --- formulas
# -------------------------------------------------------------------------------------


def surface_compliance(
    wavenumber: FloatArray,
    depth: float,
    young_modulus: float,
    poisson_ratio: float,
    *,
    bonded: bool = True,
) -> FloatArray:
    """Surface displacement per pressure, u_q/p_q in m/Pa, at each q > 0; right to
    1e-16/(q d)^3.
    """
    q = np.atleast_1d(np.asarray(wavenumber, dtype=np.float64))
    x = (q * depth).ravel()
    value_0, value_d = _basis(np.zeros_like(x), x), _basis(x, x)
    k = poisson_ratio / (1 - poisson_ratio)
    shear = 2 / (1 - poisson_ratio)  # m / s

    # u_z without cos and u_x without sin, in units of s q p / q^2
    normal_0, normal_d = (v[3] + (k - shear) * v[1] for v in (value_0, value_d))
    base = value_d[2] + k * value_d[0] if bonded else value_d[1]
    system = np.stack([value_0[0], value_0[1], base, normal_d], axis=-2)
    load = np.zeros((x.size, 4, 1))
    load[:, 0] = 1
    coefficients = np.linalg.solve(system, load)[..., 0]
    shape = np.sum(normal_0 * coefficients, axis=-1)
    s = (1 - poisson_ratio**2) / young_modulus
    return np.asarray((s * shape / q.ravel()).reshape(np.shape(wavenumber)))


def _basis(x: FloatArray, depth: FloatArray) -> FloatArray:
    """Derivatives 0 to 3 (in units of q) of the four functions of f at q z = x: (4, n,
    4).
    """
    y = depth - x
    down, up = np.exp(-x), np.exp(-y)
    rows = [
        ((-1) ** n * down, (-1) ** n * (x - n) * down, up, (y - n) * up)
        for n in range(4)
    ]
    return np.moveaxis(np.array(rows), 1, 2)


def lame_compliance(depth: float, young_modulus: float, poisson_ratio: float) -> float:
    """d/M in m/Pa, M = E (1 - nu)/((1 + nu)(1 - 2 nu)): uniaxial strain (Lame), mode q
    = 0.
    """
    nu = poisson_ratio
    return depth * (1 + nu) * (1 - 2 * nu) / (young_modulus * (1 - nu))


def uniaxial_yield_pressure(material: Material) -> float:
    """Pressure in Pa at which a layer in uniaxial strain yields, by von Mises and by
    Tresca.
    """
    return (
        material.yield_stress
        * (1 - material.poisson_ratio)
        / (1 - 2 * material.poisson_ratio)
    )


# --- full contact
# ---------------------------------------------------------------------------------


def compliance(scene: Scene) -> FloatArray:
    """Surface compliance of a scene's body for each mode of numpy.fft.rfftn."""
    surface, body, material = scene.surface, scene.body, scene.material
    *others, (n, d) = zip(surface.shape, surface.spacing, strict=True)
    waves = [*(np.fft.fftfreq(m, s) for m, s in others), np.fft.rfftfreq(n, d)]
    lengths = 2 * np.pi * np.sqrt(sum(wave**2 for wave in np.ix_(*waves)))
    modulus = effective_modulus(material)
    if body.kind == "half_space":
        lengths.flat[0] = math.inf  # the mean, which no pressure moves
        lengths *= modulus
        return np.asarray(np.divide(2, lengths, out=lengths))
    # Waves of one length are solved once.
    q, where = np.unique(lengths, return_inverse=True)
    values = np.zeros(q.shape)
    values[1:] = 2 / (modulus * q[1:])
    near = np.flatnonzero((q > 0) & (q * body.depth < _DEEP))
    E, nu = material.young_modulus, material.poisson_ratio
    bonded = body.kind == "bonded_layer"
    values[near] = surface_compliance(q[near], body.depth, E, nu, bonded=bonded)
    values[0] = lame_compliance(body.depth, E, nu)
    return np.asarray(values[where].reshape(lengths.shape))


@FULL_CONTACT.gives("field.pressure")
def _full_pressure(scene: Scene) -> FloatArray:
    """p_q = h_q / C(q) about the mean pressure."""
    C = compliance(scene)
    C.flat[0] = math.inf
    heights = scene.surface.heights
    modes = np.fft.rfftn(heights) / C
    pressure = scene.load.final + np.fft.irfftn(
        modes, heights.shape, axes=range(heights.ndim)
    )
    fits = pressure.min() >= 0 and pressure.max() <= scene.material.hardness
    FULL_CONTACT.needs(bool(fits), "a load that closes every gap without yielding")
    return np.asarray(pressure)


@FULL_CONTACT.gives("area.total", "area.elastic")
def _all_of_it(scene: Scene) -> float:
    _full_pressure(scene)  # raises where a gap is left
    return 1.0


FULL_CONTACT.gives("area.plastic", "quantity.mean_gap")(
    lambda scene: 1 - _all_of_it(scene)
)


@FULL_CONTACT.gives("quantity.elastic_energy")
def _full_energy(scene: Scene) -> float:
    """Half of the mean of pressure times displacement, which is that of the heights."""
    pressure, heights = _full_pressure(scene), scene.surface.heights
    mean = scene.load.final**2 * compliance(scene).flat[0]
    return float(np.mean(pressure * (heights - heights.mean())) + mean) / 2


@FULL_CONTACT.gives("distribution")
def _full_distribution(scene: Scene) -> PressureDistribution:
    pressure = np.sort(_full_pressure(scene), axis=None)
    steps = np.arange(1, pressure.size + 1) / pressure.size
    return PressureDistribution(
        np.concatenate([[0], pressure]), np.concatenate([[0], steps])
    )


# --- a flat surface
# ------------------------------------------------------------------------------


class _Flat(ClosedForm):
    """A level layer.  Its uniform pressure is given for any scene, to measure distances
    from it.
    """

    def scalar(self, quantity: str, scene: Scene) -> float:
        rough = effective_modulus(scene.material) * scene.surface.rms_slope
        level = rough <= 1e-5 * max(scene.load.path) and math.isfinite(scene.body.depth)
        self.needs(level, "a layer without roughness")
        return super().scalar(quantity, scene)


FLAT = _Flat("flat", "a level layer under uniform pressure, in uniaxial strain (Lame)")


@FLAT.gives("area.plastic", "quantity.plastic_volume")
def _flow(scene: Scene) -> float:
    """1 if a layer of J2 flow in uniaxial strain has yielded along the load path, else
    0.
    """
    return float(max(scene.load.path) > uniaxial_yield_pressure(scene.material))


FLAT.gives("area.total")(lambda scene: 1.0)
FLAT.gives("area.elastic")(lambda scene: 1 - _flow(scene))
FLAT.gives("quantity.plastic_depth")(lambda scene: _flow(scene) * scene.body.depth)
FLAT.gives("quantity.mean_contact_pressure", "quantity.largest_pressure")(
    lambda scene: scene.load.final
)
FLAT.gives("field.pressure")(
    lambda scene: np.full(scene.surface.shape, scene.load.final)
)


@FLAT.gives("distribution")
def _flat_distribution(scene: Scene) -> PressureDistribution:
    p0 = scene.load.final
    return PressureDistribution(
        np.array([0, p0 * (1 - 1e-12), p0]), np.array([0.0, 0.0, 1.0])
    )


def _bulk_modulus(material: Material) -> float:
    return material.young_modulus / (3 * (1 - 2 * material.poisson_ratio))


@FLAT.gives("quantity.approach")
def _compression(scene: Scene) -> float:
    """The approach of a layer in m: p d/M up to the yield pressure, with the bulk
    modulus beyond; unloading is elastic while the pressure falls by less than twice the
    yield pressure.
    """
    material, depth, path = scene.material, scene.body.depth, scene.load.path
    M, top, last = oedometric_modulus(material), max(path), path[-1]
    yields = uniaxial_yield_pressure(material)
    loading = path[: path.index(top) + 1]
    once = all(a <= b for a, b in itertools.pairwise(loading))
    FLAT.needs(once and top - last < 2 * yields, "one loading and elastic unloading")
    flowed = max(0.0, top - yields) / _bulk_modulus(material)
    sunk = min(top, yields) / M + flowed - (top - last) / M
    heights = scene.surface.heights
    return sunk * depth + float(heights.max() - heights.mean())


@FLAT.gives("quantity.largest_plastic_strain")
def _plastic_strain(scene: Scene) -> float:
    """The equivalent plastic strain: two thirds (the deviatoric part) of the strain
    since yield.
    """
    beyond = max(0.0, max(scene.load.path) - uniaxial_yield_pressure(scene.material))
    return 2 / 3 * beyond / _bulk_modulus(scene.material)


@FLAT.gives("quantity.plastic_work")
def _spent(scene: Scene) -> float:
    """Y times the plastic strain, times the depth."""
    strain = _plastic_strain(scene)
    return scene.material.yield_stress * strain * scene.body.depth if strain else 0.0


@FLAT.gives("quantity.elastic_energy")
def _stored(scene: Scene) -> float:
    """Elastic energy of a layer in uniaxial strain, (p^2/(2 K) + q^2/(6 mu)) d: q, the
    difference of the principal stresses, is held at Y by flow.
    """
    material, path = scene.material, scene.load.path
    M, bulk = oedometric_modulus(material), _bulk_modulus(material)
    shear = material.young_modulus / (2 * (1 + material.poisson_ratio))
    top, back = max(path), (max(path) - path[-1]) / M
    q = min(2 * shear * top / M, material.yield_stress)
    p = top - 2 / 3 * q - bulk * back
    q -= 2 * shear * back
    return (p**2 / (2 * bulk) + q**2 / (6 * shear)) * scene.body.depth
