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

"""What is shown of a command that takes a while: a bar in a terminal, lines elsewhere."""

import os
from pathlib import Path
import subprocess
import sys

import pytest

from lava_ros.cli.output import in_terminal, Progress

ROOT = Path(__file__).parents[2]

PROGRAM = """
import sys
if '--bare' in sys.argv:
    sys.modules['rich.progress'] = None
from lava_ros.cli.output import in_terminal
with in_terminal() as show:
    for part in range(11):
        show('counting', part / 10)
print('done')
"""


def test_tenths_are_lines_where_nobody_watches(capsys):
    """Each tenth once, however often it is told."""
    with Progress() as progress:
        for part in range(101):
            progress.show('counting', part / 100)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 11
    assert lines[0] == '  0 %  counting'
    assert lines[5].startswith(' 50 %  counting, ') and lines[5].endswith(' s left')
    assert lines[10] == '100 %  counting'
    with in_terminal() as show:
        show('counting', 0.5)
    assert capsys.readouterr().out == ''


@pytest.mark.parametrize(('word', 'shown'), [('', '\x1b['), ('--bare', ' 50 %  counting')])
def test_a_terminal_has_a_bar(word, shown):
    """With rich; without it the lines do. What is printed afterwards is there."""
    outside, inside = os.openpty()
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM, word],
        stdin=inside,
        stdout=inside,
        stderr=inside,
        cwd=ROOT,
        env=os.environ | {'TERM': 'xterm-256color'},
    )
    os.close(inside)
    seen = b''
    try:
        while chunk := os.read(outside, 4096):
            seen += chunk
    except OSError:
        # how the end of a terminal's last program is told
        pass
    os.close(outside)
    assert process.wait(30.0) == 0, seen
    text = seen.decode()
    assert shown in text
    assert 'counting' in text
    assert 'done' in text
