"""Print the deliberate faults, or with --check those that no longer fit the code."""

import argparse
from collections import Counter

from breaking.check import candidates, reason_stale
from breaking.table import FAULTS

#: Number of functions that are named as candidates for the place of a stale fault.
MOST_CANDIDATES = 4


def main():
    """Print what the options ask for; return the number of stale faults."""
    parser = argparse.ArgumentParser(prog="python -m breaking", description=__doc__)
    parser.add_argument(
        "--check",
        action="store_true",
        help="apply each fault, and list those whose place in the code is gone",
    )
    parser.add_argument(
        "word", nargs="?", default="", help="only faults whose path contains this"
    )
    options = parser.parse_args()
    faults = [fault for fault in FAULTS if options.word in fault.path]
    if options.check:
        return print_stale(faults)
    print_faults(faults)
    return 0


def print_faults(faults):
    """Print one line for each fault, and how many are seen by what."""
    for fault in faults:
        seen = fault.test or f"{fault.case}: {fault.quantity}"
        print(f"{fault.room:<12}{fault.seen_by:<8}{fault.what:<66}{seen}")
    counts = Counter(fault.seen_by for fault in faults)
    numbers = ", ".join(f"{count} by {seer}" for seer, count in counts.items())
    print(f"{len(faults)} faults: {numbers}")


def print_stale(faults):
    """Print each stale fault with the reason, and functions that may have its place.

    Returns the number of stale faults.
    """
    stale = 0
    for fault in faults:
        reason = reason_stale(fault)
        if not reason:
            continue
        stale += 1
        print(f"{fault.what}\n    {reason}")
        paths = candidates(fault)[:MOST_CANDIDATES]
        if paths:
            print(f"    now perhaps: {', '.join(paths)}")
    print(f"{stale} of {len(faults)} faults are stale")
    return stale


if __name__ == "__main__":
    raise SystemExit(main())
