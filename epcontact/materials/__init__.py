"""Materials in contact: elastic moduli, and the pressure cap that stands for a rough J2
metal.
"""
