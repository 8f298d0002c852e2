"""The shape of the sources: no import circle at any depth, few modules in a folder, few parameters in a function."""

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from hpcpic.core.case.schema import describe
from hpcpic.plasma.case.config import PlasmaConfig
from lbmdem.case.config import LbmDemConfig
from sph.case.config import SphConfig

ROOT = Path(__file__).parents[1]
PACKAGES = ("hpcpic", "sph", "lbmdem")
MOST_MODULES = 16  # in a folder: more hide each other
MOST_PARAMETERS = 12
MOST_LINES = 420
COMPILED = ("njit", "kernel", "inlined")  # names of decorators


@cache
def modules() -> dict[str, Path]:
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    names = (".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for file in files)
    return dict(zip(names, files))


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


def imports(name: str, file: Path) -> Iterator[str]:
    """What a module imports of ours, inside functions and for type checkers too, and what it names in a text to import
    later.
    """
    known, package = modules(), name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
            base = ".".join(part for part in (above, node.module) if part)
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                if whole in known or base in known:
                    yield whole if whole in known else base


def circle(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_module_imports_itself_by_way_of_others():
    graph = {name: set(imports(name, file)) - {name} for name, file in modules().items()}
    assert not circle(graph)


@pytest.mark.parametrize("package", ["hpcpic.core", "hpcpic.plasma", "sph", "lbmdem"])
def test_no_room_imports_itself_by_way_of_others(package):
    """Rooms are the folders of a package; modules beside them are rooms of their own."""
    graph: dict[str, set[str]] = {}
    for name, file in modules().items():
        if name.startswith(f"{package}."):
            room = ".".join(name.split(".")[: package.count(".") + 2])
            others = {".".join(other.split(".")[: package.count(".") + 2]) for other in imports(name, file)
                      if other.startswith(f"{package}.")}  # fmt: skip
            graph.setdefault(room, set()).update(others - {room})
    assert not circle(graph)


def test_a_folder_holds_few_modules():
    folders = {file.parent for file in modules().values()}
    crowded = {str(folder.relative_to(ROOT)): n for folder in folders if (n := len([
        file for file in folder.glob("*.py") if not file.name.startswith("__")
    ])) > MOST_MODULES}  # fmt: skip
    assert not crowded, f"more than {MOST_MODULES} modules in a folder: make a folder of those that belong together"


def test_a_function_has_few_parameters_and_a_file_few_lines():
    many, long = {}, {}
    for name, file in modules().items():
        if (n := file.read_text().count("\n")) > MOST_LINES:
            long[name] = n
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.FunctionDef):
                n = len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs)
                if n > MOST_PARAMETERS and not _is_command(node):
                    many[f"{name}.{node.name}"] = n
    assert not many, f"more than {MOST_PARAMETERS} parameters: some of them belong together, in a NamedTuple"
    assert not long, f"more than {MOST_LINES} lines: move what can be understood alone to a module of its own"


def _is_command(node: ast.FunctionDef) -> bool:
    """A verb of the command line has a parameter for each of its options."""
    return any("click" in ast.unparse(decorator) for decorator in node.decorator_list)


def test_every_docstring_can_be_read_alone():
    """It names its subject: it does not go on from somewhere else ("Of a particle.", "The same in 3D.")."""
    beginnings, found = ("Of ", "The same", "Whether it", "As "), []
    for name, file in modules().items():
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                text = ast.get_docstring(node) or ""
                if text.startswith(beginnings):
                    found.append(f"{name}.{getattr(node, 'name', '')}: {text[:40]}")
    assert not found, "name the subject first"


UNREAD = {"reproducible"}  # true in every case


def test_kernels_take_their_scratch_arrays_from_a_few_instructions():
    """Not from np.empty and np.zeros, for which numba compiles functions of its own (core/simd/scratch.py)."""
    found = [
        f"{file.name}:{call.lineno}"
        for file in modules().values()
        for function in ast.walk(parsed(file))
        if isinstance(function, ast.FunctionDef)
        and any(ast.unparse(one).partition("(")[0] in COMPILED for one in function.decorator_list)
        for call in ast.walk(function)
        if isinstance(call, ast.Call) and ast.unparse(call.func) in ("np.empty", "np.zeros")
    ]
    assert not found


@cache
def words(file: Path) -> set[str]:
    """Names of attributes and texts of a module."""
    nodes = (node for node in ast.walk(parsed(file)) if isinstance(node, ast.Attribute | ast.Constant))
    return {str(getattr(node, "attr", getattr(node, "value", ""))) for node in nodes}


@pytest.mark.parametrize(
    "config, package", [(PlasmaConfig, "hpcpic.plasma"), (SphConfig, "sph"), (LbmDemConfig, "lbmdem")]
)
def test_every_key_of_a_case_is_read(config, package):
    """Its name is an attribute or a text somewhere. A key that nothing reads is accepted, and does nothing."""
    read = UNREAD.union(*(words(file) for name, file in modules().items() if name.startswith((package, "hpcpic.core"))))
    unread = [row.key for row in describe(config) if row.key.split(".")[-1] not in read]
    assert not unread, "these keys are declared, and nothing reads them"


def test_the_faults_of_the_mutants_stand_in_the_sources(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import mutate

    stale = [(fault.number, fault.file, fault.before) for fault in mutate.faults()
             if (ROOT / fault.file).read_text().count(fault.before) != 1]  # fmt: skip
    gone = {path for fault in mutate.faults() for path in fault.area.tests if not (ROOT / path.split("::")[0]).exists()}
    assert not stale and not gone, "bring scripts/mutate.txt up to date"


def test_no_two_test_files_have_one_name():
    """pytest imports them by their names alone: of two that are alike it reads the first and ends with an error."""
    names = [file.name for file in (ROOT / "tests").rglob("test_*.py")]
    assert not {name for name in names if names.count(name) > 1}, "rename one of them"
