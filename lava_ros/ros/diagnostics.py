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

"""What the node says about itself on /diagnostics."""

from collections import Counter
from collections.abc import Mapping
from socket import gethostname
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np

from lava_ros.errors import LavaError
from lava_ros.ros.deadline import DeadlineChoice
from lava_ros.ros.ensemble_forecasts import AheadStatus, Live
from lava_ros.ros.recorder import RecorderStatus
from lava_ros.ros.recording import LastCheckpoint
from lava_ros.ros.session import is_on
from lava_ros.ros.worker_status import WorkerState, WorkerStatus
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.resolution import Resolution
from lava_ros.simulation.snapshot import Snapshot

#: Time after which an unchanged error of a topic is logged again [s].
LOG_INTERVAL = 60.0

#: Levels of a status.
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

#: Levels of states of the worker, where they are not OK.
_LEVELS = {WorkerState.WAITING: WARN, WorkerState.FAILED: ERROR}


class InputLog:
    """Counts what was taken and refused, by topic. Any thread may report."""

    def __init__(self) -> None:
        """Start with nothing."""
        self._lock = threading.Lock()
        self._accepted: Counter[str] = Counter()
        self._rejected: Counter[str] = Counter()
        self._superseded = 0
        self._arrived = 0
        # number of a topic's newest message that was judged, and whether it was refused
        self._newest: dict[str, tuple[int, bool]] = {}
        self._last_error = ''
        self._logged: dict[str, tuple[str, float]] = {}

    def arrive(self) -> int:
        """Number a message whose judgement may come after that of a newer one."""
        with self._lock:
            self._arrived += 1
            return self._arrived

    def accept(self, topic: str, number: int | None = None) -> None:
        """Note a message that was taken; the newest, or that of a number."""
        with self._lock:
            self._accepted[topic] += 1
            self._judge(topic, number, is_bad=False)
            self._logged.pop(topic, None)

    def supersede(self, topic: str, number: int | None = None) -> None:
        """Note a sound message that a newer one replaced before the simulation took it.

        The newer one may have come on another topic: both clouds and images are terrain.
        """
        with self._lock:
            self._superseded += 1
            self._judge(topic, number, is_bad=False)

    def forgive(self, topic: str) -> None:
        """Leave it at a warning: nothing better can be expected on the topic to end an error."""
        with self._lock:
            self._newest[topic] = self._newest[topic][0], False

    def reject(self, topic: str, error: LavaError, number: int | None = None) -> bool:
        """Note a message that was refused, the newest or that of a number, and whether to log it.

        What was just said about the topic is not logged again.
        """
        with self._lock:
            self._rejected[topic] += 1
            self._judge(topic, number, is_bad=True)
            self._last_error = f'{topic}: {error}'
            now, text = time.monotonic(), str(error)
            last_text, last_time = self._logged.get(topic, ('', 0.0))
            if text == last_text and now - last_time < LOG_INTERVAL:
                return False
            self._logged[topic] = (text, now)
            return True

    def _judge(self, topic: str, number: int | None, *, is_bad: bool) -> None:
        if number is None:
            self._arrived += 1
            number = self._arrived
        if number >= self._newest.get(topic, (0, False))[0]:
            self._newest[topic] = number, is_bad

    def status(self) -> DiagnosticStatus:
        """ERROR while a topic's newest message was refused, WARN when an earlier one was."""
        with self._lock:
            rejected = sum(self._rejected.values())
            is_bad = any(newest_is_bad for _, newest_is_bad in self._newest.values())
            values: dict[str, object] = {
                'accepted': sum(self._accepted.values()),
                'rejected': rejected,
                'superseded': self._superseded,
                'last_error': self._last_error,
            }
            values |= {f'rejected.{topic}': count for topic, count in self._rejected.items()}
            last_error = self._last_error
        if is_bad:
            return status('inputs', ERROR, f'refused {last_error}', values)
        if rejected:
            return status('inputs', WARN, f'{rejected} refused so far', values)
        return status('inputs', OK, 'all taken', values)


def simulation_status(
    worker: WorkerStatus,
    snapshot: Snapshot | None,
    *,
    is_active: bool,
    frame_stamp_ns: int,
    resolution: Resolution | None = None,
    clock: str = '',
) -> DiagnosticStatus:
    """The status of the simulation.

    ``snapshot`` was published last, with maps of the stamp ``frame_stamp_ns`` [ns]; ``resolution``
    says how well particles resolve the flow, and ``clock`` what is wrong with the clock.
    """
    level, message = _LEVELS.get(worker.state, OK), worker.state.value
    is_running = worker.state is WorkerState.RUNNING
    warnings = snapshot.budget.warnings() if snapshot is not None else []
    # what starts says so itself
    warnings += [clock, worker.hold_up if worker.state is not WorkerState.STARTING else '']
    warnings.append('running slower than the clock asks for' if worker.is_behind else '')
    if is_running and resolution is not None and resolution.is_coarse:
        warnings.append(resolution.text())
    if worker.error:
        message = f'{message}: {worker.error}'
    elif any(warnings):
        is_lost = snapshot is not None and not snapshot.budget.is_conserved
        level = ERROR if is_lost else WARN
        message = '; '.join(filter(None, warnings))
    values: dict[str, object] = {
        'state': worker.state.value,
        'lifecycle': 'active' if is_active else 'inactive',
        'device': worker.device,
        'speed': f'{worker.speed:.4g}',
        'mean_speed': f'{worker.mean_speed:.4g}',
    }
    if resolution is not None:
        values |= {
            'spacing_m': f'{resolution.spacing:.4g}',
            'flow_width_m': f'{resolution.width:.4g}',
            'particles_across': f'{resolution.across:.3g}',
            'footprint_error': f'{resolution.error:.2g}',
        }
    if snapshot is not None:
        values |= snapshot_values(snapshot, frame_stamp_ns)
        values['wet_cells'] = int((snapshot.thickness >= COVERED).sum())
    if not is_active:
        message = f'inactive: {message}'
    return status('simulation', level, message, values)


def snapshot_values(snapshot: Snapshot, stamp_ns: int) -> dict[str, object]:
    """The values of a status for a snapshot; ``stamp_ns`` is the stamp of its maps [ns]."""
    steps = snapshot.steps
    return {
        'simulated_time_s': repr(snapshot.time),
        'frame_stamp_ns': stamp_ns,
        'particles': snapshot.particle_count,
        **snapshot.budget.texts(),
        'steps': steps.count,
        'step_s': f'{steps.length:.6g}',
        'step_limit': steps.limit,
        'step_stages': steps.stages,
    }


def effects_status(effects: Mapping[str, str]) -> DiagnosticStatus:
    """The status of the effects: which are on, and why each is on or off."""
    names = ', '.join(name for name, text in effects.items() if is_on(text)) or 'none'
    message = f'on: {names}' if effects else 'not chosen yet'
    return status('effects', OK, message, effects)


def ahead_status(
    task: str, state: AheadStatus, latest: Live[Any] | None, *, age: float, staleness: str
) -> DiagnosticStatus:
    """The status of the tasks ``forecast`` or ``ensemble``, of which ``latest`` is the newest.

    ``age`` is its age [s], ``staleness`` why it is stale, empty if it is not.
    """
    is_ensemble = task == 'ensemble'
    values: dict[str, object] = {
        f'{task}s': state.count,
        'progress': '' if state.progress is None else f'{state.progress:.2f}',
    }
    if is_ensemble:
        values['outlines'] = state.outlines
    else:
        values['share'] = f'{state.share:.2g}'
    if state.jaccard_mean is not None:
        values['jaccard_mean'] = f'{state.jaccard_mean:.3f}'
    message = 'up to date'
    if latest is not None:
        values |= {
            'start_time_s': repr(latest.shown.time),
            'horizon_s': repr(latest.shown.horizon),
            'duration_s': f'{latest.shown.duration:.3g}',
            'age_s': f'{age:.6g}',
            'is_stale': str(bool(staleness)).lower(),
            'frame_stamp_ns': latest.stamp_ns,
        }
    if latest is not None and not is_ensemble:
        values['particles'] = latest.shown.particle_count
        values['cells_reached'] = int(np.isfinite(latest.shown.arrival).sum())
    elif latest is not None:
        ensemble, maps = latest.shown, latest.shown.maps
        values |= {
            'members': maps.members,
            'members_asked': ensemble.asked,
            'members_effective': f'{maps.effective_members:.1f}',
            'sampling_error_percent': f'{maps.sampling_error:.1f}',
            'arrival_error_s': f'{maps.arrival_error:.6g}',
            'members_beyond': maps.members_beyond,
        }
        message = f'{maps.members} of {ensemble.asked} members'
        if not ensemble.is_done:
            message += ' so far'
        elif maps.members < ensemble.asked:
            message += ': the others were left out to meet the deadline'
    if state.error:
        return status(task, ERROR, state.error, values)
    if latest is None:
        return status(task, OK, staleness, values)
    if staleness:
        return status(task, WARN, f'stale, withdrawn: {staleness}', values)
    return status(task, OK, message, values)


def deadline_status(
    deadline: float, choice: DeadlineChoice | None, *, took: float
) -> DiagnosticStatus:
    """The status of the deadline: what was chosen to meet it, and whether the newest forecast did.

    ``deadline`` is the wall time allowed [s], ``took`` that of the newest forecast [s].
    """
    values: dict[str, object] = {'deadline_s': f'{deadline:g}', 'took_s': f'{took:.3g}'}
    if choice is not None:
        values |= {
            'spacing_m': '' if choice.spacing is None else f'{choice.spacing:.4g}',
            'members': '' if choice.members is None else choice.members,
            'expected_s': f'{choice.wall_time:.3g}',
            'expected_error': f'{choice.error:.2g}',
            'expected_sampling_error': f'{choice.sampling_error:.2g}',
            'choosing_took_s': f'{choice.spent:.3g}',
        }
    reason = choice.reason if choice else 'nothing chosen: no simulation was started with a vent'
    if took > deadline:
        late = f'late: the newest took {took:.3g} s of {deadline:g} s; {reason}'
        return status('deadline', WARN, late, values)
    return status('deadline', OK if choice is None or choice.is_met else WARN, reason, values)


def recorder_status(
    recorder: RecorderStatus, checkpoint: LastCheckpoint | None = None
) -> DiagnosticStatus:
    """Say how the recorder is doing, and up to where its bag can be resumed."""
    values: dict[str, object] = {
        'state': recorder.state,
        'bag': recorder.directory,
        'files': recorder.files,
        'messages': recorder.messages,
    }
    if checkpoint is not None:
        values['checkpoints'] = checkpoint.count
        values['checkpoint_time_s'] = repr(checkpoint.time)
        values['checkpoint_bytes'] = checkpoint.size
    if recorder.error:
        return status('recorder', ERROR, recorder.error, values)
    return status('recorder', OK, recorder.state, values)


def sign(message: DiagnosticArray, node: str, device: str) -> None:
    """Put the node's name before the statuses' names, and name the hardware.

    Diagnostic aggregators identify statuses by name.
    """
    source = node.strip('/')
    for status in message.status:
        status.name = f'{source}: {status.name}'
        status.hardware_id = f'{gethostname()} {device}'.strip()


def status(
    task: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Build a diagnostic status; ``task`` is its name."""
    return DiagnosticStatus(
        level=level,
        name=task,
        message=message,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


#: Wall time in which a simulated clock has to move [s]; a replay may take a while to begin.
PATIENCE = 5.0


class ClockWatch:
    """Looks at a simulated clock from time to time."""

    def __init__(self) -> None:
        """Begin without a look."""
        self._seen: tuple[int, float] | None = None

    def look(self, stamp_ns: int, now: float) -> str:
        """Say why simulated time stands still and what to do; empty while the clock moves.

        ``stamp_ns`` is the time on the clock [ns], 0 before it is received; ``now`` is wall time
        [s].
        """
        if self._seen is None or self._seen[0] != stamp_ns:
            self._seen = stamp_ns, now
        if now - self._seen[1] < PATIENCE:
            return ''
        what = 'stands still' if stamp_ns else 'does not arrive'
        return (
            f'/clock {what}, so simulated time stands still: publish it, as `lava replay` and '
            '`ros2 bag play --clock` do, or set use_sim_time to false'
        )
