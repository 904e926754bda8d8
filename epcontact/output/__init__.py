"""The output of the program: VTK fields, charts, three-dimensional views, the report.

This package knows results and their files, but no method.  Fields are .vti (`vtk`).
Matplotlib draws charts (`charts`), and pyvista draws three-dimensional pictures
(`view`).
"""
