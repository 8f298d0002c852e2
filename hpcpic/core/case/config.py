"""Case files: libconfig text, @include files and the --set list as one tree that knows where each key stands.

A later file merges key by key into what came before it; the same key twice in one file is an error.
Limits: 16 files, @include 4 deep, 1 MiB each, 32 nested brackets. An @include is relative and leads neither to the
root of the file system nor into anything hidden, as a case may be a stranger's; what is no case is not quoted.
"""

import difflib
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from hpcpic.core.case import grammar
from hpcpic.core.case.cases import looks_like_case
from hpcpic.core.case.grammar import Include, Node
from hpcpic.core.errors import ConfigError

MAX_FILES = 16
MAX_INCLUDES = 4
MAX_BYTES = 1 << 20

Path = tuple[str | int, ...]
SET_PATH = re.compile(r"[A-Za-z*][-A-Za-z0-9_*]*(\.[A-Za-z*][-A-Za-z0-9_*]*|\[[0-9]{1,6}\])*")
WORD = re.compile(r"[A-Za-z][-A-Za-z0-9_]*(\.[-A-Za-z0-9_]+)*")  # also a name of a file, as hull.stl


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a setting; line 0: it came from the command line, which `file` then quotes."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


@dataclass(slots=True)
class Tree:
    """Plain values of a case: groups are dicts, lists tuples, arrays lists.

    faults: what is wrong but did not stop the reading, reported by schema.validate together with its own.
    incomplete: a file that was to be included was not: a key that seems to be missing may be in it.
    replaced: where a list stood that another file has put its own in the place of.
    ignored: keys that were accepted and dropped. files: (name, text) of every file read, the main one first.
    sets: the --set list as given. attached: paths of other files, which settings name.
    """

    data: dict[str, Any] = field(default_factory=dict)
    places: dict[Path, Place] = field(default_factory=dict)
    replaced: dict[Path, Place] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    incomplete: bool = False
    warnings: list[str] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)
    files: list[tuple[str, str]] = field(default_factory=list)
    sets: tuple[str, ...] = ()
    attached: list[str] = field(default_factory=list)

    def where(self, path: Path) -> Place:
        """The place of a setting, or of the nearest group around it that was written down."""
        while path and path not in self.places:
            path = path[:-1]
        return self.places.get(path, Place(self.files[0][0], 1, 1) if self.files else Place("case"))

    def drop(self, path: Path) -> Any:
        """Take a setting out of the tree and return its value; the path must exist."""
        parent: Any = self.data
        for key in path[:-1]:
            parent = parent[key]
        return parent.pop(path[-1])

    def has(self, path: Path) -> bool:
        value: Any = self.data
        for key in path:
            if not holds(value, key):
                return False
            value = value[key]
        return True


def load(path: str | os.PathLike, sets: tuple[str, ...] | list[str] = ()) -> Tree:
    """Read a case file, everything it includes, and apply the --set list.

    Raises ConfigError with all faults of syntax; other faults stay in Tree.faults.
    """
    name = os.fspath(path)
    if "\0" in name:
        raise ConfigError(f"cannot read {name!r}: no file is called so")
    reader = Reader(os.path.dirname(os.path.realpath(name)))
    reader.read(name, (), reader.tree.data, (), Place(name))
    return finish(reader, sets)


def loads(text: str, name: str = "case", sets: tuple[str, ...] | list[str] = ()) -> Tree:
    """Read a case as `load` does, from a text that includes no files."""
    reader = Reader(None)
    reader.take(text, name, (), reader.tree.data, ())
    return finish(reader, sets)


def finish(reader: "Reader", sets: tuple[str, ...] | list[str]) -> Tree:
    tree = reader.tree
    tree.sets = tuple(sets)
    if reader.broken:
        raise ConfigError(tree.faults)
    for assignment in tree.sets:
        fault = apply_set(tree, assignment)
        if fault:
            tree.faults.append(f"--set {assignment}: {fault}")
    return tree


class Reader:
    """Reads files into one tree. root: the folder that holds everything, None: no @include at all."""

    def __init__(self, root: str | None) -> None:
        self.root = root
        self.tree = Tree()
        self.broken = False  # a fault of syntax: what follows it was not read

    def fault(self, place: Place, message: str) -> None:
        self.tree.faults.append(f"{place}: {message}")

    def read(self, name: str, within: tuple[str, ...], group: dict, path: Path, asked: Place) -> None:
        """Read the file `name` into `group`, which stands at `path`. within: the files that include it."""
        real = os.path.realpath(name)
        try:
            content = file_bytes(real)
        except (OSError, ValueError) as error:
            self.broken = self.broken or not within
            self.tree.incomplete = True
            reason = getattr(error, "strerror", None) or str(error)
            self.fault(asked, f"cannot read {name!r}: {reason}" if within else f"cannot read: {reason}")
            return
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line, column = (
                content.count(b"\n", 0, error.start) + 1,
                error.start - content.rfind(b"\n", 0, error.start),
            )
            self.broken = True
            self.fault(Place(name, line, column), "not UTF-8 text")
            return
        self.take(text, name, (*within, real), group, path, foreign=not looks_like_case(text))

    def take(
        self, text: str, name: str, within: tuple[str, ...], group: dict, path: Path, foreign: bool = False
    ) -> None:
        """foreign: the text is perhaps no case, so messages about it do not quote it."""
        self.tree.files.append((name, text))
        node, faults = grammar.parse(text)
        if faults and foreign:
            line, column, _ = min(faults)
            self.broken = True
            self.fault(Place(name, line, column), "no text of a case: expected settings as in simulation = { }")
            return
        for line, column, message in faults:
            self.fault(Place(name, line, column), message)
        self.broken = self.broken or (bool(faults) and not node.value)
        self.merge(node, group, path, name, within)

    def merge(self, node: Node, group: dict, path: Path, file: str, within: tuple[str, ...]) -> None:
        """Settings of one group into `group`: groups merge, all else replaces what an earlier file set."""
        first: dict[str, Place] = {}
        for entry in node.value:
            place = Place(file, entry.line, entry.column)
            if isinstance(entry, Include):
                self.include(entry.file, place, group, path, file, within)
                continue
            if entry.name in first:
                self.fault(place, f"{dotted((*path, entry.name))}: set twice, first at {first[entry.name]}")
                continue
            earlier = self.tree.places.pop((*path, entry.name), None)  # places are in the order of what was set
            if earlier and isinstance(group.get(entry.name), tuple):
                self.tree.replaced[*path, entry.name] = earlier
            first[entry.name] = self.tree.places[*path, entry.name] = place
            if entry.node.kind == "group" and isinstance(group.get(entry.name), dict):
                self.merge(entry.node, group[entry.name], (*path, entry.name), file, within)
            else:
                self.forget((*path, entry.name), group.get(entry.name))
                group[entry.name] = self.plain(entry.node, (*path, entry.name), file, within)

    def plain(self, node: Node, path: Path, file: str, within: tuple[str, ...]) -> Any:
        if node.kind == "group":
            group: dict = {}
            self.merge(node, group, path, file, within)
            return group
        if node.kind == "scalar":
            return node.value
        values = []
        for i, item in enumerate(node.value):
            self.tree.places[*path, i] = Place(file, item.line, item.column)
            values.append(self.plain(item, (*path, i), file, within))
        return tuple(values) if node.kind == "list" else values

    def forget(self, path: Path, value: Any) -> None:
        """Drop the places below a setting whose value is replaced."""
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value if is_many(value) else ()):
            self.tree.places.pop((*path, key), None)
            self.forget((*path, key), inner)

    def include(self, name: str, place: Place, group: dict, path: Path, file: str, within: tuple[str, ...]) -> None:
        target = os.path.normpath(os.path.join(os.path.dirname(file), name))
        root, problem = self.root, None
        if root is not None and not os.path.lexists(target) and os.path.lexists(name):
            target, root = os.path.normpath(name), os.getcwd()
        real = os.path.realpath(target)
        if root is None:
            problem = "only a case that is a file may include others"
        elif os.path.isabs(name):
            problem = f"{name!r}: an @include is relative to the file that it stands in"
        elif strange(root, real):
            problem = f"{name!r} leads to the root of the file system or into something hidden"
        elif real in within:
            problem = f"circular @include of {name!r}"
        elif len(within) > MAX_INCLUDES:
            problem = f"@include nested deeper than {MAX_INCLUDES}"
        elif len(self.tree.files) >= MAX_FILES:
            problem = f"more than {MAX_FILES} files"
        if problem:
            self.tree.incomplete = True
            self.fault(place, problem)
        else:
            if root != self.root:
                here = os.path.relpath(target, os.path.dirname(file))
                self.tree.warnings.append(
                    f"{place}: {name!r} is found in the working directory only; {here!r} is found from everywhere"
                )
            self.read(target, within, group, path, place)


def strange(root: str, real: str) -> bool:
    """True if the way from a folder to a file leads over the root of the file system, or into something hidden."""
    shared = os.path.commonpath((root, real))
    if shared == root:
        return False
    return shared == os.sep or any(part.startswith(".") for part in os.path.relpath(real, shared).split(os.sep))


def file_bytes(path: str, most: int = MAX_BYTES) -> bytes:
    """The content of a regular file of at most so many bytes; a pipe or device is refused without waiting."""
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW)
    with os.fdopen(handle, "rb") as stream:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ValueError("not a regular file")
        content = stream.read(most + 1)
    if len(content) > most:
        raise ValueError(f"larger than {most >> 20} MiB")
    return content


def parse_value(text: str) -> Any:
    """A value as it stands in a case file; a bare word is taken as text. Raises ConfigError."""
    if WORD.fullmatch(text) and text.lower() not in ("true", "false"):
        return text
    tree = loads(f"value = {text}\n", "value")
    if tree.faults or len(tree.data) != 1:
        raise ConfigError([fault.partition(": ")[2] for fault in tree.faults] or "expected one value")
    return tree.data["value"]


def apply_set(tree: Tree, assignment: str) -> str | None:
    """Apply `key=value` to the tree, a group key by key; what is wrong with it, or None."""
    key, equal, text = assignment.partition("=")
    key = key.strip()
    if not equal or not SET_PATH.fullmatch(key):
        return "expected key=value with a key such as simulation.time_step or species[0].particles"
    try:
        value = parse_value(text.strip())
    except ConfigError as error:
        told = "; ".join(fault.partition(": ")[2] or fault for fault in error.messages)
        bare = grammar.QUOTES in told and '"' not in text  # a shell takes quotes away that stand in no others
        example = 'key=["text"]' if text.strip()[:1] in ("[", "(", "{") else f'{key}="{text.strip()}"'
        return f"{told}, within those of the shell: --set '{example}'" if bare else told
    path = tuple(int(part) if part.isdigit() else part for part in re.findall(r"[^.\[\]]+", key))
    parent: Any = tree.data
    for depth, part in enumerate(path[:-1]):
        if holds(parent, part):
            parent = parent[part]
        elif isinstance(parent, dict) and isinstance(part, str) and isinstance(path[depth + 1], str):
            parent = parent.setdefault(part, {})
        else:
            return absent(parent, path[: depth + 1])
    last, there = path[-1], holds(parent, path[-1])
    if isinstance(parent, tuple) and there and not (isinstance(value, dict) and isinstance(parent[last], dict)):
        return "a list element is a group: set one of its keys"
    if not there and not (isinstance(parent, dict) and isinstance(last, str)):
        return absent(parent, path)
    put(tree, parent, path, value, Place(f"--set {assignment}"))
    return None


def put(tree: Tree, parent: Any, path: Path, value: Any, place: Place) -> None:
    """Give a key of the group `parent` its value: groups merge, all else replaces."""
    last = path[-1]
    if isinstance(value, dict) and holds(parent, last) and isinstance(parent[last], dict):
        for name, inner in value.items():
            put(tree, parent[last], (*path, name), inner, place)
        return
    parent[last] = value
    for other in [other for other in tree.places if other[: len(path)] == path]:
        del tree.places[other]
    tree.places[path] = place


def is_whole(value: Any) -> bool:
    """Whether a float stands for an integer, and for one that a float holds exactly."""
    return isinstance(value, float) and value.is_integer() and abs(value) <= 2**53


def put_value(holder: Any, path: Path, value: Any) -> Any:
    """`holder` with another value at a path; tuples, which do not change, are made anew."""
    if not path:
        return value
    inner = put_value(holder[path[0]], path[1:], value)
    if isinstance(holder, tuple):
        return tuple(inner if i == path[0] else item for i, item in enumerate(holder))
    holder[path[0]] = inner
    return holder


def absent(group: Any, path: Path) -> str:
    """The fault of a key or an index that a group does not have, with the key that was probably meant."""
    if isinstance(group, tuple) and isinstance(path[-1], int):
        whole = dotted(path[:-1])
        return f"there is no {dotted(path)}: {whole} has {len(group)}; to add one give the whole list, {whole}"
    if isinstance(group, tuple):
        whole, name = dotted(path[:-1]), path[-1]
        named = [i for i, one in enumerate(group) if isinstance(one, dict) and one.get("name") == name]
        meant = f"{name!r} is {whole}[{named[0]}]" if named else f"its groups are {whole}[0], {whole}[1], ..."
        return f"there is no {dotted(path)}: {whole} is a list of {len(group)}; {meant}"
    keys = list(group) if isinstance(group, dict) else []
    near = difflib.get_close_matches(str(path[-1]), keys, 1)
    hint = f"; did you mean {dotted((*path[:-1], near[0]))}?" if near else ""
    return f"there is no {dotted(path)}{hint}"


def is_many(value: Any) -> bool:
    return isinstance(value, (list, tuple))


def holds(value: Any, key: str | int) -> bool:
    """True if a group has the key, or a list or array the index."""
    if isinstance(value, dict):
        return key in value
    return is_many(value) and isinstance(key, int) and key < len(value)


def leaves(value: Any, path: Path = ()) -> Iterator[tuple[str, Any]]:
    """(dotted key, value) of every setting in a group, those of groups in lists included."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from leaves(inner, (*path, name))
    elif isinstance(value, tuple):
        for i, inner in enumerate(value):
            yield from leaves(inner, (*path, i))
    else:
        yield dotted(path), value


def dotted(path: Path) -> str:
    """('species', 0, 'mass') as species[0].mass."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")
