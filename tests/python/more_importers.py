"""Loads model folders in importers that are too large or too exclusive for the tests' environment, and compares counts.

    python3 more_importers.py --work DIR FOLDER...

A folder is a run's: it holds NAME.urdf, NAME.xml, NAME.usda, model.sdf and report.json. For every importer a virtual environment
with pinned packages is made under `--work` (several GB in all) the first time. libsdformat needs Debian's libsdformat-dev
and a C++ compiler. Prints a Markdown table; exit code 1 if a count differs from the report's.
"""

import argparse
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

ENVIRONMENTS = {
    "mujoco 3.1.6": ["mujoco==3.1.6"],
    "mujoco 3.3.7": ["mujoco==3.3.7"],
    "sapien 3.0.3": ["sapien==3.0.3", "setuptools<81"],
    "newton 1.8.0": ["newton[sim,importers]==1.8.0"],
    "urdf-usd-converter 0.3.4": ["urdf-usd-converter==0.3.4", "omniverse-asset-validator==1.18.0"],
}

MUJOCO = """
import json, mujoco, sys
for path in (f"{sys.argv[2]}.xml", f"{sys.argv[2]}.urdf"):
    m = mujoco.MjModel.from_xml_path(f"{sys.argv[1]}/{path}")
    found = {"links": m.nbody - 1, "joints": m.njnt, "solids": int((m.geom_contype > 0).sum()), "mass": float(m.body_mass.sum()),
             "limits": {m.joint(j).name: [float(x) for x in m.jnt_range[j]] for j in range(m.njnt)}}
    if path.endswith("xml"):
        found["textures"] = m.ntex
    print(json.dumps({path.split(".")[-1]: found}))
"""

# Visuals need a Vulkan device that SAPIEN accepts; physics does not.
SAPIEN = """
import json, sys, xml.etree.ElementTree as ET, pathlib
import sapien, sapien.physx
source = pathlib.Path(sys.argv[1]) / f"{sys.argv[2]}.urdf"
tree = ET.parse(source)
for link in tree.getroot().iter("link"):
    for visual in link.findall("visual"):
        link.remove(visual)
bare = source.with_suffix(".bare.urdf")
tree.write(bare)
try:
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    loader.load_multiple_collisions_from_file = False
    a = loader.load(str(bare))
finally:
    bare.unlink()
joints = a.get_active_joints()
print(json.dumps({"urdf": {"links": len(a.get_links()), "joints": len(joints), "mass": sum(l.get_mass() for l in a.get_links()),
    "solids": sum(len(l.get_collision_shapes()) for l in a.get_links()),
    "limits": {j.name: [float(x) for x in j.get_limits()[0]] for j in joints}}}))
"""

NEWTON = """
import json, sys
import newton
for kind in ("urdf", "usda"):
    b = newton.ModelBuilder()
    path = f"{sys.argv[1]}/{sys.argv[2]}.{kind}"
    b.add_urdf(path, floating=False) if kind == "urdf" else b.add_usd(path)
    m = b.finalize(device="cpu")
    lower, upper = m.joint_limit_lower.numpy().tolist(), m.joint_limit_upper.numpy().tolist()
    print(json.dumps({kind: {"links": m.body_count, "joints": m.joint_dof_count, "mass": float(m.body_mass.numpy().sum()),
        "solids": sum(1 for f in m.shape_flags.numpy().tolist() if f & int(newton.ShapeFlags.COLLIDE_SHAPES)),
        "limits": {str(i): list(l) for i, l in enumerate(zip(lower, upper))}}}))
"""

CONVERTER = """
import json, math, pathlib, sys, tempfile
import urdf_usd_converter
from pxr import Usd, UsdPhysics
out = tempfile.mkdtemp()
asset = urdf_usd_converter.Converter().convert(f"{sys.argv[1]}/{sys.argv[2]}.urdf", out)
def found(stage):
    prims = list(stage.Traverse(Usd.TraverseInstanceProxies()))
    limits = {}
    for p in prims:
        for kind, scale in ((UsdPhysics.RevoluteJoint, math.pi / 180), (UsdPhysics.PrismaticJoint, 1)):
            if p.IsA(kind):
                limits[p.GetName()] = [kind(p).GetLowerLimitAttr().Get() * scale, kind(p).GetUpperLimitAttr().Get() * scale]
    return {"links": sum(p.HasAPI(UsdPhysics.RigidBodyAPI) for p in prims), "joints": len(limits), "limits": limits,
            "solids": sum(p.HasAPI(UsdPhysics.CollisionAPI) for p in prims),
            "mass": sum(UsdPhysics.MassAPI(p).GetMassAttr().Get() for p in prims if p.HasAPI(UsdPhysics.MassAPI))}
print(json.dumps({"converted": found(Usd.Stage.Open(asset.path))}))
import omni.asset_validator as validator
engine = validator.ValidationEngine()
issues = engine.validate(f"{sys.argv[1]}/{sys.argv[2]}.usda").issues()
kinds = {}
for i in issues:
    name = i.rule.__name__ if i.rule else "?"
    kinds.setdefault(f"{i.severity.name} {name}", []).append(i.message)
print(json.dumps({"validator": {k: len(v) for k, v in kinds.items()}}))
"""

SDFORMAT = r"""
#include <iostream>
#include <sdf/sdf.hh>
int main(int, char **argv) {
  sdf::Root root;
  auto errors = root.Load(argv[1]);
  for (const auto &e : errors) std::cerr << e.Message() << "\n";
  const auto *m = root.Model();
  if (!errors.empty() || !m) return 1;
  double mass = 0; size_t solids = 0;
  for (size_t i = 0; i < m->LinkCount(); ++i) { mass += m->LinkByIndex(i)->Inertial().MassMatrix().Mass(); solids += m->LinkByIndex(i)->CollisionCount(); }
  std::cout.precision(12);
  std::cout << "{\"sdf\": {\"links\": " << m->LinkCount() << ", \"mass\": " << mass << ", \"solids\": " << solids << ", \"limits\": {";
  size_t moving = 0;
  for (size_t i = 0; i < m->JointCount(); ++i) {
    const auto *j = m->JointByIndex(i);
    if (j->Type() == sdf::JointType::FIXED) continue;
    std::cout << (moving++ ? ", " : "") << "\"" << j->Name() << "\": [" << j->Axis()->Lower() << ", " << j->Axis()->Upper() << "]";
  }
  std::cout << "}, \"joints\": " << moving << "}}\n";
}
"""

SCRIPTS = {"mujoco 3.1.6": MUJOCO, "mujoco 3.3.7": MUJOCO, "sapien 3.0.3": SAPIEN, "newton 1.8.0": NEWTON, "urdf-usd-converter 0.3.4": CONVERTER}


def environment(work, name):
    folder = work / re.sub(r"[^a-z0-9]+", "-", name)
    if not (folder / "complete").exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        subprocess.run([folder / "bin/pip", "install", "--quiet", *ENVIRONMENTS[name]], check=True)
        (folder / "complete").touch()
    return folder / "bin/python"


def sdformat(work):
    program = work / "count_sdf"
    flags = subprocess.run(["sh", "-c", "pkg-config --cflags --libs $(pkg-config --list-all | grep -o '^sdformat[0-9]*' | tail -1)"],
                           capture_output=True, text=True, check=True).stdout.split()
    (work / "count_sdf.cc").write_text(SDFORMAT)
    subprocess.run(["g++", "-O1", "-std=c++17", work / "count_sdf.cc", "-o", program, *flags], check=True)
    return program


def expected(folder, name):
    """What the URDF itself says."""
    root = ET.parse(folder / f"{name}.urdf").getroot()
    moving = [j for j in root.findall("joint") if j.get("type") != "fixed"]
    return {
        "links": len(root.findall("link")), "joints": len(moving), "solids": len(list(root.iter("collision"))),
        "mass": sum(float(m.get("value")) for m in root.iter("mass")),
        "limits": {j.get("name"): [float(j.find("limit").get(k)) for k in ("lower", "upper")] for j in moving},
    }


def differences(found, wanted):
    """Counts that differ. A world-fixed root may be merged into the world: one link less, and its mass gone."""
    wrong = [f"{k} {found[k]}, not {wanted[k]}" for k in ("joints", "solids") if k in found and found[k] != wanted[k]]
    if found["links"] not in (wanted["links"], wanted["links"] - 1):
        wrong.append(f"links {found['links']}, not {wanted['links']}")
    if found["links"] == wanted["links"] and abs(found["mass"] / wanted["mass"] - 1) > 1e-4:
        wrong.append(f"mass {found['mass']:.4f}, not {wanted['mass']:.4f}")
    limits = sorted(map(tuple, found["limits"].values()))
    if any(abs(a - b) > 1e-4 for f, w in zip(limits, sorted(map(tuple, wanted["limits"].values()))) for a, b in zip(f, w)):
        wrong.append(f"limits {limits}")
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--only", nargs="+", default=[*SCRIPTS, "libsdformat"])
    parser.add_argument("folders", nargs="+", type=Path)
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    failed = False
    print("| importer | file | " + " | ".join(f.resolve().name for f in arguments.folders) + " |\n|---" * 1 + "|---" * (1 + len(arguments.folders)) + "|")
    for importer in arguments.only:
        rows = {}
        for folder in arguments.folders:
            folder = folder.resolve()
            wanted = expected(folder, folder.name)
            if importer == "libsdformat":
                command = [sdformat(arguments.work), folder / "model.sdf"]
            else:
                command = [environment(arguments.work, importer), "-c", SCRIPTS[importer], folder, folder.name]
            ended = subprocess.run([str(c) for c in command], capture_output=True, text=True)
            lines = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("{")]
            found = {k: v for line in lines for k, v in line.items()}
            if ended.returncode:
                rows.setdefault("error", {})[folder.name] = (ended.stderr.strip().splitlines() or ["?"])[-1][:120]
                failed = True
            for kind, counts in found.items():
                if kind == "validator":
                    rows.setdefault(kind, {})[folder.name] = "; ".join(f"{n} {k}" for k, n in counts.items()) or "no finding"
                    continue
                wrong = differences(counts, wanted)
                failed |= bool(wrong)
                rows.setdefault(kind, {})[folder.name] = "; ".join(wrong) or f"{counts['joints']} joints, {counts['solids']} solids"
        for kind, cells in rows.items():
            print(f"| {importer} | {kind} | " + " | ".join(cells.get(f.resolve().name, "") for f in arguments.folders) + " |", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
