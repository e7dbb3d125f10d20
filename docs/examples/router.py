"""A zenoh router without zenohd: a Python session in router mode.

python router.py router.json5 [key=json ...], e.g. 'listen/endpoints=["tcp/127.0.0.1:7448"]'
"""

import signal
import sys

import zenoh

# this thread waits for the signal; zenoh's threads inherit the mask
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
config = zenoh.Config.from_file(sys.argv[1])
for change in sys.argv[2:]:
    key, _, value = change.partition("=")
    config.insert_json5(key, value)
with zenoh.open(config) as session:
    print(f"router {session.info.zid()} is up", flush=True)
    signal.sigwait({signal.SIGINT, signal.SIGTERM})
