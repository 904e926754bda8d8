"""Areas and pressure distributions of a solution in the limit of a vanishing spacing.

Read `front` (where a front is), `grid` (what fronts enclose), `hidden` (what no point
shows) and `rim_correction` (the areas and how certain they are), in this order.
`distribution` is the distribution of the pressures.
"""
