"""The fleet with a fake program: every way in which a job or a worker can end.

usage: faults.py OUT
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

from support import FAKE, Killer, fleet, log, once_each, raylets, rows, started, until, write_rows

OUT = Path(sys.argv[1]).resolve()
os.environ["ARTITWIN_PROGRAM"] = str(FAKE)
# Workers have the environment of their raylet: one log for all.
os.environ["FAKE_LOG"] = str(OUT)


def place(name, **objects):
    """A folder with an input an object."""
    folder = OUT / name
    folder.mkdir()
    for key, value in objects.items():
        (folder / f"{key}.json").write_text(json.dumps({"of": f"{name}/{key}", **value}))
    return folder


def every_end_has_its_row(address):
    ends = {
        "good": {},
        "late": {"seconds": 4.0, "estimate": 0.1},
        "uncertain": {"degraded": True},
        "refused": {"refuse": "no depth topic"},
        "unreachable": {"lose": 2},
        "crashing": {"crash": 1, "memory_bytes": 300 << 20},
        "hanging": {"hang": 1, "no_estimate": 1},
        "lost": {"lose": 99},
    }
    folder = place("ends", **ends, **{f"quick{k}": {} for k in range(12)})
    values = [{"name": name, "inputs": f"{name}.json"} for name in [*ends, *(f"quick{k}" for k in range(12))]]
    values += [{"name": "gone", "inputs": ["gone.json"]}, {"name": "odd", "inputs": "good.json", "options": "--unknown"}]
    values += [{"name": "good", "inputs": "good.json"}]
    write_rows(folder / "objects.jsonl", values)
    call = ("--objects", folder / "objects.jsonl", "--out", folder / "out", "--address", address)
    said = fleet(*call, "--retries", 3, "--limit", 6, code=1)
    found = rows(folder / "out")
    assert len(found) == len(values) - 1, sorted(found)
    status = {name: row["status"] for name, row in found.items() if not name.startswith("quick")}
    assert status == {
        "good": "done",
        "late": "done",
        "uncertain": "degraded",
        "refused": "refused",
        "unreachable": "done",
        "crashing": "done",
        "hanging": "done",
        "lost": "failed",
        "gone": "refused",
        "odd": "refused",
    }, (status, said)
    retries = {name: row["retries"] for name, row in found.items() if row["retries"]}
    assert retries == {"unreachable": 2, "crashing": 1, "hanging": 1, "lost": 3}, retries
    assert found["refused"]["message"] == "no depth topic" and found["refused"]["exit_code"] == 1
    assert "is not there" in found["gone"]["message"] and "--unknown" in found["odd"]["message"]
    assert found["lost"]["exit_code"] == 75 and found["crashing"]["lost"] == ["ended by signal 9"]
    assert found["uncertain"]["warnings"] == ["twin_differs"] and found["uncertain"]["exit_code"] == 3
    (joint,) = found["good"]["joints"]
    assert (joint["type"], joint["axis"], joint["origin_std_mm"]) == ("revolute", [0, 0, 1], None), joint
    assert found["good"]["parts"] == 2 and found["good"]["version"] == "fake-1"
    # Two rows with one key are one job.
    assert sum(what == "end" and key == found["good"]["key"] for what, key, *_ in log(OUT)) == 1
    assert "late: straggler" in said, said
    once_each(log(OUT))
    page = (folder / "out/fleet.html").read_text()
    assert f"{found['good']['key']}/good/preview/thumbnail.png" in page and "no depth topic" in page
    return folder, values, call


def a_second_call_does_what_changed(folder, values, call):
    values = [value for value in values if value["name"] not in ("lost", "gone", "odd")]
    write_rows(folder / "objects.jsonl", values)
    before = log(OUT)
    fleet(*call, code=3)
    assert log(OUT) == before, "a second call worked"
    found = rows(folder / "out")
    assert all(row["standing"] and row["attempts"] == 0 for row in found.values()), found
    changed = [{**v, "options": "--set a=1"} if v["name"] == "quick3" else v for v in values]
    write_rows(folder / "objects.jsonl", changed)
    fleet(*call, code=3)
    new = {key for _, key, *_ in log(OUT)[len(before) :]}
    found = rows(folder / "out")
    assert new == {found["quick3"]["key"]} and not found["quick3"]["standing"], new
    # Of another order is the same work.
    write_rows(folder / "objects.jsonl", changed[::-1])
    before = log(OUT)
    fleet(*call, code=3)
    assert log(OUT) == before


def killed_workers_leave_no_second_writer(cluster):
    folder = place("killed", **{f"object{k:02}": {"seconds": 0.5} for k in range(16)})
    before = len(log(OUT))
    killer = Killer(cluster, kills=5, mean_s=1.0)
    process = started("--objects", f"{folder}/*.json", "--out", folder / "out", "--address", cluster.address)
    killer.start()
    _, said = process.communicate(timeout=300)
    killer.over.set()
    assert process.returncode == 0, (process.returncode, said)
    found = rows(folder / "out")
    assert killer.killed >= 3 and len(found) == 16 and len(once_each(log(OUT)[before:])) == 16
    assert sum(row["retries"] for row in found.values()) == killer.killed, (killer.killed, said)
    for name, row in found.items():
        twin = folder / "out" / row["key"] / name / "twin.urdf"
        assert twin.read_bytes() == (folder / f"{name}.json").read_bytes()


def stopped_and_called_again(address):
    folder = place("stopped", **{f"object{k}": {"seconds": 1.0} for k in range(8)})
    call = ("--objects", f"{folder}/*.json", "--out", folder / "out", "--address", address)
    first = len(log(OUT))
    process = started(*call)
    until(lambda: sum(what == "end" for what, *_ in log(OUT)[first:]) >= 2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, (process.returncode, said)
    before = log(OUT)
    time.sleep(1.0)
    assert log(OUT) == before, "jobs go on after Ctrl-C"
    states = [row["status"] for row in rows(folder / "out").values()]
    assert len(states) == 8 and set(states) == {"done", "stopped"}, states
    fleet(*call, code=0)
    assert all(row["status"] == "done" for row in rows(folder / "out").values())
    assert len(once_each(log(OUT)[first:])) == 8


def machines_that_drift(address):
    folder = place("machines", twin={})
    values = []
    for machine in range(6):
        for week in range(5):
            # m2 drifts from the third week on; m4's last log alone names something; m5's logs say nothing once.
            drifts = machine == 2 and week >= 2 or machine == 4 and week == 4 or machine == 5 and week in (1, 3, 4)
            value = 0.1 + 0.1 * week
            finding = {
                "joint": "door",
                "effect": "viscous_friction",
                "weight": 0.99,
                "parameters": [
                    {"name": "damping", "value": value, "unit": "N m s/rad", "interval": [value - 0.02, value + 0.02]}
                ],
                "alternatives": [],
            }
            verdict = "insufficient" if machine == 5 and week == 2 else "named" if drifts else "none"
            name = f"m{machine}w{week}"
            log_ = {"verdict": verdict, "findings": [finding] if drifts else [], "seconds": 0.05, "n": name}
            (folder / f"{name}.json").write_text(json.dumps(log_))
            time_ = f"2026-0{week + 1}-01T00:00:00Z"
            values.append({"twin": "twin.json", "runs": f"{name}.json", "machine": f"m{machine}", "time": time_})
    write_rows(folder / "logs.jsonl", values)
    call = ("--command", "diagnose", "--objects", folder / "logs.jsonl", "--out", folder / "out", "--address", address)
    fleet(*call, code=0)
    from pyarrow import parquet

    found = {row["machine"]: row for row in parquet.read_table(folder / "out/machines.parquet").to_pylist()}
    assert sorted(found) == ["m2", "m4", "m5"], sorted(found)
    month = lambda seconds: time.gmtime(seconds).tm_mon
    assert month(found["m2"]["since"]) == 3 and month(found["m2"]["after"]) == 2 and found["m2"]["has_grown"]
    assert found["m2"]["doubts"] == [] and found["m4"]["doubts"] == ["one log alone names it"]
    assert month(found["m5"]["since"]) == 2 and found["m5"]["silent"] == 1
    assert [point["value"] for point in found["m2"]["points"]] == [0.1 + 0.1 * week for week in (2, 3, 4)]
    page = (folder / "out/machines.html").read_text()
    assert "2026-03-01" in page and "<svg" in page and "viscous friction" in page


def main():
    with raylets(2) as cluster:
        state = every_end_has_its_row(cluster.address)
        a_second_call_does_what_changed(*state)
        killed_workers_leave_no_second_writer(cluster)
        stopped_and_called_again(cluster.address)
        machines_that_drift(cluster.address)


if __name__ == "__main__":
    main()
