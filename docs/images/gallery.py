# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Make the pictures of docs/gallery.md with the commands of that page.

python docs/images/gallery.py
"""

from contextlib import chdir
from pathlib import Path
import re
import runpy
import shlex
import shutil
from tempfile import TemporaryDirectory

from PIL import Image

from lava_ros.cli.main import main

FOLDER = Path(__file__).parent
PAGE = FOLDER.parent / 'gallery.md'
EXAMPLES = FOLDER.parents[1] / 'examples'

#: Longer side of a picture [pixels], and its number of colours.
SIZE, COLOURS = 900, 192


def commands() -> list[str]:
    """Return the `lava` commands of the page."""
    blocks = re.findall(r'```sh\n(.*?)```', PAGE.read_text(encoding='utf-8'), re.DOTALL)
    lines = '\n'.join(blocks).replace('\\\n', ' ').splitlines()
    return [line for line in lines if line.startswith('lava ')]


def shrink(path: Path) -> None:
    """Write a picture into the folder of this script, smaller and with fewer colours."""
    picture = Image.open(path).convert('RGB')
    picture.thumbnail((SIZE, SIZE), Image.Resampling.LANCZOS)
    picture.quantize(COLOURS).save(FOLDER / path.name, optimize=True)


if __name__ == '__main__':
    with TemporaryDirectory() as folder, chdir(folder):
        shutil.copytree(EXAMPLES, 'examples')
        runpy.run_path('examples/observatory_files.py')
        for command in commands():
            print(command)
            if main(shlex.split(command)[1:]):
                raise SystemExit(1)
        for path in Path().glob('gallery_*.png'):
            shrink(path)
