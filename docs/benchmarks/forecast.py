# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What forecasts cost the live simulation, and how soon they are there.

It makes forecast_cpu.csv or, with another device, forecast_cuda.csv:

    python docs/benchmarks/forecast.py cpu 'machine' > docs/benchmarks/forecast_cpu.csv
    python docs/benchmarks/forecast.py cuda:0 'machine' 256 > docs/benchmarks/live_h200.csv

The worker of the node runs a scene, after a clock that it keeps up with and then as fast as it
can, where every forecast has to take from it. Forecasts are made for some seconds and not made for
as many, turn about. Slower is by velocity evaluations a second against the turns before and after,
the median over the turns: other work on the machine comes and goes. Behind is the share of the
clock's time that was lost in all turns together. With a number of members: how often ensembles of
the scene of ``lava forecast-demo`` are renewed, half an hour ahead, while its simulation runs 40
times as fast as real time.
"""

import csv
import sys
import time

import numpy as np

from lava_ros.cli.forecast_demo import LAVA, SPACING, SPEED, UNCERTAINTY, VENT
from lava_ros.ros.ensemble_forecasts import ForecastRules
from lava_ros.ros.forecaster import Forecaster
from lava_ros.ros.worker import SimulationWorker
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.terrain_files import demo_terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.state import EVALUATIONS

#: Turns with forecasts; there is one more without.
TURNS = 10

#: How long a turn is [s].
TURN = 4.0

HORIZON = 600.0

#: How long ensembles are counted [s].
RENEWED = 40.0

#: How long is waited for a forecast after the turns [s].
LONGEST = 100.0

#: Spacing [m] by the kind of device: a state as large as it should be there.
SPACINGS = {'cpu': 10.0, 'cuda': 2.0}


def start(device):
    """The checkpoint that turns begin from: a rough slope on which lava has flowed for an hour."""
    x, y = np.meshgrid(np.arange(300) * 10.0, np.arange(200) * 10.0)
    ground = 2000.0 - 0.2 * x + 6.0 * np.sin(x / 90.0) * np.cos(y / 70.0)
    scene = Scene(Terrain(ground, 10.0), (Vent((200.0, 1000.0), 40.0, radius=20.0),), Lava())
    accuracy = preset_accuracy('standard', spacing=SPACINGS[device.partition(':')[0]])
    simulation = Simulation(scene, accuracy=accuracy, device=device)
    simulation.advance(3600.0)
    return simulation.checkpoint()


def settle(worker, seconds):
    """Let time pass as it does in the node: a snapshot a second."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        worker.request_snapshot()
        time.sleep(min(1.0, max(0.0, end - time.monotonic())))


def seen(worker):
    """Time on the clock, evaluations and simulated time, of the same moment."""
    fork = worker.fork().result()
    evaluations = int(fork.checkpoint.arrays['state.counts'][int(EVALUATIONS)])
    return np.array([fork.clock, evaluations, fork.checkpoint.time])


def measure(checkpoint, device, time_scale, turns):
    """Rates of each turn, [turns, evaluations and simulated seconds a second]; the forecaster."""
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
    worker.go_on_with(
        lambda: Simulation.resume(checkpoint, device=device), checkpoint.scene
    ).result()
    forecaster.start()
    # the process starts, the device gets warm
    forecaster.want(turns > 1)
    settle(worker, 5.0)
    rates = []
    for number in range(turns):
        forecaster.want(number % 2 == 1)
        settle(worker, 0.5)
        before = seen(worker)
        settle(worker, TURN)
        passed = seen(worker) - before
        rates.append(passed[1:] / passed[0])
    forecaster.want(turns > 1)
    end = time.monotonic() + LONGEST
    while turns > 1 and forecaster.latest is None and time.monotonic() < end:
        settle(worker, 1.0)
    forecaster.stop()
    worker.stop()
    return np.array(rates), forecaster


def renewals(device, members):
    """Wall times between complete ensembles [s], and the lost share of the clock's time."""
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
    # the kernels of the first are compiled
    last = time.monotonic() + LONGEST
    while ensembles.status.count < 1 and time.monotonic() < last:
        settle(worker, 0.1)
    before, last = seen(worker), time.monotonic() + RENEWED
    while time.monotonic() < last:
        known = ensembles.status.count
        settle(worker, 0.02)
        ends += [time.monotonic()] * (ensembles.status.count - known)
    passed = seen(worker) - before
    said = ensembles.status.error
    forecaster.stop()
    worker.stop()
    assert not said, said
    return np.diff(ends), 1.0 - passed[2] / passed[0] / SPEED


def main():
    """Print the table."""
    device, machine = sys.argv[1:3]
    table = csv.writer(sys.stdout, lineterminator='\n')
    table.writerow(['benchmark', 'case', 'value', 'unit', 'machine', 'command'])
    command = f"python docs/benchmarks/forecast.py {device} '{machine}'"

    def tell(benchmark, case, value, unit):
        table.writerow([benchmark, case, f'{value:.4g}', unit, machine, command])
        sys.stdout.flush()

    if len(sys.argv) > 3:
        command += f' {sys.argv[3]}'
        gaps, lost = renewals(device, int(sys.argv[3]))
        case = f'{sys.argv[3]} members, half an hour ahead'
        tell('ensembles', case, len(gaps) + 1, '')
        tell('an ensemble after the other, median', case, np.median(gaps), 's')
        tell('an ensemble after the other, longest', case, np.max(gaps), 's')
        tell('behind the clock', case, 100.0 * lost, '%')
        return
    checkpoint = start(device)
    tell('particles', 'start', checkpoint.particle_count, '')
    fastest = measure(checkpoint, device, 1e6, 1)[0][0, 1]
    for case, scale in (('half of its speed', 0.5 * fastest), ('as fast as it can', 1e6)):
        rates, forecaster = measure(checkpoint, device, scale, 2 * TURNS + 1)
        alone, beside = rates[::2], rates[1::2]
        around = 0.5 * (alone[:-1] + alone[1:])
        tell('evaluations alone', case, np.median(alone[:, 0]), '1/s')
        slower = 1.0 - np.median(beside[:, 0] / around[:, 0])
        tell('slower', case, 100.0 * slower, '%')
        if scale < 1e6:
            tell('behind the clock', case, 100.0 * (1.0 - rates[:, 1].mean() / scale), '%')
        tell('share of forecasts', case, forecaster.status.share, '')
        if forecaster.latest is not None:
            tell('wall time of a forecast', case, forecaster.latest.shown.duration, 's')


if __name__ == '__main__':
    main()
