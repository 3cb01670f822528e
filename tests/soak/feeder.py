# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What keeps a node busy: vents come and go, in storms too, terrain and subscribers."""

from collections import Counter
import random
import time

from nav_msgs.msg import OccupancyGrid
import numpy as np

from ros import graph_publisher
from ros.graph_publisher import cloud, elevation, image, info, LATCHED

#: Mean times between two of a kind [s].
EVERY = {'vents': 4.0, 'terrain': 20.0, 'subscriber': 2.0, 'bad message': 30.0, 'storm': 45.0,
         'reset': 150.0}

#: Messages of a storm, vents in each, time between two [s], and of how many one is bad.
STORM, VENTS, PAUSE, BAD = 200, (0, 5, 40, 40, 200), 0.005, 10

#: What a vent may be, and what is wrong with a bad one.
LIMITS = {'x': (20.0, 120.0), 'y': (60.0, 240.0), 'z': (0.0, 0.0), 'discharge': (0.5, 20.0),
          'temperature': (1000.0, 1150.0), 'radius': (5.0, 20.0)}
WRONG = ({'discharge': [-1.0]}, {'radius': [float('nan')]}, {'x': [1e9]})

#: Time after a storm in which its last messages are taken [s]: no next one pushes them out.
CALM = 1.0

GRIDS = ('height', 'temperature', 'hazard')


class Feeder(graph_publisher.Publisher):
    """Does one thing after the other to a node; ``done`` is how often each was done."""

    def __init__(self, domain, seed):
        super().__init__(domain)
        self.chance = random.Random(seed)
        self.subscriptions = []
        self.done, self.has_ended = Counter(), False

    def vents(self):
        """Another set of up to five vents, sometimes none."""
        self._publish_vents(self.chance.choice((0, 1, 1, 2, 3, 5)))

    def storm(self):
        """Sets of many vents faster than any can be taken, bad ones among them."""
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
        """The ground with every height changed by up to half a metre."""
        random = np.random.default_rng(self.chance.randrange(10**9))
        ground = elevation() + random.uniform(-0.5, 0.5, elevation().shape)
        self.publishers['terrain_info'].publish(info())
        self.publishers['terrain'].publish(image(ground.astype(np.float32)))

    def subscriber(self):
        """One more subscriber, or one less."""
        if self.subscriptions and self.chance.random() < 0.5:
            leaving = self.subscriptions.pop(self.chance.randrange(len(self.subscriptions)))
            self.node.destroy_subscription(leaving)
        elif len(self.subscriptions) < 8:
            topic = self.chance.choice(GRIDS)
            more = self.node.create_subscription(OccupancyGrid, topic, self._hear, LATCHED)
            self.subscriptions.append(more)

    def bad_message(self):
        """Something that the node has to refuse."""
        self.publishers['vents'].publish(b'\0\1\0\0' + self.chance.randbytes(40))

    def reset(self):
        """The scene again from time 0."""
        self.call('reset')

    def _hear(self, _):
        self.done['heard by those who come and go'] += 1

    def run(self, seconds):
        """Go on for so long."""
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
