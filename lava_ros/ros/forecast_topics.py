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

"""Publishes forecasts, and withdraws those that say nothing about what comes any more."""

from collections.abc import Callable, Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from lava_ros.errors import LavaError
from lava_ros.forecast.forecast import Forecast
from lava_ros.layers import ARRIVAL, Layer
from lava_ros.ros import diagnostics
from lava_ros.ros.entities import Entities
from lava_ros.ros.forecaster import Forecaster, ForecastRules, LiveForecast
from lava_ros.ros.layer_publishers import LayerPublishers
from lava_ros.ros.parameters import Settings
from lava_ros.ros.recorder import Recorder
from lava_ros.ros.worker import SimulationWorker

#: How long the end waits for the thread of the forecasts [s].
STOP_TIMEOUT = 4.0

#: Thickness from which on lava has arrived where no layer shows the arrival [m].
_THRESHOLD = 0.1


class ForecastTopics:
    """The layers of forecasts; without a horizon there are none.

    Messages are stamped with the time at which their forecast starts. A forecast is withdrawn, by
    maps on which nothing is known, as soon as scene or effects have changed or it is too old.

    Attributes:
        layers: The publishers.
    """

    def __init__(
        self,
        entities: Entities,
        layers: Sequence[Layer],
        recorder: Recorder,
        *,
        worker: SimulationWorker,
        settings: Callable[[], Settings],
    ) -> None:
        """Create a publisher for every layer.

        Args:
            entities: Creates them.
            layers: What to publish, by ``published_layers``.
            recorder: Where the layers that are recorded go.
            worker: Has the live simulation.
            settings: Gives the node's settings.

        Raises:
            LavaError: Two layers of the arrival have different thresholds.
        """
        self._node = entities.node
        self._settings = settings
        self._threshold = _threshold(layers)
        self._is_active = False
        self._withdrawn: tuple[LiveForecast, Forecast, int] | None = None
        self.layers = LayerPublishers[Forecast](
            entities, layers, recorder, frame_id=settings().rules.frame_id
        )
        self._forecaster: Forecaster | None = None
        if settings().forecast_horizon:
            ready = entities.guard_condition(self.publish)
            self._forecaster = Forecaster(worker, self._rules, on_change=ready.trigger)

    def start(self) -> None:
        """Start the thread, where forecasts are wanted at all."""
        if self._forecaster is not None:
            self._forecaster.start()

    def stop(self) -> None:
        """End the thread and its process."""
        if self._forecaster is not None:
            self._forecaster.stop(STOP_TIMEOUT)

    def activate(self, is_active: bool) -> None:
        """Make and publish forecasts from now on, or no more."""
        self._is_active = is_active
        if self._forecaster is not None:
            self._forecaster.want(is_active)

    def make_due(self, rate: float) -> None:
        """Let the layers of a rate be published with the next forecast."""
        self.layers.make_due(rate)
        self.publish()

    def publish(self, *, repeat: bool = False) -> None:
        """Publish the newest forecast where it has not been, or its withdrawal.

        Args:
            repeat: Whether layers take it that have had it.
        """
        latest = self._forecaster.latest if self._forecaster is not None else None
        if self._forecaster is None or latest is None or not self._is_active:
            return
        forecast, stamp_ns, now_ns = latest.forecast, latest.stamp_ns, self._now_ns()
        staleness = self._forecaster.staleness()
        if staleness:
            if self._withdrawn is None or self._withdrawn[0] is not latest:
                self._node.get_logger().info(f'forecast withdrawn: {staleness}')
                self._withdrawn = (latest, forecast.withdrawn(), now_ns)
            _, forecast, stamp_ns = self._withdrawn
        self.layers.publish(
            forecast,
            stamp_ns,
            also_not_due=bool(staleness),
            repeat=repeat,
            recorded_ns=now_ns,
        )

    def statuses(self) -> list[DiagnosticStatus]:
        """What diagnostics say, nothing without a horizon."""
        if self._forecaster is None:
            return []
        status = diagnostics.forecast_status(
            self._forecaster.status,
            self._forecaster.latest,
            age=self._forecaster.age,
            staleness=self._forecaster.staleness(),
        )
        return [status]

    def _rules(self) -> ForecastRules:
        settings = self._settings()
        return ForecastRules(
            horizon=settings.forecast_horizon,
            threshold=self._threshold,
            max_age=settings.forecast_max_age,
            share=settings.forecast_share,
            max_particles=settings.max_particles,
        )

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)


def _threshold(layers: Sequence[Layer]) -> float:
    """The thickness from which on lava has arrived: it is one for all layers of the arrival."""
    thresholds = {layer.threshold for layer in layers if layer.source == ARRIVAL}
    if len(thresholds) > 1 or 0.0 in thresholds:
        raise LavaError(
            'forecast_config', sorted(thresholds), 'one threshold above 0 for all arrivals'
        )
    return thresholds.pop() if thresholds else _THRESHOLD
