import functools
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np
import pytest
from llvmlite import binding, ir

from hpcpic.core.app.rates import keep_rates, read_rates
from hpcpic.core.simd import caches, compile
from hpcpic.core.simd.generate import module_from_source
from hpcpic.core.tasks import adapter

HALF = "from hpcpic.core.simd.compile import njit\n@njit\ndef half(x):\n    return 0.5 * x\n"


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """Where a fresh process keeps the compiled code of a program, with the cache root in tmp_path."""
    monkeypatch.setenv("HPCPIC_CACHE_DIR", str(tmp_path / "root"))
    caches._warned.clear()

    def folder(program=""):
        return compile.kernel_store.__wrapped__(program).folder.path

    return folder


@pytest.fixture
def fresh(cache, monkeypatch):
    """half(3.0) of a fresh process: its value, and how many signatures were compiled and not taken from a file."""

    def half():
        monkeypatch.setattr(compile, "kernel_store", functools.cache(compile.kernel_store.__wrapped__))
        function = module_from_source(HALF, "half").half
        del sys.modules[function.__module__]
        return function(3.0), sum(function.stats.cache_misses.values())

    return half


DAMAGES = {
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "zeros": lambda content: bytes(len(content)),
    "flipped": lambda content: content[:-9] + bytes([content[-9] ^ 4]) + content[-8:],
    "long": lambda content: content + b"x",
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_kernel_is_compiled_anew_and_kept_and_told_once(cache, fresh, caplog, damage):
    assert fresh() == (1.5, 1) and fresh() == (1.5, 0)
    (path,) = cache().iterdir()
    sound = path.read_bytes()
    path.write_bytes(damage(sound))
    assert fresh() == (1.5, 1)
    assert [record.message.count("damaged files") for record in caplog.records] == [1]
    assert fresh() == (1.5, 0)


def test_what_cannot_be_unpickled_or_is_of_another_signature_is_compiled_anew(cache, fresh):
    fresh()
    (path,) = cache().iterdir()
    store = compile.kernel_store()
    for content in (b"no pickle", compile.dumps(("another key", ()))):
        store.write(path.name, content)
        assert fresh() == (1.5, 1) and fresh() == (1.5, 0)


def test_a_full_disk_costs_one_warning(disk, fresh, monkeypatch, caplog):
    """Kernels are compiled in memory; what is there already is used."""
    monkeypatch.setenv("HPCPIC_CACHE_DIR", str(disk / "root"))
    fresh()
    (path,) = (disk / "root").rglob("*.kernel")
    path.unlink()
    with open(disk / "filler", "wb", buffering=0) as filler, pytest.raises(OSError, match="No space left"):
        while True:
            filler.write(bytes(4096))
    assert fresh() == (1.5, 1) and fresh() == (1.5, 1)
    (record,) = caplog.records
    assert "No space left on device" in record.message and "HPCPIC_CACHE_DIR" in record.message
    assert not [name for name in os.listdir(path.parent) if name != "filler"]  # no half files


def test_an_adapter_is_kept_and_a_damaged_one_made_anew(cache, monkeypatch, caplog):
    kind = ir.FunctionType(ir.IntType(32), [ir.IntType(64).as_pointer()] * 2 + [ir.IntType(64)])

    def make():
        monkeypatch.setattr(adapter, "kernel_store", functools.cache(compile.kernel_store.__wrapped__))
        address, _owner = adapter.adapter.__wrapped__(kind, 64)
        return address

    assert make()
    (path,) = cache().iterdir()
    sound = path.read_bytes()
    for damage in DAMAGES.values():
        path.write_bytes(damage(sound))
        assert make()
        assert len(path.read_bytes()) == len(sound)
    assert make() and {"damaged files" in record.message for record in caplog.records} == {True}


def test_a_function_without_a_source_is_not_kept(cache, monkeypatch):
    """Its constants are not in its code: another one would be taken for it."""
    monkeypatch.setattr(compile, "kernel_store", functools.cache(compile.kernel_store.__wrapped__))
    for number in (1.5, 2.5):
        names = {"njit": compile.njit, "__name__": "typed"}
        exec(f"@njit\ndef f(x):\n    return {number} * x\n", names)
        assert names["f"](2.0) == 2.0 * number


RULES = "def own(x):\n    return x\n\n\ndef returned(x):\n    return own(x)\n"
CALLING = "from hpcpic.core.simd.compile import njit\nfrom {} import {}\n@njit\ndef {}(x):\n    return {}\n"


def test_what_may_call_a_function_of_the_users_own_is_kept_apart_and_nothing_else(cache, monkeypatch):
    """By way of others too; one that was typed in, whose text nobody knows, is taken for no other."""

    def misses(factor, mine=None):
        monkeypatch.setattr(compile, "kernel_store", functools.cache(compile.kernel_store.__wrapped__))
        monkeypatch.setattr(compile, "_own", {})
        made = [module_from_source(RULES, "rules"), module_from_source(HALF, "half")]
        rules, half = made[0], made[1].half
        if mine is None:
            made.append(module_from_source(f"def own(x):\n    return {factor} * x\n", "mine"))
            mine = made[-1].own
        rules.own = mine
        compile.formula(rules.returned)
        compile.depends_on(rules.__name__, mine)
        for name, call in (("bounce", "returned(x)"), ("twice", "bounce(bounce(x))")):
            of = rules if name == "bounce" else made[-1]
            made.append(module_from_source(CALLING.format(of.__name__, call.partition("(")[0], name, call), name))
        assert (made[-1].twice(3.0), half(3.0)) == (3.0 * factor**2, 1.5)
        for module in made:
            del sys.modules[module.__name__]
        return [sum(one.stats.cache_misses.values()) for one in (made[-2].bounce, made[-1].twice, half)]

    assert misses(2.0) == [1, 1, 1] and misses(2.0) == [0, 0, 0] and misses(4.0) == [1, 1, 0]
    for factor in (5.0, 6.0):
        typed = {}
        exec(f"def own(x):\n    return {factor} * x\n", typed)
        assert misses(factor, typed["own"]) == [1, 1, 0]


@pytest.mark.parametrize("what", ["get_host_cpu_name", "get_host_cpu_features"])
def test_code_of_one_processor_is_not_run_on_another(cache, monkeypatch, what):
    """With instructions that it lacks a program would end without a word."""
    before = cache()
    feature = next(iter(binding.get_host_cpu_features()))
    other = {feature: not binding.get_host_cpu_features()[feature]}
    features = binding.FeatureMap({**binding.get_host_cpu_features(), **other})
    monkeypatch.setattr(binding, what, lambda: "another" if what == "get_host_cpu_name" else features)
    assert cache() != before


@pytest.mark.parametrize("setting", ["NUMBA_CPU_NAME=generic", "NUMBA_CPU_FEATURES=+sse2", "NUMBA_OPT=1"])
def test_a_setting_of_the_compiler_has_code_of_its_own(cache, monkeypatch, setting):
    before = cache()
    monkeypatch.setenv(*setting.split("="))
    assert cache() != before


def test_a_version_has_code_of_its_own(cache, monkeypatch):
    before = cache()
    for name in ("numba", "llvmlite", "numpy"):
        with monkeypatch.context() as patch:
            patch.setattr(compile, "version", lambda asked, name=name: "0" if asked == name else version(asked))
            assert cache() != before
    monkeypatch.setattr(sys.implementation, "cache_tag", "cpython-0")
    assert cache() != before


def test_kernel_sources_decide_the_folder(cache, monkeypatch, tmp_path):
    names = {source.name for source in compile._kernel_sources("")}
    assert {"compile.py", "vector.py", "scheduler.py", "domain.py", "bench.py"} <= names
    assert not {"poisson.py", "loop.py"} & names  # the loop asks only how many functions were compiled
    assert "push.py" in {source.name for source in compile._kernel_sources("hpcpic.plasma")}
    lines = b"import compilations, njit\n", b"import (\n    compilations,\n    njit,\n)\n", b"import compilations\n"
    assert [bool(compile._COMPILES.search(b"from hpcpic.core.simd.compile " + line)) for line in lines] == [1, 1, 0]
    files = ["hpcpic/core/space/shape.py", "hpcpic/pic/kernels/push.py", "other/kernels/push.py", "other/front.py"]
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("x = 1\n")
    monkeypatch.setattr(compile, "_ROOT", tmp_path)
    programs = ["", "hpcpic.pic", "other", compile.EVERY]
    assert [compile.program_of(f"{name}.kernels.push") for name in programs[1:3]] == programs[1:3]
    assert compile.program_of("hpcpic.core.space.exact") == "" and compile.program_of("numpy.linalg") is None
    concerned = [programs, ["hpcpic.pic", compile.EVERY], ["other", compile.EVERY], []]
    for file, touched in zip(files, concerned, strict=True):
        before = [cache(program) for program in programs]
        (tmp_path / file).write_text("x = 2\n")
        after = [cache(program) for program in programs]
        assert [p for p, a, b in zip(programs, before, after, strict=True) if a != b] == touched, file
        assert len(set(after)) == len(programs)


def test_compiled_code_lies_with_its_program():
    def folder(function):
        return Path(function.stats.cache_path)

    from hpcpic.core.space.exact import __dict__ as core
    from hpcpic.plasma.kernels.plain import __dict__ as plasma

    for names, program in ((core, ""), (plasma, "hpcpic.plasma")):
        kernels = [value for value in names.values() if hasattr(value, "py_func")]
        own = [kernel for kernel in kernels if kernel.__module__ == names["__name__"]]
        assert own and {folder(kernel) for kernel in own} == {compile.kernel_store(program).folder.path}
    head = "from hpcpic.core.simd.compile import njit\n"
    uses = "from hpcpic.plasma.kernels import plain\n"
    tail = "@njit\ndef f(x):\n    return x\n"
    assert folder(module_from_source(head + tail, "kept").f) == compile.kernel_store().folder.path
    assert folder(module_from_source(head + uses + tail, "kept").f) == compile.kernel_store("hpcpic.plasma").folder.path


def test_njit_divides_as_ieee_and_keeps_nan():
    module = module_from_source(
        "from hpcpic.core.simd.compile import njit\n@njit\ndef inverse(x):\n    return 1.0 / x, x != x\n",
        "inverse",
    )
    assert module.inverse(0.0) == (np.inf, False)
    assert module.inverse(np.nan)[1]


def test_same_text_is_the_same_module():
    source = "value = 41\n"
    module = module_from_source(source, "constant")
    assert module_from_source(source, "constant") is module
    other = module_from_source("value = 42\n", "constant")
    assert (module.value, other.value) == (41, 42)
    assert module.__file__ != other.__file__


def test_faulty_text_leaves_no_module():
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            module_from_source("1 / 0\n", "faulty")


def test_a_generated_text_is_shown_in_tracebacks():
    module = module_from_source("def fail():\n    raise ValueError  # in this very line\n", "told")
    with pytest.raises(ValueError) as caught:
        module.fail()
    assert "in this very line" in str(caught.traceback[-1].statement)


def test_processes_at_once_keep_one_kernel(tmp_path):
    """One of them compiles it, the others wait for that."""
    code = (
        f"from hpcpic.core.simd.generate import module_from_source as m\nhalf = m({HALF!r}, 'race').half\n"
        "print(half(3.0), *half.stats.cache_misses.values())"
    )
    environment = os.environ | {"HPCPIC_CACHE_DIR": str(tmp_path)}
    words = [sys.executable, "-W", "error", "-c", code]
    runs = [subprocess.Popen(words, env=environment, stdout=-1, stderr=-1, text=True) for _ in range(3)]
    assert sorted(run.communicate(timeout=60) for run in runs) == [("1.5\n", "")] * 2 + [("1.5 1\n", "")]
    assert len([*tmp_path.rglob("*.kernel")]) == 1 and not [*tmp_path.rglob("*.tmp")]


def test_what_is_compiled_is_counted_and_what_is_there_is_not():
    before = compile.compilations.n
    double = numba.njit(lambda x: 2 * x)
    assert (double(1), double(2)) == (2, 4)
    assert compile.compilations.n == before + 1


def test_a_rate_that_cannot_be_was_not_measured(cache):
    assert read_rates() == {}
    keep_rates({"update": 1.0, "triad": -2.0, "memory_ns": float("nan"), "message_gb_s": float("inf")})
    assert read_rates() == {"update": 1.0}


BOTH_WAYS = """
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.tasks.graph import Pool, bind

@njit
def add(a, k):
    a[k] += 1.0

@njit
def outer(a, k):
    add(a, k)

a = np.zeros(2)
task = bind(add, a=a, k=0)
outer(a, 1)  # `add` has no wrapper for Python until Python calls it
add(a, 1)
Pool(1).each([task, bind(outer, a=a, k=0)])
add(a, 1)
print(a.tolist())
"""


def test_a_kernel_of_tasks_and_kernels_can_be_called_from_python_too(tmp_path):
    """Compiled, and as it is kept."""
    script = tmp_path / "both_ways.py"
    script.write_text(BOTH_WAYS)
    settings = os.environ | {"HPCPIC_CACHE_DIR": str(tmp_path / "cache")}
    for _ in range(2):
        done = subprocess.run([sys.executable, script], env=settings, capture_output=True, text=True)
        assert done.stdout == "[2.0, 3.0]\n", done.stderr
