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

"""Copy the readable messages of a bag that was cut off or damaged into a new bag.

The command leaves out the damaged parts of the bag and prints where they are. The new bag is
complete.
"""

import argparse

from lava_ros.bag.reader import BagReader
from lava_ros.bag.recovery import recover
from lava_ros.cli.options import add_options
from lava_ros.cli.output import in_terminal
from lava_ros.errors import LavaError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_options(parser, 'bag')
    parser.add_argument('output', help='directory of the new bag, which must not exist')


def run(args: argparse.Namespace) -> int:
    """Recover the bag that the arguments name."""
    source = BagReader(args.bag)
    try:
        with in_terminal() as progress:
            count = recover(source, args.output, on_progress=progress)
    except OSError as error:
        raise LavaError('output', args.output, f'a place that can be written ({error})') from error
    whole = BagReader(args.output)
    print(f'{count} messages copied to {args.output}')
    for topic in sorted(whole.topics.values(), key=lambda item: item.name):
        print(f'{topic.count:8}  {topic.name}')
    seconds = ((whole.end_ns or 0) - (whole.start_ns or 0)) / 1e9
    state = 'had been cut off' if source.recovered else 'was whole'
    if source.damage:
        state = f'was damaged in {len(source.damage)} places'
    print(f'{seconds:.3f} s of recording; the bag {state}')
    return 0
