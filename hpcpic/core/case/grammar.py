"""The libconfig grammar: text of one file to a tree of nodes that know their line and column.

Source: libconfig manual, "Configuration Files" and "Grammar". Stricter than the C library where that hides
mistakes: two settings on one line need a `;` or `,` between them, a string ends on the line it begins on, and
a number that does not fit its type (more than 64 bits, more than 1.8e308) is an error.
"""

import itertools
import re
from dataclasses import dataclass, field
from functools import cache
from typing import Any

MAX_DEPTH = 32

GRAMMAR = r"""
start: entries
entries: (setting | include)*
setting: NAME (EQUAL | COLON) value separator
separator: (SEMICOLON | COMMA)?
include: INCLUDE STRING
?value: INTEGER -> integer | FLOAT -> real | BOOLEAN -> boolean | STRING+ -> text | array | items | group
array: LSQB [value (COMMA value)* COMMA?] RSQB
items: LPAR [value (COMMA value)* COMMA?] RPAR
group: LBRACE entries RBRACE
EQUAL: "="
COLON: ":"
SEMICOLON: ";"
COMMA: ","
LSQB: "["
RSQB: "]"
LPAR: "("
RPAR: ")"
LBRACE: "{"
RBRACE: "}"
INCLUDE: "@include"
NAME: /[A-Za-z*][-A-Za-z0-9_*]*/
BOOLEAN.2: /(true|false)(?![-A-Za-z0-9_*])/i
FLOAT.2: /[-+]?(([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+)(?![A-Za-z0-9_.])/
INTEGER: /[-+]?(0[xX][0-9a-fA-F]+|0[bB][01]+|0[oOqQ][0-7]+|[0-9]+)L?L?(?![A-Za-z0-9_.])/
STRING: /"(?:[^"\\\n]|\\.)*"/
SKIP: /[ \t\r\n\f\v]+|#[^\n]*|\/\/[^\n]*|\/\*[\s\S]*?\*\//
%ignore SKIP
"""

ESCAPE = re.compile(r"\\(x[0-9a-fA-F]{2}|.)")
ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "f": "\f", "a": "\a", "b": "\b", "v": "\v", "\\": "\\", '"': '"'}
# control characters, and the marks that make a line read in another order than it is stored
FORBIDDEN = re.compile("[\x00-\x08\x0e-\x1f\x7f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
OPENING = {"LBRACE": "}", "LPAR": ")", "LSQB": "]"}
QUOTES = "texts stand in quotes"  # said of a bare word where a value stands


@dataclass(slots=True)
class Node:
    """A value: `kind` is scalar, array, list or group; a group's value is a list of Entry and Include."""

    kind: str
    value: Any
    line: int
    column: int


@dataclass(slots=True)
class Entry:
    """A setting of a group. line and column are those of its name."""

    name: str
    node: Node
    line: int
    column: int


@dataclass(slots=True)
class Include:
    file: str
    line: int
    column: int


@dataclass(slots=True)
class Faults:
    """Faults of a text, as (line, column, sentence); most do not stop the reading."""

    found: list[tuple[int, int, str]] = field(default_factory=list)

    def add(self, at: Any, message: str) -> None:
        self.found.append((at.line, at.column, message))


class Builder:
    """Callbacks of the parser, one per rule of the grammar. `faults` belongs to the parse in progress."""

    faults: Faults

    def start(self, children: list) -> Node:
        return Node("group", children[0], 1, 1)

    def entries(self, children: list) -> list[Entry | Include]:
        for one, following in itertools.pairwise(children):
            entry, ended, end_line = one
            if not ended and end_line == following[0].line:
                self.faults.add(following[0], f"missing ; after the value of {entry.name!r}")
        return [entry for entry, _, _ in children]

    def setting(self, children: list) -> tuple[Entry, bool, int]:
        name, _, (node, end_line), ended = children
        return Entry(str(name), node, name.line, name.column), ended, end_line

    def separator(self, children: list) -> bool:
        return bool(children)

    def include(self, children: list) -> tuple[Include, bool, int]:
        mark, name = children
        return Include(self.unescaped(name), mark.line, mark.column), True, name.line

    def integer(self, children: list) -> tuple[Node, int]:
        (token,) = children
        text = token.rstrip("L")
        digits = text.lstrip("+-").lower().replace("q", "o")
        value = int(digits[:400], 0 if digits[:2] in ("0x", "0b", "0o") else 10) if len(digits) < 400 else 2**64
        value = -value if text.startswith("-") else value
        if not -(2**63) <= value < 2**63:
            self.faults.add(token, f"the integer {token[:24]} does not fit into 64 bits")
            value = 0
        return Node("scalar", value, token.line, token.column), token.line

    def real(self, children: list) -> tuple[Node, int]:
        (token,) = children
        value = float(token)
        if value in (float("inf"), float("-inf")):
            self.faults.add(token, f"the number {token[:24]} is too large (the largest is 1.79e308)")
            value = 0.0
        return Node("scalar", value, token.line, token.column), token.line

    def boolean(self, children: list) -> tuple[Node, int]:
        (token,) = children
        return Node("scalar", token.lower() == "true", token.line, token.column), token.line

    def text(self, children: list) -> tuple[Node, int]:
        first = children[0]
        value = "".join(self.unescaped(token) for token in children)
        return Node("scalar", value, first.line, first.column), children[-1].line

    def unescaped(self, token: Any) -> str:
        def replace(match: re.Match) -> str:
            code = match[1]
            if len(code) == 3 and code != "x00":
                return chr(int(code[1:], 16))
            if code not in ESCAPES:
                self.faults.add(token, f"unknown escape {match[0]!r} in a string")
            return ESCAPES.get(code, "")

        return ESCAPE.sub(replace, token[1:-1])

    def group(self, children: list) -> tuple[Node, int]:
        opening, entries, closing = children
        return Node("group", entries, opening.line, opening.column), closing.line

    def items(self, children: list) -> tuple[Node, int]:
        return self.sequence("list", children)

    def array(self, children: list) -> tuple[Node, int]:
        node, end_line = self.sequence("array", children)
        types = {float if type(item.value) is int else type(item.value) for item in node.value}
        if any(item.kind != "scalar" for item in node.value):
            self.faults.add(node, "an array [ ] holds only numbers, texts or booleans; use a list ( )")
        elif len(types) > 1:
            self.faults.add(node, "the values of an array [ ] must be of one type; use a list ( )")
        return node, end_line

    def sequence(self, kind: str, children: list) -> tuple[Node, int]:
        opening, closing = children[0], children[-1]
        nodes = [child[0] for child in children[1:-1] if type(child) is tuple]
        return Node(kind, nodes, opening.line, opening.column), closing.line


@cache
def parser() -> tuple[Any, Builder]:
    """The LALR parser, built once and only when a file is read (25 ms)."""
    from lark import Lark

    builder = Builder()
    options = {"parser": "lalr", "lexer": "contextual", "keep_all_tokens": True, "maybe_placeholders": False}
    return Lark(GRAMMAR, transformer=builder, **options), builder


def parse(text: str) -> tuple[Node, list[tuple[int, int, str]]]:
    """The root group of `text`, empty after a fault of syntax, and the faults (line, column, sentence)."""
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken

    faults = Faults()
    if match := FORBIDDEN.search(text):  # the first of what may be a million
        faults.found.append((*place_of(text, match.start()), f"forbidden character U+{ord(match[0]):04X}"))
    nothing = Node("group", [], 1, 1)
    if faults.found:
        return nothing, faults.found
    lark, builder = parser()
    builder.faults = faults
    state = lark.parse_interactive(text)
    opened: list = []
    before: Any = None  # before and last: the two tokens before one that does not fit
    last: Any = None
    try:
        for token in state.iter_parse():
            before, last = last, token
            if token.type in OPENING:
                opened.append(token)
                if len(opened) > MAX_DEPTH:
                    faults.add(token, f"nested deeper than {MAX_DEPTH}")
                    return nothing, faults.found
            elif opened and token == OPENING[opened[-1].type]:
                opened.pop()
        return state.feed_eof(), faults.found
    except UnexpectedToken as error:
        if error.token.type == "$END" and opened:
            faults.add(opened[-1], f"missing {OPENING[opened[-1].type]!r} for this {str(opened[-1])!r}")
        elif error.token.type == "$END":
            end = len(text.rstrip())
            faults.found.append((*place_of(text, end), f"{wanted(state, opened)}, found the end of the file"))
        elif before and before.type in ("INTEGER", "FLOAT") and before.line == last.line and last.type == "NAME":
            faults.add(last, f"found {str(last)[:24]!r} after a number, which stands alone: `show` tells its unit")
        elif before and before.type == "INTEGER" and last.type == "COMMA" and error.token.type == "INTEGER":
            faults.add(last, "found a comma in a number: decimals have a point")
        else:
            word = f": {QUOTES}" if error.token.type == "NAME" and "INTEGER" in state.choices() else ""
            faults.add(error.token, f"{wanted(state, opened)}, found {str(error.token)[:24]!r}{word}")
    except UnexpectedCharacters as error:
        faults.add(error, unreadable(text, error.pos_in_stream or 0, wanted(state, opened)))
    return nothing, faults.found


def wanted(state: Any, opened: list) -> str:
    """The symbols that may stand here, in words. opened: the brackets still open."""
    choices = set(state.choices())
    if "INTEGER" in choices:
        return 'expected a value (number, "text", true, false, [ ], ( ) or { })'
    if "EQUAL" in choices:
        return "expected = after the name"
    if opened and opened[-1].type != "LBRACE":
        return f"expected , or {OPENING[opened[-1].type]}"
    if "STRING" in choices and "NAME" not in choices:
        return 'expected the "file name" of @include'
    return "expected a setting"


def unreadable(text: str, start: int, expected: str) -> str:
    """The fault of the characters at `start`, where no symbol of the grammar begins."""
    rest = text[start : start + 60]
    if rest.startswith('"'):
        return "the string does not end on its line"
    if rest.startswith("/*"):
        return "the comment does not end"
    match = re.match(r"[^\s;,{}()\[\]=:\"]+", rest)
    word = match[0] if match else rest[:1]
    if re.match(r"[-+.]*[0-9]", word):
        return f"{word[:24]!r} is not a number"
    return f"{expected}, found {word[:24]!r}"


def place_of(text: str, offset: int) -> tuple[int, int]:
    """Line and column, from 1, of a character."""
    return text.count("\n", 0, offset) + 1, offset - text.rfind("\n", 0, offset)
