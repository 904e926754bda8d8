"""Files appear whole or not at all, and every refusal is one sentence."""

import errno
import json
import math
import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from command_line import python

import epcontact
from epcontact import files
from epcontact.errors import OutputError

POSIX = os.name != "nt"


def test_text_is_written_as_given_with_the_permissions_of_any_new_file(tmp_path):
    """`write_text` creates folders, keeps line ends, and leaves only the file."""
    target = tmp_path / "a" / ("n" * 250 + ".txt")
    ordinary = tmp_path / "y"
    files.write_text(target, "old")
    files.write_text(target, "ä\r\nb\n")
    ordinary.write_bytes(b"")
    assert target.read_bytes() == "ä\r\nb\n".encode()
    assert target.stat().st_mode == ordinary.stat().st_mode
    assert os.listdir(target.parent) == [target.name]
    files.require_writable(tmp_path / "new" / "newer")  # tries without a trace
    assert sorted(os.listdir(tmp_path)) == ["a", "y"]


def test_json_has_words_for_what_it_has_no_numbers_for(tmp_path):
    """`write_json` writes inf and nan as words, and numpy's and Python's
    types as JSON.
    """
    values = [
        math.inf,
        -np.inf,
        np.float32("nan"),
        np.array([[1.5, np.inf]]),
        np.int64(3),
    ]
    values += [np.True_, (1, "a"), tmp_path, None]
    files.write_json(tmp_path / "x.json", values)
    read = json.loads((tmp_path / "x.json").read_text(), parse_constant=pytest.fail)
    expected = [
        "inf",
        "-inf",
        "nan",
        [[1.5, "inf"]],
        3,
        True,
        [1, "a"],
        str(tmp_path),
        None,
    ]
    assert read == expected
    with pytest.raises(TypeError):
        files.write_json(tmp_path / "y.json", {"a": object()})
    assert os.listdir(tmp_path) == ["x.json"]


def stopped_by(error, name="x"):
    """Return a function of a folder that raises an error inside of `atomic_write`.

    `name` is that of the file in the folder.
    """

    def write(here):
        """Write a half of a file in a folder, then raise an error."""
        with files.atomic_write(here / name) as temporary:
            assert temporary.suffix == Path(name).suffix
            assert temporary.parent == here
            temporary.write_bytes(b"half")
            raise error

    return write


def removing(here):
    """Remove the temporary file inside of `atomic_write` in a folder."""
    with files.atomic_write(here / "x") as temporary:
        temporary.unlink()


def writing(name):
    """Return a function of a folder that writes an empty text to a path in it."""

    def write(here):
        """Write an empty text to the path in the folder `here`."""
        files.write_text(os.path.join(here, name), "")

    return write


def require_writable_file(here):
    """Require that a file of the folder `here` can be written into, like a folder."""
    files.require_writable(here / "file")


def writing_nowhere(_):
    """Write a text to an empty path."""
    files.write_text("", "")


#: What is called with a folder, the class of its error, and a pattern of the message.
REFUSED = [
    (writing("folder"), OutputError, "folder: it is a folder"),
    (require_writable_file, OutputError, "not a directory$"),
    (writing("file/y"), OutputError, "y: file.*: .*file$"),
    (writing("n" * 300), OutputError, "name too long"),
    (writing_nowhere, OutputError, "names no file"),
    (writing("a\0b"), OutputError, "cannot write"),
    (removing, OutputError, "no such file"),
    (
        stopped_by(OSError(errno.ENOSPC, "No space left")),
        OutputError,
        "x: no space left",
    ),
    (
        stopped_by(FileNotFoundError(errno.ENOENT, "gone", "other")),
        FileNotFoundError,
        "other",
    ),
    (stopped_by(ValueError("mine"), "file.vti"), ValueError, "mine"),
    (stopped_by(KeyboardInterrupt("mine"), "file.vti"), KeyboardInterrupt, "mine"),
]
if POSIX:
    REFUSED.append((writing("/dev/null"), OutputError, "device"))


@pytest.mark.parametrize(("call", "error", "words"), REFUSED)
def test_a_refusal_is_one_sentence_and_leaves_no_trace(tmp_path, call, error, words):
    """A write that fails raises one short sentence, and changes no file.

    `call` takes the folder, `error` is the class raised, and `words` a pattern of its
    message.
    """
    for name in ("file", "file.vti"):
        (tmp_path / name).write_text("keep")
    (tmp_path / "folder").mkdir()
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(error, match=words) as refused:
        call(tmp_path)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 700
    assert sorted(os.listdir(tmp_path)) == before
    assert (
        (tmp_path / "file").read_text() == (tmp_path / "file.vti").read_text() == "keep"
    )


@pytest.mark.skipif(not POSIX, reason="needs POSIX links")
def test_links_are_not_followed_and_a_full_disk_keeps_the_old_file(
    tmp_path, monkeypatch
):
    """Writing to a link replaces the link, and a full disk keeps the old content."""

    def full(_):
        """Raise the error of a full disk."""
        raise OSError(errno.ENOSPC, "No space left on device")

    real = tmp_path / "real"
    link = tmp_path / "link"
    real.write_text("old")
    for target in (real, tmp_path / "gone", link):
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        files.write_text(link, "new")
    monkeypatch.setattr(os, "fsync", full)  # after the block
    with pytest.raises(OutputError, match="no space left"):
        files.write_text(link, "newer")
    assert not link.is_symlink()
    assert link.read_text() == "new"
    assert real.read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["link", "real"]


def test_two_writers_never_mix(tmp_path):
    """A reader meets one whole file or the other, whoever is writing."""
    target = tmp_path / "x"
    contents = [b"A" * 200_000, b"B" * 200_000]
    files.write_bytes(target, contents[0])
    with ThreadPoolExecutor() as writers:
        writing = writers.map(files.write_bytes, 40 * [target], 20 * contents)
        for _ in range(100):
            assert target.read_bytes() in contents
        assert len([*writing]) == 40
    assert os.listdir(tmp_path) == ["x"]


def test_importing_the_package_loads_no_heavy_library():
    """The modules for files and views load no plotting or VTK library."""
    code = (
        "import sys, epcontact.files, epcontact.output.vtk, epcontact.output.view;"
        "heavy = {'vtkmodules', 'pyvista', 'matplotlib', 'meshio', 'scipy'} & "
        "set(sys.modules);"
        "sys.exit(f'{heavy} loaded' if heavy else 0)"
    )
    assert python("-c", code).stderr == ""


def test_leftovers_of_killed_processes_are_removed_and_no_other_files(tmp_path):
    """A run removes temporary files of killed processes, not those of running ones."""
    folder = tmp_path / "bearing-area" / "fast"
    program = (
        "import sys; from epcontact.files import atomic_write\n"
        "with atomic_write(sys.argv[1]) as path: print(path.name, flush=True); "
        "sys.stdin.read()"
    )
    command = [sys.executable, "-c", program, folder / "steps" / "x.vti"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with (
        subprocess.Popen(command, **pipes) as process,
        files.atomic_write(folder / "mine") as mine,
    ):
        name = process.stdout.readline().strip()
        assert name.startswith(f".epcontact-{platform.node()}-{process.pid}-")
        files.remove_leftovers(folder)
        assert [path.name for path in (folder / "steps").iterdir()] == [name]
        process.kill()
        process.wait()
        epcontact.verify("bearing-area", output=tmp_path, jobs=1)  # a run removes them
        assert not any((folder / "steps").iterdir())
        assert mine.exists()
        # A killed run leaves the file of junit.xml in the folder of the verdict.
        left = [tmp_path / name, tmp_path / "other" / name]
        left[1].parent.mkdir()
        for path in left:
            path.touch()
        epcontact.verify("bearing-area", output=tmp_path, jobs=1)
        assert [path.exists() for path in left] == [False, True]


@pytest.mark.parametrize(
    ("pressures", "times"),
    [([1e5, 2e5, 2.5e5], ["100000.0", "200000.0", "250000.0"]), ([1.0, 0.0], "01")],
)
def test_the_time_of_a_load_is_its_mean_pressure_while_it_grows(
    pressures, times, tmp_path
):
    """ParaView's time of a step is its mean pressure in Pa, or on a path that falls its
    number.
    """
    files.write_collection(tmp_path / "path.pvd", pressures)
    text = (tmp_path / "path.pvd").read_text()
    assert re.findall('timestep="([^"]*)"', text) == [*times]


def test_a_file_of_somebody_else_is_not_replaced(tmp_path):
    """`require_replaceable` accepts a missing, an empty and an earlier file of the same
    purpose, and refuses any other.
    """
    path = tmp_path / "x"
    files.require_replaceable(path, "a,b")
    for content in ("", "a,b\n1,2\n", "<head>a,b"):
        path.write_text(content)
        files.require_replaceable(path, "a,b")
    for content in ("mine", "\n" * 2000 + "a,b\n"):
        path.write_text(content)
        with pytest.raises(OutputError, match="x: it exists and holds something else"):
            files.require_replaceable(path, "a,b")


@pytest.mark.skipif(not POSIX, reason="Windows opens no folder")
def test_a_folder_has_one_writer(tmp_path):
    """A folder that is locked is refused until the lock ends."""
    folders = [tmp_path / "a" / "fast", tmp_path / "b"]
    first = files.lock_folders(folders)
    first.__enter__()
    for folder in folders:
        with (
            pytest.raises(OutputError, match=f"{folder}: another epcontact writes"),
            files.lock_folders([folder]),
        ):
            pass
    first.__exit__(None, None, None)
    with files.lock_folders(folders), files.lock_folders([tmp_path / "a"]):
        assert [folder.is_dir() for folder in folders] == [True, True]
