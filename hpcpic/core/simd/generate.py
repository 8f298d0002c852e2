"""Kernels written as text for one scene: a module named by the hash of its text.

Straight-line generated source keeps compiled code in files and LLVM's vectoriser at work, where closures over
compiled functions would not. Mostly a kernel file is its own template: `specialise` replaces the constants at its head
by those of the scene, so that compiled code has no branch and no array for what the scene does not use.
"""

import hashlib
import importlib
import linecache
import re
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from hpcpic.core.simd.compile import EVERY, generated, program_of

_importing = threading.RLock()  # a thread finds no module that another one has half executed


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
    package: str, stems: Sequence[str], more: str = "", replaced: Sequence[str] = (), **constants: object
) -> ModuleType:
    """One module of the files `stems` of a package, in this order, and of the text `more`, with head constants set.

    A constant's line `NAME = ...` gets str(value). Imports of one of these files by another are dropped, as the text
    stands above, and those of files in whose place one of these stands, `replaced`. KeyError for an unknown constant.
    """
    (folder,) = importlib.import_module(package).__path__
    inner = "|".join((*stems, *replaced))
    imports = re.compile(rf"^from {re.escape(package)}\.({inner}) import ([^\n(]*|\([^)]*\))\n", re.M)
    text = "".join(imports.sub("", (Path(folder) / f"{stem}.py").read_text(encoding="utf-8")) for stem in stems) + more
    for name, value in constants.items():
        text, found = re.subn(rf"^{name} = .*$", f"{name} = {value}", text, flags=re.M)
        if not found:
            raise KeyError(f"kernels {', '.join(stems)} have no constant {name}")
    return module_from_source(text, "_".join(stems))


def _program_used(source: str) -> str:
    """The program whose modules the text imports; "" for none but the core's."""
    imported = re.findall(r"^\s*(?:from|import) (\w+(?:\.\w+)?)", source, re.M)
    programs = {program for program in map(program_of, imported) if program}
    return programs.pop() if len(programs) == 1 else EVERY if programs else ""
