# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node whose simulation a bag contains, and the names of its topics."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lava_ros.bag.decoding import Decoder, DIAGNOSTICS, Moment, newest_moments, Timeline
from lava_ros.bag.description import described
from lava_ros.bag.reader import BagReader
from lava_ros.errors import LavaError


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


def described_node(custom_data: Mapping[str, str]) -> RecordedNode | None:
    """Return the node that the description of a bag names, None without such a description."""
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
        return chosen, Timeline(bag, decoder, chosen.diagnostics).of(chosen.name)
    timeline = Timeline(bag, decoder)
    known = []
    for namespace in namespaces:
        names = [name for name in timeline.nodes if _namespace(name) == namespace]
        known += [RecordedNode(name, namespace, {}) for name in names or ['']]
    chosen = _chosen(bag, known, node)
    # a replay in another namespace moves the maps, but does not rename the statuses
    is_only = not chosen.name and len(timeline.nodes) == 1
    return chosen, timeline if is_only else timeline.of(chosen.name)


def last_moments(bag: BagReader, decoder: Decoder, node: str | None = None) -> list[Moment]:
    """Return the newest moment of each node of a bag, or of the named one.

    This is fast for a bag that lava_ros has recorded, which contains a single node.

    Raises:
        LavaError: If the bag lacks the named node.
    """
    stated = described_node(bag.custom_data)
    if stated is not None or 'version' in bag.custom_data:
        topic = DIAGNOSTICS if stated is None else stated.diagnostics
        found = newest_moments(bag, decoder, topic)
        if stated is not None:
            found = [moment for moment in found if moment.node == stated.name]
    else:
        timeline = Timeline(bag, decoder)
        found = [timeline.of(name).moments[-1] for name in timeline.nodes]
    if node is None:
        return found
    known = [stated] if stated else [
        RecordedNode(item.node, _namespace(item.node), {}) for item in found
    ]
    name = _chosen(bag, known, node).name
    return [moment for moment in found if moment.node == name]


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
        raise LavaError('bag', str(bag.path), f'a bag of one node, or --node with one of {names}')
    return known[0] if known else RecordedNode('', '/', {})
