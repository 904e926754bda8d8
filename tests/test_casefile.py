"""Case files: what is read is what was written, by size, by variant and with its
default gates.
"""

import math
import re
from dataclasses import replace

import pytest
from command_line import invoke
from conftest import ROUGH, VARIANTS

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import (
    find_case,
    find_cases,
    find_named,
    load_case,
)
from epcontact.harness.case_files.citations import PAPERS, papers_of, sources_of
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.verification import require_gate


def test_case_becomes_scenes(write_case):
    """A case file gives recipes, options and digests of its size, also with Windows'
    line ends.

    Changing unknown attributes of a case raises AttributeError.
    """
    path = write_case()
    # As an editor of Windows writes it.
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    case = load_case(path, "full")
    assert [recipe.seed for recipe in case.recipes] == [3, 5, 7]
    assert case.recipes[0].shape == (64, 64)
    assert case.material.hardness == 6.0e9
    assert case.options == {
        "persson": {
            "energy_reduction": 0.536,
            "reduction": "constant",
            "spectrum": "analytic",
        },
        "bem": {"tolerance": 1e-8},
    }
    # The digest is known before the surface is made.
    assert all(
        case.digest(recipe) == case.scene(recipe).digest for recipe in case.recipes
    )
    assert len({case.digest(recipe) for recipe in case.recipes}) == 3
    assert load_case(write_case(("hardness = 6.0e9", ""))).material.hardness == math.inf
    other = case.changed(methods=("bem",), id="other")
    assert other.methods == ("bem",)
    assert other.id == "other"
    assert other.gates == case.gates
    with pytest.raises(AttributeError):
        case.changed(method="bem")


def bands(case):
    """Return the upper end of the band of each gate, by (method, quantity)."""
    return {(gate.of, gate.quantity): gate.high for gate in case.gates}


def test_a_case_has_the_default_gates_of_its_methods(write_case):
    """A case gets the default gate of each `measured_` quantity that its methods
    report.

    A gate of the case on the same quantity replaces the default one. The largest cases
    judge only their own gates.
    """
    unread = ("raw_total", "raw_plastic", "carried", "distribution", "residuals")
    names = {("bem", q) for q in QUANTITIES if q.startswith("quantity.measured_")}
    names -= {("bem", f"quantity.measured_{name}") for name in unread}
    own = ("bem", "area.total.corrected")
    gap = ("bem", "quantity.measured_gap")
    before = bands(load_case(write_case()))
    assert before[gap] == 1e-7
    assert set(before) == names | {own}
    # A gate of the case on the same quantity replaces one.
    number = (
        '"persson"\ntolerance',
        '0.0\nsource = "a test"\nnorm = "absolute"\ntolerance',
    )
    case = load_case(write_case((own[1], gap[1]), number))
    assert bands(case) == {key: band for key, band in before.items() if key != own} | {
        gap: 0.5
    }
    assert len(load_case("paper-8192-32-elastic", "large").gates) == 1  # its own alone


def test_variants_are_laid_over_the_rest_of_the_file(write_case):
    """A variant's keys replace those of the file, and its gates come before
    the file's.
    """
    soft, stiff = (load_case(text) for text in find_named(write_case(more=VARIANTS)))
    assert soft.id == "soft"
    assert stiff.id == "stiff"
    assert stiff.head.requirement == "A stiff one."
    assert soft.material.young_modulus == 50e9
    assert stiff.material.young_modulus == 100e9
    assert soft.material.hardness == stiff.material.hardness == 6e9
    assert [gate.high for gate in stiff.gates[:2]] == [0.1, 2]
    assert soft.gates[0].high == 0.5
    assert stiff.gates[0].because == "It is stiff."
    with pytest.raises(
        InvalidCase, match="holds 2 cases; name one of them: soft, stiff"
    ):
        load_case(write_case(more=VARIANTS))


def test_cases_are_found_by_name_file_and_path(write_case, tmp_path, monkeypatch):
    """A case is found by its id, the name of its file or the path, near the user or
    shipped.
    """
    assert find_case("fem-model-50-nu0").path.name == "fem-model.toml"
    assert len(find_named("fem-model")) == 9
    with pytest.raises(InvalidCase, match="did you mean 'fem-model-50-nu0'"):
        find_case("fem-modl-50-nu0")
    # A folder of own cases does not hide those of the package, nor one of results a
    # case.
    for folder in ("cases", "paper-elastic", "other"):
        (tmp_path / folder).mkdir()
    write_case().rename(tmp_path / "cases" / "mine.toml")
    (tmp_path / "cases" / "broken.toml").write_text("[")
    monkeypatch.chdir(tmp_path)
    assert [case.path.name for case in find_named("mine")] == ["mine.toml"]
    assert find_named("paper-elastic")[0].path.is_absolute()
    with pytest.raises(InvalidCase, match="no such case file"):
        find_named("other")


def test_every_shipped_case_reads_at_every_size_and_cites_papers():
    """Shipped cases have gates with reasons, cite papers, and every paper is cited."""
    cases = [load_case(text, size) for text in find_cases() for size in text.sizes]
    assert len({(case.id, case.size) for case in cases}) == len(cases)
    assert all(case.gates or case.sweep for case in cases)
    assert all(len(gate.because) > 10 for case in cases for gate in case.gates)
    assert all(papers_of(case) for case in cases)
    assert {paper for case in cases for paper in papers_of(case)} == set(PAPERS)
    identifiers = [paper.doi for paper in PAPERS if paper.doi]
    assert all(re.fullmatch(r"10\.\d{4,9}/\S+", doi) for doi in identifiers)
    own = {name for name, method in METHODS.items() if not method.foreign}
    assert {name for paper in PAPERS for name in paper.methods} == own


COUNTERFACE = "\n[counterface]\nyoung_modulus = 70.0e9\npoisson_ratio = 0.2\n"


def test_a_counterface_makes_one_scene_of_two_bodies(write_case):
    """Compliances of two unlike bodies add, Poisson's ratio is that of the first, and
    two rough ones have sqrt(2) times the rms slope.

    Grids that differ, layers and unknown keys of a counterface raise `InvalidCase`.
    """
    alone, twin = (load_case(write_case(more=m)) for m in ("", COUNTERFACE))
    modulus = 1 / ((1 - 0.3**2) / 100e9 + (1 - 0.2**2) / 70e9)
    assert twin.material.young_modulus == pytest.approx((1 - 0.3**2) * modulus)
    assert replace(twin.material, young_modulus=100e9) == alone.material
    assert twin.two_bodies["young_modulus"]["value"] == 100e9
    words = twin.two_bodies["counterface"]["value"]
    assert words.startswith("flat elastic half-space, E = 7e+10 Pa, nu = 0.2; the hard")
    assert twin.recipes == alone.recipes
    rough = (
        COUNTERFACE
        + "[counterface.surface]\n"
        + ROUGH.replace("seeds = [3", "seeds = [13")
    )
    spectrum = (
        "energy_reduction = 0.536",
        'energy_reduction = 0.536\nspectrum = "surface"',
    )
    both = load_case(write_case(spectrum, more=rough))
    surface = both.scene(both.recipes[0]).surface
    each = (
        recipe.build().rms_slope
        for recipe in (both.recipes[0].first, both.recipes[0].second)
    )
    assert surface.rms_slope == pytest.approx(math.hypot(*each), rel=0.1)
    assert both.digest(both.recipes[0]) == both.scene(both.recipes[0]).digest
    assert [both.recipes[0].first.seed, both.recipes[0].second.seed] == [3, 13]
    assert (
        "rough elastic half-space, E = 7e+10 Pa"
        in both.two_bodies["counterface"]["value"]
    )
    coarse = rough.replace("period = 1", "period = 2")
    for edits, more, words in (
        ((), rough, "drawn from none; write spectrum = 'surface'"),
        ((spectrum,), coarse, "face each other on one grid"),
        (
            (),
            COUNTERFACE + '\n[body]\nkind = "bonded_layer"\ndepth = 1e-3\n',
            "is a half-space",
        ),
        (
            (),
            COUNTERFACE.replace("young", "yuong"),
            "counterface.yuong_modulus is no key",
        ),
    ):
        with pytest.raises(InvalidCase, match=words):
            load_case(write_case(*edits, more=more))


def test_a_citation_holds_sources_papers_and_versions(write_case):
    """`cite` prints sources, papers of the options in use, and the versions of
    libraries.
    """
    plain = load_case(write_case())
    other = load_case(write_case(("[theory]", '[theory]\nreduction = "wang_muser"')))
    (more,) = set(papers_of(other)) - set(papers_of(plain))  # of the option
    assert str(more).endswith("https://doi.org/10.1007/s11249-017-0886-9")
    done = invoke("cite", "westergaard-light")
    case = load_case("westergaard-light")
    assert all(
        f"  {text}\n" in done.stdout for text in (*sources_of(case), *papers_of(case))
    )
    assert re.search(r"  numpy \d+\.\d+.* https://doi.org/10\.", done.stdout)


@pytest.mark.parametrize(
    ("band", "message"),
    [
        ("between = [-inf, 0.5]", ""),
        ("between = [-0.5, inf]", ""),
        ("between = [-inf, inf]", "give it a finite end"),
    ],
)
def test_a_band_may_be_open_at_one_end(write_case, band, message):
    """One end of a band may be infinite, and the gate has it; both may not."""
    path = write_case(("tolerance = 0.5", band))
    if message:
        with pytest.raises(InvalidCase, match=message):
            load_case(path)
        return
    gate = load_case(path).gates[0]
    ends = [float(word) for word in band.partition("[")[2].rstrip("]").split(",")]
    assert [gate.low, gate.high] == ends


def test_a_case_without_a_gate_is_refused_unless_it_is_skipped(write_case):
    """A case that cannot run here needs no gate, another one does."""
    case = load_case(write_case())
    require_gate(case)
    bare = case.changed(gates=())
    with pytest.raises(InvalidCase, match="small has no gate to judge; add a table"):
        require_gate(bare)
    require_gate(bare.changed(skip="skipped: there is no program ccx"))
