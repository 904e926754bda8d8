"""The report of a verification as one HTML page."""
