"""Contacts without a rim: full contact of half-space and layers, and the flat surface."""

from __future__ import annotations

import itertools
import math

import numpy as np

from epcontact.moduli import effective_modulus, oedometric_modulus
from epcontact.reference import layer
from epcontact.reference.form import ClosedForm, areas, refuse_unless
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

# Beyond this q d a layer cannot be told from the half-space: 4 (q d)^2 e^(-2 q d) < 1e-13.
_DEEP = 20.0


def compliance(scene: Scene) -> FloatArray:
    """Surface compliance (m/Pa) of each mode of numpy.fft.fftn; the mean's is 0, or d/M.

    A layer's is solved for from its boundary-value problem, wave by wave (`reference.layer`).
    """
    surface, body, material = scene.surface, scene.body, scene.material
    squares = np.zeros(())
    for axis, (n, d) in enumerate(zip(surface.shape, surface.spacing, strict=True)):
        along = 2 * np.pi * np.fft.fftfreq(n, d)
        squares = squares + (along**2).reshape(
            [-1 if a == axis else 1 for a in range(len(surface.shape))]
        )
    q, where = np.unique(np.sqrt(squares), return_inverse=True)
    values = np.zeros(q.shape)
    values[1:] = 2 / (effective_modulus(material) * q[1:])
    if body.kind != "half_space":
        near = np.flatnonzero((q > 0) & (q * body.depth < _DEEP))
        E, nu = material.young_modulus, material.poisson_ratio
        bonded = body.kind == "bonded_layer"
        values[near] = layer.surface_compliance(q[near], body.depth, E, nu, bonded=bonded)
        values[0] = layer.lame_compliance(body.depth, E, nu)
    return np.asarray(values[where].reshape(surface.shape))


def _full_pressure(scene: Scene) -> FloatArray:
    """p_q = h_q / C(q) about the mean pressure."""
    C = compliance(scene)
    C.flat[0] = math.inf
    modes = np.fft.fftn(scene.surface.heights) / C
    pressure = scene.load.final + np.fft.ifftn(modes).real
    fits = pressure.min() >= 0 and pressure.max() <= scene.material.hardness
    refuse_unless(bool(fits), "full_contact", "a load that closes every gap without yielding")
    return np.asarray(pressure)


def _one(scene: Scene) -> float:
    _full_pressure(scene)
    return 1.0


def _none(scene: Scene) -> float:
    _full_pressure(scene)
    return 0.0


def _full_energy(scene: Scene) -> float:
    """Half the pressure times the displacement, by Parseval; a layer's mean compression too."""
    modes = np.fft.fftn(_full_pressure(scene)) / scene.surface.heights.size
    return float(np.sum(compliance(scene) * np.abs(modes) ** 2)) / 2


def _full_distribution(scene: Scene) -> PressureDistribution:
    pressure = np.sort(_full_pressure(scene), axis=None)
    steps = np.arange(1, pressure.size + 1) / pressure.size
    return PressureDistribution(np.concatenate([[0], pressure]), np.concatenate([[0], steps]))


# --- a flat surface ------------------------------------------------------------------------------


def _flat_pressure(scene: Scene) -> FloatArray:
    return np.full(scene.surface.shape, scene.load.final)


def _flat_distribution(scene: Scene) -> PressureDistribution:
    p0 = scene.load.final
    return PressureDistribution(np.array([0, p0 * (1 - 1e-12), p0]), np.array([0.0, 0.0, 1.0]))


def _unit(_: Scene) -> float:
    return 1.0


def _compression(scene: Scene) -> float:
    """How far a layer's top sinks under the load path: approach from the first touch, m.

    Uniaxial strain: p d/M up to the yield pressure Y (1 - nu)/(1 - 2 nu), then the tangent is
    the bulk modulus; unloading is elastic while the pressure falls by less than twice that.
    """
    material, depth, path = scene.material, scene.body.depth, scene.load.path
    refuse_unless(math.isfinite(depth), "flat", "a layer, to be compressed")
    nu, M = material.poisson_ratio, oedometric_modulus(material)
    bulk = material.young_modulus / (3 * (1 - 2 * nu))
    top, last = max(path), path[-1]
    yields = layer.uniaxial_yield_pressure(material.yield_stress, nu)
    loading = path[: path.index(top) + 1]
    once = all(a <= b for a, b in itertools.pairwise(loading))
    refuse_unless(once and top - last < 2 * yields, "flat", "one loading and elastic unloading")
    sunk = min(top, yields) / M + max(0.0, top - yields) / bulk - (top - last) / M
    heights = scene.surface.heights
    return sunk * depth + float(heights.max() - heights.mean())


FORMS = (
    ClosedForm(
        "full_contact",
        "Johnson, Contact Mechanics (1985), section 13.2: p_q = h_q / C(q)",
        areas(_one, _none) | {"quantity.elastic_energy": _full_energy, "quantity.mean_gap": _none},
        {"pressure": _full_pressure},
        _full_distribution,
    ),
    ClosedForm(
        "flat",
        "a surface without roughness under uniform pressure, in uniaxial strain (Lame)",
        areas(_unit) | {"quantity.approach": _compression},
        {"pressure": _flat_pressure},
        _flat_distribution,
    ),
)
