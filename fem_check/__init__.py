"""fem_check: a finite-element half-block that answers epcontact's scenes independently.

It imports from epcontact the scene, the results and the errors alone: no kernel, no spectrum,
no area correction, not even a formula for a modulus.
"""
