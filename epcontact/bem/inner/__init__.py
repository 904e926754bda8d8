"""The linear problem of a Newton step: the inverse of the compliance on the elastic
points.
"""
