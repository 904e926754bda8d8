"""Methods: every way to answer a scene."""
