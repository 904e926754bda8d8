"""Areas and pressure distributions of a solution in the limit of a vanishing grid spacing.

`rim_correction` estimates areas from the fronts in a grid's cells (`grid`), which cross between two
neighbouring points (`front`), from what the points hide (`hidden`) and from repetition (`copies`).
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined
