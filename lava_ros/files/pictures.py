# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures of matplotlib: literal texts, embedded fonts, title and author of the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lava_ros
from lava_ros.errors import one_line, refusing
from lava_ros.files import open_input, writing


@contextmanager
def new_figure(
    field: str, output: str | Path, size: tuple[float, float], dpi: float
) -> Iterator[Any]:
    """Create a white figure with literal texts. Draw and save it inside the context.

    Args:
        field: Name of the field in the error.
        output: Name of the output in the error.
        size: Width and height [inches].
        dpi: Pixels per inch.
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    settings = {
        # a $ in a title or a place name is not the start of a formula
        'text.parse_math': False,
        # with embedded TrueType fonts, text can be searched and copied
        'pdf.fonttype': 42,
        'ps.fonttype': 42,
        # equal figures give equal files
        'svg.hashsalt': 'lava_ros',
    }
    with style.context(['default', settings]):
        figure = Figure(figsize=size, dpi=dpi, facecolor='white')
        FigureCanvasAgg(figure)
        yield figure


def save_picture(figure: Any, path: str | Path, *, title: str = '', author: str = '') -> None:
    """Write a figure with its metadata; the suffix chooses the format.

    Raises:
        LavaError: If the file cannot be written.
    """
    title, author = (one_line(text, 400) for text in (title, author))
    program = f'lava_ros {lava_ros.__version__}'
    names: dict[str, dict[str, str | None]] = {
        '.png': {'Title': title, 'Author': author, 'Software': program},
        '.pdf': {'Title': title, 'Author': author, 'Creator': program},
        # SVG uses the keys of Dublin Core
        '.svg': {'Title': title, 'Creator': author or program, 'Date': None},
    }
    found = names.get(Path(path).suffix.lower(), {})
    known = {key: text for key, text in found.items() if text or text is None}
    with writing('output', path) as partial:
        figure.savefig(partial, metadata=known)


def read_picture(field: str, path: str | Path, max_side: int = 1200) -> Any:
    """Read a picture as an RGBA image of Pillow with at most ``max_side`` pixels a side.

    Raises:
        LavaError: If the file is not a readable PNG or JPEG.
    """
    from PIL import Image

    with (
        refusing(field, str(path), 'a PNG or JPEG picture'),
        open_input(path) as file,
        Image.open(file, formats=('PNG', 'JPEG')) as image,
    ):
        image.thumbnail((max_side, max_side))
        return image.convert('RGBA')
