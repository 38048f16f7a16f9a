"""Text that came from a user or a file, made safe for one line of a terminal; without loading Rich."""

import os
import re
import sys

from paddlectl.registry.index.addresses import secrets_of, without
from paddlectl.registry.names import quoted

# The latter where a message was cut; a Ray cluster's address has no login.
_LOGIN = re.compile(r"(:/+|\w//).*@|(?<!ray)(://)[^\s/@]*:[^@\s]*")
_KEY = re.compile(r"((?:password|passwd|pwd)=)[^\s&\"']+", re.IGNORECASE)


_COMMAND = re.compile(
    r"paddlectl (compare|evaluate|explain|export|label|plot|policies|registry|resume|runs|show"
    r"|similarity|sweep|train|transfer|watch)\b"
    r"(?: [^\s,;()]+(?:,[^\s,;()]+)*)*"
)
_WITHOUT_TASKS = {"export", "label", "policies", "registry", "runs"}


def here(text: str) -> str:
    """The text with what this command line has of `--registry` and `--tasks` at the commands in it.

    So they can be typed as they are. A password in it isn't told again.
    """
    files = "".join(f" --tasks {quoted(file)}" for file in _given("--tasks"))
    place = "".join(f" --registry {quoted(without_secrets(each))}" for each in _given("--registry")[-1:])

    def placed(found: re.Match[str]) -> str:
        if "--help" in found[0]:
            return found[0]
        return f"{found[0]}{'' if found[1] in _WITHOUT_TASKS else files}{place}"

    return _COMMAND.sub(placed, text)


def _given(option: str) -> list[str]:
    """What this command line has of an option."""
    given = []
    for word, after in zip(sys.argv, [*sys.argv[1:], ""], strict=True):
        if word == option:
            given.append(after)
        elif word.startswith(f"{option}="):
            given.append(word.partition("=")[2])
    return list(filter(None, given))


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
