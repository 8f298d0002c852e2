"""Kernels made for one scene: a kernel module is its own template.

The constants at the head of a kernel module (dimension, nodes of the shape, components, precision) are replaced by
those of the scene, so that compiled code has no branch and no array for what the scene does not use.
"""

import re
from pathlib import Path
from types import ModuleType

from hpcpic.core.simd.generate import module_from_source

_BETWEEN_KERNELS = re.compile(
    r"^from hpcpic\.plasma\.kernels\.(plain|storage|simd_base|nodal|linear|push) import ([^\n(]*|\([^)]*\))\n", re.M
)


def specialise(stems: tuple[str, ...], **constants: object) -> ModuleType:
    """One module of the kernel files `stems`, in this order, with their head constants set.

    Imports of one of these files by another are dropped: the text stands above. KeyError for an unknown constant.
    """
    folder = Path(__file__).parent
    text = "".join(_BETWEEN_KERNELS.sub("", (folder / f"{stem}.py").read_text(encoding="utf-8")) for stem in stems)
    for name, value in constants.items():
        text, found = re.subn(rf"^{name} = .*$", f"{name} = {value}", text, flags=re.M)
        if not found:
            raise KeyError(f"kernels {stems} have no constant {name}")
    return module_from_source(text, "_".join(stems))
