"""The program as a process under limits, and what speaks against how it ended."""
import os
import resource
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

# An abort, a panic, a hang or the kernel's killer; 101 is Rust's panic, 134 an abort, 137 a kill.
ACCIDENTS = ("panicked at", "overflowed its stack", "memory allocation of")


@dataclass
class Ended:
    code: int | None  # None: it was still running when its time was over
    out: str
    err: str
    seconds: float
    memory_mb: float

    @property
    def text(self):
        return self.out + self.err

    def accident(self):
        """Why no input may end the program so, or an empty text."""
        if self.code is None:
            return "hung"
        if self.code < 0 or self.code in (101, 134, 137):
            return f"ended by {self.code}"
        return next((a for a in ACCIDENTS if a in self.text), "")


def limits(memory_mb):
    def apply():
        os.nice(5)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory_mb:
            resource.setrlimit(resource.RLIMIT_AS, (memory_mb << 20, memory_mb << 20))

    return apply


def run(args, seconds=60, memory_mb=4096, stdout=None, **options):
    """Runs a command to its end, or kills it; its exit code, texts, wall time and largest resident memory."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        begin = time.time()
        child = subprocess.Popen(
            [str(a) for a in args], stdin=subprocess.DEVNULL, stdout=stdout or out, stderr=err, preexec_fn=limits(memory_mb), **options
        )
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                break
            if time.time() > begin + seconds:
                os.kill(child.pid, signal.SIGKILL)
                _, _, usage = os.wait4(child.pid, 0)
                status = None
                break
            time.sleep(0.003)
        child.returncode = -9 if status is None else os.waitstatus_to_exitcode(status)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read(400_000).decode(errors="replace"))
        code = None if status is None else child.returncode
        return Ended(code, *texts, time.time() - begin, usage.ru_maxrss / 1024)


def tree(folder):
    """Every file and link below a folder with its bytes or target."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = path.read_bytes()
    return found
