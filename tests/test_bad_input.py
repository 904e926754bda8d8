"""Bad input of every kind: one sentence, exit code 2, nothing half-written, never silence.

Case files, surface files and command lines are mutated at random, but the same way every time;
the quick suite takes some dozens of mutants, the long one hundreds.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Done, invoke
from conftest import SMALL_CASE, VARIANTS
from fem_scenes import J2_CASE, MODEL_GATE
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import Case, find_named, load_case
from epcontact.harness.case_files.text import SIZES

# --- mistakes in case files ----------------------------------------------------------------------

GRID = "points_per_shortest_wavelength = { fast = 4, full = 8 }"
LOAD, HEAD = "mean_pressure = 5.0e8", "[load]"
ROUGH = SMALL_CASE.partition("[surface]\n")[2].partition("\n\n")[0]
WAVE = 'kind = "sinusoid"\nperiod = 1e-3\nshape = [8]\namplitude = 1e-6'
NO_SIZE = "points_per_shortest_wavelength = { fast = 4 }\nseeds = { full = [3] }"
TOTAL = 'quantity = "area.total.corrected"\nof = "bem"\nagainst = "persson"'
MEASURED = 'quantity = "quantity.measured_force"\nof = "persson"\nagainst = 0.0\nsource = "0"'
OMIT = '[[omit]]\nof = "bem"\nquantity = "quantity.measured_gab"\nbecause = "x"\n[load]'
GATE = SMALL_CASE[SMALL_CASE.index("[[gate]]") :]

#: What is replaced in the file, by what, and what the sentence says: the key and the remedy.
MISTAKES = [
    ("hurst =", "hurts =", r"surface\.hurts is no key of a case file; did you mean 'hurst'\?"),
    ("tolerance", "tolerence", r"gate 1\.tolerence is no key .* 'tolerance'"),
    ('kind = "self_affine"', 'kind = "selfaffine"', r"surface\.kind must be one of .* self_affine"),
    ('["persson", "bem"]', '["persson", "bme"]', "methods.* 'bme'; did you mean 'bem'"),
    ('["persson", "bem"]', '["bem", "bem"]', "names bem, bem; name each method once"),
    ('against = "persson"', 'against = "herz"', "'herz', which is neither .* 'hertz'"),
    ("fast = 4", "fats = 4", "has the keys 'fats', 'full', .* did you mean 'fast'"),
    (HEAD, OMIT, "'quantity.measured_gab' of bem, which is no default gate; did you mean"),
    ('id = "small"', 'id = "other"', "case.id is 'other', but must be the file's name, 'small'"),
    ("[[gate]]", "[gate]", r"gate is one table of a list; write \[\[gate\]\]"),
    ("[theory]", "[[theory]]", r"theory is \[\{.* but must be a valid dict"),
    ("period = 1", 'period = "1e-3"  # ', r"surface\.period\[0\] is '1e-3', but must be a valid"),
    (f"[load]\n{LOAD}", "", r"load is missing; add it \(a table \[load\]\)"),
    ("[theory]\nenergy_reduction = 0.536", "", r"needs a table \[theory\]"),
    (ROUGH, WAVE, r"theory\.spectrum is 'analytic', but a surface of kind sinusoid is not drawn"),
    ("period = 1", "period = [1e-3, 1e-7] # ", "are 0 on a period of 1e-07 m, but at least 2"),
    (LOAD, "mean_pressure = 6.0e9", r"mean_pressure is 6e\+09 Pa, .* below the hardness"),
    (LOAD, "mean_pressure = [2.0e8, 1.0e8]", "mean_pressure decreases .* non-decreasing"),
    (GRID, "shape = [8, 8]", "wavenumber_high .* needs at least"),
    ("seeds", "shape = [64, 64]\nseeds", "either .*points_per|points_per.* either"),
    (HEAD, '[body]\nkind = "bonded_layer"\n[load]', "body: depth is inf.* in m"),
    ('["persson", "bem"]', '["bem"]', "gate 1: reads persson, which case.methods does not name"),
    ('against = "persson"', 'against = "heights"', "heights has no 'area.total.corrected'; it has"),
    ('"area.total.corrected"', '"field.pressure"\nnorm = "l2"', "give a closed form that has it"),
    ('against = "persson"', "against = 0.1", "gate 1: against is a number without a source"),
    ('against = "persson"', 'against = nan\nsource = "x"', "against is nan.* finite"),
    ('against = "persson"', 'against = "bem"', "compared with itself"),
    ("tolerance = 0.5", "tolerance = 1\nbetween = [0, 1]", "give either tolerance or between"),
    ("tolerance = 0.5", "tolerance = inf", "tolerance is inf, but must be a finite number"),
    ("tolerance = 0.5", "between = [1, 0]", "between is out of order"),
    ("tolerance = 0.5", "between = [-inf, inf]", "holds whatever the difference is"),
    ("tolerance = 0.5", 'tolerance = 1\nsizes = ["full"]', "no gate applies to size 'fast'"),
    ("tolerance = 0.5", f"tolerance = 1\nsizes = {list(SIZES)}", "applies to size 'large', which"),
    ("tolerance = 0.5", 'tolerance = 1\nnorm = "l2"', "a field, and nothing else, has"),
    ("tolerance = 0.5", 'tolerance = 1\nnorm = "supremum"', "a distribution, and nothing else"),
    ("area.total.corrected", "quantity.model_area", "gate 1: .* needs a gate of fem or tamaas_j2"),
    (TOTAL, MEASURED, r"gate 1: quantity\.measured_force .* persson has none"),
    (f"{GRID}\nseeds = [3, 5, 7]", NO_SIZE, "given by size have no size in common"),
]
#: The same of a family.
OF_FAMILY = [
    ("young_modulus = 50", "yuong_modulus = 50", "variant soft: .* did you mean 'young_mod"),
    ("material = { y", "materiel = { y", "variant soft: .* did you mean 'material'"),
    ('id = "stiff", ', "", "variant 2 has the case.id None"),
    ('id = "stiff"', 'id = "soft"', "variant 2 has the case.id 'soft'"),
    ("tolerance = 0.1,", "tolerence = 0.1,", r"variant stiff: gate 1\.tolerence .*'tolerance'"),
    ('"quantity.mean_gap", of', '"quantity.mean_gab", fo', r"variant stiff: gate 2\.fo"),
    (GATE, f"{GATE}\n{GATE}", "could complete any of 2"),
]
OF_J2 = [
    ('law = "j2"', 'law = "capped"', "needs a gate of .* fem.law = 'j2'"),
    ('law = "j2"', 'law = "j2"\ngeometry = "moved"', "needs a gate of .* fem.law = 'j2'"),
    (LOAD[:16] + "5.7692e+08", "mean_pressure = [1e8, 2e8]", "needs a gate of .* fem.law = 'j2'"),
    ("hardness = 6.9231e+09", "hardness = inf", "needs a gate of .* fem.law = 'j2'"),
    ("hardness = 6.9231e+09", "", "has a yield_stress and no hardness"),
    ("yield_stress = 2.3077e+09", "", r"fem\.law is 'j2', but \[material\] yield_stress is missi"),
    ('law = "j2"', 'law = "j2"\nsteps = 4\nstep_tolerance = 0.1', "give either steps or step_tol"),
    ('law = "j2"', 'law = "elastic"\nsteps = 4', "steps has no effect on law 'elastic'"),
    ('law = "j2"', 'law = "capped"\nstep_tolerance = 0.1', "step_tolerance is for law 'j2', but"),
]
FILES = {
    "small": (SMALL_CASE, MISTAKES),
    "family": (SMALL_CASE + VARIANTS, OF_FAMILY),
    "fem-model-5": (J2_CASE + MODEL_GATE, OF_J2),
}
EDITS = [(name, *row) for name, (_, rows) in FILES.items() for row in rows]


@pytest.mark.parametrize(("name", "old", "new", "says"), EDITS)
def test_a_mistake_is_one_sentence(tmp_path, name: str, old: str, new: str, says: str) -> None:
    text, _ = FILES[name]
    assert old in text
    path = tmp_path / f"{name}.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidCase, match=says) as caught:
        _ = [load_case(text) for text in find_named(path)]
    assert all(s.startswith(f"{path}: ") and "\n" not in s for s in caught.value.args)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xff\xfe[case]", "is not TOML in UTF-8"),
        (b"x = " + b"[" * 100_000, "is not TOML in UTF-8"),
        (b"#" * (2 << 20), "is larger than"),
        (b"variant = 3", r"variant is 3, but must be tables \[\[variant\]\]"),
    ],
)
def test_what_is_no_case_file_is_refused(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "broken.toml").write_bytes(content)
    with pytest.raises(InvalidCase, match=says):
        load_case(tmp_path / "broken.toml")


def refusals(path: Path) -> list[str]:
    """Return what the command line says of a file, less its name; it must write nothing."""
    output = path.parent / "output"
    done = invoke("verify", path, "--output", output)
    assert (done.returncode, done.stdout, output.exists()) == (2, "", False)
    start = f"epcontact: {path}: "
    assert all(line.startswith(start) for line in done.stderr.splitlines())
    return [line.removeprefix(start) for line in done.stderr.splitlines()]


def test_all_mistakes_are_told_at_once(write_case) -> None:
    # Those of the tables; a misspelt key is not told to be missing, too.
    path = write_case(
        ("hurst = 0.8", "hurts = 0.8"),
        ("rms_slope = 0.1", 'rms_slope = "steep"'),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.7"),
        (LOAD, 'mean_pressure = [5.0e8, "x"]'),
        ("area.total.corrected", "area.total.corected"),
    )
    assert refusals(path) == [
        "surface.rms_slope is 'steep', but must be a valid number",
        "surface.hurts is no key of a case file; did you mean 'hurst'?",
        "material.poisson_ratio: poisson_ratio is 0.7, but must be a number between -1 and 0.5, "
        "both excluded",
        "load.mean_pressure[1] is 'x', but must be a valid number",
        "gate 1: no quantity is called 'area.total.corected'; did you mean 'area.total.corrected'?",
    ]
    # Those between tables.
    edits = (('id = "small"', 'id = "other"'), ('["persson", "bem"]', '["bem"]'), (HEAD, OMIT))
    assert refusals(write_case(*edits, (LOAD, "mean_pressure = 7.0e9"))) == [
        "case.id is 'other', but must be the file's name, 'small'",
        "mean_pressure is 7e+09 Pa, but must stay below the hardness of 6e+09 Pa",
        "gate 1: reads persson, which case.methods does not name; add it there",
        "omit has 'quantity.measured_gab' of bem, which is no default gate; did you mean "
        "'quantity.measured_gap'?",
    ]
    # One that variants share is told once.
    family = (("hurst =", "hurts ="), ("tolerance = 0.1,", "tolerence = 0.1,"))
    assert refusals(write_case(*family, more=VARIANTS)) == [
        "variant soft: surface.hurts is no key of a case file; did you mean 'hurst'?",
        "variant stiff: gate 1.tolerence is no key of a case file; did you mean 'tolerance'?",
    ]
    # What is hardly a case file is told some.
    path.write_text("".join(f"x{n} = 1\n" for n in range(30)))
    *told, last = refusals(path)
    assert told[0] == "case is missing; add it (a table [case])"
    assert (len(told), last) == (20, "there are 14 more mistakes")


# --- mutants of case files, of surface files and of command lines ---------------------------------

FORCE = """
[[gate]]
quantity = "quantity.measured_force"
of = "bem"
against = 0.0
norm = "absolute"
between = [-1e-9, 1e-9]
source = "the load"
because = "rounding"
"""
#: A case with keys of every kind, which one small surface answers.
CASE = SMALL_CASE + FORCE
for _old, _new in (
    ('["persson", "bem"]', '["persson", "bem"]\ntime_limit = 20.0\nverify = true'),
    ("wavenumber_high = 5.026548245743669e4", "wavenumber_high = 2.513274122871834e4"),
    ("seeds = [3, 5, 7]", "seeds = [3]"),
    ("hardness = 6.0e9", 'hardness = 6.0e9\nyield_stress = 2.0e9\n\n[body]\nkind = "half_space"'),
    ("= 0.536", '= 0.536\nspectrum = "analytic"\n\n[bem]\ntolerance = 1e-8'),
    ("mean_pressure = 5.0e8", "mean_pressure = [2.5e8, 5.0e8]"),
    ("tolerance = 0.5", 'norm = "relative"\ntolerance = 0.5'),
):
    assert _old in CASE
    CASE = CASE.replace(_old, _new)
SURFACE = 'kind = "file"\npath = "{name}"\nunit = 1.0\nperiod = 1.0e-3\ntreatment = "periodic"'
#: The boundary elements on a map.
MAP_CASE = SMALL_CASE.partition("[[gate]]")[0].replace(ROUGH, SURFACE) + FORCE
MAP_CASE = MAP_CASE.replace('["persson", "bem"]', '["bem"]').replace('"small"', '"map"')


def require_decent(done: Done, output: Path) -> None:
    """A clean exit: whole files; of an error one sentence, of a verdict the truth."""
    assert done.returncode in (0, 1, 2), done
    assert "Traceback" not in done.stdout + done.stderr
    require_whole(output)
    if (output / "verdict.json").exists():
        verdict = json.loads((output / "verdict.json").read_bytes())
        assert verdict["exit_code"] == done.returncode
        statuses = {gate["status"] for case in verdict["cases"] for gate in case["gates"]}
        assert (done.returncode == 0) == (statuses <= {"holds"})
    elif done.returncode == 2:
        sentence = done.stderr.splitlines()[-1]
        assert sentence.startswith("epcontact: "), done.stderr
        assert len(sentence) < 2000


def require_whole(output: Path) -> None:
    """Every file that is there can be read to its end, and no temporary one is left."""
    for path in filter(Path.is_file, output.rglob("*")):
        assert not path.name.startswith(".epcontact-"), path
        if path.suffix == ".json":
            json.loads(path.read_bytes())
        elif path.suffix == ".xml":
            ET.parse(path)


def verified(case: Path, output: Path | str) -> Done:
    return invoke("verify", case, "--output", output, "--jobs", 1)


def for_each(examples: int, strategy: st.SearchStrategy[Any], judge: Callable[[Any], None]) -> None:
    """Judge so many mutants, the same ones every time."""
    same = settings(
        max_examples=examples, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    same(given(strategy)(judge))()


def some(quick: int, many: int) -> pytest.MarkDecorator:
    """So many mutants in the quick suite, and so many in the long one."""
    return pytest.mark.parametrize("examples", [quick, pytest.param(many, marks=pytest.mark.long)])


JUNK = [
    "nan", "inf", "-inf", "0", "-0.0", "-1", "1e400", "1e-320", "1.8e308", "1" + 22 * "0",
    "true", '""', '"\\u0000"', '"..//../x"', '"persson"', "[]", "[[]]", "[nan]", "{}", "[1, 2, 3]",
    "{ fast = 1 }", "{ full = 1 }", "{ fast = {}, full = [] }", "1979-05-27", "'''a\nb'''", "0x10",
    '"area.total.raw"', "[-1.0, 1.0]", "3", "0.3", "1e9",
]  # fmt: skip


@st.composite
def mutants(draw: st.DrawFn) -> bytes:
    """The case file with one to three of its lines changed, and perhaps bytes of it."""
    lines = CASE.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        i, j = (draw(st.integers(0, len(lines) - 1)) for _ in "ij")
        key, equals, _ = lines[i].partition(" = ")
        what = draw(st.sampled_from(["drop", "twice", "value", "key", "swap"]))
        if what == "drop":
            del lines[i]
        elif what == "twice":
            lines.insert(j, lines[i])
        elif what == "value" and equals:
            lines[i] = f"{key} = {draw(st.sampled_from(JUNK))}"
        elif what == "key" and equals:
            lines[i] = lines[i].replace(key, draw(st.sampled_from([key[:-1], key * 2, "", "é"])), 1)
        elif what == "swap":
            lines[i], lines[j] = lines[j], lines[i]
    return draw(damaged("\n".join(lines).encode(), 6))


@st.composite
def damaged(draw: st.DrawFn, content: bytes, whole: int) -> bytes:
    """A file that is cut off, or has other bytes somewhere; whole so many times more often."""
    damage = draw(st.sampled_from(["none"] * whole + ["truncate", "insert", "flip"]))
    at = draw(st.integers(0, len(content)))
    if damage == "truncate":
        return content[:at]
    if damage == "insert":
        return content[:at] + draw(st.binary(min_size=1, max_size=20)) + content[at:]
    if damage == "flip" and at < len(content):
        return content[:at] + bytes([content[at] ^ draw(st.integers(1, 255))]) + content[at + 1 :]
    return content


def why_no_case(path: Path) -> str:
    """The sentences that refuse a case file, or nothing if it reads."""
    sentences: tuple[str, ...] = ()
    try:
        load_case(path)
    except InvalidCase as error:
        sentences = error.args
    assert all(str(path) in sentence and "\n" not in sentence for sentence in sentences)
    return "; ".join(sentences)


@some(60, 1000)
def test_mutants_of_a_case_file(tmp_path, examples) -> None:
    def judge(content: bytes) -> None:
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        path, output = folder / "small.toml", folder / "with space"
        path.write_bytes(content)
        done = verified(path, output)
        require_decent(done, output)
        if why_no_case(path):
            assert (done.returncode, output.exists()) == (2, False)

    for_each(examples, mutants(), judge)


@pytest.mark.parametrize("junk", JUNK)
def test_every_value_replaced_by_junk(tmp_path, junk) -> None:
    # No mutant is solved here: what reads as a case must read as another case than the original.
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    original, lines = signature(load_case(path)), CASE.splitlines()
    for i, line in enumerate(lines):
        key, equals, value = line.partition(" = ")
        if not equals or value == junk:
            continue
        path.write_text("\n".join([*lines[:i], f"{key} = {junk}", *lines[i + 1 :]]))
        if not why_no_case(path) and tomllib.loads(CASE) != tomllib.loads(path.read_text()):
            assert signature(load_case(path)) != original, f"{line} -> {junk} changes nothing"


def signature(case: Case) -> tuple[object, ...]:
    """Everything that an answer or a verdict depends on."""
    digests = tuple(case.digest(recipe) for recipe in case.recipes)
    return case.head, case.skip, digests, repr(case.options), case.gates


@st.composite
def spoilt_maps(draw: st.DrawFn) -> tuple[str, bytes]:
    x = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    heights, buffer = 1e-6 * np.cos(x)[:, None] * np.cos(x), io.BytesIO()
    ending = draw(st.sampled_from(["npy", "txt", "csv"]))
    if ending == "npy":
        np.save(buffer, heights)
    else:
        np.savetxt(buffer, heights, delimiter="," if ending == "csv" else " ")
    content, at = buffer.getvalue(), draw(st.integers(0, 400))
    word = draw(st.sampled_from([b"", b"nan", b"inf", b"1e999", b"x", b"\n", b",", b"#", b"0x1"]))
    whole = draw(damaged(content[:at] + word + content[at:], 1))
    return f"a map.{ending}", draw(st.just(whole) | st.binary(max_size=200))


@some(40, 500)
def test_mutants_of_a_surface_file(tmp_path, examples) -> None:
    def judge(spoilt: tuple[str, bytes]) -> None:
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        (folder / spoilt[0]).write_bytes(spoilt[1])
        (folder / "map.toml").write_text(MAP_CASE.replace("{name}", spoilt[0]))
        require_decent(verified(folder / "map.toml", folder / "out"), folder / "out")

    for_each(examples, spoilt_maps(), judge)


WORDS = [
    "list", "keys", "run", "verify", "small", "small.toml", "absent.toml", ".", "..", "", "-", "--",
    "--help", "--version", "--size", "fast", "full", "large", "--jobs", "1", "0", "-1", "1e9",
    "--output", "out", "--fresh", "--fields", "none", "all", "--method", "bem", "fem", "--solver",
    "faults:honest", ":", "os:getcwd", "--solver=a:b", "-x", "\x1b[31m", "é" * 300, "/dev/null",
]  # fmt: skip


@some(40, 150)
def test_command_lines(tmp_path, monkeypatch, examples) -> None:
    def judge(words: list[str]) -> None:
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        monkeypatch.chdir(folder)
        # A bare `verify` runs the one case of this folder, not all those of the package.
        (folder / "cases").mkdir()
        for path in (folder / "small.toml", folder / "cases" / "small.toml"):
            path.write_text(CASE)
        before = {p for p in folder.rglob("*") if p.is_file()}
        done = invoke(*words)
        assert done.returncode in (0, 1, 2), (words, done)
        assert "Traceback" not in done.stdout + done.stderr
        if done.returncode == 2 and not any((folder / n).exists() for n in ("out", "results")):
            told = done.stderr.splitlines()[-1].startswith("epcontact: ")
            assert told or "Usage: epcontact" in done.stderr, (words, done)
            assert {p for p in folder.rglob("*") if p.is_file()} == before
        require_whole(folder)

    text = st.text(max_size=10) if examples > 100 else st.nothing()
    for_each(examples, st.lists(st.sampled_from(WORDS) | text, max_size=7), judge)


# --- files that are no files, far too much, and output that cannot be written --------------------


def refused(done: Done, *words: str) -> None:
    assert done.returncode == 2, done
    assert done.stderr.splitlines()[-1].startswith("epcontact: "), done
    assert all(word in done.stderr for word in words), done.stderr


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


def test_links_devices_and_pipes_do_not_hang(small, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    links = {"small": "../small.toml", "dangling": "nowhere", "loop": "loop.toml"}
    (tmp_path / "cases").mkdir()
    for name, target in (links | {"device": "/dev/zero"}).items():
        (tmp_path / "cases" / f"{name}.toml").symlink_to(target)
    (tmp_path / "cases" / "folder.toml").mkdir()
    os.mkfifo(tmp_path / "cases" / "pipe.toml")
    assert verified(Path("cases/small.toml"), "out").returncode == 0
    for name in ("dangling", "loop", "device", "folder", "pipe"):
        refused(invoke("verify", f"cases/{name}.toml"), f"{name}.toml")
    refused(invoke("list"))
    os.mkfifo("pipe.txt")
    for name in ("pipe.txt", "/dev/zero", "/dev/stdin"):
        Path("map.toml").write_text(MAP_CASE.replace("{name}", name))
        refused(verified(Path("map.toml"), "out"), Path(name).name)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (GRID, "shape = [1000000, 1000000]"),
        (GRID, "shape = [99999999999, 16]"),
        ("period = 1.0e-3", "period = 1e6"),
        ("seeds = [3]", f"seeds = [{2**70}]"),
    ],
)
def test_far_too_much_is_told_before_it_is_tried(small, tmp_path, old, new) -> None:
    small.write_text(CASE.replace(old, new))
    require_decent(verified(small, tmp_path / "out"), tmp_path / "out")


# Root may write anywhere: what also stops root is a file in the way, a file system that is none,
# and a limit on the size of files.
@pytest.mark.parametrize(
    ("in_the_way", "command"),
    [
        ("out", "run"),
        ("out/small/fast/members", "run"),
        ("out/small/fast/bem-seed3.vti/", "run"),
        ("out/verdict.json/", "verify"),
        ("out/junit.xml/", "verify"),
    ],
)
def test_file_or_folder_in_the_way(small, tmp_path, in_the_way, command) -> None:
    obstacle = tmp_path / in_the_way
    obstacle.parent.mkdir(parents=True, exist_ok=True)
    if in_the_way.endswith("/"):
        obstacle.mkdir()
    else:
        obstacle.write_text("in the way")
    done = invoke(command, small, "--output", tmp_path / "out", "--jobs", 1)
    refused(done, obstacle.name)
    require_whole(tmp_path / "out")


def test_spoilt_result_is_not_reused(small, tmp_path) -> None:
    out = tmp_path / "out"
    done = verified(small, out)
    assert done.returncode == 0, done
    require_decent(done, out)
    member = out / "small" / "fast" / "members" / "bem-seed3.json"
    whole = member.read_bytes()
    changed = json.loads(whole)
    changed["steps"][-1]["areas"]["corrected"]["total"] = "nonsense"
    edited = whole.replace(b'"mean_pressure": 5', b'"mean_pressure": 6')
    words, nested = json.dumps(changed).encode(), b"[" * 100_000
    for content in (whole[:-20], b"", b"\xff\xfe", b"[]", b"null", words, edited, nested):
        assert content != whole
        member.write_bytes(content)
        done = verified(small, out)
        assert done.returncode == 0, (content[:40], done)
        assert "bem seed3 (reused)" not in done.stderr
        assert json.loads(member.read_bytes())["key"] == json.loads(whole)["key"]
