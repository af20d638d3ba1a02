"""An S3 server (moto) that fails: a share of its requests with 503, and one that answers late. Seeded.

    python eval/fleet/s3_server.py PORT [--fail 0.05] [--slow-at 40] [--slow-s 20] [--seed 0]

Requests of buckets (made by the trial itself) do not fail. SIGTERM ends it; it then prints its counts as JSON.
"""

import argparse
import json
import random
import signal
import sys
import threading
import time

from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import run_simple

BODY = b'<?xml version="1.0"?><Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>'


class Failing:
    """The application, behind a bad network."""

    def __init__(self, application, args):
        self.application, self.args = application, args
        self.random, self.lock = random.Random(args.seed), threading.Lock()
        self.counts = {"requests": 0, "failed": 0, "slow": 0}

    def __call__(self, environ, start_response):
        is_bucket = environ.get("PATH_INFO", "/").strip("/").count("/") == 0 and not environ.get("QUERY_STRING")
        with self.lock:
            self.counts["requests"] += 1
            fails = not is_bucket and self.random.random() < self.args.fail
            slow = self.counts["requests"] == self.args.slow_at
            self.counts["failed"] += fails
            self.counts["slow"] += slow
        if slow:
            time.sleep(self.args.slow_s)
        if fails:
            # The body of a put is read: the client would see a broken pipe before the answer.
            environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
            start_response("503 Slow Down", [("Content-Type", "application/xml"), ("Content-Length", str(len(BODY)))])
            return [BODY]
        return self.application(environ, start_response)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("port", type=int)
    parser.add_argument("--fail", type=float, default=0.05)
    parser.add_argument("--slow-at", type=int, default=40)
    parser.add_argument("--slow-s", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    failing = Failing(DomainDispatcherApplication(create_backend_app), args)

    def end(*_):
        print(json.dumps(failing.counts), flush=True)
        sys.stdout.flush()
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, end)
    run_simple("127.0.0.1", args.port, failing, threaded=True)


if __name__ == "__main__":
    main()
