# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Prints what a run of `make nightly` has tried: python tests/fuzz/table.py build/fuzz.json.

Fails where a kind was tried less often than it should be.
"""

import json
from pathlib import Path
import sys

COLUMNS = ('tried', 'refused', 'failed', 'longest_s')

#: What every night tries, and how often at least.
KINDS = {
    'scenes': 2000, 'messages': 2000, 'files': 2000, 'command lines': 2000, 'kills': 20,
    'flips': 1500,
}


def main() -> None:
    """Print a row for each kind."""
    path = Path(sys.argv[1])
    figures = json.loads(path.read_text(encoding='utf-8')) if path.exists() else {}
    print(f'{"":14}' + ''.join(f'{name:>11}' for name in COLUMNS))
    for kind in dict.fromkeys((*KINDS, *figures)):
        row = figures.get(kind, {})
        cells = [row.get(name, '-') for name in COLUMNS]
        shown = [f'{cell:.2f}' if isinstance(cell, float) else str(cell) for cell in cells]
        print(f'{kind:14}' + ''.join(f'{cell:>11}' for cell in shown))
    few = [kind for kind, least in KINDS.items() if figures.get(kind, {}).get('tried', 0) < least]
    if few:
        sys.exit(f'tried too rarely: {", ".join(few)}')


if __name__ == '__main__':
    main()
