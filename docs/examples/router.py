"""A zenoh router where zenohd is not at hand: a Python session in router mode.

python router.py router.json5 [key=json ...], e.g. 'listen/endpoints=["tcp/127.0.0.1:7448"]'
"""

import signal
import sys

import zenoh

# wait here for the end, in this thread: zenoh's own inherit the mask
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
config = zenoh.Config.from_file(sys.argv[1])
for change in sys.argv[2:]:
    key, _, value = change.partition("=")
    config.insert_json5(key, value)
with zenoh.open(config) as session:
    print(f"router {session.info.zid()} is up", flush=True)
    signal.sigwait({signal.SIGINT, signal.SIGTERM})
