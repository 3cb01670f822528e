# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost of forecasts for the live simulation, and their wall time.

The output is live_h200.csv; the number of members is optional:

    python docs/benchmarks/forecast.py cuda:0 'machine' 256 > docs/benchmarks/live_h200.csv

The worker of the node runs a scene, first with a clock that it can follow and then at full speed,
where each forecast slows it down. Periods of some seconds with and without forecasts alternate,
because other work on the machine varies. 'Slower' compares the velocity evaluations per second of
a period with those of the periods before and after it (median). 'Behind' is the lost fraction of
the clock's time in all periods. With a number of members, the script measures how often ensembles
of ``examples/narrow_forecast.py`` are renewed, with a horizon of half an hour, at 40 times real
time.
"""

import csv
from pathlib import Path
import sys
import time

import numpy as np

from lava_ros.live.ensemble_forecasts import ForecastRules
from lava_ros.live.forecaster import Forecaster
from lava_ros.live.worker import SimulationWorker
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.terrain_files import demo_terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.particles.layout import EVALUATIONS
from lava_ros.simulation.presets import preset_accuracy

sys.path.append(str(Path(__file__).parents[2] / 'examples'))
from narrow_forecast import LAVA, SPACING, SPEED, UNCERTAINTY, VENT

#: Number of periods with forecasts; there is one more without.
N_PERIODS = 10

#: Duration of a period [s].
PERIOD = 4.0

HORIZON = 600.0

#: Duration of counting ensembles [s].
COUNTING_TIME = 40.0

#: Timeout of a forecast after the periods [s].
TIMEOUT = 100.0

#: Spacing [m] by the kind of device, for a suitable number of particles.
SPACINGS = {'cpu': 10.0, 'cuda': 2.0}


def start(device):
    """Return the checkpoint at the start of periods: one hour of lava on a rough slope."""
    x, y = np.meshgrid(np.arange(300) * 10.0, np.arange(200) * 10.0)
    ground = 2000.0 - 0.2 * x + 6.0 * np.sin(x / 90.0) * np.cos(y / 70.0)
    scene = Scene(Terrain(ground, 10.0), (Vent((200.0, 1000.0), 40.0, radius=20.0),), Lava.paper())
    accuracy = preset_accuracy('standard', spacing=SPACINGS[device.partition(':')[0]])
    simulation = Simulation(scene, accuracy=accuracy, device=device)
    simulation.advance(3600.0)
    return simulation.checkpoint()


def settle(worker, seconds):
    """Request a snapshot per second for a time, like the node."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        worker.request_snapshot()
        time.sleep(min(1.0, max(0.0, end - time.monotonic())))


def counters(worker):
    """Return time on the clock, evaluations and simulated time at about the same moment."""
    checkpoint, now = worker.fork().result().checkpoint, time.monotonic()
    evaluations = int(checkpoint.arrays['state.counts'][int(EVALUATIONS)])
    return np.array([now, evaluations, checkpoint.time])


def measure(checkpoint, device, time_scale, periods):
    """Return evaluations and simulated seconds per second of each period, and the forecaster."""
    worker = SimulationWorker(
        lambda scene: Simulation(scene, device=device),
        clock=time.monotonic,
        time_scale=time_scale,
    )
    rules = ForecastRules(
        horizon=HORIZON, threshold=0.01, max_age=1e9, share=1.0, max_particles=10**8
    )
    forecaster = Forecaster(worker, lambda: rules)
    worker.start()
    worker.resume_with(
        lambda: Simulation.resume(checkpoint, device=device), checkpoint.scene
    ).result()
    forecaster.start()
    # starts the process and warms up the device
    forecaster.want(periods > 1)
    settle(worker, 5.0)
    rates = []
    for number in range(periods):
        forecaster.want(number % 2 == 1)
        settle(worker, 0.5)
        before = counters(worker)
        settle(worker, PERIOD)
        passed = counters(worker) - before
        rates.append(passed[1:] / passed[0])
    forecaster.want(periods > 1)
    end = time.monotonic() + TIMEOUT
    while periods > 1 and forecaster.latest is None and time.monotonic() < end:
        settle(worker, 1.0)
    forecaster.stop()
    worker.stop()
    return np.array(rates), forecaster


def renewals(device, members):
    """Return wall times between complete ensembles [s], and the lost fraction of the clock."""
    scene = Scene(demo_terrain(), (VENT,), LAVA, uncertainty=UNCERTAINTY)
    accuracy = preset_accuracy('draft', spacing=SPACING)
    worker = SimulationWorker(
        lambda scene: Simulation(scene, accuracy=accuracy, device=device),
        clock=time.monotonic,
        time_scale=SPEED,
    )
    rules = ForecastRules(
        horizon=1800.0, threshold=0.1, max_age=1e9, share=1.0, max_particles=10**8,
        members=members, time_scale=SPEED,
    )
    forecaster = Forecaster(worker, lambda: rules)
    worker.start()
    worker.set_scene(scene).result()
    forecaster.start()
    forecaster.want(True)
    ensembles, ends = forecaster.ensembles, []
    # the first ensemble compiles the kernels
    last = time.monotonic() + TIMEOUT
    while ensembles.status.count < 1 and time.monotonic() < last:
        settle(worker, 0.1)
    before, last = counters(worker), time.monotonic() + COUNTING_TIME
    while time.monotonic() < last:
        known = ensembles.status.count
        settle(worker, 0.02)
        ends += [time.monotonic()] * (ensembles.status.count - known)
    passed = counters(worker) - before
    error = ensembles.status.error
    forecaster.stop()
    worker.stop()
    assert not error, error
    return np.diff(ends), 1.0 - passed[2] / passed[0] / SPEED


def main():
    """Print the table."""
    device, machine = sys.argv[1:3]
    table = csv.writer(sys.stdout, lineterminator='\n')
    table.writerow(['benchmark', 'case', 'value', 'unit', 'machine', 'command'])
    command = f"python docs/benchmarks/forecast.py {device} '{machine}'"

    def write(benchmark, case, value, unit):
        table.writerow([benchmark, case, f'{value:.4g}', unit, machine, command])
        sys.stdout.flush()

    if len(sys.argv) > 3:
        command += f' {sys.argv[3]}'
        gaps, lost = renewals(device, int(sys.argv[3]))
        case = f'{sys.argv[3]} members, half an hour ahead'
        write('ensembles', case, len(gaps) + 1, '')
        write('an ensemble after the other, median', case, np.median(gaps), 's')
        write('an ensemble after the other, longest', case, np.max(gaps), 's')
        write('behind the clock', case, 100.0 * lost, '%')
        return
    checkpoint = start(device)
    write('particles', 'start', checkpoint.particle_count, '')
    fastest = measure(checkpoint, device, 1e6, 1)[0][0, 1]
    for case, scale in (('half of its speed', 0.5 * fastest), ('as fast as it can', 1e6)):
        rates, forecaster = measure(checkpoint, device, scale, 2 * N_PERIODS + 1)
        alone, busy = rates[::2], rates[1::2]
        around = 0.5 * (alone[:-1] + alone[1:])
        write('evaluations alone', case, np.median(alone[:, 0]), '1/s')
        slower = 1.0 - np.median(busy[:, 0] / around[:, 0])
        write('slower', case, 100.0 * slower, '%')
        if scale < 1e6:
            write('behind the clock', case, 100.0 * (1.0 - rates[:, 1].mean() / scale), '%')
        write('share of forecasts', case, forecaster.status.share, '')
        if forecaster.latest is not None:
            write('wall time of a forecast', case, forecaster.latest.duration, 's')


if __name__ == '__main__':
    main()
