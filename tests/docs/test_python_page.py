"""What the page on Python says of a tank that turns: gravity of the case and acceleration are those of its frame."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs/start/python.md"


@pytest.mark.parametrize("t", [0.0, 0.7, 2.0])
def test_water_in_a_tank_that_turns_starts_with_the_pressure_of_rest(t):
    """Seen from outside, what is left alone falls straight: its place in the frame of the tank is that turned back."""
    text = PAGE.read_text()
    code = re.search(r"```python\n(def turning.*?)```", text, re.DOTALL)[1]
    gravity = np.array([*map(float, re.search(r"case keeps `gravity = \[(.*?)\]`", text)[1].split(",")), 0.0])
    w, names = 0.5, {"math": math, "w": 0.5}
    exec(code, names)

    def place(s):
        x, y = 0.3 + 0.2 * s, 0.4 - 9.81 * s * s / 2
        return np.array([math.cos(w * s) * x + math.sin(w * s) * y, math.cos(w * s) * y - math.sin(w * s) * x, 0.0])

    e = 1e-4
    velocity = (place(t + e) - place(t - e)) / (2 * e)
    acceleration = (place(t + e) - 2 * place(t) + place(t - e)) / e**2
    np.testing.assert_allclose(gravity + names["turning"](place(t), velocity, t), acceleration, atol=1e-5)
    np.testing.assert_allclose(names["turning"]((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0), 0.0)
