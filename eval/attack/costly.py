"""Small inputs of large cost: each must end by itself, soon, in bounded memory, with a message that names what is too large."""
import os
import shutil
import struct
import zlib

import inputs
import mcap_file
from joint_logs import TWIN, joint, link, log, robot
from outcomes import Family
from program import run

MEMORY_MB, SECONDS = 1500, 20


def png_chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, depth, color, raw=b"", more=b""):
    head = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", head) + more + png_chunk(b"IDAT", zlib.compress(raw, 9)) + png_chunk(b"IEND", b"")


def deflated(data):
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(data) + packer.flush()


def overlapping_zip(blob, size, count):
    """A zip whose directory names one member many times."""
    local = b"PK\x03\x04" + struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 0, 0, len(blob), size, 1, 0) + b"a" + blob
    entry = b"PK\x01\x02" + struct.pack("<HHHHHHIIIHHHHHII", 20, 20, 0, 8, 0, 0, 0, len(blob), size, 1, 0, 0, 0, 0, 0, 0) + b"a"
    return local + entry * count + b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, count, count, len(entry) * count, len(local), 0)


def pickled_array(data):
    head = "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }"
    head += " " * (63 - (10 + len(head)) % 64) + "\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(head)) + head.encode() + data


def cloned_dtype():
    """One dtype of 20 MB, used by 400 arrays."""
    size = 20 << 20
    dtype = b"cnumpy\ndtype\nX" + struct.pack("<I", size) + b"f" * size + b"\x85R"
    dtype += b"(K\x03X\x01\0\0\0<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tbq\x01"
    one = b"cnumpy.core.multiarray\n_reconstruct\n)R(K\x01K\x01\x85h\x01\x89C\0tb"
    return pickled_array(b"\x80\x03" + dtype + b"]" + (b"(" + one + b"e") * 400 + b".")


def zstd_chunks(count, size):
    """Chunks of zeros that hold one record of an unknown kind."""
    import zstandard

    plain = b"\x80" + struct.pack("<Q", size - 9) + bytes(size - 9)
    packed = zstandard.compress(plain, 1)
    body = bytes(16) + struct.pack("<Q", size) + bytes(4) + mcap_file.text("zstd") + struct.pack("<Q", len(packed)) + packed
    return mcap_file.record(6, body) * count


class Costly:
    """The cases, each a folder that `with_...` spoils and the command that reads it."""

    def __init__(self, binary, work):
        self.binary, self.work = binary, work
        self.family = Family("small inputs of large cost")
        self.log = mcap_file.write(work / "costly_log/log.mcap", log()).parent
        self.sound = mcap_file.read(inputs.ROOT / "bags/drawer/state0/state0.mcap")

    def ends(self, name, *args, codes=(1, 2), said="", memory_mb=MEMORY_MB):
        ended = run([self.binary, *args], seconds=90, memory_mb=6000)
        wrong = ""
        if ended.code not in codes:
            wrong = f"exit code {ended.code}"
        elif said and said not in ended.text:
            wrong = f"does not say `{said}`"
        elif ended.memory_mb > memory_mb:
            wrong = f"took {ended.memory_mb:.0f} MB"
        elif ended.seconds > SECONDS:
            wrong = f"took {ended.seconds:.0f} s"
        self.family.add(ended, wrong, name)
        print(f"  {name}: {ended.code}, {ended.seconds:.1f} s, {ended.memory_mb:.0f} MB", flush=True)

    def dataset(self):
        return inputs.dataset(self.work / "costly")

    def reconstruct(self, folder):
        small = ["--preset", "preview", "--set", "surface.nodes=32", "--name", "x"]
        shutil.rmtree(self.work / "out", ignore_errors=True)
        return ["reconstruct", folder, "--out", self.work / "out", *small]

    def bag(self, messages, more=b""):
        folder = self.work / "costly_bag"
        shutil.rmtree(folder, ignore_errors=True)
        mcap_file.write(folder / "state0/state0.mcap", messages, more)
        shutil.copytree(inputs.ROOT / "bags/drawer/state1", folder / "state1")
        return folder

    def matches(self):
        name = "correspondence_loftr/no_filter/src_0_00_tgt_all_top30.npz"
        size = 255 << 20
        folder = self.dataset()
        (folder / name).write_bytes(overlapping_zip(deflated(bytes(size)), size, 60))
        self.ends("npz that names one member 60 times", *self.reconstruct(folder))
        folder = self.dataset()
        array = cloned_dtype()
        (folder / name).write_bytes(overlapping_zip(deflated(array), len(array), 1))
        self.ends("pickle with a dtype of 20 MB, 400 times", *self.reconstruct(folder))

    def images(self):
        bombs = {
            "PNG with a profile of 500 MB": png(32, 24, 8, 2, bytes(24 * 97), png_chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(500 << 20), 9))),
            "PNG with a text of 200 MB": png(32, 24, 8, 2, bytes(24 * 97), png_chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(200 << 20), 9))),
            "PNG of 60000 x 60000": png(60000, 60000, 8, 2),
            "PNG of 2^31 x 2^31": png(2**31 - 1, 2**31 - 1, 16, 6),
        }
        for name, data in bombs.items():
            folder = self.dataset()
            for file in (folder / "color_segmented").iterdir():
                file.write_bytes(data)
            # What is beside the pixels may be left out as well as refused; this dataset is too small for a twin.
            self.ends(name, *self.reconstruct(folder))
        folder = self.dataset()
        (folder / "cam_K.txt").write_text("9000 0 4096\n0 9000 4096\n0 0 1\n")
        for part, bits, color, row in (("color_segmented", 8, 2, 8192 * 3), ("depth_filtered", 16, 0, 8192 * 2), ("mask", 8, 0, 8192)):
            data = png(8192, 8192, bits, color, (b"\0" + b"\3" * row) * 8192)
            for state in (0, 1):
                for view in range(3):
                    (folder / part / f"{state}_{view:02d}.png").write_bytes(data)
        # Within what the settings allow frames to take; sixty are not.
        self.ends("six views of 8192 x 8192", *self.reconstruct(folder), codes=(0, 1, 2, 3), memory_mb=4500)
        first = (folder / "init_keyframes.yml").read_text()
        more = ""
        for state in (0, 1):
            for view in range(3, 30):
                name = f"{state}_{view:02d}"
                for part in ("color_segmented", "depth_filtered", "mask"):
                    os.link(folder / part / f"{state}_00.png", folder / part / f"{name}.png")
                pose = [1, 0, 0, 0.1 * view, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
                more += f"frame_{name}:\n  cam_in_ob: {pose}\n  time: {float(state)}\n"
        (folder / "init_keyframes.yml").write_text(first + more)
        self.ends("sixty views of 8192 x 8192", *self.reconstruct(folder))

    def bags(self):
        for field, begin in (("name", b""), ("encoding", mcap_file.text("a")), ("text", mcap_file.text("a") + mcap_file.text("ros2msg"))):
            broken = mcap_file.record(3, struct.pack("<H", 9) + begin + struct.pack("<I", 2**32 - 1) + b"x" * 40)
            folder = self.bag(self.sound, broken)
            self.ends(f"schema whose {field} is 4 GiB long", "inspect", folder, codes=(0, 1, 3))
            folder = self.bag(self.sound, mcap_file.chunk(broken))
            self.ends(f"schema whose {field} is 4 GiB long, in a chunk", "inspect", folder, codes=(0, 1, 3))
        self.bag(self.sound, zstd_chunks(200, 256 << 20))
        self.ends("200 chunks of 256 MiB in 4 MB", "inspect", folder, codes=(0, 1, 3))
        info = next(m for m in self.sound if m[0].endswith("color/camera_info"))
        doubles = (info[4][at : at + 8] for at in range(4, len(info[4]) - 8))
        focal = next(d for d in doubles if abs(struct.unpack("<d", d)[0] - 288.6) < 0.1)
        floods = {"are nan": [float("nan")] * 100_000, "differ": [288.6 + 1e-6 * i for i in range(100_000)]}
        for name, values in floods.items():
            self.bag(self.sound + [info[:4] + (info[4].replace(focal, struct.pack("<d", v), 1),) for v in values])
            self.ends(f"100,000 camera_infos that {name}", "inspect", folder, codes=(0, 1, 3))
        string = ("std_msgs/msg/String", b"string data")
        flood = [(f"/t{i}", *string, info[3] + i, b"\0\1\0\0\2\0\0\0a\0\0\0") for i in range(20_000)]
        self.bag(self.sound + flood)
        self.ends("20,000 topics", "inspect", folder, codes=(0, 1, 3))
        tf = next(m for m in self.sound if m[0] == "/tf")
        flood = [tf[:4] + (tf[4].replace(b"camera_link\0", b"c%010d\0" % i),) for i in range(200_000)]
        self.bag(self.sound + flood)
        self.ends("200,000 frames in /tf", "inspect", folder, codes=(0, 1, 3))
        odd = [(b"/x\x1b[2J\x1b]0;x\x07".decode(), *m[1:]) for m in self.sound if m[0] == "/object_mask"]
        self.bag(self.sound + odd)
        ended = run([self.binary, "inspect", folder])
        self.family.add(ended, "an escape reached the terminal" if "\x1b" in ended.text else "", "escapes in a topic")

    def texts(self):
        nested = {
            "YAML of 100,000 brackets": "x: " + "[" * 100_000 + "]" * 100_000,
            "YAML of 20,000 maps": "x: " + "{a: " * 20_000 + "1" + "}" * 20_000,
            "YAML of 100,000 list items": "- " * 100_000 + "x\n",
            "YAML whose anchors multiply": "a0: &a0 [x,x,x,x,x,x,x,x,x]\n"
            + "".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)),
        }
        for name, content in nested.items():
            folder = self.dataset()
            (folder / "init_keyframes.yml").write_text(content)
            self.ends(name, *self.reconstruct(folder))
            config = self.work / "config.yaml"
            config.write_text(content)
            self.ends(f"settings: {name}", "config", "show", "--config", config)
        for depth in (3000, 20_000, 100_000):
            self.urdf(f"{depth} nested elements", TWIN.replace("</robot>", "<x>" * depth + "</x>" * depth + "</robot>"), codes=(0, 1))
        entities = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
        self.urdf("entities that multiply", f'<!DOCTYPE r [<!ENTITY a0 "aaaaaaaaaa">{entities}]>' + TWIN.replace("</robot>", "&a9;</robot>"))
        for count, order in ((4000, 1), (40_000, -1), (100_000, 1)):
            chain = [joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(count - 1)][::order]
            self.urdf(f"a chain of {count} links", robot(*[link(f"l{i}") for i in range(count)], *chain), codes=(0, 1, 3))

    def urdf(self, name, content, codes=(1,)):
        folder = self.work / "costly_urdf"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / "t.urdf").write_text(content)
        self.ends(f"check: {name}", "check", folder, codes=codes)
        out = self.work / "costly_diagnosis"
        shutil.rmtree(out, ignore_errors=True)
        self.ends(f"diagnose: {name}", "diagnose", folder / "t.urdf", self.log, "--out", out, codes=(0, 1, 3))

    def files(self):
        shape = '<visual><geometry><mesh filename="z.obj"/></geometry></visual>'
        folder = self.work / "costly_urdf"
        for name, make in (("/dev/zero", lambda p: os.symlink("/dev/zero", p)), ("a FIFO", os.mkfifo)):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            (folder / "t.urdf").write_text(robot(link("a", shape), link("b"), joint("j", "a", "b")))
            make(folder / "z.obj")
            self.ends(f"{name} as a mesh", "check", folder, codes=(1,))
            data = self.dataset()
            (data / "cam_K.txt").unlink()
            make(data / "cam_K.txt")
            self.ends(f"{name} as cam_K.txt", "inspect", data, codes=(1,))
            bag = self.bag(self.sound)
            make(bag / "state0/metadata.yaml")
            self.ends(f"{name} as metadata.yaml", "inspect", bag, codes=(0, 1, 3))
            (bag / "state0/state0.mcap").unlink()
            make(bag / "state0/state0.mcap")
            self.ends(f"{name} as an MCAP file", "inspect", bag, codes=(1,))
            other = self.work / "special"
            other.unlink(missing_ok=True)
            make(other)
            self.ends(f"{name} as settings", "config", "show", "--config", other)
        (folder / "z.obj").unlink()
        (folder / "z.ply").write_text("ply\nformat ascii 1.0\n" + "".join(f"element q{i} 20000000\n" for i in range(20_000)) + "end_header\n")
        (folder / "t.urdf").write_text(robot(link("a", shape.replace("obj", "ply")), link("b"), joint("j", "a", "b")))
        self.ends("PLY of 20,000 lists of 2e7 elements without properties", "check", folder, codes=(0, 1))


def all_of(binary, work):
    costly = Costly(binary, work)
    for part in (costly.matches, costly.images, costly.bags, costly.texts, costly.files):
        part()
    return costly.family
