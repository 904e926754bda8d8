"""The digest of a verdict and of the results on which it rests."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic_core import to_json


def digest_of(verdict: Mapping[str, Any], folder: Path) -> str:
    """Return the SHA-256 of a verdict, followed by that of its results in the folder.

    Args:
        verdict: the content of verdict.json; its own digest does not count.
        folder: the output folder.  Without any `<method>.json` there, the digest is
            that of the verdict alone.
    """
    content = {key: part for key, part in verdict.items() if key != "digest"}
    of_verdict = hashlib.sha256(to_json(content)).hexdigest()
    digests = b""
    for case in verdict["cases"]:
        for name, method in case["methods"].items():
            path = folder / case["id"] / case["size"] / f"{name}.json"
            if method["surfaces"] and path.is_file():
                digests += hashlib.sha256(path.read_bytes()).digest()
    return of_verdict + (hashlib.sha256(digests).hexdigest() if digests else "")
