"""Bad input of every kind: one sentence, exit code 2, nothing half-written, never
silence.

Case files and command lines are mutated at random, but the same way every time;
the quick suite takes some dozens of mutants, the long one hundreds.
"""

import json
import os
import re
import shlex
import tempfile
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from conftest import ROUGH, SMALL_CASE, VARIANTS
from fem_scenes import J2_CASE, MODEL_GATE
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from epcontact import Load, Material, Scene, Surface, plot
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.harness.case_files.text import SIZES
from epcontact.harness.quantities.registry import measure
from epcontact.harness.verdict import verify
from epcontact.interface import percolation_fraction
from epcontact.output.charts.curves import residual_history

# --- mistakes in case files
# ----------------------------------------------------------------------

GRID = "points_per_shortest_wavelength = { fast = 4, full = 8 }"
LOAD = "mean_pressure = 5.0e8"
HEAD = "[load]"
WAVE = 'kind = "sinusoid"\nperiod = 1e-3\nshape = [8]\namplitude = 1e-6'
SURFACE = 'kind = "file"\npath = "map.npy"\nperiod = 1e-3\nunit = 1.0'
NO_SIZE = "points_per_shortest_wavelength = { fast = 4 }\nseeds = { full = [3] }"
TOTAL = 'quantity = "area.total.corrected"\nof = "bem"\nagainst = "persson"'
MEASURED = (
    'quantity = "quantity.measured_force"\nof = "persson"\nagainst = 0.0\nsource = "0"'
)
YIELD = "yield_stress = 2.3077e+09"
CURVE = f"{YIELD}\nhardening_curve = [[0.0, 2.3077e9], [0.1, 3e9]]"
OMIT = '[[omit]]\nof = "bem"\n[load]'
GATE = SMALL_CASE[SMALL_CASE.index("[[gate]]") :]

#: What is replaced in the file, by what, and what the sentence says: the key and the
#: remedy.
MISTAKES = [
    (
        'kind = "self_affine"',
        'kind = "selfaffine"',
        r"surface\.kind must be one of .* self_affine",
    ),
    ('["persson", "bem"]', '["persson", "bme"]', "methods.* 'bme'; did you mean 'bem'"),
    ('["persson", "bem"]', '["bem", "bem"]', "names bem, bem; name each method once"),
    ('against = "persson"', 'against = "herz"', "'herz', which is neither .* 'hertz'"),
    ("fast = 4", "fats = 4", "has the keys 'fats', 'full', .* did you mean 'fast'"),
    ("[[gate]]", "[gate]", r"gate is one table of a list; write \[\[gate\]\]"),
    ("[theory]", "[[theory]]", r"theory is \[\{.* but must be a valid dict"),
    (f"[load]\n{LOAD}", "", r"load is missing; add it \(a table \[load\]\)"),
    ("[theory]\nenergy_reduction = 0.536", "", r"needs a table \[theory\]"),
    (
        ROUGH,
        WAVE,
        r"theory\.spectrum is 'analytic', but a surface of kind sinusoid is not drawn",
    ),
    (
        "period = 1",
        "period = [1e-3, 1e-7] # ",
        "are 0 on a period of 1e-07 m, but at least 2",
    ),
    (
        LOAD,
        "mean_pressure = [2.0e8, 1.0e8]",
        "mean_pressure decreases .* non-decreasing",
    ),
    (GRID, "shape = [8, 8]", "wavenumber_high .* needs at least"),
    ("seeds", "shape = [64, 64]\nseeds", "either .*points_per|points_per.* either"),
    (HEAD, '[body]\nkind = "bonded_layer"\n[load]', "body: depth is inf.* in m"),
    (
        'against = "persson"',
        'against = "heights"',
        "heights has no 'area.total.corrected'; it has",
    ),
    (
        '"area.total.corrected"',
        '"field.pressure"\nnorm = "l2"',
        "give a closed form that has it",
    ),
    (
        'against = "persson"',
        "against = 0.1",
        "gate 1: against is a number without a source",
    ),
    ('against = "persson"', 'against = nan\nsource = "x"', "against is nan.* finite"),
    ('against = "persson"', 'against = "bem"', "compared with itself"),
    (
        "tolerance = 0.5",
        "tolerance = 1\nbetween = [0, 1]",
        "give either tolerance or between",
    ),
    ("tolerance = 0.5", "between = [1, 0]", "between is out of order"),
    ("tolerance = 0.5", "between = [-inf, inf]", "holds whatever the difference is"),
    (
        "tolerance = 0.5",
        'tolerance = 1\nsizes = ["full"]',
        "no gate applies to size 'fast'",
    ),
    (
        "tolerance = 0.5",
        f"tolerance = 1\nsizes = {list(SIZES)}",
        "applies to size 'large', which",
    ),
    ("tolerance = 0.5", 'tolerance = 1\nnorm = "l2"', "a field, and nothing else, has"),
    (
        "tolerance = 0.5",
        'tolerance = 1\nnorm = "supremum"',
        "a distribution, and nothing else",
    ),
    (TOTAL, MEASURED, r"gate 1: quantity\.measured_force .* persson has none"),
    (f"{GRID}\nseeds = [3, 5, 7]", NO_SIZE, "given by size have no size in common"),
    (
        "hardness = 6.0e9",
        "hardness = 6.0e9\nyield_stress = 2.0e9\nhardening_modulus = 1e9",
        "hardening_modulus has no effect: theory and boundary elements have one",
    ),
]
#: The same of a family.
OF_FAMILY = [
    ("material = { y", "materiel = { y", "variant soft: .* did you mean 'material'"),
    ('id = "stiff", ', "", "variant 2 has the case.id None"),
    ('id = "stiff"', 'id = "soft"', "variant 2 has the case.id 'soft'"),
    (GATE, f"{GATE}\n{GATE}", "could complete any of 2"),
]
OF_J2 = [
    (
        'law = "j2"',
        'law = "j2"\ngeometry = "moved"',
        "needs a gate of .* fem.law = 'j2'",
    ),
    ("hardness = 6.9231e+09", "", "has a yield_stress and no hardness"),
    ("hardness = 6.9231e+09", "hardness = 2e9", "below the yield_stress of 2.3077e"),
    ("hardness = 6.9231e+09", "hardness = inf", "needs a finite material.hardness"),
    (
        "yield_stress = 2.3077e+09",
        "",
        r"fem\.law is 'j2', but \[material\] yield_stress is missi",
    ),
    (
        "hardness = 6.9231e+09",
        'hardness = "effective"\nhardening_modulus = 1e9',
        "the cap that stands for J2 flow without hardening; leave hardening_modulus",
    ),
    (YIELD, f"{CURVE}\nhardening_modulus = 1e9", "two hardening laws; give one"),
    (
        YIELD,
        f"{YIELD}\nhardening_modulus = -1.0",
        "hardening_modulus is -1.0, but must",
    ),
    (
        YIELD,
        CURVE.replace("[0.0, 2.3077e9]", "[0.0, 2e9]"),
        r"must begin at \[0, 2.3077e\+09\]",
    ),
    (YIELD, CURVE.replace("0.1", "-0.1"), "plastic strains must increase"),
    (
        YIELD,
        CURVE.replace("], [0.1, 3e9", "], [0.1, 1e9"),
        "stresses must not decrease",
    ),
    (
        YIELD,
        CURVE.replace("], [0.1, 3e9", "], [0.1, inf"),
        "finite strains and positive stresses",
    ),
    (YIELD, f"{YIELD}\nhardening_curve = [[0, 2.3077e9]]", "has one point; give two"),
    (YIELD, CURVE.partition("\n")[2], "hardening needs the yield_stress"),
    (
        'law = "j2"',
        'law = "elastic"\nsteps = 4',
        "steps has no effect on law 'elastic'",
    ),
]
FILES = {
    "small": (SMALL_CASE, MISTAKES),
    "family": (SMALL_CASE + VARIANTS, OF_FAMILY),
    "fem-model-5": (J2_CASE + MODEL_GATE, OF_J2),
}
EDITS = [(name, *row) for name, (_, rows) in FILES.items() for row in rows]


@pytest.mark.parametrize(("name", "old", "new", "says"), EDITS)
def test_a_mistake_is_one_sentence(tmp_path, name, old, new, says):
    """A mistake in a case file raises `InvalidCase` with one line that names file and
    key.

    `name` is that of the file in FILES, `old` the text that is replaced by `new`, and
    `says` a pattern of the message.
    """
    text, _ = FILES[name]
    assert old in text
    path = tmp_path / f"{name}.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidCase, match=says) as caught:
        _ = [load_case(text) for text in find_named(path)]
    assert all(s.startswith(f"{path}: ") and "\n" not in s for s in caught.value.args)


def test_a_code_without_hardening_does_not_solve_a_metal_that_hardens(tmp_path):
    """`tamaas_j2` beside `fem` is refused for a metal that hardens."""
    text = J2_CASE.replace('["fem", "bem"]', '["fem", "tamaas_j2"]')
    path = tmp_path / "fem-model-5.toml"
    path.write_text(text.replace(YIELD, CURVE), encoding="utf-8")
    with pytest.raises(InvalidCase, match="tamaas_j2 does not know"):
        _ = [load_case(text) for text in find_named(path)]


def test_what_is_no_case_file_is_refused(tmp_path):
    """Files that are no TOML, too large or too deep raise `InvalidCase`."""
    path = tmp_path / "broken.toml"
    no_text = "is not TOML in UTF-8"
    for content, says in (
        (b"\xff\xfe[case]", no_text),
        (b"x = " + b"[" * 100_000, no_text),
        (b"#" * (2 << 20), "is larger than"),
        (b"x = 0x" + b"f" * 5000, "has 300 digits"),
        (b"x = { " + b"a." * 50_000 + b"a = 1 }", "a key as many parts"),
        (b"variant = 3", r"variant is 3, but must be tables \[\[variant\]\]"),
    ):
        path.write_bytes(content)
        with pytest.raises(InvalidCase, match=says):
            load_case(path)


def test_all_mistakes_are_told_at_once(write_case):
    """All mistakes of a file are reported, one line each, with exit code 2 and no
    output.
    """

    def refusals(*edits, more=""):
        """Return the lines on stderr for SMALL_CASE with replacements, without their
        beginning.

        `edits` and `more` are those of the fixture `write_case`.
        """
        path = write_case(*edits, more=more)
        done = verified(path, path.parent / "output")
        start = f"epcontact: {path}: "
        assert done.returncode == 2
        assert done.stdout == ""
        assert not (path.parent / "output").exists()
        assert all(line.startswith(start) for line in done.stderr.splitlines())
        return [line.removeprefix(start) for line in done.stderr.splitlines()]

    # A misspelt key is not told to be missing, too.
    assert refusals(
        ("hurst = 0.8", "hurts = 0.8"),
        ("rms_slope = 0.1", 'rms_slope = "steep"'),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.7"),
        (LOAD, 'mean_pressure = [5.0e8, "x"]'),
        ("area.total.corrected", "area.total.corected"),
    ) == [
        "surface.rms_slope is 'steep', but must be a valid number",
        "surface.hurts is no key of a case file; did you mean 'hurst'?",
        "material.poisson_ratio: poisson_ratio is 0.7, but must be a number between "
        "-1 and 0.5, "
        "both excluded",
        "load.mean_pressure[1] is 'x', but must be a valid number",
        "gate 1: no quantity is called 'area.total.corected'; did you mean "
        "'area.total.corrected'?",
    ]
    # Those between tables.
    edits = (
        ('id = "small"', 'id = "other"'),
        ('["persson", "bem"]', '["bem"]'),
    )
    assert refusals(*edits, (LOAD, "mean_pressure = 7.0e9")) == [
        "case.id is 'other', but must be the file's name, 'small'",
        "mean_pressure is 7e+09 Pa, but must stay below the hardness of 6e+09 Pa",
        "gate 1: reads persson, which case.methods does not name; add it there",
    ]
    (sentence,) = refusals((HEAD, OMIT))
    assert sentence.startswith("omit is no key of a case file")
    # One that variants share is told once.
    family = (("hurst =", "hurts ="), ("tolerance = 0.1\n", "tolerence = 0.1\n"))
    assert refusals(*family, more=VARIANTS) == [
        "variant soft: surface.hurts is no key of a case file; did you mean 'hurst'?",
        "variant stiff: gate 1.tolerence is no key of a case file; did you mean "
        "'tolerance'?",
    ]
    # What is hardly a case file is told some.
    *told, last = refusals((SMALL_CASE, "".join(f"x{n} = 1\n" for n in range(30))))
    assert told[0] == "case is missing; add it (a table [case])"
    assert len(told) == 20
    assert last == "there are 14 more mistakes"


# --- mutants of case files and of command lines
# ---------------------------------------------------

#: A case with keys of every kind, which one small surface answers.
CASE = SMALL_CASE
for _old, _new in (
    ('["persson", "bem"]', '["persson", "bem"]\ntime_limit = 20.0\nverify = true'),
    ("wavenumber_high = 5.026548245743669e4", "wavenumber_high = 2.513274122871834e4"),
    ("seeds = [3, 5, 7]", "seeds = [3]"),
    (
        "hardness = 6.0e9",
        'hardness = 6.0e9\nyield_stress = 2.0e9\n\n[body]\nkind = "half_space"',
    ),
    ("= 0.536", '= 0.536\nspectrum = "analytic"\n\n[bem]\ntolerance = 1e-8'),
    ("mean_pressure = 5.0e8", "mean_pressure = [2.5e8, 5.0e8]"),
    ("tolerance = 0.5", 'norm = "relative"\nbetween = [-0.5, 0.5]\nsource = "-"'),
):
    assert _old in CASE
    CASE = CASE.replace(_old, _new)


def require_decent(done, output):
    """Require a clean end of a command: no traceback, whole files, and a true verdict.

    `done` is the completed process, and `output` its folder. An error is one sentence;
    the exit code is that of the verdict, and 0 if and only if all gates hold.
    """
    assert done.returncode in (0, 1, 2), done
    assert "Traceback" not in done.stdout + done.stderr
    require_whole(output)
    if (output / "verdict.json").exists():
        verdict = json.loads((output / "verdict.json").read_bytes())
        statuses = {
            gate["status"] for case in verdict["cases"] for gate in case["gates"]
        }
        assert verdict["exit_code"] == done.returncode
        assert (done.returncode == 0) == (statuses <= {"holds"})
    elif done.returncode == 2:
        refused(done)


def refused(done, *words):
    """Require exit code 2, one short last line on stderr, and all `words` on stderr."""
    assert done.returncode == 2, done
    sentence = done.stderr.splitlines()[-1]
    assert sentence.startswith("epcontact: "), done.stderr
    assert len(sentence) < 2000
    assert all(word in done.stderr for word in words), done.stderr


def require_whole(output):
    """Require that each file in a folder can be read to its end and none is
    temporary.
    """
    readers = {".json": lambda path: json.loads(path.read_bytes()), ".xml": ET.parse}
    for path in filter(Path.is_file, output.rglob("*")):
        assert not path.name.startswith(".epcontact-"), path
        readers.get(path.suffix, Path.stat)(path)


def verified(case, output):
    """Return the completed `verify` of a case file into an output folder."""
    return invoke("verify", case, "--output", output, "--jobs", 1)


def for_each(examples, strategy, judge):
    """Call `judge` with so many `examples` drawn from a strategy, the same
    in each run.
    """
    same = settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    same(given(strategy)(judge))()


def some(quick, many):
    """Return a parameter `examples`: `quick` in the short suite, and `many` in the long
    one.
    """
    return pytest.mark.parametrize(
        "examples", [quick, pytest.param(many, marks=pytest.mark.long)]
    )


#: Values that replace those of a case file, one in a line.
JUNK = r"""nan
inf
-inf
0
-0.0
-1
1e400
1e-320
1.8e308
10000000000000000000000
true
""
"\u0000"
"..//../x"
"persson"
[]
[[]]
[nan]
{}
[1, 2, 3]
{ fast = 1 }
{ full = 1 }
{ fast = {}, full = [] }
1979-05-27
0x10
"area.total.raw"
[-1.0, 1.0]
3
0.3
1e9""".splitlines()
JUNK.append("'''a\nb'''")  # a text of two lines


@st.composite
def mutants(draw):
    """Return a strategy of case files, as bytes, with one to three lines of CASE
    changed.
    """
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
            lines[i] = lines[i].replace(
                key, draw(st.sampled_from([key[:-1], key * 2, "", "é"])), 1
            )
        elif what == "swap":
            lines[i], lines[j] = lines[j], lines[i]
    return "\n".join(lines).encode()


def refuses(path):
    """Return whether a case file is refused, with its path in one line for each
    mistake.
    """
    try:
        load_case(path)
    except InvalidCase as error:
        return all(
            str(path) in sentence and "\n" not in sentence for sentence in error.args
        )
    return False


@some(60, 1000)
def test_mutants_of_a_case_file(tmp_path, examples):
    """Each mutant of a case file is verified, or refused without output."""

    def judge(content):
        """Verify a case file with this content (bytes) in a new folder."""
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        path = folder / "small.toml"
        output = folder / "with space"
        path.write_bytes(content)
        done = verified(path, output)
        require_decent(done, output)
        if refuses(path):
            assert done.returncode == 2
            assert not output.exists()

    for_each(examples, mutants(), judge)


@pytest.mark.parametrize("junk", JUNK)
def test_every_value_replaced_by_junk(tmp_path, junk):
    # No mutant is solved here: what reads as a case must read as another case than the
    # original.
    """A case file with a value replaced by `junk` is refused, or is another case.

    No mutant is solved here.
    """
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    original = signature(load_case(path))
    lines = CASE.splitlines()
    for i, line in enumerate(lines):
        key, equals, _ = line.partition(" = ")
        path.write_text("\n".join([*lines[:i], f"{key} = {junk}", *lines[i + 1 :]]))
        if not equals or refuses(path):
            continue
        if tomllib.loads(CASE) != tomllib.loads(path.read_text()):
            assert signature(load_case(path)) != original, (
                f"{line} -> {junk} changes nothing"
            )


def signature(case):
    """Return all parts of a case on which a result or a verdict depends."""
    digests = tuple(case.digest(recipe) for recipe in case.recipes)
    return case.head, case.skip, digests, repr(case.options), case.gates


#: Words of command lines: commands, files, options, their values, and none of these.
WORDS = shlex.split("""
list keys run verify small small.toml absent.toml . .. '' - --
--help --version --size fast full large --jobs 1 0 -1 1e9 --output out --fresh
--fields none all --method bem fem --solver epcontact.bem:solve : os:getcwd
--solver=a:b -x /dev/null
""")
WORDS += ["\x1b[31m", "é" * 300]


@some(40, 150)
def test_command_lines(tmp_path, monkeypatch, examples):
    """Random words on the command line give exit codes 0 to 2 and never a traceback.

    A command that is refused leaves the files of its folder as they were.
    """

    def judge(words):
        """Run the command line with these words in a new folder that holds the case."""
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        monkeypatch.chdir(folder)
        # A bare `verify` runs the one case of this folder, not all those of the
        # package.
        (folder / "cases").mkdir()
        for path in (folder / "small.toml", folder / "cases" / "small.toml"):
            path.write_text(CASE)
        before = {p for p in folder.rglob("*") if p.is_file()}
        done = invoke(*words)
        assert done.returncode in (0, 1, 2), (words, done)
        assert "Traceback" not in done.stdout + done.stderr
        if done.returncode == 2 and not any(
            (folder / n).exists() for n in ("out", "results")
        ):
            told = done.stderr.splitlines()[-1].startswith("epcontact: ")
            assert told or "Usage: epcontact" in done.stderr, (words, done)
            assert {p for p in folder.rglob("*") if p.is_file()} == before
        require_whole(folder)

    text = st.text(max_size=10) if examples > 100 else st.nothing()
    for_each(examples, st.lists(st.sampled_from(WORDS) | text, max_size=7), judge)


# --- files that are no files, far too much, and output that cannot be written
# --------------------


@pytest.fixture
def small(tmp_path):
    """Return the path of a new file small.toml that holds CASE."""
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


def test_links_devices_and_pipes_do_not_hang(small, tmp_path, monkeypatch):
    """Case files and maps that are links, devices, pipes or folders are refused."""
    monkeypatch.chdir(tmp_path)
    Path("cases").mkdir()
    links = {
        "dangling": "nowhere",
        "loop": "loop.toml",
        "device": "/dev/zero",
        "folder": ".",
    }
    for name, target in links.items():
        Path(f"cases/{name}.toml").symlink_to(target)
    os.mkfifo("cases/pipe.toml")
    for name in (*links, "pipe"):
        refused(invoke("verify", f"cases/{name}.toml"), f"{name}.toml")
    refused(invoke("list"))
    os.mkfifo("pipe.txt")
    for name in ("pipe.txt", "/dev/zero", "/dev/stdin"):
        small.write_text(SMALL_CASE.replace(ROUGH, SURFACE.replace("map.npy", name)))
        refused(verified(small, "out"), Path(name).name)


def test_far_too_much_is_told_before_it_is_tried(small, tmp_path):
    """Grids, periods and seeds that are far too large end cleanly."""
    grids = [(GRID, f"shape = [{n}, 16]") for n in (10**9, 10**11)]
    for old, new in (
        *grids,
        ("period = 1.0e-3", "period = 1e6"),
        ("= [3]", f"= [{2**70}]"),
    ):
        small.write_text(CASE.replace(old, new))
        require_decent(verified(small, tmp_path / "out"), tmp_path / "out")


# Root may write anywhere: a file or a folder in the way also stops root.
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
def test_file_or_folder_in_the_way(small, tmp_path, in_the_way, command):
    """A file or a folder (ends with /) in place of an output gives exit code 2.

    `in_the_way` is its path, and `command` is run or verify. Root may write anywhere: a
    file or a folder in the way also stops root.
    """
    folder, _, name = in_the_way.removesuffix("/").rpartition("/")
    (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    make = Path.mkdir if in_the_way.endswith("/") else Path.touch
    make(tmp_path / folder / name)
    refused(invoke(command, small, "--output", tmp_path / "out", "--jobs", 1), name)
    require_whole(tmp_path / "out")


def test_spoilt_result_is_not_reused(small, tmp_path):
    """A saved result that is cut, no JSON, of wrong form or edited is solved again."""
    assert verified(small, tmp_path).returncode == 0
    member = tmp_path / "small" / "fast" / "members" / "bem-seed3.json"
    whole = member.read_bytes()
    changed = json.loads(whole)
    changed["steps"][-1]["areas"]["corrected"]["total"] = "nonsense"
    edited = whole.replace(b'"mean_pressure": 5', b'"mean_pressure": 6')
    for content in (
        whole[:-20],
        b"\xff\xfe",
        b"[]",
        json.dumps(changed).encode(),
        edited,
    ):
        assert content != whole
        member.write_bytes(content)
        done = verified(small, tmp_path)
        assert done.returncode == 0, content[:40]
        # All results but the spoilt one are reused.
        solves, reused = re.search(r"of (\d+), (\d+) reused", done.stderr).groups()
        assert int(reused) == int(solves) - 1, content[:40]
        assert json.loads(member.read_bytes())["key"] == changed["key"]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda scene: plot([]), "scene is [], but must be a Scene"),
        (lambda scene: plot(scene, 3), "result is 3, but must be a ContactResult"),
        (lambda scene: verify(3), "cases has 3, but must be names, paths or"),
        (lambda scene: verify("where", job=1), "no option 'job'; did you mean 'jobs'?"),
        (lambda scene: residual_history({}), "histories are empty; give the"),
        (
            lambda scene: percolation_fraction(np.zeros((0, 4))),
            "two points a direction",
        ),
        (lambda scene: percolation_fraction([1.0, np.nan]), "holds NaN or infinity"),
        (lambda scene: measure("quantity.x", scene, None), "no quantity is called"),
        (
            lambda scene: measure("quantity.mean_gap", scene, None),
            "quantity.mean_gap is reported by the methods, and not measured",
        ),
    ],
)
def test_public_functions_say_what_they_expected(call, sentence, tmp_path, monkeypatch):
    """Wrong arguments of functions end in a sentence, and never in an error of Python
    such as AttributeError; the verdict of an earlier run stays.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "verdict.json").write_text("{}")
    surface = Surface(np.linspace(0.0, 1e-6, 16), (1e-3,))
    scene = Scene(surface, Material(1e11, 0.3), Load(1e8))
    with pytest.raises(EpcontactError, match=re.escape(sentence)):
        call(scene)
    assert (tmp_path / "results" / "verdict.json").exists()


def test_a_limit_of_the_address_space_is_refused_before_anything_loads(monkeypatch):
    """Under `ulimit -v 500000` each command ends with one sentence; without the check
    the linear algebra or the compiler aborts the process.  Help needs no memory.
    """
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(resource, "getrlimit", lambda which: (500_000 * 1024, -1))
    for command in (["run", "hertz-sphere"], ["list"], ["plan", "hertz-sphere"]):
        done = invoke(*command)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.count("\n") == 1
        assert "may have 0.48 GiB of address space (ulimit -v), but" in done.stderr
    assert invoke("run", "--help").returncode == 0


@pytest.mark.parametrize("pressure", ["1.0e25", "1.0e39", "[5.0e8, 1.1e14]"])
def test_a_load_beyond_any_modulus_is_refused(pressure, write_case):
    """A pressure of more than 1000 Young's moduli, here 1e11 Pa, is refused: rounding
    would hide the roughness, and gates would fall short.
    """
    largest = float(pressure.strip("[]").split(",")[-1])
    edits = ((LOAD, f"mean_pressure = {pressure}"), ("hardness = 6.0e9", ""))
    with pytest.raises(InvalidCase) as error:
        load_case(write_case(*edits))
    (sentence,) = error.value.args
    assert sentence.partition(": ")[2] == (
        f"mean_pressure is {largest:g} Pa, but must be at most 1000 times the "
        "young_modulus of 1e+11 Pa; check the units of both"
    )


def test_a_load_of_a_thousand_moduli_is_judged_rightly(write_case):
    """At the largest load that is accepted, 1000 Young's moduli, all gates on the
    conditions of contact hold.
    """
    path = write_case((LOAD, "mean_pressure = 1.0e14"), ("hardness = 6.0e9", ""))
    verdict = verify(path, jobs=1, output=path.parent)
    checks = [gate for gate in verdict.cases[0].gates if "measured" in gate.quantity]
    assert len(checks) > 4
    assert all(gate.holds for gate in checks)
