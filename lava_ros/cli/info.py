# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava bag info`: the contents of a bag."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from typing import Any, TYPE_CHECKING

from lava_ros.cli.console import table_lines, with_units, write_json
from lava_ros.cli.options import command
from lava_ros.errors import LavaError
from lava_ros.simulation.carriers import count_key, COUNTED

if TYPE_CHECKING:
    from lava_ros.bag.mcap_file import McapFile
    from lava_ros.bag.reader import BagReader


#: Parts of the custom data that are parsed.
_READ = ('scene', 'effects', 'resumed_from')


@command('bag', '--node', '--json')
def info(args: argparse.Namespace) -> int:
    """Print what a bag contains.

    The command prints the scene, the topics and the state of a bag. It reads a bag whose recording
    was cut off up to the last complete message, and then exits with status 1, as for a damaged
    bag.
    """
    from lava_ros.bag.reader import BagReader

    bag = BagReader(args.bag)
    refused: list[LavaError] = []
    data = _as_dict(bag, args.node, refused.append)
    if args.json is None:
        print('\n'.join(_lines(bag, data, refused)))
    else:
        write_json(data, args.json)
    bag.warn_if_cut_off()
    return 0


def _as_dict(
    bag: BagReader, node: str | None, on_refused: Callable[[LavaError], object]
) -> dict[str, Any]:
    from lava_ros.bag.checkpoints import checkpoints_of
    from lava_ros.bag.description import described
    from lava_ros.scene.erupting_lava import EruptingLava

    def parts(item: BagReader | McapFile, *names: str) -> dict[str, Any]:
        return {name: getattr(item, name) for name in names}

    span = ('start_ns', 'end_ns', 'message_count')
    known = described(bag.custom_data)
    lava = EruptingLava.described(known['scene'])
    return {
        'path': str(bag.path),
        'files': [
            {
                'name': item.path.name, 'size_bytes': item.size,
                **parts(item, 'finished', *span),
            }
            for item in bag.contents
        ],
        'size_bytes': bag.size,
        'finished': not bag.recovered,
        **parts(bag, *span),
        'damage': list(bag.damage),
        'duration_s': bag.duration_ns / 1e9,
        'topics': [
            {
                'name': topic.name,
                'type': topic.message_type,
                'type_hash': topic.schema.type_hash,
                'count': topic.count,
                'qos': topic.qos.to_dict(),
            }
            for topic in bag.topics.values()
        ],
        **_simulation(bag, node),
        'checkpoints': with_units(
            [
                {
                    'time': item.time, 'log_time_ns': item.log_time_ns, 'method': item.method,
                    count_key(item.method): item.particle_count, 'size': item.size,
                }
                for item in checkpoints_of(bag.path, on_refused)
            ],
            s='time', bytes='size',
        ),
        'erupting_lava': None if lava is None else lava.as_dict(),
        'scene': known['scene'],
        **with_units({name: known[name] for name in ('effects', 'resumed_from')}, s='time'),
        'custom_data': bag.custom_data,
    }


def _simulation(bag: BagReader, node: str | None) -> dict[str, Any]:
    """Return the nodes, and simulated time [s], volumes [m3] and warnings of the only one."""
    from lava_ros.bag.decoding import Decoder
    from lava_ros.bag.recorded_node import last_moments
    from lava_ros.products.run_warnings import error_of_moment, warnings_of_moments

    try:
        moments = last_moments(bag, Decoder(bag), node)
    except LavaError:
        if node is not None:
            raise
        # only decoding needs this library
        moments = []
    found: dict[str, Any] = {'nodes': [item.node for item in moments], 'simulation': None}
    if len(moments) == 1:
        moment = moments[0]
        names = [name for name in moment.values if name.startswith('volume_')]
        found['simulation'] = {
            'simulated_time_s': moment.time,
            **{name: moment.number(name) for name in names},
            'numerical_error': error_of_moment(moment),
            'warnings': warnings_of_moments([moment]),
        }
    return found


def _lines(bag: BagReader, data: dict[str, Any], refused: list[LavaError]) -> list[str]:
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.simulation.output.budget import VolumeBudget

    lines = [f'bag        {bag.path}', f'files      {len(bag.files)}, {format_size(bag.size)}']
    if len(bag.files) > 1:
        lines += [_file_line(item, bag.start_ns or 0) for item in bag.contents]
    state = 'cut off' if bag.recovered else 'finished'
    if bag.damage:
        state += f'; damaged (warnings: {len(bag.damage)})'
    elif bag.recovered:
        state += '; everything before that is there'
    lines.append(f'recording  {state}')
    if bag.start_ns is not None:
        lines.append(f'start      {_moment(bag.start_ns)}')
        lines.append(f'duration   {data["duration_s"]:.3f} s')
    lines.append(f'messages   {bag.message_count}')
    if (resumed := data['resumed_from']) is not None:
        lines.append(f'resumed    at {resumed["time_s"]:.3f} s simulated, from {resumed["bag"]}')
    if data['nodes']:
        several = '; --node shows one of them' if len(data['nodes']) > 1 else ''
        lines.append(f'nodes      {", ".join(data["nodes"])}{several}')
    if (simulation := data['simulation']) is not None:
        lines.append(f'simulated  {simulation["simulated_time_s"]:.3f} s')
        budget = VolumeBudget.from_texts(simulation)
        if budget is not None:
            lines += ['volumes', *(f'  {name:30} {value}' for name, value in budget.rows())]
        lines += [f'  warning: {item}' for item in simulation['warnings']]
    if (lava := EruptingLava.described(data['scene'])) is not None:
        lines.append(f'lava       {lava.text()}')
    if bag.topics:
        rows = [('topic', 'type', 'count', 'reliability', 'durability')]
        for topic in bag.topics.values():
            name, count, qos = topic.name, str(topic.count), topic.qos
            rows.append((name, topic.message_type, count, qos.reliability, qos.durability))
        lines += ['', *table_lines(rows, '<<<<<')]
    lines += _checkpoint_lines(data['checkpoints'], refused)
    if data['scene'] is not None:
        lines += ['', 'scene', *_scene_lines(data['scene'])]
    if data['effects'] is not None:
        lines += ['', 'effects']
        for index, entry in enumerate(data['effects']):
            lines += [f'  changed at {entry["time_s"]:.1f} s'] if index else []
            lines += [f'  {name:16} {text}' for name, text in entry['effects'].items()]
    rest = [
        f'  {key}: {_short(item)}'
        for key, item in sorted(bag.custom_data.items())
        if key not in _READ or data[key] is None
    ]
    return [*lines, '', 'custom data', *rest] if rest else lines


def format_size(size: int) -> str:
    """Format a number of bytes."""
    from rich import filesize

    return filesize.decimal(size)


def _file_line(file: McapFile, start_ns: int) -> str:
    words = [f'  {file.path.name}', format_size(file.size)]
    if file.start_ns is not None and file.end_ns is not None:
        first, last = ((item - start_ns) / 1e9 for item in (file.start_ns, file.end_ns))
        words.append(f'{first:.3f} to {last:.3f} s')
    words.append(f'{file.message_count} messages')
    return ', '.join(words) + ('' if file.finished else ', cut off')


def _checkpoint_lines(stored: list[dict[str, Any]], refused: list[LavaError]) -> list[str]:
    lines = [f'  cannot be read: {item}' for item in refused]
    if not stored:
        return ['', 'checkpoints  none that can be read', *lines] if refused else []
    total, newest = format_size(sum(item['size_bytes'] for item in stored)), stored[-1]
    method = newest['method']
    return [
        '', f'checkpoints  {len(stored)}, {total}; resume takes the newest', *lines,
        f'  at {newest["time_s"]:.3f} s simulated, {_moment(newest["log_time_ns"])}, '
        f'{newest[count_key(method)]} {COUNTED[method]}',
    ]


def _scene_lines(scene: Mapping[str, Any]) -> list[str]:
    lines = []
    for name, value in scene.items():
        if name == 'vents' and isinstance(value, list):
            lines += [f'  vents: {len(value)}', *(f'    {_inline(item)}' for item in value)]
        else:
            lines.append(f'  {name}: {_inline(value)}')
    return lines


def _inline(value: object) -> str:
    if isinstance(value, Mapping):
        return ', '.join(f'{key} {_inline(item)}' for key, item in value.items())
    if isinstance(value, list):
        return f'[{", ".join(_inline(item) for item in value)}]'
    # to 0.1 mm in coordinates of 100 km, and of 10,000 km
    digits = 10 if isinstance(value, float) and abs(value) < 1e6 else 12
    return f'{value:.{digits}g}' if isinstance(value, float) else str(value)


def _short(text: str) -> str:
    line = ' '.join(text.split())
    return line if len(line) <= 72 else f'{line[:69]}...'


def _moment(time_ns: int) -> str:
    """Format a date or, for a simulated clock that starts near 0, seconds."""
    seconds = time_ns / 1e9
    if seconds < 1e9:
        return f'{seconds:.3f} s'
    return datetime.fromtimestamp(seconds, timezone.utc).isoformat(timespec='milliseconds')
