# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava bag recover`: a complete bag of the readable messages of another."""

import argparse
import sys

from lava_ros.cli.console import Progress
from lava_ros.cli.options import command, output_option
from lava_ros.errors import refusing


@command(
    'bag', output_option('DIR', 'directory of the new bag, which must not exist', required=True),
)
def recover(args: argparse.Namespace) -> int:
    """Copy the readable messages of a bag that was cut off or damaged into a new bag.

    The command leaves out the damaged parts of the bag and prints where they are. The new bag is
    complete. The exit status is 0 if all messages before the end of the bag are copied, also if it
    was cut off, and 1 if the bag is damaged or no message can be read.
    """
    from lava_ros.bag.reader import BagReader
    from lava_ros.bag.recovery import recover as recover_bag

    source = BagReader(args.bag)
    place = refusing('--output', args.output, 'a writable folder', OSError)
    with place, Progress(has_lines=False) as progress:
        count = recover_bag(source, args.output, on_progress=progress.show)
    whole = BagReader(args.output)
    print(f'{count} messages copied to {args.output}')
    for topic in sorted(whole.topics.values(), key=lambda item: item.name):
        print(f'{topic.count:8}  {topic.name}')
    state = 'had been cut off' if source.recovered else 'was complete'
    if source.damage:
        state = f'was damaged (warnings: {len(source.damage)})'
    print(f'{whole.duration_ns / 1e9:.3f} s of recording; the bag {state}')
    if not count:
        print(f'lava bag recover: no message of {args.bag} can be read', file=sys.stderr)
    return 0 if count else 1
