# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node between configuration and cleanup: worker, topics, services and bag."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
import time
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from lava_ros.errors import RefusalError
from lava_ros.layers.layer_files import find_config
from lava_ros.live.checkpoint_recording import CheckpointRecording
from lava_ros.live.clock import ClockWatch
from lava_ros.live.error_measurement import ErrorMeasurement
from lava_ros.live.recording_control import BagSettings, RecordingControl
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState, WorkerStatus
from lava_ros.ros import codec, diagnostics, qos
from lava_ros.ros.executor import now_ns
from lava_ros.ros.forecast_topics import ForecastTopics, load_places, PlaceTopic
from lava_ros.ros.georeference import recorded_transform
from lava_ros.ros.input_log import Allowance
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import CHECKPOINT_PERIOD, OF_TERRAIN, Settings, start_values
from lava_ros.ros.publishers import (
    LayerPublishers,
    ParticlePublisher,
    published_layers,
    ScenePublisher,
)
from lava_ros.ros.recording import SceneRecording
from lava_ros.ros.startup_inputs import make_simulation, resume_simulation, StartupInputs
from lava_ros.ros.subscribers import InputSubscribers
from lava_ros.scene import Scene
from lava_ros.simulation.output.snapshot import Snapshot

if TYPE_CHECKING:
    from lava_ros.simulation import Simulation

#: Maximum wait for each thread when closing [s]. The simulation may be in a step, or compiling.
STOP_TIMEOUT = 4.0

#: Period of the diagnostics [s].
HEARTBEAT = 1.0


class NodeRuntime:
    """A configured node: it receives ``inputs`` and, while ``is_active``, simulates and publishes.

    ``settings`` are the current settings, ``worker`` has the simulation, ``allowance`` limits
    requests. ``failure`` is the error that prevents the node from resuming a bag and ends the
    node, or None.
    """

    def __init__(
        self,
        graph: NodeGraph,
        settings: Settings,
        values: Callable[[], Mapping[str, Any]],
        startup: StartupInputs,
    ) -> None:
        """Create publishers and subscriptions, and load ``startup`` with time held.

        ``values`` returns the node's parameters.

        Raises:
            LavaError: If a file cannot be used.
        """
        self._graph, self._recorder, node = graph, graph.recorder, graph.node
        self._node = node
        self.settings = settings
        self.failure: BaseException | None = None
        self._given, progress = startup.given, startup.progress
        names = ['msg_config', 'forecast_config'][: 2 if settings.forecast_horizon else 1]
        configs = {name: find_config(getattr(settings, name), field=name) for name in names}
        features = load_places(settings.places)
        layers = published_layers(*configs.values(), settings=settings)
        self.is_active = False
        self._is_paused = progress is not None and progress.is_paused
        self._clock_watch = ClockWatch()
        self._method_reason = ''
        self._log = diagnostics.NodeLog(node.get_logger())
        self._recording = SceneRecording(
            graph,
            configs={name: path.read_text(encoding='utf-8') for name, path in configs.items()},
            parameters=values,
            transform=recorded_transform(node.get_logger(), is_wanted=settings.publish_tf),
        )
        snapshot_ready = graph.create('guard_condition', self._publish)
        self.worker = SimulationWorker(
            self._make_simulation,
            clock=lambda: now_ns(node) * 1e-9,
            constants=settings.constants,
            time_scale=settings.time_scale,
            end_time=settings.end_time,
            max_particles=settings.max_particles,
            paused=True,
            on_snapshot=snapshot_ready.trigger,
        )
        self._bags = RecordingControl(
            self._recorder,
            CheckpointRecording(
                self._recorder, self.worker.checkpoint, lambda: self.inputs.vents, progress
            ),
            startup.bag_folder,
            lambda: BagSettings(
                self.settings.bag_directory, self.settings.bag_max_size,
                self.settings.bag_max_duration, self.settings.checkpoint_period,
            ),
            startup.restart_file,
            is_wanted=settings.record if progress is None else progress.is_recording,
            is_restart=startup.is_restart,
        )
        self._saved_bytes = 0
        self._layers = LayerPublishers[Snapshot](
            graph, [layer for layer in layers if not layer.is_forecast], self._heartbeat_time
        )
        self._forecasts = ForecastTopics(
            graph,
            [layer for layer in layers if layer.is_forecast],
            worker=self.worker,
            settings=lambda: self.settings,
            features=features,
        )
        self._error = ErrorMeasurement(self.worker, share=lambda: self.settings.error_share)
        self._places = PlaceTopic(graph, features)
        for rate in sorted(self._layers.rates | self._forecasts.rates):
            graph.create('timer', 1.0 / rate, lambda rate=rate: self._mark_due(rate))
        self._scene = ScenePublisher(graph, publish_tf=settings.publish_tf)
        self._particles = ParticlePublisher(graph, self.worker)
        self._diagnostics = graph.create(
            'publisher', DiagnosticArray, '/diagnostics', qos.ros_profile(qos.DIAGNOSTICS)
        )
        # The diagnostics must not stop with a simulated clock.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        graph.create('timer', HEARTBEAT, self._publish_diagnostics, clock=steady)
        self.inputs = InputSubscribers(
            graph,
            self.worker,
            settings=lambda: self.settings,
            steady=steady,
            observe=self._forecasts.observe if settings.ensemble_members else None,
            is_echo=self._scene.is_echo,
            vents_taken=startup.vents_taken,
        )
        self.allowance = Allowance(self.inputs.refuse)
        self._begin(startup)
        # Start the threads last, so that an error above leaves none running.
        self.worker.start()
        self._error.start()
        if settings.forecast_horizon:
            self._forecasts.forecaster.start()

    def activate(self) -> None:
        """Let simulated time advance, and publish.

        Raises:
            LavaError: If the simulation has failed, or the bag cannot be created.
        """
        status = self.worker.status
        if status.state is WorkerState.FAILED:
            problem = f'The simulation has failed: {status.error}'
            raise RefusalError('simulation', problem, 'Start it again with ~/reset')
        self._bags.begin()
        self.is_active = True
        self.worker.pause(self._is_paused)
        self._forecasts.forecaster.want(True)
        self._publish(repeat=True)

    def deactivate(self) -> None:
        """Hold simulated time, withdraw forecasts and publish no more layers.

        Inputs and diagnostics continue.
        """
        self._forecasts.withdraw()
        self._publish_places()
        self.is_active = False
        self.worker.pause(True)

    def close(self) -> None:
        """Finish the bag, end the worker and leave the graph."""
        self.is_active = False
        try:
            self._close_bag()
            if self.worker.latest is not None:
                self._log.volumes(self.worker.latest)
        finally:
            # a run that could not be resumed, for example without its GPU, may be resumed later
            if self.failure is None:
                self._bags.end_run()
            self._error.stop(STOP_TIMEOUT)
            self._forecasts.forecaster.stop(STOP_TIMEOUT)
            self.worker.stop(STOP_TIMEOUT)
            self._graph.destroy()

    def check(self, settings: Settings) -> None:
        """Check settings before they are used.

        Raises:
            LavaError: If the bag cannot be written there, the lava cannot come out of the scene's
                vents, or effects change too often.
        """
        old = self.settings
        # an unchanged name that has become invalid in the meantime does not block other settings
        if settings.bag_directory != old.bag_directory:
            self._bags.folder.path(settings.bag_directory)
        scene = self.worker.view.scene
        if scene is not None and settings.constants != old.constants:
            replace(scene, **settings.constants)
        if (settings.forced, settings.horizon) != (old.forced, old.horizon):
            self.allowance.take('effects')

    def apply(self, new: Settings) -> None:
        """Use new settings, immediately or, for method, preset, spacing and lava, later."""
        old, self.settings = self.settings, new
        command = self.inputs.command
        for name in ('time_scale', 'max_particles', 'end_time'):
            value = getattr(new, name)
            if value != getattr(old, name):
                command(name, self.worker.set(name, value))
        if (new.forced, new.horizon) != (old.forced, old.horizon):
            command('effects', self.worker.set_effects(new.forced, horizon=new.horizon))
        if new.constants != old.constants:
            command('lava', self.worker.set_constants(new.constants))
        before, after = start_values(old), start_values(new)
        later = [name for name in after if after[name] != before[name]]
        ground = [name for name in OF_TERRAIN if getattr(new, name) != getattr(old, name)]
        for names, text in (
            (later, 'from the next start or reset'),
            (ground, 'for the next terrain from a topic'),
        ):
            if names:
                text = f'{", ".join(names)}: the new value is used {text}'
                self._node.get_logger().info(text)

    def pause(self, paused: bool) -> 'Future[None]':
        """Hold simulated time, or let it continue as soon as the node is active."""
        self._is_paused = paused
        return self.worker.pause(paused or not self.is_active)

    def start_recording(self) -> str:
        """Start a bag, and return its name and when it starts.

        Raises:
            LavaError: If the bag cannot be written.
        """
        self._bags.start()
        self._publish(repeat=True)
        self._check_recorder()
        return self._recorder.directory + ' at the first map' * self._recorder.is_armed

    def stop_recording(self) -> str:
        """Finish the bag and return its name, empty without a bag.

        Raises:
            LavaError: If the bag could not be written.
        """
        self._bags.is_wanted, is_recording = False, self._recorder.is_recording
        self._close_bag()
        self._check_recorder()
        return self._recorder.directory if is_recording else ''

    def _check_recorder(self) -> None:
        if self._recorder.error:
            problem = f'The recording has failed: {self._recorder.error}'
            raise RefusalError('recorder', problem, 'Check that the bag is writable')

    def save(self) -> str:
        """Write the current maps and a checkpoint to a bag and return its name.

        The bag is the one being recorded, otherwise a new one.

        Raises:
            LavaError: If the bag or the checkpoint cannot be written, there is nothing to save, or
                ``max_saved_bytes`` have been saved.
        """
        if self.worker.latest is None:
            raise RefusalError('save', 'There is no simulation to save', 'Publish a terrain first')
        maximum = self.settings.max_saved_bytes
        if self._saved_bytes >= maximum:
            problem = f'~/save has written {self._saved_bytes} bytes of at most {maximum}'
            remedy = 'Configure the node with a larger max_saved_bytes'
            error = RefusalError('save', problem, remedy)
            self.allowance.refuse('save', error)
        if not now_ns(self._node):
            problem = 'There is no time on /clock yet'
            raise RefusalError('save', problem, 'Start the clock, or set use_sim_time to false')
        is_recording, before = self._recorder.is_recording, self._recorder.size
        # a wanted recording that has failed continues in the new bag
        is_own = not (is_recording or self._bags.is_wanted)
        if not is_recording:
            self._bags.arm(is_next=not is_own)
        self._publish(repeat=True)
        self._check_recorder()
        # the user asked for a checkpoint, so write one even if checkpoint_period is 0
        reason = self._bags.finish_checkpoint(now_ns(self._node), period=CHECKPOINT_PERIOD)
        self._recorder.flush()
        self._saved_bytes += max(0, self._recorder.size - before)
        directory = self._recorder.directory
        if is_own:
            self._close_bag()
        self._check_recorder()
        if reason:
            problem = f'{directory} has the maps without a checkpoint: {reason}'
            raise RefusalError('save', problem, 'Call ~/save again')
        return directory

    def _begin(self, startup: StartupInputs) -> None:
        checkpoint, command = startup.checkpoint, self.inputs.command
        if checkpoint is not None:
            future = self.worker.resume_with(
                partial(resume_simulation, checkpoint, self.settings),
                checkpoint.scene, startup.origin, startup.before, published=startup.published,
            )
            future.add_done_callback(self._note_failure)
        elif startup.scene is not None:
            # parameters replace constants of the scene
            scene = replace(startup.scene, **self.settings.constants)
            command('scene', self.worker.set_scene(scene))
        elif startup.terrain is not None:
            command('terrain_file', self.worker.set_terrain(startup.terrain))
        else:
            self._node.get_logger().info(self.inputs.wanted)

    def _make_simulation(self, scene: Scene) -> 'Simulation':
        """Make a simulation, in the worker's thread, and log a method that it chooses."""
        simulation, choice = make_simulation(scene, self.settings)
        self._recording.note_start()
        self._method_reason = choice.reason
        if choice.reason:
            self._node.get_logger().info(choice.text())
        return simulation

    def _note_failure(self, future: 'Future[None]') -> None:
        # a new simulation in its place would look like the resumed eruption
        if not future.cancelled():
            self.failure = future.exception()

    def _mark_due(self, rate: float) -> None:
        if not self.is_active:
            return
        self._layers.mark_due(rate)
        self._forecasts.mark_due(rate)
        self.worker.request_snapshot()
        if self._is_at_rest():
            self._publish()

    def _publish(self, *, repeat: bool = False) -> None:
        """Publish the layers that are due and have changed; at rest, also those not due."""
        snapshot, view = self.worker.latest, self.worker.view
        scene = view.scene
        self._log.scene(view)
        if snapshot is None or not self.is_active:
            return
        stamp_ns = now_ns(self._node)
        # a bag begins with the next maps
        repeat |= self._recorder.is_armed and stamp_ns > 0
        if scene is not None:
            # a bag that began before the first valid clock time would be decades long
            if stamp_ns:
                self._recording.write(view, snapshot, stamp_ns)
            is_heard = self.inputs.came_from_topic(scene.terrain)
            self._scene.publish(scene, snapshot.time, stamp_ns, is_heard=is_heard)
        self._layers.publish(snapshot, stamp_ns, also_not_due=self._is_at_rest(), repeat=repeat)
        self._forecasts.publish(repeat=repeat)
        if self._layers.shown is snapshot:
            self._particles.request(snapshot, self._layers.shown_stamp_ns)
        if repeat:
            self._publish_places(repeat=True)
        self._recorder.flush()
        self._log.recorder(self._bags)

    def _publish_places(self, *, repeat: bool = False) -> None:
        snapshot = self._layers.shown
        if snapshot is not None and self.is_active:
            stamp_ns = self._layers.shown_stamp_ns
            self._places.publish(
                snapshot, *self._forecasts.valid, stamp_ns=stamp_ns, repeat=repeat
            )

    def _heartbeat_time(self) -> int | None:
        """Return the ROS time [ns] of a heartbeat, None while maps must not be repeated."""
        # subscribers detect maps that do not follow the clock by their deadline
        is_current = self.is_active and not self.worker.status.is_stale
        return now_ns(self._node) if is_current else None

    def _is_at_rest(self) -> bool:
        return self.worker.status.state is not WorkerState.RUNNING

    def _publish_diagnostics(self) -> None:
        worker = self.worker.status
        if self._is_at_rest():
            # Publish the last maps before the status that reports the end.
            self._publish()
        stamp_ns = now_ns(self._node)
        if self._recorder.is_armed and stamp_ns > 0:
            self._publish()
        self._publish_places()
        self._send_diagnostics(stamp_ns)
        self._recorder.flush()
        self._report_checkpoint(
            self._bags.poll(stamp_ns, changes=self.worker.view.changes, is_active=self.is_active)
        )
        self._note_progress(worker)
        self._log.recorder(self._bags)

    def _send_diagnostics(self, stamp_ns: int) -> None:
        worker, view = self.worker.status, self.worker.view
        snapshot = self._layers.shown
        is_simulated = self._node.get_clock().ros_time_is_active
        clock = self._clock_watch.warnings(
            stamp_ns, time.monotonic(), worker, is_simulated=is_simulated
        )
        self._log.worker(worker, view, clock, is_paused=self._is_paused)
        message = DiagnosticArray(
            header=codec.header('', stamp_ns),
            status=[
                diagnostics.simulation_status(
                    worker,
                    snapshot,
                    is_active=self.is_active,
                    frame_stamp_ns=self._layers.shown_stamp_ns,
                    resolution=self.worker.session.measured_resolution,
                    method_reason=self._method_reason,
                    missed=view.missed,
                    clock=clock,
                    error=diagnostics.error_values(self._error),
                ),
                diagnostics.effects_status(view.effects),
                self.inputs.status(self._scene.warning()),
                diagnostics.recorder_status(self._bags),
                *self._forecasts.statuses(),
                *self._places.statuses(),
            ],
        )
        diagnostics.sign(message, self._node.get_fully_qualified_name(), worker.device)
        self._graph.send(self._diagnostics, message, stamp_ns, qos.DIAGNOSTICS)

    def _note_progress(self, worker: WorkerStatus) -> None:
        # until the first map of a restarted node, the progress of the killed node applies
        if self._layers.shown is not None:
            self._bags.note(
                time=self._layers.shown.time,
                stamp_ns=self._layers.shown_stamp_ns,
                behind=worker.age if worker.is_catching_up else 0.0,
                is_held=worker.state is not WorkerState.RUNNING,
                is_paused=self._is_paused,
                given=self._given,
            )

    def _close_bag(self) -> None:
        if self._recorder.is_recording:
            # readers know the simulated time of maps only up to the last diagnostics
            self._send_diagnostics(now_ns(self._node))
        self._report_checkpoint(self._bags.close(now_ns(self._node)))
        self._log.recorder(self._bags)

    def _report_checkpoint(self, reason: str) -> None:
        if reason:
            self._node.get_logger().warning(f'no checkpoint: {reason}')
