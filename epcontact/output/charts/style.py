"""The look of every picture: colours, marks, sizes, units.

The colours are those of Okabe and Ito (2008), which people with any colour vision can
distinguish; series differ in their marks and dashes as well.  Contact states have the
same colours in every picture, matplotlib's or VTK's.  Pressure runs from yellow to
dark.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from epcontact.results import APART, ELASTIC, PLASTIC

STATE_COLOURS = {APART: "#ffffff", ELASTIC: "#f0c419", PLASTIC: "#000000"}
STATE_NAMES = {APART: "apart", ELASTIC: "elastic", PLASTIC: "plastic"}

#: Sequential and diverging colour maps (names that matplotlib and pyvista share).
PRESSURE_MAP = "viridis_r"
STRESS_MAP = "viridis"
DIFFERENCE_MAP = "RdBu_r"

#: A method has the same colour in every chart.
METHOD_COLOURS = {"persson": "#000000", "bem": "#0072b2", "fem": "#d55e00"}
CYCLE = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#7f7f7f",
    "#000000",
)
#: The parts of a contact area have the colours of their states.
PART_COLOURS = {
    "total": CYCLE[0],
    **{STATE_NAMES[k]: STATE_COLOURS[k] for k in (ELASTIC, PLASTIC)},
}
#: Their numbers have no factor in common with that of the colours, so that looks differ
#: for long.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "h")
DASHES = ("-", "--", "-.")

#: matplotlib settings; text is drawn as paths, so that an SVG looks the same
#: everywhere.
SETTINGS: Mapping[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "mathtext.fontset": "dejavusans",
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "figure.dpi": 100.0,
    "savefig.dpi": 160.0,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "epcontact",
}

_PREFIXES = {"T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3} | {
    "": 1.0,
    "m": 1e-3,
    "µ": 1e-6,
    "n": 1e-9,
}

#: Symbols as code and cases write them, as mathtext, and as text.
_SYMBOLS = (
    (
        r"E\* ?xi ?/ ?(?:sigma_Y|yield stress)",
        r"$E^*\xi\,/\,\sigma_\mathrm{Y}$",
        "E*ξ/σ_Y",
    ),
    (r"/ ?\(E\* ?xi\)", r"$/\,(E^*\xi)$", "/(E*ξ)"),
    (r"E\* ?xi", r"$E^*\xi$", "E*ξ"),
    (r"\bsigma_Y\b", r"$\sigma_\mathrm{Y}$", "σ_Y"),
    (r"\bsigma_P\b", r"$\sigma_\mathrm{P}$", "σ_P"),
    (r"\bp0\b", r"$p_0$", "p₀"),
    (r"\bnu(?= = )", r"$\nu$", "ν"),
    (r"(?<=\de-)0", "", ""),  # 1e-08
)


def typeset(text: str, *, mathtext: bool = True) -> str:
    """Return a label or caption with its symbols typeset, as mathtext or in plain
    Unicode.
    """
    for pattern, math_text, plain in _SYMBOLS:
        text = re.sub(
            pattern, (math_text if mathtext else plain).replace("\\", r"\\"), text
        )
    return text


def unit_for(largest: float, unit: str) -> tuple[float, str]:
    """Return the scale and the name of the prefixed unit that suit the largest value in
    a unit.
    """
    size = abs(largest)
    if not math.isfinite(size) or size == 0:
        return 1.0, unit
    fitting = (p for p, s in _PREFIXES.items() if size >= s and (unit != "m" or s <= 1))
    prefix = next(fitting, "n")
    return _PREFIXES[prefix], prefix + unit
