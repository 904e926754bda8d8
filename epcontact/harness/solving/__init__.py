"""Cases to results: tasks, their solves, what is measured, and files of results."""
