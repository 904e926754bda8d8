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
from pathlib import Path

import numpy as np
import pytest

import epcontact
from epcontact.errors import EpcontactError, OutputError
from epcontact.output.files import (
    remove_leftovers,
    require_writable,
    whole_file,
    write_bytes,
    write_json,
    write_text,
)

ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


def is_one_sentence(error: pytest.ExceptionInfo[OutputError], *parts: str) -> bool:
    text = str(error.value)
    return "\n" not in text and len(text) < 700 and all(part in text for part in parts)


def test_text_is_written_as_given_and_missing_folders_are_made(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b" / "x.txt"
    write_text(target, "ä\r\nb\n")
    assert target.read_bytes() == "ä\r\nb\n".encode()
    assert os.listdir(target.parent) == ["x.txt"]


def test_a_file_is_replaced_and_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    target, ordinary = tmp_path / "x", tmp_path / "y"
    write_bytes(target, b"old")
    write_bytes(target, b"new")
    ordinary.write_bytes(b"")
    assert target.read_bytes() == b"new"
    assert target.stat().st_mode == ordinary.stat().st_mode


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, MemoryError])
def test_an_interrupted_block_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    target = tmp_path / "x.vti"
    write_bytes(target, b"old")

    def interrupted() -> None:
        with whole_file(target) as temporary:
            assert temporary.suffix == ".vti"
            assert temporary.parent == target.parent
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["x.vti"]


def test_json_has_words_for_what_it_has_no_numbers_for(tmp_path: Path) -> None:
    target = tmp_path / "x.json"
    data = {
        "hardness": math.inf,
        "low": -np.inf,
        "nan": np.float32("nan"),
        "array": np.array([[1.5, np.inf]]),
        "count": np.int64(3),
        "flag": np.True_,
        "pair": (1, "a"),
        "path": tmp_path,
        "nothing": None,
    }
    write_json(target, data)
    read = json.loads(target.read_text(), parse_constant=pytest.fail)
    assert read == {
        "hardness": "inf",
        "low": "-inf",
        "nan": "nan",
        "array": [[1.5, "inf"]],
        "count": 3,
        "flag": True,
        "pair": [1, "a"],
        "path": str(tmp_path),
        "nothing": None,
    }


def test_json_refuses_what_it_cannot_hold_and_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        write_json(tmp_path / "x.json", {"a": object()})
    assert os.listdir(tmp_path) == []


def test_a_folder_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    with pytest.raises(OutputError) as error:
        write_text(tmp_path / "x", "")
    assert is_one_sentence(error, str(tmp_path / "x"), "is a folder")
    assert isinstance(error.value, EpcontactError)


def test_a_file_where_a_folder_should_be(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("keep")
    with pytest.raises(OutputError) as error:
        write_text(tmp_path / "x" / "y", "")
    assert is_one_sentence(error, str(tmp_path / "x"), "file")
    assert (tmp_path / "x").read_text() == "keep"


def test_a_folder_is_tried_without_a_trace(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("keep")
    require_writable(tmp_path / "new" / "newer")
    with pytest.raises(OutputError) as error:
        require_writable(tmp_path / "x" / "y")
    assert is_one_sentence(error, str(tmp_path / "x"), "not a directory")
    assert os.listdir(tmp_path) == ["x"]


def test_a_name_too_long(tmp_path: Path) -> None:
    with pytest.raises(OutputError) as error:
        write_text(tmp_path / ("n" * 300), "")
    assert is_one_sentence(error, "name too long")
    longest = tmp_path / ("n" * 250 + ".json")
    write_text(longest, "fits")
    assert longest.read_text() == "fits"


@pytest.mark.parametrize("name", ["", "a\0b"])
def test_no_name_at_all(tmp_path: Path, name: str) -> None:
    with pytest.raises(OutputError) as error:
        write_text(name if not name else str(tmp_path) + "/" + name, "")
    assert is_one_sentence(error, "cannot write")


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX links")
def test_links_keep_pointing_and_broken_ones_are_refused(tmp_path: Path) -> None:
    real, link, broken, circle = (tmp_path / name for name in ("real", "link", "broken", "circle"))
    real.write_text("old")
    link.symlink_to(real)
    broken.symlink_to(tmp_path / "gone")
    circle.symlink_to(circle)
    write_text(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"
    with pytest.raises(OutputError) as error:
        write_text(broken, "")
    assert is_one_sentence(error, "broken", "gone", "no such file")
    with pytest.raises(OutputError) as error:
        write_text(circle, "")
    assert is_one_sentence(error, "circle", "too many levels of symbolic links")
    assert sorted(os.listdir(tmp_path)) == ["broken", "circle", "link", "real"]


@pytest.mark.skipif(os.name == "nt", reason="needs /dev/null")
def test_a_device_is_never_replaced() -> None:
    with pytest.raises(OutputError, match="device"):
        write_text("/dev/null", "")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


@pytest.mark.skipif(ROOT or os.name == "nt", reason="root may write everywhere")
def test_a_read_only_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError) as error:
            write_text(tmp_path / "x", "")
    finally:
        tmp_path.chmod(0o700)
    assert is_one_sentence(error, str(tmp_path / "x"), "permission denied")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (errno.EACCES, "permission denied"),
        (errno.EROFS, "read-only"),
        (errno.ENOSPC, "no space left on device"),
        (errno.EIO, "input/output error"),
    ],
)
def test_what_the_system_refuses_while_writing(tmp_path: Path, code: int, words: str) -> None:
    def refused() -> None:
        with whole_file(tmp_path / "x") as temporary:
            temporary.write_bytes(b"half")
            raise OSError(code, os.strerror(code))

    with pytest.raises(OutputError) as error:
        refused()
    assert is_one_sentence(error, str(tmp_path / "x"), words)
    assert os.listdir(tmp_path) == []


def test_a_full_disk_after_the_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    write_text(tmp_path / "x", "old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="no space left"):
        write_text(tmp_path / "x", "new")
    assert (tmp_path / "x").read_text() == "old"
    assert os.listdir(tmp_path) == ["x"]


def test_errors_about_other_files_are_not_claimed(tmp_path: Path) -> None:
    def reading_another() -> None:
        with whole_file(tmp_path / "x"):
            (tmp_path / "other").read_text()

    with pytest.raises(FileNotFoundError, match="other"):
        reading_another()
    assert os.listdir(tmp_path) == []


def test_a_block_that_removes_its_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError), whole_file(tmp_path / "x") as temporary:
        temporary.unlink()
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
        "import sys, epcontact.output.files, epcontact.output.vtk;"
        "heavy = {'vtkmodules', 'pyvista', 'matplotlib', 'meshio', 'scipy'} & set(sys.modules);"
        "sys.exit(f'{heavy} loaded' if heavy else 0)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_leftovers_of_killed_processes_are_removed_and_no_other_files(tmp_path: Path) -> None:
    program = (
        "import sys; from epcontact.output.files import whole_file\n"
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
