"""Labels of ticks: numbers are plain text, a power of ten of all is a formula, names stay names."""

from hpcpic.core.app.figures import new_figure, style


def drawn(plot):
    with style():
        figure, axes = new_figure()
        plot(axes)
        figure.canvas.draw()
    return axes


def texts(axis):
    return [label.get_text() for label in axis.get_ticklabels()]


def test_numbers_are_plain_text_and_their_power_of_ten_a_formula():
    axes = drawn(lambda axes: axes.plot([0.0, 0.5], [-2e-7, 2e-7]))
    assert {"0.0", "0.5"} <= {*texts(axes.xaxis)} and {"\N{MINUS SIGN}2.0", "0.0", "2.0"} <= {*texts(axes.yaxis)}
    assert "10^{\N{MINUS SIGN}7}" in axes.yaxis.get_offset_text().get_text()


def test_names_and_powers_take_the_place_of_numbers():
    assert texts(drawn(lambda axes: axes.barh(["push", "field"], [1.0, 2.0])).yaxis) == ["push", "field"]
    assert any("10^{-2}" in one for one in texts(drawn(lambda axes: axes.loglog([1e-2, 1.0], [1.0, 2.0])).xaxis))
