"""The commands that need no case: hardness and joint."""

from __future__ import annotations

import click

from epcontact.cli.main import print_text
from epcontact.materials.hardness_map import effective_hardness
from epcontact.reference.conductance import joint_conductance

mean_pressure = click.option(
    "--mean-pressure", type=float, required=True, help="Force over nominal area, in Pa."
)


@click.command()
@click.option("--yield-stress", type=float, required=True, help="sigma_Y in Pa.")
@click.option("--young-modulus", type=float, required=True, help="E in Pa.")
@click.option("--poisson-ratio", type=float, required=True, help="nu.")
@click.option(
    "--rms-slope",
    type=float,
    required=True,
    help="Of all roughness, short waves included.",
)
@mean_pressure
@click.option(
    "--breadth",
    type=float,
    help="Longest (roll-off) over shortest wavelength; else any.",
)
def hardness(**arguments: float) -> None:
    """Print the pressure cap that represents a rough J2 metal, with its interval.

    hardness = "effective" in a case file is the same with the rms slope of the case's
    surface, which may be a measured map.
    """
    cap = effective_hardness(**arguments)
    print_text(str(cap))
    print_text(cap.source)


@click.command()
@click.option(
    "--conductivities",
    type=float,
    nargs=2,
    required=True,
    help="Of both bodies, in W/(m K).",
)
@click.option(
    "--rms-height", type=float, required=True, help="Of both surfaces together, in m."
)
@click.option(
    "--rms-slope",
    type=float,
    required=True,
    help="Of both together: 1.77 times the mean absolute slope of a profile.",
)
@click.option(
    "--hardness", type=float, required=True, help="Of the softer body, in Pa."
)
@click.option(
    "--effective-modulus", type=float, required=True, help="E* of both bodies, in Pa."
)
@mean_pressure
@click.option(
    "--breadth",
    type=float,
    help="Longest (roll-off) over shortest wavelength; else 2 to 12.",
)
def joint(**arguments: float) -> None:
    """Print the conductance of a rough joint, with its interval and textbook laws.

    Gaussian, isotropic roughness, vacuum, clean metals and a joint much larger than its
    longest waves are assumed.  The exact route is a case of this surface with a gate on
    quantity.conductance.
    """
    print_text(str(joint_conductance(**arguments)))  # type: ignore[arg-type]
