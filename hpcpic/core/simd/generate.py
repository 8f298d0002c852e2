"""Kernels written as text for one scene: a module named by the hash of its text.

Straight-line generated source keeps compiled code in files and LLVM's vectoriser at work, where closures over
compiled functions would not. Mostly a kernel file is its own template: `specialise` replaces the constants at its head
by those of the scene, so that compiled code has no branch and no array for what the scene does not use. Scenes that
differ in a constant share what does not depend on it.
"""

import ast
import functools
import hashlib
import importlib
import linecache
import re
import symtable
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from hpcpic.core.simd.compile import EVERY, generated, program_of

_importing = threading.RLock()  # a thread finds no module that another one has half made


def module_from_source(source: str, stem: str) -> ModuleType:
    """Import `source` as the module `<stem>_<hash>`; same text, same module. It is in no file, so what is executed is
    this text; tracebacks show its lines.
    """
    name = f"{stem}_{hashlib.sha256(source.encode()).hexdigest()[:32]}"
    with _importing:
        return sys.modules[name] if name in sys.modules else _executed(source, name)


def _executed(source: str, name: str) -> ModuleType:
    generated[name] = _program_used(source)
    file = f"<{name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    module = ModuleType(name)
    module.__file__ = file
    sys.modules[name] = module
    try:
        exec(compile(source, file, "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def specialise(
    package: str,
    stems: Sequence[str],
    more: Mapping[str, str] | None = None,
    replaced: Sequence[str] = (),
    **constants: object,
) -> ModuleType:
    """The definitions of the files `stems` of a package, with head constants set; those of a later file replace others.

    A constant's line `NAME = ...` gets str(value). more: text at the end of a file. What a file imports of those before
    it, or of one in whose place some of them stand, `replaced`, is theirs. Each definition becomes a module of its own
    when it is asked for: it is compiled anew only where a constant differs that it reads, or what it calls. KeyError
    for an unknown constant.
    """
    values = tuple((name, str(value)) for name, value in sorted(constants.items()))
    with _importing:
        return _specialised(package, tuple(stems), tuple(sorted((more or {}).items())), tuple(replaced), values)


@functools.cache
def _specialised(
    package: str,
    stems: tuple[str, ...],
    more: tuple[tuple[str, str], ...],
    replaced: tuple[str, ...],
    constants: tuple[tuple[str, str], ...],
) -> ModuleType:
    (folder,) = importlib.import_module(package).__path__
    origin, unknown = dict[str, _File](), {name for name, _ in constants}
    for stem in stems:
        text = (Path(folder) / f"{stem}.py").read_text(encoding="utf-8") + dict(more).get(stem, "")
        for name, value in constants:
            text, found = re.subn(rf"^{name} = .*$", f"{name} = {value}", text, flags=re.M)
            unknown -= {name} if found else set()
        file = _File(stem, text, {f"{package}.{one}" for one in (*stems, *replaced)}, origin)
        origin |= dict.fromkeys(file.defined, file)
    if unknown:
        raise KeyError(f"kernels {', '.join(stems)} have no constant {', '.join(sorted(unknown))}")
    return _Kernels(package, origin)


class _Kernels(ModuleType):
    """Definitions of files of kernels, each executed when it is asked for."""

    def __init__(self, package: str, origin: Mapping[str, "_File"]) -> None:
        super().__init__(package)
        self._origin = origin

    def __getattr__(self, name: str) -> Any:
        if name not in self._origin:
            raise AttributeError(f"the kernels of {self.__name__} have no {name}")
        with _importing:
            return getattr(self._origin[name].module(name), name)


class _Statement(NamedTuple):
    text: str
    reads: set[str]
    apart: bool  # a function or a class: one and the same wherever it is used


class _File:
    """A file of kernels; a definition of it becomes a module, with the imports and constants of the file that it reads.

    inner: files whose names are those of `origin`, of the files before this one.
    """

    def __init__(self, stem: str, text: str, inner: set[str], origin: Mapping[str, "_File"]) -> None:
        self.defined: set[str] = set()
        self._stem, lines = stem, text.splitlines()
        self._elsewhere: dict[str, _File] = {}
        self._statements: list[_Statement] = []
        self._needed: dict[str, set[int]] = {}  # statements, by whoever reads a name
        self._modules: dict[str, ModuleType] = {}
        for node in ast.parse(text).body:
            if isinstance(node, ast.ImportFrom) and node.module in inner:
                self._elsewhere |= {one.name: origin[one.name] for one in node.names}
            else:
                first = min(part.lineno for part in (node, *getattr(node, "decorator_list", ())))
                self._add(node, "\n".join(lines[first - 1 : node.end_lineno]))

    def _add(self, node: ast.stmt, text: str) -> None:
        tables = [symtable.symtable(text, self._stem, "exec")]
        for table in tables:
            tables += table.get_children()
        sets = {one.get_name() for one in tables[0].get_symbols() if one.is_assigned() or one.is_imported()}
        reads = {one.get_name() for table in tables for one in table.get_symbols() if one.is_global()}
        number = len(self._statements)
        self._statements.append(_Statement(text, reads, isinstance(node, ast.FunctionDef | ast.ClassDef)))
        self._needed |= {name: {number} for name in sets}
        if not isinstance(node, ast.Import | ast.ImportFrom):
            self.defined |= sets
        if not sets:  # something is done with a name
            for name in reads:
                self._needed.setdefault(name, set()).add(number)

    def module(self, name: str) -> ModuleType:
        """The module that defines a name. Functions that call each other have none."""
        if name not in self._modules:
            imports, own, left = set[str](), set[int](), [name]
            while left:
                one = left.pop()
                for number in self._needed.get(one, set()) - own:
                    statement = self._statements[number]
                    if statement.apart and one != name:
                        imports.add(f"from {self.module(one).__name__} import {one}")
                    else:
                        own.add(number)
                        left += statement.reads
                if one in self._elsewhere:
                    imports.add(f"from {self._elsewhere[one].module(one).__name__} import {one}")
            texts = [*sorted(imports), *(self._statements[number].text for number in sorted(own))]
            self._modules[name] = module_from_source("\n".join(texts) + "\n", self._stem)
        return self._modules[name]


def _program_used(source: str) -> str:
    """The program whose modules the text imports; "" for none but the core's."""
    imported = re.findall(r"^\s*(?:from|import) (\w+(?:\.\w+)?)", source, re.M)
    programs = {program for name in imported if (program := generated.get(name, program_of(name)))}
    return programs.pop() if len(programs) == 1 else EVERY if programs else ""
