"""The bits of every shipped case after a few steps are those that are stored: what moves code moves no bit.

A change of the physics changes them knowingly: `python tests/validation/test_digests.py` stores them anew, for the
processor that it runs on. They depend on the width of registers: in the lanes of these SPH adds up its pairs; why the
plasma's differ has not been found out.
"""

import json
from pathlib import Path

import pytest

import hpcpic
import lbmdem
import sph
from hpcpic.core.files.provenance import cpu
from hpcpic.core.simd.registers import has_avx512

STORED = Path(__file__).parents[1] / "data/digests.json"
STEPS = 4
LONG = ("column-impact-f", "column-impact-h", "column-impact-i", "column-impact-j", "column-impact-k")  # 5 mm
PROGRAMS = {"hpcpic": hpcpic, "sph": sph, "lbmdem": lbmdem}
CASES = [(name, case) for name, package in PROGRAMS.items() for case in package.cases() if case not in LONG]


def registers() -> str:
    return f"registers of {64 if has_avx512() else 32} bytes"


def digest(name: str, case: str) -> str:
    with PROGRAMS[name].Case(case).simulation(threads=1) as sim:
        sim.advance(steps=STEPS)
        return sim.digest()


def stored_for(width: str) -> list[dict[str, str]]:
    """What processors with registers of this width gave."""
    return [found for name, found in json.loads(STORED.read_text()).items() if name.endswith(width)]


def test_processors_with_registers_of_one_width_gave_the_same_bits():
    for width in ("registers of 64 bytes", "registers of 32 bytes"):
        every = stored_for(width)
        for case in {case for found in every for case in found}:
            assert len({found[case] for found in every if case in found}) == 1


@pytest.mark.validation
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("name", "case"), CASES)
def test_the_bits_of_shipped_cases_are_those_that_are_stored(name, case):
    found = stored_for(registers())
    if not found:
        pytest.skip(f"no digests are stored for {registers()}")
    known = {one[f"{name} {case}"] for one in found if f"{name} {case}" in one}
    assert {digest(name, case)} == known


if __name__ == "__main__":
    kept = json.loads(STORED.read_text()) if STORED.exists() else {}
    kept[f"{cpu()}, {registers()}"] = {f"{name} {case}": digest(name, case) for name, case in CASES}
    STORED.write_text(json.dumps(kept, indent=1) + "\n")
