"""Areas and pressure distributions of a solution in the limit of a vanishing grid
spacing.

Read `front` (where a front is), `grid` (what fronts enclose), `rim_correction` (how
sure that is).
"""
