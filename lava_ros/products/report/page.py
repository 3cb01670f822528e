# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""HTML pages about runs: `lava map`."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
import tempfile
from typing import Any

import numpy as np

from lava_ros.bag.description import described
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.forecast.store import is_ensemble
from lava_ros.layers.layer import SOURCES
from lava_ros.layers.recording import Progress, Recording, silent
from lava_ros.products.arrivals import table_of
from lava_ros.products.page_layout import BANNER, Imprint
from lava_ros.products.pictures import read_page
from lava_ros.products.report import sections
from lava_ros.products.report.charts import charts_of
from lava_ros.products.report.static_page import encoded, write_static_page
from lava_ros.products.report.summary import RunSummary, summarize

#: Facts at the top of a page, which are short.
_BRIEF = (
    'start of the eruption', 'forecast until', 'maps show', 'effusion rate', 'volume emitted',
    'inundation',
)

#: First warning of a page.
_NOTICE = f'{BANNER.capitalize()}.'


def write_report(
    paths: Sequence[str | Path],
    output: str | Path,
    *,
    imprint: Imprint | None = None,
    progress: Progress = silent,
    **options: Any,
) -> int:
    """Write a self-contained HTML page about a bag, an ensemble, or several runs.

    Args:
        paths: The runs.
        output: The page.
        imprint: Publisher of the page.
        progress: Receives the progress of reading a single bag.
        options: Options of ``read_page`` except ``layers``.

    Returns:
        Size of the page [bytes].

    Raises:
        LavaError: If a run or a file cannot be read, a single bag has no simulated times, or the
            page cannot be written.
    """
    output = file_to_write('output', output, ('.html', '.htm'))
    imprint = imprint or Imprint()
    is_bag = len(paths) == 1 and not is_ensemble(paths[0])
    recording = Recording(paths[0], node=options.get('node')) if is_bag else None
    summary = summarize(recording, progress) if recording else None
    if summary is not None:
        options['layers'] = [name for name in SOURCES if name in summary.frame.layers]
        times = summary.arrival.times
        if times is not None and np.isfinite(times).any():
            options['layers'].append('arrival')
    shown = read_page(paths, **options)
    notes = dict(shown.notes)
    # at the top of the page
    warnings = [text for text in (notes.pop('warning', ''),) if text]
    notes |= {
        f'{term.replace("_", " ")} of {name}': f'{value:.3g}'
        for name, scores in shown.scores.items()
        for term, value in scores.items()
    }
    notes |= {
        term: text
        for term, text in (('author', imprint.author), ('agency', imprint.agency)) if text
    }
    facts = {term: notes.pop(term) for term in _BRIEF if term in notes}
    with _folder_of_pictures(output) as folder:
        more: dict[str, Any] = {}
        if recording is not None and summary is not None:
            facts = dict(sections.facts(recording, summary)) | {
                term: text for term, text in facts.items() if term != 'volume emitted'
            }
            warnings = sections.warnings(recording, summary)
            more = _of_bag(recording, summary, folder)
        return write_static_page(
            output,
            shown.draw_pictures(folder),
            title=shown.title,
            subtitle=shown.subtitle,
            warnings=[_NOTICE, *warnings],
            facts=facts,
            about={term: text for term, text in notes.items() if term not in facts},
            logo=imprint.logo,
            places=_places(paths, options),
            **more,
        )


@contextmanager
def _folder_of_pictures(output: Path) -> Iterator[Path]:
    """Make a temporary folder; errors of its files name the page that would contain them."""
    with tempfile.TemporaryDirectory(prefix='lava-report-') as folder:
        try:
            yield Path(folder)
        except LavaError as error:
            if str(error.value).startswith(folder):
                raise LavaError('output', str(output), error.expected) from error
            raise


def _places(
    paths: Sequence[str | Path], options: Mapping[str, Any]
) -> list[tuple[str, str, sections.Table]]:
    """Return the arrival at the places of the overlays: the run, a summary and a table."""
    overlays, found = options.get('overlays') or {}, []
    dates = {name: options.get(name) for name in ('node', 'onset', 'zone')}
    for path in paths if overlays else ():
        table = table_of(path, list(chain.from_iterable(overlays.values())), **dates)
        head, *rows = table.as_texts()
        found.append((str(path), table.summary, sections.Table(head, rows)))
    return found


def _of_bag(recording: Recording, summary: RunSummary, folder: Path) -> dict[str, Any]:
    """Return the template of a single bag and its content; charts are drawn in a folder."""
    description = described(recording.bag.custom_data)
    charts = []
    for chart in charts_of(recording, summary):
        chart.draw(picture := folder / f'{chart.key}.svg')
        charts.append((chart, encoded(picture)))
    return {
        'template': 'report.html',
        'charts': charts,
        'hazard': sections.hazard_legend(recording),
        'depth': sections.depth_table(summary),
        'effects': sections.effects_tables(description),
        'accuracy': sections.accuracy_table(recording, description),
        'recorded': sections.recorded_tables(recording, summary),
        'described': sections.described_data(recording, description),
    }
