"""Areas and pressure distributions of a solution in the limit of a vanishing grid spacing.

rim_correction  raw and corrected areas, and their estimated error; the constants
grid            the fronts of a contact, located in the cells of a grid
front           where a front crosses between two neighbouring points
hidden          what the points of a contact may hide between them
copies          how many copies of one cell err alike
rows            the rows of a solution that the pass over a grid has in memory
distribution    the distribution of the pressures and its two ends
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined
