"""Intervals, distances, gates and verdicts that are known by hand; one case is
solved.
"""

import errno
import json
import math
import os
import platform
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections import namedtuple
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from statistics import fmean

import conftest
import numpy as np
import pytest
from command_line import invoke

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase, OutputError
from epcontact.harness.case_files.case import find_case, load_case
from epcontact.harness.gates import (
    Gate,
    distance,
    estimate,
    judge_distance,
    judge_values,
    unjudged_verdict,
)
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run
from epcontact.harness.verdict.evidence import J2_PAIR, kind_of, subject_of
from epcontact.harness.verdict.files import write_verdict
from epcontact.harness.verdict.judgement import Verdict, judge_case
from epcontact.harness.verdict.run_info import commit_of
from epcontact.harness.verdict.verification import verify
from epcontact.machine import available_cores
from epcontact.results import (
    Areas,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)


def gate(norm="relative", low=-0.1, high=0.1):
    """Return a gate on the raw contact area of bem against persson, whose deviation in
    the given norm must be between `low` and `high`.
    """
    return Gate("area.total.raw", "bem", "persson", norm, low, high, "a test")


BEM, FEM = [1.0, 2.0, 4.0], [1.1, 1.9, 4.4]


@pytest.mark.parametrize(
    (
        "norm",
        "values",
        "references",
        "paired",
        "mean",
        "half_width",
    ),  # Student's factor: 4.3026527
    [
        ("absolute", BEM, FEM, True, -2 / 15, 0.6251609479375779),
        ("relative", BEM, FEM, True, -9 / 209, 0.2058685516626538),
        ("absolute", BEM, FEM, False, -2 / 15, 5.717115803043791),
        ("relative", BEM, FEM, False, -2 / 37, 2.2485173670091716),
        ("relative", BEM, [2.0], False, 1 / 6, 1.897291516798379),
        ("relative", [-1.0, -2.0, -4.0], [2.0], False, -13 / 6, 1.897291516798379),
    ],
)
def test_differences_of_known_values(
    norm, values, references, paired, mean, half_width
):
    """The mean difference and its 95 % half-width are those worked out by hand.

    The values are one area for each surface. `paired` takes differences surface by
    surface; Student's factor for three surfaces is 4.3026527, which scipy 1.15 has to
    1.2e-11 only.
    """
    found = judge_values(gate(norm), values, references, paired).difference
    assert found.mean == pytest.approx(mean, rel=1e-12)
    assert found.half_width == pytest.approx(half_width, rel=1e-10)


@pytest.mark.parametrize(
    ("band", "values", "references", "holds"),
    [
        (gate(), [1.09], [1.0], True),
        (gate(), [1.11], [1.0], False),
        (
            gate(),
            [0.9, 1.1],
            [1.0],
            False,
        ),  # the mean is well inside, the interval is not
        (gate(), [1.0], [0.9, 1.1], False),
        (gate(low=0.07, high=0.12), [1.1], [1.0], True),
        (gate(low=0.07, high=0.12), [1.0], [1.0], False),
        (gate("absolute", -1.0, 0.4), [1.0], [0.5], False),
        (gate(), [math.nan], [1.0], False),
        (gate(), [math.inf], [1.0], False),
    ],
)
def test_a_gate_holds_only_if_the_whole_interval_does(band, values, references, holds):
    """A gate holds if the whole 95 % interval of the deviation is inside of its band,
    not the mean alone; NaN and infinity never hold.

    `band` is the gate, `values` and `references` are one number for each surface,
    unpaired, and `holds` is the expected judgement.
    """
    assert judge_values(band, values, references, paired=False).holds == holds


def test_margin_is_the_band_over_difference_and_interval():
    """The margin is the distance from 0 to the band's end, divided by the deviation
    plus its half-width; a gate without a judgement has the margin NaN.
    """
    wide = gate("absolute", -0.1, 0.3)
    assert judge_values(wide, [1.2], [1.0], paired=False).margin == pytest.approx(
        0.2 / 0.1
    )
    spread = judge_values(wide, [1.0, 1.2], [1.0], paired=False)
    assert spread.margin == pytest.approx(0.2 / spread.difference.half_width)
    assert judge_distance(replace(wide, norm="l2"), [0.1]).margin == pytest.approx(3.0)
    assert not judge_distance(gate("supremum", 0, 1), [math.nan]).holds
    # A residual may be as small as it likes, but not 0.
    small = replace(wide, against=0.0, norm="absolute", low=1e-18, high=1e-7)
    margin = judge_values(small, [5e-9], [0.0], paired=False).margin
    assert margin == pytest.approx(20.0)
    assert math.isnan(unjudged_verdict(wide, "no").margin)


def uniform(low, area=1.0, plastic=0.0):
    """Return a distribution of pressures spread evenly from `low` to `low + 1` (Pa), on
    the fraction `area` of the nominal area.

    `plastic` is the further fraction at the hardness.
    """
    sigma = np.linspace(0, 2, 20001)
    return PressureDistribution(sigma, area * np.clip(sigma - low, 0, 1), plastic)


JUMP = PressureDistribution(np.array([0, 0.5 - 1e-12, 0.5]), np.array([0.0, 0.0, 0.3]))


@pytest.mark.parametrize(
    ("norm", "a", "b", "hardness", "exact"),
    [
        ("wasserstein", uniform(0.2), uniform(0.5), 4.0, 0.3 / 4),
        # Without a hardness the scale is the mean contact pressure of the reference,
        # here 1.
        ("wasserstein", uniform(0.2, 0.25), uniform(0.5, 0.1), math.inf, 0.3),
        ("wasserstein", uniform(0, 0.2, 0.2), uniform(0, 0.3, 0.1), 2.0, 0.375 / 2),
        ("wasserstein", JUMP, uniform(0, 0.4), 4.0, 0.25 / 4),
        # Of areas .5 and .25 the largest difference is .25, over the area of the
        # reference.
        ("supremum", uniform(0, 0.5), uniform(0, 0.25), 4.0, 1.0),
        ("supremum", uniform(0, 0.2, 0.1), uniform(0, 0.1, 0.3), 2.0, 0.25),
        ("supremum", JUMP, uniform(0, 0.4), 4.0, 0.5),
    ],
)
def test_distances_of_known_distributions(norm, a, b, hardness, exact):
    """The distance of two pressure distributions is that of an integral by hand.

    Wasserstein distances are divided by the hardness, and suprema by the contact area
    of the reference `b`. A reference without contact is refused.
    """
    assert distance(norm, a, b, hardness) == pytest.approx(exact, rel=2e-4)
    with pytest.raises(InvalidCase, match="without contact"):
        distance(norm, uniform(0, area=0.0), b, hardness)


def answer(method, *areas, claim=0.0, labels="abc"):
    """Return the results of a method with one surface for each total area, a fraction
    of the nominal area.

    Half of each area is plastic. `claim` is the estimated error of the first surface's
    total area, and grows from surface to surface; `labels` holds one letter for each
    surface.
    """
    results = []
    for number, total in enumerate(areas):
        error = Areas(*(claim * (1 + number) * share for share in (1.0, 0.3, 0.7)))
        parts = dict.fromkeys(("raw", "corrected"), Areas(total, total / 2, total / 2))
        step = LoadStep(
            5e8, parts | {"error": error}, quantities={"largest_pressure": number}
        )
        results.append(ContactResult(method, (step,), Provenance("digest")))
    return MethodResults(tuple(results), tuple(labels[: len(areas)]))


def of_bem(*areas, claim=0.0, **others):
    """Return the results by method: bem with these areas (fractions) and this estimated
    error, persson with one area of 0.1.

    `others` adds or replaces the results of methods.
    """
    return {
        "bem": answer("bem", *areas, claim=claim),
        "persson": answer("persson", 0.1),
    } | others


def failed(method, *areas):
    """Return a dictionary with the results of one method: these areas, and one error
    that names the method.
    """
    return {method: replace(answer(method, *areas), errors=(f"{method}, a: stalled",))}


@pytest.fixture
def case(write_case):
    """Return the small case with its only explicit gate, a band of ± 10 % on the area.

    The default gates are left out, because they read pressure fields, which these
    results lack.
    """
    loaded = load_case(write_case(("tolerance = 0.5", "tolerance = 0.1")))
    return loaded.changed(gates=loaded.gates[:1])


SCATTERED = (0.05, 0.1, 0.2)
UNPAIRED = answer("persson", *SCATTERED, labels="def")
TWINS = MethodResults(2 * answer("bem", 0.1).results, ("a", "b"))


@pytest.mark.parametrize(
    ("given", "status", "why"),
    [
        (of_bem(0.1, 0.101, 0.102), "holds", ""),
        (of_bem(0.05, 0.1, 0.15), "falls short", ""),
        (of_bem(*SCATTERED, persson=answer("persson", *SCATTERED)), "holds", ""),
        (of_bem(*SCATTERED, persson=UNPAIRED), "falls short", ""),
        (of_bem(**failed("bem")), "error", "stalled"),
        (of_bem(**failed("bem", 0.1, 0.1)), "error", "stalled"),
        (of_bem(0.1, **failed("persson")), "error", "stalled"),
        (of_bem(bem=TWINS), "error", "surfaces a and b the same result"),
    ],
)
def test_status_of_a_case(case, given, status, why):
    """The status of a case with one gate follows from its values.

    An interval inside the band holds, a scattered one falls short unless the surfaces
    are paired, and failed or repeated surfaces are an error. `given` holds the results
    by method, and `why` is part of the gate's error message.
    """
    outcome = judge_case(case, given)
    assert outcome.status == outcome.gates[0].status == status
    assert why in str(outcome.gates[0].error)


def test_exit_code_of_several_cases(case):
    """The exit code is 0 if all judged cases hold, 1 if one falls short, and 2 if one
    has an error; skipped cases do not count.
    """
    held = judge_case(case, of_bem(0.1))
    skipped = judge_case(case.changed(skip="no file"), {})
    assert (skipped.status, skipped.gates) == ("skipped", [])
    short, error = (
        held.model_copy(update={"status": s}) for s in ("falls short", "error")
    )
    for cases, exit_code in (
        ([held, skipped], 0),
        ([held, short, held], 1),
        ([error, held], 2),
        ([short, error], 2),
    ):
        verdict = Verdict.on(cases, "fast")
        assert (verdict.exit_code, verdict.passed) == (exit_code, exit_code == 0)


def test_a_scalar_that_no_method_has_is_an_error_that_names_those_it_has(case):
    """A gate on a quantity that the method does not report is an error, and its message
    lists the quantities that are reported.
    """
    absent = case.changed(
        gates=(replace(case.gates[0], quantity="quantity.diffusion"),)
    )
    (gate,) = judge_case(absent, of_bem(0.1)).gates
    assert gate.status == "error"
    assert re.search(
        r"'quantity\.diffusion'; it has .*area\.total\.raw", str(gate.error)
    )


def test_areas_less_sure_than_the_band_do_not_hold(case):
    """A gate counts the estimated grid errors of the areas.

    An estimate covers nine of ten errors, and 1.19 times it 95 %. Two methods on
    different points share no grid, and the smaller estimate counts. Two
    solvers on the same points share the error of their grid. Beside a theory, the
    estimate of the grid method counts; an unknown one (NaN) never holds.
    """
    on_fem = replace(case.gates[0], against="fem")
    gates = case.changed(
        methods=("persson", "bem", "fem"), gates=(case.gates[0], on_fem)
    )
    for claim, status in (
        (0.005, "holds"),
        (0.02, "falls short"),
        (math.nan, "falls short"),
    ):
        given = of_bem(0.1, claim=claim, fem=answer("fem", 0.1, claim=0.03))
        judged = judge_case(gates, given)
        assert [gate.status for gate in judged.gates] == [status, status]
    assert "± 0.36 (of which 0.36 by the grid, hardness or treatment)" in str(
        judged.gates[1]
    )
    # Two solvers on the same points share the error of their grid.
    for claim, status in (
        (0.03, "holds"),
        (0.005, "falls short"),
        (math.nan, "falls short"),
    ):
        result = of_bem(0.1, claim=claim)["bem"].results[0]
        by_other_solver = replace(
            result, provenance=replace(result.provenance, options={"solver": "x"})
        )
        given = of_bem(0.1, claim=0.03, fem=MethodResults((by_other_solver,), ("a",)))
        assert judge_case(gates, given).gates[1].status == status


@pytest.mark.parametrize(
    "named",
    """\
    paper-elastoplastic area.plastic.raw 0.0572: published, theory
    paper-elastoplastic distribution persson: method here, theory – boundary elements
    theory-elastic quantity.mean_gap 3.954599994e-06: closed form, theory
    conductance-elastic quantity.conductance mikic: published, boundary elements
    calculix-elastic distribution calculix: other code, finite elements
    fem-model-5 quantity.model_area 0.212: method here, J2 flow – pressure cap
    path-fem quantity.elements_pressure 0.0: method here, finite elements
    path-unloaded quantity.measured_gap 0.0: identity, after the load
    j2-bem-5 field.pressure bem: method here, J2 – bem, effective hardness
    j2-bem-plain distribution bem: method here, J2 – bem, effective hardness
    j2-tabor-50 area.total.corrected bem: method here, J2 – bem, 3 σ_Y
    moved-5-10 field.pressure bem: method here, J2 – bem, effective hardness, rough top
    moved-5-10 quantity.moved_area 0.0: method here, finite elements, rough top
    moved-5-10 quantity.measured_force 0.0: identity, finite elements, rough top
    path-elastic quantity.surface_summit_y 0.025: closed form, inputs""".splitlines(),
)
def test_what_a_gate_verifies_and_on_what_it_rests(named):
    """The overview's row (what a gate verifies) and column (the kind of its reference)
    of known gates.

    `named` is a case, a quantity and a reference, then after the colon the expected
    kind and subject, in which "J2 – bem" stands for J2 elements beside boundary
    elements.
    """
    place, _, expected = named.replace("J2 – bem", J2_PAIR).strip().partition(": ")
    name, quantity, against = place.split(" ")
    case = load_case(find_case(name))
    gates = {(gate.quantity, f"{gate.against}"): gate for gate in case.gates}
    gate = gates[quantity, against]
    assert f"{kind_of(case, gate)}, {subject_of(case, gate)}" == expected
    # A user's solver in the place of the method leaves the kind of the reference.
    on_solver = replace(gate, of="mine")
    assert kind_of(case, on_solver) == expected.partition(",")[0]


def test_files_say_what_the_verdict_says(case, tmp_path):
    """verdict.json read back equals the verdict, and junit.xml holds the failure, the
    kind and the subject of its gate.

    The bem areas are 21 % too large on average, with estimated errors of 0.001, 0.002
    and 0.003, of which 0.7 is plastic area.
    """
    bem = answer("bem", 0.12, 0.121, 0.122, claim=0.001)
    case = case.changed(
        gates=(replace(case.gates[0], quantity="area.plastic.corrected"),)
    )
    provenance = Provenance("digest", versions={"numpy": "1.0"})
    older = replace(
        bem, results=tuple(replace(r, provenance=provenance) for r in bem.results)
    )
    judged = Verdict.on([judge_case(case, of_bem(bem=older))], "fast")
    write_verdict(judged, tmp_path)
    written = Verdict.read(tmp_path / "verdict.json")
    assert written.model_dump(exclude={"digest"}) == judged.model_dump(
        exclude={"digest"}
    )
    assert written.versions["numpy"] == f"1.0, {np.__version__}"
    (gate_verdict,) = written.cases[0].gates
    assert gate_verdict.difference.mean == pytest.approx(0.21)
    assert gate_verdict.value.claimed_error == pytest.approx(0.7 * 0.002)
    assert gate_verdict.grid_error == pytest.approx(1.19 * 0.7 * 0.002 / 0.05)
    scatter = gate_verdict.value.half_width
    error = math.hypot(scatter, 1.19 * 0.7 * 0.002)
    assert gate_verdict.value.error_95 == pytest.approx(error)
    assert gate_verdict.reference.error_95 == 0
    suites = ET.parse(tmp_path / "junit.xml").getroot()
    assert suites.attrib["failures"] == "1"
    properties = {}
    for element in suites.iter("property"):
        properties[element.attrib["name"]] = element.attrib["value"]
    assert properties == {
        "reference": "method here",
        "verifies": "theory – boundary elements",
    }
    assert (
        "only a smoke test"
        in suites.find("testsuite/testcase/failure").attrib["message"]
    )


def test_a_verdict_says_when_where_and_by_which_sources(written, tmp_path, monkeypatch):
    """The run information holds version, time, number of cores and system, but no host
    name; a second run judges the same.
    """
    first = Verdict.read(written / JSON)
    names = ["system", "node", "release", "version", "machine"]
    monkeypatch.setattr(
        platform, "uname", lambda: namedtuple("U", names)(*map("my-{}".format, names))
    )
    before = datetime.now(UTC).replace(microsecond=0)
    judged_cases = []
    second = verify(
        written / "small.toml", jobs=1, output=tmp_path, on_case=judged_cases.append
    )
    assert judged_cases == [*second.cases]
    run = second.made
    assert run.version == version("epcontact")
    assert before <= datetime.fromisoformat(run.date) <= datetime.now(UTC)
    assert (run.cores, run.system) == (available_cores(), "my-system my-machine")
    assert (
        "my-node"
        not in (tmp_path / JSON).read_text() + (tmp_path / "junit.xml").read_text()
    )
    assert [case.gates for case in second.cases] == [case.gates for case in first.cases]


def git(folder, *words):
    """Run git in a folder and return its stripped output; raises CalledProcessError if
    git fails.
    """
    about = ("-c", "user.name=x", "-c", "user.email=x", "-c", "commit.gpgsign=false")
    done = subprocess.run(
        ("git", *about, *words), cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_the_commit_is_that_of_the_package_and_of_no_repository_around_it(
    tmp_path, monkeypatch
):
    """`commit_of` returns (commit, whether sources are changed) of a checkout, and
    (None, None) for an installed package inside of another repository.
    """
    inner = tmp_path / "site-packages"
    for home in (tmp_path, inner):
        (home / "epcontact").mkdir(parents=True)
        (home / "epcontact" / "__init__.py").write_text("")
    git(tmp_path, "init")
    assert commit_of(tmp_path) == (None, None)  # nothing is tracked yet
    git(tmp_path, "add", "epcontact")
    git(tmp_path, "commit", "-m", "x")
    commit = git(tmp_path, "rev-parse", "HEAD")
    (tmp_path / "results").write_text("nothing that is judged")
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "elsewhere"))  # as a hook has it
    assert commit_of(tmp_path) == (commit, False)
    assert commit_of(inner) == (None, None)
    for room in ("epcontact", "fem_check", "cases"):
        (new := tmp_path / room / "new.py").parent.mkdir(exist_ok=True)
        new.write_text("")
        assert commit_of(tmp_path) == (commit, True)
        new.unlink()
    monkeypatch.setenv("PATH", str(tmp_path))  # without git
    assert commit_of(tmp_path) == (None, None)


def test_seconds_are_those_of_the_solves(written):
    """The verdict has the seconds of each surface's solve, and junit.xml books those of
    a method on the first gate that reads the method.
    """
    (judged,) = json.loads((written / JSON).read_text())["cases"]
    spent = {}
    for name, method in judged["methods"].items():
        members = json.loads((written / f"small/fast/{name}.json").read_text())[
            "members"
        ]
        seconds = [member["cost"]["seconds"] for member in members]
        assert [*method["seconds"].values()] == seconds
        assert [*method["seconds"]] == [
            f"seed{m['provenance']['seed']}" for m in members
        ]
        spent[name] = sum(seconds)
    suite = ET.parse(written / "junit.xml").getroot().find("testsuite")
    assert datetime.fromisoformat(suite.attrib["timestamp"]).tzinfo == UTC
    times = [float(test.attrib["time"]) for test in suite.iter("testcase")]
    assert sum(times) == pytest.approx(sum(spent.values()), abs=2e-3 * len(times))
    assert times[0] == pytest.approx(spent["bem"] + spent["persson"], abs=2e-3)


def test_the_answer_of_a_method_sums_up_its_members(write_case, tmp_path):
    """bem.json holds the mean, the standard deviation and the 95 % half-width of three
    surfaces' areas, and their largest residual.

    Student's factor for three surfaces is 4.302653.
    """
    loaded = load_case(write_case())
    run_cases([loaded.changed(methods=("bem",))], Run(output=tmp_path, jobs=1))
    answer = json.loads((tmp_path / "small" / "fast" / "bem.json").read_text())
    members = answer["members"]
    labels = [f"seed{member['provenance']['seed']}" for member in members]
    assert answer["ensemble"]["surfaces"] == labels == ["seed3", "seed5", "seed7"]
    for kind, areas in answer["areas"].items():
        assert areas["total"] == pytest.approx(
            fmean(m["areas"][kind]["total"] for m in members)
        )
        spread = answer["ensemble"]["areas"][kind]["plastic"]
        parts = [member["areas"][kind]["plastic"] for member in members]
        expected = (
            fmean(parts),
            np.std(parts, ddof=1),
            4.302653 / 3**0.5 * np.std(parts, ddof=1),
        )
        assert [*spread.values()] == pytest.approx(expected, rel=1e-6)
    residuals = [member["residuals"]["gap_elastic"] for member in members]
    assert answer["residuals"]["gap_elastic"] == max(residuals) > min(residuals)


def test_fields_of_two_methods_are_compared_point_by_point(write_case, tmp_path):
    """A gate with the norm l2 reads the pressures of both methods, here of boundary
    elements and of capped finite elements, also when a later run reuses the results.

    The results have no field that no gate compares.
    """
    methods = ('methods = ["persson", "bem"]', 'methods = ["fem", "bem"]')
    path = write_case(
        methods,
        ('of = "bem"\nagainst = "persson"', 'of = "fem"\nagainst = "bem"\nnorm = "l2"'),
        ('quantity = "area.total.corrected"', 'quantity = "field.pressure"'),
        more='\n[fem]\nlaw = "capped"\n',
    )
    loaded = load_case(path)
    scenes = [loaded.scene(recipe) for recipe in loaded.recipes]
    distances = []
    for scene in scenes:
        found = fem_check.solve(scene, law="capped").fields["pressure"]
        exact = bem.solve(scene).fields["pressure"]
        distances.append(np.linalg.norm(found - exact) / np.linalg.norm(exact))
    for reused in (0, len(scenes)):
        results = run_cases([loaded], Run(output=tmp_path, jobs=1))["small"]
        assert results["fem"].reused == reused
        assert {*results["fem"].results[0].fields} == {"pressure"}
        judged = judge_case(loaded, results).gates[0]
        assert judged.difference == estimate(distances)
        assert judged.kind == "method here"


def test_a_run_that_ends_in_an_error_leaves_no_verdict(tmp_path, monkeypatch):
    """A run that fails leaves neither its own verdict nor that of an earlier run, which
    a reader would take for its own.  An error after all is judged keeps the verdict.
    """
    names = ["junit.xml", "verdict.json"]

    def verdict_files():
        """Return the names of the files in the output folder."""
        return sorted(path.name for path in tmp_path.iterdir() if path.is_file())

    def full(_):
        """Raise the error of a full disk."""
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    assert verify("bearing-area", output=tmp_path, jobs=1).passed
    assert verdict_files() == names
    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match="no space left on device"):
            verify("bearing-area", output=tmp_path, jobs=1)
    assert verdict_files() == []
    with pytest.raises(ZeroDivisionError):  # in what is drawn of a verdict that passed
        verify("bearing-area", output=tmp_path, jobs=1, finish=lambda verdict: 1 / 0)
    assert verdict_files() == names
    assert verify("bearing-area", output=tmp_path, jobs=1).passed
    assert verdict_files() == names


MORE_GATES = """
[[gate]]
quantity = "area.plastic.raw"
of = "bem"
against = 0.05
norm = "absolute"
tolerance = 1e-9
source = "made up"
because = "it shall fall short"

[[gate]]
quantity = "quantity.mean_gap"
of = "persson"
against = "bem"
tolerance = 9.0
because = "only a smoke test"
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the output folder of one verified case with three surfaces, whose gates
    hold and fall short.

    `spectrum = "surface"` pairs the theory's results with the surfaces.
    """
    folder = tmp_path_factory.mktemp("written")
    gamma = "energy_reduction = 0.536"
    text = conftest.SMALL_CASE.replace(gamma, f'{gamma}\nspectrum = "surface"')
    (folder / "small.toml").write_text(text + MORE_GATES)
    verify(folder / "small.toml", jobs=1, output=folder)
    return folder


JSON, BEM = "verdict.json", "small/fast/bem.json"


@pytest.mark.parametrize("file", [JSON, BEM])
def test_a_file_that_was_edited_is_refused(written, tmp_path, file):
    """Every command that reads a verdict refuses the folder after `file`, the verdict
    or a result, was edited.
    """
    folder = Path(shutil.copytree(written, tmp_path / "out"))
    Verdict.read(folder / JSON)
    content = json.loads((folder / file).read_text())
    if file == BEM:
        content["mean_pressure"] = "holds"
    else:
        content["cases"][0]["gates"][1]["status"] = "holds"
    (folder / file).write_text(json.dumps(content))
    for command in (
        ("report", folder),
        ("compare", folder),
        ("gates", "--output", folder),
    ):
        assert "was changed, moved or" in invoke(*command).stderr


def test_a_damaged_file_is_one_sentence(written, tmp_path):
    """A verdict or a result that is empty, cut off, of another type or changed ends in
    one line of error.
    """
    folder = Path(shutil.copytree(written, tmp_path / "out"))
    for path in (folder / JSON, folder / BEM):
        intact = path.read_bytes()
        for content in (
            b"",
            b"{",
            b"[1]",
            b"3",
            b"null",
            b'{"digest": 1}',
            b"\xff",
            9999 * b"[",
            intact[:-9],
            intact.replace(b'"case', b'"cace'),
            intact.replace(b"0.1", b"0.2", 1),
        ):
            assert content != intact
            path.write_bytes(content)
            done = invoke("report", folder)
            assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
            assert "was changed, moved or" in done.stderr
        path.write_bytes(intact)
    assert invoke("report", folder).returncode == 0
