"""When, where and by which sources a verification ran; no person or host is named."""

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

#: The folder of the package: a checkout, or the folder of an installation.
HOME = Path(__file__).parents[3]
#: The folders of a checkout on which a verdict rests.
_JUDGED = ("epcontact", "fem_check", "cases")


class RunInfo(Record):
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
    def here(cls) -> RunInfo:
        """Return the run info of a run that begins now, on this machine."""
        commit, dirty = commit_of(HOME)
        return cls(
            version=package_versions()["epcontact"],
            commit=commit,
            dirty=dirty,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            cores=available_cores(),
            processor=_processor(),
            # A release may name its builder, so the system is named alone.
            system=f"{platform.system()} {platform.machine()}",
        )


def commit_of(home: Path) -> tuple[str | None, bool | None]:
    """Return the git commit of a checkout, and whether its files differ from it.

    Only the folders epcontact, fem_check and cases count for the difference.  Both
    members of the tuple are None if git is not installed, takes more than 10 s, or if
    the folder is no checkout of this package.

    Args:
        home: the folder that contains the package epcontact.
    """
    # A hook of another repository names that one in GIT_ variables; the index may be
    # another user's to write.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    environment["GIT_OPTIONAL_LOCKS"] = "0"
    commands = (
        # It fails in a repository around the package.
        ("ls-files", "--error-unmatch", "epcontact/__init__.py"),
        ("rev-parse", "HEAD"),
        ("status", "--porcelain", "--", *_JUDGED),
    )
    outputs = []
    for words in commands:
        try:
            done = subprocess.run(
                ("git", *words),
                cwd=home,
                env=environment,
                capture_output=True,
                text=True,
                timeout=10,
                check=True,
            )
        except (OSError, subprocess.SubprocessError):
            return None, None
        outputs.append(done.stdout.strip())
    return outputs[1], bool(outputs[2])


def _processor() -> str:
    """Return the model name of the processor; "" if the system does not report it."""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        for line in text.splitlines():
            if line.startswith("model name"):
                return line.partition(": ")[2]
    return platform.processor()
