"""Print the table of faults, or with --check those that no longer fit the code."""

import argparse
from collections import Counter

from breaking import FAULTS
from breaking.check import places_of, reason_stale


def main():
    """Print what the options ask for."""
    parser = argparse.ArgumentParser(prog="python -m breaking", description=__doc__)
    parser.add_argument(
        "--check",
        action="store_true",
        help="apply each fault, and list those whose place in the code is gone",
    )
    parser.add_argument(
        "words", nargs="?", default="", help="only faults whose room or path has this"
    )
    options = parser.parse_args()
    faults = [f for f in FAULTS.values() if options.words in f"{f.room} {f.path}"]
    if options.check:
        return print_stale(faults)
    return print_table(faults)


def print_table(faults):
    """Print one line for each fault, and how many are seen by what."""
    for fault in faults:
        seen = fault.test or f"{fault.case}: {fault.quantity}"
        print(f"{fault.room:<12}{fault.seen_by:<8}{fault.what:<66}{seen}")
    counts = Counter(fault.seen_by for fault in faults)
    numbers = ", ".join(f"{count} by {seer}" for seer, count in counts.items())
    print(f"{len(faults)} faults: {numbers}")


def print_stale(faults):
    """Print each stale fault with the reason, and where its place may be now.

    Return how many are stale.
    """
    stale = 0
    for fault in faults:
        reason = reason_stale(fault)
        if not reason:
            continue
        stale += 1
        print(f"{fault.what}\n    {reason}")
        names = places_of(fault.path, fault.place) if fault.place else []
        if names:
            print(f"    the place is in {', '.join(names)}")
    print(f"{stale} of {len(faults)} faults are stale")
    return stale


if __name__ == "__main__":
    raise SystemExit(main())
