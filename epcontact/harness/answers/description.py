"""A scene in words and figures, for the reader of its result.

A result carries them in its provenance, so that its JSON, its .vti and its report need no case.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from epcontact.materials.moduli import effective_modulus
from epcontact.scene import Scene, Surface
from epcontact.surfaces import Recipe, unit_of

_BODIES = {
    "half_space": "half-space",
    "bonded_layer": "layer bonded to a rigid base",
    "sliding_layer": "layer sliding on a rigid base",
}


def described(scene: Scene, recipe: Recipe, hardness_source: str) -> dict[str, dict[str, Any]]:
    """Return the figures of a scene by name, each with `value`, `unit` and `meaning`.

    Values are numbers, lists of numbers or words, the units "" for words and "–" for numbers
    without a unit.  What the scene does not have, such as a hardness, is left out or infinite.
    """
    surface, material = scene.surface, scene.material
    modulus, body = effective_modulus(material), _BODIES[scene.body.kind]
    if scene.body.kind != "half_space":
        body += f", {scene.body.depth:g} m deep"
    how = "from differences of neighbours" if surface.spectrum is None else "of the spectrum"
    slope = (surface.spectrum or surface).rms_slope
    rows: list[tuple[str, Any, str, str]] = [
        ("surface", _surface_in_words(surface, recipe), "", "surface"),
        ("points", list(surface.shape), "–", "grid points along each direction"),
        ("periods", list(surface.periods), "m", "period"),
        ("spacing", list(surface.spacing), "m", "distance of grid points"),
        ("rms_height", surface.rms_height, "m", "rms height"),
        ("rms_slope", slope, "–", f"rms slope ξ, {how}"),
        ("young_modulus", material.young_modulus, "Pa", "Young's modulus E"),
        ("poisson_ratio", material.poisson_ratio, "–", "Poisson's ratio ν"),
        ("effective_modulus", modulus, "Pa", "effective modulus E* = E / (1 − ν²)"),
        ("hardness", material.hardness, "Pa", "hardness σ_P, the largest contact pressure"),
        ("yield_stress", material.yield_stress, "Pa", "yield stress σ_Y of the J2 solid"),
        ("body", body, "", "body"),
        ("load_path", list(scene.load.path), "Pa", "mean pressure p₀ (force / nominal area)"),
    ]
    if surface.shortest_wavelength is not None:
        resolved = surface.shortest_wavelength / max(surface.spacing)
        rows.insert(4, ("resolution", resolved, "–", "grid points per shortest wavelength"))
    if slope > 0:
        rows.append(("load_group", scene.load.final / (modulus * slope), "–", "p₀ / (E* ξ)"))
        rows.append(("hardness_group", material.hardness / (modulus * slope), "–", "σ_P / (E* ξ)"))
    if hardness_source:
        rows.append(("hardness_source", hardness_source, "", "where the hardness comes from"))
    return {name: dict(zip(("value", "unit", "meaning"), row, strict=True)) for name, *row in rows}


def _surface_in_words(surface: Surface, recipe: Recipe) -> str:
    spectrum = surface.spectrum
    if spectrum is not None:
        return (
            f"self-affine roughness: Hurst exponent {spectrum.hurst:g}, flat spectrum from "
            f"{spectrum.wavenumber_low:.5g} to {spectrum.wavenumber_roll_off:.5g} rad/m, power law "
            f"up to {spectrum.wavenumber_high:.5g} rad/m, rms slope {spectrum.rms_slope:g}, "
            f"seed {surface.seed}"
        )
    kind = str(getattr(recipe, "kind", type(recipe).__name__)).replace("_", " ")
    return f"{kind}: {', '.join(_parameters(recipe))}"


def _parameters(recipe: Any) -> Iterator[str]:
    """Yield the parameters of a recipe as "radius 0.01 m", with the units of its annotations."""
    for name in (field.name for field in fields(recipe)):
        value = getattr(recipe, name)
        if name in ("kind", "periods", "shape", "heights") or value in (None, (), False):
            continue
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        yield f"{name.replace('_', ' ')} {shown} {unit_of(recipe, name)}".rstrip()
