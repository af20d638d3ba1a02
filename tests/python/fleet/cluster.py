"""Six small recordings and a refused one on two raylets, of which one is killed, as is a worker.

usage: cluster.py PROGRAM OUT
"""

import os
import subprocess
import sys
import time
from pathlib import Path

from support import Killer, as_plain, fleet, raylets, rows, started, until, whole, write_rows

PROGRAM, OUT = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
os.environ["ARTITWIN_PROGRAM"] = str(PROGRAM)
# Coarse, so that each takes 4 to 6 s of a core; what the twins are worth is no matter here.
OPTIONS = ["--preset", "preview", "--set", "surface.nodes=56", "--set", "model.collision.max_solids=8", "--parts", "2"]
OBJECTS = [("lamp", 4), ("lamp", 5), ("cabinet", 4), ("cabinet", 5), ("capped_box", 4), ("capped_box", 6)]


def make():
    """The recordings, and their table."""
    values = []
    for family, seed in OBJECTS:
        name = f"{family}_{seed}"
        size = ["--views", "6", "--width", "160", "--height", "120"]
        made = ["synth", "--out", OUT / name, "--seed", str(seed), "--parts", "2", "--family", family, *size]
        subprocess.run([PROGRAM, *made], check=True, stdout=subprocess.DEVNULL)
        values.append({"name": name, "inputs": name})
    values.append({"name": "no_depth", "inputs": values[0]["inputs"], "options": "--topic depth=/none"})
    write_rows(OUT / "objects.jsonl", values)
    return values


def times(folder):
    """When each file of the results was written, but for the tables."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("fleet."))
    return {path: path.stat().st_mtime_ns for path in files}


def main():
    values = make()
    call = ["--objects", OUT / "objects.jsonl", "--out", OUT / "out", "--scratch", OUT / "scratch"]
    with raylets(2) as cluster:
        call += ["--address", cluster.address]
        killer = Killer(cluster, kills=1, mean_s=4.0)
        process = started(*call, "--", *OPTIONS)
        killer.start()
        until(lambda: len(list((OUT / "out").glob("*.json"))) >= 3 or process.poll() is not None, 150)
        cluster.others[0].kill_raylet()
        _, said = process.communicate(timeout=300)
        killer.over.set()
        assert process.returncode == 3, (process.returncode, said)
        found = rows(OUT / "out")
        assert {row["status"] for name, row in found.items() if name != "no_depth"} <= {"done", "degraded"}, said
        assert found["no_depth"]["status"] == "refused" and "/none" in found["no_depth"]["message"], found["no_depth"]
        assert killer.killed == 1 and sum(row["retries"] for row in found.values()) >= 1, said
        assert all(row["attempts"] == 1 + len(row["lost"]) for row in found.values()), found
        manifests = whole(f"file://{OUT}/out")
        assert sorted(manifests) == sorted(row["key"] for row in found.values()) and len(manifests) == 7
        assert all(row["parts"] == 2 and len(row["joints"]) == 1 for name, row in found.items() if name != "no_depth")

        # Again: no work.
        before, start = times(OUT / "out"), time.monotonic()
        fleet(*call, "--", *OPTIONS, code=3)
        assert times(OUT / "out") == before and all(row["standing"] for row in rows(OUT / "out").values())
        print(f"second call {time.monotonic() - start:.1f} s")

        # A changed setting: one object.
        values[0]["options"] = "--seed 1"
        write_rows(OUT / "objects.jsonl", values)
        fleet(*call, "--", *OPTIONS, code=3)
        after = times(OUT / "out")
        assert {path: at for path, at in after.items() if path in before} == before
        assert len(list((OUT / "out").glob("*.json"))) == 8

    # One that was lost and begun again, and one that was not, are those of the plain command.
    lost = [name for name, row in found.items() if row["lost"]][:1]
    other = [name for name, row in found.items() if not row["lost"] and name != "no_depth"][:1]
    for name in lost + other:
        plain = ["reconstruct", "--out", OUT / "plain", "--name", name, *OPTIONS, OUT / name]
        subprocess.run([PROGRAM, *plain], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
        as_plain(manifests[found[name]["key"]], OUT / "plain" / name)
    print(f"as the plain command: {', '.join(lost + other)}; retries {sum(row['retries'] for row in found.values())}")


if __name__ == "__main__":
    main()
