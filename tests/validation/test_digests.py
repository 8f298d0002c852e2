"""The bits of every shipped case after a few steps are those that are stored: what moves code moves no bit.

A change of the physics changes them knowingly: `python tests/validation/test_digests.py` stores them anew. They are the
same on every x86-64 processor with AVX2 and FMA: vectors hold 64 bytes on all of them, sums have an order, and sines
and logarithms are those of the C library (core.space.elementary). That was tried on a processor with AVX-512, and there
with all that chooses code by processor told otherwise: numba, numpy and OpenBLAS. Another C library may round
logarithms otherwise. On 64-bit ARM those of SPH and the lattice are the same, where FFTW rounds otherwise.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

import hpcpic
import lbmdem
import sph
from hpcpic.core.files.provenance import cpu

STORED = Path(__file__).parents[1] / "data/digests.json"
STEPS = 4
LONG = ("column-impact-f", "column-impact-h", "column-impact-i", "column-impact-j", "column-impact-k")  # 5 mm
PROGRAMS = {"hpcpic": hpcpic, "sph": sph, "lbmdem": lbmdem}
CASES = [(name, case) for name, package in PROGRAMS.items() for case in package.cases() if case not in LONG]
SMALL = [
    {"hpcpic": "bump-on-tail"},  # which takes sines and logarithms
    pytest.param({"sph": "still-tank", "lbmdem": "couette"}, marks=pytest.mark.validation),
    pytest.param(
        {"hpcpic": "landau-damping", "sph": "standing-wave", "lbmdem": "taylor-green"}, marks=pytest.mark.validation
    ),
]
CHILD = """
import sys
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from test_digests import digest
assert not any(__cpu_features__[one] for one in __cpu_dispatch__)
print(digest(*sys.argv[1:]))
"""


def digest(name: str, case: str) -> str:
    with PROGRAMS[name].Case(case).simulation(threads=1) as sim:
        sim.advance(steps=STEPS)
        return sim.digest()


def processor() -> str:
    forced = os.environ.get("NUMBA_CPU_FEATURES")
    wide = "+avx512f" in (forced or binding.get_host_cpu_features().flatten())
    return f"{cpu()}, {'AVX-512' if wide else 'AVX2'}{' forced' if forced else ''}"


def stored() -> dict[str, str]:
    return json.loads(STORED.read_text())["digests"]


@pytest.mark.validation
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("name", "case"), CASES)
def test_the_bits_of_shipped_cases_are_those_that_are_stored(name, case):
    assert digest(name, case) == stored()[f"{name} {case}"]


@pytest.mark.timeout(900)  # on a busy machine; else within a minute
@pytest.mark.parametrize("small", SMALL)
def test_a_processor_without_avx512_gives_the_same_bits(small):
    """Numba, numpy and OpenBLAS are told that they run on one. Where they do, the stored bits are expected, and the
    kernels are those of other tests.
    """
    host = binding.get_host_cpu_features()
    dispatched = " ".join(one for one in __cpu_dispatch__ if __cpu_features__[one])
    told = {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": dispatched}
    if host["avx512f"]:
        told["NUMBA_CPU_FEATURES"] = re.sub(r"\+(avx512|avx10)", r"-\1", host.flatten())
    children = [
        subprocess.Popen([sys.executable, "-c", CHILD, *one], cwd=Path(__file__).parent, env=os.environ | told,
                         stdout=subprocess.PIPE, text=True)
        for one in small.items()
    ]  # fmt: skip
    for (name, case), child in zip(small.items(), children):
        assert child.communicate()[0].strip() == (digest(name, case) if host["avx512f"] else stored()[f"{name} {case}"])


if __name__ == "__main__":
    found = {f"{name} {case}": digest(name, case) for name, case in CASES}
    kept = json.loads(STORED.read_text())
    same = kept["processors"] if kept["digests"] == found else []
    STORED.write_text(json.dumps({"processors": sorted({*same, processor()}), "digests": found}, indent=1) + "\n")
