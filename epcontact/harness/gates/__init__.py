"""Gates: comparisons of two answers, each with the band that must contain the difference.

statistics        means of ensembles and their intervals
distances         between fields, and between distributions of pressure
gate              a comparison, and its verdict
"""
