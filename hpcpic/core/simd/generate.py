"""Kernels written as text for one scene: a module file named by the hash of its content.

Straight-line generated source keeps numba's disk cache and LLVM's vectoriser at work, where closures over
compiled functions would not.
"""

import hashlib
import importlib.util
import os
import re
import sys
import tempfile
from pathlib import Path
from types import ModuleType

from hpcpic.core.simd.jit import EVERY, cache_directory, generated_in, program_of


def keep(path: Path, content: bytes) -> None:
    """Write a file that appears complete or not at all; one that is there already stays."""
    descriptor, draft = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".draft")
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
    try:
        os.link(draft, path)
    except FileExistsError:
        pass  # another process was first
    finally:
        os.unlink(draft)


def module_from_source(source: str, stem: str) -> ModuleType:
    """Import `source` as the module `<stem>_<hash>` kept in the cache folder; same text, same module.

    Several processes may do this at once (numba takes a newer file for an edited one, so the first one stays).
    """
    name = f"{stem}_{hashlib.sha256(source.encode()).hexdigest()[:32]}"
    if name in sys.modules:
        return sys.modules[name]
    folder = cache_directory(_program_used(source))
    generated_in.add(folder)
    path = folder / f"{name}.py"
    if not path.exists():
        keep(path, source.encode())
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _program_used(source: str) -> str:
    """The program whose modules the text imports; "" for none but the core's."""
    imported = re.findall(r"^\s*(?:from|import) (\w+(?:\.\w+)?)", source, re.M)
    programs = {program for program in map(program_of, imported) if program}
    return programs.pop() if len(programs) == 1 else EVERY if programs else ""
