# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of forecasts, and withdrawal of those that no longer apply."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Generic

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask
from lava_ros.live.ensemble_forecasts import Ahead, ForecastRules, Live
from lava_ros.live.forecaster import Forecaster
from lava_ros.live.recorder import Recorder
from lava_ros.live.worker import SimulationWorker
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.layers import ARRIVAL, Layer, plain_source, PROBABILITY
from lava_ros.ros import diagnostics
from lava_ros.ros.executor import EntityRegistry, now_ns
from lava_ros.ros.parameters import Settings
from lava_ros.ros.publishers import LayerPublishers
from lava_ros.ros.startup_inputs import DeadlineChoice
from lava_ros.scene.features import Feature

#: Maximum wait for the forecast thread to end [s]; it may be copying the state.
STOP_TIMEOUT = 4.0

#: Arrival threshold if no layer shows the arrival: minimum lava thickness [m].
_THRESHOLD = 0.1


@dataclass(eq=False)
class ForecastTopics:
    """The layers of forecasts and of ensembles; there are none without a horizon.

    Messages are stamped with the time at which their forecast starts. A forecast is withdrawn, by
    maps of unknown cells, when the scene or the effects change or when it is too old. ``choice``
    returns the choice made to meet the deadline, None without a deadline. ``features`` are places
    for which ensembles also predict arrival times.
    """

    entities: EntityRegistry
    layers: Sequence[Layer]
    recorder: Recorder
    worker: SimulationWorker
    settings: Callable[[], Settings]
    choice: Callable[[], DeadlineChoice | None] = lambda: None
    features: tuple[Feature, ...] = ()

    def __post_init__(self) -> None:
        """Create publishers and the forecaster.

        Raises:
            LavaError: If layers of the arrival have different thresholds.
        """
        self._threshold = _threshold(self.layers)
        self.publishers: list[LayerPublishers[Any]] = [
            LayerPublishers(
                self.entities,
                [layer for layer in self.layers if layer.is_ensemble is is_ensemble],
                self.recorder,
                frame_id=self.settings().frame_id,
            )
            for is_ensemble in (False, True)
        ]
        self._forecasts, self._ensembles = (
            _Withdrawable(publishers, name, self.entities.node)
            for publishers, name in zip(self.publishers, ('forecast', 'ensemble'), strict=True)
        )
        ready = self.entities.create('guard_condition', self.publish)
        self._forecaster = Forecaster(self.worker, self._rules, on_change=ready.trigger)

    def start(self) -> None:
        """Start the forecast thread if there is a horizon."""
        if self.settings().forecast_horizon:
            self._forecaster.start()

    def stop(self) -> None:
        """End the forecast thread and its child process."""
        self._forecaster.stop(STOP_TIMEOUT)

    def activate(self, is_active: bool) -> None:
        """Start or stop making and publishing forecasts."""
        self._forecaster.want(is_active)

    def mark_due(self, rate: float) -> None:
        """Mark the layers of a rate [Hz] as due with the next forecast."""
        for publishers in self.publishers:
            publishers.mark_due(rate)
        self.publish()

    def publish(self, *, repeat: bool = False) -> None:
        """Publish new forecasts or withdraw stale ones; ``repeat`` includes those already sent."""
        forecaster = self._forecaster
        if forecaster.is_wanted:
            latest, ensemble = forecaster.latest, forecaster.ensembles.latest
            self._forecasts.publish(latest, forecaster.staleness(latest), repeat=repeat)
            self._ensembles.publish(ensemble, forecaster.staleness(ensemble), repeat=repeat)

    @property
    def valid(self) -> tuple[Forecast | None, EnsembleForecast | None]:
        """The newest forecast and the newest ensemble, None for one that is missing or stale."""
        forecaster = self._forecaster
        latest, ensemble = forecaster.latest, forecaster.ensembles.latest
        return (
            None if latest is None or forecaster.staleness(latest) else latest.shown,
            None if ensemble is None or forecaster.staleness(ensemble) else ensemble.shown,
        )

    def observe(self, mask: Mask, clock: float) -> 'Future[None]':
        """Weight members by the lava observed at ROS time ``clock`` [s].

        Raises:
            LavaError: If the node does not make ensembles.
        """
        if not self._forecaster.is_wanted:
            raise LavaError('observed_outline', 'no ensemble', 'an active node that makes them')
        return self._forecaster.ensembles.observe(mask, clock)

    def statuses(self) -> list[DiagnosticStatus]:
        """Return the diagnostic statuses, none without a horizon."""
        forecaster, settings = self._forecaster, self.settings()
        if not settings.forecast_horizon:
            return []
        ensembles = forecaster.ensembles
        tasks: list[Any] = [('forecast', forecaster.status, forecaster.latest)]
        if settings.ensemble_members:
            tasks.append(('ensemble', ensembles.status, ensembles.latest))
        found = [
            diagnostics.ahead_status(
                *task, age=forecaster.age(task[-1]), staleness=forecaster.staleness(task[-1])
            )
            for task in tasks
        ]
        if settings.deadline:
            # the duration of an ensemble includes that of its forecast
            known = [live.shown.duration for *_, live in tasks if live is not None]
            took = max(known, default=0.0)
            found.append(diagnostics.deadline_status(settings.deadline, self.choice(), took=took))
        return found

    def _rules(self) -> ForecastRules:
        settings, choice = self.settings(), self.choice()
        members = settings.ensemble_members
        if choice is not None and choice.members is not None:
            members = min(members, choice.members)
        return ForecastRules(
            horizon=settings.forecast_horizon,
            threshold=self._threshold,
            max_age=settings.forecast_max_age or 0.5 * settings.forecast_horizon,
            share=settings.forecast_share,
            max_particles=settings.max_particles,
            members=members,
            deadline=settings.deadline,
            time_scale=settings.time_scale,
            features=self.features,
        )


@dataclass(eq=False)
class _Withdrawable(Generic[Ahead]):
    """Publishes forecasts or ensembles while they are valid, and withdraws them when stale."""

    layers: LayerPublishers[Ahead]
    name: str
    node: Node
    withdrawn: tuple[Ahead, Ahead, int] | None = None
    is_known: bool = False

    def publish(self, live: Live[Ahead] | None, staleness: str, *, repeat: bool) -> None:
        """Publish ``live`` if it is new, or maps of unknown cells if it is stale."""
        if live is None:
            return
        shown, stamp_ns = live.shown, live.stamp_ns
        moment_ns = now_ns(self.node)
        if staleness:
            if self.withdrawn is None or self.withdrawn[0] is not shown:
                self.node.get_logger().info(f'{self.name} withdrawn: {staleness}')
                self.withdrawn = (shown, shown.withdrawn(), moment_ns)
            _, shown, stamp_ns = self.withdrawn
        self.layers.publish(
            shown,
            stamp_ns,
            # the first valid maps and a withdrawal are published immediately
            also_not_due=bool(staleness) or not self.is_known,
            repeat=repeat,
            recorded_ns=moment_ns,
        )
        self.is_known = not staleness


def _threshold(layers: Sequence[Layer]) -> float:
    """Return the arrival threshold [m], which all layers of the arrival must share."""
    arrivals = [item for item in layers if plain_source(item.source) in (ARRIVAL, PROBABILITY)]
    thresholds = {layer.threshold for layer in arrivals}
    if len(thresholds) > 1 or 0.0 in thresholds:
        expected = 'one threshold above 0 for all arrivals'
        raise LavaError('forecast_config', sorted(thresholds), expected)
    return thresholds.pop() if thresholds else _THRESHOLD
