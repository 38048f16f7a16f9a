"""Text that came from a user or a file, made safe for one line of a terminal; without loading Rich."""


def one_line(text: str) -> str:
    """The text with every character that could steer a terminal or break the line made visible."""
    return "".join(character if character.isprintable() else _shown(character) for character in text)


def _shown(character: str) -> str:
    return " " if character in "\n\t" else character.encode("unicode_escape", "backslashreplace").decode()
