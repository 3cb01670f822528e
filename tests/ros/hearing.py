# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions that wait for messages of nodes."""

from abc import ABC, abstractmethod
import time

from waiting import PATIENCE

#: A value that the status of a task has as soon as there are results.
RESULTS = {
    'simulation': 'simulated_time_s', 'forecast': 'start_time_s', 'ensemble': 'start_time_s',
}


class Hearing(ABC):
    """Waits for messages that are described as ``graph_listener`` does.

    Attributes:
        seen: All messages read so far.
    """

    seen: list

    @abstractmethod
    def next(self, timeout):
        """Return the next message; raise AssertionError if none arrives in time [s]."""

    @abstractmethod
    def hear(self):
        """Read all messages received so far, and return their total number."""

    def wait(self, condition, timeout=PATIENCE):
        """Read messages until one fulfils a condition, and return it."""
        end = time.monotonic() + timeout
        while True:
            try:
                message = self.next(end - time.monotonic())
            except AssertionError as error:
                what = f'nothing in {timeout} s fulfilled the condition; last: {self.seen[-3:]}'
                raise AssertionError(what) from error
            self.seen.append(message)
            if condition(message):
                return message

    def wait_for_topic(self, topic, condition=lambda _: True, timeout=PATIENCE):
        """Read messages until one of a topic fulfils a condition."""
        return self.wait(lambda message: message['topic'] == topic and condition(message), timeout)

    def wait_for_status(
        self, task, condition=lambda _: True, timeout=PATIENCE, node='lava', since_ns=0
    ):
        """Read diagnostics until a task's status fulfils a condition, and return that status.

        A status without results yet may lack a value that the condition reads; a complete one
        that lacks it is an error of the test.
        """
        name = f'{node}: {task}'

        def is_fulfilled(status):
            try:
                return condition(status)
            except KeyError as error:
                mark = RESULTS.get(task)
                is_complete = mark in status if mark else len(status) > len(('level', 'message'))
                assert not is_complete, f'{name} has no value {error}: {status}'
                return False

        message = self.wait_for_topic(
            'diagnostics',
            lambda item: (
                item['stamp_ns'] >= since_ns
                and name in item['status']
                and is_fulfilled(item['status'][name])
            ),
            timeout,
        )
        return message['status'][name]

    def status_now(self, task, condition=lambda _: True, node='lava'):
        """Do as ``wait_for_status``, but skip diagnostics that were published before this call."""
        return self.wait_for_status(task, condition, node=node, since_ns=time.time_ns())

    def newest(self, *topics, condition=lambda _: True):
        """Return the newest message of each topic once all have arrived, in any order."""

        def is_there(_=None):
            found.update({item['topic']: item for item in self.seen if item['topic'] in topics})
            return len(found) == len(topics) and condition(found)

        found = {}
        self.hear()
        if not is_there():
            self.wait(is_there)
        return found

    def at_rest(self, *topics):
        """Return as ``newest``, once time stands still and diagnostics report these messages."""

        def is_last(newest):
            status = newest['diagnostics']['status']['lava: simulation']
            stamp = int(status.get('frame_stamp_ns', 0))
            is_whole = all(newest[topic]['stamp_ns'] == stamp for topic in topics)
            return is_whole and status['state'] != 'running'

        found = self.newest(*topics, 'diagnostics', condition=is_last)
        return {topic: found[topic] for topic in topics}
