"""The registry of quantities: every scalar that a gate can read, with its unit and meaning.

Methods *report* most quantities: those of the table `REPORTED`.  The harness itself *measures* the
others in the process that solved the scene, so that no solver checks itself.  To add one, write a
function of an answered scene with the decorator `quantity`; its docstring is the meaning:

    @quantity("measured_force", "–")
    def force(a: Answered) -> float:
        \"\"\"mean(p)/p0 - 1.\"\"\"
        return float(a.pressure.mean()) / a.scene.load.final - 1
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.gates.distances import l2_distance
from epcontact.harness.quantities.answered import Answered
from epcontact.reference import CLOSED_FORMS
from epcontact.results import ContactResult
from epcontact.scene import Scene

Measure = Callable[[Answered], float]


@dataclass(frozen=True)
class Quantity:
    """A scalar that a gate can read.

    Attributes:
        name: its name in gates, such as area.total.raw or quantity.mean_gap; a measured quantity
            is added to the `quantities` of the result, so that its name begins with "quantity.".
        unit: its unit; "–" if it has none.
        meaning: its meaning in one line.
        needs: its requirements, checked before anything is solved: "fields" of the method,
            "J2 flow" by the method, and for that a finite "hardness" of the scene.
        measure: the function that measures the quantity; None if the method reports it.
    """

    name: str
    unit: str
    meaning: str
    needs: tuple[str, ...] = ()
    measure: Measure | None = None


#: A method from outside the package may report unlisted quantities of these groups.
REPORTED_GROUPS = ("quantity.", "residual.", "iterations.", "cost.")

#: What methods report: name | unit | meaning.
REPORTED = """
mean_pressure | Pa | force over the nominal area at the last load step
distribution | – | distribution of the contact pressures, by wasserstein or supremum
field.heights | m | heights of the surface, by the norm l2
field.pressure | Pa | contact pressure, by the norm l2
field.gap | m | gap, negative where the body flows, by the norm l2
field.displacement | m | displacement of the surface, by the norm l2
quantity.mean_gap | m | mean of the gap where it is open, over the nominal area
quantity.mean_separation | m | mean of the gap, plastic displacements included
quantity.mean_plastic_displacement | m | plastic displacement, over the nominal area
quantity.elastic_energy | J/m2 | elastic energy over the nominal area
quantity.plastic_work | J/m2 | work spent on plastic flow, over the nominal area
quantity.stored_energy | J/m2 | elastic energy of the whole J2 block, by fem
quantity.largest_pressure | Pa | largest contact pressure
quantity.mean_contact_pressure | Pa | mean pressure on the contact, by fem
quantity.approach | m | approach of the rigid flat from first touch, by fem
quantity.largest_plastic_strain | – | largest equivalent plastic strain, by fem
quantity.plastic_volume | – | share of the body that has flowed, by fem
quantity.plastic_depth | m | depth down to which the body has flowed, by fem
quantity.step_error | – | share of the force that shorter increments move, by fem
quantity.energy_reduction | – | gamma of the theory
quantity.diffusion | Pa2 | G of the theory at the full magnification
quantity.rms_slope | – | rms slope that the theory takes from the spectrum
quantity.density_slope_at_zero | 1/Pa2 | dP/dsigma of the theory at sigma = 0
quantity.density_slope_at_hardness | 1/Pa2 | dP/dsigma of the theory at the hardness
quantity.plastic_force_share | – | share of the load on plastic contact
residual.bounds | – | pressures beyond their bounds over the mean pressure, by bem
residual.force | – | force missing over the nominal force, by persson and bem
residual.area | – | area that the theory's parts miss or count twice
residual.gap_elastic | – | largest gap in elastic contact over the rms height, by bem
residual.gap_sign | – | largest gap of the wrong sign over the rms height, by bem
residual.balance | – | force that is out of balance over the load, by fem
residual.load | – | load missing over the load, by fem
residual.gap | – | largest gap in contact over the rms height, by fem
residual.penetration | – | largest penetration over the rms height, by fem
residual.tension | – | largest tensile contact force over the load, by fem
residual.certified_balance | – | balance of the system as scikit-fem assembles it
residual.certified_load | – | reaction of the base less the load, as assembled
iterations.newton | – | Newton steps of the last load step
iterations.cg | – | steps of conjugate gradients of the last load step
iterations.gradient | – | gradient steps of the last load step, by bem
iterations.levels | – | grids that the last load step was solved on, by bem
iterations.fft_pairs | – | pairs of transforms on the finest grid, by bem
iterations.equivalent_fft_pairs | – | the same with coarse grids by their points, by bem
iterations.contact_sweeps | – | changes of the contact sets, by fem
iterations.increments | – | load increments, by fem
iterations.line_searches | – | Newton steps that were shortened, by fem
cost.seconds | s | wall time of all load steps
cost.unknowns | – | unknowns of the discrete problem
cost.peak_memory_bytes | bytes | largest memory of the process
cost.fft_pairs | – | pairs of transforms on the finest grid over all load steps, by bem
cost.equivalent_fft_pairs | – | the same with coarse grids by their points, by bem
cost.newton_steps | – | Newton steps of all load steps, by fem
cost.cg_iterations | – | steps of conjugate gradients of all load steps, by fem
cost.contact_sweeps | – | changes of the contact sets over all load steps, by fem
cost.increments | – | load increments of all load steps, by fem
cost.most_newton_steps | – | largest number of Newton steps of an increment, by fem
cost.most_cg_iterations | – | largest number of steps of conjugate gradients, by fem
"""
_PARTS = ("total", "elastic", "plastic")
_KINDS = {
    "raw": "as the share of grid points",
    "corrected": "in the limit of a vanishing grid spacing",
    "error": "the estimated absolute error of the corrected one",
}

#: Every quantity by its name, such as `QUANTITIES["area.total.raw"]`.
QUANTITIES: dict[str, Quantity] = {}


def _add(name: str, unit: str, meaning: str, *rest: Any) -> None:
    QUANTITIES[name] = Quantity(name, unit, meaning, *rest)


for _part in _PARTS:
    for _kind, _meaning in _KINDS.items():
        _add(
            f"area.{_part}.{_kind}", "–", f"{_part} contact area over the nominal area, {_meaning}"
        )
for _line in REPORTED.strip().splitlines():
    _name, _unit, _meaning = _line.split(" | ")
    _add(_name, _unit, _meaning, ("fields",) if _name.startswith("field.") else ())


def quantity(
    name: str, unit: str, needs: tuple[str, ...] = ("fields",), meaning: str = ""
) -> Callable[[Measure], Measure]:
    """Add a measured quantity; its meaning is the first paragraph of the function's docstring."""

    def add(measure: Measure) -> Measure:
        said = meaning or " ".join((measure.__doc__ or "").partition("\n\n")[0].split())
        _add(f"quantity.{name}", unit, said.removesuffix("."), needs, measure)
        return measure

    return add


# --- reading -------------------------------------------------------------------------------------


def scalar_quantities(result: ContactResult) -> dict[str, float]:
    """Return every scalar of the last load step by its name in gates."""
    final = result.final
    known = {"mean_pressure": final.mean_pressure}
    for kind, areas in final.areas.items():
        known |= {f"area.{part}.{kind}": getattr(areas, part) for part in _PARTS}
    reported = (final.quantities, final.residuals, final.iterations, result.cost)
    for group, values in zip(REPORTED_GROUPS, reported, strict=True):
        known |= {group + key: float(value) for key, value in values.items()}
    return known


def read_quantity(result: ContactResult, name: str) -> float:
    """Return the scalar called `name` at the last load step of a result, or raise InvalidCase."""
    known = scalar_quantities(result)
    if name not in known:
        raise InvalidCase(
            f"{result.method} has no quantity {name!r}; it has {', '.join(sorted(known))}"
        )
    return known[name]


def measured(name: str, answered: Answered) -> float:
    """Measure a quantity, or "l2.<closed form>.<field>": a field's distance from its closed form.

    Raises InvalidCase if the result lacks what the quantity needs.
    """
    group, _, rest = name.partition(".")
    if group == "l2":
        form, _, field = rest.partition(".")
        exact = CLOSED_FORMS[form].field(field, answered.scene)
        return l2_distance(answered.field(field), exact)
    if name not in QUANTITIES:
        raise InvalidCase(f"no quantity is called {name!r}{nearest(name, QUANTITIES)}")
    found = QUANTITIES[name]
    if found.measure is None:
        raise InvalidCase(f"{name} is reported by the methods, not measured")
    if "fields" in found.needs:
        answered.field("pressure")  # raises InvalidCase if it is missing
    try:
        return found.measure(answered)
    except InvalidCase as error:  # a gate beside it must not be blamed
        raise InvalidCase(f"{name}: {error}") from error


def measure_all(names: Collection[str], scene: Scene, result: ContactResult) -> dict[str, float]:
    """Measure quantities of a result with its fields; common solves run once."""
    answered = Answered(scene, result)
    return {name: measured(name, answered) for name in names}


def measure(name: str, scene: Scene, result: ContactResult) -> float:
    """Measure a quantity of a result with its fields; see `measured`."""
    return measured(name, Answered(scene, result))
