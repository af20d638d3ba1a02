"""URDFs that no simulator should get, and names that are markup."""
import shutil
from xml.etree import ElementTree

import mcap_file
from joint_logs import TWIN, joint, link, log, robot
from outcomes import Family
from program import run

ORIGIN = "<parent"
WRONG = {
    "a loop beside the root": robot(link("z"), link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")),
    "a joint that hangs on itself": robot(link("z"), link("a"), joint("j", "a", "a")),
    "two links of one name": robot(link("a"), link("a"), link("b"), joint("j", "a", "b")),
    "two joints on one link": robot(link("a"), link("b"), joint("j", "a", "b"), joint("k", "a", "b")),
    "a mass that is nan": TWIN.replace('mass value="1"', 'mass value="nan"', 1),
    "a negative mass": TWIN.replace('mass value="1"', 'mass value="-1"', 1),
    "a negative inertia": TWIN.replace('ixx="1" iyy="1" izz="1"', 'ixx="-1" iyy="-1" izz="-1"', 1),
    "an axis that is nan": TWIN.replace('axis xyz="0 0 1"', 'axis xyz="nan 0 1"'),
    "an axis that is zero": TWIN.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'),
    "an origin that is infinite": TWIN.replace(ORIGIN, '<origin xyz="nan inf 0" rpy="nan 0 0"/>' + ORIGIN),
    "damping that is nan": TWIN.replace(ORIGIN, '<dynamics damping="nan" friction="inf"/>' + ORIGIN),
    "negative friction": TWIN.replace(ORIGIN, '<dynamics damping="0" friction="-5"/>' + ORIGIN),
    "limits that are nan": TWIN.replace('lower="-1" upper="1"', 'lower="nan" upper="inf"'),
    "limits the wrong way round": TWIN.replace('lower="-1" upper="1"', 'lower="1" upper="-1"'),
}


def refused(binary, work):
    """Each is an error for `check`, and for `diagnose` before it fits."""
    family = Family("URDFs that are wrong, `check` and `diagnose`")
    folder = work / "wrong"
    runs = [mcap_file.write(work / f"log{k}/log{k}.mcap", log()).parent for k in range(3)]
    for name, text in WRONG.items():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / "t.urdf").write_text(text)
        ended = run([binary, "check", folder])
        family.add(ended, "" if ended.code == 1 else "check lets it pass", f"check, {name}")
        out = work / "wrong_diagnosis"
        shutil.rmtree(out, ignore_errors=True)
        ended = run([binary, "diagnose", folder / "t.urdf", *runs, "--out", out, "--effects", "viscous_friction"])
        family.add(ended, "" if ended.code == 1 else "diagnose takes it", f"diagnose, {name}")
    return family


def names(binary, work):
    """A joint whose name is markup keeps its name in what `diagnose` writes, and adds nothing."""
    family = Family("names that are markup, `diagnose`")
    escapes = {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"}
    for name in ('j"/><joint name="injected" type="slide', "a&b", "a<b>", "it's", "</robot>"):
        twin = work / "named.urdf"
        twin.write_text(TWIN.replace('name="j"', f'name="{"".join(escapes.get(c, c) for c in name)}"'))
        runs = [mcap_file.write(work / f"named{k}/named{k}.mcap", log((name,))).parent for k in range(3)]
        out = work / "named_diagnosis"
        shutil.rmtree(out, ignore_errors=True)
        ended = run([binary, "diagnose", twin, *runs, "--out", out, "--effects", "viscous_friction"])
        family.add(ended, "" if ended.code in (0, 1, 2, 3) else f"exit code {ended.code}", name)
        for file in sorted(out.glob("*")):
            if file.suffix in (".urdf", ".xml", ".sdf"):
                try:
                    found = [j.get("name") for j in ElementTree.parse(file).iter("joint")]
                except ElementTree.ParseError as error:
                    found = [str(error)]
                family.check(found == [name], f"{file.name} of a joint called {name!r} holds {found}")
    return family
