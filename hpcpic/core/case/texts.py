"""Values as the text of a case file."""

from typing import Any


def value_text(value: Any) -> str:
    """A value in libconfig syntax; None, which it cannot say, is empty."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return f"{value}" if -(2**31) <= value < 2**31 else f"{value}L"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        escaped = "".join(ESCAPED.get(c) or (c if c >= " " and c != "\x7f" else f"\\x{ord(c):02x}") for c in value)
        return f'"{escaped}"'
    items = ", ".join(value_text(item) for item in value)
    return f"({items})" if value and isinstance(value[0], tuple) else f"[{items}]"


ESCAPED = {"\n": "\\n", "\t": "\\t", "\r": "\\r", "\f": "\\f", "\\": "\\\\", '"': '\\"'}
