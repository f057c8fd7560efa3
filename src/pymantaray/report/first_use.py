"""First use of drawing and of the page, in advance: a server that forks processes does it once for all of them."""

from matplotlib.figure import Figure

from pymantaray.report import style
from pymantaray.report.page import Explorer, Page


def use_all() -> None:
    """Draw a figure, which loads fonts and the parser of formulas, and make a page, which compiles templates and compresses its library."""
    style.rendered(_figure(), ("png",))
    Page("", explorer=Explorer("run", "{}")).html()


@style.styled
def _figure() -> Figure:
    figure = style.new_figure(style.DOUBLE, 2.0, "header")
    axes = figure.subplots()
    axes.set_yscale("log")  # its numbers are formulas
    axes.plot([0.0, 1.0], [1.0, 10.0], label="error")
    axes.set_xlabel("time [h]")
    figure.legend()
    return figure
