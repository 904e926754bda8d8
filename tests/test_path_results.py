"""What a path of loads keeps: each load its own values, limits, errors and costs.

The results are invented, so that no two surfaces, loads or parts of an area are alike:
an exchanged or repeated one gives another number.  The expected numbers are computed
here from the definitions in the documentation.
"""

import hashlib
from dataclasses import replace
from math import hypot
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import SMALL_CASE

from epcontact.alternatives import FACTOR, with_measurement_errors
from epcontact.harness.case_files.case import load_case
from epcontact.harness.methods.load_by_load import solve_load_by_load
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.solving import load_path, saved
from epcontact.harness.solving.load_path import solve_path, with_hardness_error
from epcontact.harness.solving.measure import measure_end
from epcontact.harness.solving.method_results import MethodResults, load_rows, summary
from epcontact.harness.solving.saved import DoneLoads
from epcontact.harness.solving.tasks import Run, tasks_of
from epcontact.materials.hardness_map import MappedHardness
from epcontact.results import Areas, ContactResult, LoadStep, Provenance
from epcontact.scene import Alternative, Load, Material, Scene, Surface

#: Student's t of two surfaces at 95 %; the mean of two values a and b has a half-width
#: of t |a - b| / 2.
STUDENT = 12.706204736
LOADS = (1e8, 4e8, 2e8)
BRANCHES = ["loading", "loading", "unloading"]


def step_of(number, load, scale):
    """Return an invented load step; `number` is its index, and `scale` belongs to the
    surface.
    """
    total = scale * (0.1 + 0.03 * number)
    return LoadStep(
        load,
        {
            "raw": Areas(1.2 * total, 0.9 * total, 0.3 * total),
            "corrected": Areas(total, 0.7 * total, 0.3 * total),
            "error": Areas(0.01 * scale, 0.004 * scale, 0.007 * scale),
        },
        {"gap_elastic": 1e-9 * scale * (number + 1)},
        {"fft_pairs": 10 * scale},
        {"mean_gap": 1e-7 * scale / (number + 1), "mean_gap_error_by_grid": 1e-9},
    )


def result_of(scale, loads=LOADS):
    """Return an invented result of boundary elements on the surface of this scale."""
    steps = tuple(step_of(number, load, scale) for number, load in enumerate(loads))
    cost = {"seconds": 2.0 * scale, "peak_memory_bytes": 1e9 * scale, "fft_pairs": 7.0}
    return ContactResult("bem", steps, Provenance("digest"), cost=cost)


def test_a_row_of_each_load_has_means_and_errors_of_the_surfaces():
    """Means are those of both surfaces at this load; errors of the grid are means times
    1.19, that of the scatter follows from both values, and the error is their root sum
    of squares.
    """
    rows = load_rows([result_of(1.0), result_of(1.1)])
    assert [row["branch"] for row in rows] == BRANCHES
    for number, (row, load) in enumerate(zip(rows, LOADS, strict=True)):
        assert row["mean_pressure"]["mean"] == load
        total = 0.1 + 0.03 * number
        for name, part, error in (
            ("total_area", 1.0, 0.01),
            ("elastic_area", 0.7, 0.004),
            ("plastic_area", 0.3, 0.007),
        ):
            grid = 1.19 * 1.05 * error
            scatter = STUDENT * 0.1 * part * total / 2
            assert row[name]["mean"] == pytest.approx(1.05 * part * total)
            assert row[name]["parts"] == pytest.approx(
                {"grid": grid, "scatter": scatter}
            )
            assert row[name]["error"] == pytest.approx(hypot(grid, scatter))
        assert row["mean_gap"]["mean"] == pytest.approx(1.05e-7 / (number + 1))
        assert row["mean_gap"]["parts"]["grid"] == pytest.approx(1.19e-9)


def test_a_summary_has_the_worst_residual_the_joint_cost_and_the_last_load(tmp_path):
    """The summary of two surfaces has the largest residual, the sum of the times, the
    largest memory, and means, deviations and intervals of the areas at the last load.
    """
    (tmp_path / "small.toml").write_text(SMALL_CASE)
    case = load_case(tmp_path / "small.toml")
    results = (result_of(1.0), result_of(1.1))
    content = summary(case, MethodResults(results, ("seed3", "seed5")))
    assert content["residuals"] == pytest.approx({"gap_elastic": 3.3e-9})
    assert content["cost"] == pytest.approx(
        {"seconds": 4.2, "peak_memory_bytes": 1.1e9, "fft_pairs": 14.0}
    )
    assert content["mean_pressure"] == 2e8
    plastic = 0.3 * 0.16
    assert content["areas"]["corrected"]["plastic"] == pytest.approx(1.05 * plastic)
    assert content["ensemble"]["areas"]["corrected"]["plastic"] == pytest.approx(
        {
            "mean": 1.05 * plastic,
            "standard_deviation": 0.1 * plastic / 2**0.5,
            "half_width_95": STUDENT * 0.1 * plastic / 2,
        }
    )
    assert content["ensemble"]["surfaces"] == ["seed3", "seed5"]


@pytest.mark.parametrize(("change", "equal"), [(1e-7, True), (1e-5, False)])
def test_surfaces_count_as_equal_if_all_quantities_agree(change, equal):
    """Two results are those of one surface if no quantity differs by more than 1e-6."""
    results = []
    for factor in (1.0, 1.0 + change):
        result = result_of(1.0)
        quantities = {"largest_pressure": 2e9, "mean_gap": 1e-7 * factor}
        results.append(
            replace(result, steps=(replace(result.final, quantities=quantities),))
        )
    found = MethodResults(tuple(results), ("seed3", "seed5")).equal_surfaces
    assert found == (("seed3", "seed5") if equal else None)


def test_the_error_of_a_hardness_is_half_the_difference_of_its_ends():
    """Each area and quantity has half the difference between the solutions with both
    ends of the interval of the hardness, and the hardness its own error in Pa.
    """
    hardness = MappedHardness(
        5e9, (4e9, 7e9), 2.5, 3.0, 0.3, 0.1, 0.2, {"a": 0.03, "b": 0.04}
    )
    step = step_of(1, 4e8, 1.0)
    found = with_hardness_error(
        step, step_of(1, 4e8, 1.3), step_of(1, 4e8, 0.8), hardness
    )
    areas = vars(found.areas["hardness_error"])
    assert areas == pytest.approx(
        {
            "total": 0.5 * 0.13 / 2,
            "elastic": 0.35 * 0.13 / 2,
            "plastic": 0.15 * 0.13 / 2,
        }
    )
    assert found.quantities["hardness_error_by_map"] == pytest.approx(0.05 * 5e9)
    assert found.quantities["mean_gap_error_by_hardness"] == pytest.approx(
        0.5 * 5e-8 / 2
    )
    assert found.areas["corrected"] == step.areas["corrected"]


def test_each_load_is_solved_with_its_own_hardness_and_interval(tmp_path):
    """A method that records its scenes is given each load once with the hardness of the
    map for the largest load so far, and once with each end of its interval.

    The result has the steps in the order of the path, the sum of all costs, and errors
    that follow from the ends.
    """
    text = SMALL_CASE
    for old, new in (
        ('["persson", "bem"]', '["bem"]'),
        ('against = "persson"', 'against = 0.1\nsource = "none"'),
        ("hardness = 6.0e9", 'hardness = "effective"\nyield_stress = 2.0e9'),
        ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8, 1.0e8, 6.0e8]"),
    ):
        text = text.replace(old, new)
    (tmp_path / "small.toml").write_text(text)
    case = load_case(tmp_path / "small.toml")

    def solve(scene, options, threads, on_load=None):
        """Return areas that are the loads over the hardness, and a cost of one second
        for each load.
        """
        hardness = scene.material.hardness
        steps = []
        for load in scene.load.path:
            areas = Areas(
                load / hardness, 0.75 * load / hardness, 0.25 * load / hardness
            )
            gap = {"mean_gap": 1e3 / hardness}
            steps.append(LoadStep(load, {"raw": areas}, quantities=gap))
        cost = {"seconds": float(len(steps))}
        return ContactResult("bem", tuple(steps), Provenance(scene.digest), cost=cost)

    task = next(task for task in tasks_of(case, Run()) if task.method.name == "bem")
    method = replace(METHODS["bem"], solve=solve)
    scene = case.scene(task.recipe)
    result = solve_path(replace(task, method=method), scene, 1)
    path = (2e8, 5e8, 1e8, 6e8)
    hardnesses = [
        case.cap_at(case.surface.rms_slope, peak) for peak in (2e8, 5e8, 5e8, 6e8)
    ]
    assert len({mapped.value for mapped in hardnesses}) == 3
    assert [step.mean_pressure for step in result.steps] == [*path]
    for step, load, mapped in zip(result.steps, path, hardnesses, strict=True):
        assert step.quantities["hardness"] == pytest.approx(mapped.value)
        assert step.areas["raw"].total == pytest.approx(load / mapped.value)
        low, high = mapped.interval
        half = (1 / low - 1 / high) / 2
        errors = vars(step.areas["hardness_error"])
        assert errors == pytest.approx(
            {"total": load * half, "elastic": 0.75 * load * half}
            | {"plastic": 0.25 * load * half}
        )
        gap_error = step.quantities["mean_gap_error_by_hardness"]
        assert gap_error == pytest.approx(1e3 * half)
        error = mapped.value * mapped.error
        assert step.quantities["hardness_error_by_map"] == pytest.approx(error)
    assert result.cost["seconds"] == 4.0
    assert result.provenance.scene == scene.digest


def test_surfaces_and_sizes_have_keys_of_their_own(tmp_path):
    """Each surface of a case has another key, and so has each surface at another size;
    a result without a quantity that is asked for later is not taken.
    """
    (tmp_path / "small.toml").write_text(SMALL_CASE)
    keys = []
    for size in ("fast", "full"):
        case = load_case(tmp_path / "small.toml", size)
        tasks = [task for task in tasks_of(case, Run()) if task.method.name == "bem"]
        keys += [saved.key_of(task) for task in tasks]
    assert len(set(keys)) == 6
    task = replace(tasks[0], extra_quantities=("quantity.conductance",))
    saved.save_result(tasks[0], tmp_path, result_of(1.0, (5e8,)))
    assert saved.load_saved(tasks[0], tmp_path) is not None
    assert saved.load_saved(task, tmp_path) is None


def test_the_end_of_a_path_keeps_all_loads_and_the_worst_check(tmp_path):
    """A check of the parts of a result has its largest value over all loads at the end;
    the earlier loads stay as they are.
    """
    checks = (1e-9, 3e-8, 2e-9)
    steps = []
    for step, check in zip(result_of(1.0).steps, checks, strict=True):
        quantities = {**step.quantities, "measured_areas": check}
        steps.append(replace(step, quantities=quantities))
    result = replace(result_of(1.0), steps=tuple(steps))
    (tmp_path / "small.toml").write_text(SMALL_CASE)
    case = load_case(tmp_path / "small.toml")
    task = SimpleNamespace(measured=("quantity.measured_areas",), extra_quantities=())
    found = measure_end(task, case.scene(case.recipes[0]), result)
    values = [step.quantities["measured_areas"] for step in found.steps]
    assert values == [1e-9, 3e-8, 3e-8]
    assert [step.mean_pressure for step in found.steps] == [*LOADS]


def test_an_error_that_one_surface_lacks_counts_in_any_order():
    """An error of 0 on one surface and .01 on another is .005 for their mean, whichever
    surface comes first; it is multiplied by 1.19 from 90 % to 95 %.
    """

    def result(plastic, error):
        """Return a result with a plastic area and its error, as fractions."""
        areas = {"raw": Areas(0.2, 0.2 - plastic, plastic)}
        areas["error"] = Areas(0.0, 0.0, error)
        steps = (LoadStep(1e6, areas),)
        return ContactResult("bem", steps, Provenance("digest"))

    results = [result(0.0, 0.0), result(0.02, 0.01)]
    for ordered in (results, results[::-1]):
        (row,) = load_rows(ordered)
        assert row["plastic_area"]["parts"]["grid"] == pytest.approx(0.00595, rel=2e-3)


# --- paths that fall, parts of a path, and loads that are done


def branches_of(*loads):
    """Return the branches of an invented result with these loads."""
    return result_of(1.0, loads).branches


def test_a_load_that_stays_after_a_fall_is_on_the_unloading_branch():
    """A repeated load belongs to the branch that led to it."""
    assert branches_of(1.0, 1.0, 3.0, 2.0, 2.0, 2.5, 3.0) == (
        *["loading"] * 3,
        *["unloading"] * 2,
        "reloading",
        "loading",
    )


def test_the_lowest_hardness_carries_the_largest_load_so_far(monkeypatch):
    """Where a load falls, the lower end of a hardness is not below the peak before."""
    solved = []

    def solve(task, scene, hardnesses, threads, **_):
        """Record the hardness of each load, and return an invented result."""
        solved.append(list(hardnesses))
        return result_of(1.0)

    monkeypatch.setattr(load_path, "_solve_with_hardnesses", solve)
    monkeypatch.setattr(load_path, "_without_files", lambda task: task)
    monkeypatch.setattr(load_path, "with_hardness_error", lambda step, *_: step)
    mapped = [SimpleNamespace(interval=(3e8, 9e8 + load)) for load in LOADS]
    scene = SimpleNamespace(load=Load(LOADS))
    load_path._with_hardness_errors(None, scene, mapped, 1, result_of(1.0).steps)
    lowest, highest = solved
    assert lowest == pytest.approx([3e8, 4.004e8, 4.004e8])
    assert highest == pytest.approx([1e9, 1.3e9, 1.1e9])


def test_loads_that_are_done_are_taken_for_their_own_part_of_the_path(monkeypatch):
    """Of a path with a hardness for each load, the two loads that an earlier run has
    solved are kept in order, and only the third is solved.
    """
    solved = []

    def solve_part(task, scene, threads, before, **_):
        """Record the loads that are solved after which, and return their result."""
        solved.append((scene.load.path, [step.mean_pressure for step in before.steps]))
        return result_of(1.0, scene.load.path)

    monkeypatch.setattr(load_path, "_solve_part", solve_part)
    heights = np.linspace(0.0, 1e-6, 16).reshape(4, 4)
    scene = Scene(Surface(heights, (1.0, 1.0)), Material(1e11, 0.3), Load(LOADS))
    task = SimpleNamespace(method=METHODS["bem"])
    done = DoneLoads(result_of(1.0, LOADS[:2]), None)
    result = load_path._solve_with_hardnesses(
        task, scene, [1e9, 2e9, 3e9], 1, done=done
    )
    assert solved == [((LOADS[2],), list(LOADS[:2]))]
    assert [step.mean_pressure for step in result.steps] == list(LOADS)
    assert result.cost == {
        "seconds": 4.0,
        "peak_memory_bytes": 1e9,
        "fft_pairs": 14.0,
    }


@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_a_solver_of_one_load_gets_the_path_to_it_and_what_has_flowed(law):
    """Each load is solved with the path up to it and the flow before it, which of a J2
    body is unknown; costs add, but the most memory and unknowns count.
    """
    received = []

    def solve_last(scene, flow):
        """Record a path and the flow, and return an invented result at its end."""
        received.append((scene.load.path, flow))
        number = len(scene.load.path)
        return replace(
            result_of(1.0, scene.load.path[-1:]),
            provenance=Provenance("digest", options={"law": law}),
            fields={"plastic_displacement": np.full(2, float(number))},
            cost={"seconds": number, "unknowns": 5 - number, "peak_memory_bytes": 7},
        )

    heights = np.linspace(0.0, 1e-6, 16).reshape(4, 4)
    scene = Scene(Surface(heights, (1.0, 1.0)), Material(1e11, 0.3), Load(LOADS))
    result = solve_load_by_load(solve_last, scene)
    assert [path for path, _ in received] == [LOADS[:1], LOADS[:2], LOADS]
    flows = [flow if flow is None else flow[0] for _, flow in received]
    assert flows == ([None] * 3 if law == "j2" else [None, 1.0, 2.0])
    assert result.cost == {"seconds": 6, "unknowns": 4, "peak_memory_bytes": 7}
    assert [step.mean_pressure for step in result.steps] == list(LOADS)


def test_errors_of_a_measurement_are_those_of_each_load():
    """The error of a gap at a load is 2 times the largest difference there."""
    base = result_of(1.0).steps
    heights = np.linspace(0.0, 1e-6, 16).reshape(4, 4)
    changes = [np.full(heights.shape, value) for value in (1e-9, -2e-9)]
    alternatives = tuple(Alternative("form", ..., (change,)) for change in changes)
    surface = Surface(heights, (1.0, 1.0), alternatives=alternatives)
    scene = Scene(surface, Material(1e11, 0.3), Load(LOADS))

    def solve(changed):
        """Return steps whose gaps differ by 1, 2 and 3 times the change."""
        change = float(changed.surface.heights[0, 0])
        steps = []
        for number, step in enumerate(base):
            gap = step.quantities["mean_gap"] + (number + 1) * change
            steps.append(replace(step, quantities={**step.quantities, "mean_gap": gap}))
        return steps

    found = with_measurement_errors(scene, base, solve)
    errors = [step.quantities["mean_gap_error_by_form"] for step in found]
    assert errors == pytest.approx([FACTOR * k * 2e-9 for k in (1, 2, 3)])


@pytest.mark.parametrize(
    ("method", "law", "expected"),
    [("fem", "j2", 2.7e8), ("calculix", None, 2.7e8), ("fem", "capped", 5e8)],
)
def test_a_cap_stands_for_j2_flow_in_errors_of_a_measurement(
    monkeypatch, method, law, expected
):
    """Differences of J2 bodies are those of a cap at 2.7 yield stresses, or above the
    largest load; those of other bodies have their own hardness.
    """
    found = []

    def with_errors(task, scene, hardnesses, threads, steps):
        """Record the hardness of each load."""
        found.append(list(hardnesses))
        return steps

    def solved(*_, **__):
        """Return an invented result."""
        return result_of(1.0)

    monkeypatch.setattr(load_path, "load_done", lambda task: None)
    monkeypatch.setattr(load_path, "_solve_with_hardnesses", solved)
    monkeypatch.setattr(load_path, "_with_measurement_errors", with_errors)
    options = {} if law is None else {"law": law}
    case = SimpleNamespace(options={method: options}, mapped=(), conductances={})
    task = SimpleNamespace(
        steps_folder=None, case=case, method=SimpleNamespace(name=method)
    )
    change = Alternative("form", ..., (np.ones(4),))
    surface = Surface(np.arange(4.0), (4.0,), alternatives=(change,))
    material = Material(1e11, 0.3, hardness=5e8, yield_stress=1e8)
    for loads, cap in (((1e8, 2e8), expected), ((1e8, 4e8), max(expected, 4.004e8))):
        solve_path(task, Scene(surface, material, Load(loads)), 1)
        assert found.pop() == pytest.approx([cap, cap])


def task_of_loads(folder, **changes):
    """Return a stand-in for a task that saves its loads in a folder."""
    values = {
        "loads_file": folder / "case" / "fast" / "bem.loads.npz",
        "case": SimpleNamespace(load=Load(LOADS)),
        "measured": (),
        "lists_loads": True,
        "peak_file": None,
        "steps_folder": None,
        "fields_file": None,
        "precision": "double",
    }
    return SimpleNamespace(**(values | changes))


def test_the_flow_is_saved_if_the_next_load_falls(tmp_path, monkeypatch):
    """The next load of a path that falls starts from the flow, one that grows does
    not; loads that were saved without what a task lists are not used.
    """
    monkeypatch.setattr(saved, "key_of", lambda task: "key")
    (tmp_path / "case").mkdir()
    flow = {"plastic_displacement": np.arange(4.0)}
    task = task_of_loads(tmp_path)
    for count, is_saved in ((1, False), (2, True)):
        result = replace(result_of(1.0, LOADS[:count]), fields=flow)
        saved.save_loads(task, result)
        done = saved.load_done(task)
        assert (done.flow is not None) == is_saved
        assert len(done.result.steps) == count
    for change in (
        {"lists_loads": False},
        {"precision": "single"},
        {"measured": ("quantity.mean_gap",)},
        {"steps_folder": tmp_path},
        {"peak_file": tmp_path / "x.vti"},
    ):
        assert saved.load_done(task_of_loads(tmp_path, **change)) is None


def test_files_of_each_load_count_if_they_were_kept_with_the_result(tmp_path):
    """A collection beside a result that was saved without one is of another run."""
    (tmp_path / "steps").mkdir()
    (tmp_path / "steps" / "path.pvd").touch()
    task = task_of_loads(
        tmp_path, steps_folder=tmp_path, steps_path=lambda output: tmp_path / "steps"
    )
    assert saved._has_files({"steps_kept": True}, task, tmp_path)
    assert not saved._has_files({"steps_kept": False}, task, tmp_path)
    assert not saved._has_files({}, task, tmp_path)
    (tmp_path / "x.vti").write_text("fields")
    digest = hashlib.sha256(b"fields").hexdigest()
    with_fields = task_of_loads(tmp_path, fields_file=tmp_path / "x.vti")
    content = {"fields_digest": digest, "precision": "double"}
    assert saved._has_files(content, with_fields, tmp_path)
    assert not saved._has_files(content | {"precision": "half"}, with_fields, tmp_path)
    (tmp_path / "x.vti").write_text("changed")
    assert not saved._has_files(content, with_fields, tmp_path)


def test_fields_stay_beside_their_own_result_alone(tmp_path, monkeypatch):
    """A result that is saved again without fields keeps their file, and another result
    of the task, by another key, deletes the files of fields and of each load.
    """
    (tmp_path / "small.toml").write_text(SMALL_CASE)
    case = load_case(tmp_path / "small.toml")
    task = next(
        task for task in tasks_of(case, Run(tmp_path)) if task.method.name == "bem"
    )
    task = replace(task, fields_file=None, steps_folder=None)
    file, steps = task.fields_path(tmp_path), task.steps_path(tmp_path)
    steps.mkdir(parents=True)
    file.write_text("fields")
    with_files = replace(task, fields_file=file, steps_folder=steps)
    left = []
    for key, saved_task in (("a", with_files), ("a", task), ("b", task)):
        monkeypatch.setattr(saved, "key_of", lambda _, key=key: key)
        saved.save_result(saved_task, tmp_path, result_of(1.0))
        left.append((file.exists(), steps.exists()))
    assert left == [(True, True), (True, True), (False, False)]


def test_each_load_is_measured_on_the_path_up_to_it(monkeypatch):
    """After each solved load the scene that is measured ends at this load, also after
    loads that an earlier run has solved.
    """
    measured = []

    def measure_load(task, scene, result, threads):
        """Record the path of the scene and the loads of the result."""
        measured.append((scene.load.path, len(result.steps)))
        return result.final

    monkeypatch.setattr(load_path, "measure_load", measure_load)
    heights = np.linspace(0.0, 1e-6, 16).reshape(4, 4)
    scene = Scene(Surface(heights, (1.0, 1.0)), Material(1e11, 0.3), Load(LOADS))
    path = SimpleNamespace(load=Load(LOADS))
    task = SimpleNamespace(
        method=METHODS["bem"], case=path, peak_file=None, steps_folder=None
    )
    first, *others = result_of(1.0).steps
    before = load_path._Before((), (first,), (), None)
    observer = load_path._LoadObserver(task, scene, 1, before)
    for count in (1, 2):
        observer(replace(result_of(1.0), steps=tuple(others[:count])))
    assert measured == [(LOADS[:2], 2), (LOADS, 3)]
    assert [step.mean_pressure for step in observer.steps] == list(LOADS[1:])


def test_a_saved_result_of_unknown_code_is_not_used_again(tmp_path, monkeypatch):
    """The code of a user's solver may have changed, even under the same key."""
    monkeypatch.setattr(saved, "key_of", lambda task: "key")
    (tmp_path / "small.toml").write_text(SMALL_CASE)
    case = load_case(tmp_path / "small.toml")
    task = next(
        task for task in tasks_of(case, Run(tmp_path)) if task.method.name == "bem"
    )
    result = result_of(1.0)
    saved.save_result(task, tmp_path, result)
    assert saved.load_saved(task, tmp_path) == result
    mine = replace(METHODS["bem"], source="mine:solve")
    assert saved.load_saved(replace(task, method=mine), tmp_path) is None
