"""Runs that are killed anywhere, continued, killed again: the result is that of a run that nothing interrupted."""
import random
import shutil
import signal
import subprocess
import time

from files import BAG, SMALL
from outcomes import Family
from program import run, tree

# They hold times, or digests of files that do.
TIMED = ("report.json", "report.html", "manifest.json")


def differing(a, b):
    return sorted(k for k in set(a) | set(b) if a.get(k) != b.get(k) and k not in TIMED)


def all_of(binary, work, count, seed):
    family = Family("killed and continued runs")
    rng = random.Random(seed)

    def command(out, *more):
        return [binary, "reconstruct", BAG, "--out", out, "--name", "t", *SMALL, *more]

    def killed(out, after, *more, by=signal.SIGKILL):
        child = subprocess.Popen(command(out, *more), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(after)
        child.send_signal(by)
        child.wait()

    shutil.rmtree(work / "kills", ignore_errors=True)
    first = run(command(work / "kills/whole"), seconds=300, memory_mb=0)
    whole = tree(work / "kills/whole/t")
    family.add(first, "" if first.code in (0, 3) and whole else "no twin", "whole")
    for number in range(count):
        out = work / f"kills/{number}"
        by = rng.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
        killed(out, rng.uniform(0.05, 1.0) * first.seconds, by=by)
        if number % 3 == 2:
            killed(out, rng.uniform(0.05, 0.6) * first.seconds, "--resume")
        damaged = ""
        kept = [f for f in out.rglob("*") if f.is_file() and ".checkpoint" in str(f)] if out.exists() else []
        if number % 4 == 3 and kept:
            file = rng.choice(kept)
            damaged = file.name
            data = bytearray(file.read_bytes())
            file.write_bytes(data[: len(data) // 2] if number % 8 == 3 else b"\xff" * 16 + data[16:])
        ended = run(command(out, "--resume"), seconds=300, memory_mb=0)
        other = differing(whole, tree(out / "t")) if (out / "t").exists() else ["no result"]
        left = [p.name for p in out.iterdir() if p.name != "t"] if out.exists() else []
        wrong = f"differs in {other[:3]}" if other else f"left {left}" if left else ""
        family.add(ended, wrong, f"kill {number} by {by.name} {damaged}")
        if number == 0 and not wrong:
            again = run(command(out, "--resume"), seconds=300, memory_mb=0)
            family.add(again, "" if again.seconds < 0.5 * first.seconds and "finished" in again.text else "done again", "--resume of a finished run")
        shutil.rmtree(out, ignore_errors=True)
    return family
