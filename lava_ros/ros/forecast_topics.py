# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of forecasts until they no longer apply, and of arrival times at places."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from lava_ros.errors import LavaError, RefusalError
from lava_ros.forecast.assimilation import Mask
from lava_ros.layers.forecast import EnsembleForecast, Forecast
from lava_ros.layers.layer import ARRIVAL, Layer, plain_source, PROBABILITY
from lava_ros.layers.place_arrivals import live_arrivals, LiveArrivals
from lava_ros.layers.places import Places, places_on
from lava_ros.live.ensemble_forecasts import ForecastRules
from lava_ros.live.forecaster import Forecaster
from lava_ros.live.worker import SimulationWorker
from lava_ros.ros import diagnostics, qos
from lava_ros.ros.diagnostics import ERROR, OK, WARN
from lava_ros.ros.executor import now_ns
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import Settings
from lava_ros.ros.publishers import LayerPublishers
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature, load_features
from lava_ros.simulation.output.snapshot import Snapshot

#: A forecast, or the maps of an ensemble.
ForecastT = TypeVar('ForecastT', Forecast, EnsembleForecast)

#: Arrival threshold if no layer shows the arrival: minimum lava thickness [m].
_THRESHOLD = 0.1

#: Relative name of the topic of arrivals at places.
PLACE_TOPIC = 'place_arrivals'

#: Maximum number of features: each message measures their distances from the lava.
MAX_FEATURES = 1000

#: Maximum number of places in the message of the status, and in its values.
_MAX_NAMED, _MAX_DESCRIBED = 3, 50


class ForecastTopics:
    """The layers of the forecasts and ensembles that ``forecaster`` computes.

    Messages are stamped with the time at which their forecast starts, by the clock after it went
    back. A forecast is withdrawn, by maps of unknown cells, when the scene or the effects change
    or when it is too old.
    """

    def __init__(
        self,
        graph: NodeGraph,
        layers: Sequence[Layer],
        *,
        worker: SimulationWorker,
        settings: Callable[[], Settings],
        features: tuple[Feature, ...] = (),
    ) -> None:
        """Create publishers and the forecaster.

        Args:
            graph: Entities and recorder of the node.
            layers: Layers of forecasts and ensembles.
            worker: Worker with the simulation.
            settings: Returns the current settings.
            features: Places for which ensembles also predict arrival times.

        Raises:
            LavaError: If layers of the arrival have different thresholds.
        """
        self._settings, self._features = settings, features
        self._threshold = _threshold(layers)
        self._forecasts, self._ensembles = (
            _Withdrawable[Any](
                'ensemble' if is_ensemble else 'forecast',
                graph,
                [layer for layer in layers if layer.is_ensemble is is_ensemble],
            )
            for is_ensemble in (False, True)
        )
        self.rates = self._forecasts.rates | self._ensembles.rates
        ready = graph.create('guard_condition', self.publish)
        self.forecaster = Forecaster(worker, self._rules, on_change=ready.trigger)

    def mark_due(self, rate: float) -> None:
        """Mark the layers of a rate [Hz] as due with the next forecast."""
        for publishers in (self._forecasts, self._ensembles):
            publishers.mark_due(rate)
        self.publish()

    def publish(self, *, repeat: bool = False) -> None:
        """Publish new forecasts or withdraw stale ones; ``repeat`` includes those already sent."""
        if self.forecaster.is_wanted:
            self._publish(repeat=repeat)

    def withdraw(self) -> None:
        """Stop making forecasts, and withdraw those that are published."""
        self.forecaster.want(False)
        self._publish(repeat=False)

    def _publish(self, *, repeat: bool) -> None:
        forecaster = self.forecaster
        latest, ensemble = forecaster.latest, forecaster.ensembles.latest
        time_scale = self._settings().time_scale
        for publishers, newest in ((self._forecasts, latest), (self._ensembles, ensemble)):
            publishers.publish_valid(
                newest, forecaster.staleness(newest), repeat=repeat,
                age_ns=round(forecaster.age(newest) / time_scale * 1e9),
            )

    @property
    def valid(self) -> tuple[Forecast | None, EnsembleForecast | None]:
        """The newest forecast and the newest ensemble, None for one that is missing or stale."""
        forecaster = self.forecaster
        latest, ensemble = forecaster.latest, forecaster.ensembles.latest
        return (
            None if forecaster.staleness(latest) else latest,
            None if forecaster.staleness(ensemble) else ensemble,
        )

    def observe(self, mask: Mask, clock: float) -> 'Future[str]':
        """Weight members by the lava observed at ROS time ``clock`` [s].

        Raises:
            LavaError: If the node does not make ensembles.
        """
        if not self.forecaster.is_wanted:
            problem = 'The node computes no ensembles, so it cannot use the outline'
            remedy = 'Set ensemble_members, and activate the node'
            raise RefusalError('observed_outline', problem, remedy)
        return self.forecaster.ensembles.observe(mask, clock)

    def statuses(self) -> list[DiagnosticStatus]:
        """Return the diagnostic statuses, none without a horizon."""
        forecaster, settings = self.forecaster, self._settings()
        if not settings.forecast_horizon:
            return []
        ensembles = forecaster.ensembles
        tasks: list[Any] = [('forecast', forecaster, self._forecasts)]
        if settings.ensemble_members:
            tasks.append(('ensemble', ensembles, self._ensembles))
        return [
            diagnostics.forecast_status(
                name, source.status, latest := source.latest,
                frame_stamp_ns=publishers.stamp_ns(latest),
                age=forecaster.age(latest), staleness=forecaster.staleness(latest),
            )
            for name, source, publishers in tasks
        ]

    def _rules(self) -> ForecastRules:
        settings = self._settings()
        return ForecastRules(
            horizon=settings.forecast_horizon,
            threshold=self._threshold,
            max_age=settings.forecast_max_age or 0.5 * settings.forecast_horizon,
            share=settings.forecast_share,
            max_particles=settings.max_particles,
            members=settings.ensemble_members,
            time_scale=settings.time_scale,
            features=self._features,
            exact=settings.quantities_exact,
        )


class _Withdrawable(LayerPublishers[ForecastT]):
    """Publishes forecasts or ensembles while they are valid, and withdraws them when stale."""

    def __init__(self, name: str, graph: NodeGraph, layers: Sequence[Layer]) -> None:
        super().__init__(graph, layers)
        self._node, self._name = graph.node, name
        self._withdrawn: tuple[ForecastT, ForecastT] | None = None
        self._is_valid = False

    def stamp_ns(self, forecast: ForecastT | None) -> int:
        """Return the stamp of the maps of a forecast [ns], 0 for None."""
        if forecast is None:
            return 0
        return self.shown_stamp_ns if forecast is self.shown else forecast.stamp_ns

    def publish_valid(
        self, latest: ForecastT | None, staleness: str, *, repeat: bool, age_ns: int = 0
    ) -> None:
        """Publish ``latest`` if it is new, or maps of unknown cells if it is stale.

        It started ``age_ns`` of the clock [ns] before the current state.
        """
        if latest is None:
            return
        shown, time_ns = latest, now_ns(self._node)
        if staleness:
            if self._withdrawn is None or self._withdrawn[0] is not latest:
                self._node.get_logger().info(f'{self._name} withdrawn: {staleness}')
                self._withdrawn = latest, replace(latest.withdrawn(), stamp_ns=time_ns)
            # a withdrawal holds at its stamp
            shown, age_ns = self._withdrawn[1], 0
        else:
            # if it becomes stale again, the withdrawal has the stamp of that time
            self._withdrawn = None
        # the first valid maps and a withdrawal are published immediately
        is_urgent = bool(staleness) or not self._is_valid
        stamp_ns = self.stamp_ns(shown)
        if 0 < time_ns < stamp_ns:
            # the clock went back: the arrival times count from the stamp
            stamp_ns, is_urgent = max(1, time_ns - age_ns), True
        self.publish(
            shown, stamp_ns, also_not_due=is_urgent, repeat=repeat, recorded_ns=time_ns
        )
        self._is_valid = not staleness


def _threshold(layers: Sequence[Layer]) -> float:
    """Return the arrival threshold [m], which all layers of the arrival must share."""
    arrivals = [item for item in layers if plain_source(item.source) in (ARRIVAL, PROBABILITY)]
    thresholds = {layer.threshold for layer in arrivals}
    if len(thresholds) > 1 or 0.0 in thresholds:
        expected = 'one threshold above 0 for all arrivals'
        raise LavaError('forecast_config', sorted(thresholds), expected)
    return thresholds.pop() if thresholds else _THRESHOLD


def load_places(files: Sequence[str]) -> tuple[Feature, ...]:
    """Read the features of the files that the parameter ``places`` names.

    Raises:
        LavaError: If a file cannot be read, or there are more than ``MAX_FEATURES`` in all.
    """
    features = tuple(item for path in files for item in load_features('places', path))
    if len(features) > MAX_FEATURES:
        raise LavaError('places', f'{len(features)} features', f'at most {MAX_FEATURES} in all')
    return features


class PlaceTopic:
    """The topic of arrivals at places; there is none without features."""

    def __init__(self, graph: NodeGraph, features: Sequence[Feature]) -> None:
        """Create the publisher."""
        self._graph, self._features = graph, features
        self._error = ''
        self._terrain: Terrain | None = None
        self._places: Places | None = None
        self._shown: tuple[object, ...] = ()
        self._latest: LiveArrivals | None = None
        self._message: DiagnosticArray | None = None
        if features:
            profile = qos.ros_profile(qos.LATCHED)
            self._publisher = graph.create('publisher', DiagnosticArray, PLACE_TOPIC, profile)

    def publish(
        self,
        snapshot: Snapshot,
        forecast: Forecast | None,
        ensemble: EnsembleForecast | None,
        stamp_ns: int,
        *,
        repeat: bool = False,
    ) -> None:
        """Publish the arrivals if they have changed, or if ``repeat``.

        Args:
            snapshot: The state of the newest maps.
            forecast: The newest forecast, None if none is valid.
            ensemble: The newest ensemble, None if none is valid.
            stamp_ns: ROS time of the newest maps [ns].
            repeat: Publish again, even if nothing has changed.
        """
        # snapshots and forecasts are equal only if they are the same object; a snapshot gets
        # another stamp if the clock went back
        shown = snapshot, forecast, ensemble, stamp_ns
        is_new = self._shown != shown
        if not self._features or not (is_new or repeat):
            return
        if is_new:
            self._shown = shown
            self._find_places(snapshot.terrain)
            self._latest, statuses = None, []
            if self._places is not None:
                self._latest = live_arrivals(self._places, snapshot, forecast, ensemble)
                statuses = _statuses(self._latest, self._places)
            header = self._graph.header(stamp_ns)
            self._message = DiagnosticArray(header=header, status=statuses)
        node = self._graph.node
        self._graph.send(self._publisher, self._message, now_ns(node), qos.LATCHED)

    def statuses(self) -> list[DiagnosticStatus]:
        """Return the status of the places; none without features."""
        if not self._features:
            return []
        latest = self._latest
        if latest is None:
            level = ERROR if self._error else OK
            return [diagnostics.status('places', level, self._error or 'no maps yet', {})]
        places = [
            (_level(latest, index), row.name, latest.words(index))
            for index, row in enumerate(latest.rows)
        ]
        # the most severe first
        places.sort(key=lambda item: item[0], reverse=True)
        worst = places[0][0]
        sentences = [f'{name}: {words}' for level, name, words in places if level == worst != OK]
        more = f'; and {len(sentences) - _MAX_NAMED} more' if len(sentences) > _MAX_NAMED else ''
        message = '; '.join(sentences[:_MAX_NAMED]) + more or latest.summary
        values = {name: words for _, name, words in places[:_MAX_DESCRIBED]}
        return [diagnostics.status('places', worst, message, values)]

    def _find_places(self, terrain: Terrain) -> None:
        if terrain is self._terrain:
            return
        self._terrain, self._places, self._error = terrain, None, ''
        try:
            self._places = places_on(self._features, terrain)
        except LavaError as error:
            self._error = f'places cannot be located on this terrain: {error}'
            self._graph.node.get_logger().error(self._error)


def _statuses(latest: LiveArrivals, places: Places) -> list[DiagnosticStatus]:
    """Return a status for each place: its name, a sentence, and the numbers."""
    result = []
    for index, row in enumerate(latest.rows):
        x, y = places.middle(index)
        values = {'x_m': x, 'y_m': y, **latest.values(index)}
        texts = {key: _text(value) for key, value in values.items() if key != 'name'}
        level = _level(latest, index)
        result.append(diagnostics.status(row.name, level, latest.words(index), texts))
    return result


def _text(value: object) -> str:
    """Format a value for a message: numbers in full precision, an empty text for None."""
    if value is None:
        return ''
    return str(value).lower() if isinstance(value, bool) else str(value)


def _level(latest: LiveArrivals, index: int) -> bytes:
    """Return ERROR if lava has arrived, WARN if it may arrive or there is no forecast."""
    row = latest.rows[index]
    may_arrive = not row.is_known or bool(row.probability)
    level: bytes = ERROR if latest.reached[index] else WARN if may_arrive else OK
    return level
