"""Forms of characters for terminals and files whose encoding lacks them."""

from __future__ import annotations

import codecs
import unicodedata

#: Name of the handler of encoding errors, for `open(..., errors=...)`.
ASCII_FORMS = "epcontact-ascii-forms"

_FORMS = {
    "±": "+-",
    "µ": "u",
    "μ": "u",
    "×": "x",
    "·": "*",
    "–": "-",
    "—": "-",
    "−": "-",
    "…": "...",
    "√": "sqrt",
    "≤": "<=",
    "≥": ">=",
    "≈": "~",
    "°": "deg",
    "²": "^2",
    "³": "^3",
    "⁻": "^-",
    "σ": "sigma",
    "ξ": "xi",
    "ν": "nu",
    "γ": "gamma",
    "\N{NO-BREAK SPACE}": " ",
}


def ascii_form(character: str) -> str:
    """Return the ASCII form of a character, such as "+-" for "±" or "o" for "ö".

    A character that has none becomes "?".
    """
    if character in _FORMS:
        return _FORMS[character]
    decomposed = unicodedata.normalize("NFKD", character)
    return decomposed.encode("ascii", "ignore").decode() or "?"


def _forms_of_error(error: UnicodeError) -> tuple[str, int]:
    """Return the ASCII forms of the characters that an encoding lacks, and the position
    at which the encoding goes on.

    Raises `error` itself if it is not an error of encoding.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    return "".join(map(ascii_form, characters)), error.end


def encodable(text: str, encoding: str | None) -> str:
    """Return a text in which each character that an encoding lacks has its ASCII form.

    Args:
        text: The text.
        encoding: Name of the encoding; None: the text is returned unchanged.
    """
    if encoding is None:
        return text
    return text.encode(encoding, ASCII_FORMS).decode(encoding)


codecs.register_error(ASCII_FORMS, _forms_of_error)
