"""A simulator whose errors are known: answer = 1 + A dx^2 - B dt^2 + C/n, and energy that grows beyond dt = limit.

The signs of the errors of dx and dt differ, so that they cancel on a curve: a search for a small total error would be
drawn there. Cost: steps ~ 1/dt, items ~ n.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests/core")]

import toy_app  # noqa: E402

from hpcpic.core.app.app import App  # noqa: E402
from hpcpic.core.app.knobs import Choice, Knob, Knobs, Quantity  # noqa: E402
from hpcpic.core.case.derived import Derived  # noqa: E402
from hpcpic.core.case.schema import REQUIRED, Section, setting, validate  # noqa: E402
from hpcpic.core.cli.main import program  # noqa: E402

A, B, C = 0.4, 0.3, 0.02


class ErrorConfig(Section):
    steps: int = setting(REQUIRED, "number of steps", ge=1)
    dt: float = setting(REQUIRED, "time step", gt=0)
    dx: float = setting(0.1, "spacing", gt=0)
    particles: int = setting(1000, "number of particles", ge=1)
    order: float = setting(2.0, "of the error in dx")
    bump: float = setting(0.0, "error more where 0.105 < dx < 0.13")
    noise: float = setting(0.0, "error that no knob makes, drawn from the settings")
    start: float = setting(0.0, "error that is drawn anew with the number of particles")
    limit: float = setting(0.5, "dt beyond which the energy grows")
    slow: float = setting(0.0, "growth rate at dt = limit/2, in proportion to dt", "1/s")
    late: float = setting(0.0, "time at which it diverges at the limit, sooner beyond; no energy grows before", "s")
    mode: int = setting(1, "scheme: 2 halves the error in dx, unless dt is turned too", ge=1, le=2)
    offset: float = setting(0.0, "error that no knob makes, always the same")
    dear: float = setting(1.0, "exponent of the cost of dx that is told")
    exact: bool = setting(False, "the answer is known to be 1")
    most: float = setting(1e9, "dx beyond which the case is refused")
    warned: float = setting(1e9, "dx beyond which it is warned of")
    seed: int = setting(1, "of nothing")
    fault: toy_app.Fault = toy_app.Fault()
    output: toy_app.Output = toy_app.Output()
    rows: int = setting(4, "points of the ring", ge=1)
    courant: float = 0.25
    pause: float = 0.0
    stop_SEM: float = 0.0

    @property
    def n_steps(self) -> int:
        return self.steps

    @property
    def end_time(self) -> float:
        return self.steps * self.dt


class ErrorToy(toy_app.Toy):
    scalar_units: Mapping[str, str] = {"answer": "1", "energy_total": "J"}

    def __init__(self, config: ErrorConfig, world, pool, timers) -> None:
        super().__init__(config, world, pool, timers)
        self.time_step = config.dt
        self.work_items = config.particles

    def scalars(self) -> dict[str, float]:
        c = self.config
        drawn = math.sin(1e4 * c.dx + 1e5 * c.dt + c.particles)
        half = 0.5 if c.mode == 2 else 1.0
        if c.mode == 2 and abs(c.dt - 0.05) > 1e-3 and abs(c.dx - 0.1) > 1e-3:  # which no law of one knob knows
            half = 20.0
        start = c.start * math.sin(c.particles)
        half += c.bump / (A * c.dx**c.order) if 0.105 < c.dx < 0.13 else 0.0
        answer = 1 + start + half * A * c.dx**c.order - B * c.dt**2 + C / c.particles + c.noise * drawn + c.offset
        fast = 0.5 if c.dt > c.limit and not c.late else 0.0
        rate = c.slow * 2 * c.dt / c.limit
        return {"answer": answer, "energy_total": math.exp(fast * self.iteration + rate * self.time)}

    def guard(self) -> str | None:
        c = self.config
        lost = c.dt > c.limit and 0.0 < c.late * c.limit / c.dt < self.time
        return "all is lost" if lost else super().guard()


def settings(config: ErrorConfig, sizes: Mapping[str, float], time: float) -> tuple[str, ...]:
    steps = math.ceil(time / sizes.get("dt", config.dt) - 1e-9)
    made = [f"steps={steps}", f"dt={time / steps!r}", f"dx={sizes.get('dx', config.dx)!r}"]
    return (*made, f"particles={math.ceil(1 / sizes.get('particles', 1 / config.particles) - 1e-9)}")


def knobs(config: ErrorConfig) -> Knobs:
    time, exact = config.steps * config.dt, 1.0 if config.exact else None
    return Knobs(
        knobs=(
            Knob("dx", "spacing", "m", ("dx",), lambda c: c.dx, 2.0, config.dear),
            Knob("dt", "time step", "s", ("dt",), lambda c: c.dt, 2.0, 1.0, "time step"),
            Knob("particles", "particles", "", ("particles",), lambda c: 1 / c.particles, 1.0, 1.0,
                 shown=lambda size: 1 / size, noisy=bool(config.start)),
        ),
        choices=(Choice("mode", ("mode",), "1", ("2",), "dx"),),
        quantities=lambda: [Quantity("answer", "the answer", time / 4, lambda seen: float(seen["answer"][-1]), exact)],
        settings=lambda sizes, end: settings(config, sizes, end),
        time=time,
        pilot=("output.series=1",),
        work=lambda c: c.steps * c.particles / c.dx,
        work_unit="updates",
        horizon=20.0,
        growth=lambda series: float(series["energy_total"].max() / series["energy_total"][0]),
        seed=lambda n: (f"seed={n}",),
        quieter=("start=0.0",) if config.start else (),
    )  # fmt: skip


def derived(config: ErrorConfig, ranks: int) -> list[Derived]:
    number = config.dt / 0.5
    verdict = "ok" if number < 1 else "fail"
    verdict_of_dx = "fail" if config.dx >= config.most else "warn" if config.dx >= config.warned else "ok"
    coarse = Derived("spacing", "dx", config.dx, "m", f"< {config.most:g}", verdict_of_dx)
    step = Derived("time step", "dt/limit", number, "", "< 1", verdict, "known", key=("dt",), stable_below=1.0)
    return [step, coarse]


APP = App(
    name="errors",
    title="errors that are known",
    schema=lambda: ErrorConfig,
    configure=lambda tree: validate(ErrorConfig, tree),
    cases=lambda: {},
    derived=derived,
    estimate=toy_app.estimate,
    load=lambda: ErrorToy,
    until=lambda config, t: (f"steps={round(t / config.dt)}",),
    knobs=knobs,
    command=(sys.executable, str(Path(__file__).resolve())),
)

if __name__ == "__main__":
    program(lambda: APP, APP.name, APP.title)
