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

"""Data files are found in a checkout, in an ament prefix and where pip puts them."""

from pathlib import Path
import sys

import pytest

from lava_ros.errors import LavaError
from lava_ros.files import resources as share
from lava_ros.files.resources import share_path


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The package as if it were installed: not in a checkout, an empty prefix, no ament."""
    package = tmp_path / 'lib/site-packages/lava_ros'
    package.mkdir(parents=True)
    monkeypatch.setattr(share, '__file__', str(package / 'resources.py'))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'prefix'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return tmp_path


def put(prefix: Path) -> Path:
    """Install a data file into a prefix."""
    path = prefix / 'share/lava_ros/msg_configs/default.yaml'
    path.parent.mkdir(parents=True)
    path.write_text('layers: {}\n')
    return path


def test_checkout():
    """In a checkout the files beside the package are used."""
    assert share_path('msg_configs/default.yaml').parents[1] == Path(share.__file__).parents[2]


def test_pip(installed):
    """Without a checkout and ament, pip's share folder is used."""
    path = put(installed / 'prefix')
    assert share_path('msg_configs/default.yaml') == path


def test_ament_comes_before_pip(installed, monkeypatch):
    """An ament prefix wins over pip's; the first prefix that has the file wins."""
    put(installed / 'prefix')
    path = put(installed / 'overlay')
    put(installed / 'underlay')
    prefixes = f'{installed / "empty"}:{installed / "overlay"}:{installed / "underlay"}'
    monkeypatch.setenv('AMENT_PREFIX_PATH', prefixes)
    assert share_path('msg_configs/default.yaml') == path


def test_somebody_elses_checkout_is_not_ours(installed):
    """A package.xml of another package beside lava_ros/ does not make a checkout."""
    root = installed / 'lib/site-packages'
    (root / 'package.xml').write_text('<package><name>other</name></package>')
    (root / 'msg_configs').mkdir()
    (root / 'msg_configs/default.yaml').write_text('')
    path = put(installed / 'prefix')
    assert share_path('msg_configs/default.yaml') == path


def test_a_missing_file_lists_the_places(installed):
    """The error names the file and every place that was looked at."""
    with pytest.raises(LavaError, match=r'msg_configs/none\.yaml') as caught:
        share_path('msg_configs/none.yaml')
    assert str(installed / 'prefix/share/lava_ros/msg_configs/none.yaml') in str(caught.value)


def test_a_file_of_the_user_comes_first(tmp_path, monkeypatch):
    """A path is taken as it is; a name without such a file is looked for in the package."""
    monkeypatch.chdir(tmp_path)
    assert share.find_file('default.yaml', 'msg_configs').parent.name == 'msg_configs'
    (tmp_path / 'default.yaml').write_text('layers: {}')
    assert share.find_file('default.yaml', 'msg_configs') == Path('default.yaml')
    with pytest.raises(LavaError, match='nothing.yaml'):
        share.find_file('nothing.yaml', 'msg_configs')
