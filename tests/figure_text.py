"""Texts of a figure as they are drawn: sizes of letters, overlaps, and what the frame cuts off."""

import numpy as np
from matplotlib import cbook
from matplotlib.legend import Legend
from matplotlib.mathtext import MathTextParser
from matplotlib.path import Path
from matplotlib.text import Text

from pymantaray.plotting.style import freeze_layout

_DPI = 200.0
_TOUCH = 0.4  # points by which the boxes of two texts may overlap


def texts(figure):
    """Texts that a reader sees, drawn at their places as in a file."""
    freeze_layout(figure)
    figure.dpi = _DPI  # hinting makes letters narrower on a screen
    figure.canvas.draw()
    found = []
    for artist in figure.findobj(Text):
        if not (artist.get_visible() and artist.get_text().strip()):
            continue
        axes = artist.axes
        if axes is not None and not axes.get_visible():
            continue
        found.append(artist)
    hidden = _hidden_ticks(figure)
    return [text for text in found if id(text) not in hidden]


def _hidden_ticks(figure):
    """Labels of ticks outside the limits of their axes, or of axes that are off."""
    hidden = set()
    for axes in figure.axes:
        for axis in axes._axis_map.values():
            labels = [axis.label, axis.offsetText]
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                labels += [tick.label1, tick.label2]
            hidden |= {id(label) for label in labels}
            if not (axes.axison and axes.get_visible()):
                continue
            shown = [*axis._update_ticks()]
            hidden -= {id(t.label1) for t in shown} | {id(t.label2) for t in shown}
            hidden -= {id(axis.label), id(axis.offsetText)}
    return hidden


def smallest_letter(figure):
    """Size of the smallest letters other than exponents and indices. [points]"""
    return min(text.get_fontsize() for text in texts(figure))


def smallest_exponent(figure):
    """Size of the smallest letters of mathematics, such as exponents; else infinite. [points]"""
    smallest = np.inf
    parser = MathTextParser("path")
    for text in texts(figure):
        if cbook.is_math_text(text.get_text()):
            parsed = parser.parse(text.get_text(), 72.0, text.get_fontproperties())
            smallest = min(smallest, *(size for _, size, *_ in parsed.glyphs))
    return smallest


def corners(text, renderer):
    """Corners of the box of a text, which may be turned, shape (4, 2). [pixels]"""
    angle = text.get_rotation()
    box = text.get_window_extent(renderer)
    text.set_rotation(0.0)
    flat = text.get_window_extent(renderer)
    text.set_rotation(angle)
    half = 0.5 * np.array([flat.width, flat.height]) - 0.5 * _TOUCH * renderer.dpi / 72.0
    half = np.maximum(half, 0.1)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    middle = np.array([0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)])
    return middle + square @ np.array([[cosine, sine], [-sine, cosine]])


def overlaps(figure):
    """Pairs of texts whose boxes overlap."""
    renderer = figure.canvas.get_renderer()
    boxes = [(text, corners(text, renderer)) for text in texts(figure)]
    paths = [Path([*box, box[0]], closed=True) for _, box in boxes]
    return [
        (boxes[i][0].get_text(), boxes[j][0].get_text())
        for i in range(len(boxes))
        for j in range(i)
        if paths[i].intersects_path(paths[j], filled=True)
    ]


def cut_off(figure):
    """Texts and legends that are not within the figure."""
    renderer, frame = figure.canvas.get_renderer(), figure.bbox.padded(1.0)
    found = [*texts(figure), *figure.findobj(Legend)]
    boxes = [(artist, artist.get_window_extent(renderer)) for artist in found]
    return [
        str(artist)
        for artist, box in boxes
        if not (
            frame.containsx(box.x0)
            and frame.containsx(box.x1)
            and frame.containsy(box.y0)
            and frame.containsy(box.y1)
        )
    ]
