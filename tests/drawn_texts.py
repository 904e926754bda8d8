"""The texts of a chart, as matplotlib draws them."""

import matplotlib as mpl


def texts_with_boxes(figure, monkeypatch):
    """Return the texts that matplotlib draws in a figure, as pairs of text and its box
    in pixels.

    The boxes are half a pixel smaller on each side, for the rounding of the layout.
    """
    boxes = []
    draw = mpl.text.Text.draw

    def draw_and_note(text, renderer):
        """Draw a text, and append it with its box unless it is blank."""
        if text.get_visible() and text.get_text().strip():
            box = text.get_window_extent(renderer).padded(-0.5)
            boxes.append((text.get_text(), box))
        draw(text, renderer)

    with monkeypatch.context() as patch:
        patch.setattr(mpl.text.Text, "draw", draw_and_note)
        figure.canvas.draw()
    return boxes
