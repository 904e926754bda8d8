"""Each key of a case file that changes a result changes the key of the saved result.

`epcontact.harness.solving.saved.key_of` names the result of a task.  If it ignored a
key of the case file, a later run would take the result of another scene for its own.
"""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from epcontact.harness.case_files.case import load_case
from epcontact.harness.case_files.mistakes import key_table
from epcontact.harness.solving import saved
from epcontact.harness.solving.tasks import Run, tasks_of
from epcontact.scene import (
    Alternative,
    Body,
    Load,
    Material,
    Scene,
    SelfAffineSpectrum,
    Surface,
)

#: Tables of a case file that say what is judged, and not what is solved.
NOT_SOLVED = ("case", "gate", "sweep", "variant")
#: Keys that change no result, each for its reason.
WITHOUT_EFFECT = {
    ("surface, file", "optional"): "it only lets a case be skipped",
    ("surface, file", "accept"): "it only lets a map pass that looks wrong",
    ("surface, file", "channel"): "only files of instruments have channels",
}
#: Tables of a case by their names in `key_table`; every value differs from the default.
ROUGHNESS = {
    "period": 1e-3,
    "hurst": 0.8,
    "wavenumber_low": 2 * np.pi / 1e-3,
    "wavenumber_roll_off": 4 * np.pi / 1e-3,
    "wavenumber_high": 8 * np.pi / 1e-3,
    "rms_slope": 0.1,
    "shape": [16, 32],
    "seeds": [3],
    "kind": "self_affine",
}
BASE = {
    "surface, self_affine": ROUGHNESS,
    "surface, sphere": {
        "kind": "sphere",
        "period": [1e-3, 1.5e-3],
        "shape": [16, 24],
        "radius": 0.01,
        "centre": [0.5, 0.25],
    },
    "surface, flat_punch": {
        "kind": "flat_punch",
        "period": [1e-3, 1.5e-3],
        "shape": [16, 24],
        "radius": 2e-4,
        "depth": 1e-5,
        "centre": [0.5, 0.25],
    },
    "surface, paraboloid": {
        "kind": "paraboloid",
        "period": [1e-3, 1.5e-3],
        "shape": [16, 24],
        "radius": 0.01,
        "centre": [0.5, 0.25],
    },
    "surface, sinusoid": {
        "kind": "sinusoid",
        "period": [1e-3, 1.5e-3],
        "shape": [16, 24],
        "amplitude": 1e-6,
        "waves": 1,
        "direction": "x",
    },
    "surface, file": {
        "kind": "file",
        "path": "map.npy",
        "period": [1e-3, 1.5e-3],
        "unit": 1e-6,
        "treatment": "periodic",
        "form": 1,
        "missing": "harmonic",
        "outliers": "keep",
    },
    "material": {
        "young_modulus": 100e9,
        "poisson_ratio": 0.3,
        "hardness": 6e9,
        "yield_stress": 2e9,
        "hardening_modulus": 1e9,
        "thermal_conductivities": [50.0, 20.0],
        "electrical_conductivities": [6e6, 2e6],
    },
    "load": {"mean_pressure": [1e8, 2e8]},
    "body": {"kind": "bonded_layer", "depth": 2e-3},
    "counterface": {"young_modulus": 70e9, "poisson_ratio": 0.2},
    "theory": {
        "energy_reduction": 0.536,
        "reduction": "constant",
        "spectrum": "surface",
    },
    "bem": {"tolerance": 1e-8},
    "fem": {
        "law": "j2",
        "geometry": "gap",
        "depth": 2e-3,
        "layers": 8,
        "tolerance": 1e-8,
        "steps": 10,
    },
}
#: For each (table, key) another value, with the keys that must change with it; None
#: leaves a key out.
OTHER = {
    ("surface, self_affine", "period"): {"period": 1.1e-3},
    ("surface, self_affine", "hurst"): {"hurst": 0.7},
    ("surface, self_affine", "wavenumber_low"): {"wavenumber_low": 7e3},
    ("surface, self_affine", "wavenumber_roll_off"): {"wavenumber_roll_off": 1.3e4},
    ("surface, self_affine", "wavenumber_high"): {"wavenumber_high": 2.6e4},
    ("surface, self_affine", "rms_slope"): {"rms_slope": 0.11},
    ("surface, self_affine", "points_per_shortest_wavelength"): {
        "points_per_shortest_wavelength": 4,
        "shape": None,
    },
    ("surface, self_affine", "shape"): {"shape": [32, 16]},
    ("surface, self_affine", "seeds"): {"seeds": [5]},
    ("surface, file", "path"): {"path": "other.npy"},
    ("surface, file", "period"): {"period": [1.5e-3, 1e-3]},
    ("surface, file", "unit"): {"unit": 2e-6},
    ("surface, file", "treatment"): {"treatment": "mirrored"},
    ("surface, file", "pixel_size"): {"pixel_size": 1e-4, "period": None},
    ("surface, file", "transpose"): {"transpose": True},
    ("surface, file", "missing"): {"missing": "nearest"},
    ("surface, file", "outliers"): {"outliers": "remove"},
    ("surface, file", "clipped"): {"clipped": "keep"},
    ("surface, file", "form"): {"form": 2},
    ("surface, file", "longest_wavelength"): {"longest_wavelength": 5e-4},
    ("surface, file", "shortest_wavelength"): {"shortest_wavelength": 3e-4},
    ("material", "young_modulus"): {"young_modulus": 101e9},
    ("material", "poisson_ratio"): {"poisson_ratio": 0.31},
    ("material", "hardness"): {"hardness": 6.1e9},
    ("material", "yield_stress"): {"yield_stress": 2.1e9},
    ("material", "hardening_modulus"): {"hardening_modulus": 1.1e9},
    ("material", "hardening_curve"): {
        "hardening_curve": [[0.0, 2e9], [0.1, 3e9]],
        "hardening_modulus": None,
    },
    ("material", "thermal_conductivities"): {"thermal_conductivities": [20.0, 50.1]},
    ("material", "electrical_conductivities"): {
        "electrical_conductivities": [2e6, 6.1e6]
    },
    ("load", "mean_pressure"): {"mean_pressure": [1.1e8, 2e8]},
    ("body", "kind"): {"kind": "sliding_layer"},
    ("body", "depth"): {"depth": 2.1e-3},
    ("counterface", "young_modulus"): {"young_modulus": 71e9},
    ("counterface", "poisson_ratio"): {"poisson_ratio": 0.21},
    ("theory", "energy_reduction"): {"energy_reduction": 0.537},
    ("theory", "reduction"): {"reduction": "persson"},
    ("theory", "spectrum"): {"spectrum": "analytic"},
    ("bem", "tolerance"): {"tolerance": 1e-9},
    ("fem", "law"): {"law": "elastic", "steps": None},
    ("fem", "geometry"): {"geometry": "punch"},
    ("fem", "depth"): {"depth": 2.1e-3},
    ("fem", "layers"): {"layers": 9},
    ("fem", "tolerance"): {"tolerance": 1e-9},
    ("fem", "steps"): {"steps": 11},
}
#: The same for the keys of smooth surfaces, which mean the same in all of them.
SHAPES = {
    "period": [1.5e-3, 1e-3],
    "shape": [24, 16],
    "radius": 1.1e-4,
    "depth": 1.1e-5,
    "centre": [0.25, 0.5],
    "amplitude": 1.1e-6,
    "waves": 2,
    "direction": "both",
}
#: The method whose options a table holds.
METHODS_OF = {"theory": "persson", "bem": "bem", "fem": "fem"}


def other_values(table, key):
    """Return a dictionary of the keys to change in a table, for another value of `key`.

    None stands for a key that is left out.
    """
    if (table, key) in OTHER:
        return OTHER[table, key]
    assert key in SHAPES, f"[{table}] {key} is new: add another value to OTHER"
    return {key: SHAPES[key]}


def tables_for(table):
    """Return the tables of a case that has this table, as dictionaries by name."""
    kind = table if table.startswith("surface") else "surface, self_affine"
    names = ["material", "load", *METHODS_OF]
    if table in ("body", "counterface"):
        names.append(table)
    tables = {"surface": dict(BASE[kind])} | {name: dict(BASE[name]) for name in names}
    if kind not in ("surface, self_affine", "surface, file"):
        tables["theory"] = {}
    if table == "body":
        tables["theory"] = {}
    if table == "fem":
        del tables["material"]["hardening_modulus"]
    if table == "counterface":
        tables["fem"] = {}
        del tables["material"]["hardening_modulus"]
    methods = [method for name, method in METHODS_OF.items() if tables[name]]
    if "theory" not in tables or not tables["theory"]:
        methods = [method for method in methods if method != "persson"]
    tables["case"] = {
        "id": "keys",
        "requirement": "Keys differ.",
        "source": "-",
        "methods": methods,
    }
    return tables


def keys_of(folder, tables):
    """Return the key of the saved result of each method, by the method's name.

    The case with these tables is written to a file in the folder.
    """
    lines = []
    for name, content in tables.items():
        if content:
            lines.append(f"[{name}]")
            for key, value in content.items():
                if value is not None:
                    lines.append(f"{key} = {json.dumps(value)}")
    (folder / "keys.toml").write_text("\n".join(lines))
    case = load_case(folder / "keys.toml")
    return {task.method.name: saved.key_of(task) for task in tasks_of(case, Run())}


@pytest.fixture
def folder(tmp_path):
    """Return a folder with two maps of 16 by 24 heights in µm, each with a gap and a
    spike.
    """
    random = np.random.default_rng(1)
    for name in ("map.npy", "other.npy"):
        heights = random.normal(size=(24, 16))
        heights[3, 4] = 40.0
        heights[7, 9] = np.nan
        np.save(tmp_path / name, heights)
    return tmp_path


SOLVED = [
    (table, key)
    for table, key, _, _ in key_table()
    if table not in NOT_SOLVED
    and (table, key) not in {*WITHOUT_EFFECT, ("counterface", "surface")}
    and key != "kind"
]


@pytest.mark.parametrize(("table", "key"), SOLVED)
def test_a_key_that_changes_a_result_changes_its_key(folder, table, key):
    """Another value of a key gives other keys to the results of the methods that it is
    about, and of no other method.
    """
    tables = tables_for(table)
    before = keys_of(folder, tables)
    tables[table.partition(",")[0]] |= other_values(table, key)
    after = keys_of(folder, tables)
    changed = {method for method in before if before[method] != after[method]}
    expected = set(before)
    if table in METHODS_OF:
        expected = {METHODS_OF[table]}
    assert changed == expected


def test_what_is_judged_changes_no_key(folder):
    """Another requirement, source, time limit or gate leaves saved results valid."""
    tables = tables_for("material")
    before = keys_of(folder, tables)
    tables["case"] |= {"requirement": "Another.", "source": "?", "time_limit": 5.0}
    tables["[gate]"] = {
        "quantity": "area.total.raw",
        "of": "bem",
        "against": "persson",
        "tolerance": 0.5,
        "because": "-",
    }
    assert keys_of(folder, tables) == before


def test_a_column_that_a_case_asks_for_changes_its_key(folder):
    """A result on a large grid has only the columns that its case asked for."""
    tables = tables_for("material")
    found = []
    for columns in ([], ["conductance"], ["conductance", "gap_percolation"]):
        tables["case"] |= {"columns": columns}
        found.append(keys_of(folder, tables)["bem"])
    assert len(set(found)) == 3


def test_the_shape_and_each_digit_of_a_period_are_in_the_digest_of_a_scene():
    """The same bytes of heights on another grid, or on a period that differs in its
    ninth digit, are another scene.
    """
    heights = np.linspace(0.0, 1e-6, 48)
    digests = set()
    for shape, period in (((6, 8), 2e-3), ((8, 6), 2e-3), ((6, 8), 2.00000001e-3)):
        surface = Surface(heights.reshape(shape), (period, 2e-3))
        digests.add(Scene(surface, Material(2e11, 0.3), Load(1e8)).digest)
    assert len(digests) == 3


def test_a_counterface_and_a_content_of_a_map_change_the_key(folder):
    """The second rough surface counts, and so do heights behind an unchanged path."""
    tables = tables_for("counterface")
    found = [keys_of(folder, tables)["bem"]]
    for hurst in (0.6, 0.7):
        surface = ROUGHNESS | {"hurst": hurst, "seeds": [8]}
        nested = {key: value for key, value in surface.items() if key != "kind"}
        nested["kind"] = "self_affine"
        found.append(keys_of(folder, tables | {"counterface.surface": nested})["bem"])
    tables = tables_for("surface, file")
    found.append(keys_of(folder, tables)["bem"])
    heights = np.load(folder / "map.npy")
    heights[0, 0] += 1e-9
    np.save(folder / "map.npy", heights)
    found.append(keys_of(folder, tables)["bem"])
    assert len(set(found)) == 5


#: For each field of a scene's parts another value than in SCENE.
OTHER_FIELDS = {
    "Material.young_modulus": 2.1e11,
    "Material.poisson_ratio": 0.31,
    "Material.hardness": 6.1e9,
    "Material.yield_stress": 2.1e9,
    "Material.hardening_modulus": 1.1e9,
    "Material.hardening_curve": ((0.0, 2e9), (0.1, 3e9)),
    "Body.kind": "sliding_layer",
    "Body.depth": 2.1e-3,
    "Load.mean_pressure": (1e8, 2e8, 3e8),
    "Surface.heights": np.linspace(0.0, 1e-6, 32).reshape(4, 8),
    "Surface.periods": (1e-3, 2.1e-3),
    "Surface.spectrum": SelfAffineSpectrum(0.8, 6e3, 7e3, 8e3, 0.1),
    "Surface.recipe": "another one",
    "Surface.treatment_errors": {"total_area": 0.1},
    "Surface.filled": np.arange(32).reshape(4, 8) == 3,
    "Surface.sampled": False,
}
#: Fields that change no number of a result, or follow from others, for each its reason.
FIELDS_WITHOUT_EFFECT = {
    "Surface.seed": "a label: the heights have its phases",
    "Surface.shortest_wavelength": "a label: a result only describes it",
    "Surface.notes": "sentences",
    "Surface.alternatives": "only maps have them, whose recipes name their files",
}


def fields_of_a_scene():
    """Return each field of the parts of a scene, such as "Body.depth"."""
    parts = (Material, Body, Load, Surface)
    return [f"{part.__name__}.{field.name}" for part in parts for field in fields(part)]


@pytest.mark.parametrize("name", fields_of_a_scene())
def test_every_field_of_a_scene_is_in_its_digest(name):
    """Another value of a field changes the digest of the scene, but for the fields that
    change no number.  A field without an entry fails: each new one is decided here.
    """
    scene = Scene(
        Surface(np.linspace(0.0, 2e-6, 32).reshape(4, 8), (1e-3, 2e-3)),
        Material(2e11, 0.3, hardness=6e9, yield_stress=2e9, hardening_modulus=1e9),
        Load((1e8, 2e8)),
        Body("bonded_layer", 2e-3),
    )
    if name in FIELDS_WITHOUT_EFFECT:
        return
    part, _, field = name.partition(".")
    values = {field: OTHER_FIELDS[name]}
    if field == "hardening_curve":
        values["hardening_modulus"] = 0.0
    changed = replace(getattr(scene, part.lower()), **values)
    assert replace(scene, **{part.lower(): changed}).digest != scene.digest


def test_changed_heights_of_a_map_have_a_recipe_of_their_own():
    """The surface with the heights that a measurement leaves open is another one than
    the map, also if that has a recipe, and so is one by another source of error.
    """
    heights = np.linspace(0.0, 1e-6, 48).reshape(6, 8)
    for recipe in ("", "a map"):
        surface = Surface(heights, (1e-3, 1e-3), recipe=recipe)
        found = {surface.fingerprint}
        for source in ("form", "missing"):
            change = np.full(heights.shape, 1e-9)
            changed = Alternative(source, ..., (change,)).applied_to(surface)
            found.add(changed.fingerprint)
        assert len(found) == 3
