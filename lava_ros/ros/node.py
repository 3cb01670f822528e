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

"""The node `lava`: topics and parameters to the simulation, its layers back to the graph."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
import os
from pathlib import Path
import signal
import sys
import time
import traceback
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData
from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.errors import LavaError
from lava_ros.layers import Layer, load_layers
from lava_ros.presets import preset_accuracy
from lava_ros.ros import codec, diagnostics, inputs, parameters, qos
from lava_ros.ros.layer_publishers import LayerPublishers
from lava_ros.ros.recorder import Recorder
from lava_ros.ros.scene_recording import SceneRecording
from lava_ros.ros.services import Services
from lava_ros.ros.worker import SimulationLike, SimulationWorker
from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Lava, Scene, scene_from_yaml, Terrain
from lava_ros.share import share_path
from lava_ros.terrain_files import load_terrain

#: Thickness from which a cell counts as wet in the diagnostics [m].
WET_THICKNESS = 0.1

#: How long the end waits for the simulation's thread: a step, or the compiler at the start [s].
STOP_TIMEOUT = 4.0


class LavaNode(Node):
    """Adapts a ``SimulationWorker`` to ROS; does no work of its own."""

    def __init__(
        self,
        *,
        make_simulation: Callable[[Scene], SimulationLike] | None = None,
        **options: Any,
    ) -> None:
        """Read the parameters, start the worker and join the graph.

        Args:
            make_simulation: Makes simulations in place of the parameters' own.
            options: Passed on to ``rclpy.node.Node``.

        Raises:
            LavaError: A parameter or a file it names is not usable.
            ParameterException: A parameter has the wrong type or is out of range.
        """
        super().__init__('lava', **options)
        scene, terrain = self._load_sources()
        self._settings = self._declare_parameters(scene.lava if scene else Lava())
        self._inputs = diagnostics.InputLog()
        self._pairing = inputs.TerrainPairing()
        config = _config_path(self._settings.msg_config)
        layers = load_layers(config)
        self._recorder = Recorder()
        self._recording = SceneRecording(
            self,
            self._recorder,
            frame_id=self._settings.rules.frame_id,
            msg_config=config.read_text(encoding='utf-8'),
            parameters=lambda: self._values,
        )
        self._clicks = 0
        self._reported_state = WorkerState.WAITING
        self._reported_recorder_error = ''
        self._snapshot_ready = self.create_guard_condition(self._publish_layers)
        self._worker = SimulationWorker(
            make_simulation or self._make_simulation,
            clock=lambda: self.get_clock().now().nanoseconds * 1e-9,
            lava=self._settings.lava,
            time_scale=self._settings.time_scale,
            end_time=self._settings.end_time,
            on_snapshot=self._snapshot_ready.trigger,
        )
        self._create_outputs(layers)
        self._create_inputs()
        self._answers = Services(
            self,
            self._worker,
            command=self._command,
            step_length=lambda: self._settings.time_scale,
            start_recording=self._start_recording,
            stop_recording=self._stop_recording,
        )
        if self._settings.record:
            self._recorder.arm(self._bag_directory())
        self._worker.start()
        if scene is not None:
            self._command('scene', self._worker.set_scene(scene))
        elif terrain is not None:
            self._command('terrain_file', self._worker.set_terrain(terrain))

    def close(self) -> bool:
        """Finish the bag and end the worker.

        Returns:
            Whether the worker has ended.
        """
        self._recorder.stop()
        ended = self._worker.stop(STOP_TIMEOUT)
        self._report_recorder()
        return ended

    # setting up

    def _load_sources(self) -> tuple[Scene | None, Terrain | None]:
        values = parameters.declare(self, parameters.SOURCES)
        terrain = load_terrain(values['terrain_file']) if values['terrain_file'] else None
        if not values['scene']:
            return None, terrain
        return scene_from_yaml(values['scene'], terrain=terrain), None

    def _declare_parameters(self, lava: Lava) -> parameters.Settings:
        specs = parameters.PARAMETERS + parameters.lava_parameters(lava)
        self._values = parameters.declare(self, specs)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        return parameters.settings_from(self._values)

    def _create_outputs(self, layers: Sequence[Layer]) -> None:
        self._layers = LayerPublishers(
            self, layers, self._recorder, frame_id=self._settings.rules.frame_id
        )
        for rate in self._layers.rates:
            self.create_timer(1.0 / rate, lambda rate=rate: self._make_due(rate))
        self._diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.ros_profile(qos.DIAGNOSTICS)
        )
        # The heartbeat must not stop with a simulated clock.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._publish_diagnostics, clock=self._steady)

    def _create_inputs(self) -> None:
        terrain_qos = qos.terrain_profile(
            transient_local=self._settings.terrain_subscribe_transient_local
        )
        command_qos = qos.ros_profile(qos.COMMANDS)
        self.create_subscription(
            Image, 'terrain', self._guarded('terrain', self._on_terrain), terrain_qos
        )
        self.create_subscription(
            MapMetaData,
            'terrain_info',
            self._guarded('terrain_info', self._on_terrain_info),
            terrain_qos,
        )
        self.create_subscription(
            PointCloud2,
            'terrain_cloud',
            self._guarded('terrain_cloud', self._on_terrain_cloud),
            terrain_qos,
        )
        self.create_subscription(
            PointCloud2, 'vents', self._guarded('vents', self._on_vents), command_qos
        )
        self.create_subscription(
            PointStamped,
            'clicked_point',
            self._guarded('clicked_point', self._on_clicked_point),
            command_qos,
        )
        self.create_timer(0.1, self._poll_pairing, clock=self._steady)

    def _make_simulation(self, scene: Scene) -> SimulationLike:
        from lava_ros.simulation import Simulation

        settings = self._settings
        return Simulation(
            scene,
            accuracy=preset_accuracy(settings.preset, spacing=settings.spacing),
            device=settings.device,
            effects=settings.forced,
            horizon=settings.horizon,
        )

    # parameters

    def _check_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        try:
            parameters.settings_from(self._with(changed))
        except LavaError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changed: list[Parameter]) -> None:
        old = self._settings
        self._values = self._with(changed)
        new = self._settings = parameters.settings_from(self._values)
        if new.time_scale != old.time_scale:
            self._command('time_scale', self._worker.set_time_scale(new.time_scale))
        if new.end_time != old.end_time:
            self._command('end_time', self._worker.set_end_time(new.end_time))
        if (new.forced, new.horizon) != (old.forced, old.horizon):
            self._command('effects', self._worker.set_effects(new.forced, horizon=new.horizon))
        if new.lava != old.lava:
            self._command('lava', self._worker.set_lava(new.lava))
        if (new.lava, new.preset, new.spacing) != (old.lava, old.preset, old.spacing):
            self.get_logger().info('the new value is used from the next start or reset on')

    def _with(self, changed: list[Parameter]) -> dict[str, Any]:
        known = {
            item.name: parameters.plain(item.value)
            for item in changed
            if item.name in self._values
        }
        return {**self._values, **known}

    # inputs

    def _guarded(self, topic: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        def take(message: Any) -> None:
            try:
                callback(message)
            except LavaError as error:
                self._reject(topic, error)
            except Exception as error:
                self.get_logger().error(traceback.format_exc())
                reason = f'{type(error).__name__}: {error}'
                self._reject(topic, LavaError(topic, reason, 'a message that can be read'))

        return take

    def _reject(self, topic: str, error: LavaError) -> None:
        if self._inputs.reject(topic, error):
            self.get_logger().error(f'{topic} refused: {error}')

    def _command(self, topic: str, future: 'Future[None]') -> None:
        """Report how a command for the worker ends; that is in the worker's thread."""

        def report(done: 'Future[None]') -> None:
            error = None if done.cancelled() else done.exception()
            if isinstance(error, LavaError):
                self._reject(topic, error)
            elif error is None and not done.cancelled():
                self._inputs.accept(topic)

        future.add_done_callback(report)

    def _on_terrain(self, image: Image) -> None:
        inputs.check_image(image, self._settings.rules)
        self._pairing.add_image(image, time.monotonic())
        self._poll_pairing()

    def _on_terrain_info(self, info: MapMetaData) -> None:
        inputs.check_info(info, self._settings.rules)
        self._inputs.accept('terrain_info')
        self._pairing.add_info(info, time.monotonic())
        self._poll_pairing()

    def _poll_pairing(self) -> None:
        if not self._pairing.is_waiting:
            return
        try:
            pair = self._pairing.poll(time.monotonic())
            if pair is not None:
                terrain = inputs.terrain_from_image(*pair, self._settings.rules)
                self._command('terrain', self._worker.set_terrain(terrain))
        except LavaError as error:
            self._reject('terrain', error)

    def _on_terrain_cloud(self, cloud: PointCloud2) -> None:
        terrain = inputs.terrain_from_cloud(cloud, self._settings.rules)
        self._command('terrain_cloud', self._worker.set_terrain(terrain))

    def _on_vents(self, cloud: PointCloud2) -> None:
        vents = inputs.vents_from_cloud(cloud, self._settings.rules)
        self._command('vents', self._worker.set_vents(vents))

    def _on_clicked_point(self, point: PointStamped) -> None:
        settings, scene = self._settings, self._worker.scene
        if scene is not None and len(scene.vents) >= settings.rules.max_vents:
            raise LavaError(
                'clicked_point', 'one more vent', f'at most {settings.rules.max_vents} (max_vents)'
            )
        self._clicks += 1
        vent = inputs.vent_from_point(
            point,
            settings.rules,
            discharge=settings.default_discharge,
            temperature=settings.default_temperature,
            radius=settings.default_radius,
            name=f'click {self._clicks}',
        )
        self._command('clicked_point', self._worker.add_vent(vent))

    # outputs

    def _make_due(self, rate: float) -> None:
        self._layers.make_due(rate)
        self._worker.request_snapshot()
        if self._is_at_rest():
            self._publish_layers()

    def _publish_layers(self, *, repeat: bool = False) -> None:
        """Publish the layers that are due and have something new; all of them at rest."""
        snapshot = self._worker.latest
        if snapshot is None:
            return
        stamp_ns = self._stamp_ns()
        if self._worker.scene is not None:
            self._recording.write(
                self._worker.scene,
                snapshot,
                stamp_ns,
                effects=self._worker.effects,
                device=self._worker.status.device,
            )
        self._layers.publish(
            snapshot, stamp_ns, also_not_due=self._is_at_rest(), repeat=repeat
        )
        self._recorder.flush()
        self._report_recorder()

    def _is_at_rest(self) -> bool:
        return self._worker.status.state is not WorkerState.RUNNING

    def _publish_diagnostics(self) -> None:
        worker = self._worker.status
        if self._is_at_rest():
            # The end is not told before its frame is out.
            self._publish_layers()
        snapshot = self._layers.shown
        stamp_ns = self._stamp_ns()
        wet = 0 if snapshot is None else int((snapshot.thickness >= WET_THICKNESS).sum())
        message = DiagnosticArray(
            header=codec.header('', stamp_ns),
            status=[
                diagnostics.simulation_status(
                    worker, snapshot, wet_cells=wet, frame_stamp_ns=self._layers.shown_stamp_ns
                ),
                diagnostics.effects_status(self._worker.effects),
                self._inputs.status(),
                diagnostics.recorder_status(self._recorder.status),
            ],
        )
        data = codec.serialise(message)
        self._diagnostics.publish(data)
        self._recorder.write(
            '/diagnostics',
            'diagnostic_msgs/msg/DiagnosticArray',
            data,
            stamp_ns,
            qos=qos.bag_profile(qos.DIAGNOSTICS),
        )
        self._recorder.flush()
        self._report_recorder()
        self._report_state(worker.state, worker.error)

    def _report_state(self, state: WorkerState, error: str) -> None:
        if state is self._reported_state:
            return
        self._reported_state = state
        if state is WorkerState.FAILED:
            self.get_logger().error(f'simulation failed: {error}; ~/reset starts it again')
        else:
            self.get_logger().info(f'simulation {state.value}')

    def _stamp_ns(self) -> int:
        return self.get_clock().now().nanoseconds

    # recording

    def _start_recording(self) -> str:
        directory = self._bag_directory()
        self._recorder.arm(directory)
        self._publish_layers(repeat=True)
        self._report_recorder()
        if self._recorder.status.error:
            raise LavaError('bag_directory', str(directory), self._recorder.status.error)
        return str(directory)

    def _stop_recording(self) -> str:
        self._recorder.stop()
        self._report_recorder()
        return self._recorder.status.directory

    def _bag_directory(self) -> Path:
        chosen = self._settings.bag_directory
        return Path(chosen) if chosen else Path('bags') / time.strftime('%Y-%m-%dT%H-%M-%S')

    def _report_recorder(self) -> None:
        error = self._recorder.status.error
        if error and error != self._reported_recorder_error:
            self.get_logger().error(error)
        self._reported_recorder_error = error


def _config_path(name: str) -> Path:
    """A file by its path, or by its name among the package's own."""
    path = Path(name)
    return path if path.is_file() else share_path(f'msg_configs/{name}')


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns:
        0 after a signal, 1 when the node cannot start.
    """
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = LavaNode()
    except (LavaError, ParameterException) as error:
        hint = ' (a parameter that is not whole is written 5.0)' * isinstance(
            error, ParameterException
        )
        print(f'lava_node cannot start: {error}{hint}', file=sys.stderr)
        rclpy.shutdown()
        return 1
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stopping:
            executor.spin_once(timeout_sec=0.1)
    finally:
        ended = node.close()
    node.get_logger().info('stopped' if ended else 'stopped; a step of the simulation was cut off')
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    if not ended:
        # Leaving normally would wait for, or crash in, the thread that is still in the solver.
        sys.stdout.flush()
        os._exit(0)
    return 0


if __name__ == '__main__':
    sys.exit(main())
