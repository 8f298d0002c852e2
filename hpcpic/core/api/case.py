"""A case in Python: what a case file says, checked when it is made."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from hpcpic.core.api.numbers import whole, words
from hpcpic.core.api.results import Run, ended, threads_of
from hpcpic.core.api.simulation import Simulation
from hpcpic.core.api.tables import Check, Forecast
from hpcpic.core.api.texts import assignments, called, case_text, settings_of, told_in_python
from hpcpic.core.app.app import App
from hpcpic.core.app.read import Case as ReadCase
from hpcpic.core.app.read import read_case
from hpcpic.core.case.config import Place, Tree, loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.case.dump import dump
from hpcpic.core.cli.check import numbers_of
from hpcpic.core.errors import ConfigError
from hpcpic.core.simd import frozen

if TYPE_CHECKING:
    from hpcpic.core.cli.job import Plan
    from hpcpic.core.comm.world import World
    from hpcpic.core.files.rundir import RunDir


class Case:
    """One case, valid and complete: a shipped name, the path of a case file, or its sections by name.

    >>> import sph
    >>> case = sph.Case("water-column").changed({"numerics.spacing": 0.02})
    >>> case.config.numerics.spacing
    0.02

    Raises ConfigError with every fault, each with its place, its key and what would be right. A case never changes;
    `changed` gives another one.
    """

    load_app: ClassVar[Callable[[], App]]

    def __init__(self, source: str | os.PathLike[str] | None = None, /, **sections: Any) -> None:
        if isinstance(source, Mapping):
            raise ConfigError("a case takes its sections by name: Case(simulation={...}, ...), or Case(**sections)")
        if source is not None and not isinstance(source, str | os.PathLike):
            raise ConfigError(f"a case is made of a shipped name or a path (got {source!r})")
        if isinstance(source, str) and "\n" in source:
            raise ConfigError(
                "a case is made of a shipped name or a path, and this is the text of a case: write it to a file, "
                "pathlib.Path('my.conf').write_text(text), and give its path"
            )
        if (source is None) == (not sections):
            raise ConfigError("a case is made of a shipped name or a path, or else of the sections of a case file")
        self._source = None if source is None else os.fspath(source)
        self._starts: tuple[tempfile.TemporaryDirectory, ...] = ()  # of arrays, as long as a case lives that uses them
        self._array_keys: tuple[str, ...] = ()  # under which they were given
        self._text = case_text(sections, self._keep)
        self._sets: tuple[str, ...] = ()
        self._read()

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise AttributeError(f"{name}: a case never changes; changed({{...}}) makes another one")
        super().__setattr__(name, value)

    def _keep(self, key: str, given: Mapping[str, Any]) -> str:
        """Write arrays that a case starts from; the path of their file. Raises ConfigError."""
        self._array_keys = (*self._array_keys, key)
        try:
            plain = {name: np.asarray(values) for name, values in given.items()}
        except ValueError as error:
            raise ConfigError(f"{key}: no arrays: {error}") from None
        folder = tempfile.TemporaryDirectory(prefix="hpcpic-")
        self._starts = (*self._starts, folder)
        path = Path(folder.name) / f"start-{len(self._starts)}.npz"
        np.savez(path, allow_pickle=False, **plain)
        return str(path)

    def _read(self) -> None:
        self._app = type(self).load_app()
        with told_in_python(self._array_keys):
            if self._source is not None:
                self._read_case = read_case(self._app, self._source, self._sets)
            else:
                tree = self._tree()
                self._read_case = ReadCase("case.conf", tree, self._app.configure(tree))

    @property
    def config(self) -> Any:
        """The typed configuration, with every default filled in."""
        return self._read_case.config

    def _tree(self) -> Tree:
        """The keys given in Python; what is wrong with them is placed by its key alone."""
        tree = loads(self._text, "case.conf", self._sets)
        on_sets = {path: place for path, place in tree.places.items() if not place.line}
        tree.places = {(): Place(f"{self._app.name}.Case"), **on_sets}
        return tree

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """Another case, with these keys ("species[0].particles") set to these values. Raises ConfigError.

        A mapping changes the keys in it and leaves the others of its group: {"simulation": {"end_time": 1.0}} is
        {"simulation.end_time": 1.0}. A list takes the place of the whole list, which adds a species, or leaves a group
        of one out.
        """
        if not isinstance(changes, Mapping):
            raise ConfigError(f'changed({{"simulation.time_step": 0.1}}): keys with their values (got {changes!r})')
        case = object.__new__(type(self))
        case._source, case._text = self._source, self._text
        case._starts, case._array_keys = self._starts, self._array_keys
        case._sets = (*self._sets, *assignments(changes, case._keep))
        case._read()
        return case

    def __reduce__(self) -> tuple[Callable[..., Case], tuple[Any, ...]]:
        """For pickle: what the case is made of, and the arrays that it starts from. It is read again where it comes."""
        files = [path for folder in self._starts for path in sorted(Path(folder.name).iterdir())]
        arrays = {str(path): path.read_bytes() for path in files}
        return _made_again, (type(self), self._source, self._text, self._sets, arrays)

    def __str__(self) -> str:
        """libconfig text with every default filled in, which reads back to the same case."""
        return dump(self.config)

    def __repr__(self) -> str:
        made_of = repr(self._source) if self._source else "made in Python"
        return " ".join([f"<{self._app.name} case {made_of}", *self._sets]) + ">"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the case file, and beside it the files that it names. Raises FileError."""
        from hpcpic.core.files.atomic import write_atomic
        from hpcpic.core.files.given import content_of, located, names_of

        target, names = Path(path), names_of(self._read_case.tree)
        beside = {source: f"{target.stem}-{name}" for source, name in names.items()}
        for source, name in beside.items():
            write_atomic(target.with_name(name), content_of(source))
        write_atomic(target, located(str(self), beside))

    def check(self, ranks: int = 1) -> Check:
        """The derived numbers with their limits, as `check` prints them; no step is taken."""
        ranks = whole(ranks, "ranks")
        return Check(tuple(numbers_of(self._app, self.config, ranks)), tuple(self._read_case.tree.warnings))

    def estimate(self, ranks: int = 1, threads: int = 1) -> Forecast:
        """Memory, disk and time on so many ranks and threads, as `estimate` prints them."""
        from hpcpic.core.app.rates import read_rates

        ranks, threads = whole(ranks, "ranks"), whole(threads, "threads")
        estimate = self._app.estimate(self.config, ranks, threads, read_rates())
        return Forecast(self._app, self.config, ranks, threads, estimate)

    def run(
        self,
        folder: str | os.PathLike[str] | None = None,
        *,
        threads: int | None = None,
        wall: str | float | None = None,
        checkpoint_every: str | int | None = None,
        quiet: bool = False,
        replace: bool = False,
        force: bool = False,
    ) -> Run:
        """Do what the verb `run` does, and open the folder that it made. Collective under mpirun: every rank makes the
        same case, with the same arrays.

        folder: by default that of the command line. threads, wall ("HH:MM:SS" or seconds) and checkpoint_every (500
        steps, "15m") mean what they mean there. quiet: print warnings only. replace: the run in the folder. force: run
        although `check` refuses, where the limit may be overridden. A run that was stopped early returns too, with the
        status "stopped". Raises ConfigError, FileError, and Diverged when the state was no solution any more.
        """
        from hpcpic.core.app import use
        from hpcpic.core.cli.job import Flags, job
        from hpcpic.core.cli.run import prepare_run, run_folder
        from hpcpic.core.comm.meeting import agree, meet

        def prepare(app: App, world: World) -> tuple[RunDir, Plan]:
            with self._file() as path:
                rundir, plan = prepare_run(path, target, self._sets, replace, force, False, app, world)
            plan.warnings += told
            return rundir, plan

        flags = Flags(threads_of(threads), words(wall), words(checkpoint_every), quiet=quiet, summary=not quiet)
        frozen.require_unchanged()
        told = use.keep_own()
        target = run_folder(self._read_case) if folder is None else os.fspath(folder)
        meet("run()")
        agree({"folder": str(target), **settings_of(self.config)})
        with told_in_python(self._array_keys):
            code = job(lambda: self._app, prepare, flags, raises=True)
        return ended(code, target, self._app)

    @contextmanager
    def _file(self) -> Iterator[str]:
        """The case as a file: as it stands, or one for the time being, whose name errors do not tell."""
        if self._source is not None:
            yield self._source
            return
        with tempfile.TemporaryDirectory(prefix="hpcpic-") as folder:
            path = Path(folder) / self._read_case.path
            path.write_text(self._text, encoding="utf-8")
            try:
                yield str(path)
            except ConfigError as error:
                name = f"{self._app.name}.Case"
                raise ConfigError([called(told, str(path), name) for told in error.messages]) from None

    def simulation(self, *, threads: int | None = None, force: bool = False) -> Simulation:
        """The simulation in memory, at its initial state: use it in a `with`. Nothing is written. Collective: every
        rank makes the same case, with the same arrays.

        force: although `check` refuses, where the limit may be overridden. Raises ConfigError beyond the others."""
        threads = threads_of(threads)
        with told_in_python(self._array_keys):
            enforce(self._app.derived(self.config, 1), self._read_case.tree, force)
        return Simulation(self._app, self.config, threads)


def _made_again(
    kind: type[Case], source: str | None, text: str, sets: tuple[str, ...], arrays: Mapping[str, bytes]
) -> Case:
    """A case that was pickled; its arrays are in files of its own."""
    case = object.__new__(kind)
    case._source, case._starts, case._array_keys = source, (), ()
    for old, content in arrays.items():
        folder = tempfile.TemporaryDirectory(prefix="hpcpic-")
        case._starts = (*case._starts, folder)
        path = Path(folder.name) / Path(old).name
        path.write_bytes(content)
        text, sets = text.replace(old, str(path)), tuple(words.replace(old, str(path)) for words in sets)
    case._text, case._sets = text, sets
    case._read()
    return case
