"""What a person reads, beside the screens that were saved: one scene of each command.

`pytest tests/test_screens.py --force-regen` saves the screens that have changed in
`tests/test_screens`, for somebody to read them in the difference of the commit.  Words
are compared exactly and numbers within tolerances; other tests show that the numbers
are right.
"""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_line import invoke
from conftest import SMALL_CASE
from test_compare import changed_tables
from test_executor import THEORY
from test_shown import tree_of, verdict

from epcontact.cli import run_and_verify
from epcontact.harness.verdict.judgement import Verdict

#: Numbers may differ by this part of themselves, by the last digit shown, or by this
#: part of the largest number of their line, which is far below what solvers resolve.
#: Columns and units that are exchanged differ by more; tests of values are narrower.
RELATIVE_TOLERANCE = 0.02
ROUNDING = 1e-9

NUMBER = re.compile(r"(?<![\w.#])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?!\w|\.\d)")

#: Texts that differ from machine to machine and from run to run, and their stand-ins.
VARYING = {
    r"\b\d+(\.\d+){2,}": "VERSION",
    r"(?<=\d),(?=\d{3} MiB)": "",
    r"\b(?=\d*[a-f])[0-9a-f]{12,}\b": "DIGEST",
    r"version VERSION, (commit|date) .*": "MACHINE",
    r"VERSION on \d{4}-\d\d-\d\d": "VERSION on DATE",
}
#: Lines whose numbers are those of a clock, of a machine or of rounding.
NOISE = re.compile(r"measured_|boundary elements \||\| yes \|")


def lasting(text):
    """Return a text without what changes from machine to machine: versions, digests,
    and numbers of measured lines.
    """
    for pattern, name in VARYING.items():
        text = re.sub(pattern, name, text)
    lines = [line.rstrip() for line in text.splitlines()]
    for index, line in enumerate(lines):
        if NOISE.search(line):
            lines[index] = NUMBER.sub("*", line)
    return "\n".join(lines) + "\n"


def words_of(line):
    """Return the words of a line, with a mark in the place of each number."""
    return " ".join(NUMBER.sub("#", line).split())


def tolerance_of(number, scale):
    """Return the allowed difference of a printed number (a text) in a line whose
    largest number is `scale`.
    """
    digits, _, exponent = number.partition("e")
    _, point, decimals = digits.partition(".")
    last_digit = 0.0
    if point:
        last_digit = 10.0 ** (int(exponent or 0) - len(decimals))
    relative = RELATIVE_TOLERANCE * abs(float(number))
    return 1.01 * max(last_digit, relative, ROUNDING * scale)


def compare_screens(obtained, expected):
    """Require that two files (paths) have equal words line by line, and numbers that
    are equal within tolerances.
    """
    lines = obtained.read_text("utf-8").splitlines()
    saved_lines = expected.read_text("utf-8").splitlines()
    assert [words_of(line) for line in lines] == [words_of(s) for s in saved_lines]
    for line, saved_line in zip(lines, saved_lines, strict=True):
        numbers = NUMBER.findall(line)
        saved_numbers = NUMBER.findall(saved_line)
        scale = max((abs(float(number)) for number in saved_numbers), default=0.0)
        for number, saved in zip(numbers, saved_numbers, strict=True):
            difference = abs(float(number) - float(saved))
            assert difference <= tolerance_of(saved, scale), f"{line}\n{saved_line}"


@pytest.fixture(autouse=True)
def terminal_width(monkeypatch):
    """Give every command the same width, whatever terminal the tests run in."""
    monkeypatch.setenv("COLUMNS", "100")


@pytest.fixture
def check_screen(file_regression):
    """Return a function that fails unless a text equals the test's saved screen.

    Words must be equal, numbers within the tolerances of `compare_screens`.
    """

    def check(text):
        """Compare the lasting part of the text with the saved screen."""
        file_regression.check(lasting(text), encoding="utf-8", check_fn=compare_screens)

    return check


#: Two oblong rough metals that conduct heat, of an effective hardness, at two loads.
CHANGES = {
    'id = "small"': 'id = "metals"',
    "[3, 5, 7]": "[3, 5]",
    "period = 1.0e-3": "period = [1.0e-3, 1.25e-3]",
    "mean_pressure = 5.0e8": "mean_pressure = [2.0e8, 5.0e8]",
    "hardness = 6.0e9": 'hardness = "effective"\nyield_stress = 2.0e9\n'
    "thermal_conductivities = [16.0, 50.0]",
}
GATES = """
[[gate]]
quantity = "distribution"
norm = "wasserstein"
of = "bem"
against = "persson"
tolerance = 0.7
because = "two small surfaces are uncertain"

[[gate]]
quantity = "quantity.conductance"
of = "bem"
against = 5.0e4
source = "made up"
between = [-0.9, 0.2]
because = "it is a number"
"""


@pytest.fixture(scope="module")
def metals(tmp_path_factory):
    """Run and verify the case of two metals once.

    The returned namespace has the folder `home`, the case file `case`, the `screens` of
    both commands, and the function `screen` that runs a further command.
    """
    home = tmp_path_factory.mktemp("screens")
    text = SMALL_CASE + GATES
    for old, new in CHANGES.items():
        assert old in text, old
        text = text.replace(old, new)
    case = home / "metals.toml"
    case.write_text(text)

    def screen(command, *options, returncode=0):
        """Run a command, require its exit code, and return what it prints, with HOME
        for the folder.
        """
        done = invoke(command, *options)
        assert done.returncode == returncode, done
        return done.stdout.replace(str(home), "HOME")

    out = ("--jobs", 1, "--output", home)
    screens = {"run": screen("run", case, *out, "--charts")}
    screens["verify"] = screen(
        "verify", case, *out, "--gates", "--report", returncode=1
    )
    return SimpleNamespace(home=home, case=case, screens=screens, screen=screen)


def test_run(metals, check_screen):
    """`run` prints its saved screen at two loads."""
    check_screen(metals.screens["run"])


def test_verify(metals, check_screen):
    """`verify` prints its saved screen with a gate that falls short."""
    check_screen(metals.screens["verify"])


def test_report(metals, check_screen):
    """The page has its saved words; the quantities that no gate reads are left out.

    Its headline has the colour of a case that falls short.
    """
    page = tree_of(metals.home / "report.html")
    (headline,) = page.iter("h1")
    assert headline.get("class") == "verdict bad"
    texts = []
    for element in page.iter():
        is_note = element.get("class") == "note"
        if element.tag == "tr" and not is_note and not element.get("data-uncovered"):
            cells = ("".join(cell.itertext()) for cell in element)
            texts.append(" | ".join(cells))
        elif element.tag in ("h1", "h2", "h3", "p", "li", "summary", "figcaption"):
            texts.append("".join(element.itertext()))
    check_screen("\n".join(" ".join(text.split()) for text in texts))


def test_gates(metals, check_screen):
    """`gates` prints its saved screen of the bands and last values of a case."""
    check_screen(metals.screen("gates", metals.case, "--output", metals.home))


def test_plan(metals, check_screen):
    """`plan` prints its saved screen for areas within 7 %."""
    options = ("--tolerance", "7%", "--check")
    check_screen(metals.screen("plan", metals.case, *options))


def test_cite(metals, check_screen):
    """`cite` prints its saved screen of the literature that a case uses."""
    check_screen(metals.screen("cite", metals.case))


def screen_of(command):
    """Return what a command (one text) prints, which needs no scene and must
    succeed.
    """
    done = invoke(*command.split())
    assert done.returncode == 0
    return done.stdout


def test_list(check_screen):
    """`list` prints its saved screen of all cases of the package."""
    check_screen(screen_of("list"))


def test_keys(check_screen):
    """`keys` prints its saved screen of all keys of a case file."""
    check_screen(screen_of("keys"))


def test_chart(check_screen):
    """`chart` prints its saved screen of all studies."""
    check_screen(screen_of("chart"))


def test_hardness(check_screen):
    """`hardness` prints its saved screen for a metal in SI units."""
    metal = "--yield-stress 1e9 --young-modulus 7e10 --poisson-ratio 0.2"
    surface = "--mean-pressure 2e8 --rms-slope 0.1 --breadth 9"
    check_screen(screen_of(f"hardness {metal} {surface}"))


def test_joint(check_screen):
    """`joint` prints its saved screen for two conducting bodies in SI units."""
    bodies = "--conductivities 16 50 --hardness 3e9 --effective-modulus 2e10"
    surface = "--rms-height 3e-6 --rms-slope 0.2 --mean-pressure 3e7 --breadth 9"
    check_screen(screen_of(f"joint {bodies} {surface}"))


def test_verify_of_many_cases(check_screen, capsys):
    """Of seven cases three hold, two fall short, one has an error, one is skipped."""
    first, second, third = verdict().cases
    judged = [first, second, third]
    for number, case in enumerate((first, first, second)):
        judged.append(case.model_copy(update={"id": f"{case.id}-{number}"}))
    skipped = {"status": "skipped", "gates": [], "skipped_because": "no map is here"}
    judged.append(first.model_copy(update={"id": "case-s", "methods": {}, **skipped}))
    left_out = [["a gate", "another"] if case is third else [] for case in judged]
    shown = []
    for case, gates in zip(judged, left_out, strict=True):
        shown.append(case.model_copy(update={"not_judged": gates}))
        told_hardness = "hard" if case is second else ""
        shown[-1]._case = SimpleNamespace(
            recipes=(), lists_loads=False, told_hardness=told_hardness
        )
    run_and_verify._print_verdict(
        Verdict.on(shown, "fast"), Path("my results"), False, False
    )
    check_screen(capsys.readouterr().out)


def test_compare(check_screen, tmp_path):
    """`compare` prints its saved screen for two tables of values that differ."""
    old, new = changed_tables()
    old.to_csv(tmp_path / "old.csv")
    new.to_csv(tmp_path / "new.csv")
    done = invoke("compare", tmp_path / "old.csv", tmp_path / "new.csv")
    assert done.returncode == 1
    check_screen(done.stdout)


def test_sweep(check_screen, tmp_path, write_case):
    """A sweep of six points by the theory alone prints its saved screen."""
    axes = """
[sweep]
load.mean_pressure = [2e8, 4e8]
material.hardness = [3e9, 6e9, 12e9]
"""
    case = write_case(*THEORY, more=axes)
    done = invoke("sweep", case, "--output", tmp_path, "--jobs", 1)
    assert done.returncode == 0
    check_screen(done.stdout.replace(str(tmp_path), "HOME"))


def test_every_saved_screen_belongs_to_a_test():
    """No saved screen is left of a test that was renamed or deleted."""
    files = Path(__file__).with_suffix("").glob("*.txt")
    assert {file.stem for file in files} <= {*globals()}
