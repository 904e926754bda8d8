"""The linear problem of a Newton step: the compliance restricted to the elastic set.

`cg` solves it by conjugate gradients, `split` applies the compliance cheaply, and
`preconditioner` works on the `cells` of the grid.
"""
