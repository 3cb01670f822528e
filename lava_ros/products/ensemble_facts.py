# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Facts about an ensemble for its page, also about folders of earlier versions."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lava_ros.files.yaml import parse_json
from lava_ros.forecast.influence import Influences
from lava_ros.scene.ranges import short_citation

#: Maps that version 0.1.0 did not write, and their names on the page.
_MAPS = {
    'arrival_time_earliest': 'earliest arrival of any run',
    'largest_peak_thickness': 'largest thickness of any run',
}

#: Tags and keys that version 0.1.0 did not write, and their names on the page.
_VALUES = {
    'unseen_percent': 'probability below which no run has lava',
    **{
        f'arrives_before_p{percent}_percent': 'probability that lava comes before the mapped times'
        for percent in (10, 50, 90)
    },
    **{
        f'inundated_area_p{percent}_m2': 'inundated area at 10, 50 and 90 % or more'
        for percent in (10, 50, 90)
    },
    'inundated_area_worst_m2': 'area inundated in any run',
    'spacing_error': 'error of the spacing',
    'is_usable': 'whether the error of the spacing is small enough',
    'quantities': 'uncertain quantities with their sources',
    'switched_on': 'effects that the runs have switched on',
    'forced': 'effects that were forced',
}


class Missing:
    """Maps, tags and keys that the folder of an ensemble lacks."""

    def __init__(self) -> None:
        """Initialize with a complete folder."""
        self._names: dict[str, None] = {}

    def has_map(self, folder: Path, stem: str) -> bool:
        """Return True unless a map is missing that an earlier version did not write."""
        if stem not in _MAPS or (folder / f'{stem}.tif').exists():
            return True
        self._names[_MAPS[stem]] = None
        return False

    def get(self, known: Mapping[str, Any], name: str) -> Any:
        """Return a value that an earlier version did not write; None if it is missing."""
        if name not in known:
            self._names[_VALUES[name]] = None
        return known.get(name)

    def facts(self, version: str) -> dict[str, str]:
        """Return the names of what is missing, for the page of an ensemble of a version."""
        if not self._names:
            return {}
        names = '; '.join(self._names)
        return {'missing': f'{names}. lava_ros {version} wrote this folder without them.'}


def describe_uncertain(inputs: Mapping[str, Any]) -> dict[str, str]:
    """Describe the uncertain quantities of a manifest with their sources, and the exact ones."""
    drawn = [
        f'{name.replace("_", " ")} {item["distribution"]}, {short_citation(item["source"])}'
        for name, item in inputs.get('drawn', {}).items()
    ]
    exact = [name.replace('_', ' ') for name in inputs.get('exact', {})]
    return {
        'uncertain': '; '.join(drawn) or 'no quantity',
        **({'taken as exact': ', '.join(exact)} if exact else {}),
    }


def describe_influence(tags: Mapping[str, str]) -> dict[str, str]:
    """Describe which quantities affect the inundated area most, if the tags state it."""
    if 'influence' not in tags:
        return {}
    found = Influences.from_dict(parse_json('influence', tags['influence']))
    return {'what decides (1 - J)': found.text()}
