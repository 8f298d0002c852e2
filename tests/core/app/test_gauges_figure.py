"""The figure of gauges has a panel for each, with a line for each component."""

from types import SimpleNamespace

import numpy as np
import pytest

from hpcpic.core.app.figures import NoData, NotInScene, gauges_figure
from hpcpic.core.case.gauge import Gauge
from hpcpic.core.files.series import Series


def test_each_gauge_has_a_panel_and_each_component_a_line():
    t = np.linspace(0.0, 1.0, 5)
    values = {"u_x": t, "u_y": 2 * t, "p": 3 * t}
    run = SimpleNamespace(series=Series(values, dict(zip(values, ("m/s", "m/s", "Pa"))), np.arange(5), t))
    gauges = (
        Gauge(name="u", what="velocity", at=(1.0, 2.0)),
        Gauge(name="p", what="pressure", at=(0.5, 0.5), size=(1.0, 0.0)),
    )
    panels = gauges_figure(run, gauges).axes
    assert [len(panel.lines) for panel in panels] == [2, 1]
    assert panels[0].get_ylabel() == "velocity, m/s" and panels[1].lines[0].get_ydata()[-1] == 3.0
    assert "mean" in panels[1].get_title(loc="left") + panels[1].get_title()
    with pytest.raises(NotInScene):
        gauges_figure(run, ())
    with pytest.raises(NoData, match="the series lacks q"):
        gauges_figure(run, (Gauge(name="q", what="pressure", at=(0.5, 0.5)),))
