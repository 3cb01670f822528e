# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page of commands."""

from pathlib import Path
import re

import pytest

from lava_ros.cli.parser import COMMANDS
from scripts import load_script

PAGE = Path(__file__).parents[2] / 'docs/commands.md'
SCRIPT = load_script(PAGE.with_suffix('.py'))


def test_tables_of_commands_are_up_to_date() -> None:
    for path, text in SCRIPT.pages().items():
        assert path.read_text(encoding='utf-8') == text, 'run python docs/commands.py'
    listed = [name for names in SCRIPT.JOBS.values() for name in names]
    assert sorted(listed) == sorted(COMMANDS)


@pytest.mark.parametrize('name', COMMANDS)
def test_page_of_commands_has_an_example_of_each_command(name: str) -> None:
    blocks = re.findall(r'```sh\n(.*?)```', PAGE.read_text(encoding='utf-8'), re.DOTALL)
    assert any(re.search(rf'(?m)^lava {name}\b', block) for block in blocks)
