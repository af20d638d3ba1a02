"""What the fleet must show, at full size: objects on raylets, of which one is killed in the middle, as are workers at random moments.

    python eval/fleet/trial.py --out DIR [--program PATH | --fake SECONDS] [--objects 60] [--bags BAG...] [--raylets 3] [--kills 10]
        [--store folder|s3] [--fail 0.05] [--slow-s 20] [--plain 8] [--options "--preset preview"]

Makes objects with `synth`, adds one that must be refused, runs the fleet, checks every file, calls it again, changes one row, compares with the plain
command, and prints a verdict table; exit code 1 where a verdict is no. With --store s3 inputs and results are in moto's server (`s3_server.py`), of
whose requests a share fails. What is made or plain-run is kept in DIR; the fleet's own part goes on where it was stopped with --resume (in a folder: moto forgets), and begins
anew without. Wall time is held against the ideal: the jobs' own seconds over the slots that lived. For a quiet machine.
"""

import argparse
import atexit
import json
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from common import add_program, fleet, keep, objects, timed, use_program

WITHIN = 0.15
"""By how much the wall time may exceed the ideal (issue 28)."""
BUCKET = "trial"


class Verdicts:
    """Lines of the table."""

    def __init__(self):
        self.lines = []

    def add(self, what, holds, figure=""):
        self.lines.append((what, bool(holds), figure))
        print(f"  {'yes' if holds else 'NO '} {what} {figure}", flush=True)

    def table(self):
        return "| what | holds | figure |\n|---|---|---|\n" + "".join(
            f"| {what} | {'yes' if holds else 'NO'} | {figure} |\n" for what, holds, figure in self.lines
        )


def server(args):
    """The S3 server, started; None for a folder."""
    if args.store != "s3":
        return None
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    os.environ |= {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ACCESS_KEY_ID": "trial",
        "AWS_SECRET_ACCESS_KEY": "trial",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
    }
    own = [sys.executable, Path(__file__).with_name("s3_server.py"), str(port), f"--fail={args.fail}", f"--slow-s={args.slow_s}"]
    with open(args.out / "server.log", "w") as log:
        process = subprocess.Popen(own, stdout=subprocess.PIPE, stderr=log, text=True)
    # Where the trial fails, too.
    atexit.register(process.kill)
    for _ in range(200):
        with socket.socket() as try_:
            if try_.connect_ex(("127.0.0.1", port)) == 0:
                return process
        time.sleep(0.1)
    raise SystemExit("the S3 server did not start")


def upload(paths):
    """Copies objects to the bucket; gives their URIs."""
    import boto3
    from botocore.config import Config

    client = boto3.client("s3", endpoint_url=os.environ["AWS_ENDPOINT_URL"], config=Config(retries={"max_attempts": 20}))
    client.create_bucket(Bucket=BUCKET)
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                client.put_object(Bucket=BUCKET, Key=f"in/{file.relative_to(path.parent)}", Body=file.read_bytes())
    return [f"s3://{BUCKET}/in/{path.name}" for path in paths]


def table(args, inputs, changed=None):
    """The rows: all objects, and one without a depth topic."""
    values = [{"name": Path(str(uri)).stem, "inputs": str(uri)} for uri in inputs]
    if args.fake:
        refused = args.out / "inputs/refused.json"
        refused.write_text(json.dumps({"refuse": "no depth topic"}))
        values.append({"name": "no_depth", "inputs": str(refused)})
    else:
        values.append({"name": "no_depth", "inputs": str(inputs[0]), "options": "--topic depth=/none"})
    if changed is not None:
        values[changed]["options"] = "--seed 1"
    path = args.out / "objects.jsonl"
    path.write_text("".join(json.dumps(value) + "\n" for value in values))
    return path


def disturbed(args, call, out):
    """The run with its kills; seconds, slot seconds that were there, exit code, kills."""
    from support import Killer, raylets, whole_keys

    with raylets(args.raylets) as cluster:
        address = ["--address", cluster.address]
        start = time.monotonic()
        process = subprocess.Popen([str(part) for part in [*call, *address, "--", *shlex.split(args.options)]])
        # Kills are spread over the run, which takes about as long as the jobs over the slots.
        killer = Killer(cluster, args.kills, mean_s=max(0.5, args.mean_s * args.objects / args.raylets / (args.kills + 2)))
        killer.start()
        node_at = None
        while process.poll() is None:
            if node_at is None and args.raylets > 1 and len(whole_keys(out)) >= args.objects / 2:
                cluster.others[0].kill_raylet()
                node_at = time.monotonic() - start
            time.sleep(0.5)
        seconds = time.monotonic() - start
        killer.over.set()
        slots = args.raylets * seconds - ((seconds - node_at) if node_at else 0.0)
        return seconds, slots, process.returncode, killer.killed, node_at


def run(args):
    from support import as_plain, rows_of, whole

    program = use_program(args)
    os.environ["FAKE_LOG"] = str(args.out)
    verdicts = Verdicts()
    paths = [*objects(args, args.out / "inputs", args.objects - len(args.bags)), *args.bags]
    s3 = server(args)
    out = f"s3://{BUCKET}/out" if s3 else f"file://{args.out}/store"
    if not args.resume:
        shutil.rmtree(args.out / "store", ignore_errors=True)
        (args.out / "log").unlink(missing_ok=True)
    inputs = paths if s3 is None or args.fake else upload(paths)
    if s3 and args.fake:
        upload([])
    call = fleet("--objects", table(args, inputs), "--out", out, "--cores", "1")
    seconds, slots, code, killed, node_at = disturbed(args, call, out)
    found = rows_of(out)
    ends = Counter(row["status"] for name, row in found.items() if name != "no_depth")
    verdicts.add(
        "every object ended, with a twin or a refusal",
        set(ends) <= {"done", "degraded", "refused"} and ends["done"] + ends["degraded"] > 0,
        ", ".join(f"{count} {status}" for status, count in sorted(ends.items())),
    )
    verdicts.add(
        "the refused one says why, exit code 3",
        code == 3 and found["no_depth"]["status"] == "refused",
        found["no_depth"]["message"],
    )
    verdicts.add("a raylet was killed in the middle", args.raylets < 2 or node_at, f"at {node_at or 0:.0f} of {seconds:.0f} s")
    retries = sum(row["retries"] for row in found.values())
    verdicts.add("workers were killed at random moments", killed >= args.kills, f"{killed}; {retries} jobs tried again")
    manifests = whole(out)
    once = len(manifests) == len(found) and all(row["attempts"] <= 1 + len(row["lost"]) for row in found.values())
    verdicts.add("every object exactly once, every file whole", once, f"{len(manifests)} manifests")
    own = sum(row["seconds"] or 0.0 for row in found.values())
    within = own / slots
    verdicts.add(
        f"wall time within {100 * WITHIN:.0f} % of the ideal",
        within >= 1.0 / (1.0 + WITHIN),
        f"{seconds:.0f} s; the jobs' own {own:.0f} s are {100 * within:.1f} % of {slots:.0f} slot seconds",
    )
    more = [*call, "--", *shlex.split(args.options)]
    took, _ = timed(more)
    stood = all(row["standing"] for row in rows_of(out).values())
    verdicts.add("a second call does no work", stood and whole(out).keys() == manifests.keys(), f"{took:.1f} s")
    timed(fleet("--objects", table(args, inputs, changed=0), "--out", out, "--cores", "1", "--", *shlex.split(args.options)))
    new = whole(out).keys() - manifests.keys()
    verdicts.add("a changed row alone is done again", len(new) == 1, f"{len(new)} new")
    if not args.fake:
        compare(args, program, paths, found, manifests, verdicts, as_plain)
    if s3:
        s3.send_signal(signal.SIGTERM)
        counts = json.loads(s3.communicate(timeout=30)[0])
        verdicts.add("requests failed, and were sent again", counts["failed"] > 0, f"{counts['failed']} of {counts['requests']}")
    keep(args.out / "trial.json", {"seconds": seconds, "job_seconds": own, "slot_seconds": slots, "retries": retries})
    return verdicts


def compare(args, program, paths, found, manifests, verdicts, as_plain):
    """Holds results and refusals against the plain command, those of lost jobs first. A run of it leaves its exit
    code in a file, and is not done again where that is there."""
    by_loss = sorted(paths, key=lambda path: -len(found[path.stem]["lost"]))[: args.plain]
    folder = args.out / "plain"
    folder.mkdir(exist_ok=True)
    wrong = []
    for path in by_loss:
        row, ended = found[path.stem], folder / f"{path.stem}.exit"
        if not ended.exists():
            plain = [program, "reconstruct", "--out", folder, "--name", path.stem, *shlex.split(args.options), path]
            env = {**os.environ, "RAYON_NUM_THREADS": "1"}
            code = subprocess.run([str(part) for part in plain], env=env, capture_output=True, check=False).returncode
            ended.write_text(f"{code}\n")
        code = int(ended.read_text())
        try:
            assert row["status"] == {0: "done", 3: "degraded", 1: "refused", 2: "refused"}.get(code), f"{row['status']}, plain exit code {code}"
            if code in (0, 3):
                as_plain(manifests[row["key"]], folder / path.stem)
        except AssertionError as error:
            wrong.append(f"{path.stem}: {error}")
    verdicts.add(
        "ends and bytes are those of the plain command",
        not wrong,
        f"{len(by_loss)} compared, but for report and times; {'; '.join(wrong)}",
    )


def main():
    parser = argparse.ArgumentParser()
    add_program(parser)
    parser.add_argument("--objects", type=int, default=60, help="with --bags in all")
    parser.add_argument("--bags", type=lambda text: Path(text).resolve(), nargs="*", default=[])
    parser.add_argument("--raylets", type=int, default=3)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--mean-s", type=float, help="seconds of a job, to spread the kills [--fake's, else 30]")
    parser.add_argument("--store", choices=("folder", "s3"), default="folder")
    parser.add_argument("--fail", type=float, default=0.05)
    parser.add_argument("--slow-s", type=float, default=20.0)
    parser.add_argument("--plain", type=int, default=8, help="objects that are compared with the plain command")
    parser.add_argument("--resume", action="store_true")
    args = parser.parse_args()
    args.mean_s = args.mean_s or args.fake or 30.0
    verdicts = run(args)
    print(verdicts.table())
    (args.out / "verdicts.md").write_text(verdicts.table())
    return 0 if all(holds for _, holds, _ in verdicts.lines) else 1


if __name__ == "__main__":
    sys.exit(main())
