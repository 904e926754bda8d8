"""Materials in contact: elastic moduli, and the pressure cap that represents a rough J2
metal.
"""
