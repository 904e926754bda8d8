"""What people read, as lines: of terminals, pages, charts, tables and files of results.

Beside a file of such lines that was read and found right, words must be the same, and
numbers to 3 % or a step of their last digit.  Whatever moves is seen; what is right is
shown by other tests.
"""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex

from epcontact.output.vtk import read_fields

NUMBER = re.compile(
    r"(?<![\w.#])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?![\w.])|\bnan\b"
)
#: Lines that are those of a clock, a machine, a version or the rounding.
OWN = re.compile(
    "measured_|resid|certified|second|MiB|memory|version|numba|digest| made |counts"
    "|history|iterations| cost|points times|scene:|[|] yes [|]"
    "|^(inputs|theory|boundary|finite|J2|after).* \\|"
)


def lasting(lines):
    """The lines that are the same on every machine, without hashes and numbers of
    versions.
    """
    varying = re.compile(r"(?<![\w.])(?=\d*[a-f])[0-9a-f]{12,}\b|\d+(\.\d+){2,}")
    return [varying.sub("*", line) for line in map(str, lines) if not OWN.search(line)]


def same_as_read(lines, name, folder, counted="(?!)"):
    """Compare lines with a file in `read`, but only the words of those that begin as
    `counted`.
    """
    found = [" ".join(line.split()) for line in lines]
    (folder / name).write_text("\n".join(found) + "\n", "utf-8")
    file = Path(__file__).parent / "read" / name
    told = f"; cp {folder / name} {file} if all that differs is right"
    known = file.read_text("utf-8").splitlines()
    for line, expected in zip(found, known, strict=False):
        numbers = not re.match(counted, expected)
        bare, mark = (
            (NUMBER.pattern, "#") if numbers else (rf"[,; ]|{NUMBER.pattern}", "")
        )
        assert re.sub(bare, mark, line) == re.sub(bare, mark, expected), told
        pairs = zip(NUMBER.findall(line), NUMBER.findall(expected), strict=True)
        for one, other in pairs if numbers else ():
            size, _, power = other.partition("e")
            step = 1.01 * 10.0 ** (int(power or 0) - len(size.partition(".")[2]))
            near = pytest.approx(
                float(other), rel=0.03, abs=step * ("." in size), nan_ok=True
            )
            assert float(one) == near, f"{line}, not {expected}{told}"
    assert len(found) == len(known), told


def told(values):
    """Numbers by their count, their size, and two means over it, of which one knows
    their order.
    """
    values = np.ravel(np.asarray(values, dtype=float))
    values = values[np.isfinite(values)]
    if values.size < 4:
        return ", ".join(f"{value:.4g}" for value in values)
    size = np.abs(values).mean()
    means = values.mean(), (values * np.cos(1 + np.arange(values.size))).mean()
    return f"{values.size} of {size:.4g}, " + ", ".join(
        f"{m / (size or 1):.2f}" for m in means
    )


def lines_of_page(page):
    """Headings, paragraphs and rows of a parsed page."""
    for each in page.iter():
        if each.tag in ("tr", "h1", "h2", "h3", "p", "li", "summary"):
            yield (
                " | ".join("".join(cell.itertext()) for cell in each)
                if each.tag == "tr"
                else ("".join(each.itertext()))
            )


def lines_of_chart(name, chart):
    """The words, and the place and look of all that is drawn, and the columns of its
    table.
    """
    yield f"{name}: {chart.caption}"
    for title, column in zip(chart.header, zip(*chart.rows, strict=True), strict=True):
        words = dict.fromkeys(one for one in column if isinstance(one, str))
        numbers = told([one for one in column if not isinstance(one, str)])
        yield f"{name}, {title}: {', '.join(words)} {numbers}"
    for axes in chart.figure.axes:
        words = [axes.get_title(), *(text.get_text() for text in axes.texts)]
        words += [
            getattr(axes, f"get_{way}{what}")()
            for way in "xy"
            for what in ("label", "scale")
        ]
        yield f"{name}, axes: {' | '.join(words)} | {told(axes.axis())}"
        for line in axes.lines:
            look = [
                line.get_color(),
                line.get_marker(),
                line.get_fillstyle(),
                line.get_linestyle(),
            ]
            yield f"{name}, line: {look} {told(line.get_xdata())}; {told(line.get_ydata())}"
        for each in axes.collections:
            colours = [
                to_hex(c)
                for c in (*each.get_facecolor()[:1], *each.get_edgecolor()[:1])
            ]
            ends = [path.vertices for path in each.get_paths()] or [[]]
            yield f"{name}, {type(each).__name__}: {colours} {told(np.concatenate(ends))}"
            yield f"{name}, sizes: {told([np.ptp(bar, axis=0).sum() for bar in ends if len(bar)])}"
        for image in axes.images:
            field = told(
                np.ma.filled(np.ma.asarray(image.get_array(), dtype=float), np.nan)
            )
            ends = told(image.get_extent()), told(image.get_clim())
            yield f"{name}, image: {image.get_cmap().name} {field}; {ends}"
    for legend in (
        *chart.figure.legends,
        *(axes.get_legend() for axes in chart.figure.axes),
    ):
        for text, key in (
            zip(legend.texts, legend.legend_handles, strict=True) if legend else ()
        ):
            colour = getattr(key, "get_facecolor", getattr(key, "get_color", None))()
            yield f"{name}, legend: {text.get_text()} {to_hex(colour)}"


def lines_of_data(value, at):
    """The names and values of a file of JSON."""
    if isinstance(value, dict):
        rounding = (
            ("value", "difference") if OWN.search(str(value.get("quantity"))) else ()
        )
        for name in (name for name in value if name not in rounding):
            yield from lines_of_data(value[name], f"{at} {name}")
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for number, one in enumerate(value):
            yield from lines_of_data(one, f"{at} {number}")
    else:
        numbers = (
            isinstance(value, list) and len(value) > 3 and isinstance(value[0], float)
        )
        yield f"{at}: {told(value) if numbers else value}"


def lines_of_file(path):
    """What is in a file of results."""
    if path.suffix == ".json":
        yield from lines_of_data(json.loads(path.read_text("utf-8")), path.name)
    elif path.suffix == ".csv":
        for name, column in pd.read_csv(path).items():
            words = pd.api.types.is_string_dtype(column)
            shown = ", ".join(dict.fromkeys(column)) if words else told(column)
            yield f"{path.name} {name}: {shown}"
    elif path.suffix == ".vti":
        file = read_fields(path)
        yield f"{path.name}: {told(file.spacing)}"
        yield from (
            f"{path.name} {n}: {told(f)} {file.units.get(n)}"
            for n, f in file.fields.items()
        )
        yield from (
            f"{path.name} {n}: {v} {file.units.get(n)}"
            for n, v in file.attributes.items()
        )
    elif path.suffix in (".txt", ".pvd"):
        yield f"{path.name}: {path.read_text('utf-8')}"
