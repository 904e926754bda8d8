"""A folder of results that somebody else made cannot reach files outside of itself.

Such a folder is the artifact of a pull request, for example.  Whoever makes it can give
it any names and links, with digests that match.  Each test has a folder `results` and,
beside it, a folder `private` whose files must neither be read, changed nor deleted.
"""

import base64
import errno
import json
import os
import shutil

import conftest
import pytest
from command_line import invoke

from epcontact import files
from epcontact.harness.verdict import verify
from epcontact.harness.verdict.digest import digest_of

SECRET = b"a private picture"
#: Names of files that a report draws, and one that it only shows.
PRIVATE_FILES = ("contact-bem.png", "residuals.csv", "loads-2024.txt", "holiday.png")


@pytest.fixture(scope="module")
def verified(tmp_path_factory):
    """Return the output folder of a verification of SMALL_CASE with theory and boundary
    elements.
    """
    folder = tmp_path_factory.mktemp("verified")
    (folder / "small.toml").write_text(conftest.SMALL_CASE)
    verify(folder / "small.toml", jobs=1, output=folder)
    return folder


@pytest.fixture
def results(verified, tmp_path):
    """Return a copy of the output folder, beside which lies the folder `private`.

    The private folder holds the results once more, and PRIVATE_FILES.
    """
    private = tmp_path / "private" / "fast"
    shutil.copytree(verified / "small" / "fast", private)
    for name in PRIVATE_FILES:
        (private / name).write_bytes(SECRET)
    (private / "holiday.txt").write_text("a private caption")
    return shutil.copytree(verified, tmp_path / "results")


def forge(results, **changes):
    """Change keys of the first case in verdict.json, and adapt the digest of the
    folder.

    `changes` are the new values by their keys.
    """
    file = results / "verdict.json"
    verdict = json.loads(file.read_text())
    verdict["cases"][0] |= changes
    verdict["digest"] = digest_of(verdict, results)
    file.write_text(json.dumps(verdict))


def methods_of(results):
    """Return the entries of the methods in verdict.json by name, as dictionaries."""
    verdict = json.loads((results / "verdict.json").read_text())
    return verdict["cases"][0]["methods"]


def contents(folder):
    """Return the bytes of each file below a folder, by their paths."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def require_refusal(results, sentence, command=("report",)):
    """Require that a command on the results ends with exit code 2 and one sentence.

    `sentence` is a part of the sentence, and `command` are the words of the command
    before the folder; private files must be as before, and no report is written.
    """
    private = results.parent / "private"
    before = contents(private)
    done = invoke(*command, results)
    assert done.returncode == 2, done.stdout
    assert done.stderr.count("\n") == 1
    assert sentence in done.stderr
    assert contents(private) == before
    assert not (results / "report.html").exists()


@pytest.mark.parametrize("command", [("report",), ("compare",), ("gates", "--output")])
@pytest.mark.parametrize("name", ["../private", ".", "a/b", "", "small\n", ".hidden"])
def test_the_id_of_a_case_cannot_be_a_path(results, name, command):
    """Each `command` that reads a verdict refuses an id (`name`) that is no name of a
    folder.
    """
    forge(results, id=name)
    require_refusal(results, f"cases.0.id is {name!r}, but must be the name", command)


@pytest.mark.parametrize(
    ("key", "value"), [("id", "/tmp/private"), ("size", "../../private/fast")]
)
def test_a_case_or_size_cannot_be_a_path(results, key, value):
    """A report refuses a path as the `value` of a case's id or size (`key`)."""
    forge(results, **{key: value})
    require_refusal(results, f"cases.0.{key} is {value!r}")


@pytest.mark.parametrize("name", ["../../../private/fast/bem", "*"])
def test_the_name_of_a_method_cannot_be_a_path_or_a_pattern(results, name):
    """A report refuses a method with the `name` of a path, or of a pattern that fits
    all files.
    """
    methods = methods_of(results)
    methods[name] = methods.pop("bem")
    forge(results, methods=methods)
    require_refusal(results, f"cases.0.methods.{name} is {name!r}")


def test_the_label_of_a_surface_cannot_be_a_path(results):
    """A report refuses a surface whose label is a path."""
    methods = methods_of(results)
    methods["bem"]["seconds"] = {"../seed3": 1.0}
    forge(results, methods=methods)
    require_refusal(results, "cases.0.methods.bem.seconds.../seed3 is '../seed3'")


def test_a_picture_cannot_be_a_link_to_a_private_one(results):
    """A report does not show a picture that is a link out of the folder."""
    folder = results / "small" / "fast"
    (folder / "power-spectrum.png").symlink_to(
        results.parent / "private" / "fast" / "holiday.png"
    )
    (folder / "power-spectrum.txt").write_text("A caption.")
    require_refusal(results, "power-spectrum.png: it leads out of the folder")


def test_a_view_of_a_result_follows_no_link_to_private_fields(results):
    """`epcontact view` refuses a field file that is a link out of the folder of its
    result.
    """
    folder = results / "small" / "fast"
    (folder / "bem.vti").symlink_to(results.parent / "private" / "fast" / "holiday.png")
    done = invoke("view", folder / "bem.json", "--screenshot", results / "x.png")
    assert done.returncode == 2
    assert "bem.vti: it leads out of the folder" in done.stderr
    assert not (results / "x.png").exists()


@pytest.mark.parametrize(
    ("link", "target"), [("small", "private"), ("small/fast", "private/fast")]
)
def test_a_folder_of_results_cannot_be_a_link_to_another(results, link, target):
    """A report refuses a folder of a case or of a size (`link`) that is a link to
    `target`, a folder beside the results.
    """
    shutil.rmtree(results / "small")
    (results / link).parent.mkdir(exist_ok=True)
    (results / link).symlink_to(results.parent / target)
    require_refusal(results, "leads out of the folder")


def test_a_verification_draws_no_pictures_through_a_link(results):
    """`epcontact verify --report` refuses to write into a folder that is a link."""
    shutil.rmtree(results / "small")
    (results / "small").symlink_to(results.parent / "private")
    case = results / "small.toml"
    command = ("verify", case, "--report", "--output")
    require_refusal(results, "leads out of the folder", command)


@pytest.mark.parametrize("link", ["small", "small/fast", "small/fast/members"])
@pytest.mark.parametrize("command", ["run", "verify"])
def test_no_result_is_written_through_a_link(tmp_path, link, command):
    """`run` and `verify` refuse an output folder in which a folder of a case is a link
    out of it, and change nothing behind the link.
    """
    private = tmp_path / "private"
    private.mkdir()
    results = tmp_path / "results"
    (results / link).parent.mkdir(parents=True)
    (results / link).symlink_to(private)
    (tmp_path / "small.toml").write_text(conftest.SMALL_CASE)
    done = invoke(command, tmp_path / "small.toml", "--output", results, "--jobs", 1)
    assert done.returncode == 2
    assert "leads out of the folder" in done.stderr
    assert not any(private.iterdir())


@pytest.mark.parametrize("name", ["../../../private/fast/x.vti", "/etc/passwd"])
def test_a_collection_cannot_name_a_file_outside_of_its_folder(results, name):
    """A report refuses a .pvd file with the `name` of a file outside of its folder."""
    entry = f'<DataSet timestep="0" file="{name}"/>'
    collection = f"<VTKFile><Collection>{entry}</Collection></VTKFile>"
    (results / "small" / "fast" / "bem.pvd").write_text(collection)
    require_refusal(results, "it leads out of the folder")


def test_the_list_of_a_sweep_cannot_name_a_file_outside_of_its_folder(results):
    """`epcontact accuracy` refuses a list of results with a path out of its folder."""
    task = {"file": "../private/fast/members/bem-seed3.json", "key": ""}
    sweep = {"schema": "epcontact-sweep-1", "tasks": [task]}
    (results / "sweep.json").write_text(json.dumps(sweep))
    require_refusal(results, "it leads out of the folder", ("accuracy",))


def test_a_link_that_stays_inside_and_a_folder_that_is_a_link_are_welcome(results):
    """A report accepts a link inside of the folder and a folder that is itself a
    link.
    """
    (results / "latest").symlink_to("small")
    link = results.parent / "link"
    os.symlink(results, link)
    assert invoke("report", link).returncode == 0
    assert (results / "report.html").is_file()


def test_a_report_shows_and_deletes_no_file_that_it_did_not_draw(results):
    """Files whose names resemble those of charts are neither shown, changed nor
    deleted.
    """
    folder = results / "small" / "fast"
    for name in ("contact-notes.txt", "loads-of-work.csv", "body-shop.png"):
        (folder / name).write_bytes(SECRET)
    (folder / "body-shop.txt").write_text("A caption.")
    before = contents(results)
    assert invoke("report", results).returncode == 0
    assert before.items() <= contents(results).items()
    page = (results / "report.html").read_text()
    assert base64.b64encode(SECRET).decode() not in page


def test_pictures_of_an_earlier_run_do_not_stay_beside_other_results(results):
    """A report deletes a chart of an earlier run that it does not draw again."""
    earlier = results / "small" / "fast" / "loads-gap.png"
    earlier.write_bytes(SECRET)
    assert invoke("report", results).returncode == 0
    assert not earlier.exists()


def test_a_report_replaces_no_file_that_is_none(results):
    """`epcontact report --output` replaces an earlier report, and no other file."""
    page = results.parent / "page.html"
    for _ in range(2):
        assert invoke("report", results, "--output", page).returncode == 0
    page.write_text("<!doctype html>\n<title>My page</title>\n")
    command = ("report", "--output", page)
    require_refusal(results, "page.html: it exists and holds something else", command)
    assert "My page" in page.read_text()


def test_results_of_another_kind_are_one_sentence(results):
    """A report refuses results that lack what this version saves."""
    file = results / "small" / "fast" / "bem.json"
    data = json.loads(file.read_text())
    data["members"] = [{"method": 3}]
    file.write_text(json.dumps(data))
    forge(results)
    require_refusal(results, "bem.json holds no results of this version")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("command", ["report", "compare"])
def test_a_pipe_or_a_device_instead_of_a_verdict_is_not_read(tmp_path, command):
    """A pipe that nobody writes, and a device that never ends, are refused at once."""
    for name, create in (
        ("pipe", os.mkfifo),
        ("zero", lambda path: path.symlink_to("/dev/zero")),
    ):
        folder = tmp_path / name
        folder.mkdir()
        create(folder / "verdict.json")
        done = invoke(command, folder)
        assert done.returncode == 2
        assert "it is a device or pipe, not a file" in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_report_into_a_folder_that_is_read_only_is_refused(results, monkeypatch):
    """A file system that lets no file be made, as in a container, is one sentence."""

    def refuse(prefix, dir):
        """Raise what the system raises on a file system that is read-only."""
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), dir)

    monkeypatch.setattr(files.tempfile, "mkdtemp", refuse)
    done = invoke("report", results)
    assert done.returncode == 2
    assert done.stderr.startswith(f"epcontact: cannot write {results}: read-only file")
