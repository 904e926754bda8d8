"""Methods: every way to answer a scene.

registry          METHODS, and what the rest of the package needs to know of each
memory            estimates of what a solve takes
peers             ContactMechanics and tamaas
exchange          scenes and results as files, for solvers in any language
foreign           solvers from outside, in a process of their own
"""
