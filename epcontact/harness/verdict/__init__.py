"""The verdict on cases: whether every gate holds.

judgement         the Verdict that verdict.json holds, and how the gates of a case are judged
read_back         what was written is read and checked again
verification      `verify`, the main job
pytest_cases      gates as tests of pytest
"""

from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.verification import verify

__all__ = ["Verdict", "verify"]
