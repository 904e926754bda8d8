"""Answers: the results of a case, one for each surface and method.

description       a scene in words and figures
foundation        the sources and libraries that a result rests on
store             results on disk, found again by their keys
solve             one task: make the surface, solve, measure
run               the tasks of cases, over processes or any executor
pictures          the charts of a case's answers
"""
