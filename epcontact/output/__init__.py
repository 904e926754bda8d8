"""All that leaves the program: files, VTK fields, charts, three-dimensional views, the report.

This package knows results and the files they are kept in, and none of the methods.  Files appear
whole or not at all (`files`); fields are .vti (`vtk`); charts are drawn by matplotlib (`charts`),
three-dimensional pictures by pyvista in a process of their own (`view`).
"""
