# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Templates of HTML pages, and static pages with one picture."""

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lava_ros
from lava_ros.errors import refusing
from lava_ros.files import write_output
from lava_ros.files.pictures import read_picture

#: Kinds of pictures in data URLs by suffix, other than PNG.
_KINDS = {'.jpg': 'jpeg', '.jpeg': 'jpeg', '.svg': 'svg+xml'}


def render_page(template: str, **content: Any) -> str:
    """Render a template of this folder; texts are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True,
        undefined=StrictUndefined, keep_trailing_newline=True,
    )
    return pages.get_template(template).render(version=lava_ros.__version__, **content)


def write_static_page(
    output: Path, pictures: Sequence[tuple[str, Path]], *, template: str = 'still.html',
    **content: Any,
) -> int:
    """Write a self-contained HTML page about some pictures.

    Args:
        output: The page.
        pictures: Titles and paths of the pictures (PNG).
        template: A template of this folder: ``still.html``, or one that extends it.
        content: Variables of the template: ``title``, ``subtitle``, ``warnings`` and short
            ``facts`` of the page, and the sections after the pictures, such as the long facts
            ``about`` the runs. ``logo`` is the path of a logo.

    Returns:
        Size of the page [bytes].

    Raises:
        LavaError: If the page cannot be written, or the picture cannot be read.
    """
    content.setdefault('about', {})
    logo = content.pop('logo', '')
    if logo:
        # raises for a file without a picture
        read_picture('--logo', logo)
    content['logo'] = encoded(Path(logo)) if logo else ''
    images = [(title, encoded(path)) for title, path in pictures]
    style = Path(__file__).with_name('report.css').read_text(encoding='utf-8')
    text = render_page(template, style=style, pictures=images, **content)
    write_output('output', output, text)
    return len(text.encode())


def encoded(path: Path) -> str:
    """Return a PNG, JPEG or SVG as a data URL.

    Raises:
        LavaError: If the file cannot be read.
    """
    with refusing('output', str(path), 'a readable picture', OSError):
        kind = _KINDS.get(path.suffix.lower(), 'png')
        return f'data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}'
