"""The laboratories: the code that measured the constants of the product.

Run in `tests`, each prints its constants beside those in use (`python -m
laboratory.rim`):

rim           the rim correction of areas, in ten seconds
area_scenes   the scenes in which corrected areas once were wrong, in three minutes
conductance   the table and the formula of what rough joints conduct, in half an hour
hardness_map  the map of the effective hardness, in four hours (`--size large`)
breadth       what the breadth of a spectrum changes in it (`--solve`: in an hour)
"""
