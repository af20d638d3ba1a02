"""An S3 server in memory, some of whose answers are refusals.

    python store_server.py SHARE SLOW

prints its port. Of the requests without the header `x-plain` the share SHARE is answered with 503, and the one
of number SLOW after two seconds. A GET of `/counts` says how many were refused and delayed.
"""

import itertools
import json
import random
import sys
import threading
import time

from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

SHARE, SLOW = float(sys.argv[1]), int(sys.argv[2])
APP = DomainDispatcherApplication(create_backend_app)
RANDOM, NUMBERS, LOCK = random.Random(7), itertools.count(), threading.Lock()
COUNTS = {"requests": 0, "refused": 0, "delayed": 0}


def faulty(environ, start_response):
    if environ["PATH_INFO"] == "/counts":
        body = json.dumps(COUNTS).encode()
        start_response("200 OK", [("Content-Length", str(len(body)))])
        return [body]
    if "HTTP_X_PLAIN" in environ:
        return APP(environ, start_response)
    with LOCK:
        number, refused = next(NUMBERS), RANDOM.random() < SHARE
        COUNTS["requests"] += 1
        COUNTS["refused"] += refused
        COUNTS["delayed"] += number == SLOW
    if number == SLOW:
        time.sleep(2)
    if refused:
        # The body is read, or the client finds its connection closed.
        environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
        start_response("503 Slow Down", [("Content-Type", "text/plain")])
        return [b"come later"]
    return APP(environ, start_response)


server = make_server("127.0.0.1", 0, faulty, threaded=True)
print(server.server_port, flush=True)
server.serve_forever()
