"""FFTW as addresses: plans made once, executed from compiled tasks.

The library is the one that the pyfftw wheel carries, called through ctypes: importing pyfftw costs 160 ms.
Plans are made with ESTIMATE for one transform at a time, one thread each, so that the bits of a row depend on
the row alone: not on ranks, threads, blocks or what the planner measured. Rows start on 64-byte boundaries.
"""

import ctypes
import functools
import importlib.util
import math
import re
import threading
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

_DESTROY_INPUT, _PRESERVE_INPUT, _ESTIMATE = 1, 16, 64  # flags of fftw3.h
_planner = threading.Lock()  # only fftw_execute_* may run in several threads at once


class Plan(NamedTuple):
    """One transform: `execute(plan, input, output)`, all addresses. Safe in any number of threads."""

    execute: int
    plan: int


def _library_file(stem: str) -> str:
    """Path of pyfftw's own `stem` library (libfftw3 or libfftw3f); ImportError when there is none."""
    spec = importlib.util.find_spec("pyfftw")
    if spec is None or spec.origin is None:
        raise ImportError("pyfftw is not installed; its FFTW library is needed: pip install pyfftw")
    folder = Path(spec.origin).parent
    for found in sorted((folder.parent / "pyfftw.libs").glob(f"{stem}-*.so*")):
        return str(found)
    importlib.import_module("pyfftw")  # linked with a library of the system: see which one it loads
    pattern = re.compile(rf"(/\S*/{stem}(?:-\w+)?\.so\S*)$", re.MULTILINE)
    match = pattern.search(Path("/proc/self/maps").read_text())
    if match is None:
        raise ImportError(f"{stem} not found, neither beside pyfftw nor loaded by it")
    return match.group(1)


@functools.cache
def _library(single: bool) -> ctypes.CDLL:
    return ctypes.CDLL(_library_file("libfftw3f" if single else "libfftw3"))


def _plan(kind: str, shape: tuple[int, ...], dtype: DTypeLike, *tail: int) -> Plan:
    """Call fftw[f]_plan_<kind>(rank, shape, in, out, *tail) on aligned places that ESTIMATE leaves alone."""
    single = np.dtype(dtype) in (np.float32, np.complex64)
    library, prefix = _library(single), "fftwf" if single else "fftw"
    places = np.empty(2 * (16 * math.prod((*shape[:-1], shape[-1] + 2)) + 64), np.uint8)
    source = places.ctypes.data + (-places.ctypes.data) % 64
    target = source + (places.nbytes // 2 & ~63)
    sizes = (ctypes.c_int * len(shape))(*shape)
    make = getattr(library, f"{prefix}_plan_{kind}")
    make.restype = ctypes.c_void_p
    with _planner:
        plan = make(len(shape), sizes, ctypes.c_void_p(source), ctypes.c_void_p(target), *tail)
    if not plan:
        raise ValueError(f"FFTW makes no plan for {kind} of shape {shape}")
    execute = ctypes.cast(getattr(library, f"{prefix}_execute_{kind}"), ctypes.c_void_p).value
    assert execute is not None
    return Plan(execute, plan)


@functools.cache
def real_to_complex(shape: tuple[int, ...], dtype: DTypeLike) -> Plan:
    """Forward: contiguous real[shape] into complex[..., shape[-1] // 2 + 1]. Keeps its input."""
    return _plan("dft_r2c", shape, dtype, _ESTIMATE | _PRESERVE_INPUT)


@functools.cache
def complex_to_real(shape: tuple[int, ...], dtype: DTypeLike) -> Plan:
    """Inverse (not normalised) of complex[..., shape[-1] // 2 + 1] into real[shape]. Destroys its input."""
    return _plan("dft_c2r", shape, dtype, _ESTIMATE | _DESTROY_INPUT)


@functools.cache
def complex_to_complex(n: int, sign: int, dtype: DTypeLike) -> Plan:
    """Contiguous complex[n], exponent of `sign`: -1 forward, 1 inverse (not normalised). Keeps its input."""
    return _plan("dft", (n,), dtype, sign, _ESTIMATE | _PRESERVE_INPUT)
