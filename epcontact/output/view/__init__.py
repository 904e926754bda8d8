"""Three-dimensional views of fields."""
