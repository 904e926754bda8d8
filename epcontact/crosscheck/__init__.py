"""Why finite and boundary elements differ on a scene, part by part.

model_difference   J2 flow against a pressure cap on one body; gates read it as
                   quantity.model_*, quantity.effective_* and quantity.elements_*
report             all parts of the difference, surface by surface
"""
