"""The registry of quantities: every scalar that a gate can read, with its unit and meaning.

`QUANTITIES` is the only list of them: the schema of case files, the check of gates, the key of a
kept result and the measurements all use it.  There are two kinds.

Most quantities are reported by the method: the areas, and the entries of `quantities`,
`residuals`, `iterations` and `cost` of a result.  The harness itself *measures* the others with
numpy, in the process that solved the scene, from the pressure field, the heights of the scene and
the compliance of `reference.layers`, so that no solver checks itself.  A measured quantity has a
function `measure`; `needs` lists what it needs beside the scene.

To add a quantity, add an entry to `_REPORTED` or to `_MEASURED`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from epcontact.harness.interface import Branch
from epcontact.harness.quantities import identities, measurements
from epcontact.harness.quantities.measurements import Answered
from epcontact.reference.roughness import rms_slope


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
    measure: Callable[[Answered], float] | None = None


#: A method from outside the package may report unlisted quantities of these groups.
REPORTED_GROUPS = ("quantity.", "residual.", "iterations.", "cost.")


_AREAS = tuple(
    Quantity(f"area.{part}.{kind}", "–", f"{part} contact area over the nominal area, {meaning}")
    for part in ("total", "elastic", "plastic")
    for kind, meaning in (
        ("raw", "as the share of grid points"),
        ("corrected", "in the limit of a vanishing grid spacing"),
        ("error", "the estimated absolute error of the corrected one"),
    )
)

_REPORTED = (
    Quantity("mean_pressure", "Pa", "force over the nominal area at the last load step"),
    Quantity(
        "distribution", "–", "distribution of the contact pressures, by wasserstein or supremum"
    ),
    Quantity("field.heights", "m", "heights of the surface, by the norm l2", ("fields",)),
    Quantity("field.pressure", "Pa", "contact pressure, by the norm l2", ("fields",)),
    Quantity("field.gap", "m", "gap, negative where the body flows, by the norm l2", ("fields",)),
    Quantity("field.displacement", "m", "displacement of the surface, by the norm l2", ("fields",)),
    Quantity("quantity.mean_gap", "m", "mean of the gap where it is open, over the nominal area"),
    Quantity("quantity.mean_separation", "m", "mean of the gap, plastic displacements included"),
    Quantity(
        "quantity.mean_plastic_displacement", "m", "plastic displacement, over the nominal area"
    ),
    Quantity("quantity.elastic_energy", "J/m2", "elastic energy over the nominal area"),
    Quantity("quantity.plastic_work", "J/m2", "work spent on plastic flow, over the nominal area"),
    Quantity("quantity.stored_energy", "J/m2", "elastic energy of the whole J2 block, by fem"),
    Quantity("quantity.largest_pressure", "Pa", "largest contact pressure"),
    Quantity("quantity.mean_contact_pressure", "Pa", "mean pressure on the contact, by fem"),
    Quantity("quantity.approach", "m", "approach of the rigid flat from first touch, by fem"),
    Quantity("quantity.largest_plastic_strain", "–", "largest equivalent plastic strain, by fem"),
    Quantity("quantity.plastic_volume", "–", "share of the body that has flowed, by fem"),
    Quantity("quantity.plastic_depth", "m", "depth down to which the body has flowed, by fem"),
    Quantity("quantity.step_error", "–", "share of the force that shorter increments move, by fem"),
    Quantity("quantity.energy_reduction", "–", "gamma of the theory"),
    Quantity("quantity.diffusion", "Pa2", "G of the theory at the full magnification"),
    Quantity("quantity.rms_slope", "–", "rms slope that the theory takes from the spectrum"),
    Quantity("quantity.density_slope_at_zero", "1/Pa2", "dP/dsigma of the theory at sigma = 0"),
    Quantity(
        "quantity.density_slope_at_hardness", "1/Pa2", "dP/dsigma of the theory at the hardness"
    ),
    Quantity("quantity.plastic_force_share", "–", "share of the load on plastic contact"),
    Quantity(
        "residual.bounds", "–", "pressures beyond their bounds over the mean pressure, by bem"
    ),
    Quantity("residual.force", "–", "force missing over the nominal force, by persson and bem"),
    Quantity("residual.area", "–", "area that the theory's parts miss or count twice"),
    Quantity(
        "residual.gap_elastic", "–", "largest gap in elastic contact over the rms height, by bem"
    ),
    Quantity("residual.gap_sign", "–", "largest gap of the wrong sign over the rms height, by bem"),
    Quantity("residual.balance", "–", "force that is out of balance over the load, by fem"),
    Quantity("residual.load", "–", "load missing over the load, by fem"),
    Quantity("residual.gap", "–", "largest gap in contact over the rms height, by fem"),
    Quantity("residual.penetration", "–", "largest penetration over the rms height, by fem"),
    Quantity("residual.tension", "–", "largest tensile contact force over the load, by fem"),
    Quantity("residual.certified_balance", "–", "balance of the system as scikit-fem assembles it"),
    Quantity("residual.certified_load", "–", "reaction of the base less the load, as assembled"),
    Quantity("quantity.known_intervals", "–", "largest error of known intervals, by judge"),
    Quantity("quantity.known_distances", "–", "largest error of known distances, by judge"),
    Quantity("quantity.known_falsehoods", "–", "largest error of known scores, by judge"),
    Quantity("quantity.known_budget", "–", "largest break of a chain of differences, by judge"),
    Quantity("iterations.newton", "–", "Newton steps of the last load step"),
    Quantity("iterations.cg", "–", "steps of conjugate gradients of the last load step"),
    Quantity("iterations.gradient", "–", "gradient steps of the last load step, by bem"),
    Quantity("iterations.levels", "–", "grids that the last load step was solved on, by bem"),
    Quantity("iterations.fft_pairs", "–", "pairs of transforms on the finest grid, by bem"),
    Quantity(
        "iterations.equivalent_fft_pairs", "–", "the same with coarse grids by their points, by bem"
    ),
    Quantity("iterations.contact_sweeps", "–", "changes of the contact sets, by fem"),
    Quantity("iterations.increments", "–", "load increments, by fem"),
    Quantity("iterations.line_searches", "–", "Newton steps that were shortened, by fem"),
    Quantity("cost.seconds", "s", "wall time of all load steps"),
    Quantity("cost.unknowns", "–", "unknowns of the discrete problem"),
    Quantity("cost.peak_memory_bytes", "bytes", "largest memory of the process"),
    Quantity(
        "cost.fft_pairs", "–", "pairs of transforms on the finest grid over all load steps, by bem"
    ),
    Quantity(
        "cost.equivalent_fft_pairs", "–", "the same with coarse grids by their points, by bem"
    ),
    Quantity("cost.newton_steps", "–", "Newton steps of all load steps, by fem"),
    Quantity("cost.cg_iterations", "–", "steps of conjugate gradients of all load steps, by fem"),
    Quantity("cost.contact_sweeps", "–", "changes of the contact sets over all load steps, by fem"),
    Quantity("cost.increments", "–", "load increments of all load steps, by fem"),
    Quantity(
        "cost.most_newton_steps", "–", "largest number of Newton steps of an increment, by fem"
    ),
    Quantity(
        "cost.most_cg_iterations", "–", "largest number of steps of conjugate gradients, by fem"
    ),
)

# What the load does next, by the branch of the load path.
_BRANCHES: tuple[tuple[Branch, str], ...] = (("loading", "grows"), ("unloading", "falls"))

_MEASURED = (
    Quantity(
        "quantity.surface_rms_height",
        "m",
        "rms height of the surface",
        (),
        lambda a: a.scene.surface.rms_height,
    ),
    Quantity(
        "quantity.surface_rms_slope",
        "–",
        "rms slope of the surface by spectral derivatives",
        (),
        lambda a: rms_slope(a.scene),
    ),
    *(
        Quantity(
            f"quantity.surface_{name}",
            unit,
            meaning,
            (),
            partial(measurements.surface_mark, name=name),
        )
        for name, unit, meaning in (
            ("highest", "m", "height of the highest point over the mean"),
            ("skewness", "–", "skewness of the heights: of the other sign upside down"),
            ("summit_x", "–", "place of the highest point along x, over the period"),
            ("summit_y", "–", "place of the highest point along y, over the period"),
        )
    ),
    Quantity(
        "quantity.surface_curvature",
        "1/m",
        "curvature at the highest point by differences, mean over the axes",
        (),
        measurements.summit_curvature,
    ),
    Quantity("quantity.measured_force", "–", "mean(p)/p0 - 1", ("fields",), measurements.force),
    Quantity(
        "quantity.measured_bounds",
        "–",
        "largest distance of p from [0, hardness], over p0",
        ("fields",),
        measurements.bounds,
    ),
    Quantity(
        "quantity.measured_gap",
        "–",
        "largest violation of the contact conditions (Karush-Kuhn-Tucker) over the rms height: "
        "|g| where 0 < p < hardness, -g where p = 0, g where p = hardness",
        ("fields",),
        measurements.gap,
    ),
    Quantity(
        "quantity.measured_raw_total",
        "–",
        "share of grid points with p > 0, less the raw area",
        ("fields",),
        measurements.raw_total,
    ),
    Quantity(
        "quantity.measured_raw_plastic",
        "–",
        "share of grid points at the hardness, less the raw plastic area",
        ("fields",),
        measurements.raw_plastic,
    ),
    Quantity(
        "quantity.measured_carried",
        "–",
        "(int sigma dF + hardness A_pl)/p0 - 1 of the reported distribution",
        ("fields",),
        measurements.carried,
    ),
    *(
        Quantity(
            f"quantity.{name}_{branch}",
            unit,
            f"{meaning}, if the load {change} next",
            ("fields",),
            partial(function, branch=branch),
        )
        for name, unit, meaning, function in (
            (
                "stiffness",
                "Pa/m",
                "d(mean pressure)/d(approach of the mean planes)",
                measurements.stiffness,
            ),
            (
                "conductance",
                "1/m",
                "contact conductance per nominal area times the sum of the bodies' resistivities",
                measurements.conductance,
            ),
        )
        for branch, change in _BRANCHES
    ),
    *(
        Quantity(
            f"quantity.{part}_patches{suffix}",
            "–",
            f"{meaning} of {part} contact",
            ("fields",),
            partial(measurements.patches_of, part=part, what=what),
        )
        for part in ("total", "elastic", "plastic")
        for suffix, what, meaning in (
            ("", "number", "number of connected patches"),
            ("_largest", "largest", "share of the nominal area in the largest patch"),
        )
    ),
    Quantity(
        "quantity.contact_percolation",
        "–",
        "share of the nominal area, the closest points first, that first connects across a period",
        ("fields",),
        partial(measurements.percolation, sign=1.0),
    ),
    Quantity(
        "quantity.gap_percolation",
        "–",
        "share of the nominal area, the widest gaps first, that first connects across a period",
        ("fields",),
        partial(measurements.percolation, sign=-1.0),
    ),
    Quantity(
        "quantity.measured_areas",
        "–",
        "largest error of the areas that needs no reference: counts of the pressures, sums",
        ("fields",),
        identities.areas,
    ),
    Quantity(
        "quantity.measured_figures",
        "–",
        "largest difference of a reported mean, energy or pressure from that of the fields",
        ("fields",),
        identities.figures,
    ),
    Quantity(
        "quantity.measured_fields",
        "–",
        "largest error of heights, displacement, gap (over the rms height) and state",
        ("fields",),
        identities.fields,
    ),
    Quantity(
        "quantity.measured_distribution",
        "–",
        "largest difference of the distribution from a count of the pressures",
        ("fields",),
        identities.distribution,
    ),
    Quantity(
        "quantity.measured_residuals",
        "–",
        "largest relative error of the reported residuals of the gap",
        ("fields",),
        identities.residuals,
    ),
    Quantity(
        "quantity.distribution_balance",
        "–",
        "largest error of the distribution's areas (over the contact) and of its load (over p0)",
        (),
        identities.balance,
    ),
    Quantity(
        "quantity.path_work",
        "–",
        "work of the load path over the energy that it leaves, less 1; by Simpson's rule",
        (),
        identities.work,
    ),
    Quantity(
        "quantity.cycle_area",
        "–",
        "total area at the last load over that when the path first had this load, less 1",
        (),
        identities.cycle,
    ),
    Quantity(
        "quantity.smallest_contact_pressure",
        "Pa",
        "smallest pressure where p > 0",
        ("fields",),
        measurements.smallest_contact_pressure,
    ),
    # The next six compare J2 flow with a pressure cap, see `model_difference`.
    Quantity(
        "quantity.model_area",
        "–",
        "A_J2/A_cap - 1 of the raw areas, with the cap at the hardness of the scene",
        ("fields", "J2 flow", "hardness"),
        lambda a: a.model.at_hardness.area,
    ),
    Quantity(
        "quantity.model_overlap",
        "–",
        "shared contact nodes over the nodes in either contact, of J2 and the same cap",
        ("fields", "J2 flow", "hardness"),
        lambda a: a.model.at_hardness.overlap,
    ),
    Quantity(
        "quantity.model_distance",
        "–",
        "Wasserstein distance of the pressures of J2 and the same cap, over the hardness",
        ("fields", "J2 flow", "hardness"),
        lambda a: a.model.at_hardness.wasserstein,
    ),
    Quantity(
        "quantity.effective_hardness",
        "–",
        "c_eff: the cap over yield_stress at which the capped body has the area of the J2 body",
        ("fields", "J2 flow"),
        lambda a: a.model.effective.ratio,
    ),
    Quantity(
        "quantity.effective_overlap",
        "–",
        "shared contact nodes over the nodes in either contact, of J2 and the cap c_eff",
        ("fields", "J2 flow"),
        lambda a: a.model.effective_difference.overlap,
    ),
    Quantity(
        "quantity.elements_pressure",
        "–",
        "L2 difference of the pressures, elastic or capped, from those of boundary elements on the "
        "compliance of the elements, over their L2 norm",
        ("fields",),
        lambda a: a.model.elements_pressure,
    ),
    Quantity(
        "quantity.elements_area",
        "–",
        "A_cap/A - 1, with A_cap on the compliance of the elements and A on the exact one",
        ("fields", "J2 flow"),
        lambda a: a.model.elements_area,
    ),
)

#: Every quantity by its name, such as `QUANTITIES["area.total.raw"]`.
QUANTITIES: dict[str, Quantity] = {q.name: q for q in (*_AREAS, *_REPORTED, *_MEASURED)}
