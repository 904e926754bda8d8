"""The commands that need no case: hardness and joint."""

from __future__ import annotations

from epcontact.cli.main import print_text
from epcontact.materials.hardness_map import effective_hardness
from epcontact.reference.conductance import joint_conductance


def hardness(**arguments: float) -> None:
    """Print the pressure cap that represents a rough J2 metal, with its interval.

    The arguments are those of `commands.hardness`.
    """
    cap = effective_hardness(**arguments)
    print_text(str(cap))
    print_text(cap.source)


def joint(**arguments: float) -> None:
    """Print the conductance of a rough joint, with its interval and textbook laws.

    The arguments are those of `commands.joint`.
    """
    print_text(str(joint_conductance(**arguments)))  # type: ignore[arg-type]
