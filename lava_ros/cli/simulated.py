# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs with progress, for the kinds of `lava run`."""

from collections.abc import Iterator
from contextlib import contextmanager
import sys

from lava_ros.cli.console import Progress
from lava_ros.runs.scene_run import Request, SceneRun


@contextmanager
def simulated(request: Request) -> Iterator[SceneRun]:
    """Run to the end with progress, or resume; the block writes what is made of the maps.

    Raises:
        LavaError: If the run cannot start, continue or write its maps.
    """
    with SceneRun(request) as made:
        if made.is_resumed:
            print(f'continuing the interrupted run in {made.folder.path}', file=sys.stderr)
        try:
            with Progress() as progress:
                made.run(progress.sink(request.until))
            yield made
        except KeyboardInterrupt:
            print('lava run: interrupted; the same command continues', file=sys.stderr)
            raise
