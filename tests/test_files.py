"""Files appear whole or not at all, and every refusal is one sentence."""

from __future__ import annotations

import errno
import json
import math
import os
import platform
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import python

import epcontact
from epcontact.errors import OutputError
from epcontact.files import (
    remove_leftovers,
    require_writable,
    whole_file,
    write_bytes,
    write_json,
    write_text,
)

POSIX = os.name != "nt"


def test_text_is_written_as_given_with_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    target, ordinary = tmp_path / "a" / "b" / "x.txt", tmp_path / "y"
    write_text(target, "old")
    write_text(target, "ä\r\nb\n")
    ordinary.write_bytes(b"")
    assert target.read_bytes() == "ä\r\nb\n".encode()
    assert target.stat().st_mode == ordinary.stat().st_mode
    assert os.listdir(target.parent) == ["x.txt"]
    require_writable(tmp_path / "new" / "newer")
    assert sorted(os.listdir(tmp_path)) == ["a", "y"]
    if POSIX:
        (tmp_path / "link").symlink_to(ordinary)
        write_text(tmp_path / "link", "new")
        assert (tmp_path / "link").is_symlink()
        assert ordinary.read_text() == "new"
    longest = tmp_path / ("n" * 250 + ".json")
    write_text(longest, "fits")
    assert longest.read_text() == "fits"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, MemoryError])
def test_an_interrupted_block_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    target = tmp_path / "x.vti"
    write_bytes(target, b"old")

    def interrupted() -> None:
        with whole_file(target) as temporary:
            assert (temporary.suffix, temporary.parent) == (".vti", target.parent)
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["x.vti"]


def test_json_has_words_for_what_it_has_no_numbers_for(tmp_path: Path) -> None:
    values: dict[str, tuple[Any, Any]] = {
        "hardness": (math.inf, "inf"),
        "low": (-np.inf, "-inf"),
        "nan": (np.float32("nan"), "nan"),
        "array": (np.array([[1.5, np.inf]]), [[1.5, "inf"]]),
        "count": (np.int64(3), 3),
        "flag": (np.True_, True),
        "pair": ((1, "a"), [1, "a"]),
        "path": (tmp_path, str(tmp_path)),
        "nothing": (None, None),
    }
    target = tmp_path / "x.json"
    write_json(target, {name: given for name, (given, _) in values.items()})
    read = json.loads(target.read_text(), parse_constant=pytest.fail)
    assert read == {name: held for name, (_, held) in values.items()}
    with pytest.raises(TypeError):
        write_json(tmp_path / "y.json", {"a": object()})
    assert os.listdir(tmp_path) == ["x.json"]


def _interrupted(path: Path, error: OSError) -> None:
    with whole_file(path) as temporary:
        temporary.write_bytes(b"half")
        raise error


def _refused_by_system(code: int) -> Callable[[Path], None]:
    return lambda here: _interrupted(here / "x", OSError(code, os.strerror(code)))


def _removing(path: Path) -> None:
    with whole_file(path) as temporary:
        temporary.unlink()


REFUSED: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a folder in the way": (lambda here: write_text(here / "folder", ""), "folder: it is a folder"),
    "a file for a folder": (lambda here: write_text(here / "file" / "y", ""), "file"),
    "and nothing tried": (lambda here: require_writable(here / "file" / "y"), "not a directory"),
    "a name too long": (lambda here: write_text(here / ("n" * 300), ""), "name too long"),
    "no name": (lambda here: write_text("", ""), "names no file"),
    "a zero in a name": (lambda here: write_text(f"{here}/a\0b", ""), "cannot write"),
    "a removed file": (lambda here: _removing(here / "x"), "no such file"),
    "no permission": (_refused_by_system(errno.EACCES), "x: permission denied"),
    "read-only": (_refused_by_system(errno.EROFS), "x: read-only"),
    "a full disk": (_refused_by_system(errno.ENOSPC), "x: no space left on device"),
    "a broken disk": (_refused_by_system(errno.EIO), "x: input/output error"),
}
if POSIX:
    REFUSED |= {
        "a broken link": (lambda here: write_text(here / "broken", ""), "no such file.*gone"),
        "links in a circle": (lambda here: write_text(here / "circle", ""), "too many levels"),
        "a device": (lambda here: write_text("/dev/null", ""), "device"),
    }


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_one_sentence_and_leaves_no_trace(tmp_path: Path, name: str) -> None:
    call, words = REFUSED[name]
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("keep")
    if POSIX:
        (tmp_path / "broken").symlink_to(tmp_path / "gone")
        (tmp_path / "circle").symlink_to(tmp_path / "circle")
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(OutputError, match=words) as error:
        call(tmp_path)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 700
    assert sorted(os.listdir(tmp_path)) == before
    assert (tmp_path / "file").read_text() == "keep"
    assert not POSIX or stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_errors_about_other_files_are_not_claimed(tmp_path: Path) -> None:
    other = FileNotFoundError(errno.ENOENT, "no such file", "other")
    with pytest.raises(FileNotFoundError, match="other"):
        _interrupted(tmp_path / "x", other)
    assert os.listdir(tmp_path) == []


def test_two_writers_never_mix(tmp_path: Path) -> None:
    """A reader meets one whole file or the other, whoever is writing."""
    target = tmp_path / "x"
    contents = [bytes([65 + k]) * 200_000 for k in range(2)]
    write_bytes(target, contents[0])
    threads = [
        threading.Thread(target=lambda c=c: [write_bytes(target, c) for _ in range(20)])
        for c in contents
    ]
    for thread in threads:
        thread.start()
    seen = set()
    while any(thread.is_alive() for thread in threads):
        seen.add(target.read_bytes())
    assert seen <= set(contents)
    assert os.listdir(tmp_path) == ["x"]


def test_importing_the_package_loads_no_heavy_library() -> None:
    code = (
        "import sys, epcontact.files, epcontact.output.vtk, epcontact.output.view;"
        "heavy = {'vtkmodules', 'pyvista', 'matplotlib', 'meshio', 'scipy'} & set(sys.modules);"
        "sys.exit(f'{heavy} loaded' if heavy else 0)"
    )
    assert python("-c", code).returncode == 0


def test_leftovers_of_killed_processes_are_removed_and_no_other_files(tmp_path: Path) -> None:
    program = (
        "import sys; from epcontact.files import whole_file\n"
        "with whole_file(sys.argv[1]) as path: print(path.name, flush=True); sys.stdin.read()"
    )
    deep = tmp_path / "steps" / "x.vti"
    with subprocess.Popen(
        [sys.executable, "-c", program, deep], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        text=True,
    ) as process, whole_file(tmp_path / "mine"):  # fmt: skip
        assert process.stdout is not None
        name = process.stdout.readline().strip()
        remove_leftovers(tmp_path)
        assert [path.name for path in deep.parent.iterdir()] == [name]
        process.kill()
        while (deep.parent / name).exists():  # the system takes a moment to end it
            remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["mine", "steps"]


def test_a_run_removes_what_a_killed_one_has_left(tmp_path: Path) -> None:
    folder = tmp_path / "bearing-area" / "fast"
    folder.mkdir(parents=True)
    done = subprocess.Popen([sys.executable, "-c", ""])
    done.wait()
    leftover = folder / f".epcontact-{platform.node()}-{done.pid}-0123456789ab.vti"
    leftover.touch()
    epcontact.verify("bearing-area", output=tmp_path, jobs=1)
    assert not leftover.exists()
