# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Make the pictures of ``docs/how_to/watch.md`` with a headless Chromium.

The variable CHROME names it, or ``make look`` installs it.

The recording shows a bag of ``examples/etna.yaml`` with checkpoints, the picture the forecast of a
running node:

    lava ros node --ros-args -p scene:=examples/etna.yaml -p record:=true \
        -p bag_directory:=bags/film -p time_scale:=2400.0 -p preset:=draft \
        -p end_time:=43200.0 -p checkpoint_period:=1.0
    PYTHONPATH=tests python docs/images/watch.py bags/film
    lava ros node --ros-args -p scene:=examples/uncertain.yaml -p forecast_horizon:=2.0 \
        -p ensemble_members:=8 -p time_scale:=60.0 -p preset:=draft &
    PYTHONPATH=tests python docs/images/watch.py
"""

import base64
from contextlib import closing
from io import BytesIO
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from PIL import Image

from lava_ros.layers.layer import PROBABILITY
from lava_ros.watch.frames import BagFrames
from lava_ros.watch.page import Page, SHOWN
from lava_ros.watch.server import Server
from products.report.devtools import Browser

FOLDER = Path(__file__).parent

#: Sizes of the page and of a picture [pixels].
SIZE, SHOWN_SIZE = (1200, 560), (750, 350)

#: Duration of a picture of the recording [ms], and its number of colours.
DURATION, COLOURS = 160, 255

#: Movement of the mouse between two pictures [pixels], which turns the view, and of its wheel
#: before the first one, which brings the lava nearer.
TURN, WHEEL = 8, -700

#: Closes the notice that there is no GPU.
CLOSE = 'document.querySelectorAll("[class*=Notification-closeButton]").forEach(e => e.click())'

#: The button of the view from the south.
SOUTH = '[...document.querySelectorAll("button")].find(e => /south/.test(e.textContent))'

#: Number of pictures with particles at the end of the recording.
N_PARTICLES = 4


class Camera:
    """A browser that shows the page of a server."""

    def __init__(self, browser: Browser, server: Server) -> None:
        """Open the page, and wait until it shows a map."""
        self._browser, self._server = browser, server
        browser.resize(*SIZE)
        browser.call('Page.navigate', url=f'http://127.0.0.1:{server.port}/')
        while not browser.evaluate(f'{SOUTH} != null'):
            self.draw()
        self.approach()
        browser.evaluate(CLOSE)
        self.draw(20)

    @property
    def page(self) -> Page:
        """The page."""
        return next(iter(self._server.pages.values()))

    def draw(self, rounds: int = 1) -> None:
        """Update the page, and let the browser draw it."""
        for _ in range(rounds):
            self._server.update()
            self._browser.evaluate('0')
            time.sleep(0.05)

    def approach(self) -> None:
        """Look at the lava from the south, from near."""
        self._browser.evaluate(f'{SOUTH}.click()')
        self.draw(10)
        self._mouse('mouseWheel', deltaX=0, deltaY=WHEEL)
        self.draw(60)

    def turn(self) -> None:
        """Turn the view about the lava."""
        for kind, moved in (('mousePressed', 0), ('mouseMoved', TURN), ('mouseReleased', TURN)):
            self._mouse(kind, moved, button='left', clickCount=1)

    def _mouse(self, kind: str, moved: int = 0, **options: Any) -> None:
        place = {'x': SIZE[0] // 2 + moved, 'y': SIZE[1] // 2}
        self._browser.call('Input.dispatchMouseEvent', type=kind, **place, **options)

    def picture(self) -> Image.Image:
        """Return the page as a picture."""
        data = self._browser.call('Page.captureScreenshot', format='png')['data']
        page = Image.open(BytesIO(base64.b64decode(data))).convert('RGB')
        return page.resize(SHOWN_SIZE, Image.Resampling.LANCZOS)


def record(camera: Camera, count: int) -> list[Image.Image]:
    """Return pictures of each of ``count`` maps, and of the last particles."""
    pictures = []
    for number in range(count + N_PARTICLES):
        camera.page.slider.value = min(number, count - 1)
        camera.page.particles.value = number >= count
        camera.turn()
        camera.draw(8)
        pictures.append(camera.picture())
    return pictures


def main() -> None:
    """Write the recording of a bag, or the picture of the running node."""
    if sys.argv[1:]:
        frames = BagFrames(sys.argv[1])
    else:
        from lava_ros.clients.live_frames import LiveFrames

        frames = LiveFrames()
    server = Server(frames, 0)
    with (
        TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        closing(Browser(Path(folder))) as browser,
        closing(server),
    ):
        camera = Camera(browser, server)
        if sys.argv[1:]:
            first, *others = (
                item.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
                for item in record(camera, len(frames.times))
            )
            first.save(
                FOLDER / 'watch.gif', save_all=True, append_images=others, duration=DURATION,
                loop=0, optimize=True,
            )
        else:
            probability = SHOWN[PROBABILITY][0]
            while probability not in camera.page.choice.options:
                camera.draw(10)
            camera.page.choice.value = probability
            camera.draw(20)
            camera.approach()
            camera.picture().save(FOLDER / 'watch.png', optimize=True)


if __name__ == '__main__':
    main()
