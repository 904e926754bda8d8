"""Bad input of every kind: one sentence, exit code 2, nothing half-written, never silence.

Case files, surface files and command lines are mutated at random, but the same way every time;
the quick suite takes some dozens of mutants, the long one hundreds.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Done, invoke
from conftest import SMALL_CASE
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import Case, load_case

GRID = "points_per_shortest_wavelength = { fast = 4, full = 8 }"
#: A case with keys of every kind, which one small surface answers.
CASE = SMALL_CASE
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
CASE += FORCE
SURFACE = """[surface]
kind = "file"
path = "{name}"
unit = 1.0
period = 1.0e-3
treatment = "periodic"

[material]"""
#: The boundary elements on a map.
MAP_CASE = re.sub(
    r"\[surface\].*\[material\]", SURFACE, SMALL_CASE.partition("[theory]")[0], flags=re.S
)
MAP_CASE = MAP_CASE.replace('["persson", "bem"]', '["bem"]').replace('"small"', '"map"')
MAP_CASE += f"[load]\nmean_pressure = 5.0e8\n{FORCE}"


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


def verified(case: Path, output: Path) -> Done:
    return invoke("verify", case, "--output", output, "--jobs", 1)


@pytest.fixture
def fresh(tmp_path: Path) -> Callable[[], Path]:
    """A new folder a call: hypothesis runs many examples in one test."""
    numbers = iter(range(10**6))

    def make() -> Path:
        folder = tmp_path / str(next(numbers))
        folder.mkdir()
        return folder

    return make


def for_each(examples: int, strategy: st.SearchStrategy[Any], judge: Callable[[Any], None]) -> None:
    """Judge so many mutants, the same ones every time."""
    same = settings(
        max_examples=examples, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip

    @same
    @given(strategy)
    def judged(mutant: Any) -> None:
        judge(mutant)

    judged()


def some(quick: int, many: int) -> pytest.MarkDecorator:
    """So many mutants in the quick suite, and so many in the long one."""
    return pytest.mark.parametrize("examples", [quick, pytest.param(many, marks=pytest.mark.long)])


# --- mutants of case files -----------------------------------------------------------------------

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
        flipped = bytes([content[at] ^ draw(st.integers(1, 255))])
        return content[:at] + flipped + content[at + 1 :]
    return content


def why_no_case(path: Path) -> str:
    """The sentences that refuse a case file, or nothing if it reads."""
    try:
        load_case(path)
    except InvalidCase as error:
        sentences = error.args
    else:
        return ""
    assert all(str(path) in sentence and "\n" not in sentence for sentence in sentences)
    return "; ".join(sentences)


def test_the_unspoilt_case_holds(fresh) -> None:
    folder = fresh()
    (folder / "small.toml").write_text(CASE)
    done = verified(folder / "small.toml", folder / "out")
    assert done.returncode == 0, done
    require_decent(done, folder / "out")


@some(60, 1000)
def test_mutants_of_a_case_file(fresh, examples) -> None:
    def judge(content: bytes) -> None:
        path, output = fresh() / "small.toml", fresh() / "with space"
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


# --- mutants of surface files and of command lines -----------------------------------------------


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
def test_mutants_of_a_surface_file(fresh, examples) -> None:
    def judge(spoilt: tuple[str, bytes]) -> None:
        folder = fresh()
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
def test_command_lines(fresh, monkeypatch, examples) -> None:
    def judge(words: list[str]) -> None:
        folder = fresh()
        monkeypatch.chdir(folder)
        (folder / "small.toml").write_text(CASE)
        # A bare `verify` runs the one case of this folder, not all those of the package.
        (folder / "cases").mkdir()
        (folder / "cases" / "small.toml").write_text(CASE)
        before = {p for p in folder.rglob("*") if p.is_file()}
        done = invoke(*words)
        assert done.returncode in (0, 1, 2), (words, done)
        assert "Traceback" not in done.stdout + done.stderr
        if done.returncode == 2 and not any((folder / n).exists() for n in ("out", "results")):
            last = done.stderr.splitlines()[-1]
            assert last.startswith("epcontact: ") or "Usage: epcontact" in done.stderr, (
                words,
                done,
            )
            assert {p for p in folder.rglob("*") if p.is_file()} == before
        require_whole(folder)

    text = st.text(max_size=10) if examples > 100 else st.nothing()
    for_each(examples, st.lists(st.sampled_from(WORDS) | text, max_size=7), judge)


# --- files that are no files, and far too much ---------------------------------------------------


def refused(done: Done, *words: str) -> None:
    assert done.returncode == 2, done
    assert done.stderr.splitlines()[-1].startswith("epcontact: "), done
    assert all(word in done.stderr for word in words), done.stderr


def test_links_to_case_files(fresh) -> None:
    folder = fresh()
    (folder / "real").mkdir()
    (folder / "real" / "small.toml").write_text(CASE)
    links = {"small": "real/small.toml", "dangling": "nowhere", "loop": "loop.toml"}
    for name, target in (links | {"device": "/dev/zero"}).items():
        (folder / f"{name}.toml").symlink_to(target)
    (folder / "folder.toml").mkdir()
    assert verified(folder / "small.toml", folder / "out").returncode == 0
    for name in ("dangling", "loop", "device", "folder"):
        refused(invoke("verify", folder / f"{name}.toml"), f"{name}.toml")


def test_devices_and_pipes_do_not_hang(fresh, monkeypatch) -> None:
    folder = fresh()
    monkeypatch.chdir(folder)
    (folder / "cases").mkdir()
    os.mkfifo(folder / "cases" / "pipe.toml")
    refused(invoke("list"), "pipe.toml", "regular file")
    (folder / "cases" / "pipe.toml").unlink()
    (folder / "cases" / "zero.toml").symlink_to("/dev/zero")
    refused(invoke("list"), "zero.toml", "regular file")
    os.mkfifo(folder / "pipe.txt")
    for name in ("pipe.txt", "/dev/zero", "/dev/stdin"):
        (folder / "map.toml").write_text(MAP_CASE.replace("{name}", name))
        refused(verified(folder / "map.toml", folder / "out"), Path(name).name)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (GRID, "shape = [1000000, 1000000]"),
        (GRID, "shape = [99999999999, 16]"),
        ("wavenumber_high = 2.513274122871834e4", "wavenumber_high = 1e12"),
        ("period = 1.0e-3", "period = 1e6"),
        ("seeds = [3]", f"seeds = [{2**63}]"),
        ("seeds = [3]", f"seeds = [{2**70}]"),
    ],
)
def test_far_too_much_is_told_before_it_is_tried(fresh, old, new) -> None:
    folder = fresh()
    assert old in CASE
    (folder / "small.toml").write_text(CASE.replace(old, new))
    require_decent(verified(folder / "small.toml", folder / "out"), folder / "out")


# --- output folders ------------------------------------------------------------------------------
#
# Root may write anywhere: what also stops root is a file in the way, a file system that is none,
# and a limit on the size of files.


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


@pytest.mark.parametrize(
    ("in_the_way", "command"),
    [
        ("out", "run"),
        ("out/small", "run"),
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


def test_output_where_none_can_be(small, tmp_path) -> None:
    for folder in ("/proc/epcontact", "/dev/full", "/dev/null/out"):
        refused(verified(small, folder), folder)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "verdict.json").symlink_to("/dev/full")
    refused(verified(small, tmp_path / "out"), "verdict.json", "device")


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    resource = pytest.importorskip("resource")  # Windows has none
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)


@pytest.mark.parametrize("size", [0, 100, 5000, 40000])
def test_no_room_for_a_file(small, tmp_path, size) -> None:
    with largest_file(size):
        done = verified(small, tmp_path / "out")
    refused(done, "file too large")
    require_whole(tmp_path / "out")
    assert not (tmp_path / "out" / "junit.xml").exists()


def test_spoilt_result_is_not_reused(small, tmp_path) -> None:
    out = tmp_path / "out"
    assert verified(small, out).returncode == 0
    member = out / "small" / "fast" / "members" / "bem-seed3.json"
    whole = member.read_bytes()
    changed = json.loads(whole)
    changed["steps"][-1]["areas"]["corrected"]["total"] = "nonsense"
    edited = whole.replace(b'"mean_pressure": 5', b'"mean_pressure": 6')
    nested = b"[" * 100_000
    words = json.dumps(changed).encode()
    for content in (whole[:-20], b"", b"\xff\xfe", b"[]", b"null", words, edited, nested):
        assert content != whole
        member.write_bytes(content)
        done = verified(small, out)
        assert done.returncode == 0, (content[:40], done)
        assert "bem seed3 (reused)" not in done.stderr
        assert json.loads(member.read_bytes())["key"] == json.loads(whole)["key"]


@pytest.mark.slow
def test_killed_at_any_moment_leaves_whole_files(small, tmp_path) -> None:
    """Two runs into one folder, killed; a third one finishes what they began."""
    small.write_text(CASE.replace("seeds = [3]", f"seeds = {list(range(16))}"))
    out = tmp_path / "out"

    def started() -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "epcontact", "run", str(small), "--output", str(out)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    runs = [started(), started()]
    deadline = time.monotonic() + 120
    while len(list(out.rglob("bem-seed*.json"))) <= 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    for run in runs:
        run.kill()
        # Its workers hold the same pipes: they have to end with it.
        run.communicate(timeout=60)
    # A killed process may leave a temporary file behind, but no half file under its name.
    for path in out.rglob("*.json"):
        if not path.name.startswith(".epcontact-"):
            json.loads(path.read_bytes())
    run = started()
    _, stderr = run.communicate(timeout=300)
    assert run.returncode == 0, stderr
    assert stderr.count("(reused)") >= 4
