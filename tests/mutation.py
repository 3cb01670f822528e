# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes single places of the code at random, and counts the changes that its tests detect.

``python tests/mutation.py`` prints the score, and each change that no test detects as a diff. A
change is a mutant: another comparison, sign, small number or connective, or a deleted statement.
Kernels are left out: the cases of verification check them.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
import datetime
import difflib
from functools import cache
import os
from pathlib import Path
from queue import SimpleQueue
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

#: Regular expression of the files that are changed.
FILES = 'simulation/|live/|maps/'

#: Maximum time of the tests of a file without a change [s]; slower files are left out.
MAX_TEST_TIME = 240.0

#: Numbers that are changed; others are data, such as widths of lines.
_NUMBERS = {0: '1', 1: '2', 2: '1', 0.5: '0.6'}

_IGNORED = shutil.ignore_patterns('.*', '__pycache__', 'bags', 'build', 'install', 'log')

_WITHOUT_CODE = ('annotation', 'returns', 'decorator_list')

_OTHER = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And,
}


class Mutant(NamedTuple):
    """A changed place of a file: the bytes from ``start`` to ``end`` are replaced."""

    file: str
    start: int
    end: int
    text: str

    def apply(self, source: bytes) -> bytes:
        """Return the changed source."""
        return source[: self.start] + self.text.encode() + source[self.end :]


def mutants(file: str, source: bytes) -> Iterator[Mutant]:
    """Yield all mutants of a file, except in kernels, annotations, assertions and texts."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def visit(node: ast.AST) -> Iterator[Mutant]:
        decorators = ' '.join(map(ast.unparse, getattr(node, 'decorator_list', ())))
        is_text = isinstance(node, ast.JoinedStr | ast.Assert)
        if is_text or re.search(r'\bwp\.|kernel', decorators):
            return
        text = _changed(node)
        if text is not None:
            first = starts[node.lineno - 1] + node.col_offset
            yield Mutant(file, first, starts[node.end_lineno - 1] + node.end_col_offset, text)
        for name, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and name not in _WITHOUT_CODE:
                    yield from visit(child)

    yield from visit(ast.parse(source))


def _changed(node: ast.AST) -> str | None:
    """Return the text of a changed node, None if it remains."""
    if isinstance(node, ast.AugAssign) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        return 'pass'
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        other = ast.Compare(node.left, [_OTHER[type(node.ops[0])]()], node.comparators)
        return f'({ast.unparse(other)})'
    if isinstance(node, ast.BinOp) and type(node.op) in _OTHER:
        return f'({ast.unparse(ast.BinOp(node.left, _OTHER[type(node.op)](), node.right))})'
    if isinstance(node, ast.BoolOp):
        return f'({ast.unparse(ast.BoolOp(_OTHER[type(node.op)](), node.values))})'
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return repr(not node.value)
    return _NUMBERS.get(node.value) if isinstance(node, ast.Constant) else None


@cache
def tests_of(file: str) -> tuple[str, ...]:
    """Return the tests of a file: those with its name in its room, or that import it there."""
    path = Path(file)
    module = re.escape('.'.join(path.with_suffix('').parts))
    room = ROOT / 'tests' / path.parts[1]
    found = [
        test for test in sorted(room.rglob('test_*.py'))
        if test.stem == f'test_{path.stem}'
        or re.search(rf'\b{module}\b', test.read_text(encoding='utf-8'))
    ]
    return tuple(str(test.relative_to(ROOT)) for test in found or [room])


def run_tests(tree: Path, tests: Sequence[str], limit: float) -> int | None:
    """Run tests in a copy of the project; return the exit status, None after ``limit`` [s]."""
    command = [sys.executable, '-m', 'pytest', '-q', '-x', '-p', 'no:cacheprovider', *tests]
    environment = {**os.environ, 'PYTHONPATH': str(tree), 'PYTHONDONTWRITEBYTECODE': '1'}
    try:
        return subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, check=False, timeout=limit
        ).returncode
    except subprocess.TimeoutExpired:
        return None


def main() -> None:
    """Try mutants until the time is over, and print the score and the survivors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seed', type=int, default=datetime.date.today().toordinal())
    parser.add_argument('--count', type=int, default=1000, help='maximum number of mutants')
    parser.add_argument('--minutes', type=float, default=30.0, help='start none after this time')
    parser.add_argument('--workers', type=int, default=max(1, (os.cpu_count() or 1) // 2))
    parser.add_argument('--files', default=FILES, help='regular expression of the files')
    options = parser.parse_args()
    paths = sorted((ROOT / 'lava_ros').rglob('*.py'))
    everything = [
        mutant for path in paths if re.search(options.files, str(path.relative_to(ROOT)))
        for mutant in mutants(str(path.relative_to(ROOT)), path.read_bytes())
    ]
    chosen = random.Random(options.seed).sample(everything, min(options.count, len(everything)))
    print(f'{len(everything)} mutants, seed {options.seed}', flush=True)
    end, trees, limits = time.monotonic() + 60.0 * options.minutes, SimpleQueue[Path](), {}

    def is_detected(mutant: Mutant) -> bool | None:
        """Return True if a test fails; None without time, or if the tests are too slow or fail."""
        if time.monotonic() >= end:
            return None
        tree, tests = trees.get(), tests_of(mutant.file)
        path, source = tree / mutant.file, (ROOT / mutant.file).read_bytes()
        try:
            if tests not in limits:
                begun = time.monotonic()
                passes = run_tests(tree, tests, MAX_TEST_TIME) == 0
                limits[tests] = 3.0 * (time.monotonic() - begun) + 10.0 if passes else None
            if limits[tests] is None:
                return None
            path.write_bytes(mutant.apply(source))
            # a mutant that takes several times as long does not end
            status = run_tests(tree, tests, limits[tests])
        finally:
            path.write_bytes(source)
            trees.put(tree)
        if status == 0:
            old, new = (text.decode().splitlines() for text in (source, mutant.apply(source)))
            print('\n'.join(difflib.unified_diff(old, new, mutant.file, n=1, lineterm='')),
                  flush=True)
        return status != 0

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.workers) as pool:
        for number in range(options.workers):
            trees.put(shutil.copytree(ROOT, Path(folder) / str(number), ignore=_IGNORED))
        found = list(pool.map(is_detected, chosen))
    tried = [item for item in found if item is not None]
    if not tried:
        sys.exit('no mutant was tried')
    print(f'{sum(tried)} of {len(tried)} mutants are detected; {len(found) - len(tried)} were not '
          'tried, as the time was over, or their tests are slow or fail')


if __name__ == '__main__':
    main()
