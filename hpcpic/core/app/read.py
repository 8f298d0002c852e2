"""Reads a case that the command line names: the options for it, and the file to a configuration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import click

from hpcpic.core.app.app import App
from hpcpic.core.case.cases import find_case
from hpcpic.core.case.config import Tree, load

set_option = click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override one key of the case, as species[0].particles=1000.",
)


def shape_options(command: Callable) -> Callable:
    """--ranks and --threads, for verbs that only think about a run."""
    command = click.option("--threads", type=click.IntRange(1), default=1, show_default=True, help="Threads per rank.")(
        command
    )
    return click.option("--ranks", type=click.IntRange(1), default=1, show_default=True, help="MPI ranks.")(command)


@dataclass(frozen=True, slots=True)
class Case:
    """A case that has been read and found valid."""

    path: str
    tree: Tree
    config: Any


def read_case(app: App, case: str, sets: tuple[str, ...] = ()) -> Case:
    """Raises ConfigError with every fault."""
    tree = load(path := str(find_case(case, app.cases())), sets)
    return Case(path, tree, app.configure(tree))
