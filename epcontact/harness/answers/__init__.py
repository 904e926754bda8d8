"""Answers: the results of a case, one for each surface and method.

store             tasks and their results on disk, and a scene in words and figures
run               tasks solved: here, in processes or by any executor
pictures          the charts of a case's answers
"""
