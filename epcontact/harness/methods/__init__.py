"""Methods: every way to answer a scene.

registry          METHODS, and what the rest of the package needs to know of each
peers             ContactMechanics and tamaas
foreign           solvers from outside, in any language and in a process of their own
"""
