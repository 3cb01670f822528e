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
from lava_ros.verification.cases.sheets import EXPERIMENTS, FORMS, RADII
from lava_ros.verification.chart import draw
from lava_ros.verification.measure import all_settings, name_of, Setting, STEPPED
from lava_ros.verification.rows import points, presets_of
from scripts import load_script

report = load_script(Path(__file__).parents[2] / 'docs/accuracy_report.py')
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


def test_super_time_stepping_is_compared_with_euler(row):
    """Euler takes 400 evaluations; the others take 100 and err half as much."""
    rows = [
        row(
            setting=name_of(accuracy), quantity=quantity,
            evaluations=400 if accuracy.integrator == 'euler' else 100,
            error=0.02 if accuracy.integrator == 'euler' else error,
        )
        for accuracy in measure.stepping()
        if accuracy.refinement == STEPPED[0]
        for quantity, error in (('radius', 0.01), ('profile', 0.0201))
    ]
    head, euler, *others = table(rows, 'Super-time-stepping')
    column = {name: index for index, name in enumerate(head)}
    assert euler[column['integrator']] == 'Euler'
    assert euler[column["Euler's over these"]] == ''
    assert [line[column['Courant number']] for line in others] == ['0.5', '0.75', '1']
    assert {line[column["Euler's over these"]] for line in others} == {'4.0'}
    assert {line[column["larger than Euler's"]] for line in others} == {'none'}
    worse = [replace(item, error=0.03) if item.error == 0.0201 else item for item in rows]
    _, _, *others = table(worse, 'Super-time-stepping')
    assert {line[column["larger than Euler's"]] for line in others} == {'profile'}


def test_corrections_lead_from_the_paper_to_the_default(row):
    """Each correction halves the errors."""
    rows = [
        row(
            setting=name_of(accuracy), preset={0: 'as-published', 7: 'standard'}.get(index, ''),
            quantity=quantity, error=scale * 0.5**index, wall_s_per_simulated_hour=100.0 - index,
        )
        for index, accuracy in enumerate(measure.paper_settings().values())
        for quantity, scale in (('radius', 0.1), ('scatter', 1.28))
    ]
    title = "From the paper's settings to ours"
    head, *lines = table(rows, title)
    assert head[:3] == ['setting', 'radius', 'scatter']
    assert [line[0] for line in lines] == list(measure.paper_settings())
    assert (lines[0][2], lines[-1][2]) == ('128 %', '1 %')
    text = '\n'.join(section(rows, title))
    assert 'is standard: its largest error is 1 %, in 93 s instead of 100 s' in text
    assert 'is 128 % (scatter), so the ratio of the errors is 0.0078.' in text
    expensive = row(setting='expensive', error=1e-6, wall_s_per_simulated_hour=101.0)
    cheap = row(setting='cheap', error=1e-5, wall_s_per_simulated_hour=99.0)
    assert section([*rows, expensive], title) == section(rows, title)
    assert 'is cheap: its' in '\n'.join(section([*rows, expensive, cheap], title))


def test_gradient_forms_are_compared_by_case(row):
    forms = measure.gradients()
    rows = [
        row(case=case, setting=name_of(accuracy), quantity=quantity, error=error)
        for case in ('fixed_volume', 'pond')
        for accuracy, error in zip(forms.values(), (0.02, 0.001, 0.5), strict=False)
        for quantity in ('speed', 'flatness')
    ]
    head, *lines = table(rows, 'Gradient forms')
    assert head == ['case', 'quantity', *forms]
    assert ['A pond', 'flatness', *['2 %', '0.1 %', '50 %'][: len(forms)]] in lines
    assert ['A pond', 'a run took', *(['1 s'] * len(forms))] in lines
    assert len(lines) == 6
    assert len(table(rows[:-2], 'Gradient forms')) == 1 + 3
    assert section(rows[:2], 'Gradient forms') is None


def test_lateral_stress_is_compared_by_form_and_radius(row):
    rows = [
        row(
            case='lateral', setting=f'{kind}, l = {radius:g} h',
            quantity=f'response at {length} h', error=0.01 * radius / length,
            wall_s=2.0 if kind == 'green' else 4.0, wall_s_per_simulated_hour=math.nan,
        )
        for kind in ('green', 'helmholtz')
        for radius in (2.0, 1.0, 10.0)
        for length in (4, 20)
        if (kind, radius) != ('green', 10.0)
    ]
    head, *lines = table(rows, 'Lateral stress')
    assert head == ['quantity', 'l/h', 'green', 'helmholtz']
    assert lines[0] == ['response at 4 h', '1', '0.25 %', '0.25 %']
    assert lines[2] == ['response at 4 h', '10', '', '2.5 %']
    assert [line[1] for line in lines] == ['1', '2', '10'] * 3
    assert lines[6] == ['time per particle and evaluation', '1', '2,500 ns', '5,000 ns']
    # the section parses the names of the experiments
    rows = [row(case='lateral', setting=name) for name in EXPERIMENTS]
    head, *lines = table(rows, 'Lateral stress')
    assert head[2:] == list(FORMS)
    assert [float(line[1]) for line in lines] == 2 * list(RADII)
    assert all(cell for line in lines for cell in line)


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


def test_unwritable_chart_is_an_error_that_names_the_file(tmp_path, row):
    with pytest.raises(LavaError, match=r'none/a\.png'):
        draw([row()], {}, tmp_path / 'none/a.png')
