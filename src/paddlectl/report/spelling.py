"""Symbols that an encoding lacks, spelled in what it has. Without Rich, for errors are told by it too."""

import codecs

ERRORS = "paddlectl.spelled"
"""The name of the error handler by which a stream spells what its encoding lacks."""

# The percent sign is what cp864 lacks, and the rest is beyond ASCII.
_SPELLED = {
    "Ψ": "Psi", "ψ": "psi", "Φ": "Phi", "Λ": "Lambda", "γ": "gamma", "π": "pi", "ε": "epsilon", "²": "^2",
    "→": "->", "←": "<-", "≥": ">=", "≤": "<=", "≠": "!=", "×": "x", "·": "*", "−": "-", "%": "pct",
    "…": "...", "–": "-", "—": "-", "‘": "'", "’": "'", "“": '"', "”": '"', "•": "*",
    "\xa0": " ",
    "─": "-", "━": "-", "╸": "-", "╺": "-", "│": "|", "╭": "+", "╮": "+", "╰": "+", "╯": "+",
    "\ufffd": "?", "▁": "_", "▂": ".", "▃": ":", "▄": "-", "▅": "=", "▆": "+", "▇": "*", "█": "#",
}  # fmt: skip


def spelled(text: str, encoding: str) -> str:
    """The text as a stream of that encoding shows it."""
    return text.encode(encoding, ERRORS).decode(encoding)


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_SPELLED.get(character) or _escaped(character) for character in lacking), error.end


def _escaped(character: str) -> str:
    return character.encode("ascii", "backslashreplace").decode()


codecs.register_error(ERRORS, _spell)
