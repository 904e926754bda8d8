"""Print the table of faults: what is wrong, where, and what sees it."""

from collections import Counter

from breaking import FAULTS


def main():
    """Print one line for each fault, and how many are seen by what."""
    for fault in FAULTS.values():
        seen = fault.test or f"{fault.case}: {fault.quantity}"
        print(f"{fault.room:<12}{fault.seen_by:<8}{fault.what:<66}{seen}")
    counts = Counter(fault.seen_by for fault in FAULTS.values())
    print(
        f"{len(FAULTS)} faults: "
        + ", ".join(f"{n} by {by}" for by, n in counts.items())
    )


if __name__ == "__main__":
    main()
