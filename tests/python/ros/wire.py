"""Reads `{"type": .., "hex": .., "fields": {path: value}}` a line and holds it against rosbags: the bytes are those of
rosbags, and the fields have these values."""
import json
import sys

from peer import typestore


def field(message, path):
    for part in path.split("."):
        message = message[int(part)] if part.isdigit() else getattr(message, part)
    return message.tolist() if hasattr(message, "tolist") else message


def main():
    store = typestore()
    count = 0
    for line in sys.stdin:
        case = json.loads(line)
        payload = bytes.fromhex(case["hex"])
        message = store.deserialize_cdr(payload, case["type"])
        back = bytes(store.serialize_cdr(message, case["type"]))
        if back != payload:
            sys.exit(f"{case['type']}: {len(payload)} bytes here, {len(back)} by rosbags, or others")
        for path, value in case["fields"].items():
            found = field(message, path)
            if found != value:
                sys.exit(f"{case['type']}.{path} is {found}, not {value}")
        count += 1
    print(count)


main()
