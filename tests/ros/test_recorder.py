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

"""The recorder: one bag after the other, and errors that do not end the node."""

import pytest
from std_msgs.msg import String

from lava_ros.bag import BagReader
from lava_ros.errors import LavaError
from lava_ros.layers import Qos
from lava_ros.ros import codec, qos
from lava_ros.ros.recorder import Recorder

PROFILE = qos.bag_profile(Qos())


def _write(recorder, text, stamp_ns=1):
    data = codec.serialise(String(data=text))
    recorder.write('/words', 'std_msgs/msg/String', data, stamp_ns, qos=PROFILE)
    return data


def test_records_what_it_is_given(tmp_path):
    """The bytes in the bag are the bytes that were handed over, with QoS and description."""
    recorder = Recorder()
    assert recorder.status.state == 'off'
    recorder.arm(tmp_path / 'bag')
    assert recorder.status.state == 'armed'
    _write(recorder, 'too early')
    recorder.begin({'scene': 'old'})
    assert recorder.status.state == 'recording'
    data = _write(recorder, 'word', 42)
    recorder.describe({'scene': 'new'})
    recorder.flush()
    recorder.stop()
    recorder.stop()
    assert (recorder.status.state, recorder.status.messages) == ('off', 1)
    bag = BagReader(tmp_path / 'bag')
    (message,) = bag.messages()
    assert bytes(message.data) == data
    assert bag.custom_data == {'scene': 'new'}
    (topic,) = bag.topics.values()
    assert topic.qos.durability == 'transient_local'


def test_one_bag_at_a_time(tmp_path):
    """An existing folder and a second recording are refused."""
    recorder = Recorder()
    with pytest.raises(LavaError, match='does not exist yet'):
        recorder.arm(tmp_path)
    recorder.arm(tmp_path / 'one')
    with pytest.raises(LavaError, match='one recording at a time'):
        recorder.arm(tmp_path / 'two')
    recorder.stop()
    recorder.arm(tmp_path / 'two')


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    """What is known at once is refused; an error at the bag's opening is a status."""
    (tmp_path / 'file').write_text('')
    recorder = Recorder()
    for name in ('file/bag', 300 * 'x', ''):
        with pytest.raises(LavaError, match='bag_directory'):
            recorder.arm(tmp_path / name)
    recorder.arm(tmp_path / 'later' / 'bag')
    (tmp_path / 'later').write_text('')
    recorder.begin({})
    assert recorder.status.state == 'off'
    assert 'cannot record to' in recorder.status.error


@pytest.mark.parametrize('step', ['write', 'flush'])
def test_a_full_disk_stops_the_recording(tmp_path, monkeypatch, step):
    """When a write fails, the recording ends and says why; writing on does nothing."""
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag')
    recorder.begin({})
    _write(recorder, 'kept')
    recorder.flush()

    def fail(*_args, **_options):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(recorder._writer, step, fail)
    _write(recorder, 'lost', 2)
    recorder.flush()
    assert recorder.status.state == 'off'
    assert 'No space left on device' in recorder.status.error
    _write(recorder, 'ignored', 3)
    assert [message.topic for message in BagReader(tmp_path / 'bag').messages()][:1] == ['/words']
    recorder.arm(tmp_path / 'next')
    assert recorder.status.error == ''


def test_a_bag_is_split(tmp_path):
    """With a limit the recording goes on in new files, which the status counts."""
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag', max_duration=10.0)
    recorder.begin({'scene': 'Etna'})
    for second in range(25):
        _write(recorder, f'word {second}', second * 10**9)
        recorder.flush()
    assert recorder.status.files == 3
    assert recorder.status.messages == 25
    recorder.stop()
    assert len(BagReader(tmp_path / 'bag').files) == 3
    recorder.arm(tmp_path / 'next')
    assert (recorder.status.files, recorder.status.messages) == (0, 0)
