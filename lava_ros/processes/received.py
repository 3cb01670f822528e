# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The child's end of its connection to the parent: a thread that receives, or ends the child."""

from collections.abc import Callable
import os
from queue import SimpleQueue
import threading
import traceback
from typing import TypeVar

ItemT = TypeVar('ItemT')


def receive_in_thread(receive: Callable[[], ItemT], items: 'SimpleQueue[ItemT]') -> None:
    """Receive the parent's requests in a thread, and put them into a queue.

    This process ends when the parent has closed the connection, even in the middle of its work.

    Args:
        receive: Returns the next item, and raises EOFError or OSError without a parent.
        items: The queue.
    """

    def run() -> None:
        try:
            while True:
                items.put(receive())
        except (EOFError, OSError):
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)

    threading.Thread(target=run, daemon=True).start()
