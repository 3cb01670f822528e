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

"""A real browser for tests, driven by the DevTools protocol."""

import base64
from collections.abc import Callable
import importlib.util
import json
import os
from pathlib import Path
import shutil
import socket
import subprocess
import sys
import time
from typing import Any
from urllib.request import urlopen

import pytest

pytest.importorskip('tornado')
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

#: Names that Chromium has, beside the path in the environment variable CHROME.
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')

#: Longest that anything may take [s]: other work goes on beside the tests.
PATIENCE = 60.0

# Chromium as Qt's WebEngine has it, which comes as a wheel.
_QT = """
import sys
from PySide6.QtCore import QUrl
from PySide6.QtWebEngineWidgets import QWebEngineView
from PySide6.QtWidgets import QApplication
application = QApplication(sys.argv)
view = QWebEngineView()
view.resize(1000, 800)
view.load(QUrl('about:blank'))
view.show()
application.exec()
"""


def chromium() -> str | None:
    """Path of an installed Chromium, None without one."""
    return os.environ.get('CHROME') or next(filter(None, map(shutil.which, NAMES)), None)


def has_qt() -> bool:
    """Whether Qt's WebEngine is installed."""
    if importlib.util.find_spec('PySide6') is None:
        return False
    return importlib.util.find_spec('PySide6.QtWebEngineWidgets') is not None


class ProtocolError(LookupError):
    """The browser refused a call, perhaps because it is between two pages."""


class Browser:
    """A headless browser with one page.

    Attributes:
        problems: Errors and warnings of the page's console, exceptions, refused resources.
        requested: Addresses the page has asked for, those inside it left out.
    """

    def __init__(self, folder: Path) -> None:
        """Start it.

        Args:
            folder: An empty folder for its files.
        """
        self.problems: list[str] = []
        self.requested: list[str] = []
        self._log = (folder / 'browser.log').open('wb')
        path = chromium()
        start = self._start_qt if path is None else self._start_chromium
        self._process, port = start(folder, path or sys.executable)
        try:
            self._socket = _WebSocket(_wait(lambda: _page_address(port), self._explain))
        except BaseException:
            self.close()
            raise
        self._last_id = 0
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def _start_chromium(
        self, folder: Path, path: str
    ) -> tuple[subprocess.Popen[bytes], Callable[[], int]]:
        options = ['--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage']
        options += ['--remote-debugging-port=0', f'--user-data-dir={folder}', '--no-first-run']
        process = subprocess.Popen(
            [path, *options, 'about:blank'], stdout=self._log, stderr=self._log
        )

        def port() -> int:
            return int((folder / 'DevToolsActivePort').read_text().split()[0])

        return process, port

    def _start_qt(
        self, folder: Path, path: str
    ) -> tuple[subprocess.Popen[bytes], Callable[[], int]]:
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            number = probe.getsockname()[1]
        environment = os.environ | {
            'QT_QPA_PLATFORM': 'offscreen',
            'QTWEBENGINE_CHROMIUM_FLAGS': '--disable-gpu --disable-dev-shm-usage',
            'QTWEBENGINE_DISABLE_SANDBOX': '1',
            'QTWEBENGINE_REMOTE_DEBUGGING': f'127.0.0.1:{number}',
            'HOME': str(folder),
        }
        process = subprocess.Popen(
            [path, '-c', _QT], env=environment, stdout=self._log, stderr=self._log
        )
        return process, lambda: number

    def _explain(self) -> str:
        self._log.flush()
        return Path(self._log.name).read_text(errors='replace')[-1000:]

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol, and note the events that come before its answer."""
        self._last_id += 1
        message = {'id': self._last_id, 'method': method, 'params': parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.receive())
            if answer.get('id') == self._last_id:
                if 'error' in answer:
                    raise ProtocolError(f'{method}: {answer["error"]}')
                return answer['result']
            self._note(answer)

    def open(self, path: Path) -> None:
        """Open a file, and wait until its script says that it is ready."""
        self.call('Page.navigate', url=path.as_uri())
        self.wait_for('document.documentElement?.dataset.ready === "true"')

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page."""
        answer = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in answer, answer['exceptionDetails']
        return answer['result'].get('value')

    def wait_for(self, expression: str) -> None:
        """Wait until an expression is true in the page."""

        def check() -> bool:
            if not self.evaluate(expression):
                raise LookupError(expression)
            return True

        _wait(check, lambda: f'{expression} is not true; {self.problems}')

    def press(self, key: str) -> None:
        """Press a key: a character, or a name such as ``ArrowLeft``."""
        codes = {' ': 32, 'End': 35, 'Home': 36, 'ArrowLeft': 37, 'ArrowRight': 39}
        code = codes.get(key) or ord(key)
        text = {'text': key} if len(key) == 1 else {}
        for kind, extra in (('keyDown', text), ('keyUp', {})):
            self.call(
                'Input.dispatchKeyEvent', type=kind, key=key, windowsVirtualKeyCode=code, **extra
            )

    def click(self, selector: str, *, x: float = 0.5, y: float = 0.5) -> None:
        """Click into an element, at shares of its width and height from its upper left."""
        found = json.dumps(selector)
        self.evaluate(f'document.querySelector({found}).scrollIntoView({{block: "center"}})')
        box = self.evaluate(
            f'(() => {{const b = document.querySelector({found}).getBoundingClientRect();'
            'return [b.left, b.top, b.width, b.height]})()'
        )
        place = {'x': box[0] + x * box[2], 'y': box[1] + y * box[3]}
        self.call('Input.dispatchMouseEvent', type='mouseMoved', **place)
        for kind in ('mousePressed', 'mouseReleased'):
            self.call(
                'Input.dispatchMouseEvent', type=kind, button='left', clickCount=1, **place
            )

    def resize(self, width: int, height: int, *, phone: bool = False) -> None:
        """Give the page a size [pixels]."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=phone,
        )

    def screenshot(self, path: Path) -> None:
        """Write what is seen as PNG."""
        data = self.call('Page.captureScreenshot', format='png')['data']
        path.write_bytes(base64.b64decode(data))

    def _note(self, event: dict[str, Any]) -> None:
        details = event.get('params', {})
        if event['method'] == 'Runtime.exceptionThrown':
            self.problems.append(json.dumps(details['exceptionDetails']))
        elif event['method'] == 'Log.entryAdded':
            self.problems.append(details['entry']['text'])
        elif event['method'] == 'Runtime.consoleAPICalled':
            self.problems.append(json.dumps(details['args']))
        elif event['method'] == 'Network.requestWillBeSent':
            url = details['request']['url']
            if not url.startswith(('data:', 'blob:', 'about:')):
                self.requested.append(url)


class _WebSocket:
    """The client's side of a WebSocket, which waits."""

    def __init__(self, address: str) -> None:
        self._loop = IOLoop(make_current=False)
        self._connection = self._run(websocket_connect, address, max_message_size=2**28)

    def send(self, text: str) -> None:
        """Send a text."""
        self._run(self._connection.write_message, text)

    def receive(self) -> str:
        """The next text."""
        return self._run(self._connection.read_message)

    def _run(self, function: Callable[..., Any], *args: Any, **options: Any) -> Any:
        async def call() -> Any:
            return await function(*args, **options)

        return self._loop.run_sync(call, PATIENCE)


def _page_address(port: Callable[[], int]) -> str:
    with urlopen(f'http://127.0.0.1:{port()}/json/list', timeout=PATIENCE) as answer:
        pages = [item for item in json.load(answer) if item['type'] == 'page']
    return pages[0]['webSocketDebuggerUrl']


def _wait(attempt: Callable[[], Any], explain: Callable[[], str]) -> Any:
    """What an attempt gives, once it does not fail for want of something."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            return attempt()
        except (OSError, LookupError) as error:
            if time.monotonic() > until:
                raise TimeoutError(f'{error!r}: {explain()}') from error
        time.sleep(0.05)
