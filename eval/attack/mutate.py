"""Sound files made wrong in small ways, by a seed."""
import struct

LENGTHS = [0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1, 2**40, 256 << 20]
FLOATS = [float("nan"), float("inf"), -float("inf"), 0.0, 1e308, -1e308, 5e-324, -1.0, 1e300]


def place(rng, size):
    """Anywhere, or near the begin, or near the end."""
    kind = rng.randrange(4)
    if kind < 2:
        return rng.randrange(size)
    near = min(size - 1, int(rng.expovariate(1 / 400)))
    return near if kind == 2 else size - 1 - near


def file_bytes(rng, data):
    """A file with one to five places changed."""
    data = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 5])):
        if len(data) < 64:
            break
        at, kind = place(rng, len(data)), rng.randrange(9)
        span = rng.randrange(1, 5000)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            for _ in range(rng.randrange(2, 200)):
                data[place(rng, len(data))] = rng.randrange(256)
        elif kind == 2:
            del data[at:]
        elif kind == 3:
            del data[at : at + span]
        elif kind == 4:
            data[at:at] = data[at : at + span]
        elif kind == 5:
            width = rng.choice([4, 8])
            data[at : at + width] = (rng.choice(LENGTHS) % 2 ** (8 * width)).to_bytes(width, "little")
        elif kind == 6:
            data[at : at + rng.randrange(1, 64)] = b"\xff" * rng.randrange(1, 64)
        elif kind == 7:
            data[at : at + span] = bytes(span)
        else:
            data[at:at] = rng.randbytes(rng.randrange(1, 300))
    return bytes(data)


def payload(rng, data):
    """A serialized message with a length, a float or some bits changed, cut, or filled up."""
    data, kind = bytearray(data), rng.randrange(7)
    near = max(5, min(len(data) - 8, 700))
    at = rng.randrange(4, near) if near > 4 else 4
    if kind == 0:
        data[at & ~3 : (at & ~3) + 4] = struct.pack("<I", rng.choice(LENGTHS) % 2**32)
    elif kind == 1:
        data[4 + (at - 4 & ~7) : 12 + (at - 4 & ~7)] = struct.pack("<d", rng.choice(FLOATS))
    elif kind == 2:
        data[min(at, len(data) - 1)] ^= 1 << rng.randrange(8)
    elif kind == 3:
        del data[rng.randrange(len(data)) :]
    elif kind == 4:
        data[:4] = rng.randbytes(4)
    elif kind == 5:
        data[4:12] = rng.choice([bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f\xff\xc9\x9a\x3b", b"\0\0\0\x80\0\0\0\0"])
    else:
        data = data[:4] + rng.randbytes(rng.randrange(0, 16))
    return bytes(data)


def messages(rng, all_messages):
    """Messages with some of one topic changed, dropped, doubled, renamed, or out of order."""
    all_messages = list(all_messages)
    topic = rng.choice(sorted({m[0] for m in all_messages}))
    of_topic = [i for i, m in enumerate(all_messages) if m[0] == topic]
    some = of_topic if rng.random() < 0.6 else [rng.choice(of_topic)]
    kind = rng.randrange(8)
    if kind < 4:
        seed = rng.random()
        for i in some:
            own = type(rng)(seed)
            all_messages[i] = all_messages[i][:4] + (payload(own, all_messages[i][4]),)
    elif kind == 4:
        chosen = set(some)
        all_messages = [m for i, m in enumerate(all_messages) if i not in chosen or rng.random() < 0.5]
    elif kind == 5:
        other = rng.choice(sorted({m[1] for m in all_messages}) + ["std_msgs/msg/String", "", "x" * 3000, "../../x"])
        for i in some:
            all_messages[i] = (topic, other) + all_messages[i][2:]
    elif kind == 6:
        nanos = rng.choice([0, 2**63 - 1, 2**64 - 1])
        for i in some:
            all_messages[i] = all_messages[i][:3] + (nanos, all_messages[i][4])
    else:
        rng.shuffle(all_messages)
    return all_messages
