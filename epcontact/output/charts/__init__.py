"""Charts of results and of studies."""
