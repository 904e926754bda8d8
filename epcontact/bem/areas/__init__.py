"""Areas and pressure distributions of a solution in the limit of a vanishing grid spacing.

`rim_correction` estimates areas from the fronts in a grid's cells (`grid`), which cross between two
neighbouring points (`front`), and from what the points hide (`hidden`).
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined
