"""Quantities: every figure that a gate can read of an answer.

registry          QUANTITIES, each with its unit and meaning
reading           the value of a quantity in an answer
measurements      what the harness computes of an answer itself
identities        what must agree within one answer
model_difference  J2 flow against a pressure cap, and the effective hardness
"""
