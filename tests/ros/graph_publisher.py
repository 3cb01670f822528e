# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Valid and malformed messages for nodes, and clients that publish them and call services."""

from abc import ABC, abstractmethod
from array import array
import hashlib
import time

from geometry_msgs.msg import PointStamped, TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap
import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_srvs.srv import SetBool, Trigger

from lava_ros.ros import codec
from lava_ros.scene import Terrain
from ros_messages import float_image
from waiting import PATIENCE, wait_until

ROWS, COLUMNS, RESOLUTION = 30, 40, 10.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TYPES = {
    'terrain': (Image, LATCHED),
    'terrain_info': (MapMetaData, LATCHED),
    'terrain_cloud': (PointCloud2, LATCHED),
    'terrain_georeference': (TransformStamped, LATCHED),
    'vents': (PointCloud2, QoSProfile(depth=10)),
    'clicked_point': (PointStamped, QoSProfile(depth=10)),
    'observed_outline': (OccupancyGrid, QoSProfile(depth=10)),
}
SERVICES = {
    'reset': Trigger, 'step': Trigger, 'save': Trigger, 'pause': SetBool, 'record': SetBool,
}
TRANSITIONS = {
    'configure': Transition.TRANSITION_CONFIGURE,
    'activate': Transition.TRANSITION_ACTIVATE,
    'deactivate': Transition.TRANSITION_DEACTIVATE,
    'cleanup': Transition.TRANSITION_CLEANUP,
}
#: Goal states of the transitions.
GOALS = {
    'configure': 'inactive', 'activate': 'active', 'deactivate': 'inactive',
    'cleanup': 'unconfigured', 'shutdown': 'finalized',
}
#: Services that are not idempotent.
ONCE = {'change_state', 'step', 'save', 'record'}
#: Wait for an answer before a service is called again [s].
REPEAT_PERIOD = 5.0


def elevation(height=500.0, columns=COLUMNS):
    """Return a plane that falls towards +x by 1 in 10, with a valley along its middle."""
    y, x = np.mgrid[0:ROWS, 0:columns]
    return (height - RESOLUTION * 0.1 * x + 0.05 * (y - ROWS / 2) ** 2).astype(np.float32)


def image(values=None, frame_id='map', **changes):
    """Return a terrain image, with fields changed."""
    values = elevation() if values is None else values
    message = float_image(values, codec.header(frame_id, 0))
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def info(width=COLUMNS, angle=0.0, x=0.0, **changes):
    """Return the description of the terrain's cells, with fields changed."""
    message = MapMetaData(width=width, height=ROWS, resolution=RESOLUTION)
    message.origin.position.x = x
    message.origin.orientation.z = float(np.sin(angle / 2.0))
    message.origin.orientation.w = float(np.cos(angle / 2.0))
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def cloud(columns, frame_id='map'):
    return codec.point_cloud(columns, codec.header(frame_id, 0))


def cloud_of(points, is_bigendian=False, padding=0):
    """Return a cloud of structured points, shape [rows, columns], with padding after each row."""
    kinds = {'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64, 'i4': PointField.INT32}
    fields = [
        PointField(name=name, offset=offset, datatype=kinds[dtype.str[1:]], count=1)
        for name, (dtype, offset) in points.dtype.fields.items()
    ]
    rows, columns = points.shape
    data = b''.join(row.tobytes() + b'\xee' * padding for row in points)
    return PointCloud2(
        header=codec.header('map', 0), height=rows, width=columns, fields=fields,
        is_bigendian=is_bigendian, point_step=points.itemsize,
        row_step=columns * points.itemsize + padding, data=array('B', data),
    )


def vents(frame_id='map', without=(), **changes):
    """Return one vent high on the slope, with values changed and fields left out."""
    columns = {'x': 60.0, 'y': 155.0, 'z': 0.0, 'discharge': 20.0, 'temperature': 1100.0}
    columns.update({'radius': 10.0, **changes})
    return cloud({key: [value] for key, value in columns.items() if key not in without}, frame_id)


def click(x, y, frame_id='map'):
    message = PointStamped()
    message.header.frame_id = frame_id
    message.point.x, message.point.y = x, y
    return message


def outline(late=0.0):
    """Return observed lava down to 100 m from the vent, stamped ``late`` [s] after now."""
    y, x = (np.mgrid[0:ROWS, 0:COLUMNS] + 0.5) * RESOLUTION
    lava = (np.abs(y - 155.0) < 25.0) & (x > 45.0) & (x < 160.0)
    header = codec.header('map', time.time_ns() + int(late * 1e9))
    return codec.occupancy_grid(np.where(lava, 100, 0), Terrain(lava, RESOLUTION), header)


def georeference(system='EPSG:32633', x=499000.0, y=4180000.0, stamp_ns=0, frame_id='map'):
    """Return a georeference, which belongs to every terrain unless it has a stamp."""
    message = TransformStamped(child_frame_id=frame_id, header=codec.header(system, stamp_ns))
    message.transform.translation.x, message.transform.translation.y = x, y
    return message


def spoilt(value):
    values = elevation()
    values[5, 5] = value
    return values


def points():
    """Return the terrain as a point cloud of its cell centres, two metres higher."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS] * RESOLUTION
    return {'x': x.ravel() + 5.0, 'y': y.ravel() + 5.0, 'z': elevation().ravel() + 2.0}


CASES = {
    'terrain': ('terrain', image),
    'terrain_info': ('terrain_info', info),
    'terrain_cloud': ('terrain_cloud', lambda: cloud(points())),
    'georeference': ('terrain_georeference', georeference),
    'vents': ('vents', vents),
    'kelvin_vents': ('vents', lambda: vents(temperature=1360.0)),
    'no_vents': ('vents', lambda: cloud({'x': []})),
    'click': ('clicked_point', lambda: click(100.0, 155.0)),
    'nan_hole': ('terrain', lambda: image(spoilt(np.nan))),
    'cloud_with_hole': (
        'terrain_cloud',
        lambda: cloud({name: np.delete(column, 77) for name, column in points().items()}),
    ),
    'vents_without_fields': ('vents', lambda: vents(without=('discharge', 'radius'))),
    'click_off_map': ('clicked_point', lambda: click(9e6, 0.0)),
    # another size, with the same valley
    'higher': ('terrain', lambda: image(elevation(505.0, COLUMNS + 8))),
    'higher_info': ('terrain_info', lambda: info(width=COLUMNS + 8)),
    'away': ('terrain_info', lambda: info(x=1e5)),
    'outline': ('observed_outline', outline),
    'outline_of_tomorrow': ('observed_outline', lambda: outline(late=86400.0)),
}


def publication(number):
    """Return the message info of a publication: source timestamp and sequence number."""
    return {'source_timestamp': number, 'publication_sequence_number': number}


class Asking(ABC):
    """Calls services of nodes; the default ``node`` is /lava."""

    @abstractmethod
    def request(self, kind, name, timeout, **fields):
        """Call a service once; return its response, None if none arrives in time [s]."""

    def ask(self, kind, name, **fields):
        """Call a service and return its answer; call it again if none comes and that is harmless.

        A reply to a client that the node has not discovered yet is lost.
        """
        is_repeatable = name.rpartition('/')[2] not in ONCE
        end = time.monotonic() + PATIENCE
        while (left := end - time.monotonic()) > 0.0:
            timeout = min(REPEAT_PERIOD, left) if is_repeatable else left
            if (answer := self.request(kind, name, timeout, **fields)) is not None:
                return answer
        raise AssertionError(f'no answer from {name}')

    def map(self, topic, node='/lava'):
        """Return shape, stamp and hash of the cells of a map of the node."""
        grid = self.ask(GetMap, f'{node}/{topic}/get_map').map
        return {
            'cells': hashlib.sha256(grid.data).hexdigest(),
            'shape': [grid.info.height, grid.info.width],
            'stamp_ns': codec.nanoseconds(grid.header.stamp),
        }

    def set(self, node='/lava', **values):
        """Set parameters of the node atomically and return the response; ``__`` is a dot."""
        messages = [
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        name = f'{node}/set_parameters_atomically'
        result = self.ask(SetParametersAtomically, name, parameters=messages).result
        return {'success': result.successful, 'message': result.reason}

    def call(self, service, data=False, node='/lava'):
        """Call a service of the node and return its answer."""
        kind = SERVICES[service]
        result = self.ask(kind, f'{node}/{service}', **{'data': data} if kind is SetBool else {})
        return {'success': result.success, 'message': result.message}

    def change(self, name, node='/lava'):
        """Request a transition; return True if its answer or the state shows success.

        ``shutdown`` is another in each state, and found by its label.
        """
        transition = Transition(id=TRANSITIONS.get(name, 0))
        transition.label = '' if name in TRANSITIONS else name
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            answer = self.request(
                ChangeState, f'{node}/change_state', REPEAT_PERIOD, transition=transition
            )
            # if the response was lost, the state shows success
            went_well = self.state(node) == GOALS[name]
            if answer is not None or went_well:
                assert answer is None or not answer.success or went_well, (name, self.state(node))
                return went_well and (answer is None or answer.success)
        raise AssertionError(f'no answer to {name} from {node}')

    def state(self, node='/lava'):
        """Return the label of the node's state."""
        return self.ask(GetState, f'{node}/get_state').current_state.label


class Publisher(Asking):
    """Publishes the messages of a test to nodes in a graph, and calls their services.

    With ``durability`` each topic has this one, and a history of one message.
    """

    def __init__(self, domain, durability=None):
        self.durability = durability
        self._context = Context()
        self._context.init(args=[], domain_id=domain)
        self.node = Node('test_publisher', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        given = None if durability is None else QoSProfile(depth=1, durability=durability)
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, given or qos)
            for topic, (kind, qos) in TYPES.items()
        }
        self._clients = {}

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.shutdown()

    def request(self, kind, name, timeout, **fields):
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        assert client.wait_for_service(timeout_sec=PATIENCE), f'no service {name}'
        future = client.call_async(kind.Request(**fields))
        self._executor.spin_until_future_complete(future, timeout_sec=timeout)
        if future.done():
            return future.result()
        client.remove_pending_request(future)
        return None

    def publish(self, *cases):
        """Send messages by their names in ``CASES`` once there is a subscriber."""
        for case in cases:
            topic, make = CASES[case]
            publisher = self.publishers[topic]
            wait_until(publisher.get_subscription_count, lambda: f'{topic} has no subscriber')  # noqa: B023
            publisher.publish(make())

    def spin(self):
        """Run one callback that is due, or briefly wait for one."""
        self._executor.spin_once(timeout_sec=0.1)

    def spin_until(self, condition):
        """Run callbacks until a condition holds."""
        wait_until(lambda: self.spin() or condition(), pause=0.0)
