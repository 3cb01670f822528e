# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Load for a node: changing vents, also in storms, terrain, subscribers and bad messages."""

from collections import Counter
import random
import time

from nav_msgs.msg import OccupancyGrid
import numpy as np

from ros import graph_publisher
from ros.graph_publisher import cloud, elevation, image, info, LATCHED

#: Mean interval between two actions of a kind [s].
EVERY = {'vents': 4.0, 'terrain': 20.0, 'subscriber': 2.0, 'bad message': 30.0, 'storm': 45.0,
         'reset': 150.0}

#: Messages in a storm, vents per message, interval [s], and number of messages per bad one.
STORM, VENTS, PAUSE, BAD = 200, (0, 5, 40, 40, 200), 0.005, 10

#: Limits of the values of a vent, and values of bad vents.
LIMITS = {'x': (20.0, 120.0), 'y': (60.0, 240.0), 'z': (0.0, 0.0), 'discharge': (0.5, 20.0),
          'temperature': (1000.0, 1150.0), 'radius': (5.0, 20.0)}
WRONG = ({'discharge': [-1.0]}, {'radius': [float('nan')]}, {'x': [1e9]})

#: Time after a storm for its last messages to be received before the next ones replace them [s].
CALM = 1.0

GRIDS = ('height', 'temperature', 'hazard')


class Feeder(graph_publisher.Publisher):
    """Acts on a node in random order; ``done`` counts the actions by name."""

    def __init__(self, domain, seed):
        super().__init__(domain)
        self.chance = random.Random(seed)
        self.subscriptions = []
        self.done, self.has_ended = Counter(), False

    def vents(self):
        """Publish a new set of up to five vents, sometimes none."""
        self._publish_vents(self.chance.choice((0, 1, 1, 2, 3, 5)))

    def storm(self):
        """Publish sets of many vents faster than the node can use them, including bad ones."""
        for number in range(STORM):
            if number % BAD:
                self._publish_vents(self.chance.choice(VENTS))
            else:
                self._publish_vents(1, **self.chance.choice(WRONG))
                self.done['bad in storms'] += 1
            time.sleep(PAUSE)
        self.vents()
        time.sleep(CALM)

    def _publish_vents(self, count, **changes):
        columns = {
            name: [self.chance.uniform(*limits) for _ in range(count)]
            for name, limits in LIMITS.items()
        }
        self.publishers['vents'].publish(cloud({**columns, **changes}))

    def terrain(self):
        """Publish the terrain with each elevation changed by up to half a metre."""
        random = np.random.default_rng(self.chance.randrange(10**9))
        ground = elevation() + random.uniform(-0.5, 0.5, elevation().shape)
        self.publishers['terrain_info'].publish(info())
        self.publishers['terrain'].publish(image(ground.astype(np.float32)))

    def subscriber(self):
        """Add or remove a subscriber."""
        if self.subscriptions and self.chance.random() < 0.5:
            leaving = self.subscriptions.pop(self.chance.randrange(len(self.subscriptions)))
            self.node.destroy_subscription(leaving)
        elif len(self.subscriptions) < 8:
            topic = self.chance.choice(GRIDS)
            more = self.node.create_subscription(OccupancyGrid, topic, self._count, LATCHED)
            self.subscriptions.append(more)

    def bad_message(self):
        """Publish a message that the node must refuse."""
        self.publishers['vents'].publish(b'\0\1\0\0' + self.chance.randbytes(40))

    def reset(self):
        """Restart the scene at time 0."""
        self.call('reset')

    def _count(self, _):
        self.done['received by temporary subscribers'] += 1

    def run(self, seconds):
        """Run for a time [s]."""
        end = time.monotonic() + seconds
        due = {name: time.monotonic() for name in EVERY}
        due['reset'] += EVERY['reset']
        due['bad message'] += EVERY['bad message']
        due['storm'] += 0.2 * EVERY['storm']
        while (now := time.monotonic()) < end:
            self._executor.spin_once(timeout_sec=0.05)
            for name, moment in due.items():
                if now >= moment:
                    getattr(self, name.replace(' ', '_'))()
                    self.done[name] += 1
                    due[name] = now + EVERY[name] * self.chance.uniform(0.5, 1.5)
        self.has_ended = True
