"""The verdict on cases: whether every gate holds."""

from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.verification import verify

__all__ = ["Verdict", "verify"]
