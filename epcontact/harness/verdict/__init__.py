"""The verdict on cases: whether every gate holds.

verification      `verify`, the main job, and the Verdict that verdict.json holds
read_back         what was written is read and checked again
ratchet           bands may narrow, but widen only with a reason
known             comparisons whose outcome is known judge the judge
pytest_cases      gates as tests of pytest
"""

from epcontact.harness.verdict.verification import Verdict, verify

__all__ = ["Verdict", "verify"]
