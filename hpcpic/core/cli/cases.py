"""list, show: the shipped cases and what can be set."""

from __future__ import annotations

import json
from pathlib import Path

import click

from hpcpic.core.app.app import AppLoader
from hpcpic.core.app.read import read_case
from hpcpic.core.app.text import table
from hpcpic.core.app.use import use_option
from hpcpic.core.case.cases import read_header
from hpcpic.core.case.config import Tree, dotted
from hpcpic.core.case.dump import dump
from hpcpic.core.case.schema import describe
from hpcpic.core.case.texts import value_text


def make_list_command(app_loader: AppLoader) -> click.Command:
    @click.command("list")
    def list_cases() -> None:
        """The shipped cases, a line each with the expected time."""
        headers = ((name, read_header(path)) for name, path in app_loader().cases().items())
        table(("case", "time", "what"), [(name, header.time, header.what) for name, header in headers])

    return list_cases


def make_show_command(app_loader: AppLoader) -> click.Command:
    @click.command("show")
    @click.argument("case")
    @use_option
    @click.option("--schema", is_flag=True, help="Print the JSON schema of all cases of this program instead.")
    @click.option("--text", is_flag=True, help="Print the case file instead: --text > my.conf makes one to change.")
    def show(case: str, schema: bool, text: bool) -> None:
        """A case's header, and every key with its type, unit, default and limits."""
        app = app_loader()
        if schema:
            click.echo(json.dumps(app.schema().model_json_schema(), indent=1))
            return
        read = read_case(app, case)
        if text:
            given = Path(read.path).read_text(encoding="utf-8")
            click.echo(dump(read.config) if "@include" in given else given, nl=False)  # elsewhere it includes nothing
            return
        header = read_header(read.path)
        click.echo(read.path)
        for name in ("what", "source", "expected", "time"):
            if getattr(header, name):
                click.echo(f"{name + ':':<10}{getattr(header, name)}")
        click.echo()
        here = _written(read.tree)
        rows = [
            (row.key, here.get(row.key, ""), row.unit, row.type, row.default, row.limits, row.text)
            for row in describe(app.schema())
        ]
        table(("key", "here", "unit", "type", "default", "limits", "meaning"), rows)

    return show


def _written(tree: Tree) -> dict[str, str]:
    """key -> value as the case writes it; values of one key in several groups of a list are joined."""
    found: dict[str, list[str]] = {}

    def walk(value: object, path: tuple[str, ...]) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                walk(inner, (*path, name))
        elif isinstance(value, tuple):
            for inner in value:
                walk(inner, (*path[:-1], f"{path[-1]}[]"))
        else:
            found.setdefault(dotted(path), []).append(value_text(value))

    walk(tree.data, ())
    return {key: "; ".join(values) for key, values in found.items()}
