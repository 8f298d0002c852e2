"""Kernels written as text for one scene: a module named by the hash of its text.

Straight-line generated source keeps compiled code in files and LLVM's vectoriser at work, where closures over
compiled functions would not. Mostly a kernel file is its own template: `specialise` replaces the constants at its head
by those of the scene, so that compiled code has no branch and no array for what the scene does not use. Scenes that
differ in a constant share what does not depend on it.
"""

import hashlib
import importlib
import linecache
import re
import sys
import threading
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

from hpcpic.core.simd.compile import EVERY, generated, program_of

overridden: set[tuple[str, str]] = set()  # (module, name) in whose place a later file of a scene has another
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
    package: str,
    stems: Sequence[str],
    more: Mapping[str, str] | None = None,
    replaced: Sequence[str] = (),
    **constants: object,
) -> ModuleType:
    """What the files `stems` of a package define, with head constants set; a later file's in place of an earlier one's.

    A constant's line `NAME = ...` gets str(value). more: text at the end of a file. Each file becomes a module of its
    own that imports what it names of those before it, or of one in whose place some of them stand, `replaced`. So it is
    compiled anew only where a constant differs in it or in what it imports. KeyError for an unknown constant.
    """
    (folder,) = importlib.import_module(package).__path__
    inner = "|".join((*stems, *replaced))
    imports = re.compile(rf"^from {re.escape(package)}\.(?:{inner}) import ([^\n(]+|\([^)]*\))\n", re.M)
    whole, origin, unknown = ModuleType(package), dict[str, str](), set(constants)
    for stem in stems:
        text = (Path(folder) / f"{stem}.py").read_text(encoding="utf-8") + (more or {}).get(stem, "")
        for name, value in constants.items():
            text, found = re.subn(rf"^{name} = .*$", f"{name} = {value}", text, flags=re.M)
            unknown -= {name} if found else set()
        text = imports.sub(partial(_imports, origin), text)
        module, nothing = module_from_source(text, stem), object()
        public = {name: value for name, value in vars(module).items() if not name.startswith("__")}
        own = [name for name, value in public.items() if vars(whole).get(name, nothing) is not value]
        overridden.update((origin[name], name) for name in own if name in origin)
        origin.update(dict.fromkeys(own, module.__name__))
        vars(whole).update(public)
    if unknown:
        raise KeyError(f"kernels {', '.join(stems)} have no constant {', '.join(sorted(unknown))}")
    return whole


def _imports(origin: Mapping[str, str], found: re.Match) -> str:
    """Lines that import the names of an import from the modules that define them."""
    names = re.findall(r"\w+", found[1])
    lists = {origin[name]: ", ".join(one for one in names if origin[one] == origin[name]) for name in names}
    return "".join(f"from {module} import {listed}\n" for module, listed in lists.items())


def _program_used(source: str) -> str:
    """The program whose modules the text imports; "" for none but the core's."""
    imported = re.findall(r"^\s*(?:from|import) (\w+(?:\.\w+)?)", source, re.M)
    programs = {program for name in imported if (program := generated.get(name, program_of(name)))}
    return programs.pop() if len(programs) == 1 else EVERY if programs else ""
