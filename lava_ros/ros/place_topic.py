# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of lava arrival times at places, on a topic and in the diagnostics."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from lava_ros.errors import LavaError
from lava_ros.live.recorder import Recorder
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.place_arrivals import live_arrivals, LiveArrivals
from lava_ros.maps.places import Places, places_on
from lava_ros.ros import codec, diagnostics, qos
from lava_ros.ros.diagnostics import ERROR, OK, WARN
from lava_ros.ros.executor import EntityRegistry
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature, load_features
from lava_ros.simulation.output.snapshot import Snapshot

#: Relative name of the topic.
TOPIC = 'place_arrivals'

#: Maximum number of features: each message measures their distances from the lava.
MAX_FEATURES = 1000

#: Maximum number of places in the message of the status, and in its values.
_MAX_NAMED, _MAX_DESCRIBED = 3, 50


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

    def __init__(
        self,
        entities: EntityRegistry,
        recorder: Recorder,
        features: Sequence[Feature],
        *,
        frame_id: str,
    ) -> None:
        """Create the publisher."""
        self._node, self._recorder, self._frame_id = entities.node, recorder, frame_id
        self._features = features
        self._error = ''
        self._terrain: Terrain | None = None
        self._places: Places | None = None
        self._shown: tuple[object, ...] = (None, None, None)
        self._latest: LiveArrivals | None = None
        self._message: DiagnosticArray | None = None
        if features:
            profile = qos.ros_profile(qos.LATCHED)
            self._publisher = entities.create('publisher', DiagnosticArray, TOPIC, profile)

    def publish(
        self,
        snapshot: Snapshot,
        forecast: Forecast | None,
        ensemble: EnsembleForecast | None,
        stamp_ns: int,
        *,
        recorded_ns: int,
        repeat: bool = False,
    ) -> None:
        """Publish the arrivals if they have changed, or if ``repeat``.

        Args:
            snapshot: The state of the newest maps.
            forecast: The newest forecast, None if none is valid.
            ensemble: The newest ensemble, None if none is valid.
            stamp_ns: ROS time of the newest maps [ns].
            recorded_ns: ROS time of the message in the bag [ns].
            repeat: Publish again, even if nothing has changed.
        """
        if not self._features:
            return
        shown = (snapshot, forecast, ensemble)
        is_new = any(one is not other for one, other in zip(shown, self._shown, strict=True))
        if is_new:
            self._shown = shown
            self._latest = self._arrivals(snapshot, forecast, ensemble)
            statuses = []
            if self._latest is not None and self._places is not None:
                statuses = _statuses(self._latest, self._places)
            self._message = DiagnosticArray(
                header=codec.header(self._frame_id, stamp_ns), status=statuses
            )
        if self._message is not None and (is_new or repeat):
            data, name = codec.serialise(self._message), self._publisher.topic_name
            self._publisher.publish(data)
            kind = codec.type_name(DiagnosticArray)
            self._recorder.write(name, kind, data, recorded_ns, qos=qos.LATCHED)

    def statuses(self) -> list[DiagnosticStatus]:
        """Return the status of the places; none without features."""
        if not self._features:
            return []
        latest = self._latest
        if latest is None:
            level = ERROR if self._error else OK
            return [diagnostics.status('places', level, self._error or 'no maps yet', {})]
        # sort by level, most severe first
        statuses = sorted(
            (
                (_level(latest, index), row.name, latest.words(index))
                for index, row in enumerate(latest.rows)
            ),
            key=lambda item: item[0], reverse=True,
        )
        worst = statuses[0][0]
        sentences = [f'{name}: {words}' for level, name, words in statuses if level == worst != OK]
        more = f'; and {len(sentences) - _MAX_NAMED} more' if len(sentences) > _MAX_NAMED else ''
        message = '; '.join(sentences[:_MAX_NAMED]) + more or latest.summary
        values = {name: words for _, name, words in statuses[:_MAX_DESCRIBED]}
        return [diagnostics.status('places', worst, message, values)]

    def _arrivals(
        self, snapshot: Snapshot, forecast: Forecast | None, ensemble: EnsembleForecast | None
    ) -> LiveArrivals | None:
        if snapshot.terrain is not self._terrain:
            self._terrain, self._places, self._error = snapshot.terrain, None, ''
            try:
                self._places = places_on(self._features, snapshot.terrain)
            except LavaError as error:
                self._error = f'places cannot be put on this terrain: {error}'
                self._node.get_logger().error(self._error)
        if self._places is None:
            return None
        return live_arrivals(self._places, snapshot, forecast, ensemble)


def _statuses(latest: LiveArrivals, places: Places) -> list[DiagnosticStatus]:
    """Return a status for each place: its name, a sentence, and the numbers."""
    return [
        diagnostics.status(
            row.name, _level(latest, index), latest.words(index),
            {
                key: _text(value)
                for key, value in [
                    *zip(('x_m', 'y_m'), places.middle(index), strict=True),
                    *latest.values(index).items(),
                ]
                if key != 'name'
            },
        )
        for index, row in enumerate(latest.rows)
    ]


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
