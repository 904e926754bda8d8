"""Bad input of every kind: one sentence, exit code 2, nothing half-written, never silence.

Case files, surface files and command lines are mutated at random, but the same way every time;
the quick suite takes some dozens of mutants, the slow one a thousand.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from command_line import Done, invoke
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from epcontact.errors import InvalidCase
from epcontact.harness.case_files import case as casefile

CASE = """
[case]
id = "small"
requirement = "The boundary elements answer a small scene."
source = "made for the tests"
methods = ["persson", "bem"]
time_limit = 20.0
verify = true

[surface]
kind = "self_affine"
period = 1.0e-3
hurst = 0.8
wavenumber_low = 6.283185307179586e3
wavenumber_roll_off = 1.2566370614359173e4
wavenumber_high = 2.513274122871834e4
rms_slope = 0.1
points_per_shortest_wavelength = { fast = 4, full = 8 }
seeds = [3]

[material]
young_modulus = 100.0e9
poisson_ratio = 0.3
hardness = 6.0e9
yield_stress = 2.0e9

[body]
kind = "half_space"

[theory]
energy_reduction = 0.536
spectrum = "analytic"

[bem]
tolerance = 1e-8

[load]
mean_pressure = [2.5e8, 5.0e8]

[[gate]]
quantity = "area.total.corrected"
of = "bem"
against = "persson"
norm = "relative"
tolerance = 0.5
because = "only a smoke test"

[[gate]]
quantity = "quantity.measured_force"
of = "bem"
against = 0.0
norm = "absolute"
between = [-1e-9, 1e-9]
source = "the load"
because = "rounding"
"""

MAP_CASE = """
[case]
id = "map"
requirement = "A map from a file is answered."
source = "made for the tests"
methods = ["bem"]
time_limit = 20.0

[surface]
kind = "file"
path = "{name}"
unit = 1.0
period = 1.0e-3
treatment = "periodic"

[material]
young_modulus = 100.0e9
poisson_ratio = 0.3

[load]
mean_pressure = 5.0e8

[[gate]]
quantity = "quantity.measured_force"
of = "bem"
against = 0.0
norm = "absolute"
tolerance = 1e-9
source = "the load"
because = "rounding"
"""


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
        return
    if done.returncode == 2:
        sentence = done.stderr.splitlines()[-1]
        assert sentence.startswith("epcontact: "), done.stderr
        assert len(sentence) < 2000


def require_whole(output: Path) -> None:
    """Every file that is there can be read to its end, and no temporary one is left."""
    for path in output.rglob("*") if output.is_dir() else ():
        assert not path.name.startswith(".epcontact-"), path
        if path.suffix == ".json":
            json.loads(path.read_bytes())
        elif path.suffix == ".xml":
            ET.parse(path)


# --- mutants of case files -----------------------------------------------------------------------

JUNK = [
    "nan", "inf", "-inf", "0", "-0.0", "-1", "1e400", "1e-320", "1.8e308", "1" + 22 * "0",
    "true", '""', '"\\u0000"', '"..//../x"', '"persson"', "[]", "[[]]", "[nan]", "{}", "[1, 2, 3]",
    "{ fast = 1 }", "{ full = 1 }", "{ fast = {}, full = [] }", "1979-05-27", "'''a\nb'''", "0x10",
    '"area.total.raw"', "[-1.0, 1.0]", "3", "0.3", "1e9",
]  # fmt: skip


@st.composite
def mutants(draw: st.DrawFn, text: str = CASE) -> bytes:
    """The case file with one to three things done to it."""
    lines = text.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        i = draw(st.integers(0, len(lines) - 1))
        key, equals, _ = lines[i].partition(" = ")
        what = draw(st.sampled_from(["drop", "twice", "value", "key", "swap", "insert", "cut"]))
        if what == "drop":
            del lines[i]
        elif what == "twice":
            lines.insert(i, lines[i])
        elif what == "value" and equals:
            lines[i] = f"{key} = {draw(st.sampled_from(JUNK))}"
        elif what == "key" and equals:
            lines[i] = lines[i].replace(key, draw(st.sampled_from([key[:-1], key * 2, "", "é"])), 1)
        elif what == "swap":
            j = draw(st.integers(0, len(lines) - 1))
            lines[i], lines[j] = lines[j], lines[i]
        elif what == "insert":
            lines.insert(i, draw(st.text(max_size=12)))
        elif what == "cut":
            lines[i] = lines[i][: draw(st.integers(0, len(lines[i])))]
        if not lines:
            lines = [""]
    content = "\n".join(lines).encode("utf-8", "surrogatepass")
    damage = draw(st.sampled_from(["none"] * 6 + ["truncate", "bytes"]))
    if damage == "truncate":
        content = content[: draw(st.integers(0, len(content)))]
    elif damage == "bytes":
        at = draw(st.integers(0, len(content)))
        content = content[:at] + draw(st.binary(min_size=1, max_size=8)) + content[at:]
    return content


def judge_mutant(content: bytes, folder: Path) -> None:
    path, output = folder / "small.toml", folder / "with space"
    path.write_bytes(content)
    done = invoke("verify", path, "--output", output, "--jobs", 1)
    require_decent(done, output)
    sentence = why_no_case(path)
    if sentence:
        assert (done.returncode, output.exists()) == (2, False)


def why_no_case(path: Path) -> str:
    """The sentences that refuse a case file, or nothing if it reads."""
    try:
        casefile.load_case(path)
    except InvalidCase as error:
        sentences = error.args
    else:
        return ""
    assert all(str(path) in sentence and "\n" not in sentence for sentence in sentences)
    return "; ".join(sentences)


def some(examples: int) -> settings:
    return settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@pytest.fixture
def fresh(tmp_path: Path) -> Callable[[], Path]:
    """A new folder a call: hypothesis runs many examples in one test."""
    numbers = iter(range(10**6))

    def make() -> Path:
        folder = tmp_path / str(next(numbers))
        folder.mkdir()
        return folder

    return make


def test_the_unspoilt_case_holds(fresh) -> None:
    folder = fresh()
    (folder / "small.toml").write_text(CASE)
    done = invoke("verify", folder / "small.toml", "--output", folder / "out", "--jobs", 1)
    assert done.returncode == 0, done
    require_decent(done, folder / "out")


@some(60)
@given(content=mutants())
def test_mutants_of_a_case_file(fresh, content) -> None:
    judge_mutant(content, fresh())


@pytest.mark.long
@some(1000)
@given(content=mutants())
def test_a_thousand_mutants_of_a_case_file(fresh, content) -> None:
    judge_mutant(content, fresh())


@pytest.mark.parametrize("junk", JUNK)
def test_every_value_replaced_by_junk(tmp_path, junk) -> None:
    # No mutant is solved here: what reads as a case must read as another case than the original.
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    original = signature(casefile.load_case(path))
    lines = CASE.splitlines()
    for i, line in enumerate(lines):
        key, equals, value = line.partition(" = ")
        if not equals or value == junk:
            continue
        path.write_text("\n".join([*lines[:i], f"{key} = {junk}", *lines[i + 1 :]]))
        if why_no_case(path):
            continue
        case = casefile.load_case(path)
        before, after = (tomllib.loads(t) for t in (CASE, path.read_text()))
        if before != after:
            assert signature(case) != original, f"{line} -> {junk} changes nothing"


def signature(case: casefile.Case) -> tuple[object, ...]:
    """Everything that an answer or a verdict depends on."""
    return (
        case.id, case.requirement, case.source, case.methods, case.time_limit, case.verify,
        case.skip, tuple(case.digest(r) for r in case.recipes), repr(case.options), case.gates,
    )  # fmt: skip


# --- mutants of surface files --------------------------------------------------------------------


def heights_as(ending: str) -> bytes:
    x = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    heights = 1e-6 * np.cos(x)[:, None] * np.cos(x)
    buffer = io.BytesIO()
    if ending == "npy":
        np.save(buffer, heights)
    else:
        np.savetxt(buffer, heights, delimiter="," if ending == "csv" else " ")
    return buffer.getvalue()


@st.composite
def spoilt_maps(draw: st.DrawFn) -> tuple[str, bytes]:
    ending = draw(st.sampled_from(["npy", "txt", "csv"]))
    content = heights_as(ending)
    at = draw(st.integers(0, min(len(content), 400)))
    what = draw(st.sampled_from(["truncate", "flip", "insert", "junk", "text", "nothing"]))
    if what == "truncate":
        content = content[:at]
    elif what == "flip" and at < len(content):
        content = (
            content[:at] + bytes([content[at] ^ draw(st.integers(1, 255))]) + content[at + 1 :]
        )
    elif what == "insert":
        content = content[:at] + draw(st.binary(min_size=1, max_size=20)) + content[at:]
    elif what == "junk":
        content = draw(st.binary(max_size=200))
    elif what == "text":
        word = draw(st.sampled_from([b"nan", b"inf", b"1e999", b"x", b"\n", b",", b"#", b"0x1"]))
        content = content[:at] + word + content[at:]
    return f"a map.{ending}", content


def judge_map(name: str, content: bytes, folder: Path) -> None:
    (folder / name).write_bytes(content)
    case, output = folder / "map.toml", folder / "out"
    case.write_text(MAP_CASE.replace("{name}", name))
    require_decent(invoke("verify", case, "--output", output, "--jobs", 1), output)


@some(40)
@given(spoilt=spoilt_maps())
def test_mutants_of_a_surface_file(fresh, spoilt) -> None:
    judge_map(*spoilt, fresh())


@pytest.mark.long
@some(500)
@given(spoilt=spoilt_maps())
def test_many_mutants_of_a_surface_file(fresh, spoilt) -> None:
    judge_map(*spoilt, fresh())


# --- command lines -------------------------------------------------------------------------------

WORDS = [
    "list", "keys", "run", "verify", "small", "small.toml", "absent.toml", ".", "..", "", "-", "--",
    "--help", "--version", "--size", "fast", "full", "large", "--jobs", "1", "0", "-1", "1e9",
    "--output", "out", "--fresh", "--fields", "none", "all", "--method", "bem", "fem", "--solver",
    "faults:honest", ":", "os:getcwd", "--solver=a:b", "-x", "\x1b[31m", "é" * 300, "/dev/null",
]  # fmt: skip


def judge_line(words: list[str], folder: Path) -> None:
    (folder / "small.toml").write_text(CASE)
    # A bare `verify` runs the one case of this folder, not all those of the package.
    (folder / "cases").mkdir()
    (folder / "cases" / "small.toml").write_text(CASE)
    before = {p for p in folder.rglob("*") if p.is_file()}
    done = invoke(*words)
    assert done.returncode in (0, 1, 2), (words, done)
    assert "Traceback" not in done.stdout + done.stderr
    if done.returncode == 2 and not (folder / "out").exists() and not (folder / "results").exists():
        last = done.stderr.splitlines()[-1]
        assert last.startswith("epcontact: ") or "Usage: epcontact" in done.stderr, (words, done)
        assert {p for p in folder.rglob("*") if p.is_file()} == before
    require_whole(folder)


@pytest.fixture
def in_folder(fresh, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Path]:
    def make() -> Path:
        folder = fresh()
        monkeypatch.chdir(folder)
        return folder

    return make


@some(40)
@given(words=st.lists(st.sampled_from(WORDS), max_size=6))
def test_command_lines(in_folder, words) -> None:
    judge_line(words, in_folder())


@pytest.mark.long
@some(150)
@given(words=st.lists(st.sampled_from(WORDS) | st.text(max_size=10), max_size=7))
def test_many_command_lines(in_folder, words) -> None:
    judge_line(words, in_folder())


# --- files that are no files ---------------------------------------------------------------------


def refused(done: Done, *words: str) -> None:
    assert done.returncode == 2, done
    assert done.stderr.splitlines()[-1].startswith("epcontact: "), done
    for word in words:
        assert word in done.stderr, done.stderr


def test_links_to_case_files(fresh) -> None:
    folder = fresh()
    (folder / "real").mkdir()
    (folder / "real" / "small.toml").write_text(CASE)
    (folder / "small.toml").symlink_to("real/small.toml")
    (folder / "dangling.toml").symlink_to("nowhere")
    (folder / "loop.toml").symlink_to("loop.toml")
    (folder / "device.toml").symlink_to("/dev/zero")
    (folder / "folder.toml").mkdir()
    done = invoke("verify", folder / "small.toml", "--output", folder / "out", "--jobs", 1)
    assert done.returncode == 0
    for name in ("dangling", "loop", "device", "folder"):
        refused(invoke("verify", folder / f"{name}.toml"), f"{name}.toml")


def test_devices_and_pipes_among_the_cases_do_not_hang(in_folder) -> None:
    folder = in_folder()
    (folder / "cases").mkdir()
    os.mkfifo(folder / "cases" / "pipe.toml")
    refused(invoke("list"), "pipe.toml", "regular file")
    (folder / "cases" / "pipe.toml").unlink()
    (folder / "cases" / "zero.toml").symlink_to("/dev/zero")
    refused(invoke("list"), "zero.toml", "regular file")


def test_device_or_pipe_for_a_surface_does_not_hang(fresh) -> None:
    folder = fresh()
    os.mkfifo(folder / "pipe.txt")
    for name in ("pipe.txt", "/dev/zero", "/dev/stdin"):
        case = folder / "map.toml"
        case.write_text(MAP_CASE.replace("{name}", name))
        refused(invoke("verify", case, "--output", folder / "out"), Path(name).name)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("points_per_shortest_wavelength = { fast = 4, full = 8 }", "shape = [1000000, 1000000]"),
        ("points_per_shortest_wavelength = { fast = 4, full = 8 }", "shape = [99999999999, 16]"),
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
    done = invoke("verify", folder / "small.toml", "--output", folder / "out", "--jobs", 1)
    require_decent(done, folder / "out")


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
    "in_the_way", ["out", "out/small", "out/small/fast/members", "out/small/fast/bem-seed3.vti"]
)
def test_file_or_folder_in_the_way(small, tmp_path, in_the_way) -> None:
    obstacle = tmp_path / in_the_way
    obstacle.parent.mkdir(parents=True, exist_ok=True)
    if obstacle.suffix:
        obstacle.mkdir()
    else:
        obstacle.write_text("in the way")
    done = invoke("run", small, "--output", tmp_path / "out", "--jobs", 1)
    refused(done, Path(in_the_way).name)
    require_whole(tmp_path / "out")


@pytest.mark.parametrize("name", ["verdict.json", "junit.xml"])
def test_folder_where_the_verdict_should_be(small, tmp_path, name) -> None:
    (tmp_path / "out" / name).mkdir(parents=True)
    refused(invoke("verify", small, "--output", tmp_path / "out", "--jobs", 1), name, "folder")


@pytest.mark.parametrize("folder", ["/proc/epcontact", "/dev/full", "/dev/null/out"])
def test_output_where_none_can_be(small, folder) -> None:
    refused(invoke("verify", small, "--output", folder, "--jobs", 1), folder)


def test_link_to_a_full_device(small, tmp_path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "verdict.json").symlink_to("/dev/full")
    done = invoke("verify", small, "--output", tmp_path / "out", "--jobs", 1)
    refused(done, "verdict.json", "device")


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
        done = invoke("verify", small, "--output", tmp_path / "out", "--jobs", 1)
    refused(done, "file too large")
    require_whole(tmp_path / "out")
    assert not (tmp_path / "out" / "junit.xml").exists()


def test_full_disk(small, tmp_path) -> None:
    folder = tmp_path / "tiny"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(mount, check=False, capture_output=True).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("no file system can be mounted here")
    try:
        done = invoke("verify", small, "--output", folder / "out", "--jobs", 1)
        refused(done, "full")
        require_whole(folder)
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_spoilt_result_is_not_reused(small, tmp_path) -> None:
    out = tmp_path / "out"
    assert invoke("verify", small, "--output", out, "--jobs", 1).returncode == 0
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
        done = invoke("verify", small, "--output", out, "--jobs", 1)
        assert done.returncode == 0, (content[:40], done)
        assert "bem seed3 (reused)" not in done.stderr
        assert json.loads(member.read_bytes())["key"] == json.loads(whole)["key"]


# --- more than one process -----------------------------------------------------------------------


def started(small: Path, out: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "epcontact", "run", str(small), "--output", str(out)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_two_runs_into_one_folder(small, tmp_path) -> None:
    text = CASE.replace("seeds = [3]", "seeds = [1, 2, 3, 4, 5, 6]")
    small.write_text(text)
    out = tmp_path / "out"
    runs = [started(small, out) for _ in range(2)]
    for run in runs:
        _, stderr = run.communicate(timeout=300)
        assert run.returncode == 0, stderr
    require_whole(out)
    assert len(list((out / "small" / "fast" / "members").glob("bem-*.json"))) == 6


@pytest.mark.slow
def test_killed_at_any_moment_leaves_whole_files(small, tmp_path) -> None:
    small.write_text(CASE.replace("seeds = [3]", f"seeds = {list(range(16))}"))
    out = tmp_path / "out"
    for number in range(2):
        run = started(small, out)
        deadline = time.monotonic() + 120
        while len(list(out.rglob("bem-seed*.json"))) <= 3 * number and time.monotonic() < deadline:
            time.sleep(0.02)
        run.kill()
        # Its workers hold the same pipes: they have to end with it.
        run.communicate(timeout=60)
        # A killed process may leave a temporary file behind, but no half file under its name.
        for path in out.rglob("*.json"):
            if not path.name.startswith(".epcontact-"):
                json.loads(path.read_bytes())
    run = started(small, out)
    _, stderr = run.communicate(timeout=300)
    assert run.returncode == 0, stderr
    assert stderr.count("(reused)") >= 4
