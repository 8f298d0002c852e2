"""Errors with the exit code a program leaves with; anything else that escapes is a bug and exits 1."""


class HpcpicError(Exception):
    """Base of the errors that are told in one message, without a traceback."""

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message


class ConfigError(HpcpicError):
    """Usage or configuration is wrong. `messages` holds every fault found, one line or block each."""

    exit_code = 2

    def __init__(self, messages: str | list[str]) -> None:
        self.messages = [messages] if isinstance(messages, str) else list(messages)
        super().__init__("\n".join(self.messages))


class CheckFailed(HpcpicError):
    """A check, comparison or validation is beyond its tolerance."""

    exit_code = 3


class Diverged(HpcpicError):
    """The state is no longer a solution: not finite, particle lost, conservation broken."""

    exit_code = 4


class FileError(HpcpicError):
    """Run folder exists, disk full, damaged checkpoint, unreadable file."""

    exit_code = 6
