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

"""Where bags may be written."""

import pytest

from lava_ros.errors import LavaError
from lava_ros.ros.bag_folder import BagFolder


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a folder outside of it and a link to that."""
    (tmp_path / 'outside').mkdir()
    (tmp_path / 'here' / 'bags').mkdir(parents=True)
    (tmp_path / 'here' / 'bags' / 'link').symlink_to(tmp_path / 'outside')
    monkeypatch.chdir(tmp_path / 'here')
    return tmp_path


def test_the_bag_given_at_the_start_may_be_anywhere(here):
    """The user's own word is taken as it is, again and again."""
    given = str(here / 'outside' / 'bag')
    folder = BagFolder('', given)
    assert str(folder.path(given)) == given


def test_a_bag_without_a_name(here):
    """It is named by the time, in the root: the folder of the given bag, or bags/."""
    assert BagFolder('', '').path('').parent.name == 'bags'
    given = here / 'outside' / 'bag'
    assert BagFolder('', str(given)).path('').parent == given.parent
    assert BagFolder(str(here), '').path('').parent == here


def test_names_inside_the_root(here):
    """Relative to the working directory, or absolute."""
    folder = BagFolder('', '')
    for name in ('bags/one', 'bags/two/three', str(here / 'here' / 'bags' / 'four')):
        assert str(folder.path(name)) == name


@pytest.mark.parametrize(
    'name',
    [
        '/etc/lava',
        'one',
        'bags',
        'bags/../one',
        '../outside/bag',
        'bags/link/bag',
        'bags/link/../outside/bag',
        'bags/\0',
    ],
)
def test_names_outside_the_root_are_refused(here, name):
    """Whether by an absolute path, by .., or by a link."""
    with pytest.raises(LavaError, match='bag_directory'):
        BagFolder('', '').path(name)


def test_a_root_of_its_own(here):
    """With bag_root the bags lie there, and only there."""
    root = here / 'outside'
    folder = BagFolder(str(root), 'bags/first')
    assert str(folder.path('bags/first')) == 'bags/first'
    assert folder.path(str(root / 'second')) == root / 'second'
    with pytest.raises(LavaError, match='outside'):
        folder.path('bags/third')


def test_nodes_that_share_a_folder(here):
    """Bags named by the time never meet: not of two nodes, nor two of one node in one second."""
    root = here / 'outside'
    for node, end in (('/lava', ''), ('/etna/lava', '_etna_lava')):
        folder = BagFolder(str(root), '', node=node)
        first = folder.path('')
        first.mkdir()
        second = folder.path('')
        assert first.name.removesuffix(end).count('_') == 0
        assert second not in (first, here)
        assert not second.exists()
