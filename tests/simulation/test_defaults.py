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

"""How Warp starts."""

from contextlib import nullcontext
import logging
import os

import pytest
import warp as wp

from lava_ros.simulation import defaults as automatic


@pytest.mark.parametrize('fails', [False, True])
def test_what_warp_writes_is_logged(
    fails: bool,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Its library writes to stderr, why it fails too; what others write there stays there."""

    def start() -> None:
        os.write(2, b'Warp CUDA warning: no driver\n[INFO] [lava]: of another thread\n')
        if fails:
            raise RuntimeError('Warp did not start')

    monkeypatch.setattr(wp, 'init', start)
    expected = pytest.raises(RuntimeError) if fails else nullcontext()
    with caplog.at_level(logging.INFO, logger='lava_ros'), expected:
        automatic._start_warp.__wrapped__()
    assert caplog.messages == ['Warp CUDA warning: no driver']
    assert capfd.readouterr().err == '[INFO] [lava]: of another thread\n'
