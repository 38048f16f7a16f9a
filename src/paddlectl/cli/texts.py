"""Text that came from a user or a file, made safe for one line of a terminal; without loading Rich."""

import os
import re
import sys

from paddlectl.registry.addresses import secrets_of, without

_LOGIN = re.compile(r"(:/+|\w//).*@|(://)[^\s/@]*:[^@\s]*")  # the latter where a message was cut
_KEY = re.compile(r"((?:password|passwd|pwd)=)[^\s&\"']+", re.IGNORECASE)


def without_secrets(text: str) -> str:
    """The text without user and password of any address in it, or among what the command was given."""
    for given in (*sys.argv[1:], os.environ.get("PADDLECTL_REGISTRY", "")):
        text = without(text, secrets_of(given))
    text = _LOGIN.sub(lambda found: f"{found[1]}…@" if found[1] else f"{found[2]}…", text)
    return _KEY.sub(r"\1…", text)


def one_line(text: str) -> str:
    """The text with every character that could steer a terminal or break the line made visible."""
    return "".join(character if character.isprintable() else _shown(character) for character in text)


def _shown(character: str) -> str:
    return " " if character in "\n\t" else character.encode("unicode_escape", "backslashreplace").decode()
