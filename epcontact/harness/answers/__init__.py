"""Answers: the results of a case, one for each surface and method.

description       a scene in words and figures
store             tasks, and their results on disk, found again by their keys
run               tasks solved: here, in processes or by any executor
pictures          the charts of a case's answers
"""
