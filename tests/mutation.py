# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes single places of the code at random, and counts the changes that tests detect.

``python tests/mutation.py`` prints the score, and each change that no test detects as a diff. A
change is a mutant: another comparison, sign, small number or connective, or a deleted statement.
Kernels are left out: the cases of verification check them.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
import datetime
import difflib
from functools import cache
import os
from pathlib import Path
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

#: Maximum time of tests without a change [s]; slower tests are left out.
MAX_TEST_TIME = 600.0

#: Numbers that are changed; others are data, such as widths of lines.
_NUMBERS = {0: '1', 1: '2', 2: '1', 0.5: '0.6'}

_OTHER = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And,
}

#: Options of pytest for many files.
_SPREAD = ('--numprocesses=auto', '--dist=loadfile')

_WITHOUT_CODE = ('annotation', 'returns', 'decorator_list')


class Mutant(NamedTuple):
    """A changed place of a file: ``text`` in place of the bytes from ``start`` to ``end``."""

    file: str
    start: int
    end: int
    text: str

    def apply(self, source: bytes) -> bytes:
        """Return the changed source."""
        return source[: self.start] + self.text.encode() + source[self.end :]


def mutants(file: str, source: bytes) -> Iterator[Mutant]:
    """Yield all mutants of a file, except in kernels, constants, annotations and texts."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    # values of constants are data
    waiting: list[ast.AST] = [
        node for node in ast.parse(source).body
        if not isinstance(node, ast.Assign | ast.AnnAssign)
    ]
    while waiting:
        node = waiting.pop()
        decorators = ' '.join(map(ast.unparse, getattr(node, 'decorator_list', ())))
        is_text = isinstance(node, ast.JoinedStr | ast.Assert)
        if is_text or re.search(r'\bwp\.|kernel', decorators):
            continue
        text = _changed(node)
        if text is not None:
            first = starts[node.lineno - 1] + node.col_offset
            yield Mutant(file, first, starts[node.end_lineno - 1] + node.end_col_offset, text)
        for name, value in ast.iter_fields(node):
            children = value if isinstance(value, list) else [value]
            if name not in _WITHOUT_CODE:
                waiting += [child for child in children if isinstance(child, ast.AST)]


def _changed(node: ast.AST) -> str | None:
    """Return the text of a changed node, None if it remains."""
    is_call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    if is_call or isinstance(node, ast.AugAssign):
        return 'pass'
    if isinstance(node, ast.Constant):
        is_flag = isinstance(node.value, bool)
        return repr(not node.value) if is_flag else _NUMBERS.get(node.value)
    other: ast.expr | None = None
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        other = ast.Compare(node.left, [_OTHER[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.BinOp) and type(node.op) in _OTHER:
        other = ast.BinOp(node.left, _OTHER[type(node.op)](), node.right)
    if isinstance(node, ast.BoolOp):
        other = ast.BoolOp(_OTHER[type(node.op)](), node.values)
    return f'({ast.unparse(other)})' if other is not None else None


@cache
def tests_of(file: str) -> tuple[tuple[str, ...], ...]:
    """Return the tests of a file in stages: its own, those of its room, and those of others.

    Its own have its name, or are in its room and import it; those of other rooms import it.
    """
    path = Path(file)
    room = ROOT / 'tests' / path.parts[1]
    pattern = rf"\b{re.escape('.'.join(path.with_suffix('').parts))}\b"
    own, others = [], []
    for test in sorted((ROOT / 'tests').rglob('test_*.py')):
        is_near, name = room in test.parents, str(test.relative_to(ROOT))
        is_importing = re.search(pattern, test.read_text('utf-8'))
        if test.stem == f'test_{path.stem}' or (is_near and is_importing):
            own.append(name)
        elif is_importing:
            others.append(name)
    stages = tuple(own), (f'tests/{room.name}', *_SPREAD), (*others, *_SPREAD)
    return tuple(stage for stage in stages if stage not in ((), _SPREAD))


def passes(tree: Path, tests: tuple[str, ...], limit: float) -> bool:
    """Return True if tests pass in a copy of the project in less than ``limit`` [s]."""
    command = [sys.executable, '-m', 'pytest', '-q', '-x', '-p', 'no:cacheprovider', *tests]
    environment = {**os.environ, 'PYTHONPATH': str(tree), 'PYTHONDONTWRITEBYTECODE': '1'}
    try:
        return subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, check=False, timeout=limit
        ).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def is_detected(mutant: Mutant, tree: Path) -> bool | None:
    """Return True if a test fails, None if all tests are too slow or fail without the mutant."""
    path, result = tree / mutant.file, None
    source = path.read_bytes()
    for tests in tests_of(mutant.file):
        limit = None if result else _limit(tree, tests)
        if limit is not None:
            path.write_bytes(mutant.apply(source))
            result = not passes(tree, tests, limit)
            path.write_bytes(source)
    if result is False:
        old, new = (text.decode().splitlines() for text in (source, mutant.apply(source)))
        diff = difflib.unified_diff(old, new, mutant.file, n=1, lineterm='')
        print('\n'.join(diff), flush=True)
    return result


@cache
def _limit(tree: Path, tests: tuple[str, ...]) -> float | None:
    """Return the maximum time of tests with a mutant [s], None if they fail without."""
    begun = time.monotonic()
    if not passes(tree, tests, MAX_TEST_TIME):
        return None
    # a mutant that takes several times as long does not end
    return 3.0 * (time.monotonic() - begun) + 10.0


def main() -> None:
    """Try mutants until the time is over, and print the score and those that no test detects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seed', type=int, default=datetime.date.today().toordinal())
    parser.add_argument('--count', type=int, default=1000, help='maximum number of mutants')
    parser.add_argument('--minutes', type=float, default=30.0, help='start none after this time')
    parser.add_argument('--files', default='simulation/|live/|layers/', help='regular expression')
    options = parser.parse_args()
    end = time.monotonic() + 60.0 * options.minutes
    paths = sorted((ROOT / 'lava_ros').rglob('*.py'))
    everything = [
        mutant for path in paths for file in [str(path.relative_to(ROOT))]
        if re.search(options.files, file) for mutant in mutants(file, path.read_bytes())
    ]
    chosen = random.Random(options.seed).sample(everything, min(options.count, len(everything)))
    print(f'{len(everything)} mutants, seed {options.seed}', flush=True)
    with tempfile.TemporaryDirectory() as folder:
        ignored = shutil.ignore_patterns('.*', '__pycache__', 'bags', 'build', 'install', 'log')
        tree = shutil.copytree(ROOT, Path(folder) / 'project', ignore=ignored)
        found = [is_detected(one, tree) for one in chosen if time.monotonic() < end]
    tried = [result for result in found if result is not None]
    if not tried:
        sys.exit('no mutant was tried')
    print(f'tests detect {sum(tried)} of {len(tried)} mutants; {len(found) - len(tried)} have no '
          'usable tests')


if __name__ == '__main__':
    main()
