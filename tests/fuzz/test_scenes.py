# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Random valid scenes keep the invariants of every flow."""

from dataclasses import replace

from hypothesis import note, settings
import pytest

from fuzz.limits import bounded
from fuzz.scenes import extreme_scenes, MAX_PARTICLES, Trial, trials
from hard.invariants import Watch
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.simulation import Simulation

#: Maximum readings of the clock in a scene, in a test run and in a night: about four a time step.
PATIENCE = {True: 3000, False: 75_000}

#: Maximum readings of the clock in a part of an extreme scene.
BRIEF = 400

#: Number of times at which the invariants are checked.
FRAMES = 6


class Readings:
    """A clock that counts its readings, so that a wall limit ends a run at the same step always.

    It stands for the module ``time`` in the solvers, which read it before each launch.
    """

    def __init__(self) -> None:
        self._count = 0

    def monotonic(self) -> float:
        self._count += 1
        return float(self._count)

    perf_counter = monotonic


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Readings:
    """Let wall limits be numbers of readings."""
    readings = Readings()
    for module in ('simulation', 'particles.solver', 'cells.solver'):
        monkeypatch.setattr(f'lava_ros.simulation.{module}.wall_clock', readings)
    return readings


def looks(trial: Trial) -> int:
    """Return the number of times in a frame at which the lava at the vents is observed.

    Lateral stress holds lava up: its level is highest just after a particle was emitted.
    """
    is_held = trial.effects.green or trial.effects.helmholtz
    return MAX_PARTICLES // FRAMES if is_held else 1


def play(trial: Trial, device: str, clock: Readings, patience: int) -> bool:
    """Simulate a trial under watch; return True if it reached its end."""
    simulation = Simulation(
        trial.scene, effects=trial.effects, accuracy=trial.accuracy, device=device
    )
    watch = Watch(simulation)
    end = clock.monotonic() + patience
    for frame in range(1, FRAMES + 1):
        if frame == FRAMES // 2 and trial.vents is not None:
            simulation.set_vents(trial.vents)
            watch.renew()
        if frame == 2 * FRAMES // 3 and trial.terrain is not None:
            simulation.set_terrain(trial.terrain)
            watch.renew()
        count = looks(trial)
        for part in range(1 - count, 1):
            moment = trial.until * (frame + part / count) / FRAMES
            left = end - clock.monotonic()
            if left <= 0.0 or simulation.advance(moment, wall_limit=left) < moment:
                return False
            if part:
                watch.look()
        watch.check()
    return True


def test_random_scenes_keep_the_invariants(in_part, device, trial, clock):
    is_ci = settings().derandomize

    def keeps_the_invariants(scene):
        note(repr(scene))
        with trial('scenes') as row:
            is_whole = play(scene, device, clock, PATIENCE[is_ci])
            row['cut_off'] = row.get('cut_off', 0) + (not is_whole)

    # scenes take up to 10 s
    tried = settings(max_examples=10) if is_ci else settings()
    in_part(keeps_the_invariants, tried, scene=trials(all_effects=not is_ci))


def test_extreme_scenes_run_or_are_refused(in_part):
    """No error of Warp reaches the user, from whichever method."""

    def runs_or_is_refused(case):
        note(repr(case))
        scene, accuracy, horizon = case
        try:
            with bounded():
                simulation = Simulation(
                    scene, effects=Effects(), accuracy=accuracy, device='cpu', horizon=horizon
                )
                simulation.advance(horizon, wall_limit=BRIEF)
                simulation.snapshot()
                first, *_ = scene.vents
                simulation.set_vents([replace(first, discharge=1.0)])
                simulation.advance(simulation.time + 1.0, wall_limit=BRIEF)
                lower = replace(scene.terrain, elevation=0.9 * scene.terrain.elevation)
                simulation.set_terrain(lower)
                simulation = Simulation.resume(simulation.checkpoint(), device='cpu')
                simulation.advance(simulation.time + 1.0, wall_limit=BRIEF)
        except LavaError as error:
            assert error.field

    tried = settings(max_examples=10) if settings().derandomize else settings()
    in_part(runs_or_is_refused, tried, case=extreme_scenes())
