"""What a verdict rests on, by its digest: no later command shows a verdict that was changed."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic_core import to_json

from epcontact.errors import OutputError
from epcontact.files import read_bytes

Data = Mapping[str, Any]  # the content of a JSON file

#: The files that say what a run found.
FILES = ("verdict.json", "junit.xml", "report.html")


def withdraw(folder: Path) -> None:
    """Remove the verdict of a run that ends in an error."""
    for name in FILES:
        (folder / name).unlink(missing_ok=True)


def digest_of(verdict: Data, folder: Path) -> str:
    """Return the SHA-256 of a verdict and of the answers on which it rests."""
    found = hashlib.sha256(to_json({k: part for k, part in verdict.items() if k != "digest"}))
    for case in verdict["cases"]:
        here = folder / case["id"] / case["size"]
        for path in (here / f"{name}.json" for name, m in case["methods"].items() if m["surfaces"]):
            found.update(path.read_bytes() if path.is_file() else b"")
    return found.hexdigest()


def require_untouched(folder: Path) -> None:
    """Raise OutputError if a verdict or its answers are not those that `verify` wrote together."""
    content, same = read_bytes(folder / "verdict.json"), False
    with contextlib.suppress(KeyError, TypeError, ValueError, AttributeError, RecursionError):
        verdict = json.loads(content)
        same = verdict["digest"] == digest_of(verdict, folder)
    if not same:
        raise OutputError(
            f"cannot show {folder / 'verdict.json'}: it or an answer beside it was changed after "
            "verify wrote them; run verify again"
        )
