# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy report as Markdown, its studies, and its chart."""

from dataclasses import replace
import math
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.image import imread
import pytest

from lava_ros.errors import LavaError
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import measure
from lava_ros.verification.chart import draw
from lava_ros.verification.measure import all_settings, name_of, Setting
from lava_ros.verification.rows import points, presets_of, read_csv
from scripts import load_script

ROOT = Path(__file__).parents[2]
report = load_script(ROOT / 'docs/accuracy_report.py')
markdown, studies = report.markdown, report.studies


def test_report_names_presets_and_the_front(fake_case, measured, row):
    tried = [
        Setting('coarse', Accuracy(refinement=0.5)),
        Setting('chosen', Accuracy(refinement=1.0), preset='standard'),
    ]
    text = markdown(measured([fake_case()], tried), {'fake': 'A title'}, stem='cpu')
    for part in ('| case | standard |', '| A title | 0.33 % in 61 ms |', '**standard: chosen**',
                 '![', 'cpu.csv'):
        assert part in text
    assert text.endswith('|\n')
    # a setting without a result is not on the front
    text = markdown([row(setting='broken', error=math.nan), row()], {}, stem='cpu')
    assert '| broken | none |' in text and '| **a** | 1 % |' in text
    assert '## Presets' not in text
    # in the order of cost
    rows = [row(setting=name, preset=name) for name in ('fine', '', 'draft')]
    assert presets_of(points(rows)) == ['draft', 'fine']


def section(rows, title):
    """Return the lines of a section without its title, or None."""
    text = '\n'.join(studies(rows, {'pond': 'A pond'}))
    parts = {part.split('\n')[0]: part.split('\n')[1:] for part in text.split('## ')[1:]}
    return parts.get(title)


def table(rows, title):
    """Return the cells of a section's table, header first."""
    lines = [line for line in section(rows, title) if line.startswith('|')]
    del lines[1]
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in lines]


def test_convergence_has_the_order_at_every_doubling(row):
    """Errors fall as the spacing and as its square."""
    rows = [
        row(
            setting=name_of(accuracy), quantity=quantity,
            particles=round(8000 * accuracy.refinement**2),
            error=0.01 / accuracy.refinement**order,
        )
        for accuracy in measure.convergence()
        for quantity, order in (('radius', 1), ('profile', 2))
    ]
    head, first, *others, last = table(rows, 'Convergence')
    assert head == ['particles', 'radius', 'order', 'profile', 'order', 'a run took']
    assert first[:5] == ['2,000', '2 %', '', '4 %', '']
    assert len(others) == 6 and others[1][:2] == ['8,000', '1 %']
    for line in others:
        assert [float(line[2]), float(line[4])] == pytest.approx([1.0, 2.0], abs=0.02)
    assert last == ['least squares', '', '1.00', '', '2.00', '']


def test_committed_measurements_fill_every_study():
    rows = read_csv(ROOT / 'docs/accuracy/h200.csv')
    for title in (
        'Convergence', 'Super-time-stepping', "From the paper's settings to ours",
        'Gradient forms', 'Lateral stress',
    ):
        head, *lines = table(rows, title)
        assert len(lines) > 1 and {len(line) for line in lines} == {len(head)}
        assert not any('nan' in cell for line in lines for cell in line)
    settings = measure.paper_settings()
    lines = table(rows, "From the paper's settings to ours")[1:]
    assert [line[0] for line in lines] == [*settings]


@pytest.mark.parametrize('name', ['other_codes', 'equal_error_table'])
def test_tables_of_pages_are_up_to_date(name):
    script = load_script(ROOT / f'docs/benchmarks/{name}.py')
    page = script.PAGE.read_text(encoding='utf-8')
    assert script.written(page, script.TABLES) == page


@pytest.mark.parametrize('count', [1, 4])
def test_chart_is_not_blank(tmp_path, count, fake_case, measured):
    cases = [fake_case(f'case{index}') for index in range(count)]
    rows = measured(cases, all_settings(quick=True))
    draw(rows, {case.name: case.title for case in cases}, tmp_path / 'a.png')
    picture = imread(tmp_path / 'a.png')
    assert picture.shape[0] > 400
    assert (picture[..., :3].min(axis=2) < 0.5).mean() > 0.005


def test_chart_omits_what_is_not_known(tmp_path, row, monkeypatch):
    """It has no case without a cost, and a preset with a NaN at its known error."""
    drawn = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: drawn.append(figure.axes))
    still = row(case='lateral', wall_s_per_simulated_hour=math.nan)
    preset = row(setting='p', preset='as-published', error=2.5)
    rows = [
        preset, replace(preset, quantity='edge', error=math.nan), row(setting='good'),
        row(setting='euler', error=math.nan),
    ]
    for given in ([still], [*rows, still]):
        draw(given, {}, tmp_path / 'a.png')
    assert [len(axes) for axes in drawn] == [0, 1]
    others, named = (item.get_offsets() for item in drawn[1][0].collections)
    assert [place[1] for place in others] == [0.01]
    assert [place[1] for place in named] == [2.5]


def test_chart_shows_the_front_of_an_earlier_report(tmp_path, row, monkeypatch):
    drawn = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: drawn.append(figure))
    before = [row(error=0.5), row(case='other', error=0.1)]
    for former in ([], before):
        draw([row()], {}, tmp_path / 'a.png', former)
    _, plain = (figure.axes[0].lines for figure in drawn)
    assert [line.get_ydata().tolist() for line in plain] == [[0.01], [0.5]]
    legends = [[text.get_text() for text in figure.legends[0].texts] for figure in drawn]
    assert ['front before' in texts for texts in legends] == [False, True]


def test_panels_name_a_machine_that_is_not_in_the_heading(tmp_path, row, monkeypatch):
    drawn = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: drawn.append(figure))
    rows = [row(case='a', machine='new'), *(row(case=name, machine='old') for name in 'bc')]
    draw(rows, {}, tmp_path / 'a.png')
    (figure,) = drawn
    assert [text.get_text() for text in figure.texts].count('old') == 1
    assert [axes.texts[0].get_text() for axes in figure.axes] == ['new', '', '']


def test_unwritable_chart_is_an_error_that_names_the_file(tmp_path, row):
    with pytest.raises(LavaError, match=r'none/a\.png'):
        draw([row()], {}, tmp_path / 'none/a.png')
