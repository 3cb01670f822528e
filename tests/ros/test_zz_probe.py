import time, pytest
from ros.conftest import start_flow
from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder, Timeline
from std_srvs.srv import SetBool, Trigger

def call(node, name, **f):
    kind = SetBool if f else Trigger
    return node.request(kind, f'/lava/{name}', 5.0, **f)

def test_stamp(local):
    node = start_flow(local)
    print(call(node, 'pause', data=True).message)
    node.run_commands()
    for _ in range(50): node.spin()
    before = node.newest('height')['height']['stamp_ns']
    node.jump(node.now + 30.0)
    node.hear(); n=len(node.seen)
    print(call(node, 'save').message)
    node.hear()
    got=[(x['topic'], x.get('stamp_ns')) for x in node.seen[n:] if x.get('topic')]
    print(before, node.now, got)

def test_jump(local, tmp_path):
    node = start_flow(local, record=True, bag_directory='bag')
    node.run(10.0)
    print('now', node.now, node.worker.session.time)
    node.jump(9_990.0)
    for _ in range(30): node.spin()
    node.run(15.0)
    print('now', node.now, node.worker.session.time)
    print(call(node, 'record', data=False).message)
    print(node.log[-1500:])
    bag = BagReader(tmp_path/'bag')
    print(bag.start_ns, bag.end_ns)
    tl = Timeline(bag, Decoder(bag))
    print([(m.stamp_ns/1e9, m.time) for m in tl.moments])
    print('last run', [(m.stamp_ns/1e9, m.time) for m in tl.last_run])
    print([(m.topic, m.stamp_ns/1e9) for m in bag.messages(['/hazard'])])
