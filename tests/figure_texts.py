"""Can the words of a figure be read?"""

from itertools import combinations

from matplotlib.figure import Figure
from matplotlib.text import Text


def unreadable(figure: Figure) -> list[str]:
    """Texts that leave the figure and pairs that cover each other, by more than two pixels: layouts are that exact.

    Numbers of axes are the care of matplotlib.
    """
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    ticks = {
        label
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
        for label in (tick.label1, tick.label2)
    }
    hidden = {text for axes in figure.axes if not axes.get_visible() for text in axes.findobj(Text)}
    texts = [text for text in figure.findobj(Text) if text not in ticks | hidden]
    texts = [text for text in texts if text.get_visible() and text.get_text().strip()]
    places = [(text.get_text(), text.get_window_extent(renderer).padded(-2)) for text in texts]
    x0, y0, x1, y1 = figure.bbox.extents
    outside = [words for words, at in places if not (x0 <= at.x0 and at.x1 <= x1 and y0 <= at.y0 and at.y1 <= y1)]
    covered = [f"{a} / {b}" for (a, place), (b, other) in combinations(places, 2) if place.overlaps(other)]
    return outside + covered
