"""The command line of every simulator: the verbs, and the exit codes they leave with."""

from __future__ import annotations

import atexit
import ctypes
import errno
import gc
import io
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

import click

from hpcpic.core.app import text
from hpcpic.core.app.app import AppLoader
from hpcpic.core.errors import FileError, HpcpicError
from hpcpic.version import __version__

VERBS = {  # verb -> the module of core that makes it, and what --help says without importing it
    "list": ("cli.cases", "The shipped cases, a line each with the expected time."),
    "show": ("cli.cases", "A case's header, and every key with its type, unit, default and limits."),
    "check": ("cli.check", "Validate a case; print every derived number with its limit, verdict and source."),
    "estimate": ("cli.estimate", "Memory by item, disk and time of a case on any ranks x threads."),
    "run": ("cli.run", "Run a case; `mpirun -n N` in front runs it on N ranks."),
    "restart": ("cli.restart", "Go on from the newest good checkpoint, on any number of ranks and threads."),
    "sweep": ("study.sweep", "Run a case for every combination of some settings."),
    "tradeoff": ("study.tradeoff", "Measure what each knob of a case costs and gains; find the cheapest setting."),
    "stability": ("study.stability", "Bisect for the largest stable size of a knob of a case."),
    "compare": ("report.compare", "Config, series, last snapshots, timers and final state of two run folders."),
    "plot": ("report.plot", "Draw figures of a run."),
    "report": ("report.report", "One HTML page on a run, or a comparison of several."),
    "export": ("report.export", "Write the snapshots and series of a run for other programs."),
    "bench": ("cli.bench", "Measure bandwidth and kernel rates of this machine and keep them for `estimate`."),
    "doctor": ("cli.doctor", "MPI, launcher, threads, HDF5, FFTW, versions, the cache of compiled kernels."),
}
ALIASES = {  # words of other programs -> verb
    **dict.fromkeys(("simulate", "start", "solve", "execute"), "run"),
    **dict.fromkeys(("resume", "continue", "resubmit"), "restart"),
    **dict.fromkeys(("validate", "verify", "test"), "check"),
    **dict.fromkeys(("animate", "movie", "draw", "view", "visualize"), "plot"),
    **dict.fromkeys(("cases", "ls"), "list"),
    **dict.fromkeys(("convert", "dump", "vtk"), "export"),
    **dict.fromkeys(("keys", "init", "schema"), "show"),
    "diff": "compare",
}
TABLES = ("list", "show", "check", "estimate", "sweep", "tradeoff", "stability", "compare", "bench", "doctor")
PARALLEL = ("run", "restart", "bench", "doctor")  # verbs in which all ranks take part
NO_READER = 128 + signal.SIGPIPE  # what shells say of a program that writes to nobody

RANK_VARIABLES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "PMIX_RANK")  # where launchers tell a process its rank


def launcher_rank() -> int:
    """The rank the launcher gave this process, known before MPI starts; 0 without a launcher."""
    for name in RANK_VARIABLES:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return 0


class CommandLine(click.Group):
    """All verbs. It imports a verb when it is used, prints a known error once, and exits with its code."""

    def __init__(self, app_loader: AppLoader, name: str, title: str) -> None:
        super().__init__(name=name, help=f"{title[:1].upper()}{title[1:]}.")
        self.app_loader = app_loader

    def list_commands(self, context: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, context: click.Context, verb: str) -> click.Command | None:
        if verb not in VERBS:
            return None
        make: Callable[[AppLoader], click.Command] = getattr(
            import_module(f"hpcpic.core.{VERBS[verb][0]}"), f"make_{verb}_command"
        )
        command = make(self.app_loader)
        if verb in TABLES:
            words = "Print all tables as one object: {tables: [[{column: value}]], text: [line]}."
            command.params.append(click.Option(
                ["--json"], is_flag=True, is_eager=True, expose_value=False, callback=text.ask_for_json, help=words
            ))  # fmt: skip
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(verb, sentence) for verb, (_, sentence) in VERBS.items()])

    def resolve_command(self, context: click.Context, arguments: list[str]) -> Any:
        if "" in arguments:
            raise click.UsageError("an argument is empty: is a variable of the shell not set?")
        for word in arguments:
            if any("\ud800" <= letter <= "\udfff" for letter in word):  # bytes that Python could not read
                raise click.UsageError(f"{word!a}: not text in the encoding of this terminal")
        if launcher_rank() and arguments and arguments[0] not in PARALLEL:
            sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115  (rank 0 says it)
        if arguments and arguments[0] not in VERBS:
            import difflib  # only where there is a mistake

            if arguments[0] == "help":
                raise click.UsageError(f"say `{self.name} --help`, or `{self.name} VERB --help`", context)
            near = ALIASES.get(arguments[0]) or next(iter(difflib.get_close_matches(arguments[0], VERBS, 1)), None)
            hint = f"did you mean {near!r}?" if near else f"there are {', '.join(VERBS)}"
            raise click.UsageError(f"no such command {arguments[0]!r}; {hint}", context)
        return super().resolve_command(context, arguments)

    def main(self, args: Sequence[str] | None = None, *rest: Any, **settings: Any) -> Any:
        settings["standalone_mode"] = False
        settings["prog_name"] = self.name
        try:
            with exit_without_reader():
                code = self._with_json(args, *rest, **settings) or 0
            sys.exit(code)
        except click.ClickException as error:
            if not launcher_rank():
                error.show()
                click.echo(hint(error, self.name or ""), nl=False, err=True)
            sys.exit(error.exit_code)
        except click.Abort:  # Ctrl-C before there is anything to stop
            end_all_ranks()
            sys.exit(1)
        except HpcpicError as error:
            self.leave(error)
        except OSError as error:
            if error.filename is None and error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            self.leave(FileError(f"{error.filename or 'the output'}: {error.strerror}"))

    def _with_json(self, *rest: Any, **settings: Any) -> Any:
        """Do the verb, and print its answer where --json asks for one. The answer of an outer verb stays open."""
        with text.answering(silent=bool(launcher_rank())):
            return super().main(*rest, **settings)

    def make_context(self, *rest: Any, **settings: Any) -> click.Context:
        with exit_without_reader():  # click itself would exit with 1
            return super().make_context(*rest, **settings)

    def invoke(self, context: click.Context) -> Any:
        with exit_without_reader():
            return super().invoke(context)

    def leave(self, error: HpcpicError) -> None:
        """Print the error on one rank and exit with its code."""
        if not launcher_rank():
            click.echo(error.message, err=True)
        sys.exit(error.exit_code)


@contextmanager
def exit_without_reader() -> Iterator[None]:
    """Exit quietly where the reader of the output has gone, as `head` does."""
    try:
        yield
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what is printed as the program ends
        sys.exit(NO_READER)


def hint(error: click.ClickException, program: str) -> str:
    """A line on what the user probably wants, after a wrong use of the command line."""
    if isinstance(error, click.MissingParameter) and error.param and error.param.name == "case":
        return f"`{program} list` shows the shipped ones.\n"
    if isinstance(error, click.NoSuchOption) and error.option_name in ("-n", "-np", "--ranks"):
        return f"Ranks are asked for in front: mpirun -n N {program} ...\n"
    if "extra argument" in error.message and "." in error.message:
        return "A setting is one word: --set KEY=VALUE\n"
    return ""


def end_all_ranks() -> None:
    """End this rank by a signal, so that the launcher ends the others, which may wait for it: it does not where a rank
    exits before it has started MPI.
    """
    if any(name in os.environ for name in RANK_VARIABLES):
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)


def mend_streams() -> None:
    """Open standard streams that are closed on /dev/null, as files opened later would take their numbers, and let them
    show characters that the terminal cannot show as escapes.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which this is
            setattr(sys, name, open(number, "r+" if number == 0 else "w", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def build(app_loader: AppLoader, name: str, title: str) -> click.Group:
    """The command group of one simulator; `app_loader` is called by the verbs that need the app."""
    group = CommandLine(app_loader, name, title)
    return click.version_option(__version__, prog_name=name)(group)


def program(app_loader: AppLoader, name: str, title: str) -> None:
    """Run the command group and end the process, after the exit functions of Python and C libraries. The interpreter is
    not taken apart: that costs half a second, and the system does it as well.
    """
    mend_streams()
    gc.set_threshold(50_000)  # new objects: imports make hundreds of thousands that stay
    try:
        build(app_loader, name, title)()
    except SystemExit as end:
        if not isinstance(end.code, int):
            raise
        code = end.code
    except BaseException:
        sys.excepthook(*sys.exc_info())
        end_all_ranks()
        code = 1
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # full, or gone: what mattered has been printed
            stream.flush()
    atexit._run_exitfuncs()
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi and mpi.Is_initialized() and not mpi.Is_finalized():
        mpi.Finalize()  # mpi4py would do it as the interpreter ends
        if code:
            gc.collect()  # HDF5's handler fails at some things that a traceback has kept open
        # MPICH takes leave of its launcher in an exit handler of C; one that saw no leave kills the other ranks (exit
        # code 9 or 0, whatever ours is). With the interpreter locked: handlers may call it.
        ctypes.PyDLL(None).exit(code)
    os._exit(code)
