"""Pages that the code itself tells: the verbs of the command line, every key of every simulator, and the tutorials with
what their notebooks give when they are run.

In the sources every link leads to a file of the repository, so that they can be read there. In the site a link to a
notebook leads to its page, one to the keys of a simulator to their table, and a line that is only a link, with the path
of a file as its text, becomes the file.
"""

from __future__ import annotations

import html
import re
import tempfile
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any

import click
import nbformat
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter
from nbconvert.preprocessors import CoalesceStreamsPreprocessor, ExecutePreprocessor

from hpcpic.core.case.schema import Row, describe
from hpcpic.core.cli.main import VERBS, build

TUTORIALS = sorted((Path(__file__).parent / "tutorials").glob("*.ipynb"))
PROGRAMS = {"hpcpic": "Plasma", "sph": "SPH", "lbmdem": "Lattice and grains"}
ROOT = Path(__file__).parents[1]
KEYS = {"hpcpic/plasma": "hpcpic", "sph": "sph", "lbmdem": "lbmdem"}  # whose case/config.py has the keys


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that no file holds."""
    files.append(File.generated(config, "reference/verbs.md", content=verbs_page()))
    for name, title in PROGRAMS.items():
        files.append(File.generated(config, f"reference/{name}.md", content=keys_page(name, title)))
    for notebook in TUTORIALS:
        page, pictures = tutorial(notebook)
        files.append(File.generated(config, f"tutorials/{notebook.stem}.md", content=page))
        for name, picture in pictures.items():
            files.append(File.generated(config, f"tutorials/{name}", content=picture))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A page with its links as the site has them."""
    folder = PurePosixPath(page.file.src_uri).parent

    def keys(link: re.Match) -> str:
        return f"]({'../' * len(folder.parts)}reference/{KEYS[link[1]]}.md)"

    markdown = re.sub(r"\]\([./]*?(hpcpic/plasma|sph|lbmdem)/case/config\.py\)", keys, markdown)
    markdown = re.sub(r"\]\(([./]*tutorials/\w+)\.ipynb\)", r"](\1.md)", markdown)
    return re.sub(r"^\[([\w./-]+)\]\(\S+\)$", lambda link: file_text(ROOT / link[1]), markdown, flags=re.MULTILINE)


def file_text(file: Path) -> str:
    """A file as a block of code."""
    language = {".py": "python", ".sh": "bash", ".diff": "diff"}.get(file.suffix, "")
    return f"```{language}\n{file.read_text(encoding='utf-8').rstrip()}\n```"


def tutorial(notebook: Path) -> tuple[str, dict[str, bytes]]:
    """The page of a notebook that is run here, and its pictures by name. Raises CellExecutionError."""
    cells = nbformat.read(notebook, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        ExecutePreprocessor(timeout=600).preprocess(cells, {"metadata": {"path": folder}})
    cells, _ = CoalesceStreamsPreprocessor().preprocess(cells, {})
    for output in (one for cell in cells.cells for one in cell.get("outputs", ()) if "text" in one):
        output["text"] = re.sub(r"\x1b\[[0-9;]*m", "", output["text"])  # colours of a terminal
    named = {"unique_key": notebook.stem, "output_files_dir": "."}
    text, made = MarkdownExporter().from_notebook_node(cells, named)
    head, _, rest = text.lstrip().partition("\n")
    download = f"[This page as a notebook]({notebook.name}){{ download }}, with `pip install jupyterlab` to run it."
    return f"{head}\n\n{download}\n{rest}", {Path(name).name: data for name, data in made["outputs"].items()}


def verbs_page() -> str:
    """What `PROGRAM VERB --help` says of every verb."""
    load_app = import_module("sph.__main__").load_app
    face = build(load_app, "PROGRAM", "one of hpcpic, sph, lbmdem")
    lines = ["# The verbs", "", "`hpcpic`, `sph` and `lbmdem` answer to the same verbs.", ""]
    with click.Context(face, info_name="PROGRAM") as context:
        for verb in VERBS:
            command = face.get_command(context, verb)
            assert command is not None
            with click.Context(command, info_name=verb, parent=context, max_content_width=100) as inner:
                lines += [f"## {verb}", "", VERBS[verb][1], "", "```", command.get_help(inner), "```", ""]
    return "\n".join(lines)


def keys_page(name: str, title: str) -> str:
    """Every key with its type, unit, default, limits and meaning, a table for each section."""
    sections: dict[str, list[Row]] = {}
    for row in describe(import_module(f"{name}.__main__").load_app().schema()):
        sections.setdefault(row.key.rpartition(".")[0], []).append(row)
    lines = [f"# Keys of {title[:1].lower() if name != 'sph' else title[:1]}{title[1:]} cases", ""]
    lines += [f"`{name} show CASE` prints the same table with the values of a case beside it.", ""]
    for section, keys in sections.items():
        lines += [f"## `{section}`" if section else "## At the top", "", *table(keys), ""]
    return "\n".join(lines)


def table(rows: Iterable[Row]) -> Iterator[str]:
    yield "| key | meaning | unit | type | default | limits |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for row in rows:
        name = row.key.rpartition(".")[2]
        cells = (f"`{name}`", row.text, row.unit, code(row.type), code(row.default), code(row.limits))
        yield f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |"


def code(text: str) -> str:
    """In the letters of code, which a table's bars and brackets do not end."""
    return f"<code>{html.escape(text).replace('|', '|<wbr>')}</code>" if text else ""
