"""Exact solutions, and as gates name them."""
