"""Text that came from a user or a file, made safe for one line of a terminal; without loading Rich."""

import re

_SECRET = re.compile(r"(:/{1,2}[^:/@\s]{0,200}):\S*@|(?i:(password|passwd|pwd)=)[^\s&\"']+")


def without_secrets(text: str) -> str:
    """The text without the password of any address in it."""
    return _SECRET.sub(lambda found: f"{found[1]}:…@" if found[1] is not None else f"{found[2]}=…", text)


def one_line(text: str) -> str:
    """The text with every character that could steer a terminal or break the line made visible."""
    return "".join(character if character.isprintable() else _shown(character) for character in text)


def _shown(character: str) -> str:
    return " " if character in "\n\t" else character.encode("unicode_escape", "backslashreplace").decode()
