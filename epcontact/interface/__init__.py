"""A contact under load: its stiffness, its conductance, its patches and percolation.

    stiffness    stiffness and conductance of a contact, and what carries a change
    rim          from the grid to the limit of a vanishing spacing, by the contact's rim
    punch        the flat punch on the points of a contact, on the grid
    percolation  connected patches of a mask, and the area fraction that percolates
    runs         runs of points on a periodic grid, and the patches that they join to
    limit        a value of the grid, its limit, and the error of the limit

Each module imports only from those below it.
"""

from epcontact.interface.limit import Limit
from epcontact.interface.percolation import Patches, find_patches, percolation_fraction
from epcontact.interface.stiffness import (
    Branch,
    contact_conductance,
    interface_stiffness,
)

__all__ = [
    "Branch",
    "Limit",
    "Patches",
    "contact_conductance",
    "find_patches",
    "interface_stiffness",
    "percolation_fraction",
]
