# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""HTML pages with one picture and without a script: of hindcasts, ensembles, several runs."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
import tempfile

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, write_output
from lava_ros.pages.pictures import draw_runs
from lava_ros.pages.report.sections import facts_html, warnings_html

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>{style}
img {{ display: block; max-width: 100%; max-height: 90vh; margin: 1rem auto; }}</style>
</head>
<body>
<header><h1>{title}</h1><p class="subtitle">{subtitle}</p></header>
<main>
{warnings}
<dl class="facts">{facts}</dl>
<img src="data:image/png;base64,{picture}" alt="{shows}">
{sections}
</main>
<footer><p>lava_ros {version}</p></footer>
</body>
</html>
"""


def write_still(
    output: Path,
    *,
    title: str,
    subtitle: str,
    warnings: Iterable[str],
    facts: Mapping[str, str],
    picture: Path,
    shows: str,
    sections: str = '',
) -> int:
    """Write a self-contained HTML page about a PNG.

    ``shows`` describes the picture; ``sections`` is HTML that follows it.

    Returns:
        Size of the page [bytes].

    Raises:
        LavaError: The page cannot be written, or the picture cannot be read.
    """
    try:
        image = base64.b64encode(picture.read_bytes()).decode()
    except OSError as error:
        raise LavaError('output', str(picture), f'a readable picture ({error})') from error
    text = _PAGE.format(
        title=escape(title),
        subtitle=escape(subtitle),
        style=resources.files('lava_ros.pages.report').joinpath('report.css').read_text('utf-8'),
        warnings=warnings_html(warnings),
        facts=facts_html(facts.items()),
        picture=image,
        shows=escape(shows),
        sections=sections,
        version=escape(lava_ros.__version__),
    )
    write_output('output', output, text)
    return len(text.encode())


def write_comparison(
    paths: Sequence[str], output: str | Path, *, overlays: Sequence[str], observed: str | None
) -> int:
    """Write a page about an ensemble, or about several runs, and return its size [bytes].

    Raises:
        LavaError: A run or a file cannot be read, or the page cannot be written.
    """
    output = file_to_write('output', output, ('.html', '.htm'))
    with tempfile.TemporaryDirectory(prefix='lava-report-') as folder:
        picture = Path(folder) / 'maps.png'
        drawn = draw_runs(paths, picture, overlays=overlays, observed=observed)
        facts = drawn['notes'] | {
            f'{term.replace("_", " ")} of {name}': f'{value:.3g}'
            for name, scores in drawn['scores'].items()
            for term, value in scores.items()
        }
        return write_still(
            output,
            title=drawn['title'],
            subtitle=drawn['summary'],
            warnings=[f'{drawn["banner"].capitalize()}.'],
            facts=facts,
            picture=picture,
            shows=', '.join(drawn['maps']),
        )
