"""Addresses of databases: how they are told from folders, and what of them nobody may see."""

import re
from collections.abc import Callable, Iterable
from urllib.parse import parse_qsl, quote, quote_plus, unquote

_ODD = re.compile(
    r":.*@|(?:^|[?&\s])(password|passwd|pwd)\s*=|^\W*postgres\w*\W.*@", re.IGNORECASE | re.DOTALL
)
_SHORTEST = 3  # characters; less can't be told from the words around it
_SPELLINGS: tuple[Callable[[str], str], ...] = (quote, quote_plus, lambda secret: repr(secret)[1:-1])
_KEYS = ("password", "passwd", "pwd", "sslpassword")


def is_like_one(text: str) -> bool:
    """Whether a text that is no address can only have been meant as one, and may hold a password."""
    return _ODD.search(text) is not None


def is_clear(address: str) -> bool:
    """Whether an address can be read in one way only: `@` stands once at most, behind user and password."""
    before, at, _ = address.partition("://")[2].rpartition("@")
    return not at or re.search(r"[@/?#\s]", before) is None


def secrets_of(address: str) -> list[str]:
    """What of an address nobody may see, as it is written and as it is meant; the longest first."""
    login = re.split(r":/*|//", address, maxsplit=1)[-1].rpartition("@")[0]
    user, _, password = login.partition(":")
    found = [login, password, f'"{user}"', f"'{user}'", f'"{unquote(user)}"', f"'{unquote(user)}'"]
    query = parse_qsl(address.partition("?")[2])
    found += [value for key, value in query if key in _KEYS]
    found += [quoted for key, value in query if key == "user" for quoted in (f'"{value}"', f"'{value}'")]
    found += [unquote(secret) for secret in found]
    found += [spell(secret) for secret in found for spell in _SPELLINGS]
    return sorted({secret for secret in found if len(secret) >= _SHORTEST}, key=len, reverse=True)


def without(text: str, secrets: Iterable[str]) -> str:
    """The text with `…` for each of them."""
    for secret in secrets:
        text = text.replace(secret, "…")
    return text
