"""What belongs to the user: results, notes, links, other folders. Nothing of it may be changed or lost."""
import os
import shutil
import subprocess

from inputs import ROOT
from joint_logs import log
import mcap_file
from outcomes import Family
from program import run, tree

SMALL = ["--preset", "preview", "--set", "surface.nodes=64", "--set", "surface.points=3000"]
BAG = ROOT / "bags/drawer"


def all_of(binary, work):
    family = Family("files of the user")
    runs = work / "runs"
    shutil.rmtree(work / "runs", ignore_errors=True)

    def reconstruct(out, *more, name="drawer", stdout=None):
        return run([binary, "reconstruct", BAG, "--out", out, "--name", name, *SMALL, *more], seconds=300, memory_mb=0, stdout=stdout)

    def untouched(what, folder, before, ended, codes=(1, 2)):
        same = folder.exists() and tree(folder) == before
        family.add(ended, "" if same and ended.code in codes else f"exit code {ended.code}, {'kept' if same else 'CHANGED'}", what)

    made = reconstruct(runs)
    family.add(made, "" if made.code in (0, 3) else "no twin", "a first run")
    twin = runs / "drawer"
    logs = [mcap_file.write(work / f"drawn{k}/drawn{k}.mcap", log(("joint_1",))).parent for k in range(3)]
    before = tree(twin)
    untouched("synth --out TWIN", twin, before, run([binary, "synth", "--out", twin, "--seed", "1", "--views", "4"], seconds=120))
    untouched("diagnose --out TWIN", twin, before, run([binary, "diagnose", twin / "drawer.urdf", *logs, "--out", twin], seconds=120))
    above = run([binary, "diagnose", twin / "drawer.urdf", *logs, "--out", runs, "--force"], seconds=120)
    untouched("diagnose --force --out above the twin", twin, before, above)
    (twin / "notes.txt").write_text("the hinge squeaks\n")
    before = tree(twin)
    untouched("reconstruct over notes", twin, before, reconstruct(runs))
    (twin / "notes.txt").unlink()
    urdf = twin / "drawer.urdf"
    urdf.write_text(urdf.read_text() + "<!-- tuned by hand -->\n")
    before = tree(twin)
    untouched("reconstruct over an edited URDF", twin, before, reconstruct(runs))
    ended = reconstruct(runs, "--force")
    kept = [p for p in runs.iterdir() if ".bak" in p.name]
    family.add(ended, "" if len(kept) == 1 and tree(kept[0]) == before and twin.exists() else "the edited twin is lost", "reconstruct --force")
    ended = reconstruct(runs)
    family.add(ended, "" if ended.code in (0, 3) else "an unchanged own folder is not replaced", "reconstruct again")

    victim, folder = work / "victim", work / "victims"
    for name in ("lock", "capture.ckpt"):
        victim.write_text("precious")
        out = work / f"link_{name}"
        shutil.rmtree(out, ignore_errors=True)
        (out / ".artitwin-drawer.checkpoint").mkdir(parents=True)
        os.symlink(victim, out / ".artitwin-drawer.checkpoint" / name)
        ended = reconstruct(out)
        kept = victim.exists() and victim.read_text() == "precious"
        family.add(ended, "" if kept else "the target of a planted link is lost", f"{name} is a link")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "keep").write_text("x")
    for name in (".artitwin-drawer.checkpoint", "drawer", "drawer_rejected"):
        out = work / "link_folder"
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        os.symlink(folder, out / name)
        ended = reconstruct(out)
        family.add(ended, "" if [p.name for p in folder.iterdir()] == ["keep"] else "the folder behind a link was changed", f"{name} is a link")

    with open("/dev/full", "wb") as full:
        for command in (["inspect", BAG], ["check", twin], ["config", "show"], ["doctor"]):
            ended = run([binary, *command], stdout=full)
            family.add(ended, "" if ended.code not in (0, None) and ended.err else "a full device is not reported", f"{command[0]} > /dev/full")
        ended = reconstruct(work / "full", "--json", stdout=full)
        family.add(ended, "" if ended.code not in (0, 3, None) else "a full device is not reported", "reconstruct --json > /dev/full")
    small_disk(family, work, reconstruct)
    return family


def small_disk(family, work, reconstruct):
    """File systems that cannot hold a result: one is refused before the work, one fills up at its end."""
    disk = work / "disk"
    disk.mkdir(exist_ok=True)
    for size, before_work in (("1m", True), ("3m", False)):
        mounted = ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", disk]
        if os.geteuid() != 0 or subprocess.run(mounted, capture_output=True).returncode:
            print("skipped: no small file system can be mounted here")
            return
        try:
            ended = reconstruct(disk)
            late = before_work and ended.seconds > 1
            family.add(ended, "noticed late" if late else "" if ended.code == 1 else f"exit code {ended.code}", f"a disk of {size}")
            # Finished stages are kept for --resume.
            left = [p.name for p in disk.iterdir() if before_work or ".checkpoint" not in p.name]
            family.check(not left, f"a disk of {size} is left with {left}")
        finally:
            subprocess.run(["umount", disk], check=False)
