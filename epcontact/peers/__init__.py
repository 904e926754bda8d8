"""Other contact codes, as functions that map a scene to a result.

public_codes      ContactMechanics and tamaas: capped contact of half-spaces
tamaas_j2         tamaas with J2 flow, by volume integrals
calculix          CalculiX on the block of `fem_check`, and its input file
pressure_result   the result that follows from the pressures of a code
"""
