# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Prints the figures of `make nightly`: python tests/fuzz/table.py build/fuzz.json.

Fails if a kind was tried too rarely.
"""

import json
from pathlib import Path
import sys

COLUMNS = ('tried', 'refused', 'failed', 'longest_s')

#: Minimum number of trials of each kind in a night.
KINDS = {
    'scenes': 2000, 'messages': 2000, 'bags': 500, 'command lines': 2000, 'kills': 20,
    'flips': 300, 'rasters': 400, 'vectors': 400, 'tables': 400, 'YAML': 400,
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
    tried = {kind: row.get('tried', 0) for kind, row in figures.items()}
    few = [kind for kind, minimum in KINDS.items() if tried.get(kind, 0) < minimum]
    if few:
        sys.exit(f'tried too rarely: {", ".join(few)}')


if __name__ == '__main__':
    main()
