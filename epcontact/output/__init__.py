"""The output of the program: files, VTK fields, charts, three-dimensional views, the report.

This package knows results and their files, but no method.  Files appear whole or not at all
(`files`).  Fields are .vti (`vtk`).  Matplotlib draws charts (`charts`), and pyvista draws
three-dimensional pictures (`view`).
"""
