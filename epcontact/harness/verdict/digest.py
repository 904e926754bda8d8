"""The digest of a verdict and of the results on which it rests."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic_core import to_json


def digest_of(verdict: Mapping[str, Any], folder: Path) -> str:
    """Return the SHA-256 of a verdict, followed by that of the results beside it.

    Args:
        verdict: the content of verdict.json; its key `digest` does not count.
        folder: the folder that contains verdict.json, and the results of each method as
            `<case>/<size>/<method>.json`.

    Returns:
        128 hexadecimal digits; only the first 64, those of the verdict, if the folder
        has none of the results.
    """
    content = {key: value for key, value in verdict.items() if key != "digest"}
    of_verdict = hashlib.sha256(to_json(content)).hexdigest()
    digests = b""
    for case in verdict["cases"]:
        for name, method in case["methods"].items():
            path = folder / case["id"] / case["size"] / f"{name}.json"
            if method["surfaces"] and path.is_file():
                digests += hashlib.sha256(path.read_bytes()).digest()
    if not digests:
        return of_verdict
    return of_verdict + hashlib.sha256(digests).hexdigest()
