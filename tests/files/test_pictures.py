# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pictures: literal texts, embedded fonts, title and author of the file."""

from pathlib import Path
import re
from typing import Any

from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
import numpy as np
from PIL import Image
import pytest

from lava_ros.errors import LavaError
from lava_ros.files import pictures
from lava_ros.files.pictures import read_picture, save_picture
from lava_ros.layers.frame import Frame
from lava_ros.products.animation import animate_bag
from lava_ros.products.page_layout import Imprint
from lava_ros.products.reliability import draw_reliability
from lava_ros.products.sheet import draw_sheet, Panel
from lava_ros.scene.features import Feature
from lava_ros.verification import chart
from lava_ros.verification.rows import read_csv
from recording import record

ROOT = Path(__file__).parents[2]

#: Text that matplotlib parses as formulas, or hides, by default.
TEXT = r'_$5 $6 $\a$ ${{}}$ \frac{1} & #1~^2 % è'

GROUND = np.add.outer(np.arange(40.0), np.arange(60.0)).astype(np.float32)
LAVA = np.where(np.hypot(*np.indices(GROUND.shape) - 20.0) < 9.0, 2.0, np.nan)


def sheet(path: Path, **options: Any) -> None:
    panel = {name: options.pop(name) for name in ('heading', 'outline') if name in options}
    frame = Frame(
        GROUND, 10.0, (0.0, 0.0), {}, np.array([[200.0, 200.0]]), 60.0,
        {'terrain': {'epsg': 32633, 'offset': [500_000.0, 4_180_000.0]}},
    )
    outlines = {panel['outline']: np.isfinite(LAVA)} if 'outline' in panel else None
    shown = Panel(frame, 'thickness', LAVA, panel.get('heading', ''), outlines=outlines)
    draw_sheet([shown], path, **{'title': 'Lava', **options})


def feature(kind: str, name: str) -> list[Feature]:
    """Return a feature on the lava of ``sheet``."""
    places = np.array([[150.0, 150.0], [250.0, 160.0], [240.0, 260.0], [150.0, 150.0]])
    count = {'Point': 1, 'LineString': 3, 'Polygon': 4}[kind]
    ring = np.add(places[:count], (500_000.0, 4_180_000.0))
    return [Feature('', kind, (ring,), {'name': name})]


def accuracy_chart(path: Path, text: str) -> None:
    """Draw an accuracy chart with a text as the title of its case."""
    rows = read_csv(ROOT / 'docs/accuracy/cpu.csv')
    chart.draw(rows[:40], dict.fromkeys({row.case for row in rows}, text), path)


def sheet_texts(path: Path) -> list[str]:
    """Draw a page with the text at every place, and return all texts."""
    kinds = ('Point', 'LineString', 'Polygon')
    places = ('title', 'subtitle', 'note', 'heading', 'outline', 'file', 'agency', 'author')
    texts = {place: f'{TEXT} {place}' for place in (*places, *kinds)}
    overlays = {
        texts['file']: [item for kind in kinds for item in feature(kind, texts[kind])]
    }
    sheet(
        path, title=texts['title'], subtitle=texts['subtitle'], heading=texts['heading'],
        notes={'source': texts.pop('note')}, outline=texts['outline'], overlays=overlays,
        imprint=Imprint(texts['author'], texts['agency']),
    )
    return [*texts.values(), f'source: {TEXT} note']


def chart_texts(path: Path) -> list[str]:
    """Draw an accuracy chart with the text, and return it."""
    accuracy_chart(path, TEXT)
    return [TEXT]


@pytest.fixture
def figures(monkeypatch):
    """Collect the saved figures, and fail if one contains a formula."""
    found: list[Any] = []

    def keep(figure: Any, *words: Any, **options: Any) -> None:
        found.append(figure)
        save_picture(figure, *words, **options)

    def refuse(_: object, text: str, *__: Any, **___: Any) -> None:
        raise AssertionError(f'read as a formula: {text}')

    for module in ('lava_ros.products.sheet', 'lava_ros.verification.chart'):
        monkeypatch.setattr(f'{module}.save_picture', keep)
    monkeypatch.setattr(MathTextParser, 'parse', refuse)
    return found


@pytest.mark.parametrize('draw', [sheet_texts, chart_texts])
def test_draws_texts_literally(draw, figures, tmp_path):
    expected = draw(tmp_path / 'map.svg')
    (figure,) = figures
    drawn = {item.get_text().strip('\u200b') for item in figure.findobj(Text)}
    assert set(expected) <= drawn


@pytest.mark.parametrize('draw', [
    lambda path: sheet(path),
    lambda path: accuracy_chart(path, 'case'),
    lambda path: animate_bag(record(path.parent / 'bag'), path.with_suffix('.gif'), seconds=0.5),
])
def test_ignores_the_matplotlib_settings_of_the_user(draw, figures, tmp_path, monkeypatch):
    import matplotlib

    with matplotlib.rc_context({'text.usetex': True, 'text.color': 'white', 'font.size': 40.0}):
        draw(tmp_path / 'map.png')
        assert matplotlib.rcParams['text.usetex'] and matplotlib.rcParams['text.parse_math']
    for figure in figures:
        assert not any(item.get_usetex() for item in figure.findobj(Text))


def test_draws_a_reliability_diagram_on_a_page(figures, tmp_path):
    likely = np.linspace(0.0, 1.0, 50)
    sheet(tmp_path / 'a.png', charts=[lambda axes: draw_reliability(axes, likely, likely > 0.4)])
    assert any('Brier' in item.get_text() for item in figures[0].findobj(Text))


def test_no_other_module_creates_a_figure():
    made = [
        path.name
        for path in (ROOT / 'lava_ros').rglob('*.py')
        if re.search(r'\bFigure\(|pyplot|savefig', path.read_text(encoding='utf-8'))
    ]
    assert made == [Path(pictures.__file__).name]


def test_files_contain_title_author_and_fonts(tmp_path):
    imprint = Imprint('A. Rossi', 'Osservatorio Etneo')
    for ending in ('pdf', 'svg', 'png'):
        sheet(tmp_path / f'map.{ending}', title='Etna $5', imprint=imprint)
    page = (tmp_path / 'map.pdf').read_bytes()
    assert b'/Title (Etna $5)' in page and b'/Author (A. Rossi, Osservatorio Etneo)' in page
    assert b'/FontFile2' in page and b'/Type3' not in page
    text = (tmp_path / 'map.svg').read_text(encoding='utf-8')
    assert '<dc:title>Etna $5' in text and 'A. Rossi, Osservatorio Etneo' in text
    with Image.open(tmp_path / 'map.png') as image:
        known = image.text  # type: ignore[attr-defined]
    assert (known['Title'], known['Author']) == ('Etna $5', 'A. Rossi, Osservatorio Etneo')


def test_draws_a_logo_and_rejects_other_files(tmp_path):
    Image.new('P', (300, 100), 1).save(tmp_path / 'logo.png')
    assert read_picture('--logo', tmp_path / 'logo.png').mode == 'RGBA'
    Image.new('RGB', (2000, 2000), (255, 0, 255)).save(tmp_path / 'logo.jpg')
    assert max(read_picture('--logo', tmp_path / 'logo.jpg').size) <= 1200
    sheet(tmp_path / 'map.png', imprint=Imprint(logo=str(tmp_path / 'logo.jpg')))
    pixels = np.asarray(Image.open(tmp_path / 'map.png').convert('RGB')).astype(int)
    logo = (pixels[..., 0] > 240) & (pixels[..., 1] < 20) & (pixels[..., 2] > 240)
    rows, columns = np.nonzero(logo)
    # 0.58 inches at 150 pixels per inch, in the upper right corner
    assert 80 <= np.ptp(rows) <= 90 and 80 <= np.ptp(columns) <= 90
    assert rows.max() < 150 and columns.min() > 0.8 * pixels.shape[1]
    (tmp_path / 'text.png').write_text('no picture')
    for name in ('text.png', 'none.png', '.'):
        with pytest.raises(LavaError, match='--logo is .*a PNG or JPEG'):
            read_picture('--logo', tmp_path / name)
