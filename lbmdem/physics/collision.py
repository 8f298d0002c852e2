"""Collisions: what a node makes of its populations, as source text of a sweep and the numbers that it reads.

The text leads from f0..f<q-1> (without their weights) to g0..g<q-1>. BGK and TRT (Ginzburg 2005) are written on sums
and differences of opposite pairs; BGK is TRT with equal rates. "central": central moments about the fluid velocity,
second order relaxed at 1/tau, its trace and all higher orders set to equilibrium (the Maxwellian's; De Rosis 2019 for
D3Q19), which stays stable as tau -> 1/2. The third and fourth orders need not be measured then, so that it costs little
more than TRT. `lbmdem.physics.reference` has all of them in plain numpy.

Numbers may change between steps (the force), the text does not.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lbmdem.physics.forcing import Forcing
from lbmdem.physics.velocity_sets import Lattice


@dataclass(frozen=True)
class Scheme:
    """A collision by its name in a case.

    text(lattice, forced): its lines after the moments. magic: whether odd populations have a rate of their own, from
    (tau - 1/2)(1/odd rate - 1/2). grid_reynolds: the largest U dx/nu of an under-resolved doubly periodic shear layer
    that stays finite, measured. product(tau, magic): that of these, which says where walls lie: half-way at 3/16; None
    where it is not known. dearer: whether a sweep takes longer, by the share "central" of the rates of a machine.
    """

    name: str
    text: Callable[[Lattice, bool], list[str]]
    magic: bool = False
    grid_reynolds: float = math.inf
    product: Callable[[float, float], float] | None = None
    dearer: bool = False


@dataclass(frozen=True)
class Source:
    """The text of a collision, and the names of the numbers that it reads."""

    names: tuple[str, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Collision:
    """A scheme with its relaxation times on a lattice; forcing: how a force enters, None of a fluid without."""

    lattice: Lattice
    scheme: Scheme
    tau: float
    magic: float
    forcing: Forcing | None = None

    @property
    def source(self) -> Source:
        return _source(self.lattice, self.scheme, self.forcing is not None)

    @property
    def rates(self) -> tuple[float, float]:
        """Relaxation rates of even and odd populations."""
        even = 1.0 / self.tau
        return even, 1.0 / (self.magic / (self.tau - 0.5) + 0.5) if self.scheme.magic else even

    def shift(self, force: ArrayLike | None) -> NDArray[np.float64]:
        """The part of a force per volume that belongs to the momentum of the fluid [d]."""
        if self.forcing is None or force is None:
            return np.zeros(self.lattice.dimensions)
        return self.forcing.share * np.asarray(force, float)

    def numbers(self, force: ArrayLike | None) -> NDArray[np.float64]:
        """Values of the names of `source`; force per volume, lattice units."""
        lattice, (even, odd) = self.lattice, self.rates
        values = {"keep_rest": 1 - even, "keep_even": (1 - even) / 2, "keep_odd": (1 - odd) / 2, "keep": 1 - even}
        for k, w in enumerate(_classes(lattice)):
            values |= {f"even{k}": even * w, f"curve{k}": 4.5 * even * w, f"odd{k}": 3 * odd * w}
        if self.forcing is not None:
            vector, left = np.asarray(force, float), self.forcing.factor
            for k, w in enumerate(_classes(lattice)):
                values |= {f"tilt{k}": 9 * left(even) * w, f"work{k}": 3 * left(even) * w}
            for axis, component, part in zip("xyz", vector, self.shift(vector)):
                values |= {f"f{axis}": component, f"h{axis}": part, f"sixth{axis}": component / 6}
            for i, _ in lattice.pairs:
                along = float(lattice.e[i] @ vector)
                values |= {f"along{i}": along, f"push{i}": 3 * left(odd) * lattice.weights[i] * along}
        return np.array([values[name] for name in self.source.names])


@functools.cache
def _source(lattice: Lattice, scheme: Scheme, forced: bool) -> Source:
    lines = _moments(lattice, forced) + scheme.text(lattice, forced)
    words = set(itertools.chain.from_iterable(_words(line.split("=", 1)[1]) for line in lines))
    defined = {name for line in lines for name in _words(line.split("=", 1)[0])}
    given = {f"f{i}" for i in range(lattice.q)} | {"fma"}
    return Source(tuple(sorted(words - defined - given)), tuple(lines))


def _words(text: str) -> list[str]:
    return [word for word in "".join(c if c.isalnum() or c == "_" else " " for c in text).split() if word[0].isalpha()]


def _classes(lattice: Lattice) -> list[float]:
    """The different weights; class 0 is rest."""
    return list(dict.fromkeys(lattice.weights))


def _axes(lattice: Lattice) -> str:
    return "xyz"[: lattice.dimensions]


def _signed(terms: Sequence[tuple[int, str]]) -> str:
    """Sum of +-names, the positive ones first; by halves, so that few additions wait for each other."""
    (sign, name), *others = ordered = sorted(terms, key=lambda term: -term[0])
    if not others:
        return name if sign > 0 else f"-{name}"
    half = (len(ordered) + 1) // 2
    negative = ordered[half][0] < 0
    second = _signed([(-sign if negative else sign, name) for sign, name in ordered[half:]])
    return f"({_signed(ordered[:half])} {'-' if negative else '+'} {second})"


def _moments(lattice: Lattice, forced: bool) -> list[str]:
    """s, d: sums and differences of pairs; drho = rho - 1; j: momentum with the forcing's share of the force."""
    axes, lines = _axes(lattice), []
    for i, j in lattice.pairs:
        lines += [f"s{i} = f{i} + f{j}", f"d{i} = f{i} - f{j}"]
    lines.append("drho = " + _signed([(1, "f0"), *((1, f"s{i}") for i, _ in lattice.pairs)]))
    for k, axis in enumerate(axes):
        terms = [(int(lattice.e[i][k]), f"d{i}") for i, _ in lattice.pairs if lattice.e[i][k]]
        lines.append(f"j{axis} = {_signed(terms)}" + (f" + h{axis}" if forced else ""))
    lines += ["rho = drho + 1.0", "inverse = 1.0 / rho"]
    return lines


def _two_rates(lattice: Lattice, forced: bool) -> list[str]:
    """p, m: even and odd parts of a pair after the collision."""
    axes, classes = _axes(lattice), _classes(lattice)
    square = "+".join(f"j{a}*j{a}" for a in axes)
    lines = [f"base = drho - 1.5*inverse*({square})"]
    if forced:
        lines.append("power = inverse*(" + "+".join(f"j{a}*f{a}" for a in axes) + ")")
    for k in range(len(classes)):
        lines.append(f"base{k} = even{k}*base" + (f" - work{k}*power" if forced else ""))
        if k:
            lines.append(f"bend{k} = curve{k}*inverse")
            if forced:
                lines.append(f"lean{k} = tilt{k}*inverse")
    lines.append("g0 = fma(keep_rest, f0, base0)")
    for i, j in lattice.pairs:
        k = classes.index(lattice.weights[i])
        lines.append(f"c{i} = " + _signed([(int(e), f"j{a}") for e, a in zip(lattice.e[i], axes) if e]))
        slope = f"fma(lean{k}, along{i}, bend{k}*c{i})" if forced else f"bend{k}*c{i}"
        lines.append(f"p{i} = fma(keep_even, s{i}, fma({slope}, c{i}, base{k}))")
        drift = f"fma(odd{k}, c{i}, push{i})" if forced else f"odd{k}*c{i}"
        lines.append(f"m{i} = fma(keep_odd, d{i}, {drift})")
        lines += [f"g{i} = p{i} + m{i}", f"g{j} = p{i} - m{i}"]
    return lines


def _central(lattice: Lattice, forced: bool) -> list[str]:
    """Raw moments m of h from central ones; k: second order after relaxation, without the pressure."""
    axes = _axes(lattice)
    couples = list(itertools.combinations(axes, 2))
    lines = [f"u{a} = j{a}*inverse" for a in axes]
    lines += [f"q{a} = j{a}*u{a}" for a in axes]
    lines.append("third = drho*0.3333333333333333")
    for k, a in enumerate(axes):
        terms = "+".join(f"s{i}" for i, _ in lattice.pairs if lattice.e[i][k])
        lines.append(f"r{a} = {terms} - third - q{a}" + (f" + u{a}*f{a}" if forced else ""))
    lines.append("mean = (" + "+".join(f"r{a}" for a in axes) + f")*{1 / len(axes)!r}")
    for a in axes:
        lines.append(f"k{a} = keep*(r{a} - mean)")
        lines.append(f"b{a} = k{a} + rho*0.3333333333333333")
        lines.append(f"mm{a} = k{a} + third + q{a}" + (f" + u{a}*f{a}" if forced else ""))
        lines.append(f"m{a} = j{a}" + (f" + h{a}" if forced else ""))
    for a, b in couples:
        lines += _couple(lattice, forced, a, b)
    return lines + _from_moments(lattice, couples)


def _couple(lattice: Lattice, forced: bool, a: str, b: str) -> list[str]:
    """Moments with both axes a and b: m_ab, m_aab, m_abb, m_aabb."""
    n, axes = a + b, _axes(lattice)
    signs = lattice.e[:, axes.index(a)] * lattice.e[:, axes.index(b)]
    terms = [(int(signs[i]), f"s{i}") for i, _ in lattice.pairs if signs[i]]
    lines = [f"q{n} = j{a}*u{b}"]
    if forced:
        lines.append(f"w{n} = u{a}*h{b} + u{b}*h{a}")
    lines.append(f"k{n} = keep*({_signed(terms)} - q{n}" + (f" + w{n})" if forced else ")"))
    lines.append(f"m{n} = k{n} + q{n}" + (f" + w{n}" if forced else ""))
    for one, two in ((a, b), (b, a)):  # m of one^2 two
        text = f"2.0*u{one}*k{n} + u{two}*(b{one} + q{one})"
        if forced:
            text += f" + u{one}*(u{one}*h{two} + u{two}*f{one}) + sixth{two}"
        lines.append(f"m{one}{one}{two} = {text}")
    text = f"third*0.3333333333333333 + u{b}*u{b}*b{a} + u{a}*u{a}*b{b} + 4.0*u{a}*u{b}*k{n} + q{a}*u{b}*u{b}"
    if forced:
        text += f" + 2.0*u{a}*u{b}*w{n} + 2.0*(u{b}*sixth{b} + u{a}*sixth{a})"
    return [*lines, f"m{a}{a}{b}{b} = {text}"]


def _from_moments(lattice: Lattice, couples: list[tuple[str, str]]) -> list[str]:
    """Populations with these moments."""
    axes = _axes(lattice)
    lines = []
    fourth = {axis: [f"m{a}{a}{b}{b}" for a, b in couples if axis in (a, b)] for axis in axes}
    third = {axis: [f"m{other}{other}{axis}" for other in axes if other != axis] for axis in axes}
    rest = "drho - " + " - ".join(f"mm{a}" for a in axes)
    lines.append(f"g0 = {rest} + " + " + ".join(f"m{a}{a}{b}{b}" for a, b in couples))
    for i, j in lattice.pairs:
        e = dict(zip(axes, lattice.e[i]))
        moving = [a for a in axes if e[a]]
        if len(moving) == 1:
            (a,) = moving
            odd = " - ".join([f"m{a}", *third[a]])
            lines += [f"p{i} = 0.5*(mm{a} - " + " - ".join(fourth[a]) + ")", f"n{i} = {0.5 * e[a]}*({odd})"]
        else:
            a, b = moving
            lines.append(f"p{i} = 0.25*(m{a}{a}{b}{b} {'+' if e[a] * e[b] > 0 else '-'} m{a}{b})")
            lines.append(f"n{i} = 0.25*(" + _signed([(int(e[a]), f"m{b}{b}{a}"), (int(e[b]), f"m{a}{a}{b}")]) + ")")
        lines += [f"g{i} = p{i} + n{i}", f"g{j} = p{i} - n{i}"]
    return lines


BRAKES = ", but brakes grains in gaps of a node"  # what is told of central moments beside moving grains
HOLDS = ", but holds back what flows through gaps of a few nodes"  # and beside grains that stay
COLLISIONS = {
    scheme.name: scheme
    for scheme in (
        Scheme("BGK", _two_rates, grid_reynolds=160.0, product=lambda tau, magic: (tau - 0.5) ** 2),
        Scheme("TRT", _two_rates, magic=True, grid_reynolds=43.0, product=lambda tau, magic: magic),
        Scheme("central", _central, dearer=True, product=lambda tau, magic: 0.5 * (tau - 0.5)),
    )
}
