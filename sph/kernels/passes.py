"""The passes over all pairs: lines of formulas put into loops over layers, bodies, rows and vectors of neighbours.

Each pair of bodies is met once, for both, along the runs that `runs.find` has found. Layers of even number come first,
then the odd ones; each adds to what it and the next one have, so that those of a kind are independent and the result
does not depend on who computes them. Lanes count from the start of a run.

Lengths, velocities, densities and masses are in units that the numbers of a scene know: in double precision the state
is read as it is held, in SI units; in single, columns in those of c0, rho0 and rho0 h^d, positions in UNIT. F lacks the
factor of its kernel, which the scales of a scene make up for in the sums.

The kernels are text that calls the formulas of `terms` by name. What a formula needs is known by its parameters: lines
that compute it are put before it, once.
"""

from collections.abc import Sequence
from types import ModuleType

import numpy as np

from hpcpic.core.simd.compile import formula, formulas
from hpcpic.core.simd.generate import module_from_source
from hpcpic.core.simd.vector import lanes
from sph.kernels.marks import EDGE, EXTRAPOLATED, FLOWS, PARTNERS, PLAIN, REPULSIVE, SLIPS
from sph.physics import terms, vectors
from sph.physics.pair_spec import NUMBERS, Line, PairSpec, Pass, columns_of, passes_of, state_of, sums_of
from sph.physics.smoothing import SMOOTHING
from sph.physics.terms import needs

formulas(terms, vectors)

ROWS = {2: 2, 3: 5}  # as kernels.runs has them
FRESH = {2: (1,), 3: (1, 4)}  # of these, which the row before has not met
ARGUMENTS = (
    "block, blocks, odd, begin, base, shape, numbers, run_first, run_length, flags, position, v, drho, m, values, sums"
)
GIVEN = ("d", "n", "beyond", "solid_i", "solid_j")  # that the loops compute
MASKS = {"both_flow": f"kinds & class_i & {FLOWS} == {FLOWS}"}  # of pairs, by their flags (see `Pairs`)
WALL_MASKS = {  # the same, in cases with walls that follow the fluid
    "one_follows": f"(kinds ^ class_i) & {EXTRAPOLATED} != 0",
    "at_edges": f"(kinds | class_i) & {EDGE} != 0",
    "one_sticks": f"(kinds ^ class_i) & {EXTRAPOLATED | SLIPS} == {EXTRAPOLATED}",
    "none_slips": f"(kinds | class_i) & {SLIPS} | (kinds & class_i) & {EXTRAPOLATED} == 0",
}

HEAD = """
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from hpcpic.core.simd.vector import (
    Vec, address_of, bitmask, convert, fma, lane_numbers, load, prefetch, prefetch_to_write, select, splat, store, total
)
from sph.kernels.runs import across_a_film
from sph.physics import terms
from sph.physics.smoothing import SMOOTHING
from {clear} import clear

REAL = np.{real}
F_ = Vec({lanes}, REAL)
I_ = Vec({lanes}, np.int32)
LANES_ = np.int64({lanes})
smoothing = SMOOTHING[{kernel!r}]
smoothing_w, smoothing_f = smoothing.w, smoothing.f
FAR2 = REAL((2.0 * smoothing.support) ** 2)  # in h^2: where F is 0
"""

BEYOND = (  # r^2 of lanes behind the end of a run: from `LANES_ - those before it` on
    "beyonds = zeros(2 * LANES_, REAL)",
    "beyonds[LANES_:] = FAR2 / (per_h * per_h)",
)

CLEAR = """
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, splat, store

F_ = Vec({lanes}, np.{real})


@njit
def clear(line, first, last):
    for k in range(first, last, {lanes}):
        store(line, k, splat(F_, 0.0))
"""


class PassText:
    """The kernel of one pass."""

    def __init__(self, spec: PairSpec, title: str, one: Pass) -> None:
        self.spec, self.title, self.one = spec, title, one
        self.sums = sums_of(spec, one)
        self.columns = set[str]()  # that the text reads
        self._pair(mixed=True)  # finds them

    @property
    def source(self) -> str:
        spec, columns, n = self.spec, columns_of(self.spec), len(self.sums)
        read = sorted(self.columns)
        places = {name: f"values[{columns.index(name)}]" for name in columns} | ({} if spec.single else state_of(spec))
        if spec.in_turn:
            places["volume"] = places["light"]
        numbers = [f"{name} = REAL(numbers[{k}])" for k, name in enumerate(NUMBERS)]
        numbers += [f"{name} = {_tuple(spec.components(name))}" for name in ("gravity", "fall")]
        lines = [f"{a}_ = position[{k}]" for k, a in enumerate(spec.axes)] + [f"{c}_ = {places[c]}" for c in read]
        fetch = [f"{name}_i = {name}_[u]" for name in (*spec.axes, *read)] + self._tuples("i")
        fetch += [f"sum{k} = splat(F_, 0.0)" for k in range(n)]
        fetch += self._fetch_ahead([line.split(" ")[0] for line in lines])
        lines += [f"sums{k} = sums[{k}]" for k in range(n)]
        if self.one.wall:
            lines += [f"{name}_ = {places[name]}" for name in spec.components("n")]
        return (
            f"\n\n@njit\ndef {self.title}({ARGUMENTS}):\n"
            + _indent([*numbers, *lines, *BEYOND, "zero = splat(F_, 0.0)"], 4)
            + _indent(["for l in range(blocks[block], blocks[block + 1]):"], 4)
            + _indent(["if (shape[2] + l) & 1 != odd:", "    continue"], 8)
            + _indent(["first, last = base[l], base[l] + begin[l + 1] - begin[l]"], 8)
            + _indent(["if odd == 0:  # the first that adds to these two"], 8)
            + _indent([f"clear(sums{k}, first, base[l + 2])" for k in range(n)], 12)
            + _indent(["for i in range(first, last):", "    u = np.uint64(i)  # numba looks whether others are < 0"], 8)
            + _indent(fetch, 12)
            + self._neighbours()
            + _indent([f"sums{k}[u] += total(sum{k})" for k in range(n)], 12)
        )

    def _tuples(self, side: str) -> list[str]:
        """Vectors and matrices of one side, of the columns that are read."""
        several = "v", "g", "l", "t", "s", "own", "turn"
        names = {name for name in several if self.columns >= set(self.spec.components(name))}
        return [f"{name}_{side} = {_tuple(f'{c}_{side}' for c in self.spec.components(name))}"
                for name in sorted(names)]  # fmt: skip

    def _fetch_ahead(self, read: Sequence[str]) -> list[str]:
        """Cache lines that bodies soon after i will want first, and no row has before: there are more streams than the
        processor follows by itself.
        """
        lines = []
        for row in FRESH[self.spec.dimensions]:
            lines.append(f"soon = np.int64(run_first[{row}, i]) + np.int64(run_length[{row}, i]) + 4 * LANES_")
            lines += [f"prefetch(address_of({name}, soon))" for name in read]
            lines += [f"prefetch_to_write(address_of(sums{k}, soon))" for k in range(len(self.sums))]
        return ["if i & (LANES_ // 4 - 1) == 0:", *(f"    {line}" for line in lines)]  # ends vary by more than a line

    def _neighbours(self) -> str:
        """The loops over the runs of a body; those that meet only fluid need no classes."""

        def loop(pair: Sequence[str], depth: int) -> str:
            head = [
                f"for row in range({ROWS[self.spec.dimensions]}):",
                "    j = np.int64(run_first[np.uint64(row), u])",
                "    end = j + np.int64(run_length[np.uint64(row), u])",
                "    while j < end:",
            ]
            return _indent(head, depth) + _indent([*pair, "j += LANES_"], depth + 8)

        plain, mixed = self._pair(mixed=False), self._pair(mixed=True)
        if not self.spec.walls:
            return loop(plain, 12)
        body = _indent(["class_i = flags[u]"], 12)
        if self.one.by_volume and self.spec.without_volume:
            return body + _indent([f"if class_i & {REPULSIVE} == 0:"], 12) + loop(plain, 16)
        if not self.one.inside:
            return body + _indent([f"if class_i & {PLAIN} == 0:"], 12) + loop(mixed, 16)
        body += _indent([f"if class_i & {PLAIN} == {PLAIN}:"], 12) + loop(plain, 16)
        if self.one.wall:
            body += _indent([f"elif class_i & {REPULSIVE} != 0:", "    solid_i, mass_i = mass_i, REAL(0.0)"], 12)
            body += loop(self._wall_pair(), 16)
        body += _indent(["else:"], 12)
        if self.one.wall:
            body += _indent(["solid_i = REAL(0.0)"], 16)
        return body + loop(mixed, 16)

    def _pair(self, mixed: bool) -> list[str]:
        """One vector of neighbours; not mixed: all are fluid and near none that is not."""
        known = {*GIVEN, *NUMBERS, "gravity", "fall"}
        first = self._first(known, mixed)
        lines = [line for one in self.one.lines for line in self._line(one, known, mixed)]
        for _, _, by in self.one.sums:
            lines += [line for name in by for line in self._prepared(name, known, mixed)]
        for k, (name, to, factors) in enumerate(self._parts()):
            lines.append(f"sum{k} = fma({to[0]}, {factors[0]}, sum{k})  # {name}")
            lines.append(f"store(sums{k}, j, fma({to[1]}, {factors[1]}, load(F_, sums{k}, j)))")
        if self.one.wall and mixed:
            lines += ["repels = stands & (F != 0.0)", "if bitmask(repels) != 0:"]
            lines += [f"    {line}" for line in self._wall_force(known)]
        return first + self._loads(mixed) * (not self.one.midway) + lines

    def _wall_pair(self) -> list[str]:
        """One vector of neighbours of a particle of a repulsive wall, to which all else gives nothing."""
        known = {*GIVEN, *NUMBERS, "gravity", "fall"}
        return self._first(known, True) + self._loads(True) + self._wall_force(known)

    def _first(self, known: set[str], mixed: bool) -> list[str]:
        """What is found first: d and F, 0 between two that have nothing to do with each other."""
        lines = self._distance(known, mixed) + self._prepared("F", known, mixed)
        if mixed:
            lines += ["kinds = load(I_, flags, j)", f"partners = (kinds | class_i) & {PARTNERS} == {PARTNERS}"]
            if self.one.films:
                lines.append("partners = partners | across_a_film(kinds, class_i)")
            lines += ["F = select(partners, F, 0.0)"]
        return lines

    def _loads(self, mixed: bool) -> list[str]:
        lines = [f"{name}_j = load(F_, {name}_, j)" for name in sorted(self.columns)]
        if self.one.wall and mixed:  # repulsive walls have neither mass nor volume
            lines += [f"stands = kinds & {REPULSIVE} != 0", "solid_j = select(stands, mass_j, 0.0)"]
            lines += ["mass_j = select(stands, 0.0, mass_j)"]
        return lines + self._tuples("j")

    def _distance(self, known: set[str], mixed: bool) -> list[str]:
        read = "convert(F_, {a}_i - load(I_, {a}_, j))" if self.spec.single else "{a}_i - load(F_, {a}_, j)"
        lines = [f"d = {_tuple(read.format(a=a) for a in self.spec.axes)}"]
        if self.one.midway:
            lines = [*lines, *self._prepared("dv", known, mixed), "d = terms.midway(d, dv, half_step)"]
            lines = self._loads(mixed) + lines
        return [*lines, "beyond = load(F_, beyonds, LANES_ - min(end - j, LANES_))"]

    def _parts(self) -> list[tuple[str, tuple[str, str], list[str]]]:
        """Every scalar sum: name, weights, and what they multiply."""
        found = []
        for name, weights, by in self.one.sums:
            parts = self.spec.components(name)
            for k, part in enumerate(parts):
                found.append((part, weights, [f"{term}[{k}]" if len(parts) > 1 else term for term in by]))
        return found

    def _line(self, line: Line, known: set[str], mixed: bool) -> list[str]:
        """A formula and before it what it needs that is not known yet."""
        masks = MASKS | (WALL_MASKS if self.spec.extrapolated else {}) if mixed else {}
        mask = masks.get(line.pairs.mask)
        if not (mask or line.pairs.among_fluid or (mixed and not line.pairs.mask)):
            return []
        lines = [text for name in needs(line.formula) for text in self._prepared(name, known, mixed)]
        known |= set(line.out.split(", "))
        made = f"terms.{line.formula.__name__}({', '.join(needs(line.formula))})"
        if mask:
            made = f"select({mask}, {made}, {line.pairs.elsewhere or line.out})"
        return [*lines, f"{line.out} = {made}"]

    def _prepared(self, name: str, known: set[str], mixed: bool) -> list[str]:
        """Lines that compute a need, unless it is known: of the kernel, a column, or the formula of that name."""
        if name in known:
            return []
        if name in ("W", "F"):
            known.add(name)
            return [*self._prepared("r", known, mixed), f"{name} = smoothing_{name.lower()}(r, per_h)"]
        if name.endswith(("_i", "_j")):
            self.columns.update(self.spec.components(name[:-2]))
            return []
        return self._line(Line(name, getattr(terms, name)), known, mixed)

    def _wall_force(self, known: set[str]) -> list[str]:
        """The further force between a body and a particle of a repulsive wall, which does not reach the support."""
        spec = self.spec
        lines = [f"n = {_tuple(f'load(F_, {n}_, j) - {n}_[i]' for n in spec.components('n'))}"]
        lines += [text for line in self.one.wall for text in self._line(line, known, True)]
        lines += ["partners = partners & (lane_numbers(I_) < np.int32(end - j))"]
        for k, a in enumerate(self.sums[: spec.dimensions]):
            lines += [f"here = select(partners, wall[{k}], 0.0)  # {a}"]
            lines += [f"sum{k} = sum{k} + here", f"store(sums{k}, j, load(F_, sums{k}, j) - here)"]
        return lines


def _tuple(parts) -> str:
    return f"({', '.join(parts)})"


def _indent(lines: Sequence[str], depth: int) -> str:
    return "".join(" " * depth + line + "\n" for line in lines)


def make(spec: PairSpec) -> ModuleType:
    """The compiled kernels, by the titles of `passes_of`, each in a module of its own, which other cases may share."""
    for function in (SMOOTHING[spec.kernel].w, SMOOTHING[spec.kernel].f):
        formula(function)
    known = {"real": spec.real, "lanes": lanes(np.dtype(spec.real))}
    clear = module_from_source(CLEAR.format(**known), "clear").__name__
    head = HEAD.format(**known, kernel=spec.kernel, clear=clear)
    foot = f"\n# {SMOOTHING[spec.kernel].digest}\n"
    made = ModuleType("pairs")
    for title, one in passes_of(spec).items():
        module = module_from_source(head + PassText(spec, title, one).source + foot, f"pairs_{title}")
        setattr(made, title, getattr(module, title))
    return made
