"""What a user can get wrong: one class a kind, each with the exit code that scripts may rely on."""


class PaddlectlError(Exception):
    """A mistake or fault that is told in one or two lines, never as a traceback.

    Args:
        message: What is wrong, and where.
        hint: What to do next; printed as the second line. Empty if there is nothing to add.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message, hint)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message}\n{self.hint}" if self.hint else self.message


class UsageError(PaddlectlError):
    """The command line asks for something that makes no sense."""

    exit_code = 2


class InvalidFileError(PaddlectlError):
    """A file that the user wrote can't be used; the message starts with file:line:column."""

    exit_code = 3


class NotFoundError(PaddlectlError):
    """A task, policy, run or file that isn't there."""

    exit_code = 4


class IntegrityError(PaddlectlError):
    """Stored data that isn't what was stored, or a use of it that must be refused."""

    exit_code = 5


class RegistryBusyError(PaddlectlError):
    """Another process held the registry for longer than the wait."""

    exit_code = 6


class SchemaVersionError(PaddlectlError):
    """A registry that another version of paddlectl made."""

    exit_code = 7
