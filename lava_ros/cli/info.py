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

"""`lava info`: say what a bag holds."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from datetime import datetime, timezone
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from lava_ros.errors import LavaError
from lava_ros.yaml_files import parse_yaml

if TYPE_CHECKING:
    from lava_ros.bag.reader import BagFile, BagReader, Topic

# Custom data of this name describes the scene, as scene_to_dict gives it, in YAML or JSON.
_SCENE = 'scene'

# Which effects were on from when on, a list in JSON; see ros/scene_recording.py.
_EFFECTS = 'effects'

# Bag, simulated time and ROS time of the checkpoint that the recorded simulation has gone on from,
# in JSON.
_RESUMED = 'resumed_from'

_SHOWN_CHECKPOINTS = 5


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'info',
        help='say what a bag holds',
        description='Print the scene, the topics and the state of a bag. Bags whose recording '
        'was cut off are read up to the last whole message.',
    )
    parser.add_argument('bag', help='bag directory or .mcap file')
    parser.add_argument('--json', metavar='FILE', help='write it as JSON instead, - for stdout')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Describe the bag that the arguments name.

    Raises:
        LavaError: The bag cannot be read, or the JSON file not written.
    """
    from lava_ros.bag.reader import BagReader

    bag = BagReader(args.bag)
    if args.json is None:
        print('\n'.join(_lines(bag)))
        return 0
    text = json.dumps(_as_dict(bag), indent=2, ensure_ascii=False)
    if args.json == '-':
        print(text)
        return 0
    try:
        Path(args.json).write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise LavaError('--json', args.json, f'a file that can be written ({error})') from error
    return 0


def _as_dict(bag: BagReader) -> dict[str, Any]:
    from lava_ros.bag.checkpoints import checkpoints_of

    return {
        'path': str(bag.path),
        'files': [
            {
                'name': item.path.name,
                'size': item.size,
                'finished': item.finished,
                'start_ns': item.start_ns,
                'end_ns': item.end_ns,
                'message_count': item.message_count,
            }
            for item in bag.describe_files()
        ],
        'size': bag.size,
        'recovered': bag.recovered,
        'damage': list(bag.damage),
        'start_ns': bag.start_ns,
        'end_ns': bag.end_ns,
        'duration': bag.duration_ns / 1e9,
        'message_count': bag.message_count,
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
        'simulation': _simulation(bag),
        'resumed_from': _resumed(bag.custom_data),
        'checkpoints': [item._asdict() for item in checkpoints_of(bag.path)],
        'scene': _scene(bag.custom_data),
        'effects': _effects(bag.custom_data),
        'custom_data': bag.custom_data,
    }


def _lines(bag: BagReader) -> list[str]:
    lines = [f'bag        {bag.path}']
    lines.append(f'files      {len(bag.files)}, {_size(bag.size)}')
    if len(bag.files) > 1:
        lines += [_file_line(item, bag.start_ns or 0) for item in bag.describe_files()]
    state = 'cut off; everything before that is there' if bag.recovered else 'finished'
    if bag.damage:
        state = f'{state.split(";")[0]}; damaged in {len(bag.damage)} places'
    lines.append(f'recording  {state}')
    if bag.start_ns is not None:
        lines.append(f'start      {_moment(bag.start_ns)}')
        lines.append(f'duration   {bag.duration_ns / 1e9:.3f} s')
    count = bag.message_count
    lines.append(f'messages   {"unknown" if count is None else count}')
    resumed = _resumed(bag.custom_data)
    if resumed is not None:
        lines.append(f'resumed    at {resumed["time"]:.3f} s simulated, from {resumed["bag"]}')
    lines += _simulation_lines(bag)
    lines += _topic_lines(list(bag.topics.values()))
    lines += _checkpoint_lines(bag)
    scene = _scene(bag.custom_data)
    if scene is not None:
        lines += ['', 'scene', *_scene_lines(scene)]
    effects = _effects(bag.custom_data)
    if effects is not None:
        lines += ['', 'effects', *_effect_lines(effects)]
    shown = {_SCENE: scene, _EFFECTS: effects, _RESUMED: resumed}
    rest = {
        key: value
        for key, value in sorted(bag.custom_data.items())
        if shown.get(key) is None
    }
    if rest:
        lines += ['', 'custom data', *(f'  {key}: {_short(item)}' for key, item in rest.items())]
    return lines


def _simulation(bag: BagReader) -> dict[str, float] | None:
    """What the node said last: simulated time [s], volumes [m3] and their error."""
    from lava_ros.bag.decoding import Decoder
    from lava_ros.timeline import last_moment

    try:
        moment = last_moment(bag, Decoder(bag))
    except LavaError:
        # Decoding takes a library that the rest does without.
        return None
    if moment is None:
        return None
    names = [name for name in moment.values if name.startswith('volume_')]
    return {'time': moment.time, **{name: moment.number(name) for name in names}}


def _simulation_lines(bag: BagReader) -> list[str]:
    said = _simulation(bag)
    if said is None:
        return []
    volumes = [
        f'{name[len("volume_") : -len("_m3")]} {value:,.1f} m3'
        for name, value in said.items()
        if name.endswith('_m3')
    ]
    lines = [f'simulated  {said["time"]:.3f} s']
    lines += [f'volumes    {", ".join(volumes)}'] if volumes else []
    if 'volume_error' in said:
        lines.append(f'error      {said["volume_error"]:.1e} of the emitted volume')
    return lines


def _file_line(file: BagFile, start_ns: int) -> str:
    words = [f'  {file.path.name}', _size(file.size)]
    if file.start_ns is not None and file.end_ns is not None:
        first, last = ((item - start_ns) / 1e9 for item in (file.start_ns, file.end_ns))
        words.append(f'{first:.3f} to {last:.3f} s')
    if file.message_count is not None:
        words.append(f'{file.message_count} messages')
    return ', '.join(words) + ('' if file.finished else ', cut off')


def _topic_lines(topics: list[Topic]) -> list[str]:
    if not topics:
        return []
    rows = [('topic', 'type', 'count', 'reliability', 'durability')]
    for topic in topics:
        count = 'unknown' if topic.count is None else str(topic.count)
        qos = topic.qos
        rows.append((topic.name, topic.message_type, count, qos.reliability, qos.durability))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        '',
        *(
            '  '.join(item.ljust(width) for item, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ),
    ]


def _checkpoint_lines(bag: BagReader) -> list[str]:
    """The newest checkpoints, each a moment that `lava node --resume` can go on from."""
    from lava_ros.bag.checkpoints import checkpoints_of

    refused: list[LavaError] = []
    stored = checkpoints_of(bag.path, refused.append)
    lines = [f'  cannot be read: {item}' for item in refused]
    if not stored:
        return ['', 'checkpoints  none that can be read', *lines] if refused else []
    total = _size(sum(item.size for item in stored))
    lines = ['', f'checkpoints  {len(stored)}, {total}; resume takes the newest', *lines]
    if len(stored) > _SHOWN_CHECKPOINTS:
        lines.append(f'  {len(stored) - _SHOWN_CHECKPOINTS} older ones')
    for item in stored[-_SHOWN_CHECKPOINTS:]:
        lines.append(
            f'  at {item.time:.3f} s simulated, {_moment(item.log_time_ns)}, '
            f'{item.particle_count} particles, {_size(item.size)}'
        )
    return lines


def _scene(custom_data: Mapping[str, str]) -> dict[str, Any] | None:
    """The scene as plain data, None when the bag has none that reads as a mapping."""
    try:
        scene = parse_yaml('scene', custom_data.get(_SCENE, ''))
    except LavaError:
        return None
    return scene if isinstance(scene, dict) else None


def _scene_lines(scene: Mapping[str, Any]) -> list[str]:
    lines = []
    for name, value in scene.items():
        if name == 'vents' and isinstance(value, list):
            lines.append(f'  vents: {len(value)}')
            lines += [f'    {_inline(item)}' for item in value]
        else:
            lines.append(f'  {name}: {_inline(value)}')
    return lines


def _resumed(custom_data: Mapping[str, str]) -> dict[str, Any] | None:
    """What the bag has gone on from, None for one that began at time 0 or does not say."""
    try:
        origin = json.loads(custom_data.get(_RESUMED, ''))
    except ValueError:
        return None
    is_origin = (
        isinstance(origin, dict)
        and isinstance(origin.get('bag'), str)
        and isinstance(origin.get('time'), int | float)
    )
    return origin if is_origin else None


def _effects(custom_data: Mapping[str, str]) -> list[dict[str, Any]] | None:
    """The changes of effects, None when the bag has no list that can be read."""
    try:
        entries = json.loads(custom_data.get(_EFFECTS, ''))
    except ValueError:
        return None
    if not isinstance(entries, list) or not all(_is_change(item) for item in entries):
        return None
    return entries


def _is_change(entry: object) -> bool:
    return (
        isinstance(entry, Mapping)
        and isinstance(entry.get('time'), int | float)
        and isinstance(entry.get('effects'), Mapping)
    )


def _effect_lines(entries: list[dict[str, Any]]) -> list[str]:
    """All effects at the start, then what went on or off."""
    lines = []
    for index, entry in enumerate(entries):
        if index:
            lines.append(f'  changed at {entry["time"]:.1f} s')
        lines += [f'  {name:16} {text}' for name, text in entry['effects'].items()]
    return lines


def _inline(value: object) -> str:
    if isinstance(value, Mapping):
        return ', '.join(f'{key} {_inline(item)}' for key, item in value.items())
    if isinstance(value, list):
        return f'[{", ".join(_inline(item) for item in value)}]'
    return f'{value:g}' if isinstance(value, float) and abs(value) < 1e6 else str(value)


def _short(text: str) -> str:
    line = ' '.join(text.split())
    return line if len(line) <= 72 else f'{line[:69]}...'


def _size(size: int) -> str:
    for power, unit in ((9, 'GB'), (6, 'MB'), (3, 'kB')):
        if size >= 10**power:
            return f'{size / 10**power:.1f} {unit}'
    return f'{size} bytes'


def _moment(time_ns: int) -> str:
    """Wall time, or seconds when the time is a simulation's that starts near 0."""
    seconds = time_ns / 1e9
    if seconds < 1e9:
        return f'{seconds:.3f} s'
    return datetime.fromtimestamp(seconds, timezone.utc).isoformat(timespec='milliseconds')
