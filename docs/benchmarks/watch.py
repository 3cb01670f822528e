# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the live view of a large terrain: time to the first picture, CPU and memory.

    PYTHONPATH=tests python docs/benchmarks/watch.py 10

The argument is the duration [min]. A headless Chromium, which the variable CHROME names or
``make look`` installs, opens the page of 2,500 x 2,500 cells with 100,000 cells of lava, which
change ``RATE`` times a second after the first picture. Most of the time to this picture is the
browser's. Later CPU and memory are those of this process, the server; maps
are in its memory, so that no ROS is involved. As root, begin the command with
``setpriv --bounding-set=-sys_nice --inh-caps=-sys_nice``: Chromium without a GPU would
otherwise draw with a higher priority than the server's.
"""

from contextlib import closing, suppress
import math
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import threading
import time

import numpy as np

from lava_ros.layers.frame import Frame, LayerFrame
from lava_ros.layers.layer import IMAGE, Layer
from lava_ros.watch.frames import Frames
from lava_ros.watch.server import Server
from products.report.devtools import Browser

#: Cells along a side of the terrain, maps a second, different maps, and kept times.
SIDE, RATE, N_MAPS, N_TIMES = 2500, 5.0, 4, 600

#: Numbers of the page's last picture: its triangles, more than it has without the ground.
INFO, GROUND = 'window.__viserTestpoints?.rendererInfo.render', 120_000


class Flow(Frames):
    """A lobe of lava of 100,000 cells whose thickness changes with time."""

    def __init__(self) -> None:
        """Make the maps."""
        super().__init__()
        y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
        ground = 3000.0 - 0.8 * np.hypot(x - 1250.0, y - 1250.0)
        ground += 20.0 * np.sin(x / 9.0 + y / 17.0)
        # half axes of 640 and 50 cells
        inside = ((x - 1800.0) / 640.0) ** 2 + ((y - 1250.0) / 50.0) ** 2 < 1.0
        layer = Layer('height_raw', 'height_raw', 'thickness', IMAGE)
        self.cells = int(inside.sum())
        self.times, self.version = [0.0], 1
        self.shown, self.begun, self._maps = 0, math.inf, []
        for number in range(N_MAPS):
            depth = np.where(inside, 3.0 + 2.0 * np.sin(0.02 * x + number), np.nan)
            shown = LayerFrame(layer, depth.astype(np.float32), False)
            self._maps.append(Frame(
                elevation=ground, resolution=5.0, origin=(0.0, 0.0), layers={'thickness': shown},
                vents=np.array([[6300.0, 6250.0]]), time=0.0, scene={},
            ))

    def poll(self) -> None:
        """Add the maps that are due since ``begun``."""
        count = int(RATE * max(time.monotonic() - self.begun, 0.0)) + 1
        if count > self.version:
            self.version = count
            self.times = [float(item) for item in range(max(0, count - N_TIMES), count)]

    def frame(self, index: int) -> Frame:
        """Return one of the maps in turn, and count it."""
        self.shown += 1
        return self._maps[int(self.times[index]) % N_MAPS]


def browser_seconds() -> float:
    """Return the CPU time of the descendants of this process, which are the browser [s]."""
    ticks, parents = {}, {}
    for process in Path('/proc').glob('[0-9]*'):
        with suppress(OSError):
            fields = (process / 'stat').read_text(encoding='utf-8').rpartition(')')[2].split()
            parents[int(process.name)] = int(fields[1])
            ticks[int(process.name)] = int(fields[11]) + int(fields[12])
    family: set[int] = set()
    while more := {item for item in parents if parents[item] in {os.getpid(), *family}} - family:
        family |= more
    return sum(ticks[item] for item in family) / os.sysconf('SC_CLK_TCK')


def resident() -> float:
    """Return the resident memory of this process [MB]."""
    lines = Path('/proc/self/status').read_text(encoding='utf-8').splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith('VmRSS'))) / 1024.0


def main() -> None:
    """Print the first picture's time, then CPU and memory each half minute."""
    flow = Flow()
    server, ended = Server(flow, 0), threading.Event()
    serving = threading.Thread(target=server.run, args=(ended,), daemon=True)
    with (
        TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        closing(Browser(Path(folder))) as browser,
    ):
        browser.resize(1000, 600)
        serving.start()
        begun, server_cpu, cpu = time.monotonic(), time.process_time(), browser_seconds()
        browser.call('Page.navigate', url=f'http://127.0.0.1:{server.port}/')
        browser.wait_for('(document.body?.innerText ?? "").includes("Lava flow")')
        text = time.monotonic() - begun
        browser.wait_for(f'({INFO}.triangles ?? 0) > {GROUND}')
        browser.screenshot(Path(folder) / 'first.png')
        print(
            f'{flow.cells} cells of lava, all sent after {text:.1f} s, first picture after '
            f'{time.monotonic() - begun:.1f} s: CPU time of the server '
            f'{time.process_time() - server_cpu:.1f} s, of the browser '
            f'{browser_seconds() - cpu:.1f} s', flush=True,
        )
        flow.begun = time.monotonic()
        for _ in range(round(2.0 * float(sys.argv[1]))):
            cpu, wall, shown = time.process_time(), time.monotonic(), flow.shown
            drawn = browser.evaluate(f'{INFO}.frame')
            time.sleep(30.0)
            wall = time.monotonic() - wall
            drawn = browser.evaluate(f'{INFO}.frame') - drawn
            heap = browser.evaluate('performance.memory.usedJSHeapSize') / 2**20
            print(
                f'{time.monotonic() - begun:4.0f} s: {(flow.shown - shown) / wall:.1f} maps/s as '
                f'{drawn / wall:.1f} pictures/s, '
                f'{100.0 * (time.process_time() - cpu) / wall:.0f} % of a core, server '
                f'{resident():.0f} MB, heap of the page {heap:.0f} MB', flush=True,
            )
        ended.set()
        serving.join()


if __name__ == '__main__':
    main()
