"""`check --kernel`: the source of the kernels that are written for a case, as they are compiled."""

from __future__ import annotations

import difflib
import inspect
import linecache
import sys
from typing import Any

import click

from hpcpic.core.app.app import App
from hpcpic.core.app.text import table
from hpcpic.core.errors import ConfigError


def kernel_texts(app: App, config: Any) -> dict[str, str]:
    """name -> source: of every module that was written for the case, and as MODULE.FUNCTION of each kernel in it.

    Makes the model on one rank, as a run does before its first step, and takes the modules that this has made.
    """
    from hpcpic.core import memory
    from hpcpic.core.comm.world import World
    from hpcpic.core.simd.compile import generated
    from hpcpic.core.tasks.graph import Pool
    from hpcpic.core.timers import Timers

    make = app.load()
    memory.require_room(lambda: sum(app.estimate(config, 1, 1, {}).memory.values()))
    pool = Pool(1)
    try:
        make(config, World.alone(), pool, Timers()).close()
    finally:
        pool.close()
    texts: dict[str, str] = {}
    for key in generated:
        module, title = sys.modules[key], key.rpartition("_")[0]  # without the hash of its text
        texts[title] = texts.get(title, "") + "".join(linecache.getlines(f"<{key}>"))
        functions = ((name, getattr(value, "py_func", value)) for name, value in vars(module).items())
        own = ((name, value) for name, value in functions if inspect.isfunction(value) and value.__module__ == key)
        texts |= {f"{title}.{name}": inspect.getsource(value) for name, value in own}
    return texts


def print_kernel(app: App, config: Any, name: str) -> None:
    """Print a kernel by MODULE.NAME or NAME alone, or else a module; "list": the names. Raises ConfigError."""
    texts = kernel_texts(app, config)
    if name == "list":
        table(("kernel", "lines"), [(key, text.count("\n")) for key, text in texts.items()], right=("lines",))
        return
    found = [key for key in texts if key.endswith(f".{name}")] or [name] * (name in texts)
    if len(found) != 1:
        there = ", ".join(found or difflib.get_close_matches(name, texts, 3, 0.3) or ["those of --kernel list"])
        raise ConfigError(f"--kernel {name}: {'several' if found else 'none'} of that name; there are {there}")
    click.echo(texts[found[0]].rstrip("\n"))
