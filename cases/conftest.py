from epcontact.harness.pytest_cases import pytest_addoption, pytest_collect_file  # noqa: F401
