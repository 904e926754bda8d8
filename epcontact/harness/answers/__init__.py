"""Answers: the results of a case, one for each surface and method."""
