# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fake cases, and rows of measurements."""

import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases import Measurement, Run
from lava_ros.verification.measure import measure, Setting
from lava_ros.verification.rows import Row


class FakeCase:
    """A case whose error falls and whose time grows with the refinement."""

    def __init__(self, name='fake', time=0.01):
        self.name, self.title, self.source = name, f'The {name} case', 'nowhere'
        self.time = time
        self.accuracies = []

    def run(self, accuracy, device):
        self.accuracies.append(accuracy)
        scale = accuracy.refinement * accuracy.ratio
        measurements = tuple(
            Measurement(name, error / scale, 0.0, 'm', scale=1.0)
            for name, error in (('radius', 1e-3), ('profile', 1e-2))
        )
        wall_time = self.time * scale + 1e-4 * len(self.accuracies)
        return Run(self.name, measurements, 100, 3, 9, 1800.0, wall_time)


@pytest.fixture
def fake_case():
    """Return the class of fake cases, made of a name and the time of a run at a scale of 1 [s]."""
    return FakeCase


@pytest.fixture
def measured():
    """Return a function that measures cases at settings, by default at three refinements."""

    def rows(cases, settings=None, **options):
        settings = settings or [
            Setting(f'refinement {n:g}', Accuracy(refinement=n)) for n in (0.5, 1.0, 2.0)
        ]
        pairs = [(case, item) for case in cases for item in settings]
        found = measure(pairs, device='cpu', command='lava check accuracy', **options)
        return [row for group in found for row in group]

    return rows


@pytest.fixture
def row():
    """Return a function that makes a row of a fixed volume, with the given changes."""

    def make(**changes):
        usual = {
            'case': 'fixed_volume', 'setting': 'a', 'preset': '', 'quantity': 'radius',
            'error': 0.01, 'measured': 1.0, 'exact': 1.0, 'unit': 'm', 'particles': 8000,
            'steps': 10, 'evaluations': 100, 'simulated_s': 360.0, 'wall_s': 1.0,
            'wall_s_per_simulated_hour': 10.0, 'device': 'cpu', 'machine': 'a machine',
            'command': 'lava check accuracy', 'repetitions': 1, 'low': 1.0, 'high': 1.0,
        }
        return Row(**{**usual, **changes})

    return make
