"""Contact areas in the limit of a vanishing grid spacing, from the fields on one grid."""
