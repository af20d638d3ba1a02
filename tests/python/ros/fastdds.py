"""Fast DDS by tests/fastdds/peer.cpp (FASTDDS_PEER names the library), and how ROS 2 maps services on it: a reply tells the
identity of the sample that it answers."""
import ctypes
import os

RECEIVE_BUFFER_BYTES = 4 << 20
LARGEST_BYTES = 1 << 20

library = ctypes.CDLL(os.environ["FASTDDS_PEER"])
library.fd_join.restype = library.fd_endpoint.restype = ctypes.c_void_p
library.fd_endpoint.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p] + [ctypes.c_int] * 4 + [ctypes.c_uint32]
library.fd_matched.argtypes = [ctypes.c_void_p]
library.fd_write.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32, ctypes.c_char_p]
library.fd_take.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32, ctypes.c_char_p]
library.fd_take.restype = ctypes.c_int64


def join(domain):
    return made(library.fd_join(domain, RECEIVE_BUFFER_BYTES), f"domain {domain}")


def made(handle, what):
    if not handle:
        raise OSError(f"Fast DDS refuses {what}")
    return handle


class Endpoint:
    def __init__(self, participant, name, kind, reliable, latched, depth, writes):
        handle = library.fd_endpoint(participant, name.encode(), kind.encode(), writes, reliable, latched, depth, LARGEST_BYTES)
        self.handle, self.name = made(handle, name), name

    def matched(self):
        return library.fd_matched(self.handle)


class Writer(Endpoint):
    def __init__(self, *arguments):
        super().__init__(*arguments, True)

    def bytes(self, payload):
        payload, identity = bytes(payload), ctypes.create_string_buffer(24)
        if library.fd_write(self.handle, payload, len(payload), identity) < 0:
            raise OSError(f"{self.name}: write failed")
        return identity.raw


class Reader(Endpoint):
    def __init__(self, *arguments):
        super().__init__(*arguments, False)
        self.data, self.related = ctypes.create_string_buffer(LARGEST_BYTES), ctypes.create_string_buffer(24)

    def take_related(self):
        while length := library.fd_take(self.handle, self.data, LARGEST_BYTES, self.related):
            if length < 0:
                raise OSError(f"{self.name}: a sample is larger than {LARGEST_BYTES} bytes")
            yield self.related.raw, ctypes.string_at(self.data, length)

    def take(self):
        return [payload for _, payload in self.take_related()]


class Requests:
    def send(self, writer, body):
        return writer.bytes(body)

    def replies(self, reader):
        return reader.take_related()
