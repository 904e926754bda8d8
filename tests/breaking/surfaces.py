"""Faults of surfaces, spectra, filters and readers."""

from dataclasses import replace

import numpy as np

from breaking.fault import Fault, changed, given, on_result

S = "epcontact.surfaces."
FILES = "tests/test_surface_files.py::test_"


def _spectrum(**changes):
    def wrong(spectrum, *rest):
        return (
            replace(spectrum, **{k: f(spectrum) for k, f in changes.items()}),
            *rest,
        )

    return wrong


def _shape(what, patch, *seen, **more):
    return Fault(what, "surfaces", patch, *seen, **more)


FAULTS = (
    _shape(
        "amplitude from valley to crest",
        on_result(
            S + "shapes.Sinusoid.build", lambda s: replace(s, heights=2 * s.heights)
        ),
        "westergaard-line",
        "quantity.surface_rms_height",
    ),
    _shape(
        "waves along y for waves along x",
        on_result(
            S + "shapes.Sinusoid.build",
            lambda s: (
                s
                if s.heights.ndim == 1
                else replace(
                    s,
                    heights=np.ascontiguousarray(s.heights.T.reshape(s.heights.shape)),
                )
            ),
        ),
        "westergaard-surface",
        "field.pressure",
        status="error",
    ),
    _shape(
        "spherical cap for parabola",
        changed(
            S + "shapes.Paraboloid.build",
            lambda f: lambda r: f(replace(r, radius=0.99 * r.radius)),
        ),
        "hertz-sphere",
        "quantity.surface_curvature",
    ),
    _shape(
        "a punch four points too wide",
        changed(
            S + "shapes.FlatPunch.build",
            lambda f: (
                lambda r: f(replace(r, radius=r.radius + 2 * r.periods[0] / r.shape[0]))
            ),
        ),
        "punch-strip",
        "area.total.raw",
        0.6,
    ),
    _shape(
        "Hurst exponent of the surface",
        given(
            S + "self_affine.amplitude_shape", _spectrum(hurst=lambda s: s.hurst - 0.1)
        ),
        "rough-elastic",
        "quantity.surface_rms_height",
    ),
    _shape(
        "no roll-off",
        given(
            S + "self_affine.amplitude_shape",
            _spectrum(wavenumber_roll_off=lambda s: s.wavenumber_low),
        ),
        "rough-elastic",
        "quantity.surface_rms_height",
    ),
    _shape(
        "the band cut at half its highest wave number",
        given(
            S + "self_affine.amplitude_shape",
            _spectrum(wavenumber_high=lambda s: s.wavenumber_high / 2),
        ),
        "rough-elastic",
        "quantity.surface_rms_height",
    ),
    _shape(
        "the longest waves left out",
        given(
            S + "self_affine.amplitude_shape",
            _spectrum(wavenumber_low=lambda s: 1.2 * s.wavenumber_low),
        ),
        "rough-elastic",
        "quantity.surface_rms_height",
    ),
    _shape(
        "amplitudes of a line on a surface",
        changed(
            S + "self_affine.amplitude_shape",
            lambda f: lambda s, q, dimension: f(s, q, 1),
        ),
        "rough-elastic",
        "quantity.surface_rms_height",
    ),
    _shape(
        "the power spectrum for the amplitudes",
        changed(
            S + "self_affine.amplitude_shape",
            lambda f: lambda s, q, dimension: f(s, q, dimension) ** 2,
        ),
        "rough-elastic",
        "quantity.surface_rms_height",
    ),
    _shape(
        "the shortest ring of waves left out",
        on_result(
            "epcontact.persson.roughness.radial_spectrum",
            lambda r: replace(
                r,
                slope_variance=np.where(
                    r.wavenumber < 0.95 * r.wavenumber[r.slope_variance > 1e-9].max(),
                    r.slope_variance,
                    0,
                ),
            ),
        ),
        "theory-surface",
        "quantity.rms_slope",
    ),
    _shape(
        "another seed than asked for",
        given(S + "self_affine.grid_heights", lambda r: (replace(r, seed=r.seed + 1),)),
        "path-elastic",
        "quantity.surface_highest",
    ),
    _shape(
        "every seed the same surface",
        given(S + "self_affine.grid_heights", lambda r: (replace(r, seed=7),)),
        "path-elastic",
        "quantity.surface_highest",
    ),
    _shape(
        "heights turned round",
        on_result(
            S + "self_affine.grid_heights", lambda h: np.ascontiguousarray(h[::-1])
        ),
        "path-elastic",
        "quantity.surface_summit_x",
    ),
    _shape(
        "heights turned round along y",
        on_result(
            S + "self_affine.grid_heights", lambda h: np.ascontiguousarray(h[:, ::-1])
        ),
        "path-elastic",
        "quantity.surface_summit_y",
    ),
    _shape(
        "a picture turned from x to y",
        on_result(
            S + "measured.read_heights", lambda m: replace(m, heights=m.heights.T)
        ),
        test=FILES + "every_format_holds_the_same_heights",
    ),
    _shape(
        "a counterface that does not yield",
        changed(
            "epcontact.harness.case_files.model.of_both",
            lambda f: lambda one, other: one,
        ),
        "two-spheres",
        "area.total.corrected",
    ),
    _shape(
        "a counterface without its roughness",
        changed(
            S + "measured.Facing.build", lambda f: lambda recipe: recipe.first.build()
        ),
        "two-spheres",
        "quantity.surface_curvature",
    ),
)
