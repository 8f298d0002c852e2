"""Kernels written as text for one scene: a module named by the hash of its text.

Straight-line generated source keeps compiled code in files and LLVM's vectoriser at work, where closures over
compiled functions would not.
"""

import hashlib
import linecache
import re
import sys
from types import ModuleType

from hpcpic.core.simd.compile import EVERY, generated, program_of


def module_from_source(source: str, stem: str) -> ModuleType:
    """Import `source` as the module `<stem>_<hash>`; same text, same module. It is in no file, so what is executed is
    this text; tracebacks show its lines.
    """
    name = f"{stem}_{hashlib.sha256(source.encode()).hexdigest()[:32]}"
    if name in sys.modules:
        return sys.modules[name]
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


def _program_used(source: str) -> str:
    """The program whose modules the text imports; "" for none but the core's."""
    imported = re.findall(r"^\s*(?:from|import) (\w+(?:\.\w+)?)", source, re.M)
    programs = {program for program in map(program_of, imported) if program}
    return programs.pop() if len(programs) == 1 else EVERY if programs else ""
