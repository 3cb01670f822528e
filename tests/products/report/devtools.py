# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A real browser for tests, controlled by the DevTools protocol."""

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

#: Names of Chromium, used without a path in the environment variable CHROME.
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')

#: Timeout of each action on a busy machine [s].
TIMEOUT = 60.0

# Chromium in Qt's WebEngine, which is available as a wheel.
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
    """Return the path of an installed Chromium, None without one."""
    return os.environ.get('CHROME') or next(filter(None, map(shutil.which, NAMES)), None)


def _has_qt() -> bool:
    if importlib.util.find_spec('PySide6') is None:
        return False
    return importlib.util.find_spec('PySide6.QtWebEngineWidgets') is not None


#: Mark of tests that use a browser.
needs_browser = pytest.mark.skipif(
    chromium() is None and not _has_qt(),
    reason='needs Chromium (apt install chromium, or CHROME) or Qt (make look)',
)


class ProtocolError(LookupError):
    """A call that the browser rejected, for example between two pages."""


class Browser:
    """A headless browser with one page.

    Attributes:
        problems: Errors and warnings in the page's console, exceptions, blocked resources.
        requested: Addresses that the page has requested, without those inside it.
    """

    def __init__(self, folder: Path) -> None:
        """Start the browser with an empty folder for its files."""
        self.problems: list[str] = []
        self.requested: list[str] = []
        self._log = (folder / 'browser.log').open('wb')
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            port = probe.getsockname()[1]
        # pages in 3-D are drawn without a GPU
        path, flags = chromium(), ['--use-angle=swiftshader', '--enable-unsafe-swiftshader']
        flags.append('--disable-dev-shm-usage')
        words, environment = [sys.executable, '-c', _QT], {
            'QT_QPA_PLATFORM': 'offscreen',
            'QTWEBENGINE_CHROMIUM_FLAGS': ' '.join(flags),
            'QTWEBENGINE_DISABLE_SANDBOX': '1',
            'QTWEBENGINE_REMOTE_DEBUGGING': f'127.0.0.1:{port}',
            'HOME': str(folder),
        }
        if path is not None:
            words, environment = [path, '--headless', '--no-sandbox', '--no-first-run', *flags], {}
            words += [f'--remote-debugging-port={port}', f'--user-data-dir={folder}']
        self._process = subprocess.Popen(
            [*words, 'about:blank'], env=os.environ | environment,
            stdout=self._log, stderr=self._log,
        )
        try:
            self._loop = IOLoop(make_current=False)
            address = _wait(lambda: _page_address(port), self._explain)
            self._socket = self._run(websocket_connect, address, max_message_size=2**28)
        except BaseException:
            self.close()
            raise
        self._last_id = 0
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def _run(self, function: Callable[..., Any], *args: Any, **options: Any) -> Any:
        async def call() -> Any:
            return await function(*args, **options)

        return self._loop.run_sync(call, TIMEOUT)

    def _explain(self) -> str:
        self._log.flush()
        return Path(self._log.name).read_text(errors='replace')[-1000:]

    def close(self) -> None:
        """Stop the browser."""
        self._process.terminate()
        try:
            self._process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol, and record the events before its answer."""
        self._last_id += 1
        message = {'id': self._last_id, 'method': method, 'params': parameters}
        self._run(self._socket.write_message, json.dumps(message))
        while True:
            answer = json.loads(self._run(self._socket.read_message))
            if answer.get('id') == self._last_id:
                if 'error' in answer:
                    raise ProtocolError(f'{method}: {answer["error"]}')
                return answer['result']
            self._note(answer)

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
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

    def resize(self, width: int, height: int, *, phone: bool = False) -> None:
        """Set the size of the page [pixels]."""
        size = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': phone}
        self.call('Emulation.setDeviceMetricsOverride', **size)

    def screenshot(self, path: Path) -> None:
        """Write a picture of the page as PNG."""
        data = self.call('Page.captureScreenshot', format='png')['data']
        path.write_bytes(base64.b64decode(data))

    def _note(self, event: dict[str, Any]) -> None:
        details = event.get('params', {})
        problems = {
            'Runtime.exceptionThrown': 'exceptionDetails', 'Runtime.consoleAPICalled': 'args',
        }
        if event['method'] in problems:
            self.problems.append(json.dumps(details[problems[event['method']]]))
        elif event['method'] == 'Log.entryAdded':
            self.problems.append(details['entry']['text'])
        elif event['method'] == 'Network.requestWillBeSent':
            url = details['request']['url']
            if not url.startswith(('data:', 'blob:', 'about:')):
                self.requested.append(url)


def _page_address(port: int) -> str:
    with urlopen(f'http://127.0.0.1:{port}/json/list', timeout=TIMEOUT) as answer:
        pages = [item for item in json.load(answer) if item['type'] == 'page']
    return pages[0]['webSocketDebuggerUrl']


def _wait(attempt: Callable[[], Any], explain: Callable[[], str]) -> Any:
    """Repeat an attempt until it succeeds, and return its result."""
    until = time.monotonic() + TIMEOUT
    while True:
        try:
            return attempt()
        except (OSError, LookupError) as error:
            if time.monotonic() > until:
                raise TimeoutError(f'{error!r}: {explain()}') from error
        time.sleep(0.05)
