"""Units and sizes that the header of a text file states.

The lines are those of Gwyddion, SPIP, WSxM, Nova and Keyence, of the software of stylus
instruments, and others of the same form: a word for the quantity, a number with its
unit, or the unit alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

#: The value in m of each word for a unit of length, in lower case.
UNITS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    "cm": 1e-2,
    **dict.fromkeys(("mm", "millimeter", "millimeters"), 1e-3),
    **dict.fromkeys(("millimetre", "millimetres"), 1e-3),
    **dict.fromkeys(("µm", "um", "micron", "microns", "mikrometer"), 1e-6),
    **dict.fromkeys(("micrometer", "micrometers", "micrometre", "micrometres"), 1e-6),
    **dict.fromkeys(("nm", "nanometer", "nanometers"), 1e-9),
    **dict.fromkeys(("nanometre", "nanometres"), 1e-9),
    **dict.fromkeys(("å", "angstrom", "angstroms", "ångström"), 1e-10),
    "pm": 1e-12,
    **dict.fromkeys(("inch", "inches"), 25.4e-3),
    **dict.fromkeys(("mil", "mils"), 25.4e-6),
    **dict.fromkeys(("µin", "uin"), 25.4e-9),
}
_WORDS = "|".join(sorted(UNITS, key=len, reverse=True))
#: A unit that ends where its word ends.
_UNIT = rf"(?:{_WORDS})(?![^\W_])"
_NUMBER = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?"
#: Units of values that are no heights, in lower case.
_NO_LENGTHS = r"(?:[mµunpk]?v|[mµunp]a|a|deg|°|rad|k?hz|[mµunp]?n|%|counts?)"
#: What may stand between a word and its value.
_GAP = r"[\s:=：;,]+"

#: Words for the number that marks points without a height.
_NO_DATA = (
    r"(?:no[-_ ]?data|missing|invalid|bad|void)[-_ ]?(?:value|data|pixel|point)s?"
)

#: Words for the length of a map along x and y, and for the spacing of its points.
_X_LENGTH = (
    r"(?:x[-_ ]?(?:length|size|range|amplitude|extent|dimension|scan[-_ ]?size)"
    r"|width|breite|largeur|anchura|larghezza"
    r"|(?:scan|profile)[-_ ]?(?:length|len|range|width))"
)
#: Words for one length of a square map, or for both lengths.
_BOTH_LENGTHS = r"(?:scan|image|map|field)[-_ ]?size"
#: Words whose number is the number of points if it has no unit: "Width: 1024".
_MAY_BE_POINTS = rf"width|height|breite|höhe|{_BOTH_LENGTHS}|[xy][-_ ]?(?:size|dim)"
#: The line with which the header of a text file of SPIP begins; it has lengths in nm.
_SPIP = "file format = ascii"
_Y_LENGTH = (
    r"(?:y[-_ ]?(?:length|size|range|amplitude|extent|dimension|scan[-_ ]?size)"
    r"|height|höhe|hauteur|altura|altezza)"
)
_PIXEL = r"(?:pixel[-_ ]?(?:size|spacing|pitch)|xy[-_ ]?calibration"
_PIXEL += r"|lateral[-_ ]?(?:resolution|sampling|calibration|spacing)"
_PIXEL += r"|(?:sampling|sample|point|data|measuring)[-_ ]?"
_PIXEL += r"(?:distance|interval|step|spacing|pitch)|step[-_ ]?(?:size|width)?"
_PIXEL += r"|spacing|pitch)"
_STEP = r"(?:increment|step|spacing|pitch|pixel[-_ ]?size|calibration|interval|scale)"
_X_PIXEL = rf"(?:x[-_ ]?{_STEP}|scale[-_ ]?x|d[-_ ]?x|delta[-_ ]?x)"
_Y_PIXEL = rf"(?:y[-_ ]?{_STEP}|scale[-_ ]?y|d[-_ ]?y|delta[-_ ]?y)"
_UNIT_OF_HEIGHTS = (
    r"(?:(?:value|values|z|height|heights|vertical|data)[-_ ]?units?"
    r"|units?[-_ ]?(?:of[-_ ])?(?:the[-_ ])?(?:values?|z|heights?|data)"
    r"|(?:werte?|höhen)?[-_ ]?einheiten?(?: der (?:werte|höhen))?"
    r"|z[-_ ]?ax(?:is|e)|unités(?: de valeur)?|unità valore|unidades de valor)"
)
_UNIT_OF_LENGTHS = (
    r"(?:x(?=\s*[(\[/])|(?:x|xy|x[-_ ]?y|lateral|length|horizontal)[-_ ]?units?"
    r"|units?[-_ ]?(?:of[-_ ])?(?:the[-_ ])?(?:x|xy|lengths?)|x[-_ ]?ax(?:is|e))"
)
#: A number that is the value of something, such as "0.8 mm", "2.5 [µm]", "= 5" or
#: "(mm) 5"; the heading of a column holds none.
_VALUE = rf"(?<![\w.,]){_NUMBER}\s*{_UNIT}|\d[.,]\d+\s*[(\[]|[:=)\]]\s*{_NUMBER}"
#: A word for heights, other words, and their unit: "heights, in micrometres"; no number
#: follows, as in "range of z (mm): 2".
_HEIGHTS_IN = (
    rf"\b(?:heights?|z|values?|höhen?)\b[^:=\d(\[]*?"
    rf"(?:\bin\s+|[(\[/]\s*)(?P<unit>{_UNIT})(?![\s)\]:=]*\d)"
)


@dataclass(frozen=True)
class StatedLength:
    """A length that a header states."""

    value: float  #: The length in m.
    source: str  #: The line of the header that states it.


@dataclass(frozen=True)
class StatedScale:
    """The units and lengths that the header of a text file states."""

    unit: float | None = None  #: Unit of the heights in m.
    unit_source: str = ""  #: The line of the header that states it.
    x_length: StatedLength | None = None  #: Length of the map along x.
    y_length: StatedLength | None = None  #: Length of the map along y.
    x_pixel: StatedLength | None = None  #: Distance of its points along x.
    y_pixel: StatedLength | None = None  #: Distance of its points along y.
    no_length: str = ""  #: The line that states a unit which is no length, if any.
    length_unit: float | None = None  #: Unit of x in m, stated in a line of its own.
    #: Units of the columns of a list of points in m, None for a column without one.
    columns: tuple[float | None, ...] = ()


def unit_in_metres(word: str) -> float | None:
    """Return the value in m of a word for a unit of length; None if it is no such word.

    Args:
        word: the unit, such as "nm", "µm" or "microns", in any case.
    """
    word = _plain(word).strip()
    return 1e-10 if word in ("a", "ang") else UNITS.get(word)


def read_scale(header: list[str]) -> StatedScale:
    """Return the units and lengths that the lines of a header state.

    The first line that states a quantity counts.  A length without a unit is in the
    unit of lengths that another line states, in nm in files of SPIP, and is left out
    otherwise.

    Args:
        header: the lines above the table of numbers, with their marks of comments.
    """
    lines = [(_plain(line).strip(' #%;,"*!\\\t\r\n'), line) for line in header]
    unit, unit_source = _find_unit(lines, rf"^{_UNIT_OF_HEIGHTS}\b")
    columns = _column_units([plain for plain, _ in lines])
    if unit is None:
        unit, unit_source = _find_unit(lines, r"^units?\b")
        if unit is not None and not columns:
            columns = (unit, unit)  # of all that the file lists
    if unit is None:
        for plain, line in lines:
            match = re.search(_HEIGHTS_IN, plain)
            if match:
                unit = UNITS[match["unit"]]
                unit_source = _shown(line)
                break
    if unit is None:
        # WSxM states how far the heights of a map reach, in their unit.
        for plain, line in lines:
            match = re.search(
                rf"^z amplitude{_GAP}{_NUMBER}\s*(?P<unit>{_UNIT})", plain
            )
            if match:
                unit = UNITS[match["unit"]]
                unit_source = _shown(line)
    no_length = ""
    for plain, line in lines:
        if re.search(rf"^{_UNIT_OF_HEIGHTS}\b[^\w%°]*{_NO_LENGTHS}[\s)\]]*$", plain):
            no_length = _shown(line)
    length_unit, _ = _find_unit(lines, rf"^{_UNIT_OF_LENGTHS}\b")
    if length_unit is None and any(line == _SPIP for line, _ in lines):
        length_unit = 1e-9
    both = _find_lengths(lines, _BOTH_LENGTHS, length_unit)
    pixel = _find_lengths(lines, _PIXEL, length_unit)
    x_length = _find_lengths(lines, _X_LENGTH, length_unit) or both
    y_length = _find_lengths(lines, _Y_LENGTH, length_unit) or both[1:]
    x_pixel = _find_lengths(lines, _X_PIXEL, length_unit) or pixel
    y_pixel = _find_lengths(lines, _Y_PIXEL, length_unit) or pixel
    return StatedScale(
        unit,
        unit_source,
        x_length[0] if x_length else None,
        y_length[-1] if y_length else None,
        x_pixel[0] if x_pixel else None,
        y_pixel[-1] if y_pixel else None,
        no_length,
        length_unit,
        columns,
    )


def missing_mark(header: list[str]) -> float | None:
    """Return the number that a header names as that of points without a height.

    None if it names none.  A line such as "NODATA_value -9999" or "No data value: 0".

    Args:
        header: the lines above the table of numbers.
    """
    for line in header:
        match = re.search(rf"^\W*{_NO_DATA}{_GAP}(?P<mark>{_NUMBER})\W*$", _plain(line))
        if match:
            return float(match["mark"].replace(",", "."))
    return None


def _plain(line: str) -> str:
    """Return a line in lower case, without quotes and with one sign for micro and Å."""
    line = line.replace('"', "").replace("\u03bc", "\u00b5").replace("\u212b", "\u00c5")
    return line.lower()


def _shown(line: str) -> str:
    """Return a line of a header as a message shows it."""
    return " ".join(line.replace('"', "").strip(" #%;,*!\\\t\r\n").split())[:60]


def _find_unit(lines: list[tuple[str, str]], words: str) -> tuple[float | None, str]:
    """Return the unit in m that follows given words, and the line; None and "" if none.

    Args:
        lines: each line of the header, in lower case and as it is.
        words: a pattern of the words in front of the unit.
    """
    for plain, line in lines:
        match = re.search(rf"{words}[^\w%]*(?P<unit>{_UNIT})[\s)\]]*$", plain)
        if match:
            return UNITS[match["unit"]], _shown(line)
    return None, ""


def _find_lengths(
    lines: list[tuple[str, str]], words: str, length_unit: float | None
) -> list[StatedLength]:
    """Return the first positive length that follows given words, or the first two.

    Two lengths are those along x and y: "Scan size: 10 x 5 µm".

    Args:
        lines: each line of the header, in lower case and as it is.
        words: a pattern of the words in front of the number.
        length_unit: the unit in m of numbers without one; None leaves these out.  A
            number that may be that of the points is left out, too.

    Returns:
        One length, two, or none if no line states it.
    """
    pattern = (
        rf"^{words}\s*(?:[(\[/]\s*(?P<before>{_UNIT})[^)\]:=;,]*[)\]]?)?{_GAP}"
        rf"(?P<x>{_NUMBER})(?:\s*(?:{_UNIT})?\s*[x×*]\s*(?P<y>{_NUMBER}))?"
        rf"[\s,;(\[]*(?P<after>{_UNIT})?"
    )
    for plain, line in lines:
        match = re.search(pattern, plain)
        if not match:
            continue
        word = match["before"] or match["after"]
        if not word and re.match(_MAY_BE_POINTS, plain):
            continue
        unit = UNITS[word] if word else length_unit
        lengths = []
        for number in (match["x"], match["y"]):
            value = float((number or "0").rstrip(",.").replace(",", "."))
            if unit and value > 0:
                lengths.append(StatedLength(value * unit, _shown(line)))
        if lengths:
            return lengths
    return []


def _column_units(lines: list[str]) -> tuple[float | None, ...]:
    """Return the unit in m of each column of a list of points, () if none is stated.

    The last line counts that has two or three units in brackets, behind a stroke or
    behind a word: "x [mm]; z [µm]", "Lateral um, Profile Å", "mm nm".  A line with
    values, such as "Cutoff 0.8 mm; tip radius 2 µm", is none.

    Args:
        lines: the lines of the header in lower case.
    """
    for line in reversed(lines):
        if re.search(_VALUE, line):
            continue
        bracketed = re.findall(rf"[(\[/]\s*({_UNIT}|a(?=\s*[)\]]))", line)
        if len(bracketed) in (2, 3):
            return tuple(unit_in_metres(word) for word in bracketed)
        cells = re.split(r"\s*[;,\t]\s*", line)
        if len(cells) < 2:
            cells = line.split()
        words = [re.search(rf"(?:^|\s)({_UNIT}|a|ang)$", cell) for cell in cells]
        units = [unit_in_metres(word[1]) if word else None for word in words]
        if len(cells) in (2, 3) and units[-1] and units[-2]:
            return tuple(units)
    return ()
