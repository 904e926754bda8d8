"""From case files to a verdict."""
