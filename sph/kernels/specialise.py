"""Kernels made for one scene: a kernel module is its own template, its head constants replaced by the scene's."""

import re
from pathlib import Path
from types import ModuleType

from hpcpic.core.simd.generate import module_from_source


def specialise(stem: str, **constants: object) -> ModuleType:
    """The kernel file `stem` with its head constants set; KeyError for an unknown one."""
    text = (Path(__file__).parent / f"{stem}.py").read_text(encoding="utf-8")
    for name, value in constants.items():
        text, found = re.subn(rf"^{name} = .*$", f"{name} = {value!r}", text, flags=re.M)
        if not found:
            raise KeyError(f"kernels {stem} have no constant {name}")
    return module_from_source(text, f"sph_{stem}")
