# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node whose simulation a bag contains, and the names of its topics."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import json

from lava_ros.bag.decoding import (
    Decoder,
    DIAGNOSTICS,
    Moment,
    newest_moments,
    node_of,
    Timeline,
)
from lava_ros.bag.description import described
from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError, RefusalError

#: Default full name of the node.
DEFAULT_NODE = '/lava'


@dataclass(frozen=True)
class RecordedNode:
    """A node in a bag.

    Attributes:
        name: Full name, such as /etna/lava; empty if it is unknown.
        namespace: Namespace of the topics that ``topics`` does not contain.
        topics: Full names of topics by their names before remapping, as the bag describes them.
    """

    name: str
    namespace: str
    topics: Mapping[str, str]

    def topic(self, name: str) -> str:
        """Return the full name of a topic, by its name before remapping."""
        return self.topics.get(name) or f'{self.namespace.rstrip("/")}/{name}'

    @property
    def diagnostics(self) -> str:
        """The topic of its diagnostics."""
        return self.topics.get('diagnostics', DIAGNOSTICS)

    @property
    def description(self) -> dict[str, str]:
        """The part of the description of a bag from which ``described_node`` makes this node."""
        return {
            'node': self.name, 'namespace': self.namespace, 'topics': json.dumps(dict(self.topics))
        }


def described_node(custom_data: Mapping[str, str]) -> RecordedNode | None:
    """Return the node that the description of a bag names, None if it names none."""
    name, topics = custom_data.get('node'), described(custom_data)['topics']
    if not name or topics is None:
        return None
    return RecordedNode(name, custom_data.get('namespace', '/'), topics)


def find_node(
    bag: BagReader, decoder: Decoder, namespaces: Iterable[str], *, node: str | None = None
) -> tuple[RecordedNode, Timeline]:
    """Return the node whose maps are to be read from a bag, and its timeline.

    The description of the bag names the node. In a bag without such a description, a node is
    looked for in each namespace with maps.

    Args:
        bag: The bag.
        decoder: Decoder of its messages.
        namespaces: Namespaces with maps.
        node: Full name or namespace of the node; None for the only one.

    Raises:
        LavaError: If the bag has several nodes and none is named, or lacks the named one.
    """
    stated = described_node(bag.custom_data)
    if stated is not None:
        chosen = _chosen(bag, [stated], node)
        timeline = Timeline(bag, decoder, chosen.diagnostics, is_own=True)
        return chosen, timeline.of(chosen.name)
    timeline = Timeline(bag, decoder)
    chosen = _chosen(bag, _nodes_in(timeline, namespaces), node)
    # ros2 bag play with remapped topics moves the maps, but does not rename the statuses
    is_only = not chosen.name and len(timeline.nodes) == 1
    return chosen, timeline if is_only else timeline.of(chosen.name)


def last_moments(bag: BagReader, decoder: Decoder, node: str | None = None) -> list[Moment]:
    """Return the newest moment of each node with diagnostics in a bag, or of the named one.

    This is fast for a bag whose description names its node.

    Raises:
        LavaError: If the bag lacks the named node.
    """
    stated = described_node(bag.custom_data)
    if stated is None:
        timeline = Timeline(bag, decoder)
        known = _nodes_in(timeline)
        found = [timeline.of(item.name).moments[-1] for item in known]
    else:
        known, found = [stated], newest_moments(bag, decoder, stated.diagnostics)
    names = [item.name for item in (known if node is None else [_chosen(bag, known, node)])]
    return [moment for moment in found if moment.node in names]


@dataclass(frozen=True)
class Selection:
    """The messages of a bag that belong to one of its nodes.

    Attributes:
        node: The node.
        topics: Full names of its topics, and of those that all nodes share.
    """

    node: RecordedNode
    topics: frozenset[str]
    _others: frozenset[str]
    _decoder: Decoder

    def has(self, message: BagMessage) -> bool:
        """Return True unless a message is on another topic, or the diagnostics of another node."""
        if message.topic != self.node.diagnostics or not self._others:
            return message.topic in self.topics
        owners = self._decoder.decode(message, lambda item: set(map(node_of, item.status)))
        return self.node.name in owners or not owners & self._others


def select_node(bag: BagReader, node: str, shared: frozenset[str]) -> Selection:
    """Return the messages of a node: all of a bag that describes it, else those of its namespace.

    Args:
        bag: The bag.
        node: Full name or namespace of the node.
        shared: Names of topics that all nodes share.

    Raises:
        LavaError: If the bag lacks the node.
    """
    decoder, stated = Decoder(bag), described_node(bag.custom_data)
    if stated is not None:
        chosen = _chosen(bag, [stated], node)
        return Selection(chosen, frozenset(bag.topics), frozenset(), decoder)
    known = _nodes_in(Timeline(bag, decoder))
    chosen = _chosen(bag, known, node)
    # the longest first: the root namespace contains all others
    spaces = sorted({item.namespace.rstrip('/') for item in known}, key=len, reverse=True)
    own = {
        topic
        for topic in bag.topics
        if chosen.namespace.rstrip('/')
        == next((space for space in spaces if topic.startswith(f'{space}/')), None)
    }
    others = frozenset(item.name for item in known) - {chosen.name}
    return Selection(chosen, frozenset(own | shared & bag.topics.keys()), others, decoder)


def _nodes_in(timeline: Timeline, namespaces: Iterable[str] | None = None) -> list[RecordedNode]:
    """List the nodes of a bag whose description names none: the nodes with diagnostics.

    With ``namespaces``, a node without a name is listed for each of them without diagnostics, and
    nodes of others are left out.
    """
    if namespaces is None:
        return [RecordedNode(name, _namespace(name), {}) for name in timeline.nodes]
    return [
        RecordedNode(name, namespace, {})
        for namespace in namespaces
        for name in [name for name in timeline.nodes if _namespace(name) == namespace] or ['']
    ]


def _namespace(name: str) -> str:
    return name.rpartition('/')[0] or '/'


def _chosen(bag: BagReader, known: list[RecordedNode], node: str | None) -> RecordedNode:
    """Return the only node, or the one with a full name or in a namespace."""
    names = ', '.join(item.name or item.namespace for item in known)
    if node is not None:
        wanted = f'/{node.strip("/")}'
        exact = [item for item in known if item.name == wanted]
        known = exact or [item for item in known if item.namespace == wanted]
        if not known:
            raise LavaError('--node', node, f'a node of {bag.path}: {names or "it has none"}')
    if len(known) > 1:
        names = ', '.join(item.name or item.namespace for item in known)
        remedy = f'Choose one: --node with one of {names}'
        raise RefusalError('bag', f'{bag.path} contains several nodes', remedy)
    return known[0] if known else RecordedNode('', '/', {})
