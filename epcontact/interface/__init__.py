"""The interface under load: its stiffness, its conductance, its patches and percolation.

stiffness    stiffness and conductance of a contact, as limits of a vanishing spacing
punch        the flat punch on the points of a contact, on the grid
rim          how the rim of a contact leads from the grid to the limit
percolation  the connected patches of a mask, and the area fraction that percolates
limit        a value of the grid with its limit and the error of the limit
"""

from epcontact.interface.limit import Limit
from epcontact.interface.percolation import Patches, find_patches, percolation_fraction
from epcontact.interface.stiffness import contact_conductance, interface_stiffness

__all__ = [
    "Limit",
    "Patches",
    "contact_conductance",
    "find_patches",
    "interface_stiffness",
    "percolation_fraction",
]
