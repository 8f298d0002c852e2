import os
import stat
import subprocess
import sys
import warnings
from pathlib import Path

import numba
import numpy as np
import pytest

from hpcpic.core.cli.rates import keep_rates, read_rates
from hpcpic.core.errors import FileError
from hpcpic.core.simd import jit
from hpcpic.core.simd.generate import module_from_source


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """cache_directory() of a fresh process with its root in tmp_path."""
    monkeypatch.setenv("HPCPIC_CACHE_DIR", str(tmp_path / "root"))
    return jit.cache_directory.__wrapped__


def test_cache_is_private_and_stable(cache, tmp_path):
    folder = cache()
    assert folder.parent == tmp_path / "root" / str(os.getuid())
    for part in (folder, folder.parent):
        assert stat.S_IMODE(part.stat().st_mode) == 0o700
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache() == folder


def test_default_root_is_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.delenv("HPCPIC_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert jit.cache_directory.__wrapped__().is_relative_to(tmp_path / "hpcpic")


def test_a_user_without_a_home_keeps_nothing_and_is_told(monkeypatch):
    for name in ("HPCPIC_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # what it does where the system knows of no home
    with pytest.warns(RuntimeWarning, match="no home folder; set HPCPIC_CACHE_DIR"):
        assert jit.cache_directory.__wrapped__().is_dir()
    assert read_rates() == {}
    with pytest.raises(FileError, match="no home folder"):
        keep_rates({"update": 1.0})


@pytest.mark.parametrize("level", ["user", "hash"])
@pytest.mark.parametrize("fault", ["link", "group", "others"])
def test_unsafe_cache_is_refused_with_one_warning(cache, tmp_path, level, fault):
    folder = cache()
    victim = folder if level == "hash" else folder.parent
    if fault == "link":
        victim.rename(tmp_path / "elsewhere")
        victim.symlink_to(tmp_path / "elsewhere")
    else:
        victim.chmod(0o770 if fault == "group" else 0o702)
    with pytest.warns(RuntimeWarning, match="not kept") as caught:
        fresh = cache()
        others = [cache(program) for program in ("sph", "lbmdem")]
    if level == "user":  # one folder and one reason for the code of all programs
        assert others == [fresh, fresh]
    assert len(caught) == 1
    assert not fresh.is_relative_to(tmp_path / "root")
    assert stat.S_IMODE(fresh.stat().st_mode) == 0o700


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_cache_of_another_user_is_refused(cache):
    os.chown(cache().parent, 12345, 12345)
    with pytest.warns(RuntimeWarning, match="another user"):
        cache()


def test_kernel_sources_decide_the_folder(cache, monkeypatch, tmp_path):
    names = {source.name for source in jit._kernel_sources("")}
    assert {"jit.py", "vector.py", "scheduler.py", "domain.py"} <= names and "poisson.py" not in names
    assert "push.py" in {source.name for source in jit._kernel_sources("hpcpic.plasma")}
    files = ["hpcpic/core/space/shape.py", "hpcpic/pic/kernels/push.py", "other/kernels/push.py", "other/front.py"]
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("x = 1\n")
    monkeypatch.setattr(jit, "_ROOT", tmp_path)
    programs = ["", "hpcpic.pic", "other", jit.EVERY]
    assert [jit.program_of(f"{name}.kernels.push") for name in programs[1:3]] == programs[1:3]
    assert jit.program_of("hpcpic.core.space.exact") == "" and jit.program_of("numpy.linalg") is None
    concerned = [programs, ["hpcpic.pic", jit.EVERY], ["other", jit.EVERY], []]
    for file, touched in zip(files, concerned, strict=True):
        before = [cache(program) for program in programs]
        (tmp_path / file).write_text("x = 2\n")
        after = [cache(program) for program in programs]
        assert [p for p, a, b in zip(programs, before, after, strict=True) if a != b] == touched, file
        assert len(set(after)) == len(programs)


def test_compiled_code_lies_with_its_program():
    def folder(function):
        return Path(function._cache.cache_path).parent

    from hpcpic.core.space.exact import __dict__ as core
    from hpcpic.plasma.kernels.plain import __dict__ as plasma

    for names, program in ((core, ""), (plasma, "hpcpic.plasma")):
        kernels = [value for value in names.values() if hasattr(value, "py_func")]
        own = [kernel for kernel in kernels if kernel.__module__ == names["__name__"]]
        assert own and {folder(kernel) for kernel in own} == {jit.cache_directory(program)}
    head = "from hpcpic.core.simd.jit import njit\n"
    uses = "from hpcpic.plasma.kernels import plain\n"
    tail = "@njit\ndef f(x):\n    return x\n"
    assert folder(module_from_source(head + tail, "kept").f) == jit.cache_directory("")
    assert folder(module_from_source(head + uses + tail, "kept").f) == jit.cache_directory("hpcpic.plasma")


def test_settings_of_the_compiler_decide_the_folder(cache, monkeypatch):
    before = cache()
    monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")
    assert cache() != before


def test_njit_divides_as_ieee_and_keeps_nan():
    module = module_from_source(
        "from hpcpic.core.simd.jit import njit\n@njit\ndef inverse(x):\n    return 1.0 / x, x != x\n",
        "inverse",
    )
    assert module.inverse(0.0) == (np.inf, False)
    assert module.inverse(np.nan)[1]


def test_same_text_is_the_same_module(tmp_path):
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


def test_many_processes_write_one_module_once(tmp_path):
    code = (
        "from hpcpic.core.simd.generate import module_from_source as m\n"
        "import os\nf = m('x = 5\\n' * 20000, 'race')\nprint(f.x, os.stat(f.__file__).st_ino)"
    )
    environment = os.environ | {"HPCPIC_CACHE_DIR": str(tmp_path)}
    runs = [
        subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    said = {run.communicate(timeout=60)[0] for run in runs}
    assert len(said) == 1
    assert said.pop().startswith("5 ")
    assert not list(tmp_path.rglob("*.draft"))


def test_what_is_compiled_is_counted_and_what_is_there_is_not():
    before = jit.compilations.n
    double = numba.njit(lambda x: 2 * x)
    assert (double(1), double(2)) == (2, 4)
    assert jit.compilations.n == before + 1


def test_a_rate_that_cannot_be_was_not_measured(cache):
    cache()
    keep_rates({"update": 1.0, "triad": -2.0, "memory_ns": float("nan"), "message_gb_s": float("inf")})
    assert read_rates() == {"update": 1.0}
