"""The verdict on cases: whether every gate holds.

record            what a verification found: the Verdict that verdict.json holds
judgement         the gates of a case, judged
files             verdict.json and junit.xml
read_back         what was written is read and checked again
verification      `verify`, the main job
pytest_cases      gates as tests of pytest
"""

from epcontact.harness.verdict.record import Verdict
from epcontact.harness.verdict.verification import verify

__all__ = ["Verdict", "verify"]
