"""Areas and pressure distributions of a solution in the limit of a vanishing grid spacing.

rim_correction  raw and corrected areas, their estimated error, and the constants
grid            the fronts of a contact in the cells of a grid, and the sums over them
front           where a front crosses between two neighbouring points
hidden          what the points of a contact may hide between them
copies          how many copies of one cell err alike
distribution    the distribution of the pressures and its two ends
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined
