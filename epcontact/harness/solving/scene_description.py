"""A scene as a table of names, values and units, for its results, files and report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from epcontact.materials.moduli import effective_modulus
from epcontact.scene import Body, Material, Scene, Surface
from epcontact.surfaces import Recipe, unit_of

_BODIES = {
    "half_space": "half-space",
    "bonded_layer": "layer bonded to a rigid base",
    "sliding_layer": "layer sliding on a rigid base",
}

#: A row of the table: name, value, unit and meaning.
_Row = tuple[str, Any, str, str]


def describe_scene(
    scene: Scene, recipe: Recipe, hardness_source: str
) -> dict[str, dict[str, Any]]:
    """Return the properties of a scene by name, each with `value`, `unit`, `meaning`.

    A result carries them in its provenance, so that its JSON, .vti and report need no
    case.  Values are numbers, lists of numbers or words; the unit is "" for words and
    "–" for numbers without one.  What the scene does not have, such as a hardness, is
    left out or infinite.

    Args:
        scene: the scene that was solved.
        recipe: how its surface was made.
        hardness_source: where an effective hardness comes from; "" for another one.
    """
    surface, material = scene.surface, scene.material
    modulus = effective_modulus(material)
    slope = (surface.spectrum or surface).rms_slope
    slope_source = "of the spectrum"
    if surface.spectrum is None:
        slope_source = "from differences of neighbours"
    rows: list[_Row] = [
        ("surface", _describe_surface(surface, recipe), "", "surface"),
        ("points", list(surface.shape), "–", "grid points along each direction"),
        ("periods", list(surface.periods), "m", "period"),
        ("spacing", list(surface.spacing), "m", "distance of grid points"),
        *_resolution(surface),
        ("rms_height", surface.rms_height, "m", "rms height"),
        ("rms_slope", slope, "–", f"rms slope ξ, {slope_source}"),
        ("young_modulus", material.young_modulus, "Pa", "Young's modulus E"),
        ("poisson_ratio", material.poisson_ratio, "–", "Poisson's ratio ν"),
        ("effective_modulus", modulus, "Pa", "effective modulus E* = E / (1 − ν²)"),
        (
            "hardness",
            material.hardness,
            "Pa",
            "hardness σ_P, the largest contact pressure",
        ),
        (
            "yield_stress",
            material.yield_stress,
            "Pa",
            "yield stress σ_Y of the J2 solid",
        ),
        *_hardening(material),
        ("body", _describe_body(scene.body), "", "body"),
        (
            "load_path",
            list(scene.load.path),
            "Pa",
            "mean pressure p₀ (force / nominal area)",
        ),
    ]
    if slope > 0:
        load_group = scene.load.final / (modulus * slope)
        hardness_group = material.hardness / (modulus * slope)
        rows.append(("load_group", load_group, "–", "p₀ / (E* ξ)"))
        rows.append(("hardness_group", hardness_group, "–", "σ_P / (E* ξ)"))
    if hardness_source:
        meaning = "where the hardness comes from"
        rows.append(("hardness_source", hardness_source, "", meaning))
    return {
        name: {"value": value, "unit": unit, "meaning": meaning}
        for name, value, unit, meaning in rows
    }


def _hardening(material: Material) -> Iterator[_Row]:
    """Yield the row of the hardening of a material; nothing if it does not harden."""
    for name, law in material.hardening.items():
        parameters = getattr(material, name)
        yield name, law.describe(parameters), law.unit, law.meaning


def _resolution(surface: Surface) -> Iterator[_Row]:
    """Yield the row "resolution", the grid points per shortest wavelength along the
    coarser direction; nothing if the shortest wavelength of the surface is not known.
    """
    if surface.shortest_wavelength is not None:
        points = surface.shortest_wavelength / max(surface.spacing)
        yield "resolution", points, "–", "grid points per shortest wavelength"


def _describe_body(body: Body) -> str:
    """Return the kind of a body in words, with the depth of a layer in m."""
    words = _BODIES[body.kind]
    if body.kind != "half_space":
        words += f", {body.depth:g} m deep"
    return words


def _describe_surface(surface: Surface, recipe: Recipe) -> str:
    """Return a surface in words: its spectrum, or its kind with the parameters of the
    recipe from which it was made.
    """
    spectrum = surface.spectrum
    if spectrum is not None:
        return (
            f"self-affine roughness: Hurst exponent {spectrum.hurst:g}, "
            f"flat spectrum from {spectrum.wavenumber_low:.5g} to "
            f"{spectrum.wavenumber_roll_off:.5g} rad/m, power law up to "
            f"{spectrum.wavenumber_high:.5g} rad/m, rms slope {spectrum.rms_slope:g}, "
            f"seed {surface.seed}"
        )
    recipe = getattr(recipe, "map", recipe)  # of a mirrored map
    kind = str(getattr(recipe, "kind", type(recipe).__name__)).replace("_", " ")
    return f"{kind}: {', '.join(_describe_parameters(recipe))}"


def _describe_parameters(recipe: Any) -> Iterator[str]:
    """Yield the parameters of a recipe that are set, such as "radius 0.01 m".

    The grid, the kind and the heights are left out.  `recipe` is a dataclass whose
    annotations give the units.
    """
    for field in fields(recipe):
        value = getattr(recipe, field.name)
        if field.name in ("kind", "periods", "shape", "heights"):
            continue
        if value in (None, (), False):
            continue
        number = f"{value:g}" if isinstance(value, float) else str(value)
        words = f"{field.name.replace('_', ' ')} {number} {unit_of(recipe, field.name)}"
        yield words.rstrip()
