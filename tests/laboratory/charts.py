"""The command of a study of the laboratories: `python -m laboratory.NAME [--full]`."""

import argparse
import sys
from pathlib import Path

from epcontact.studies.frame import Study, save_charts


def save(study: Study) -> None:
    """Run the study with the options of the command line, save its charts, and print
    their paths.
    """
    parser = argparse.ArgumentParser(description=study.description)
    parser.add_argument("--full", action="store_true", help="minutes, and finer")
    parser.add_argument("--output", type=Path, default=Path("charts"))
    arguments = parser.parse_args()

    def say(sentence: str) -> None:
        """Print a sentence on stderr."""
        print(sentence, file=sys.stderr)

    charts = study.run(say, full=arguments.full)
    for path in save_charts(study.name, charts, arguments.output):
        print(path)
    for chart in charts:
        print(chart.caption)
