"""What methods, closed forms, maps and laws say of scenes without symmetry, beside what
was read.

Other tests show that it is right; here whatever moves is seen, by-products, notes and
errors too.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import pyvista
from as_read import NUMBER, lasting, lines_of_data, same_as_read, told
from fem_scenes import rough_scene

import fem_check
from epcontact import bem, effective_hardness, joint_conductance, persson
from epcontact import surfaces as maps
from epcontact.errors import EpcontactError
from epcontact.materials import hardness_map
from epcontact.persson.separation import gap_distribution
from epcontact.persson.theory import Theory
from epcontact.persson.validity import expected_errors
from epcontact.reference import CLOSED_FORMS
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces.power_spectrum import radial_spectrum
from fem_check.limit_load import STRIP_LIMIT, strip_punch

L, METAL = 2 * math.pi, Material(2.0, 0.3, hardness=0.3, yield_stress=0.1)
SPECTRUM = SelfAffineSpectrum(0.7, 1.0, 2.0, 8.0, 0.2)
ROUGH = maps.SelfAffine(SPECTRUM, (L, 1.25 * L), (32, 40), seed=3)
LINE = replace(ROUGH, periods=(L,), shape=(48,))
PIECE = replace(ROUGH, shape=(96, 120)).build().heights[:70, :50] / 5
X, Y = np.indices(PIECE.shape)
TILT = PIECE + 0.01 * X - 0.02 * Y
HOLED = np.where((7 * X + Y) % 23 == 5, np.nan, TILT)
SPIKED = HOLED + 0.8 * ((5 * X + 3 * Y) % 311 == 61)
MAPS = {
    "mirrored": maps.HeightsFromArray(
        SPIKED, (20.0, 11.0), "mirrored", missing="nearest"
    ),
    "cleaned": maps.HeightsFromArray(
        SPIKED,
        (20.0, 33.0),
        "mirrored",
        missing="harmonic",
        form=2,
        outliers="remove",
        shortest_wavelength=3.0,
    ),
    "periodic": maps.HeightsFromArray(
        TILT, (20.0, 15.0), "periodic", longest_wavelength=14.0
    ),
    "marked": maps.HeightsFromArray(
        np.where(TILT < -0.3, -99.0, np.round(TILT, 1)),
        (40.0, 33.0),
        "periodic",
        form=0,
    ),
    "stepped": maps.HeightsFromArray(
        np.int16(20 * ROUGH.build().heights), (99.0, 90.0)
    ),
    "picture": maps.HeightsFromArray(
        (TILT > 0).astype(np.uint8), (4.0, 33.0), "periodic"
    ),
    "facing": maps.Facing(
        maps.HeightsFromArray(TILT, (20.0, 15.0), "periodic", shortest_wavelength=2.0),
        maps.HeightsFromArray(
            PIECE[::-1], (20.0, 15.0), "periodic", form=2, shortest_wavelength=3.0
        ),
    ),
}
SHAPES = {
    "rough": ROUGH,
    "line": LINE,
    "level": maps.HeightsFromArray(np.zeros((6, 5)), (1.0, 0.7)),
    "wave": maps.Sinusoid((1.0,), (64,), 0.02),
    "across": maps.Sinusoid((1.0, 2.0), (32, 32), 0.02, 2, "y"),
    "waves": maps.Sinusoid((1.0, 1.0), (32, 32), 0.02, direction="both"),
    "sphere": maps.Sphere((1.0, 1.0), (32, 32), 0.45),
    "bump": maps.Paraboloid((1.0,), (64,), 3.0, (0.3,)),
    "lattice": maps.Paraboloid((1.0, 1.0), (32, 32), 3.0),
    "post": maps.FlatPunch((1.0,), (60,), 0.2, 0.5),
    "disc": maps.FlatPunch((1.0, 1.0), (32, 32), 0.3, 0.5),
}
LOADS = [
    *((math.inf, p) for p in (0.0015, 0.03, 0.18, (0.5, 0.2))),
    (0.3, (0.01, 0.006)),
]
#: What the limit of a vanishing spacing says of boundary elements has tests of its own.
LIMITS = re.compile("areas (corrected|error)|_by_grid|distribution")
BODIES = {
    "": Body(),
    " bonded": Body("bonded_layer", 0.3),
    " sliding": Body("sliding_layer", 0.3),
}


def short(lines):
    """Lines whose numbers have four digits, two decimals if no more are given, or are
    0.
    """

    def digits(found):
        value, given = float(found[0]), re.fullmatch(r"[-+]?\d+(\.\d\d)?", found[0])
        return "0" if abs(value) < 1e-15 else found[0] if given else f"{value:.3e}"

    return [NUMBER.sub(digits, line) for line in lasting(lines)]


def lines_of_surface(name, surface):
    yield f"{name}: {surface!r} {surface.shortest_wavelength} {surface.seed}"
    yield from (f"{name} note: {note}" for note in surface.notes)
    yield from lines_of_data(dict(surface.treatment_errors), f"{name} edges")
    yield f"{name} heights: {told(surface.heights)}; {told(maps.topography(surface))}"
    for part, values in vars(radial_spectrum(surface)).items():
        yield f"{name} rings {part}: {told(values)}"
    yield f"{name} octaves: {[told(part) for part in maps.power_by_octave(surface)]}"


def lines_of_result(name, result):
    yield from lines_of_data(result.to_json(), name)
    yield f"{name} size: {result.cost['unknowns']}"
    yield from (
        f"{name} field {n}: {told(field)}" for n, field in result.fields.items()
    )


def answer_of(form, quantity, scene):
    try:
        if quantity == "distribution":
            return f"{[told(part) for part in list(vars(form.pressures(scene)).values())[:2]]}"
        if quantity.startswith("field."):
            return told(form.field(quantity[6:], scene))
        return f"{form.scalar(quantity, scene):.5g}"
    except EpcontactError as refusal:
        return f"{refusal}"


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_surfaces_are_as_read(tmp_path):
    rows = (";".join(f"{v:.6f}".replace(".", ",") for v in row) for row in SPIKED.T)
    text = "Höhe in µm\n\n" + "\n".join(rows).replace("nan", "")
    (tmp_path / "map.csv").write_text(text, "latin-1")
    file = maps.HeightsFromFile(
        tmp_path / "map.csv", (40e-4, 66e-4), 1e-6, missing="nearest"
    )
    made = {
        name: each.build() for name, each in (MAPS | SHAPES | {"file": file}).items()
    }
    lines = [line for name, one in made.items() for line in lines_of_surface(name, one)]
    lines += [f"{name} recipe: {recipe.fingerprint}" for name, recipe in SHAPES.items()]
    same_as_read(short(lines), "surfaces.txt", tmp_path)


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_closed_forms_maps_and_laws_are_as_read(tmp_path):
    lines, refused = [hardness_map.formula_text()], {}
    for name, recipe in SHAPES.items():
        surface = recipe.build()
        for kind, body in BODIES.items():
            for cap, path in LOADS:
                material = replace(METAL, hardness=cap)
                scene = Scene(surface, material, Load(path), body)
                known = {CLOSED_FORMS["flat"]: name == "level" and kind != ""}
                for form in (f for f in CLOSED_FORMS.values() if known.get(f, True)):
                    for q in form.quantities:
                        told_of = answer_of(form, q, scene)
                        if "this scene is not" in told_of:
                            refused[told_of] = 0
                        elif not q.endswith(".corrected"):
                            lines.append(
                                f"{name}{kind} {path} of {cap}: {form.name} {q} {told_of}"
                            )
    metal = {"yield_stress": 1e9, "young_modulus": 210e9, "poisson_ratio": 0.31}
    for load, slope, breadth in (
        (0.4, 0.03, None),
        (0.25, 0.1, 3),
        (0.01, 0.2, 50),
        (1.2, 0.3, 8),
    ):
        found = effective_hardness(
            mean_pressure=load * 1e9, rms_slope=slope, breadth=breadth, **metal
        )
        lines += [*str(found).splitlines(), found.rests_on]
    joint = {"rms_height": 1e-6, "effective_modulus": 60e9, "mean_pressure": 10e6}
    for k, slope, hardness, breadth in (
        ((16, 200), 0.15, 3e9, None),
        ((4, 9), 0.1, 1e9, 5),
    ):
        found = joint_conductance(
            conductivities=k,
            rms_slope=slope,
            hardness=hardness,
            breadth=breadth,
            **joint,
        )
        lines += str(found).splitlines()
    lines += [
        f"punch: {told(strip_punch(2, mean_dilatation=m) / STRIP_LIMIT)}"
        for m in (1, 0)
    ]
    same_as_read(short([*lines, *refused]), "forms.txt", tmp_path)


def test_the_theory_is_as_read(tmp_path):
    lines = []
    for wide, hardness, rule, gamma in (
        (64.0, 0.3, "constant", 0.536),
        (32.0, math.inf, "constant", 0.536),
        (128.0, 1.1, "persson", 0.45),
        (16.0, 2.5, "constant", 0.536),
        (64.0, 0.12, "xu", 0.42),
        (32.0, math.inf, "wang_muser", 5 / 9),
        (32.0, 0.4, "local", 0.168),
    ):
        spectrum = SelfAffineSpectrum(0.8, 1.0, 4.0, wide, 0.1)
        surface = Surface(np.zeros((8, 8)), (L, L), spectrum, notes=("It is given.",))
        load = Load(
            tuple(0.1 * share * min(hardness, 1.0) / 0.91 for share in (0.05, 0.3))
        )
        scene = Scene(surface, Material(1.0, 0.3, 0.1 * hardness / 0.91), load)
        name, options = f"{rule} {hardness:g} {wide:g}", {"energy_reduction": gamma}
        lines += lines_of_result(name, persson.solve(scene, reduction=rule, **options))
        theory = Theory.of_scene(scene, reduction=rule, **options)
        for p in load.path:
            for many in (1, 6):
                errors = (
                    expected_errors(theory, p, many)
                    if rule in ("constant", "local")
                    else {}
                )
                lines += lines_of_data(errors, f"{name} expected {many}")
            curves = {
                "magnification": theory.magnification_curve(p),
                "pressure": theory.pressure_curve(p, 0.5 * wide),
            }
            for kind, curve in curves.items():
                lines += [
                    f"{name} {kind} {n}: {told(v)}" for n, v in curve.columns().items()
                ]
            if rule != "local":
                gaps = gap_distribution(theory, p, np.geomspace(1e-3, 0.3, 20))
                lines.append(f"{name} gaps: {[told(part) for part in gaps]}")
        if rule == "constant":
            grown = persson.hardness_curve(
                theory, 0.004, lambda zeta: 0.05 * zeta**0.2, [4, 16]
            )
            lines.append(
                f"{name} growing: {told(grown.areas.plastic)}; {told(grown.hardness)}"
            )
    scene = Scene(ROUGH.build(), METAL, Load(0.02))
    own = persson.solve(scene, energy_reduction=0.536, spectrum="surface")
    same_as_read(short([*lines, *lines_of_result("own", own)]), "theory.txt", tmp_path)


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_numerics_are_as_read(tmp_path):
    surface, path = (
        replace(ROUGH.build(), notes=("It is rough.",)),
        Load((0.01, 0.03, 0.02)),
    )
    scenes = {kind: Scene(surface, METAL, path, body) for kind, body in BODIES.items()}
    line = Scene(LINE.build(), METAL, Load((0.01, 0.03, 0.0)))
    elastic = replace(
        scenes[""], material=replace(METAL, hardness=math.inf), load=Load(0.05)
    )
    treated = replace(elastic, surface=MAPS["mirrored"].build(), load=Load(0.02))
    lines = []
    for name, scene, options in (
        *(("bem" + kind, scene, {}) for kind, scene in scenes.items()),
        ("line", line, {}),
        ("elastic", elastic, {"area_tolerance": 1e-3}),
        ("treated", treated, {}),
        (
            "slow",
            replace(elastic, load=Load(0.2)),
            {"method": "polonsky_keer", "tolerance": 1e-4},
        ),
    ):
        found = lines_of_result(name, bem.solve(scene, threads=1, **options))
        lines += [line for line in found if not LIMITS.search(line)]
    small = Surface(surface.heights[::2, ::4], surface.periods, notes=("It is rough.",))
    flowing = {"law": "j2", "hardening": 0.5, "path": (0.02, 0.03, 0.0)}
    capped = {"law": "capped", "geometry": "moved", "path": (0.02, 0.03, 0.01)}
    for name, options in {
        "": {**flowing},
        " bonded": capped,
        " sliding": {**flowing},
    }.items():
        scene = replace(scenes[name], surface=small, load=Load(options.pop("path")))
        folder = tmp_path / f"fem{name}"
        result = fem_check.solve(scene, output=folder, threads=1, layers=4, **options)
        lines += lines_of_result(f"fem{name}", result)
        for file in sorted(folder.glob("*.vtu")):
            grid = pyvista.read(file)
            for data in (grid.point_data, grid.cell_data):
                lines += [f"fem{name} {file.name} {n}: {told(data[n])}" for n in data]
            known = {
                n: grid.field_data[n][0] for n in grid.field_data if "version" not in n
            }
            lines += lines_of_data(
                {**known, "place": told(grid.points)}, f"fem{name} {file.name}"
            )
    punch = replace(rough_scene(12, 3, dimensions=1, pressure=0.3), load=Load(0.3))
    lines += lines_of_result(
        "punch", fem_check.solve(punch, geometry="punch", threads=1)
    )
    same_as_read(short(lines), "numerics.txt", tmp_path)
