# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A bag with all contents of a report, including text that could break the page."""

import json

import pytest
import yaml

from recording import record

#: Text that runs, or ends the element around it, on a page that does not escape it.
HOSTILE = '</script><script>window.broken = 1</script><img src=x onerror="window.broken = 1">&\'"'


@pytest.fixture(scope='session')
def run(tmp_path_factory):
    """Return a bag with nine frames, effects that change, parameters and hostile texts."""
    effects = [
        {
            'stamp_ns': 1,
            'time': 0.0,
            'effects': {
                'cooling': 'on: heat lost = 2.5 > 0.01',
                'crust': f'off: {HOSTILE}',
            },
        },
        {'stamp_ns': 2, 'time': 300.0, 'effects': {'crust': 'on: forced'}},
    ]
    parameters = {'preset': 'standard', 'spacing': 0.0, 'frame_id': HOSTILE}
    return record(
        tmp_path_factory.mktemp('report') / 'run',
        [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0, 1400.0, 1600.0],
        custom_data={
            'effects': json.dumps(effects),
            'parameters': yaml.safe_dump(parameters),
            'version': HOSTILE,
            'device': 'cpu',
        },
    )
