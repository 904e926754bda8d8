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

from epcontact.errors import without_controls
from epcontact.results import APART, ELASTIC, PLASTIC

#: A point without contact that an earlier, larger load has flattened.  Results do not
#: have this state, but pictures show it beside the contact states.
FLATTENED = 3
#: The colours and the names of the states of a point.
STATE_COLOURS = {
    APART: "#ffffff",
    ELASTIC: "#f0c419",
    PLASTIC: "#000000",
    FLATTENED: "#4a7fb0",
}
STATE_NAMES = {
    APART: "apart",
    ELASTIC: "elastic",
    PLASTIC: "plastic",
    FLATTENED: "apart, flattened",
}

#: Sequential and diverging colour maps (names that matplotlib and pyvista share).
PRESSURE_MAP = "viridis_r"
STRESS_MAP = "viridis"
DIFFERENCE_MAP = "RdBu_r"

#: A method has the same colour in every chart; other series take those of the cycle.
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
#: The parts of a contact area have the colours of their states; elastic is darker,
#: because a yellow line on white paper is hard to see, above all in grey.
PART_COLOURS = {
    "total": CYCLE[0],
    STATE_NAMES[ELASTIC]: "#c47f00",
    STATE_NAMES[PLASTIC]: STATE_COLOURS[PLASTIC],
}
#: The numbers of marks, dashes and colours have no common factor, so that many series
#: look different before a look repeats.
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
    # The layout and the picture need the sizes of the same texts, which matplotlib
    # measures once for each resolution.
    "figure.dpi": 160.0,
    "savefig.dpi": 160.0,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "epcontact",
}

#: Prefixes of units, from the largest to the smallest.
_PREFIXES = {
    "T": 1e12,
    "G": 1e9,
    "M": 1e6,
    "k": 1e3,
    "": 1.0,
    "m": 1e-3,
    "µ": 1e-6,
    "n": 1e-9,
}

#: Symbols as code and cases write them (a regular expression), as mathtext, and as
#: text.
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
    (r"(?<!\\)\bzeta(?= = )", r"$\zeta$", "ζ"),
    (r"(?<=\de-)0", "", ""),  # 1e-08
)
#: Relative differences below this are those of rounding, and are shown without digits.
_ROUNDING = 1e-6


def label_text(words: str) -> str:
    """Return words as matplotlib shows them unchanged: without mathtext and controls.

    Names of methods, surfaces and points of a sweep pass through this function, because
    they may hold the name of a file: a "$" in it would begin a formula.
    """
    return without_controls(words).replace("$", r"\$")


def typeset(text: str, *, mathtext: bool = True) -> str:
    """Return a label or caption with its symbols typeset.

    Args:
        text: the text, with symbols such as "sigma_P" or "E* xi".
        mathtext: True to replace symbols by matplotlib's mathtext between dollar signs,
            False to replace them by Unicode letters.
    """
    for pattern, math_symbol, plain_symbol in _SYMBOLS:
        symbol = math_symbol if mathtext else plain_symbol
        text = re.sub(pattern, symbol.replace("\\", r"\\"), text)
    return text


def difference_text(difference: float) -> str:
    """Return an absolute relative difference as text in per cent, with two digits.

    Differences below a millionth are those of rounding and have no digits.
    """
    if difference < _ROUNDING:
        return "< 0.0001 %"
    two_digits = float(f"{100 * difference:.2g}")
    return f"{two_digits:g} %"


def unit_for(largest: float, unit: str) -> tuple[float, str]:
    """Return the prefixed unit, such as "MPa", in which values are easy to read.

    Args:
        largest: the largest value, in `unit`; its sign does not matter.  If it is 0 or
            not finite, the unit keeps no prefix.
        unit: a unit without a prefix, such as "Pa"; for "m" no prefix above 1 is used.

    Returns:
        The number by which values in the unit are divided, and the prefixed unit.
    """
    size = abs(largest)
    if not math.isfinite(size) or size == 0:
        return 1.0, unit
    for prefix, scale in _PREFIXES.items():
        if size >= scale and (unit != "m" or scale <= 1):
            return scale, f"{prefix}{unit}"
    return _PREFIXES["n"], f"n{unit}"
