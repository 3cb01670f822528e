# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders of ensembles from earlier versions have pages, which name what they lack."""

import html
import json
from pathlib import Path
import shutil
from typing import Any

import pytest
import rasterio

from cli.conftest import ensemble_words
from command_line import done, refused

#: Maps, tags of the maps, and keys of the description that version 0.1.0 did not write, with words
#: about them on the page.
MAPS = {
    'arrival_time_earliest': 'earliest arrival of any run',
    'largest_peak_thickness': 'largest thickness of any run',
}
TAGS = {
    'unseen_percent': 'probability below which no run has lava',
    'arrives_before_p10_percent': 'probability that lava comes before the mapped times',
    'arrives_before_p50_percent': 'probability that lava comes before the mapped times',
    'arrives_before_p90_percent': 'probability that lava comes before the mapped times',
    'inundated_area_p10_m2': 'inundated area at 10, 50 and 90 % or more',
    'inundated_area_worst_m2': 'area inundated in any run',
    'spacing_error': 'error of the spacing',
    'is_usable': 'whether the error of the spacing is small enough',
}
KEYS = {
    'quantities': 'uncertain quantities with their sources',
    'plan.switched_on': 'effects that the runs have switched on',
    'plan.forced': 'effects that were forced',
}

#: Every map, tag and key alone, and all together, as in a folder of version 0.1.0.
CASES = [*([name] for name in (*MAPS, *TAGS, *KEYS)), [*MAPS, *TAGS, *KEYS]]


def remove(folder: Path, names: list[str]) -> None:
    """Remove maps, tags and keys from the folder of an ensemble."""
    for path in folder.glob('*.tif'):
        if path.stem in names:
            path.unlink()
            continue
        with rasterio.open(path) as file:
            kept = {key: text for key, text in file.tags().items() if key not in names}
            values, profile = file.read(), file.profile
        with rasterio.open(path, 'w', **profile) as file:
            file.write(values)
            file.update_tags(**kept)
    record = json.loads((folder / 'run.json').read_text())
    for name in names:
        *outer, last = name.split('.')
        (record[outer[0]] if outer else record).pop(last, None)
    write_as_earlier(folder, record)


def write_as_earlier(folder: Path, record: dict[str, Any]) -> None:
    """Replace run.json by the ensemble.json that version 0.1.0 wrote."""
    (folder / 'run.json').unlink()
    known = {name: record[name] for name in ('scene', 'elevation', 'plan', 'seed')}
    if 'quantities' in record:
        known['inputs'] = record['quantities']
    known |= {'version': 6, 'lava_ros': record['program']['lava_ros']}
    (folder / 'ensemble.json').write_text(json.dumps(known))


@pytest.mark.parametrize('names', CASES, ids=lambda names: '+'.join(names[:2]))
def test_page_names_what_an_earlier_version_did_not_write(
    names: list[str], ensemble: Path, tmp_path: Path, undrawn: None
) -> None:
    folder = Path(shutil.copytree(ensemble, tmp_path / 'members'))
    remove(folder, names)
    done('map', folder, '-o', tmp_path / 'page.html')
    page = html.unescape((tmp_path / 'page.html').read_text())
    assert 'wrote this folder without them' in page
    for name in names:
        assert {**MAPS, **TAGS, **KEYS}[name] in page
    for name in set(MAPS) - set(names):
        assert MAPS[name] not in page
    assert 'Inundation probability' in page and 'None' not in page and 'nan' not in page.split()


def test_page_of_this_version_lacks_nothing(
    ensemble: Path, tmp_path: Path, undrawn: None
) -> None:
    done('map', ensemble, '-o', tmp_path / 'page.html')
    assert 'wrote this folder' not in (tmp_path / 'page.html').read_text()


@pytest.mark.parametrize('name', ['elevation', 'inundation_probability', 'arrival_time_p50'])
def test_page_needs_the_maps_of_all_versions(name: str, ensemble: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ensemble, tmp_path / 'members'))
    (folder / f'{name}.tif').unlink()
    assert f'{name}.tif' in refused('map', folder, '-o', tmp_path / 'page.html')


def test_places_and_bags_of_an_earlier_ensemble_are_read_and_members_refused(
    ensemble: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(ensemble, tmp_path / 'members'))
    (tmp_path / 'huts.csv').write_text('x,y,name\n500240,4180190,hut\n')
    found = []
    for _ in range(2):
        done('places', folder, tmp_path / 'huts.csv', '--json', tmp_path / 'a.json')
        found.append(json.loads((tmp_path / 'a.json').read_text())['places'])
        assert 'recording  finished' in done('bag', 'info', folder)
        assert 'with --formats' in refused('export', folder, '-o', tmp_path / 'maps')
        if (folder / 'run.json').exists():
            write_as_earlier(folder, json.loads((folder / 'run.json').read_text()))
    assert found[0] == found[1]
    words = [folder if word == ensemble else word for word in ensemble_words(ensemble.parent, 5)]
    assert 'new, empty, or of this ensemble' in refused(*words)
