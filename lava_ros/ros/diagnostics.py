# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Diagnostics of the node: messages on /diagnostics, and its log."""

from collections.abc import Mapping, Sequence
from pathlib import Path
import re
from socket import gethostname
from types import MappingProxyType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np

from lava_ros.bag.description import is_on, unused_velocities
from lava_ros.bag.status_values import numerical_error_values, resolution_values, snapshot_values
from lava_ros.layers.forecast import EnsembleForecast, Forecast
from lava_ros.live.ensemble_forecasts import ForecastStatus
from lava_ros.live.error_measurement import ErrorMeasurement
from lava_ros.live.recording_control import RecordingControl
from lava_ros.live.session import SessionView, WITH_PARTICLES
from lava_ros.live.worker_status import WorkerState, WorkerStatus
from lava_ros.scene import suspicious_temperatures, Terrain
from lava_ros.scene.plausibility import doubts_of_scene
from lava_ros.scene.projection import system_name
from lava_ros.scene.vents import are_in_place
from lava_ros.simulation.carriers import count_key
from lava_ros.simulation.output.inundation import reached_cells
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.resolution import Resolution

#: Levels of a status.
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

#: Levels of the worker states that are not OK.
_LEVELS = {WorkerState.WAITING: WARN, WorkerState.FAILED: ERROR}


def simulation_status(
    worker: WorkerStatus,
    snapshot: Snapshot | None,
    *,
    is_active: bool,
    frame_stamp_ns: int,
    resolution: Resolution | None = None,
    method_reason: str = '',
    missed: Sequence[str] = (),
    clock: Mapping[str, str] = MappingProxyType({}),
    error: Mapping[str, str] = MappingProxyType({}),
) -> DiagnosticStatus:
    """Return the status of the simulation.

    Args:
        worker: Status of the worker.
        snapshot: The last snapshot published, None before the first.
        is_active: True if the node is active.
        frame_stamp_ns: Stamp of the maps of the snapshot [ns].
        resolution: Measured or expected resolution of the flow.
        method_reason: Why the node has chosen these carriers, empty if they were given.
        missed: Warnings about effects that they do not have (``SessionView.missed``).
        clock: Warnings about the clock (``ClockWatch.warnings``).
        error: Values of the numerical error.
    """
    state = worker.state
    level, message = _LEVELS.get(state, OK), state.value
    warnings = snapshot.budget.warnings() if snapshot is not None else []
    # the state 'starting' already explains the delay
    warnings += [*clock.values(), worker.blocked_by if state is not WorkerState.STARTING else '']
    if worker.is_catching_up:
        warnings.append(_catch_up_text(worker))
    else:
        warnings.append('running slower than the clock' if worker.is_behind else '')
    if worker.is_stale and state is WorkerState.RUNNING:
        warnings.append(
            f'the state is {worker.age:.4g} s of simulated time old, expected at most '
            f'{worker.max_age:.4g} s: hazard and masks are not repeated'
        )
    if state is WorkerState.RUNNING and resolution is not None and resolution.warnings():
        warnings.append(resolution.text())
    if state is WorkerState.RUNNING and missed:
        warnings.append(missed_text(missed))
    if worker.error:
        message = f'{message}: {worker.error}'
    elif worker.fault:
        level, message = ERROR, worker.fault
    elif any(warnings):
        is_lost = snapshot is not None and not snapshot.budget.is_conserved
        level = ERROR if is_lost else WARN
        message = '; '.join(filter(None, warnings))
    values: dict[str, object] = {
        'state': state.value,
        'lifecycle': 'active' if is_active else 'inactive',
        'device': worker.device,
        'speed': f'{worker.speed:.4g}',
        'mean_speed': f'{worker.mean_speed:.4g}',
        'age_s': f'{worker.age:.4g}',
        'max_age_s': f'{worker.max_age:.4g}',
        'clock_lost_s': f'{worker.lost:.4g}',
        'clock_jumps': worker.jumps,
    }
    if resolution is not None:
        values |= resolution_values(resolution)
    if method_reason:
        values['method_reason'] = method_reason
    if missed:
        values['missed_effects'] = '; '.join(missed)
    values |= error
    if snapshot is not None:
        values |= snapshot_values(snapshot, frame_stamp_ns)
    if not is_active:
        message = f'inactive: {message}'
    return status('simulation', level, message, values)


def missed_text(missed: Sequence[str]) -> str:
    """Return the warning about effects that the flow needs and cells do not have, and a remedy."""
    return f'{"; ".join(missed)}. {WITH_PARTICLES}' if missed else ''


def error_values(measurement: ErrorMeasurement) -> dict[str, str]:
    """Return the status values of the numerical error; without a measurement only its text."""
    error, texts = measurement.latest, {'numerical_error': measurement.text()}
    return texts if error is None else texts | numerical_error_values(error)


def effects_status(effects: Mapping[str, str]) -> DiagnosticStatus:
    """Return the status of the effects: which are on, and why each is on or off."""
    names = ', '.join(name for name, text in effects.items() if is_on(text)) or 'none'
    message = f'on: {names}' if effects else 'not chosen yet'
    return status('effects', OK, message, effects)


def forecast_status(
    task: str,
    state: ForecastStatus,
    latest: Forecast | EnsembleForecast | None,
    *,
    frame_stamp_ns: int,
    age: float,
    staleness: str,
) -> DiagnosticStatus:
    """Return the status of the task ``forecast`` or ``ensemble``; ``latest`` is the newest result.

    ``frame_stamp_ns`` is the stamp of its maps [ns], ``age`` its age [s], ``staleness`` the reason
    why it is stale, empty if it is not.
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
    if state.members_left is not None:
        values['members_left_by_outline'] = f'{state.members_left:.1f}'
    message = 'up to date'
    if latest is not None:
        values |= {
            'start_time_s': repr(latest.time),
            'horizon_s': repr(latest.horizon),
            'duration_s': f'{latest.duration:.3g}',
            'age_s': f'{age:.6g}',
            'is_stale': str(bool(staleness)).lower(),
            'frame_stamp_ns': frame_stamp_ns,
        }
    if isinstance(latest, Forecast):
        values[count_key(latest.method)] = latest.particle_count
        values['cells_reached'] = int(reached_cells(latest.arrival).sum())
    elif latest is not None:
        maps = latest.maps
        values |= {
            'members': maps.members,
            'members_asked': latest.asked,
            'members_effective': f'{maps.effective_members:.1f}',
            'sampling_error_percent': f'{maps.sampling_error:.1f}',
            'unseen_percent': f'{maps.unseen:.2g}',
            'arrival_error_s': f'{maps.arrival_error:.6g}',
            'members_beyond': maps.members_beyond,
            'drawn': latest.drawn,
            'exact': latest.exact,
        }
        message = f'{maps.members} of {latest.asked} members'
        if not latest.is_done:
            message += ' so far'
    level = OK
    if state.error:
        level, message = ERROR, state.error
    elif latest is None:
        message = staleness
    elif staleness:
        level, message = WARN, f'stale, withdrawn: {staleness}'
    return status(task, level, message, values)


def recorder_status(recording: RecordingControl) -> DiagnosticStatus:
    """Return the status of the recorder, with the time up to which its bag can be resumed."""
    recorder, checkpoints = recording.recorder, recording.checkpoints
    last, file = checkpoints.last, recording.restart_file
    values: dict[str, object] = {
        'state': recorder.state,
        'bag': recorder.directory,
        'files': recorder.files,
        'messages': recorder.messages,
    }
    if last is not None:
        values['checkpoints'] = checkpoints.count
        values['checkpoint_time_s'] = repr(last.time)
        values['checkpoint_bytes'] = last.size
    level, message = OK, recorder.state
    if recorder.error:
        level, message = ERROR, recorder.error + '; trying again' * recording.is_wanted
    if file is not None and file.error:
        level = max(level, WARN)
        message += f'; a restart would not know the time of the newest maps: {file.error}'
    return status('recorder', level, message, values)


def sign(message: DiagnosticArray, node: str, device: str) -> None:
    """Prefix statuses with the node's name, as aggregators require, and set the hardware."""
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


class NodeLog:
    """Logs scene, simulation and recorder when they have changed."""

    def __init__(self, logger: Any) -> None:
        """Initialize with an empty history."""
        self._logger = logger
        self._logged: dict[str, Any] = {'state': WorkerState.WAITING}

    def scene(self, view: SessionView) -> None:
        """Log changes of terrain, vents and effects.

        Changes within the noise of a sensor (``SessionView.changes``) are not logged.
        """
        scene = view.scene
        if scene is None or self._logged.get('changes') == view.changes:
            return
        self._logged['changes'] = view.changes
        terrain, vents, effects = scene.terrain, scene.vents, view.effects
        self._log_change('terrain', terrain, _terrain_text(terrain))
        # discharges and small shifts are left out: a live feed changes them with each message
        known = self._logged.get('vents')
        places = known if known is not None and are_in_place(vents, known) else vents
        discharge = sum(vent.discharge_at(view.time) for vent in vents)
        self._log_change('vents', places, f'vents: {len(vents)}, {discharge:g} m3/s')
        # the topics use Celsius
        doubts = suspicious_temperatures(scene, is_celsius=True)
        doubts += [doubt.text for doubt in doubts_of_scene(scene)]
        doubts = [*doubts, *unused_velocities(vents, effects)][:3]
        self._log_change('doubts', [*map(_wording, doubts)], '; '.join(doubts), 'warning')
        names = [name for name, text in effects.items() if is_on(text)]
        self._log_change('effects', names, f'effects: {", ".join(names) or "none"}')

    def worker(
        self,
        worker: WorkerStatus,
        view: SessionView,
        clock: Mapping[str, str],
        *,
        is_paused: bool,
    ) -> None:
        """Log changes of the simulation's state, and warnings about its flow and its clock."""
        state, resolution = worker.state, view.resolution
        text = f'simulation {state.value}'
        if state is WorkerState.FAILED:
            text = f'simulation failed: {worker.error}; ~/reset starts it again'
        elif state is WorkerState.PAUSED and not is_paused:
            # an inactive node holds time too, and reports that it is inactive
            text = ''
        failed = state is WorkerState.FAILED
        self._log_change('state', state, text, 'error' if failed else 'info')
        if resolution is not None:
            severity = 'warning' if resolution.warnings() else 'info'
            wording = resolution.spacing, [*map(_wording, resolution.warnings())]
            self._log_change('resolution', wording, resolution.text(), severity)
            missed = missed_text(view.missed)
            self._log_change('missed', _wording(missed), missed, 'warning')
        # the text contains a duration, so only its kind is compared
        for kind in ('clock', 'ahead', 'back', 'lost'):
            self._log_change(kind, kind in clock, clock.get(kind, ''), 'warning')
        if worker.is_catching_up:
            self._log_change('catch-up', True, _catch_up_text(worker), 'warning')
        elif self._logged.get('catch-up'):
            self._log_change('catch-up', False, 'simulated time has caught up with the clock')
        self._log_change('hold-up', bool(worker.blocked_by), worker.blocked_by, 'warning')

    def volumes(self, snapshot: Snapshot) -> None:
        """Log the volume of lava emitted, and where it is."""
        budget = snapshot.budget
        self._logger.info(f'volume at {snapshot.time:g} s: {budget.text()}')
        for text in budget.warnings():
            self._logger.warning(text)

    def recorder(self, recording: RecordingControl) -> None:
        """Log the location of the bag, its error, and the error of the progress file."""
        recorder, file = recording.recorder, recording.restart_file
        if recorder.is_recording:
            place = Path(recorder.directory).absolute()
            self._log_change('recorder', place, f'recording to {place}')
        # not while a failed recording is tried again
        if not recorder.is_armed:
            self._log_change('recorder error', recorder.error, recorder.error, 'error')
        if file is not None:
            self._log_change('restart', file.error, file.error, 'warning')

    def _log_change(self, about: str, thing: object, text: str, severity: str = 'info') -> None:
        """Log ``text`` when ``thing`` has changed; an empty text is not logged."""
        if about in self._logged and self._logged[about] == thing:
            return
        self._logged[about] = thing
        # rclpy requires a constant severity for each line of code that logs
        if text and severity == 'error':
            self._logger.error(text)
        elif text and severity == 'warning':
            self._logger.warning(text)
        elif text:
            self._logger.info(text)


def _catch_up_text(worker: WorkerStatus) -> str:
    return f'catching up after a restart: {worker.age:.4g} s of simulated time behind'


def _wording(text: str) -> str:
    """Return a text without its numbers, which a live feed changes with each message."""
    return re.sub(r'\d[\d.]*(e[+-]\d+)?', '', text)


def _terrain_text(terrain: Terrain) -> str:
    rows, columns = terrain.shape
    empty = int(np.isnan(terrain.elevation).sum())
    holes = f', {empty} of them without data' * bool(empty)
    if sea := int(terrain.is_sea.sum()):
        holes += f', {sea} in the sea'
    system = f', {system_name(terrain.epsg, terrain.wkt)}' * terrain.has_system
    return f'terrain: {columns} x {rows} cells of {terrain.resolution:g} m{holes}{system}'
