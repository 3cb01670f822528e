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

"""The manual page of `lava`, its sentences about wrong usage, and the completion of shells."""

import subprocess

import pytest

from lava_ros.cli import main as cli


def _page(capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(['--help'])
    assert caught.value.code == 0
    return capsys.readouterr().out


def test_the_page_has_its_parts(capsys):
    """Name, synopsis, commands, examples, environment and exit status, within 88 columns."""
    page = _page(capsys)
    for part in ('NAME', 'SYNOPSIS', 'COMMANDS', 'EXAMPLES', 'ENVIRONMENT', 'EXIT STATUS'):
        assert f'{part}\n' in page
    assert max(len(line) for line in page.splitlines()) <= 88


def test_every_command_has_a_line_under_a_heading(capsys):
    """In the order of the groups, each once, with what it does."""
    page = _page(capsys)
    listed = page[page.index('COMMANDS') : page.index('EXAMPLES')].splitlines()[1:]
    lines = [line for line in listed if line.strip()]
    expected = []
    for heading, commands in cli.GROUPS:
        expected.append(f'  {heading}')
        words = [command.__name__.split('.')[-1].replace('_', '-') for command in commands]
        expected += [f'    {word}' for word in words]
    names = [line for line in lines if not line.startswith('     ')]
    assert [line[: 17 if line.startswith('    ') else None].rstrip() for line in names] == expected
    assert all(line[17:].strip() for line in lines if line.startswith('    '))


def test_the_examples_of_the_page_parse(capsys):
    """Each example is a command with arguments that it takes."""
    page = _page(capsys)
    examples = page[page.index('EXAMPLES') : page.index('ENVIRONMENT')].splitlines()[1:]
    commands = [line.strip().split('  ')[0] for line in examples if line.strip()]
    assert len(commands) >= 5
    for command in commands:
        words = command.split()[1:]
        if '--ros-args' in words:
            words = words[: words.index('--ros-args')]
        assert cli._parser().parse_args(words).command == words[0]


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        ((), "lava: COMMAND is missing; 'lava --help'"),
        (('replays',), "lava: 'replays' is not a command, 'replay' is the closest; 'lava --help'"),
        (('dance',), "lava: 'dance' is not a command; there are demo, node,"),
        (('--verson',), "lava: '--verson' is not known here, '--version' is the closest"),
        (('replay',), "lava replay: bag is missing; 'lava replay --help'"),
        (('replay', 'bag', '--rate', 'x'), "lava replay: --rate: 'x' is not a number"),
        (('replay', 'bag', '--rate'), 'lava replay: --rate: expected one argument'),
        (('replay', 'bag', '--rte', '2'), "lava replay: '--rte' is not known here, '--rate' is"),
        (('info', 'a', 'b'), "lava info: 'b' is not known here"),
        (('plot', 'bag'), 'lava plot: -o/--output is missing'),
        (('bench', 'speed'), "'speed' is not known; there are effects, steps, publishing"),
        (('bench', 'effects', '--runs', '1.5'), "--runs: '1.5' is not a whole number"),
        (('demo', '--preset', 'none'), "--preset: 'none' is not known; there are draft, standard"),
        (('completion', 'fish'), "'fish' is not known; there are bash, zsh"),
        (('node', 'scene.yaml'), "lava node: 'scene.yaml' is not known here"),
    ],
)
def test_wrong_usage_is_one_sentence(words, sentence, capsys):
    """What is wrong, what is close, and where to read on; status 2, nothing on stdout."""
    with pytest.raises(SystemExit) as caught:
        cli.main(words)
    assert caught.value.code == 2
    seen = capsys.readouterr()
    assert seen.out == ''
    assert seen.err.count('\n') == 1
    assert sentence in seen.err
    assert seen.err.endswith("--help' lists what it takes\n")


def test_an_error_of_a_library_is_one_line(tmp_path, capsys):
    """YAML explains itself over several lines; here it does so in one."""
    (tmp_path / 'scene.yaml').write_text('terrain: {file: a\nvents: [')
    assert cli.main(['effects', str(tmp_path / 'scene.yaml')]) == 2
    assert capsys.readouterr().err.count('\n') == 1


def _completions(script, words):
    """What bash completes the last word to."""
    quoted = ' '.join(f"'{word}'" for word in words)
    code = (
        f'{script}\nCOMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; COMP_LINE="{words}"\n'
        'completer=$(complete -p lava | sed -E "s/.*-F ([^ ]+).*/\\1/"); $completer\n'
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    ended = subprocess.run(
        ['bash', '--norc', '-c', code], capture_output=True, text=True, timeout=20, check=True
    )
    return set(ended.stdout.split())


def test_bash_completes(capsys, tmp_path, monkeypatch):
    """Commands, options, choices and files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'etna.yaml').write_text('')
    assert cli.main(['completion', 'bash']) == 0
    script = capsys.readouterr().out
    assert _completions(script, ['lava', 'do']) == {'doctor'}
    assert {'--rate', '--loop', '--clock'} <= _completions(script, ['lava', 'replay', '--'])
    assert _completions(script, ['lava', 'completion', '']) >= {'bash', 'zsh'}
    assert 'etna.yaml' in _completions(script, ['lava', 'effects', 'et'])


def test_zsh_gets_a_script(capsys):
    """It is one of zsh's, and has every command."""
    assert cli.main(['completion', 'zsh']) == 0
    script = capsys.readouterr().out
    assert script.startswith('#compdef lava')
    for _, commands in cli.GROUPS:
        for command in commands:
            assert command.__name__.split('.')[-1] in script


def test_completion_without_its_library(monkeypatch, capsys):
    """The error says how to get it."""
    monkeypatch.setitem(cli.sys.modules, 'shtab', None)
    assert cli.main(['completion', 'bash']) == 2
    assert "pip install 'lava_ros[completion]'" in capsys.readouterr().err
