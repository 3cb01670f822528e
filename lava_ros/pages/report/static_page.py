# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Templates of HTML pages, and static pages with one picture."""

import base64
from pathlib import Path
from typing import Any

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.files import write_output
from lava_ros.files.optional import require


def render_page(template: str, **content: Any) -> str:
    """Render a template of this folder; texts are escaped."""
    require('jinja2', 'HTML pages')
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True,
        undefined=StrictUndefined, keep_trailing_newline=True,
    )
    return pages.get_template(template).render(version=lava_ros.__version__, **content)


def read_asset(name: str) -> str:
    """Return the text of a style or script in this folder."""
    return Path(__file__).with_name(name).read_text(encoding='utf-8')


def write_static_page(
    output: Path, picture: Path, *, template: str = 'still.html', **content: Any
) -> int:
    """Write a self-contained HTML page about a PNG.

    Args:
        output: The page.
        picture: The PNG.
        template: A template of this folder: ``still.html``, or one that extends it.
        content: Variables of the template: ``title``, ``subtitle``, ``warnings`` and ``facts`` of
            the page, ``shows``, which describes the picture, and the sections after the picture.

    Returns:
        Size of the page [bytes].

    Raises:
        LavaError: If the page cannot be written, or the picture cannot be read.
    """
    try:
        image = base64.b64encode(picture.read_bytes()).decode()
    except OSError as error:
        raise LavaError('output', str(picture), f'a readable picture ({error})') from error
    text = render_page(template, style=read_asset('report.css'), picture=image, **content)
    write_output('output', output, text)
    return len(text.encode())
