"""Where a verdict comes from: the version and the commit, the time and the machine, and
nothing that names a person or a host.
"""

from __future__ import annotations

import os
import platform
import subprocess
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from pydantic import Field

from epcontact.harness.gates import Record
from epcontact.machine import available_cores
from epcontact.results import package_versions

HOME = Path(__file__).parents[
    3
]  # of the package: a checkout, or the folder of an installation
_JUDGED = ("epcontact", "fem_check", "cases")  # what of a checkout a verdict rests on


class Made(Record):
    """When, where and by which sources a verdict was made."""

    version: str = Field(description="of epcontact")
    commit: str | None = Field(
        default=None, description="of the checkout; absent without one"
    )
    dirty: bool | None = Field(
        default=None,
        description="whether its sources or cases differed from that commit",
    )
    date: str = Field(description="when the run began: ISO 8601, in UTC")
    cores: int = Field(description="that the run could use")
    processor: str
    system: str

    @classmethod
    def here(cls) -> Made:
        """Return what is true now, on this machine."""
        commit, dirty = commit_of(HOME)
        return cls(
            version=package_versions()["epcontact"],
            commit=commit,
            dirty=dirty,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            cores=available_cores(),
            processor=_processor(),
            system=f"{platform.system()} {platform.machine()}",  # a release may name its builder
        )


def commit_of(home: Path) -> tuple[str | None, bool | None]:
    """Return the commit of a checkout, and whether what is judged there differs from
    it.
    """
    # A hook of another repository names that one; the index may be another user's to
    # write.
    others = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    found = []
    for words in (
        (
            "ls-files",
            "--error-unmatch",
            "epcontact/__init__.py",
        ),  # not a repository around it
        ("rev-parse", "HEAD"),
        ("status", "--porcelain", "--", *_JUDGED),
    ):
        try:
            done = subprocess.run(
                ("git", *words),
                cwd=home,
                env=others | {"GIT_OPTIONAL_LOCKS": "0"},
                capture_output=True,
                text=True,
                timeout=10,
                check=True,
            )
        except (OSError, subprocess.SubprocessError):
            return None, None
        found.append(done.stdout.strip())
    return found[1], bool(found[2])


def _processor() -> str:
    with suppress(OSError, StopIteration):
        lines = (
            Path("/proc/cpuinfo")
            .read_text(encoding="utf-8", errors="replace")
            .splitlines()
        )
        return next(line for line in lines if line.startswith("model name")).partition(
            ": "
        )[2]
    return platform.processor()
