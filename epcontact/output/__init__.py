"""What leaves the program: files written whole, VTK fields, views, charts, report.

Heavy libraries (vtk, pyvista, matplotlib) are imported inside the functions that use them, so
that importing these modules costs nothing.
"""
